"""Other phases that the rules of a phase read: their values at the instant at which a rule is evaluated.

A rule of one phase may read the variables of another phase of the same time indices, ``m.body.x[t]``. Between the
points of the grid such a variable does not exist: the trajectory that stands on the model is taken.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np
from pyomo.core.base.block import Block
from pyomo.core.base.expression import Expression
from pyomo.core.base.var import Var

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.modeling.blocks import BuiltBlockData
from pyrobocop_pyomo.modeling.variable_values import put_values, values_restored
from pyrobocop_pyomo.numerics import Grid, Mesh
from pyrobocop_pyomo.trajectories import Trajectory

from .nodes import StageNodes
from .phase_values import PhaseValues
from .record import PhaseRecord


def other_phases(block: Any) -> list[Any]:
    """All phases of a model but one."""
    return [
        phase
        for phase in block.model().block_data_objects(descend_into=Block)
        if phase is not block and isinstance(phase, BuiltBlockData) and phase.is_built
        if isinstance(getattr(phase, "record", None), PhaseRecord)
    ]


def coupled_phases_of(block: Any, grid: Grid) -> list[Any]:
    """The other phases of the model that share the element boundaries of a phase, in time indices.

    Parameters
    ----------
    block : PhaseBlock
    grid : Grid
        Of the trajectory that is checked, in real time.
    """
    boundaries = indices_of(block.record, grid).mesh.boundaries
    return [phase for phase in other_phases(block) if _same(phase.record.grid.mesh.boundaries, boundaries)]


def _same(first: Any, second: Any) -> bool:
    return np.shape(first) == np.shape(second) and bool(np.allclose(first, second, rtol=1e-9, atol=1e-12))


def indices_of(record: PhaseRecord, grid: Grid) -> Grid:
    """The grid of a trajectory in the phase's time indices; its mesh need not be that of the phase."""
    if not record.normalised:
        return grid
    if grid.mesh.elements == record.grid.mesh.elements:
        return Grid(grid.scheme, record.grid.mesh)
    first, last = grid.mesh.boundaries[0], grid.mesh.boundaries[-1]
    return Grid(grid.scheme, Mesh(tuple((time - first) / (last - first) for time in grid.mesh.boundaries)))


def is_on_model(phase: Any, trajectory: Trajectory) -> bool:
    """Whether the values of a trajectory are those that the phase has now, to rounding."""
    values = PhaseValues(phase)
    try:
        now = values.trajectory(values.read(), evaluate=False)
    except TrajectoryError:
        return False
    kinds = (now.states, trajectory.states), (now.signals, trajectory.signals), (now.parameters, trajectory.parameters)
    each = [(of[name], numbers) for of, given in kinds for name, numbers in given.items()]
    return all(_same(*both) for both in [(now.grid.times, trajectory.grid.times), *each])


@contextmanager
def put_on_model(trajectories: Iterable[tuple[Any, Trajectory]]) -> Iterator[None]:
    """Context in which phases have the values of trajectories, for rules that read the model at other instants."""
    pairs = list(trajectories)
    starts = [phase.start for phase, _ in pairs if getattr(phase.start, "ctype", None) is Expression]
    stated = [start.expr for start in starts]
    with values_restored([variable for phase, _ in pairs for variable in phase.component_data_objects(Var)]):
        try:
            for phase, trajectory in pairs:
                _put_values(phase, trajectory)
                put_horizon(phase, trajectory.grid)
            yield
        finally:
            for start, expression in zip(starts, stated, strict=True):
                start.set_value(expression)


def _put_values(phase: Any, trajectory: Trajectory) -> None:
    indices = indices_of(phase.record, trajectory.grid).mesh.boundaries
    values = PhaseValues(phase)
    sampled = values.sampled(trajectory, partial(np.interp, xp=indices, fp=trajectory.grid.mesh.boundaries))
    if is_of_grid(phase.record, trajectory.grid):  # then the samples themselves, jumps between elements included
        at_points = {**trajectory.signals, **{f"{name}_derivative": of for name, of in trajectory.rates.items()}}
        at_points = {name: of for name, of in at_points.items() if isinstance(values.nodes.get(name), StageNodes)}
        sampled |= {name: of for name, of in {**trajectory.states, **at_points}.items() if name in sampled}
    for name, numbers in sampled.items():
        put_values(values.variables[name], numbers.tolist())
    for name, number in trajectory.parameters.items():
        phase.component(name).set_value(number, skip_validation=True)


def put_horizon(phase: Any, grid: Grid) -> None:
    """Give start, duration and moving element boundaries of a phase the values of a grid in real time.

    A start that is an expression is another phase's business, which this one is judged without.
    """
    boundaries = grid.mesh.boundaries
    start, end = boundaries[0], boundaries[-1]
    for component, number in ((phase.start, start), (phase.duration, end - start)):
        if getattr(component, "ctype", None) is Var:
            component.set_value(number, skip_validation=True)  # a motion may last longer than a plan is allowed to
        elif getattr(component, "ctype", None) is Expression:
            component.set_value(number)
    if phase.record.free_widths and len(boundaries) == len(phase.boundary):
        for i, boundary in enumerate(boundaries):
            phase.boundary[i].set_value((boundary - start) / (end - start), skip_validation=True)


def is_of_grid(record: PhaseRecord, grid: Grid) -> bool:
    """Whether a grid, in real time, has the points of the phase's own one."""
    return grid.scheme.name == record.grid.scheme.name and _same(indices_of(record, grid).times, record.grid.times)
