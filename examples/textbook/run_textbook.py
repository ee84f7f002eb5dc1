"""Run a textbook problem as a script: what `run_example` does, with the published value beside ours."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

sys.path.append(str(Path(__file__).parents[1]))  # where the other examples are
from run_example import run_example


def run_textbook(
    build: Callable[..., pyo.ConcreteModel],
    draw: Callable[[Any, pyo.ConcreteModel], None],
    published: float,
    *,
    elements: int | None = None,
    coarse: int = 10,
) -> None:
    """Solve with defaults, compare with the published value, verify and draw.

    Parameters
    ----------
    build : callable
        ``build(mesh, elements)`` makes the model; either may be None.
    draw : callable
        ``draw(figure, model)``.
    published : float
        The best published value of the objective.
    elements : int, optional
        Of each phase; by default those of `PhaseBlock`.
    coarse : int
        Elements of a quick look.
    """

    def solve(backend: str | None, tee: bool, **case: Any) -> tuple[pyo.ConcreteModel, rcp.SolveResult]:
        model = build(**case)
        result = rcp.solve(model, backend=backend, tee=tee)
        difference = abs(result.objective - published) / abs(published)
        print(f"published: {published:.8g}, ours: {result.objective:.8g}, relative difference {difference:.1e}")
        return model, result

    run_example(
        build,
        draw,
        cases={"published": {"elements": elements}},
        default="published",
        coarse={"elements": coarse},
        size=(8.0, 4.0),
        search=solve,
    )
