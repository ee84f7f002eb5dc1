"""How often a problem that was spoilt has a wrong answer with a clean report: never, it is to be.

    python benchmarks/adversary.py [--quick] [--trials N] [--first SEED] [--only SPOILER ...]
    python benchmarks/adversary.py --seed SEED

A seed picks a problem with a known answer and spoils it in one way, or states one whose answer is known from
mathematics (``tests/adversary``, whose docstrings say what is right). The kinds take turns. Per kind the table counts
what was refused, not solved, named as doubtful, and answered rightly. Faults are listed with their seeds. With
``--seed`` one of them is repeated in full. The exit code is 0 where there is no fault. Two processes share the work:
``--trials 1000``, and ``--trials 1000 --first 1000``.
"""

from __future__ import annotations

import sys
from pathlib import Path

from spoilt_trials import chosen_seeds, tabulated

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
from adversary.trial import KINDS, Verdict, executable_found, tried

QUICK = ("scaled_objective", "row_said_twice", "contradiction")


def main() -> None:
    """Run and print."""
    if not executable_found() and not {"-h", "--help"} & set(sys.argv):
        sys.exit("the judge needs the executable of Ipopt: python build_asl.py")
    seeds = chosen_seeds(__doc__, KINDS, QUICK, tried, Verdict.FAULT)
    faults = [trial for trial in tabulated(seeds, tried, KINDS, Verdict.FAULT) if trial.verdict is Verdict.FAULT]
    print(f"\n{len(faults)} faults in {len(seeds)} trials")
    for fault in faults:
        print(" ".join(str(fault).split())[:300])
    sys.exit(bool(faults))


if __name__ == "__main__":
    main()
