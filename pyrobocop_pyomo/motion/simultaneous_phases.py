"""Phases of one model that happen at the same time on the same grid, such as one for each of two robots."""

from __future__ import annotations

from numbers import Real
from typing import Any

from pyomo.core.base.constraint import Constraint
from pyomo.repn import generate_standard_repn

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.modeling.expressions import same_expression
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.numerics.rounding import ROUNDING


def refuse_other_times(phase: Any, other: Any, *, early: bool = False) -> None:
    """Refuse to read the states of a phase at the times of another one, unless both are the same times.

    Parameters
    ----------
    phase, other : PhaseBlockData
        The phase whose times are the set of points, and the one that is read.
    early : bool
        True while the model is still being stated: what ties two durations may come later.

    Raises
    ------
    ObstacleError
        Naming both phases.
    """
    if phase is other:
        return
    remedy = "Give both phases the same start, duration, mesh and scheme, or add a block for each of them."
    if phase.grid.scheme.name != other.grid.scheme.name or phase.grid.times != other.grid.times:
        raise ObstacleError(
            f"states of phase '{other.name}' are read at the times of phase '{phase.name}', which has other points of "
            f"time. {remedy}"
        )
    if not (phase.has_normalised_time or other.has_normalised_time) or early:
        return
    free = phase.record.free_widths or other.record.free_widths
    if free or not (_same(phase.start, other.start) and _same_durations(phase, other)):
        raise ObstacleError(
            f"states of phase '{other.name}' are read at the times of phase '{phase.name}', but nothing says that both "
            f"happen at the same time. Tie them by a constraint, {phase.name}.duration == {other.name}.duration, with "
            "the same fixed start and without free element widths; or give both the same fixed duration."
        )


def _same(first: Any, second: Any) -> bool:
    if isinstance(first, Real) and isinstance(second, Real):
        return abs(float(first) - float(second)) <= ROUNDING * max(1.0, abs(float(first)))
    return not isinstance(first, Real) and not isinstance(second, Real) and same_expression(first, second)


def _same_durations(phase: Any, other: Any) -> bool:
    pair = (phase.duration, other.duration)
    if any(isinstance(duration, Real) for duration in pair):
        return _same(*pair)
    wanted = {id(duration) for duration in pair}
    for row in phase.model().component_data_objects(Constraint, active=True, descend_into=True):
        if row.equality and {id(v) for v in variables_in(row.body)} == wanted and _is_difference(row):
            return True
    return False


def _is_difference(row: Any) -> bool:
    """Whether a row says that its two variables are equal."""
    form = generate_standard_repn(row.body)
    if not form.is_linear() or len(form.linear_coefs) != 2:
        return False
    first, second = form.linear_coefs
    return bool(
        abs(first + second) <= ROUNDING * abs(first) and abs(form.constant - row.upper) <= ROUNDING * abs(first)
    )
