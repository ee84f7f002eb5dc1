"""`verify_clearance`: the proof that bodies keep their distances at all times, or the instant at which they do not.

A stretch of time is proven clear by one plane: with a fixed unit vector ``n``, the gap ``n . p_i - n . q_j`` of two
corners is a function of time that exceeds neither side of its chord by more than ``h^2 / 8`` times its second
derivative. Stretches that a plane does not prove are halved. See the explanation of obstacle avoidance.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import check_pose, signed_distance

from .bodies import Body
from .motion import Motion
from .moving_shapes import moving_shapes
from .pair_proof import Effort, prove_pair
from .pose_templates import clocks_of
from .safety_report import PairSafety, SafetyReport

_SHARE_OF_CLEARANCE = 0.01


def verify_clearance(
    motion: Motion,
    bodies: Mapping[str, Body],
    clearances: Mapping[tuple[str, str], float],
    *,
    tolerance: float | None = None,
    depth: int = 24,
    pieces: int = 20_000,
) -> SafetyReport:
    """Judge the distances of pairs of bodies over a whole motion, at the current values of the model.

    Parameters
    ----------
    motion : Motion
    bodies : mapping of name to Body
    clearances : dict of (str, str) to float
        Which pairs are judged, and the distance that each has to keep.
    tolerance : float, optional
        Distances down to ``clearance - tolerance`` count as kept; 1 % of each clearance by default.
    depth : int
        How often a stretch of time may be halved before the pair is left undecided there.
    pieces : int
        How many stretches a pair may take.

    Returns
    -------
    SafetyReport
        Safe only where the distance is *proven*, up to rounding; every pair of convex parts has its line. Intervals
        whose values are no motion of rigid bodies, because they leap or shrink by more than the tolerance, are
        undecided.

    Raises
    ------
    ObstacleError
        Naming the body whose pose cannot be followed between the nodes, or a pair of bodies that are not there.
    """
    for pair, clearance in clearances.items():
        missing = [name for name in pair if name not in bodies]
        if missing:
            raise ObstacleError(f"the pair {pair} names '{missing[0]}'; the bodies are {', '.join(bodies)}.")
        sizes = [bodies[name].dimension for name in pair]
        if sizes[0] != sizes[1]:
            raise ObstacleError(f"the pair {pair} is of a body in {sizes[0]} and one in {sizes[1]} dimensions.")
        if tolerance is not None and not 0.0 < tolerance < clearance:
            raise ObstacleError(
                f"tolerance = {tolerance!r}: expected a length between 0 and the clearance of {pair}, {clearance:g}. "
                "With none at all, bodies that keep their clearance exactly could not be proven to."
            )
    if not motion.intervals:
        return _at_points(motion, bodies, clearances, tolerance)
    watched = {name: bodies[name] for name in dict.fromkeys(name for pair in clearances for name in pair)}
    shapes = moving_shapes(motion, watched)
    with np.errstate(all="ignore"):
        strays = {name: [shape.strays(motion) for shape in parts] for name, parts in shapes.items()}
    clocks = clocks_of(motion)
    ends = np.array([[clocks[nodes[0]], clocks[nodes[-1]]] for nodes in motion.intervals])
    found = []
    for (first, second), clearance in clearances.items():
        effort = Effort(_tolerance(tolerance, clearance), depth, pieces)
        found += [
            prove_pair(a, b, clearance, ends, effort, a_strays + b_strays)
            for a, a_strays in zip(shapes[first], strays[first], strict=True)
            for b, b_strays in zip(shapes[second], strays[second], strict=True)
        ]
    return SafetyReport(tuple(found))


def _tolerance(tolerance: float | None, clearance: float) -> float:
    return _SHARE_OF_CLEARANCE * clearance if tolerance is None else tolerance


def _at_points(
    motion: Motion, bodies: Mapping[str, Body], clearances: Mapping[tuple[str, str], float], tolerance: float | None
) -> SafetyReport:
    """Points without order: exact distances there are all there is."""
    poses: dict[tuple[str, Any], Any] = {}
    for name, body in bodies.items():
        for point in motion.points:
            pose = None if body.pose is None else motion.pose_at_node(body.pose, point, name=name)
            if pose is not None:
                check_pose(pose, name)
            poses[name, point] = pose
    found = []
    for (first, second), clearance in clearances.items():
        for a, p in bodies[first].named_parts(first):
            for b, q in bodies[second].named_parts(second):
                distances = np.array(
                    [signed_distance(p, q, poses[first, at], poses[second, at]).distance for at in motion.points]
                )
                worst = int(np.argmin(distances))
                found.append(
                    PairSafety(
                        first=a,
                        second=b,
                        clearance=clearance,
                        tolerance=_tolerance(tolerance, clearance),
                        distance=float(distances[worst]),
                        proven=float(distances[worst]),
                        time=motion.points[worst],
                        interval=None,
                        interval_distance=distances,
                        interval_proven=distances,
                        undecided=(),
                        pieces=len(distances),
                    )
                )
    return SafetyReport(tuple(found), between=False)
