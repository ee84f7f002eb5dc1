"""How often a motion that is called safe is not: never, it is to be.

    python benchmarks/safety_adversary.py [--quick] [--trials N] [--first SEED] [--only SPOILER ...]
    python benchmarks/safety_adversary.py --seed SEED

A seed picks a motion beside obstacles and spoils it between the points of the mesh (``tests/adversary/safety.py``,
whose docstring has the law). Per spoiler the table counts what was refused, not called safe, called safe and truly
clear by a dense simulation, and called safe and not clear: faults, which are listed with their seeds. The first rows
are not spoilt. With ``--seed`` one trial is repeated. The exit code is 0 where there is no fault.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter, defaultdict
from pathlib import Path

from table import Table, show_progress

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from adversary.safety import DOCUMENTED, SPOILERS, UNSPOILT, Trial, Verdict, tried

TRIALS, QUICK = 2000, ("nothing", "data_by_time", "no_history")
COLUMNS = [("spoilt by", "<24s"), ("trials", ">6d"), *((verdict.value, ">10d") for verdict in Verdict)]


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="two trials of three spoilers")
    parser.add_argument("--trials", type=int, default=TRIALS, metavar="N", help=f"{TRIALS} by default")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="of the trials; 0 by default")
    parser.add_argument("--only", nargs="+", choices=SPOILERS, metavar="SPOILER", help="some of the spoilers")
    parser.add_argument("--seed", type=int, help="one trial")
    arguments = parser.parse_args()
    if arguments.seed is not None:
        trial = tried(arguments.seed)
        print(trial)
        sys.exit(trial.verdict is Verdict.FAULT)
    chosen = arguments.only or (QUICK if arguments.quick else list(SPOILERS))
    trials = 2 * len(SPOILERS) if arguments.quick else arguments.trials
    turn = list(SPOILERS)
    seeds = [seed for seed in range(arguments.first, arguments.first + trials) if turn[seed % len(turn)] in chosen]
    faults = report(seeds)
    for fault in faults:
        print(fault)
    sys.exit(bool(faults))


def report(seeds: list[int]) -> list[Trial]:
    """Try them, print the table, and give the faults."""
    found: dict[str, Counter[Verdict]] = defaultdict(Counter)
    faults = []
    for done, seed in enumerate(seeds):
        show_progress(f"{done} of {len(seeds)}, {len(faults)} faults")
        trial = tried(seed)
        found[trial.spoiler][trial.verdict] += 1
        if trial.verdict is Verdict.FAULT:
            faults.append(trial)
    show_progress("")
    table = Table(COLUMNS)
    table.header()
    for name in (name for name in SPOILERS if name in found):
        table.add(name, found[name].total(), *(found[name][verdict] for verdict in Verdict))
    unspoilt = sum((found[name] for name in UNSPOILT if name in found), Counter())
    lost = unspoilt.total() - unspoilt[Verdict.TRUE] - unspoilt[Verdict.FAULT]
    share = f", {lost} of {unspoilt.total()} that are not spoilt are not called safe" if unspoilt else ""
    undocumented = [fault for fault in faults if fault.spoiler not in DOCUMENTED]
    limits = len(faults) - len(undocumented)
    print(f"\n{len(undocumented)} faults, and {limits} beyond documented limits, in {len(seeds)} trials{share}")
    return undocumented


if __name__ == "__main__":
    main()
