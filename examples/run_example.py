"""Run an example as a script: build, solve, report, verify, draw. The same command line for all of them."""

from __future__ import annotations

import argparse
import inspect
import json
import os
from collections.abc import Callable, Mapping, Sequence
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
        Of the picture of the default choice, inches; 100 pixels each. Several cases side by side are so many times as
        wide where the default is one.
    search : callable, optional
        Finds the best of many models and its result, in place of building and solving one; called with a case and
        options of `solve`.
    animate : callable, optional
        ``animate(model, path)`` writes a GIF of a solved model; where bodies avoid obstacles there is one anyway.
    """
    source = Path(inspect.getfile(build))
    arguments = _read_command_line(str(inspect.getmodule(build).__doc__), cases, default)
    arguments.output.mkdir(parents=True, exist_ok=True)
    shown = list(cases) if arguments.case == "all" else [arguments.case]

    wide = 1 if default == "all" else len(shown)
    figure = Figure(figsize=(wide * size[0], size[1]), dpi=100, layout="constrained")
    places = dict(zip(shown, figure.subfigures(1, len(shown), squeeze=False)[0], strict=True))
    solved, facts = True, {}
    for name in shown if arguments.facts is None else cases:
        started = _cpu_seconds()
        case = {**cases[name], **(coarse if arguments.coarse else {})}
        options = {"backend": arguments.backend, "tee": arguments.tee}
        if search is None:
            model = build(**case)
            model.name = f"{model.name} - {name}"
            result = rcp.solve(model, mesh_tolerance=None, **options)  # published values are those of their meshes
        else:
            model, result = search(**case, **options)
        spent = _cpu_seconds() - started
        print(result)
        if isinstance(result, rcp.SolveResult):  # teams say it themselves
            print(f"{result.solver}, derivatives by {result.derivatives}.")
        checks = {phase.name: phase.trajectory().verify() for phase in rcp.phases_of(model)}
        for phase, check in checks.items():
            print(f"\nphase '{phase}', recomputed from its equations:\n{check}")
        facts[name] = {"cpu": spent} | facts_of(model, result, list(checks.values()))
        for avoid in model.block_data_objects(active=True):
            if arguments.animate and isinstance(avoid, ObstacleAvoidanceBlockData):
                film = arguments.output / f"{source.stem}_{name}.gif"
                print(f"animation: {rcp.scenes.animate_avoidance(avoid, film, title=model.name)}")
        if arguments.animate and animate is not None:
            print(f"animation: {animate(model, arguments.output / f'{source.stem}_{name}.gif')}")
        print()
        if name in places:
            draw(places[name], model)
        solved = solved and facts[name]["solved"]

    if arguments.facts is not None:
        arguments.facts.write_text(json.dumps(facts, indent=1))
    picture = arguments.output / f"{source.stem}.png"
    figure.savefig(picture)
    print(f"picture: {picture}")
    raise SystemExit(0 if solved else 1)


def facts_of(
    m: pyo.ConcreteModel, result: rcp.SolveResult | rcp.teams.TeamResult, checks: Sequence[rcp.Verification]
) -> dict[str, Any]:
    """Size of a solved model and what came out, as numbers and words; given the checks of its phases.

    Returns
    -------
    dict
        ``solved`` tells whether it counts as solved; ``iterations``, ``objective`` and ``verdict`` what came out. Of
        one model also ``variables``, ``rows`` and ``pairs``, and recomputed from the equations of its phases, or from
        its rows where it has none, ``violation``, ``product`` and ``horizon``, the error of re-integration.
    """
    if isinstance(result, rcp.teams.TeamResult):
        counts = [count for record in result.rounds for _, count, _ in record.reports.values()]
        # Not a solver's status counts, but what the plan is worth physically.
        worth = "agreed" if result.score is None else "strict" if result.score.strict else "practical"
        verdict = f"{worth if result.success else 'FAILED'}: {len(result.plans)} agents, {len(result.rounds)} rounds"
        return {"solved": result.success, "iterations": sum(counts), "objective": result.objective, "verdict": verdict}
    horizons = [check.horizon_error for check in checks if check.horizon_error is not None]
    verdict = result.quality.name.lower()
    if result.residuals:
        verdict += f", {result.certificate.name.lower()}"
    if result.safety is not None:
        verdict += ", NOT CLEAR" if result.safe is False else ", clear"
    return {
        "solved": result.solved,
        "variables": sum(not v.fixed for v in m.component_data_objects(pyo.Var, active=True)),
        "rows": sum(1 for _ in m.component_data_objects(pyo.Constraint, active=True)),
        "pairs": len(result.residuals),
        "iterations": result.iterations,
        "objective": result.objective,
        "violation": max((check.largest_violation for check in checks), default=result.constraint_violation),
        "product": max((check.product for check in checks), default=result.largest_product),
        "horizon": max(horizons, default=None),
        "verdict": verdict,
    }


def _cpu_seconds() -> float:
    """Of this process and of its children that have ended."""
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


def _read_command_line(description: str, cases: Mapping[str, Case], default: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--case", choices=[*cases, "all"], default=default, help=f"default: {default}")
    parser.add_argument("--coarse", action="store_true", help="few elements, for a quick look")
    parser.add_argument("--output", type=Path, default=Path("output"), help="folder of the picture (default: output)")
    parser.add_argument(
        "--facts",
        type=Path,
        metavar="FILE",
        help="solve all cases, draw the chosen, and write sizes, results and CPU seconds of all as JSON",
    )
    parser.add_argument(
        "--animate",
        action="store_true",
        help="write a GIF per case where bodies avoid obstacles, or the example has a film of its own",
    )
    parser.add_argument(
        "--backend",
        choices=["in process", "asl", "vectorised", "executable"],
        help="default: the first found that takes the model",
    )
    parser.add_argument("--tee", action="store_true", help="show Ipopt's log")
    return parser.parse_args()
