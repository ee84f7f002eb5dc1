"""Random arms that reach from one compartment of a shelf into another, or from in front of it into one."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

CLEARANCE = 0.01
BOARD, DEPTH, WIDTH = 0.03, 0.35, 0.7  # of the shelf: thickness of its boards, how deep and how wide it is
# Lengths of the links and half widths; the arm in the plane has its height above the floor, that in space its column.
LENGTHS = {3: (0.45, 0.4, 0.25), 6: (0.3, 0.25, 0.2, 0.2, 0.15, 0.15)}
IN_SPACE = {3: ("z", "y", "y"), 6: ("z", "y", "y", "x", "y", "x")}
LENGTHS_IN_SPACE = {3: (0.0, 0.5, 0.5), 6: (0.0, 0.45, 0.2, 0.2, 0.1, 0.12)}
HALF = 0.03
KINDS = [(dimension, joints, order, goal) for goal in ("joints", "hand") for order in (1, 2) for joints in (3, 6)
         for dimension in (2, 3)]  # fmt: skip


def random_shelf(seed: int, elements: int = 20, stages: int = 2, **options: Any) -> pyo.ConcreteModel:
    """Least effort of the joints from the start to the goal; the initial guess is the straight line of the joints.

    Parameters
    ----------
    seed : int
        Of the scene and of the kind of arm: in the plane or in space, three joints or six, with the rates of the joints
        as controls or their accelerations, and a goal for the joints or for the pose of the hand.
    elements, stages : int
    **options
        Of the `ObstacleAvoidanceBlock`.
    """
    dimension, joints, order, goal = KINDS[seed % len(KINDS)]
    rng = np.random.default_rng([seed, dimension, joints])
    poses, shapes = _arm(dimension, joints)
    limit = 2.8 if dimension == 2 else 2.5
    start, end, boards = _scene(rng, dimension, joints, poses, shapes, limit)
    m = pyo.ConcreteModel(name=f"shelf {seed}: {joints} joints in {dimension}D, order {order}, goal of the {goal}")
    m.reach = b = rcp.PhaseBlock(duration=4.0, elements=elements, stages=stages)
    names = [f"q{k}" for k in range(joints)]
    for k, name in enumerate(names):
        last = {"final": float(end[k])} if goal == "joints" else {}
        b.declare(name, rcp.State(initial=float(start[k]), bounds=(-limit, limit), **last))
        if order == 1:
            b.declare(f"w{k}", rcp.Control(bounds=(-3, 3)))
        else:
            b.declare(f"w{k}", rcp.State(initial=0, final=0, bounds=(-3, 3)))
            b.declare(f"a{k}", rcp.Control(bounds=(-12, 12)))

    @b.ode
    def turning(b: Any, t: Any) -> dict[Any, Any]:
        rates = {b.component(f"q{k}"): b.component(f"w{k}")[t] for k in range(joints)}
        return rates if order == 1 else rates | {
            b.component(f"w{k}"): b.component(f"a{k}")[t] for k in range(joints)
        }  # fmt: skip

    def pose(link: int) -> Callable[[Any, Any], rcp.Pose]:
        return lambda b, t: poses([b.component(name)[t] for name in names])[link]

    if goal == "hand":
        t = b.time.last()
        wanted, there = poses(end.tolist())[joints - 1].numbers(), pose(joints - 1)(b, t)
        at, length = LENGTHS[joints][-1] if dimension == 2 else LENGTHS_IN_SPACE[joints][-1], dimension
        ahead = [there.rotation[i][0] for i in range(dimension)]
        tip, place = (wanted[1] + wanted[0][:, 0] * at).tolist(), there.translation
        m.hand = pyo.Constraint(range(length), rule=lambda m, i: place[i] + at * ahead[i] == tip[i])
    moved = "w" if order == 1 else "a"
    m.effort = pyo.Objective(
        expr=b.integral(lambda b, t: sum(b.component(f"{moved}{k}")[t] ** 2 for k in range(joints)))
    )
    b.initialize_straight_lines()
    bodies = {f"link {k}": rcp.Body(shape, pose=pose(k)) for k, shape in shapes.items()}
    links = list(shapes)
    b.avoid = rcp.ObstacleAvoidanceBlock(
        b.time, bodies=bodies, obstacles=boards, clearance=CLEARANCE,
        exclude=[(f"link {i}", f"link {j}") for i, j in itertools.pairwise(links)], **options,
    )  # fmt: skip
    return m


def _arm(dimension: int, joints: int) -> tuple[Callable[[Any], list[rcp.Pose]], dict[int, rcp.Polytope]]:
    """Poses of all links at the angles of the joints, and the shapes of the links that have one."""
    if dimension == 2:
        lengths = LENGTHS[joints]
        shapes = {
            k: rcp.Polytope.capsule((HALF, 0), (length - HALF, 0), HALF) for k, length in enumerate(lengths)
        }  # fmt: skip

        def in_plane(angles: Any) -> list[rcp.Pose]:
            pose, found = rcp.planar_pose(0.0, 0.0), []
            for angle, before in zip(angles, (0.0, *lengths), strict=False):
                pose = pose @ rcp.planar_pose(before, 0.0, angle)
                found.append(pose)
            return found

        return in_plane, shapes
    lengths, axes = LENGTHS_IN_SPACE[joints], IN_SPACE[joints]
    boxes = {
        k: rcp.Polytope.box(length, 2 * HALF, 2 * HALF, center=(length / 2, 0, 0))
        for k, length in enumerate(lengths) if length > 0
    }  # fmt: skip

    def in_space(angles: Any) -> list[rcp.Pose]:
        pose, found = rcp.spatial_pose((0.0, 0.0, 0.4)), []
        for angle, axis, before in zip(angles, axes, (0.0, *lengths), strict=False):
            turn = [angle if axis == own else 0.0 for own in "xyz"]
            pose = pose @ rcp.spatial_pose((before, 0.0, 0.0), euler=turn)
            found.append(pose)
        return found

    return in_space, boxes


def _scene(
    rng: np.random.Generator, dimension: int, joints: int, poses: Any, shapes: dict[int, rcp.Polytope], limit: float
) -> tuple[np.ndarray, np.ndarray, dict[str, rcp.Polytope]]:
    """Start, goal and boards: every second start is in another compartment, the others are in front of the shelf."""
    last = (LENGTHS if dimension == 2 else LENGTHS_IN_SPACE)[joints][-1]
    while True:
        front, gap = float(rng.uniform(0.45, 0.7)), float(rng.uniform(0.24, 0.36))
        low = float(rng.uniform(-0.45, -0.15)) + (0.4 if dimension == 3 else 0.0)
        heights = [low + k * (gap + BOARD) for k in range(4)]
        boards = _boards(dimension, front, heights)
        chosen = rng.permutation(3)[:2]
        middles = [heights[k] + 0.5 * (gap + BOARD) for k in chosen]
        inside = bool(rng.integers(2))
        goals = _reaching(rng, poses, shapes, boards, limit, joints, last, (front, middles[0], gap))
        starts = _reaching(
            rng, poses, shapes, boards, limit, joints, last, (front, middles[1], gap) if inside else None
        )
        if len(goals) and len(starts):
            return starts[0], goals[0], boards


def _boards(dimension: int, front: float, heights: list[float]) -> dict[str, rcp.Polytope]:
    size = (DEPTH,) if dimension == 2 else (DEPTH, WIDTH)
    aside = () if dimension == 2 else (0.0,)
    found = {
        f"board {k}": rcp.Polytope.box(*size, BOARD, center=(front + DEPTH / 2, *aside, height))
        for k, height in enumerate(heights)
    }  # fmt: skip
    middle, tall = (heights[0] + heights[-1]) / 2, heights[-1] - heights[0] + BOARD
    found["back"] = rcp.Polytope.box(BOARD, *size[1:], tall, center=(front + DEPTH + BOARD / 2, *aside, middle))
    if dimension == 3:
        for name, y in (("left side", WIDTH / 2), ("right side", -WIDTH / 2)):
            found[name] = rcp.Polytope.box(DEPTH, BOARD, tall, center=(front + DEPTH / 2, y, middle))
    return found


def _reaching(
    rng: np.random.Generator, poses: Any, shapes: dict[int, rcp.Polytope], boards: dict[str, rcp.Polytope],
    limit: float, joints: int, last: float, compartment: tuple[float, float, float] | None, tries: int = 4000,
) -> list[np.ndarray]:  # fmt: skip
    """An arm that is clear of everything with its hand in a compartment, or in front of the shelf."""
    for _ in range(tries):
        angles = rng.uniform(-limit, limit, joints)
        if joints == 6 or compartment is not None:
            angles = angles * rng.uniform(0.2, 0.7)
        placed = poses(angles.tolist())
        turn, place = placed[-1].numbers()
        tip = place + turn[:, 0] * last
        if compartment is not None:
            front, middle, gap = compartment
            aside = abs(tip[1]) < WIDTH / 2 - 0.08 if len(tip) == 3 else True
            if not (front + 0.08 < tip[0] < front + DEPTH - 0.04 and abs(tip[-1] - middle) < gap / 2 - 0.05 and aside):
                continue
        elif tip[0] > 0.4:
            continue
        links = {k: shape.placed(placed[k]) for k, shape in shapes.items()}
        far = all(
            rcp.scenes.signed_distance(link, board).distance > 2 * CLEARANCE
            for link in links.values() for board in boards.values()
        )  # fmt: skip
        order = list(links)
        own = all(
            rcp.scenes.signed_distance(links[i], links[j]).distance > 2 * CLEARANCE
            for n, i in enumerate(order) for j in order[n + 2 :]
        )  # fmt: skip
        if far and own:
            return [angles]
    return []
