"""How far bodies get from where a plan has them when a robot integrates its controls.

A plan is the polynomials of its states. The equations hold at the collocation points only; what the controls lead to is
another motion, by the error of the discretisation. `PhaseBlock.reintegrate` gives its states. Here they become the
distances of corners, which are taken off what is proven for the plan.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import PyRobocopError, TrajectoryError
from pyrobocop_pyomo.links.tied_starts import ties_of
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.phases.reintegration import SMALLEST_SCALE, Reintegration, reintegrate
from pyrobocop_pyomo.trajectories import Trajectory

from .motion import Motion
from .moving_shapes import MovingShape
from .rules_along_motion import SignalFormulas

# Distances are compared at a number of instants in each element; in between they may be larger, by much less than this.
BETWEEN_INSTANTS = 1.1
# As a share of the size of a state, or of one: what the equations of another phase may take for its plan.
FAR_COMPANION = 1e-4
# In sizes of a state: as far as a motion counts that has left the finite numbers.
LOST = 1e6


@dataclass(frozen=True, eq=False)
class EquationsMotion:
    """The motion of the equations beside that of a plan.

    Attributes
    ----------
    deviation : dict of str to array, shape (intervals,)
        By the name of a moving part: how far any of its corners gets from where the plan has it; by the text of a
        clearance: how far what is required gets from what the plan asks for. Zero where a body
        moves by a formula in time; infinite where the motion of the equations left the finite numbers.
    how : str
        How it was found, in words; empty where it is not known.
    why_unknown : str
        Why the equations' motion is not known; empty where it is.
    """

    deviation: Mapping[str, Array] = field(default_factory=dict)
    how: str = ""
    why_unknown: str = ""

    @property
    def statement(self) -> str:
        """What is known of the motion of the equations, in words; nothing where nobody followed it."""
        if not self.how:
            return ""
        largest = max((float(of.max(initial=0.0)) for of in self.deviation.values()), default=0.0)
        far = f"at most {largest:.2g} from the plan" if np.isfinite(largest) else "unstable: it leaves all bounds"
        return f"the motion of the equations under the plan's controls, {self.how}, is {far}"

    def of(self, name: str, intervals: int) -> Array:
        """Deviation of a part by interval; zero where nothing is known of another motion."""
        return self.deviation.get(name, np.zeros(intervals))


def equations_motion(
    motion: Motion,
    phases: Collection[Any],
    shapes: Mapping[str, list[MovingShape]],
    lengths: Mapping[str, SignalFormulas] | None = None,
) -> EquationsMotion:
    """Integrate the equations of phases, and compare the corners.

    Parameters
    ----------
    motion : Motion
    phases : collection of PhaseBlock
        All that poses and clearances read.
    shapes : mapping of body to list of MovingShape
        At the current values.
    lengths : mapping of str to SignalFormulas, optional
        Clearances that read signals: with other states, another clearance is required.
    """
    moving = [(shape, shape.template) for parts in shapes.values() for shape in parts if shape.template is not None]
    lengths = lengths or {}
    # Where a phase states no equations, whatever moves a body is chosen, and there is no other motion than the plan.
    if not any(map(_states_equations, phases)):
        return EquationsMotion()
    found: dict[int, Any] = {}
    for phase in phases:
        key = id(phase)
        try:
            found[key] = reintegrated(phase)
        except PyRobocopError as error:
            return EquationsMotion(why_unknown=str(error))
        if len(found[key].errors) != len(motion.intervals):
            return EquationsMotion(why_unknown=f"phase '{phase.name}' has other elements than the motion.")
    by_template: dict[int, Array] = {}
    deviation = {}
    for shape, template in moving:
        if id(template) not in by_template:
            by_template[id(template)] = _differences(template, found, len(motion.intervals))
        deviation[shape.name] = _of_corners(shape, by_template[id(template)])
    for name, length in lengths.items():
        difference = np.abs(_differences(length, found, len(motion.intervals))).max(axis=(1, 2))
        deviation[name] = np.where(np.isfinite(difference), BETWEEN_INSTANTS * difference, np.inf)
    hows = dict.fromkeys(reintegration.how for reintegration in found.values())
    return EquationsMotion(deviation, how="; ".join(hows))


def reintegrated(phase: Any, after: tuple[Any, ...] = ()) -> Reintegration:
    """The motion of a phase's equations at the current values, from where those of the phases before it lead.

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
    ties = ties_of(phase)
    led = []
    for other in ties.before:
        if any(other is known for known in following):
            continue
        before = reintegrated(other, following)
        if before.open_loop is None:
            return replace(_states(phase), open_loop=None)
        led.append((other, _led(other.trajectory(), before)))
    for other in ties.beside:
        _refuse_far_companion(phase, other)
    return _states(phase, ties.start_after(led))


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
    before = [other for other in ties_of(phase).before if not any(other is of for of in following)]
    if not before:
        return [(phase, reduction)]
    own, led = _states(phase), reintegrated(phase, after)
    shares = [(phase, by_own := _apart(own.states, own.planned, own.planned))]
    taken_over = 0.0 if by_own == LOST else _apart(led.states, own.states, own.planned)
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
    return reintegrate(phase, phase.record, phase.trajectory(), initial=initial, states_only=True)


def _refuse_far_companion(phase: Any, other: Any) -> None:
    """Equations read the plan of another phase: its motion must be that, by a small share of the size of each state."""
    motion = _states(other)
    for name, planned in motion.planned.items():
        led = None if motion.states is None else motion.states[name]
        away = np.inf if led is None else float(np.abs(led - planned).max())
        if not away <= FAR_COMPANION * max(1.0, float(np.abs(planned).max())):
            raise TrajectoryError(
                f"the equations of phase '{phase.name}' read states of '{other.name}', whose own equations lead "
                f"'{name}' {away:.2g} away from its plan. Give '{other.name}' more elements."
            )


def _led(planned: Trajectory, found: Reintegration) -> Trajectory:
    """The trajectory of a plan with the states that its equations lead to."""
    assert found.open_loop is not None
    states = {name: values.copy() for name, values in planned.states.items()}
    for name, values in states.items():
        away = found.open_loop[name] - found.planned[name]
        for nodes, difference in zip(planned.grid.node_positions, away, strict=True):
            fractions = planned.grid.scheme.state_nodes
            values[nodes] = planned.states[name][nodes] + np.interp(fractions, found.fractions, difference)
        values[-1] = found.open_loop[name][-1, -1]
    return replace(planned, states=states)


def _states_equations(phase: Any) -> bool:
    """Whether a phase says how its states or algebraics move."""
    for statement in phase.record.statements:
        rows = phase.component(statement.name)
        equations = statement.kind == "constraint" and any(row.equality for row in rows.values())
        if equations or statement.kind in ("ode", "residual", "step map"):
            return True
    return False


def _differences(template: SignalFormulas, found: Mapping[int, Any], intervals: int) -> Array:
    """Entries of the pose by the equations less those of the plan, shape ``(intervals, k, entries)``."""
    # Each phase is looked at where its own rules ask for it.
    fractions = np.unique(np.concatenate([reintegration.fractions for reintegration in found.values()]))
    interval, fraction = np.repeat(np.arange(intervals), len(fractions)), np.tile(fractions, intervals)
    planned = {slot: signal.values(interval, fraction) for slot, signal in template.signals.items()}
    led = dict(planned)
    for slot, signal in template.signals.items():
        home = None if signal.component is None else signal.component.parent_block()
        reintegration = found.get(id(home))
        if reintegration is None:
            continue
        states = reintegration.states
        name = signal.component.local_name
        if states is None:
            led[slot] = np.full(len(interval), np.inf)
        elif name in states:
            # The difference of states is taken from one integration; the plan's polynomial is the same in both.
            off = states[name] - reintegration.planned[name]
            moved = [np.interp(fractions, reintegration.fractions, of_element) for of_element in off]
            led[slot] = planned[slot] + np.concatenate(moved)
    with np.errstate(all="ignore"):
        difference = template.evaluated(led, len(interval)) - template.evaluated(planned, len(interval))
    return difference.reshape(intervals, len(fractions), -1)


def _of_corners(shape: MovingShape, difference: Array) -> Array:
    """Largest displacement of any corner in each interval; infinite where it is not finite, or a ray turns."""
    d = shape.shape.dimension
    rotation = difference[:, :, : d * d].reshape(*difference.shape[:2], d, d)
    with np.errstate(all="ignore"):
        moved = np.einsum("nkrc,ic->nkir", rotation, shape.shape.vertices) + difference[:, :, None, d * d :]
        largest = BETWEEN_INSTANTS * np.linalg.norm(moved, axis=3).max(axis=(1, 2))
        if len(shape.shape.rays):
            turned = np.abs(rotation).max(axis=(1, 2, 3))
            largest = np.where(turned > 1e-12, np.inf, largest)
    return np.where(np.isfinite(largest), largest, np.inf)
