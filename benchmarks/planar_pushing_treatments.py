"""Planar pushing with stick and slip under each treatment of complementarity, by each way to Ipopt.

    python benchmarks/planar_pushing_treatments.py [--quick] [--elements N] [--repeat N]

"a*b" is the largest product of a complementary pair at the end: what it says about contact is only worth as much as
that number is small. "J" is the cost without any penalty. All runs start from zero; nothing is tuned per run.

(i) to (v) are the treatments of Raghunathan, Jha & Romeres, ICRA 2022, sec. III-B, doi:10.1109/ICRA46639.2022.9812069,
with their tolerance delta = 1e-4 where it is fixed.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import pyomo.environ as pyo
from table import Table, show_progress

import pyrobocop_pyomo as rcp

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
from planar_pushing import GOALS, build

FOLLOW_MU = rcp.relaxations.FollowBarrier(factor=1.0)
CONTINUED = rcp.relaxations.Geometric(first=1e-4, factor=0.1, last=1e-8)

TREATMENTS = {
    "(i)   pair, 1e-4": rcp.Strategy(grouping="pair", schedule=rcp.relaxations.Fixed(1e-4)),
    "(i)   pair, 1e-4 to 1e-8": rcp.Strategy(grouping="pair", schedule=CONTINUED),
    "(ii)  element, 1e-4": rcp.Strategy(grouping="element", schedule=rcp.relaxations.Fixed(1e-4)),
    "(ii)  element, 1e-4 to 1e-8": rcp.Strategy(grouping="element", schedule=CONTINUED),
    "(iii) pair, delta = mu": rcp.Strategy(grouping="pair", schedule=FOLLOW_MU),
    "(iv)  element, delta = mu": rcp.Strategy(grouping="element", schedule=FOLLOW_MU),
    "(v)   penalty, weight 1e4": rcp.Strategy(relaxation="penalty", schedule=rcp.relaxations.Fixed(1e-4)),
    "(v)   penalty, weight 10": rcp.Strategy(relaxation="penalty", schedule=rcp.relaxations.Fixed(0.1)),
    "default of rcp.solve": None,
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="20 elements, one goal, the best backend, once")
    parser.add_argument("--elements", type=int, default=100)
    parser.add_argument("--repeat", type=int, default=2, help="runs of each; the fastest counts")
    arguments = parser.parse_args()
    elements, repeat = (20, 1) if arguments.quick else (arguments.elements, arguments.repeat)
    goals = {"turn": GOALS["turn"]} if arguments.quick else GOALS
    backends = rcp.ipopt.available_backends()[:1] if arguments.quick else rcp.ipopt.available_backends()

    print(f"planar pushing, {elements} elements of implicit Euler, fastest of {repeat}; seconds include writing\n")
    table = Table(
        [
            ("goal", "<14"), ("treatment", "<27"), ("backend", "<17"), ("J", ">9.5f"), ("iterations", ">10d"),
            ("a*b", ">8.1e"), ("violation", ">9.1e"), ("seconds", ">7.2f"), ("status", "<20"),
        ]
    )  # fmt: skip
    table.header()
    for goal, target in goals.items():
        for treatment, strategy in TREATMENTS.items():
            for backend in backends:
                show_progress(f"{goal}, {treatment}, {backend.name}")
                model = build(target, elements=elements)
                start = [(v, v.value) for v in model.component_data_objects(pyo.Var)]
                results = []
                for _ in range(repeat):
                    for variable, number in start:
                        variable.set_value(number, skip_validation=True)
                    results.append(rcp.solve(model, backend=backend, progress=False, strategies=strategy))
                result = min(results, key=lambda candidate: candidate.seconds)
                show_progress("")
                table.add(
                    goal,
                    treatment,
                    backend.name.lower(),
                    result.objective,
                    result.iterations,
                    result.largest_product,
                    result.constraint_violation,
                    result.seconds,
                    result.steps[result.best.number].status.name,
                )


if __name__ == "__main__":
    main()
