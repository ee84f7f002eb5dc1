"""How far bodies get from where a plan has them when a robot integrates its controls, or why that is not known.

A plan is the polynomials of its states. The equations hold at the collocation points only; what the controls lead to is
another motion, by the error of the discretisation. `PhaseBlock.reintegrate` gives its states. Here they become the
distances of corners, which are taken off the proven distances of the plan. Here it is decided, too, whether there is
something to integrate, whether the integration can have seen all that the equations do, and whether the motion goes on
where one phase follows another.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint

from pyrobocop_pyomo.errors import PyRobocopError, TrajectoryError
from pyrobocop_pyomo.links.linked_initial_states import linked_initial_state
from pyrobocop_pyomo.modeling.blocks import BuiltBlockData
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.phases import PhaseBlockData
from pyrobocop_pyomo.phases.bounds_between_points import unseen_on_the_way
from pyrobocop_pyomo.phases.reintegration import SMALLEST_SCALE, Reintegration, reintegrate
from pyrobocop_pyomo.trajectories import Trajectory

from .motion import Motion
from .moving_shapes import MovingShape, RequiredClearance
from .rules_along_motion import SignalFormulas, parent_of

PLAN_ALONE = "equations=False asks for the plan alone."
NO_EQUATIONS = "a trajectory has no equations. Where its phase is at hand, ask its avoidance block: block.verify()."
# Distances are compared at a number of instants in each element; in between they may be larger, by much less than this.
BETWEEN_INSTANTS = 1.1
# As a share of the size of a state, or of one: what the equations of another phase may take for its plan.
FAR_COMPANION = 1e-4
# In sizes of a state: as far as a motion counts that has left the finite numbers.
LOST = 1e6


@dataclass(frozen=True, eq=False)
class EquationsMotion:
    """The motion of the equations beside the motion of a plan.

    Attributes
    ----------
    intervals : int
    deviation : dict of str to array, shape (intervals,)
        By the name of a moving part: how far any of its corners gets from where the plan has it; by the text of a
        clearance: how far what is required gets from what the plan asks for. Zero where a body
        moves by a formula in time; infinite where the motion of the equations left the finite numbers.
    how : str
        How it was found, in words; empty where it is not known.
    why_unknown : str
        Why the equations' motion is not known; empty where it is.
    """

    intervals: int
    deviation: Mapping[str, Array] = field(default_factory=dict)
    how: str = ""
    why_unknown: str = ""

    @property
    def statement(self) -> str:
        """A sentence on the motion of the equations; empty where nobody followed it."""
        if not self.how:
            return ""
        largest = max((float(of.max(initial=0.0)) for of in self.deviation.values()), default=0.0)
        far = f"at most {largest:.2g} from the plan" if np.isfinite(largest) else "unstable: it leaves all bounds"
        return f"the motion of the equations under the plan's controls, {self.how}, is {far}"

    def of(self, name: str) -> Array:
        """Deviation of a part by interval; zero where nothing is known of another motion."""
        return self.deviation.get(name, np.zeros(self.intervals))


def replayed_motion(
    motion: Motion, parts: Iterable[MovingShape | RequiredClearance], *, equations: bool = True
) -> EquationsMotion:
    """How far the motion under the controls leads each moving part, and each clearance, from the plan.

    Parameters
    ----------
    motion : Motion
    parts : iterable of MovingShape and RequiredClearance
        At the current values.
    equations : bool
        Whether anything but the plan is to be looked at.

    Returns
    -------
    EquationsMotion
        Its deviations are those of what reads variables that move: NaN where nobody looked, and a lower bound where
        `why_unknown` says that not everything was seen. Everything else has no other motion than the plan.
    """
    alone = not motion.has_equations
    moving = [(part, of) for part in parts if (of := part.template) is not None and (alone or _components(of))]
    components = list({id(component): component for _, of in moving for component in _components(of)}.values())
    phases = list(
        {id(home): home for of in components if isinstance(home := of.parent_block(), PhaseBlockData)}.values()
    )
    reintegrations: dict[int, Reintegration] = {}
    why, count = "", len(motion.intervals)
    if alone:
        why = NO_EQUATIONS
    elif phases and not equations:
        why = PLAN_ALONE
    elif any(map(_states_equations, phases)):  # elsewhere whatever moves a body is chosen: there is only the plan
        try:
            reintegrations = {id(phase): reintegrated(phase) for phase in phases}
        except PyRobocopError as error:
            why = str(error)
    elif not phases and _rows_move(components):
        why = "the model has rows at its points for it, which say nothing in between."
    if why:
        unknown = {part.name: np.full(count, np.nan) for part, _ in moving}
        return EquationsMotion(count, unknown, why_unknown=why)
    apart = {id(of): _differences(of, reintegrations, count) for _, of in moving if reintegrations}
    deviation = {}
    for part, of in moving if reintegrations else ():
        with np.errstate(all="ignore"):
            largest = BETWEEN_INSTANTS * part.displacements(apart[id(of)]).reshape(count, -1).max(axis=1)
        deviation[part.name] = np.where(np.isfinite(largest), largest, np.inf)
    how = "; ".join(dict.fromkeys(reintegration.how for reintegration in reintegrations.values()))
    return EquationsMotion(count, deviation, how, _why_not_everywhere(phases, components, bool(reintegrations)))


def reintegrated(phase: Any, after: tuple[Any, ...] = ()) -> Reintegration:
    """The motion of a phase's equations at the current values, from where the motions of the phases before it lead.

    All rows that tie its start, links and their jumps included, say where a phase starts when another one ends
    elsewhere than planned. What closes a circle, as in a periodic motion, starts at the plan.

    Parameters
    ----------
    phase : PhaseBlock
    after : tuple of PhaseBlock
        Phases that follow this one, for which it is evaluated.

    Raises
    ------
    PyRobocopError
        When its motion, or where it starts, is not known.
    """
    following = (phase, *after)
    ties = linked_initial_state(phase)
    motions = []
    for other in ties.before:
        if any(other is known for known in following):
            continue
        before = reintegrated(other, following)
        if before.open_loop is None:
            return replace(_states(phase), open_loop=None)
        motions.append((other, _motion_of_equations(other.trajectory(), before)))
    for other in ties.beside:
        _refuse_far_companion(phase, other)
    return _states(phase, ties.start_after(motions))


def needed_reductions(phase: Any, reduction: float, after: tuple[Any, ...] = ()) -> list[tuple[Any, float]]:
    """The phases whose own equations lead the motion of a phase away, and by which factors their errors have to shrink.

    What a phase takes over from those before it is no error of its own mesh, and is traced back to theirs.

    Parameters
    ----------
    phase : PhaseBlock
    reduction : float
        By which factor the distance of its motion from its plan has to shrink; below 1.
    after : tuple of PhaseBlock
        Phases that follow this one, for which it is evaluated.

    Raises
    ------
    PyRobocopError
        When its motion, or where it starts, is not known.
    """
    following = (phase, *after)
    before = [other for other in linked_initial_state(phase).before if not any(other is of for of in following)]
    if not before:
        return [(phase, reduction)]
    own, replayed = _states(phase), reintegrated(phase, after)
    shares = [(phase, by_own := _apart(own.open_loop, own.planned, own.planned))]
    taken_over = 0.0 if by_own == LOST else _apart(replayed.open_loop, own.open_loop, own.planned)
    shares += [(other, taken_over) for other in before]
    allowed = reduction * max(share for _, share in shares)
    needed = [(of, allowed / share) for of, share in shares if share > allowed]
    return [
        each
        for of, factor in needed
        for each in ([(of, factor)] if of is phase else needed_reductions(of, factor, following))
    ]


def _apart(
    first: Mapping[str, Array] | None, second: Mapping[str, Array] | None, planned: Mapping[str, Array]
) -> float:
    """Largest distance of two motions in any state, relative to its size."""
    if first is None or second is None:
        return LOST
    sizes = {name: SMALLEST_SCALE + np.abs(values).max() for name, values in planned.items()}
    apart = max((float(np.abs(first[name] - second[name]).max() / size) for name, size in sizes.items()), default=0.0)
    return min(apart, LOST) if np.isfinite(apart) else LOST


def _states(phase: Any, initial: Mapping[str, float] | None = None) -> Reintegration:
    return reintegrate(phase, phase.trajectory(), initial=initial, states_only=True)


def _refuse_far_companion(phase: Any, other: Any) -> None:
    """Equations read the plan of another phase: its motion must be that, by a small share of the size of each state."""
    motion = _states(other)
    for name, planned in motion.planned.items():
        replayed = None if motion.open_loop is None else motion.open_loop[name]
        away = np.inf if replayed is None else float(np.abs(replayed - planned).max())
        if not away <= FAR_COMPANION * max(1.0, float(np.abs(planned).max())):
            raise TrajectoryError(
                f"the equations of phase '{phase.name}' read states of '{other.name}', whose own equations lead "
                f"'{name}' {away:.2g} away from its plan. Give '{other.name}' more elements."
            )


def _motion_of_equations(planned: Trajectory, reintegration: Reintegration) -> Trajectory:
    """The trajectory of a plan with the states that its equations lead to."""
    assert reintegration.open_loop is not None
    states = {name: values.copy() for name, values in planned.states.items()}
    for name, values in states.items():
        away = reintegration.open_loop[name] - reintegration.planned[name]
        for nodes, difference in zip(planned.grid.node_positions, away, strict=True):
            fractions = planned.grid.scheme.state_nodes
            values[nodes] = planned.states[name][nodes] + np.interp(fractions, reintegration.fractions, difference)
        values[-1] = reintegration.open_loop[name][-1, -1]
    return replace(planned, states=states)


def _states_equations(phase: Any) -> bool:
    """Whether a phase says how its states or algebraics move."""
    for statement in phase.record.statements:
        rows = phase.component(statement.name)
        equations = statement.kind == "constraint" and any(row.equality for row in rows.values())
        if equations or statement.kind in ("ode", "residual", "step map"):
            return True
    return False


def _differences(template: SignalFormulas, reintegrations: Mapping[int, Any], intervals: int) -> Array:
    """Entries of the pose by the equations less the entries by the plan, shape ``(intervals * k, entries)``."""
    # Each phase is looked at where its own rules ask for it.
    fractions = np.unique(np.concatenate([reintegration.fractions for reintegration in reintegrations.values()]))
    interval, fraction = np.repeat(np.arange(intervals), len(fractions)), np.tile(fractions, intervals)
    planned = {slot: signal.values(interval, fraction) for slot, signal in template.signals.items()}
    replayed = dict(planned)
    for slot, signal in template.signals.items():
        home = None if signal.component is None else signal.component.parent_block()
        reintegration = reintegrations.get(id(home))
        if reintegration is None:
            continue
        states = reintegration.open_loop
        name = signal.component.local_name
        if states is None:
            replayed[slot] = np.full(len(interval), np.inf)
        elif name in states:
            # The difference of states is taken from one integration; the plan's polynomial is the same in both.
            off = states[name] - reintegration.planned[name]
            moved = [np.interp(fractions, reintegration.fractions, of_element) for of_element in off]
            replayed[slot] = planned[slot] + np.concatenate(moved)
    with np.errstate(all="ignore"):
        return template.evaluated(replayed, len(interval)) - template.evaluated(planned, len(interval))


def _components(template: SignalFormulas) -> list[Any]:
    """Variables of the model that a pose or a clearance reads over time."""
    return [signal.component for signal in template.signals.values() if signal.component is not None]


def _rows_move(components: Collection[Any]) -> bool:
    """Whether equations of the model tie what poses read to other points, or to other variables.

    Equations among the positions of one point, as a start or a goal, leave the way to it free; those of a block of this
    package, such as one that keeps bodies apart, move nothing.
    """
    own = {id(parent_of(data)) for component in components for data in component.values()}
    models = {id(component.model()): component.model() for component in components}
    for model in models.values():
        for row in model.component_data_objects(Constraint, active=True, descend_into=True):
            if not row.equality or isinstance(row.parent_block(), BuiltBlockData):
                continue
            read = list(variables_in(row.body))
            positions = {variable.index() for variable in read if id(variable.parent_component()) in own}
            others = any(id(variable.parent_component()) not in own for variable in read)
            if len(positions) > 1 or (positions and others):
                return True
    return False


def _why_not_everywhere(phases: Iterable[Any], components: Collection[Any], are_integrated: bool) -> str:
    """What the integration of phases, and of those before them, may not have seen, and where bodies jump."""
    pending = list(phases)
    for phase in pending:
        ties = linked_initial_state(phase)
        pending += [other for other in ties.before if not any(other is of for of in pending)]
        for component in (of for of in components if of.parent_block() is phase):
            start = component[phase.initial_time]
            for other in ties.before if not any(start is given for given in ties.unknowns) else ():
                if component.local_name not in other.record.names_of_states:
                    continue
                end = other.component(component.local_name)[other.final_time]
                if not np.isclose(end.value, start.value):
                    return (
                        f"'{start.name}' does not go on from '{end.name}', and no row says that it jumps by "
                        f"{abs(end.value - start.value):.3g}: let the link between these phases join it."
                    )
        statements = [*phase.record.statements_of("ode"), *phase.record.statements_of("residual")]
        unseen = unseen_on_the_way(phase, phase.trajectory(), statements) if are_integrated else ""
        if unseen:
            return unseen
    return ""
