"""How often a problem that was spoilt has a wrong answer with a clean report: never, it is to be.

    python benchmarks/adversary.py [--quick] [--trials N] [--first SEED] [--only SPOILER ...]
    python benchmarks/adversary.py --seed SEED

A seed picks a problem with a known answer and spoils it in one way (``tests/adversary``, whose docstring says what is
right). Per spoiler the table counts what was refused, not solved, named as doubtful, and answered rightly. Faults are
listed with their seeds. With ``--seed`` one of them is repeated in full. The exit code is 0 where there is no fault.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter, defaultdict
from pathlib import Path

from table import Table, show_progress

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from adversary.spoilers import SPOILERS
from adversary.trial import Trial, Verdict, executable_found, tried

TRIALS, QUICK = 2000, ("scaled_objective", "row_said_twice", "contradiction")
COLUMNS = [("spoilt by", "<32s"), ("trials", ">6d"), *((verdict.value, ">10d") for verdict in Verdict)]


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="two trials of three spoilers")
    parser.add_argument("--trials", type=int, default=TRIALS, metavar="N", help=f"{TRIALS} by default")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="of the trials; 0 by default")
    parser.add_argument("--only", nargs="+", choices=SPOILERS, metavar="SPOILER", help="some of the spoilers")
    parser.add_argument("--seed", type=int, help="one trial, told in full")
    arguments = parser.parse_args()
    if not executable_found():
        sys.exit("the judge needs the executable of Ipopt: python -m pyrobocop_pyomo build-asl")
    if arguments.seed is not None:
        trial = tried(arguments.seed)
        print(trial)
        sys.exit(trial.verdict is Verdict.FAULT)
    chosen = arguments.only or (QUICK if arguments.quick else list(SPOILERS))
    trials = 2 * len(SPOILERS) if arguments.quick else arguments.trials
    turn = list(SPOILERS)
    seeds = range(arguments.first, arguments.first + trials)
    faults = report([seed for seed in seeds if turn[seed % len(turn)] in chosen])
    for fault in faults:
        print(" ".join(str(fault).split())[:300])
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
    print(f"\n{len(faults)} faults in {len(seeds)} trials")
    return faults


if __name__ == "__main__":
    main()
