"""The motion that the equations make of a plan: the states re-integrated inside every element.

A collocation polynomial meets the differential equations at its points only. What moves by the equations, a robot that
is given the controls of the plan, leaves it in between, and from element to element. How far is known after an
integration that knows nothing of the scheme.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import EvaluationError, PyRobocopError, TrajectoryError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.flows import Flows, integrate_flows
from pyrobocop_pyomo.numerics.tables import tables_continued
from pyrobocop_pyomo.trajectories import Trajectory

from .bounds_between_points import SAMPLES, instants_to_look_at, stated_formulas
from .coupled_phases import CoupledPhase, coupled_phases_of, put_on_model
from .delays import MotionSoFar
from .element_instants import ElementInstants
from .families import guesses_by_component
from .implicit_steps import stepped_flows
from .instant_equations import InstantEquations, refuse_equations_beside
from .record import PhaseRecord, Statement
from .right_hand_sides import RightHandSides
from .rule_formulas import RuleFormulas

# Of the integration, relative to the size of each state. Differences are of interest from there on.
TOLERANCE = 1e-10
# Where rules change quickly with the time many instants have to be followed.
TOLERANCE_IF_QUICK = 1e-6
# Of element ends alone, which every result asks for.
TOLERANCE_OF_ENDS = 1e-8
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
        Whether pairs decide what happens. An open loop that misses a contact by a hair is another motion.
    integrals : dict of name to (array, array)
        Per element, shape ``(N,)``, what an integral gains there: by the quadrature of the mesh, and along the motion
        `local`.
    remarks : tuple of str
        Which integrals are not known along the motion, and why.
    delayed : bool
        Whether the equations read earlier times.
    """

    fractions: Array
    planned: Mapping[str, Array]
    local: Mapping[str, Array]
    open_loop: Mapping[str, Array] | None
    contact: bool
    integrals: Mapping[str, tuple[Array, Array]] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    delayed: bool = False

    @property
    def integral_errors(self) -> Mapping[str, Array]:
        """Difference of each integral over each element from that along the motion of the equations, shape ``(N,)``."""
        return {name: np.abs(planned - moved) for name, (planned, moved) in self.integrals.items()}

    @property
    def states(self) -> Mapping[str, Array] | None:
        """The motion of the equations: the open loop."""
        return self.open_loop

    @property
    def how(self) -> str:
        """How the motion of the equations was found, in words."""
        if self.contact:
            return "simulated with contact from the start of the plan"
        return "integrated from the start of the plan on"

    @property
    def errors(self) -> Array:
        """Largest difference of any state from the plan inside each element, shape ``(N,)``; infinite where unknown."""
        return self._largest(self.states, self.planned)

    def end_errors(
        self, of: Mapping[str, Array] | None, trajectory: Trajectory, sizes: Mapping[str, float] | None = None
    ) -> Array:
        """Largest difference of any state from the plan at the end of each element, shape ``(N,)``; in units of sizes.

        With delays it is that inside the element too: what is there is read again later.
        """
        sizes = sizes or dict.fromkeys(self.planned, 1.0)
        planned, found = self.planned, of
        if of is not None and not self.delayed:
            found = {name: of[name][:, -1:] for name in planned}
            ends = {
                name: np.append(trajectory.element_states(name)[1:, 0], trajectory.states[name][-1]) for name in planned
            }
            planned = {name: values[:, None] for name, values in ends.items()}
        scaled = None if found is None else {name: found[name] / sizes[name] for name in planned}
        return self._largest(scaled, {name: values / sizes[name] for name, values in planned.items()})

    @staticmethod
    def _largest(of: Mapping[str, Any] | None, planned: Mapping[str, Array]) -> Array:
        if of is None:
            return np.full(len(next(iter(planned.values()))), np.inf)
        with np.errstate(invalid="ignore"):
            return np.array([np.abs(of[name] - planned[name]).max(axis=1) for name in planned]).max(axis=0)


def reintegrate(
    block: Any,
    trajectory: Trajectory,
    coupled: Sequence[CoupledPhase] | None = None,
    initial: Mapping[str, float] | None = None,
    *,
    states_only: bool = False,
    ends_only: bool = False,
) -> Reintegration:
    """See `PhaseBlockData.reintegrate`.

    Parameters
    ----------
    block : PhaseBlock
    trajectory : Trajectory
    coupled : sequence of CoupledPhase, optional
        Other phases, beside values of the trajectory that stand on the model already.
    initial : dict of state name to number, optional
        Where the open loop starts; as the plan does by default.
    states_only : bool
        Leave out the integrals, which take longer than the states where there are delays.
    ends_only : bool
        Leave out the open loop, and what is inside the elements, where these take their time.
    """
    record: PhaseRecord = block.record
    names = record.names_of_states
    if not names:
        raise TrajectoryError(f"phase '{block.name}' has no states: there is no error to estimate.")
    if record.discrete_states:
        raise TrajectoryError(
            f"phase '{block.name}': no error of discretisation of {', '.join(sorted(record.discrete_states))}. Step "
            "maps lead them from element to element; on another mesh it would be another motion. The defect says how "
            "far each step is from its map; phase.simulate() applies the maps one after the other."
        )
    initial = guesses_by_component(record, initial or {}, f"phase '{block.name}'")
    first = np.array([initial.get(name, trajectory.states[name][0]) for name in names], dtype=float)
    on_model = put_on_model([(block, trajectory)]) if coupled is None else nullcontext()
    coupled = coupled_phases_of(block, trajectory.grid) if coupled is None else coupled
    with on_model, tables_continued():
        formulas = RuleFormulas(block, trajectory.grid, coupled)
        try:
            flows, contact = _flows(formulas, trajectory, first, ends_only)
        except EvaluationError as error:
            raise TrajectoryError(f"phase '{block.name}': {error}") from error
        integrals, remarks = ({}, ()) if states_only else _integrals(block, trajectory)
        if not np.isfinite(flows.local).all():
            _refuse_undefined(formulas, trajectory)
    planned = trajectory.element_polynomials(flows.fractions)
    return Reintegration(
        fractions=flows.fractions,
        planned={name: planned[name] for name in names},
        local={name: flows.local[:, :, j] for j, name in enumerate(names)},
        open_loop=None if flows.whole is None else {name: flows.whole[:, :, j] for j, name in enumerate(names)},
        contact=contact,
        integrals=integrals,
        remarks=remarks,
        delayed=bool(record.delayed_names),
    )


def _refuse_undefined(formulas: RuleFormulas, trajectory: Trajectory) -> None:
    """Where the equations have no value on the plan itself, no motion can be known."""
    at, record = ElementInstants(formulas, trajectory, trajectory.grid.scheme.c), formulas.record
    for statement in record.statements_of("ode") + record.statements_of("residual"):
        for side in stated_formulas(formulas, statement):
            at.value_of(side, statement)


def _flows(formulas: RuleFormulas, trajectory: Trajectory, first: Array, ends: bool) -> tuple[Flows, bool]:
    """The flows, and whether contact decides them."""
    block, record = formulas.block, formulas.record
    starts = np.array([trajectory.element_states(name)[:, 0] for name in record.names_of_states]).T
    scales = SMALLEST_SCALE + np.abs(np.array([trajectory.states[name] for name in record.names_of_states])).max(axis=1)
    rates = RightHandSides(formulas, trajectory, InstantEquations)
    refuse_equations_beside(block, rates.equations.read)
    fractions = instants_to_look_at(formulas, trajectory, rates.equations.statements)
    is_quick = len(fractions) != SAMPLES + 1
    if rates.are_delayed:
        parts = fractions if is_quick else np.array([0.0, 1.0])
        return _delayed_flows(rates, trajectory, parts, fractions, starts, first), False
    if not rates.equations.needs_steps:
        flows = None
        if ends and not is_quick:
            flows = integrate_flows(rates, starts, scales, fractions[:: SAMPLES // 2], TOLERANCE_OF_ENDS, None)
        if flows is None:
            tolerance = TOLERANCE_IF_QUICK if is_quick else TOLERANCE
            flows = integrate_flows(rates, starts, scales, fractions, tolerance, first)
        if flows is not None:
            return flows, False
    return stepped_flows(rates, trajectory, fractions, scales, first), bool(rates.equations.pairs)


def _delayed_flows(
    rates: RightHandSides, trajectory: Trajectory, parts: Array, fractions: Array, starts: Array, first: Array
) -> Flows:
    """One element after the other: the whole motion reads itself, and what is delayed may jump anywhere in them.

    From their own starts, elements read the trajectory at earlier times.
    """
    exactly: dict[str, Any] = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-11}
    carried: list[Array] = []
    with np.errstate(all="ignore"):
        local = [rates.through(i, start, parts, fractions, **exactly)[0] for i, start in enumerate(starts)]
        so_far = MotionSoFar(list(trajectory.states), rates.past, trajectory.grid.mesh.boundaries[0], first)
        rates.past = so_far
        try:
            for i in range(len(starts)):
                found, _ = rates.through(i, carried[-1][-1] if carried else first, parts, fractions, so_far, **exactly)
                if not np.isfinite(found).all():
                    return Flows(fractions, np.array(local), None)
                carried.append(found)
        except PyRobocopError:
            raise  # a rule that cannot be asked says nothing about the motion
        except (ArithmeticError, ValueError):
            return Flows(fractions, np.array(local), None)
    return Flows(fractions, np.array(local), np.array(carried))


def _integrals(block: Any, trajectory: Trajectory) -> tuple[dict[str, tuple[Array, Array]], tuple[str, ...]]:
    """Each integral per element: by quadrature and along the local motion; and remarks on those that are not known."""
    known: dict[str, tuple[Array, Array]] = {}
    remarks: list[str] = []
    for position, statement in enumerate(block.record.integrals, start=1):
        name = f"{statement.name} ({position})"
        try:
            known[name] = _integral(block, trajectory, statement)
        except (TrajectoryError, EvaluationError) as error:
            remarks.append(f"integral {name}: not re-integrated. {error}")
    return known, tuple(remarks)


def _integral(block: Any, trajectory: Trajectory, statement: Statement) -> tuple[Array, Array]:
    what = f"phase '{block.name}': integral '{statement.name}'"
    grid = trajectory.grid
    formulas = RuleFormulas(block, trajectory.grid)
    rates = RightHandSides(formulas, trajectory, InstantEquations, [statement])
    if rates.equations.needs_steps:
        raise TrajectoryError(
            f"phase '{block.name}': its motion depends on contacts, or on hidden conditions, which single instants do "
            "not tell."
        )
    names, width = block.record.names_of_states, grid.mesh.widths
    nodes = {name: trajectory.element_states(name) for name in names}
    planned = np.zeros(len(width))
    with np.errstate(all="ignore"):
        for fraction, weight in zip(grid.scheme.c.tolist(), grid.scheme.b.tolist(), strict=True):
            here = np.array([nodes[name] @ grid.scheme.state_at([fraction])[0] for name in names])
            planned += weight * rates(fraction, np.vstack([here, planned])[:, None, :])[-1, 0]
    if not np.isfinite(planned).all():
        raise TrajectoryError(f"{what} has no finite value on the plan.")
    fractions = instants_to_look_at(formulas, trajectory, [*block.record.statements_of("ode"), statement])
    starts = np.column_stack([*(nodes[name][:, 0] for name in names), np.zeros(len(width))])
    sizes = [np.abs(nodes[name]).max() for name in names] + [np.abs(planned).sum()]
    found = integrate_flows(rates, starts, SMALLEST_SCALE + np.array(sizes), fractions, TOLERANCE, None)
    if found is None:
        raise TrajectoryError(f"{what}: the equations are too stiff for an integration of all elements at once.")
    return planned, found.local[:, -1, -1]
