"""How often a motion that is called safe is not: never, it is to be.

    python benchmarks/safety_adversary.py [--quick] [--trials N] [--first SEED] [--only SPOILER ...]
    python benchmarks/safety_adversary.py --seed SEED

A seed picks a motion beside obstacles and spoils it (``tests/adversary/safety.py``, whose docstring has the law, and
``motions.py``). Per kind the table counts what was refused, not called safe, not known (``safe`` is None), called safe
and truly clear by a dense simulation, and called safe and not clear: faults, which are listed with their seeds. The
first rows are not spoilt; below the table stands how many of these are called safe, with pairs and without, and how
many of the others are clear by the simulation. With ``--seed`` one trial is repeated. The exit code is 0 where there is
no fault. Two processes share the work: ``--trials 1000``, and ``--trials 1000 --first 1000``.
"""

from __future__ import annotations

import sys
from pathlib import Path

from spoilt_trials import chosen_seeds, tabulated

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from adversary.motions import DOCUMENTED, SPOILERS, WITH_PAIRS, WITHOUT_PAIRS
from adversary.safety import Trial, Verdict, tried

QUICK = ("nothing", "data_by_time", "no_history")


def main() -> None:
    """Run and print."""
    faults = report(chosen_seeds(__doc__, SPOILERS, QUICK, tried, Verdict.FAULT))
    for fault in faults:
        print(fault)
    sys.exit(bool(faults))


def report(seeds: list[int]) -> list[Trial]:
    """Try them, print the table and what became of motions not spoilt; give the faults that no page documents."""
    trials = tabulated(seeds, tried, SPOILERS, Verdict.FAULT)
    for words, names in (("without pairs", WITHOUT_PAIRS), ("with pairs", WITH_PAIRS)):
        unspoilt = [trial for trial in trials if trial.spoiler in names]
        lost = [trial for trial in unspoilt if trial.verdict not in (Verdict.TRUE, Verdict.FAULT)]
        unknown = sum(trial.verdict is Verdict.NOT_KNOWN for trial in lost)
        clear = sum(bool(trial.clear) for trial in lost)
        print(
            f"not spoilt, {words}: {len(unspoilt)} trials, {len(unspoilt) - len(lost)} called safe, {unknown} not "
            f"known, {len(lost) - unknown} not safe; {clear} of the {len(lost)} lost are clear by the simulation"
        )
    faults = [trial for trial in trials if trial.verdict is Verdict.FAULT]
    undocumented = [fault for fault in faults if fault.spoiler not in DOCUMENTED]
    limits = len(faults) - len(undocumented)
    print(f"\n{len(undocumented)} faults, and {limits} beyond documented limits, in {len(seeds)} trials")
    return undocumented


if __name__ == "__main__":
    main()
