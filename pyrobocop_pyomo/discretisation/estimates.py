"""`DiscretisationEstimate`: errors that the mesh of an answer makes, and what would make them small.

Where inside an element a control or an algebraic jumps: there a better mesh has a boundary.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from textwrap import shorten

import numpy as np

from pyrobocop_pyomo.numerics import Array, Mesh
from pyrobocop_pyomo.numerics.mesh import remesh
from pyrobocop_pyomo.phases.bounds_between_points import WORTH_A_SENTENCE
from pyrobocop_pyomo.presentation import MOST_CHARACTERS, Presented, percent
from pyrobocop_pyomo.trajectories import Trajectory

# ---------------------------------------------------------------------------------------------------------------- jumps


# A jump is as large a part of what the signal does at all, and what it does beside the jump is as small a part of it.
_JUMP, _QUIET = 0.2, 0.25
# As a part of the jump: a value that is as near to one of its sides belongs to it.
_SIDE = 1e-3
# Not nearer to the ends of the element than this part of it.
_MARGIN = 0.01


def jump_fractions(trajectory: Trajectory) -> dict[int, float]:
    """Local fractions of jumps, by the number of the element; of several in one element, the largest.

    Inside an element a polynomial cannot jump, but the integral of what it does is that of the jump nearly: the states
    at the element's end need it. From a level `a` of the element before to a level `c` of the one after, with the mean
    `m` in the element, the jump is at the fraction ``(c - m) / (c - a)``.

    Parameters
    ----------
    trajectory : Trajectory
    """
    found: dict[int, tuple[float, float]] = {}
    for name in trajectory.signals:
        values = trajectory.element_signals(name)
        size = float(np.ptp(values))
        if size > 0.0:
            for element, fraction, jump in _jumps(values, trajectory.grid.scheme.b, size):
                if element not in found or jump / size > found[element][1]:
                    found[element] = (fraction, jump / size)
    return {element: fraction for element, (fraction, _) in found.items()}


def _jumps(values: Array, weights: Array, size: float) -> list[tuple[int, float, float]]:
    """Element, fraction and size of each jump of one signal, from its values of shape ``(N, s)``."""
    jumps = []
    for i in range(1, len(values) - 1):
        before, here, after = values[i - 1 : i + 2]
        first, last = float(before[-1]), float(after[0])
        jump = last - first
        if abs(jump) < _JUMP * size or max(np.ptp(before), np.ptp(after)) > _QUIET * abs(jump):
            continue
        done = (here - first) / jump
        inside = (done > -_SIDE).all() and (done < 1.0 + _SIDE).all()
        on_one_side = (done < _SIDE).all() or (done > 1.0 - _SIDE).all()
        fraction = 1.0 - float(weights @ done)
        if inside and not on_one_side and _MARGIN < fraction < 1.0 - _MARGIN:
            jumps.append((i, fraction, abs(jump)))
    return jumps


# ------------------------------------------------------------------------------------------------------------ estimates


# Relative to the objective, and to the size of each state: what is above is said before anything else.
SMALL_OBJECTIVE_ERROR = 1e-3
SMALL_MOTION_ERROR = 1e-2
# On finer meshes: the error of the motion that is allowed, as a multiple of those of the objective and of limits.
_MOTION = SMALL_MOTION_ERROR / SMALL_OBJECTIVE_ERROR
# At most so much of errors with different signs is taken to cancel: how well they do is known to leading order only.
CANCELLED = 0.2
# An objective below this part of its scale is zero, but for the tolerance of the solver.
ZERO_OBJECTIVE = 1e-8


def size_of_objective(objective: float, scale: float | None) -> float:
    """What errors of an objective are compared with: itself, or its scale where it is zero.

    Parameters
    ----------
    objective : float
    scale : float or None
        By how much the variables change it, which the program was divided by; None where nothing tells it, and only
        errors below the tolerance of the solver count as zero.
    """
    scale, least = (1.0, ZERO_OBJECTIVE) if scale is None else (scale, scale)
    return abs(objective) if abs(objective) > ZERO_OBJECTIVE * scale else least


@dataclass(frozen=True, eq=False)
class PhaseEstimate(Presented):
    """Of one phase, element by element.

    Attributes
    ----------
    name : str
    motion : array, shape (N,), or None
        How far each element ends from where the equations lead under the controls of the plan, as a part of the size
        of each state; the largest of all states.
    state : str
        The state with the largest one.
    largest : float
        That error in the units of the state.
    objective : array, shape (N,), or None
        What each element adds to the error of the objective, estimated; not negative.
    remarks : tuple of str
        What is not known, and why.
    net : float or None
        What all elements together add to the error of the objective, estimated; errors of different signs cancel.
    passed : float
        By how much bounds and path constraints that states pass between the points flatter the objective, estimated:
        the mean excess beside each point times the multiplier there. `objective` is at least as large.
    excesses : array, shape (N,), or None
        How far each element passes bounds of states and path inequalities of states alone between the points, as a part
        of the size of what is limited, down to a thousandth. Those that controls or algebraics can meet are not
        looked at: other controls between the points meet them.
    bounds_passed : str
        Which states pass their bounds between the points of the mesh, and which controls by more than a hundredth of
        their size, as a sentence; empty where none does.
    """

    name: str
    motion: Array | None
    state: str
    largest: float
    objective: Array | None
    remarks: tuple[str, ...] = ()
    net: float | None = None
    passed: float = 0.0
    excesses: Array | None = None
    bounds_passed: str = ""

    @property
    def relative(self) -> float | None:
        """Largest error of the motion, as a part of the size of the state."""
        return None if self.motion is None else float(self.motion.max(initial=0.0))

    def _summary(self) -> str:
        return f"'{self.name}': largest error of the motion {self.largest:.1e}"


@dataclass(frozen=True, eq=False)
class DiscretisationEstimate(Presented):
    """Estimated errors that the mesh makes: of the motion, and of the objective.

    The error of the objective is that against the optimum of the continuous problem, to leading order; see the page on
    errors of elements in the documentation. What a model states beside its phases, and what pairs do between the
    points, is not seen.

    Attributes
    ----------
    objective : float
        Of the answer.
    phases : dict of phase name to PhaseEstimate
    beside : tuple of str
        What else moves in the model, of which nothing is known, and why.
    size : float
        What errors of the objective are compared with, as `size_of_objective` says; NaN without phases.
    """

    objective: float
    phases: Mapping[str, PhaseEstimate] = field(repr=False)
    beside: tuple[str, ...] = ()
    size: float = math.nan

    @property
    def objective_error(self) -> float | None:
        """Estimated error of the objective, in its own units; None where that of some phase is not known.

        It is zero where nothing free stands in the objective.
        """
        known = [(phase.net, phase.objective) for phase in self.phases.values()]
        parts = [(net, float(of.sum())) for net, of in known if net is not None and of is not None]
        if self.beside or not parts or len(parts) < len(known):
            return None
        nets, sizes = zip(*parts, strict=True)
        return max(abs(sum(nets)), CANCELLED * sum(sizes), sum(phase.passed for phase in self.phases.values()))

    @property
    def relative_objective_error(self) -> float | None:
        """The same as a part of the objective's size."""
        error = self.objective_error
        return None if error is None else error / self.size

    @property
    def motion_error(self) -> float | None:
        """Largest difference, at the end of any element, from the motion of the equations; as a part of each size."""
        return None if self.beside else self._largest_of_all("motion")

    @property
    def excess(self) -> float | None:
        """How far some bound or path inequality of states is passed between the points, as a part of its size."""
        return self._largest_of_all("excesses")

    @property
    def remarks(self) -> tuple[str, ...]:
        """What is not known, and why; and what passes its bounds between the points of the mesh."""
        unknown = tuple(remark for phase in self.phases.values() for remark in phase.remarks)
        return (*self.beside, *unknown, *self.bounds_passed)

    @property
    def bounds_passed(self) -> tuple[str, ...]:
        """A sentence for each phase in which something passes its bounds between the points of the mesh."""
        return tuple(phase.bounds_passed for phase in self.phases.values() if phase.bounds_passed)

    @property
    def is_large(self) -> bool:
        """Whether an error is known to be above a thousandth of the objective, or a hundredth of a state or limit."""
        errors = (self.motion_error, SMALL_MOTION_ERROR), (self.excess, SMALL_MOTION_ERROR)
        known = (*errors, (self.relative_objective_error, SMALL_OBJECTIVE_ERROR))
        return any(error is not None and not error <= small for error, small in known)

    @property
    def largest_known_motion_error(self) -> float:
        """The largest error of the motion in any element, as a part of the size of a state; NaN where none is known."""
        return self._largest("motion")

    def _largest_of_all(self, kind: str) -> float | None:
        """Of all phases; None where that of some phase is not known."""
        is_known = bool(self.phases) and all(getattr(phase, kind) is not None for phase in self.phases.values())
        return self._largest(kind) if is_known else None

    def _largest(self, kind: str) -> float:
        known = [of for of in (getattr(phase, kind) for phase in self.phases.values()) if of is not None]
        return max((float(of.max(initial=0.0)) for of in known), default=math.nan)

    def ratio(self, tolerance: float) -> float:
        """How many times the largest error is what it may be; NaN where none is known.

        Parameters
        ----------
        tolerance : float
            What errors of limits and of the objective may be, relative to sizes; that of the motion ten times so much.
        """
        of_objective = self.relative_objective_error
        errors = [self._largest("motion") / _MOTION, self._largest("excesses")]
        return float(np.fmax.reduce([*errors, math.nan if of_objective is None else of_objective])) / tolerance

    def finer(
        self,
        meshes: Mapping[str, Mesh],
        trajectories: Mapping[str, Trajectory],
        tolerance: float,
        keep: Mapping[str, Collection[float]],
    ) -> dict[str, Mesh]:
        """Meshes on which all elements are expected to meet a tolerance.

        Parameters
        ----------
        meshes : dict of str to Mesh
            Those of this answer.
        trajectories : dict of str to Trajectory
            The answer; where a control jumps, a boundary is put.
        tolerance : float
            As that of `ratio`.
        keep : mapping of str to collection of float
            Boundaries that stay; others may go.
        """
        return {
            name: remesh(
                mesh,
                self._shares(name, mesh.elements) / tolerance,
                1.0,
                trajectories[name].grid.scheme.order,
                keep=keep[name],
                jumps=jump_fractions(trajectories[name]),
            )
            for name, mesh in meshes.items()
        }

    def _shares(self, name: str, elements: int) -> Array:
        """Each element's errors, relative to sizes; of the objective, as if all elements had the same."""
        errors, of = np.zeros(elements), self.phases.get(name)
        if of is not None and of.motion is not None:
            errors = of.motion / _MOTION
        if of is not None and of.excesses is not None:
            errors = np.maximum(errors, of.excesses)
        if of is not None and of.objective is not None:
            count = sum(len(other.objective) for other in self.phases.values() if other.objective is not None)
            errors = np.maximum(errors, of.objective * count / self.size)
        return errors

    @property
    def is_known(self) -> bool:
        """Whether the errors of the objective and of the motion were computed."""
        return self.objective_error is not None and self.motion_error is not None

    def in_short(self) -> str:
        """What is said wherever a result is shown: the larger error, or why it is not known; empty without a mesh."""
        if not (self.phases or self.beside):
            return ""
        objective, motion = self.objective_error, self.motion_error
        if objective is None or motion is None:
            unknown = [phase for phase in self.phases.values() if phase.motion is None or phase.net is None]
            why = (*self.beside, *(phase.remarks[0] for phase in unknown))
            return shorten(f"mesh error not known: {why[0]}", MOST_CHARACTERS, placeholder=" ...")
        elements = sum(len(phase.motion) for phase in self.phases.values() if phase.motion is not None)
        error = percent(motion) if motion >= objective / self.size else self._objective_error_in_words(objective)
        return f"mesh error {error} on {elements} elements"

    def _objective_error_in_words(self, error: float) -> str:
        """A part of the objective; where that is zero, a part of it says nothing, and the size does."""
        if error <= abs(self.objective):
            return percent(error / self.size)
        return f"{error:.1e} in its units, where the objective is {self.objective:.1e}"

    def sentence(self) -> str:
        """The errors in one line; empty where nothing is known."""
        parts = []
        if (error := self.objective_error) is not None:
            parts.append(f"objective {error:.1e} ({self._objective_error_in_words(error)})")
        elif self.phases:
            parts.append("objective not known")
        worst = max(
            (p for p in self.phases.values() if p.relative is not None),
            key=lambda phase: phase.relative or 0.0,
            default=None,
        )
        if worst is not None:
            parts.append(
                f"motion {worst.largest:.1e} at '{worst.name}.{worst.state}' ({percent(worst.relative or 0.0)})"
            )
        elif self.phases:
            parts.append("motion not known")
        if self.excess is not None and not self.excess <= WORTH_A_SENTENCE:
            parts.append(f"limits of states passed between the points by {percent(self.excess)} of their sizes")
        return f"error of the mesh, estimated: {', '.join(parts)}" if parts else ""

    def __str__(self) -> str:
        advice = "The mesh is coarse: take more elements." if self.is_large else ""
        return "\n".join(line for line in (self.sentence(), advice, *self.remarks) if line)
