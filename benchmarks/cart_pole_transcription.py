"""What a modelling layer costs: a cart-pole swing-up from nothing to its solution, stated in several ways.

    python benchmarks/cart_pole_transcription.py [--quick] [--elements N ...] [--repeat N]

Each way makes the same nonlinear program (see ``cart_pole_ways.py``) with three Radau stages per element, from the
same straight line; the objectives must agree. Each column is the smallest number of seconds of several runs, "total"
their sum. "hand-off" is all that is neither stating nor Ipopt: writing, loading, starting, reading back, and for
phases also the checks before; "check" is the recomputation of the answer's residuals, which the other ways do not do.
"ratio" is the total against this package in process.

``pyomo.dae`` keeps derivatives as variables, and Ipopt may need many more iterations then: "derivatives kept" is the
same formulation by this package, which tells the cost of the layer from the gain by the formulation.
"""

from __future__ import annotations

import argparse
import gc
from collections.abc import Callable

from cart_pole_ways import Measured, as_phase, by_hand_in_casadi, by_pyomo_dae
from table import Table, show_progress

import pyrobocop_pyomo as rcp

OURS = "phase, in process, ASL"


def ways() -> dict[str, Callable[[int], Measured]]:
    """What can be measured on this machine."""
    found = rcp.ipopt.available_backends()
    chosen: dict[str, Callable[[int], Measured]] = {}
    if rcp.ipopt.Backend.IN_PROCESS_ASL in found:
        chosen[OURS] = lambda n: as_phase(n, "asl")
        chosen["phase, derivatives kept"] = lambda n: as_phase(n, "asl", keep_derivatives=True)
    if rcp.ipopt.Backend.IN_PROCESS_VECTORISED in found:
        chosen["phase, in process, vectorised"] = lambda n: as_phase(n, "vectorised")
    if rcp.ipopt.Backend.EXECUTABLE in found:
        chosen["phase, executable"] = lambda n: as_phase(n, "executable")
        chosen["pyomo.dae, executable"] = by_pyomo_dae
    chosen["CasADi by hand, vectorised"] = by_hand_in_casadi
    return chosen


def main() -> None:
    """Print the table; exit with 1 when the objectives disagree."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="20 elements, once")
    parser.add_argument("--elements", type=int, nargs="+", default=[50, 200, 1000])
    parser.add_argument("--repeat", type=int, default=3, help="runs of each; the fastest counts")
    arguments = parser.parse_args()
    meshes, repeat = ([20], 1) if arguments.quick else (arguments.elements, arguments.repeat)

    table = Table(
        [
            ("elements", ">8d"), ("way", "<29"), ("build", ">7.3f"), ("transcribe", ">10.3f"), ("hand-off", ">8.3f"),
            ("solve", ">7.3f"), ("check", ">6.3f"), ("total", ">7.3f"), ("ratio", ">5.2f"), ("iterations", ">10d"),
            ("variables", ">9d"), ("objective", ">11.7f"),
        ]
    )  # fmt: skip
    table.header()
    agree = True
    for elements in meshes:
        fastest: dict[str, Measured] = {}
        # Round by round, so that a disturbance of the machine does not fall on one way alone.
        for turn in range(repeat):
            for way, measure in ways().items():
                show_progress(f"{elements} elements, {way}, run {turn + 1} of {repeat}")
                gc.collect()
                measured = measure(elements)
                fastest[way] = measured if way not in fastest else fastest[way].or_faster(measured)
        show_progress("")
        reference = fastest.get(OURS, next(iter(fastest.values())))
        for way, best in fastest.items():
            table.add(
                elements, way, best.build, best.transcribe, best.hand_off, best.solve, best.check, best.total,
                best.total / reference.total, best.iterations, best.variables, best.objective,
            )  # fmt: skip
        agree = agree and all(abs(best.objective - reference.objective) < 1e-5 for best in fastest.values())
    print("all objectives agree" if agree else "the objectives differ: the table compares different problems")
    raise SystemExit(0 if agree else 1)


if __name__ == "__main__":
    main()
