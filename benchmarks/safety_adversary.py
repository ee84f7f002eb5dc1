"""How often a motion that is called safe is not: never, it is to be.

    python benchmarks/safety_adversary.py [--quick] [--trials N] [--first SEED] [--only SPOILER ...]
    python benchmarks/safety_adversary.py --seed SEED

A seed picks a motion beside obstacles and spoils it between the points of the mesh (``tests/adversary/safety.py``,
whose docstring has the law). Per spoiler the table counts what was refused, not called safe, called safe and truly
clear by a dense simulation, and called safe and not clear: faults, which are listed with their seeds. The first rows
are not spoilt. With ``--seed`` one trial is repeated. The exit code is 0 where there is no fault.
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

from spoilt_trials import chosen_seeds, tabulated

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from adversary.safety import DOCUMENTED, SPOILERS, UNSPOILT, Trial, Verdict, tried

QUICK = ("nothing", "data_by_time", "no_history")


def main() -> None:
    """Run and print."""
    faults = report(chosen_seeds(__doc__, SPOILERS, QUICK, tried, Verdict.FAULT))
    for fault in faults:
        print(fault)
    sys.exit(bool(faults))


def report(seeds: list[int]) -> list[Trial]:
    """Try them, print the table, and give the faults that no page documents."""
    counts, faults = tabulated(seeds, tried, SPOILERS, Verdict.FAULT)
    unspoilt = sum((counts[name] for name in UNSPOILT if name in counts), Counter())
    lost = unspoilt.total() - unspoilt[Verdict.TRUE] - unspoilt[Verdict.FAULT]
    share = f", {lost} of {unspoilt.total()} that are not spoilt are not called safe" if unspoilt else ""
    undocumented = [fault for fault in faults if fault.spoiler not in DOCUMENTED]
    limits = len(faults) - len(undocumented)
    print(f"\n{len(undocumented)} faults, and {limits} beyond documented limits, in {len(seeds)} trials{share}")
    return undocumented


if __name__ == "__main__":
    main()
