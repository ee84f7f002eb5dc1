"""One run of Ipopt on a scaled program, with everything that comes back in the units of the program itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from pyrobocop_pyomo.programs.nonlinear_program import NonlinearProgram, PrimalDualPoint
from pyrobocop_pyomo.programs.scaled_program import ScaledProgram
from pyrobocop_pyomo.programs.scales import Scales

from .ipopt_outcome import IpoptOutcome, IterationRecord
from .ipopt_run import run_ipopt


def run_scaled(
    nlp: NonlinearProgram,
    scales: Scales,
    options: Mapping[str, Any],
    start: PrimalDualPoint,
    *,
    on_iteration: Callable[[IterationRecord], bool | None] | None = None,
    **how: Any,
) -> IpoptOutcome:
    """As `run_ipopt`, whose other arguments are handed on; Ipopt's options and log are about the scaled program."""

    def unscaled(record: IterationRecord) -> IterationRecord:
        return record._replace(objective=record.objective * scales.objective)

    def told(record: IterationRecord) -> bool | None:
        return None if on_iteration is None else on_iteration(unscaled(record))

    head = (
        f"The log below is about the scaled program: the objective divided by {scales.objective:.3g}, variables and "
        "rows by their typical sizes.\n"
    )
    scaled = ScaledProgram(nlp, scales)
    outcome = run_ipopt(scaled, options, scales.scaled(start), on_iteration=on_iteration and told, head=head, **how)
    point = scales.unscaled(outcome.point, nlp)
    assert point.g_multipliers is not None
    assert point.lower_multipliers is not None
    assert point.upper_multipliers is not None
    return replace(
        outcome,
        x=point.x,
        objective=outcome.objective * scales.objective,
        g=outcome.g * scales.g,
        g_multipliers=point.g_multipliers,
        lower_multipliers=point.lower_multipliers,
        upper_multipliers=point.upper_multipliers,
        records=[unscaled(record) for record in outcome.records],
    )
