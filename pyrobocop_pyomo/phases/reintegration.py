"""The motion that the equations make of a plan: the states re-integrated inside every element.

A collocation polynomial meets the differential equations at its points only. What moves by the equations, a robot that
is given the controls of the plan, leaves it in between, and from element to element. How far is known after an
integration that knows nothing of the scheme.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any

import numpy as np

from pyrobocop_pyomo.complementarity import Complementarity
from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.numerics import Array, Grid
from pyrobocop_pyomo.numerics.flows import Flows, integrate_flows
from pyrobocop_pyomo.trajectories import Trajectory

from .between_points import check_rules_between_points
from .companions import companions_of, indices_of, put_on_model
from .element_integration import integrate_inside, signals_at
from .point_model import PointModel
from .rate_arrays import RateArrays
from .record import PhaseRecord
from .stepped_elements import determined_unknowns, stepped_flows

# Parts of each element at whose ends the motions are compared.
SAMPLES = 16
# Of the integration, relative to the size of each state. Differences are of interest from there on.
TOLERANCE = 1e-10
# A state that stays at zero has a size too.
SMALLEST_SCALE = 1e-3


@dataclass(frozen=True, eq=False)
class Reintegration:
    """The states of a plan beside those that its equations lead to under its controls.

    Attributes
    ----------
    fractions : array, shape (k,)
        Where in each element the motions are compared, from 0 to 1.
    planned : dict of state name to array, shape (N, k)
        The polynomials of the plan.
    local : dict of state name to array, shape (N, k)
        Each element integrated from where the plan starts it.
    open_loop : dict of state name to array, shape (N, k), or None
        Integrated from the start of the plan on, in one go; None where that left the finite numbers.
    contact : bool
        Whether pairs decide what happens. Contacts open and close at the steps of the plan: an open loop that misses
        one by a hair is another motion, and `local` is what counts.
    """

    fractions: Array
    planned: Mapping[str, Array]
    local: Mapping[str, Array]
    open_loop: Mapping[str, Array] | None
    contact: bool

    @property
    def states(self) -> Mapping[str, Array] | None:
        """The motion of the equations: open loop, or from element to element where there are contacts."""
        return self.local if self.contact else self.open_loop

    @property
    def how(self) -> str:
        """How the motion of the equations was found, in words."""
        if self.contact:
            return "each element integrated from where the plan starts it"
        return "integrated from the start of the plan on"

    @property
    def errors(self) -> Array:
        """Largest difference of any state from the plan inside each element, shape ``(N,)``; infinite where unknown."""
        return self._largest(self.states, self.planned)

    def end_errors(self, of: Mapping[str, Array] | None, trajectory: Trajectory) -> Array:
        """Largest difference of any state from the plan at the end of each element, shape ``(N,)``."""
        ends = {name: None if of is None else of[name][:, -1:] for name in self.planned}
        planned = {
            name: np.append(trajectory.element_states(name)[1:, 0], trajectory.states[name][-1])[:, None]
            for name in self.planned
        }
        return self._largest(None if of is None else ends, planned)

    @staticmethod
    def _largest(of: Mapping[str, Any] | None, planned: Mapping[str, Array]) -> Array:
        if of is None:
            return np.full(len(next(iter(planned.values()))), np.inf)
        with np.errstate(invalid="ignore"):
            return np.array([np.abs(of[name] - planned[name]).max(axis=1) for name in planned]).max(axis=0)


def reintegrate(
    block: Any,
    record: PhaseRecord,
    trajectory: Trajectory,
    point: PointModel | None = None,
    initial: Mapping[str, float] | None = None,
) -> Reintegration:
    """See `PhaseActions.reintegrate`.

    Parameters
    ----------
    block : PhaseBlock
    record : PhaseRecord
    trajectory : Trajectory
    point : PointModel, optional
        Asks the rules, by values of the trajectory that stand on the model already.
    initial : dict of state name to number, optional
        Where the open loop starts; as the plan does by default.
    """
    names = record.names_of_states
    if not names:
        raise TrajectoryError(f"phase '{block.name}' has no states: there is no error to estimate.")
    if record.discrete_states:
        raise TrajectoryError(
            f"phase '{block.name}': no error of discretisation of {', '.join(sorted(record.discrete_states))}. Step "
            "maps lead them from element to element; on another mesh it would be another motion. The defect says how "
            "far each step is from its map; phase.simulate() applies the maps one after the other."
        )
    planned_first = {name: float(trajectory.states[name][0]) for name in names}
    first = np.array([{**planned_first, **(initial or {})}[name] for name in names]) if initial else None
    contact = any(True for _ in block.component_data_objects(Complementarity, active=True, descend_into=True))
    with nullcontext() if point is not None else put_on_model([(block, trajectory)]):
        flows, fractions = _flows(block, record, trajectory, point, first)
    planned = trajectory.element_polynomials(fractions)
    return Reintegration(
        fractions=fractions,
        planned={name: planned[name] for name in names},
        local={name: flows.local[:, :, j] for j, name in enumerate(names)},
        open_loop=None if flows.whole is None else {name: flows.whole[:, :, j] for j, name in enumerate(names)},
        contact=contact,
    )


def element_end_errors(block: Any, record: PhaseRecord, trajectory: Trajectory) -> Array:
    """How far each element ends from where the equations lead from its own start, shape ``(N,)``.

    Raises
    ------
    TrajectoryError
        As `reintegrate`.
    """
    found = reintegrate(block, record, trajectory)
    return found.end_errors(found.local, trajectory)


def _flows(
    block: Any, record: PhaseRecord, trajectory: Trajectory, point: PointModel | None, first: Array | None
) -> tuple[Flows, Array]:
    names = record.names_of_states
    unknowns = determined_unknowns(block, record)
    if unknowns is not None:
        return stepped_flows(block, record, trajectory, unknowns, first)
    if set(record.equation_of) != set(names):
        implicit = sorted(set(names) - set(record.equation_of))
        raise TrajectoryError(
            f"re-integration needs explicit equations; implicit are those of {', '.join(implicit)}, and the residual "
            "equations determine neither all algebraics nor the derivatives alone."
        )
    fractions = np.linspace(0.0, 1.0, SAMPLES + 1)
    indices = indices_of(record, trajectory.grid)
    if point is None:
        point = PointModel(block, record, indices, trajectory.grid, companions_of(block, indices.mesh.boundaries))
    point.set_values(trajectory.parameters)
    try:
        check_rules_between_points(block, record, point, record.statements_of("ode"))
        point.set_values(trajectory.parameters)
        point.asks_phase = False
        flows = _side_by_side(block, record, trajectory, indices, point, first)
        if flows is None:
            flows = integrate_inside(trajectory, _single_rates(record, trajectory, point), fractions, first)
    finally:
        point.leave_nodes()
    return flows, fractions


def _side_by_side(
    block: Any,
    record: PhaseRecord,
    trajectory: Trajectory,
    indices: Grid,
    point: PointModel,
    first: Array | None,
) -> Flows | None:
    """All elements at once; None where the equations are no formulas, or too stiff for this."""
    names = record.names_of_states
    starts = np.array([trajectory.element_states(name)[:, 0] for name in names]).T
    scales = SMALLEST_SCALE + np.abs(np.array([trajectory.states[name] for name in names])).max(axis=1)
    try:
        rates = RateArrays(block, record, trajectory, indices, point)
    except TrajectoryError:
        return None
    return integrate_flows(rates, starts, scales, SAMPLES, TOLERANCE, first)


def _single_rates(record: PhaseRecord, trajectory: Trajectory, point: PointModel) -> Any:
    """Rates at one instant of one element, as the rules say them."""
    names, scheme, mesh = record.names_of_states, trajectory.grid.scheme, trajectory.grid.mesh
    signals = {name: trajectory.element_signals(name) for name in trajectory.signals}

    def rates(element: int, time: float, state: Array) -> Array:
        local = (time - mesh.boundaries[element]) / mesh.widths[element]
        per_stage = {name: per_element[element] for name, per_element in signals.items()}
        values = signals_at(scheme, local, time, per_stage, trajectory.piecewise_linear)
        point.set_values({**values, **dict(zip(names, state, strict=True))})
        point.forget_derivatives()
        point.element = element
        result = point.rates(record.statements_of("ode"), point.index_at(time))
        return np.array([result[name] for name in names])

    return rates
