"""Run an example as a script: build, solve, report, verify, draw. The same command line for all of them."""

from __future__ import annotations

import argparse
import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pyomo.environ as pyo
from matplotlib.figure import Figure

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.obstacles import ObstacleAvoidanceBlockData

Case = Mapping[str, Any]


def run_example(
    build: Callable[..., pyo.ConcreteModel],
    draw: Callable[[Any, pyo.ConcreteModel], None],
    *,
    cases: Mapping[str, Case],
    default: str,
    coarse: Case,
    size: tuple[float, float] = (10.0, 4.6),
    search: Callable[..., tuple[pyo.ConcreteModel, rcp.SolveResult]] | None = None,
    animate: Callable[[pyo.ConcreteModel, Path], Any] | None = None,
) -> None:
    """Read the command line, run the cases it names, and exit with 0 only if all of them were solved.

    A plan around obstacles is solved only if its clearances are proven at all times; the result shows by how much.

    Parameters
    ----------
    build : callable
        Makes the model; its file is the example, and names the picture.
    draw : callable
        ``draw(figure, model)`` draws a solved model onto a figure or subfigure.
    cases : mapping of name to arguments of build
        What the example offers.
    default : str
        The case that runs unless another is named; ``"all"`` for all of them, side by side.
    coarse : mapping
        Arguments of build for a quick look on few elements.
    size : (width, height)
        Of the picture, inches; 100 pixels each.
    search : callable, optional
        Finds the best of many models and its result, in place of building and solving one; called with a case and
        options of `solve`.
    animate : callable, optional
        ``animate(model, path)`` writes a GIF of a solved model; where bodies avoid obstacles there is one anyway.
    """
    source = Path(inspect.getfile(build))
    arguments = _read_command_line(str(inspect.getmodule(build).__doc__), cases, default)
    arguments.output.mkdir(parents=True, exist_ok=True)
    chosen = list(cases) if arguments.case == "all" else [arguments.case]

    figure = Figure(figsize=size, dpi=100, layout="constrained")
    places = figure.subfigures(1, len(chosen), squeeze=False)[0]
    solved = True
    for name, place in zip(chosen, places, strict=True):
        case = {**cases[name], **(coarse if arguments.coarse else {})}
        options = {"backend": arguments.backend, "tee": arguments.tee}
        if search is None:
            model = build(**case)
            model.name = f"{model.name} - {name}"
            result = rcp.solve(model, **options)
        else:
            model, result = search(**case, **options)
        print(result)
        for phase in rcp.phases_of(model):
            print(f"\nphase '{phase.name}', recomputed from its equations:\n{phase.trajectory().verify()}")
        for avoid in model.block_data_objects(active=True):
            if arguments.animate and isinstance(avoid, ObstacleAvoidanceBlockData):
                film = arguments.output / f"{source.stem}_{name}.gif"
                print(f"animation: {rcp.drawing.animate_avoidance(avoid, film, title=model.name)}")
        if arguments.animate and animate is not None:
            print(f"animation: {animate(model, arguments.output / f'{source.stem}_{name}.gif')}")
        print()
        draw(place, model)
        # Of a team not a solver's status counts, but what its plan is worth physically.
        solved = solved and (result.success if isinstance(result, rcp.teams.TeamResult) else result.solved)

    picture = arguments.output / f"{source.stem}.png"
    figure.savefig(picture)
    print(f"picture: {picture}")
    raise SystemExit(0 if solved else 1)


def _read_command_line(description: str, cases: Mapping[str, Case], default: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--case", choices=[*cases, "all"], default=default, help=f"default: {default}")
    parser.add_argument("--coarse", action="store_true", help="few elements, for a quick look")
    parser.add_argument("--output", type=Path, default=Path("output"), help="folder of the picture (default: output)")
    parser.add_argument(
        "--animate",
        action="store_true",
        help="write a GIF per case where bodies avoid obstacles, or the example has a film of its own",
    )
    parser.add_argument(
        "--backend",
        choices=["in process", "asl", "casadi", "vectorised", "executable"],
        help="default: vectorised where bodies avoid obstacles, else the best found",
    )
    parser.add_argument("--tee", action="store_true", help="show Ipopt's log")
    return parser.parse_args()
