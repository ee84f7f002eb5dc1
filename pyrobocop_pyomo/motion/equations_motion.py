"""How far bodies get from where a plan has them when a robot integrates its controls.

A plan is the polynomials of its states. The equations hold at the collocation points only; what the controls lead to is
another motion, by the error of the discretisation. `PhaseBlock.reintegrate` gives its states. Here they become the
distances of corners, which are taken off what is proven for the plan.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import PyRobocopError
from pyrobocop_pyomo.links import LinkData
from pyrobocop_pyomo.modeling.blocks import blocks_of_kind
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.phases import PhaseBlockData
from pyrobocop_pyomo.phases.reintegration import Reintegration

from .motion import Motion
from .moving_shapes import MovingShape
from .pose_templates import SignalFormulas

# Distances are compared at a number of instants in each element; in between they may be larger, by much less than this.
BETWEEN_INSTANTS = 1.1


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
        """What is known of the motion of the equations, in words; nothing where there are none."""
        if self.why_unknown:
            return f"the motion of the equations is not known, and not proven: {self.why_unknown}"
        if not self.how:
            return ""
        largest = max((float(of.max(initial=0.0)) for of in self.deviation.values()), default=0.0)
        far = f"at most {largest:.2g} from the plan" if np.isfinite(largest) else "unstable: it leaves all bounds"
        return f"the motion of the equations under the plan's controls, {self.how}, is {far}"

    def of(self, name: str, intervals: int) -> Array:
        """Deviation of a part by interval; zero where nothing is known of another motion."""
        return self.deviation.get(name, np.zeros(intervals))


def phases_of_motion(motion: Motion) -> list[Any]:
    """The phases whose states move along the points of a motion."""
    states = getattr(motion.interpolation, "states", None)
    phase = getattr(states, "phase", None)
    return [] if phase is None else [phase]


def equations_motion(
    motion: Motion, shapes: Mapping[str, list[MovingShape]], lengths: Mapping[str, SignalFormulas] | None = None
) -> EquationsMotion:
    """Integrate the equations of all phases that poses read, and compare the corners.

    Parameters
    ----------
    motion : Motion
    shapes : mapping of body to list of MovingShape
        At the current values.
    lengths : mapping of str to SignalFormulas, optional
        Clearances that read signals: with other states, another clearance is required.
    """
    # A formula of the user's own between points is no motion of a phase.
    found_in = [(shape, shape.template) for parts in shapes.values() for shape in parts]
    moving = [(shape, template) for shape, template in found_in if isinstance(template, SignalFormulas)]
    phases: dict[int, Any] = {}
    lengths = lengths or {}
    for template in [*(template for _, template in moving), *lengths.values()]:
        for signal in template.signals:
            home = None if signal.component is None else signal.component.parent_block()
            if isinstance(home, PhaseBlockData):
                phases[id(home)] = home
    if not phases:
        reads_signals = any(signal.component is not None for _, template in moving for signal in template.signals)
        if motion.interpolation is None or motion.interpolation.is_assumed or not reads_signals:
            return EquationsMotion()
        return EquationsMotion(why_unknown="the model has rows at its points for them, which say nothing in between.")
    found: dict[int, Any] = {}
    for key, phase in phases.items():
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
    """The motion of a phase's equations at the current values, from where those of the phases before it end.

    Links say where a phase starts when the one before ends elsewhere than planned, jumps included. A link that closes a
    circle, as in a periodic motion, starts at the plan.

    Parameters
    ----------
    phase : PhaseBlock
    after : tuple of PhaseBlock
        Phases that follow this one, for which it is evaluated.
    """
    following = (phase, *after)
    for link in blocks_of_kind(phase.model(), LinkData):
        if link.second is phase and not any(link.first is other for other in following):
            first = link.first
            before = reintegrated(first, following)
            if before.contact:
                break  # each element starts where the plan does
            if before.open_loop is None:
                return replace(phase.reintegrate(), open_loop=None)
            planned = first.trajectory()
            ends = {name: float(states[-1, -1]) for name, states in before.open_loop.items()}
            led = {name: np.append(planned.states[name][:-1], end) for name, end in ends.items()}
            found: Reintegration = phase.reintegrate(initial=link.start_after(replace(planned, states=led)))
            return found
    whole: Reintegration = phase.reintegrate()
    return whole


def _differences(template: SignalFormulas, found: Mapping[int, Any], intervals: int) -> Array:
    """Entries of the pose by the equations less those of the plan, shape ``(intervals, k, entries)``."""
    # Each phase is looked at where its own rules ask for it.
    fractions = np.unique(np.concatenate([reintegration.fractions for reintegration in found.values()]))
    interval, fraction = np.repeat(np.arange(intervals), len(fractions)), np.tile(fractions, intervals)
    planned, led = {}, {}
    for signal in template.signals:
        planned[id(signal.placeholder)] = led[id(signal.placeholder)] = signal.values(interval, fraction)
        home = None if signal.component is None else signal.component.parent_block()
        reintegration = found.get(id(home))
        if reintegration is None:
            continue
        states = reintegration.states
        name = signal.component.local_name
        if states is None:
            led[id(signal.placeholder)] = np.full(len(interval), np.inf)
        elif name in states:
            # The difference of states is taken from one integration; the plan's polynomial is the same in both.
            off = states[name] - reintegration.planned[name]
            moved = [np.interp(fractions, reintegration.fractions, of_element) for of_element in off]
            led[id(signal.placeholder)] = signal.values(interval, fraction) + np.concatenate(moved)
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
