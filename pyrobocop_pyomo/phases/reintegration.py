"""The motion that the equations make of a plan: the states re-integrated inside every element.

A collocation polynomial meets the differential equations at its points only. What moves by the equations, a robot that
is given the controls of the plan, leaves it in between, and from element to element. How far is known after an
integration that knows nothing of the scheme.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import EvaluationError, PyRobocopError, TrajectoryError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.polynomials import gauss_rule
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.numerics.tables import tables_continued
from pyrobocop_pyomo.trajectories import Trajectory

from .bounds_between_points import SAMPLES, instants_to_look_at, stated_formulas
from .coupled_phases import coupled_phases_of, put_on_model
from .delays import MotionSoFar
from .element_instants import ElementInstants
from .families import guesses_by_component
from .implicit_steps import stepped_motions
from .instant_equations import InstantEquations, known_equations, refuse_equations_beside
from .record import PhaseRecord, Statement
from .right_hand_sides import RightHandSides
from .rule_formulas import RuleFormulas

# Of the integration: differences are of interest from there on. Longer steps would pass over a short jet unseen.
_EXACTLY: dict[str, Any] = {"method": "LSODA", "rtol": 1e-11, "atol": 1e-12, "max_step": 1.0 / SAMPLES}
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
    def how(self) -> str:
        """How the motion of the equations was found, in words."""
        if self.contact:
            return "simulated with contact from the start of the plan"
        return "integrated from the start of the plan on"

    @property
    def errors(self) -> Array:
        """Largest difference of any state from the plan inside each element, shape ``(N,)``; infinite where unknown."""
        return self._largest(self.open_loop, self.planned)

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
    formulas: RuleFormulas | None = None,
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
    formulas : RuleFormulas, optional
        Where values of the trajectory stand on the model already.
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
    on_model = put_on_model([(block, trajectory)]) if formulas is None else nullcontext()
    with on_model, tables_continued():
        formulas = formulas or RuleFormulas(block, trajectory.grid, coupled_phases_of(block, trajectory.grid))
        equations = known_equations(formulas)
        refuse_equations_beside(block, equations.read)
        integrals = _IntegralsAlongMotion(formulas, trajectory, equations, [] if states_only else record.integrals)
        rates = RightHandSides(formulas, trajectory, equations)
        instants = instants_to_look_at(formulas, trajectory, equations.statements)
        # Where rules change quickly with the time no step goes over one of these.
        parts = np.array([0.0, 1.0]) if len(instants) == SAMPLES + 1 else instants
        fractions = parts[[0, -1]] if ends_only and not rates.are_delayed else instants
        places = np.union1d(fractions, integrals.nodes)
        try:
            local, whole = _motions(rates, trajectory, parts, places, first, ends_only=ends_only)
        except EvaluationError as error:
            raise TrajectoryError(f"phase '{block.name}': {error}") from error
        if not np.isfinite(local).all():
            # Where the equations have no value on the plan itself, no motion can be known.
            at = ElementInstants(formulas, trajectory, trajectory.grid.scheme.c)
            for statement in record.statements_of("ode") + record.statements_of("residual"):
                at.values_stated(stated_formulas(formulas, statement), statement)
        gained = integrals.over_elements(local[..., np.searchsorted(places, integrals.nodes)])
    compared = np.searchsorted(places, fractions)
    return Reintegration(
        fractions=fractions,
        planned={name: of for name, of in trajectory.element_polynomials(fractions).items() if name in names},
        local=dict(zip(names, local[..., compared], strict=True)),
        open_loop=None if whole is None else dict(zip(names, whole[..., compared], strict=True)),
        contact=bool(equations.pairs),
        integrals=gained,
        remarks=tuple(integrals.remarks),
        delayed=bool(record.delayed_names),
    )


class _IntegralsAlongMotion:
    """Integrals whose integrands are known between the points, and remarks on the others.

    Parameters
    ----------
    formulas : RuleFormulas
    trajectory : Trajectory
    equations : InstantEquations
    statements : sequence of Statement

    Attributes
    ----------
    nodes : array
        Local fractions at which states are wanted: three on each part on which integrands hardly change.
    remarks : list of str
    """

    def __init__(
        self, formulas: RuleFormulas, trajectory: Trajectory, equations: InstantEquations, statements: list[Statement]
    ) -> None:
        self._formulas, self._trajectory, self._equations = formulas, trajectory, equations
        self._integrands: dict[str, Any] = {}
        self.remarks: list[str] = []
        parts = np.zeros(0)
        for position, statement in enumerate(statements, start=1):
            name = f"{statement.name} ({position})"
            try:
                if equations.needs_steps:
                    raise TrajectoryError(
                        f"phase '{formulas.block.name}': its motion depends on contacts, or on hidden conditions, "
                        "which single instants do not tell."
                    )
                self._integrands[name] = formulas.formulas_of(statement)
                parts = np.union1d(parts, instants_to_look_at(formulas, trajectory, [statement]))
            except TrajectoryError as error:
                self._leave_out(name, error)
        self.nodes, self._weights = gauss_rule(parts)

    def _leave_out(self, name: str, why: object) -> None:
        self._integrands.pop(name, None)
        self.remarks.append(f"integral {name}: not re-integrated. {why}")

    def over_elements(self, local: Array) -> dict[str, tuple[Array, Array]]:
        """As planned, and along the motion of each element, whose states at `nodes` have the shape ``(n, N, q)``."""
        found: dict[str, tuple[Array, Array]] = {}
        if not self._integrands:
            return found
        scheme = self._trajectory.grid.scheme
        polynomials = self._trajectory.element_polynomials(scheme.c)
        planned = np.array([polynomials[name] for name in self._formulas.record.names_of_states])[:, None]
        for name, integrand in list(self._integrands.items()):
            try:
                # What is delayed is that of the plan.
                rates = RightHandSides(self._formulas, self._trajectory, self._equations, [integrand])
                with np.errstate(all="ignore"):
                    of_mesh = rates.values([integrand], scheme.c, planned)[0, 0] @ scheme.b
                    along = rates.values([integrand], self.nodes, local[:, None])[0, 0] @ self._weights
                if not np.isfinite([of_mesh, along]).all():
                    raise TrajectoryError("It has no finite value on the plan, or on the motion that it leads to.")
                found[name] = of_mesh, along
            except (TrajectoryError, EvaluationError) as error:
                self._leave_out(name, error)
        return found


def _motions(
    rates: RightHandSides, trajectory: Trajectory, parts: Array, fractions: Array, first: Array, *, ends_only: bool
) -> tuple[Array, Array | None]:
    """The motion of every element, and that from the first start on, as `stepped_motions` gives them."""
    names = [*trajectory.states]
    scales = SMALLEST_SCALE + np.abs(np.array([trajectory.states[name] for name in names])).max(axis=1)
    starts = np.array([trajectory.element_states(name)[:, 0] for name in names])
    if rates.equations.needs_steps:
        return stepped_motions(rates, starts, parts, fractions, scales, first)
    motion = _Motion(rates, parts, fractions, scales)
    local, whole = np.full((*starts.shape, len(fractions)), np.inf), None
    # What is delayed is that of the plan for single elements, and for the whole motion its own.
    with np.errstate(all="ignore"), nullcontext() if rates.are_delayed else suppress(ArithmeticError, ValueError):
        if ends_only:
            local = motion.of_elements(starts)
        elif rates.are_delayed:
            so_far = MotionSoFar(names, rates.past, trajectory.grid.mesh.boundaries[0], first)
            local, rates.past = motion.of_elements(starts), so_far
            whole = motion.one_by_one(first, so_far)
        else:
            local, slopes = motion.with_slopes(starts)
            whole = motion.meeting(starts, local, slopes, first)
    return local, whole


class _Motion:
    """The motion of equations by SciPy: of elements side by side, and from the first start on.

    Parameters
    ----------
    rates : RightHandSides
    parts, fractions : array
        As for `RightHandSides.through`.
    scales : array, shape (n,)
    """

    def __init__(self, rates: RightHandSides, parts: Array, fractions: Array, scales: Array) -> None:
        self._rates, self._parts, self._fractions, self._scales = rates, parts, fractions, scales
        rates.farthest = 1e6 * scales

    def _through(self, elements: slice, states: Array, so_far: MotionSoFar | None = None) -> Array:
        return self._rates.through(elements, states, self._parts, self._fractions, so_far, **_EXACTLY)[0]

    def of_elements(self, starts: Array) -> Array:
        """Each element from its own start, shape ``(n, N, q)``."""
        return self._through(slice(None), starts[:, None])[:, 0]

    def with_slopes(self, starts: Array) -> tuple[Array, Array]:
        """The same, and derivatives of the ends by the starts, shape ``(n, n, N)``."""
        steps, n = 1e-6 * self._scales[:, None], len(starts)
        varied, each = np.repeat(starts[:, None], n + 1, axis=1), np.arange(n)
        varied[each, each + 1] += steps
        found = self._through(slice(None), varied)
        return found[:, 0], (found[:, 1:, :, -1] - found[:, :1, :, -1]) / steps

    def meeting(self, starts: Array, found: Array, slopes: Array, first: Array) -> Array | None:
        """From the first start on: all elements from starts at which their ends meet, by Newton's method.

        Parameters
        ----------
        starts : array, shape (n, N)
        found, slopes : array
            As `with_slopes` gives them.
        first : array, shape (n,)
        """
        with suppress(ArithmeticError, ValueError):
            for _ in range(8):
                moves = np.empty(starts.shape)
                moves[:, 0] = first - starts[:, 0]
                for i, gap in enumerate((found[:, :-1, -1] - starts[:, 1:]).T):
                    moves[:, i + 1] = gap + slopes[:, :, i] @ moves[:, i]
                if (np.abs(moves) <= NEGLIGIBLE * self._scales[:, None]).all():
                    return found
                starts = starts + moves
                found = self.of_elements(starts)  # with the slopes that it has: they are most of the work
        return self.one_by_one(first)  # an unstable motion goes far from where slopes were taken

    def one_by_one(self, first: Array, so_far: MotionSoFar | None = None) -> Array | None:
        """From the first start on, one element after the other; with delays the motion reads itself."""
        carried = [first[:, None, None, None]]
        try:
            for i in range(len(self._rates.widths)):
                carried.append(self._through(slice(i, i + 1), carried[-1][..., -1], so_far))
                if not np.isfinite(carried[-1]).all():
                    return None
        except PyRobocopError:
            raise  # a rule that cannot be asked says nothing about the motion
        except (ArithmeticError, ValueError):
            return None
        return np.concatenate(carried[1:], axis=2)[:, 0]
