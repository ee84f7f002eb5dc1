"""May a rule be asked between the points of the grid? Compared with what it says at them, before it is believed.

Between the points a rule gets a proxy of its phase, and what it reads is replaced by the values of that instant. A
rule that reads another time which moves along with its own (``b.x[t - h]``), that looks for its own time among the
points, or that reads expressions which nothing gives for all times, has no answer there, or a wrong one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.modeling.row_violations import number_or_nan
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.trajectories import Trajectory

from .companions import is_of_grid
from .delays import AheadOfMotion, past_on_model
from .point_model import PointModel
from .record import PhaseRecord, PreviousStates, Statement

# Elements at which rules are compared, and the place within them that no scheme has a point at.
_SAMPLES = 5
_BETWEEN = 0.3717

# Largest relative difference of a rate by the proxy from the one by the phase.
_AGREEMENT = 1e-9

# Parts of an element: so far beside the points rules are compared with the rows. What is measured there by rates that
# change quickly, or by the tolerance of a solver, is no other rule.
_BESIDE, _SAME_RATE = 1e-9, 1e-5


def check_rules_between_points(
    block: Any, record: PhaseRecord, point: PointModel, statements: Iterable[Statement]
) -> None:
    """Compare what rules read and say between the points with what they do at the points.

    Parameters
    ----------
    block : PhaseBlock
    record : PhaseRecord
    point : PointModel
        With the phase's own time indices. Its values are others afterwards.
    statements : iterable of Statement

    Raises
    ------
    TrajectoryError
        Naming the rule, and what it reads or says.
    """
    asks_phase, element, past = point.asks_phase, point.element, point.past
    if past is None:
        point.past = _past_of_any_value(block, record)
    try:
        for statement in statements:
            try:
                _compare(block, record, point, statement)
            except TrajectoryError:
                raise
            except Exception as error:  # a rule that was written for its points may raise anything elsewhere
                raise TrajectoryError(
                    f"phase '{block.name}': the rule '{statement.name}' cannot be asked between the points of the "
                    f"grid ({type(error).__name__}: {error})."
                ) from error
    finally:
        point.asks_phase, point.element, point.past = asks_phase, element, past
        point.leave_nodes()


def refuse_data_at_points(
    block: Any, record: PhaseRecord, trajectory: Trajectory, rates: Callable[[float, Array], Array]
) -> None:
    """Refuse equations that say something at their points and something else on both sides of these.

    A rule of the time may jump at a point; what differs from both sides are numbers for the points alone, such as those
    of a dictionary with a default for all other times.

    Parameters
    ----------
    block : PhaseBlock
        With the values of the trajectory on the model.
    record : PhaseRecord
    trajectory : Trajectory
    rates : callable
        ``rates(fraction, states)``: derivatives at a local fraction of all elements, shape ``(n, N)``, at states of
        that shape.

    Raises
    ------
    TrajectoryError
        Naming the state, and both numbers.
    """
    grid, names = trajectory.grid, record.names_of_states
    stated_by_rows = [name for name in names if name in record.rates]
    if not is_of_grid(record, grid) or not stated_by_rows:
        return
    stated = {name: [number_or_nan(record.rates[name][time]) for time in record.grid.points] for name in stated_by_rows}
    per_stage = {name: np.array(numbers)[grid.stage_positions] for name, numbers in stated.items()}
    for stage, fraction in enumerate(grid.scheme.c.tolist()):
        states = np.array([trajectory.element_states(name) @ grid.scheme.state_at([fraction])[0] for name in names])
        try:
            with np.errstate(all="ignore"):
                beside = [rates(fraction + side * _BESIDE, states) for side in (-1.0, 1.0)]
        except (ArithmeticError, ValueError):
            return  # what is not defined there is named where the motion is followed
        for name in stated_by_rows:
            row, at = per_stage[name][:, stage], names.index(name)
            # A rule that jumps here agrees with one side, one that changes quickly with the middle of both.
            before, after = (found[at] for found in beside)
            differences = [np.abs(of - row) / (1.0 + np.abs(row)) for of in (before, after, 0.5 * (before + after))]
            differs = np.min(differences, axis=0) > _SAME_RATE
            # At its very ends a phase has one side only.
            times = np.array(grid.mesh.boundaries[:-1]) + fraction * np.array(grid.mesh.widths)
            differs &= (times > grid.mesh.boundaries[0]) & (times < grid.mesh.boundaries[-1])
            if differs.any():
                i = int(np.argmax(differs))
                raise TrajectoryError(
                    f"phase '{block.name}': the equation of '{name}' says {row[i]:g} at the point t = {times[i]:g} of "
                    f"the grid, but {beside[0][at, i]:g} just before and {beside[1][at, i]:g} just after it. What it "
                    "says is known at the points only. Give data over time as an rcp.Table, and compute with t by "
                    "Pyomo's functions."
                )


def _past_of_any_value(block: Any, record: PhaseRecord) -> Any:
    boundaries = np.array(record.grid.mesh.boundaries)
    on_model = past_on_model(block, record, boundaries, boundaries)

    def past(name: str, time: float) -> float:
        try:
            return on_model(name, time)
        except AheadOfMotion:
            return 1.0  # anything will do, as for what has no value at the point itself

    return past


def _compare(block: Any, record: PhaseRecord, point: PointModel, statement: Statement) -> None:
    what = f"phase '{block.name}': the rule '{statement.name}'"
    grid = record.grid
    states = dict.fromkeys(record.names_of_states, 0.0)
    more = [PreviousStates(what, states, record.families)] if statement.kind == "step map" else []
    fixed: frozenset[int] | None = None
    for i in np.unique(np.linspace(0, grid.mesh.elements - 1, _SAMPLES).astype(int)).tolist():
        on = grid.stage_times[i][-1]
        off = grid.mesh.boundaries[i] + _BETWEEN * float(grid.mesh.widths[i])
        point.element = i
        point.set_values(*_values_at(block, record, on))
        if statement.kind == "ode":
            point.forget_derivatives()  # as in an integration, which knows none
        point.asks_phase = False
        read = point.read_elsewhere(statement, off, *more)
        fixed = read if fixed is None else fixed
        by_proxy, numbers = point.read_elsewhere(statement, on, *more), _numbers(point, statement, on)
        point.asks_phase = True
        by_phase, stated = point.read_elsewhere(statement, on, *more), _numbers(point, statement, on)
        here = point.keys_at(on)
        if not (fixed == read and by_proxy == by_phase == fixed - here):
            moved = (fixed ^ read) | (by_phase ^ (fixed - here)) | (by_proxy ^ by_phase)
            raise TrajectoryError(
                f"{what} reads {point.name_of(moved)}, at other times than its own, which change with it. What it "
                "says is known at the points of the grid only. A delay is known everywhere: write b.x.delayed(t, tau)."
            )
        if not _agree(numbers, stated):
            raise TrajectoryError(
                f"{what} says {_shown(stated)} at t = {on:g}, but {_shown(numbers)} for the formula that it gives for "
                "all times. What it says is known at the points of the grid only."
            )


def _values_at(block: Any, record: PhaseRecord, time: float) -> tuple[dict[str, float], dict[str, float]]:
    """What the phase holds at a point; anything will do where it holds nothing."""
    names = [*record.names_of_states, *record.names_of_signals]
    values = {name: value(block.component(name)[time], exception=False) for name in names}
    slopes = {
        name: value(block.component(f"{name}_derivative")[time], exception=False)
        for name in sorted(record.kept_derivatives)
    }
    given, sloped = ({k: 1.0 if v is None else float(v) for k, v in of.items()} for of in (values, slopes))
    return given, dict.fromkeys(record.names_of_states, 0.0) | sloped


def _numbers(point: PointModel, statement: Statement, time: float) -> dict[str, float] | None:
    """Rates that a rule states; None for the other kinds, and where they have no value."""
    if statement.kind != "ode":
        return None
    try:
        return point.rates([statement], time)
    except (ArithmeticError, ValueError, TypeError):
        return None


def _agree(first: dict[str, float] | None, second: dict[str, float] | None) -> bool:
    if first is None or second is None:
        return first is second
    return first.keys() == second.keys() and all(
        first[name] == second[name]
        or abs(first[name] - second[name]) <= _AGREEMENT * (1.0 + abs(second[name]))
        or (np.isnan(first[name]) and np.isnan(second[name]))
        for name in first
    )


def _shown(numbers: dict[str, float] | None) -> str:
    return "nothing" if numbers is None else ", ".join(f"{name}' = {number:g}" for name, number in numbers.items())
