"""How often a problem that was spoilt has a wrong answer with a clean report: never, it is to be.

    python benchmarks/adversary.py [--quick] [--trials N] [--first SEED] [--only SPOILER ...]
    python benchmarks/adversary.py --seed SEED

A seed picks a problem with a known answer and spoils it in one way (``tests/adversary``, whose docstring says what is
right). Per spoiler the table counts what was refused, not solved, named as doubtful, and answered rightly. Faults are
listed with their seeds. With ``--seed`` one of them is repeated in full. The exit code is 0 where there is no fault.
"""

from __future__ import annotations

import sys
from pathlib import Path

from spoilt_trials import chosen_seeds, tabulated

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from adversary.spoilers import SPOILERS
from adversary.trial import Verdict, executable_found, tried

QUICK = ("scaled_objective", "row_said_twice", "contradiction")


def main() -> None:
    """Run and print."""
    if not executable_found() and not {"-h", "--help"} & set(sys.argv):
        sys.exit("the judge needs the executable of Ipopt: python -m pyrobocop_pyomo build-asl")
    seeds = chosen_seeds(__doc__, SPOILERS, QUICK, tried, Verdict.FAULT)
    _, faults = tabulated(seeds, tried, SPOILERS, Verdict.FAULT)
    print(f"\n{len(faults)} faults in {len(seeds)} trials")
    for fault in faults:
        print(" ".join(str(fault).split())[:300])
    sys.exit(bool(faults))


if __name__ == "__main__":
    main()
