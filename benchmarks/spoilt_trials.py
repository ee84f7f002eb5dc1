"""What the two adversaries share: their arguments, the seeds that these choose, and the table of what came of them."""

from __future__ import annotations

import argparse
import sys
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from enum import Enum
from typing import Any

from table import Table, show_progress

TRIALS = 2000


def chosen_seeds(
    description: str | None, spoilers: Iterable[str], quick: tuple[str, ...], tried: Callable[[int], Any], fault: Enum
) -> list[int]:
    """The seeds that the arguments of the command line name; with ``--seed`` one trial is printed, and that is all.

    Parameters
    ----------
    description : str
        Docstring of the benchmark.
    spoilers : names
        They take turns: a seed stands for the spoiler at its remainder.
    quick : names
        Spoilers that ``--quick`` tries, twice each.
    tried : callable
        From a seed to its trial.
    fault : Verdict
        That must not be.
    """
    turn = list(spoilers)
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="two trials of three spoilers")
    parser.add_argument("--trials", type=int, default=TRIALS, metavar="N", help=f"{TRIALS} by default")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="of the trials; 0 by default")
    parser.add_argument("--only", nargs="+", choices=turn, metavar="SPOILER", help="some of the spoilers")
    parser.add_argument("--seed", type=int, help="one trial, told in full")
    arguments = parser.parse_args()
    if arguments.seed is not None:
        trial = tried(arguments.seed)
        print(trial)
        sys.exit(trial.verdict is fault)
    chosen = arguments.only or (quick if arguments.quick else turn)
    trials = 2 * len(turn) if arguments.quick else arguments.trials
    seeds = range(arguments.first, arguments.first + trials)
    return [seed for seed in seeds if turn[seed % len(turn)] in chosen]


def tabulated(seeds: list[int], tried: Callable[[int], Any], spoilers: Iterable[str], fault: Enum) -> list[Any]:
    """Try the seeds, print the table of how often which verdict came of each spoiler, and give the trials."""
    verdicts = list(type(fault))
    counts: dict[str, Counter[Enum]] = defaultdict(Counter)
    trials = []
    for done, seed in enumerate(seeds):
        show_progress(f"{done} of {len(seeds)}, {sum(of[fault] for of in counts.values())} faults")
        trials.append(trial := tried(seed))
        counts[trial.spoiler][trial.verdict] += 1
    show_progress("")
    table = Table([("spoilt by", "<32s"), ("trials", ">6d"), *((verdict.value, ">10d") for verdict in verdicts)])
    table.header()
    for name in (name for name in spoilers if name in counts):
        table.add(name, counts[name].total(), *(counts[name][verdict] for verdict in verdicts))
    return trials
