"""Poses between the nodes follow the polynomials that trajectories evaluate."""

import math
import pickle
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.moving import by_states, check, on_a_phase, on_points
from pyomo.dae import ContinuousSet, DerivativeVar

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError, ObstacleError
from pyrobocop_pyomo.geometry import Polytope, planar_pose
from pyrobocop_pyomo.motion import Body, motion_of
from pyrobocop_pyomo.motion.motion import Motion
from pyrobocop_pyomo.motion.moving_shapes import template_of
from pyrobocop_pyomo.templates.template import templated

FAR = Polytope.box(1, 1, center=(90, 90))
FIXED = {"duration": 2.0}
FREE = {"duration": rcp.Duration(bounds=(0.5, 3), initial_guess=2.0), "free_element_widths": (0.2, 4.0)}
FOLLOWED = [
    ("radau", 3, FREE),
    ("gauss", 2, FREE),
    ("lobatto", 3, FIXED),
    ("explicit_euler", None, FIXED),
    ("implicit_midpoint", None, FREE),
]


def path(t: float) -> tuple[float, float, float]:
    return math.sin(3 * t), t * math.cos(2 * t), 1.5 * t**2


def by_clock(m: Any, t: Any) -> Any:
    b = m.move
    return planar_pose(b.x[t] + 0.1 * b.time_at(t), b.y[t] * pyo.cos(b.time_at(t)), b.theta[t] - b.duration)


@pytest.mark.parametrize(("scheme", "stages", "horizon"), FOLLOWED, ids=str)
def test_poses_follow_the_trajectory(scheme: str, stages: int | None, horizon: dict[str, Any]) -> None:
    """In expressions, in the template's values and in its Taylor forms alike, whatever the scheme and the horizon."""
    m = on_a_phase(path, scheme, stages, elements=4, **horizon)
    if "free_element_widths" in horizon:
        for i, boundary in enumerate([0.0, 0.15, 0.55, 0.7, 1.0]):
            m.move.boundary[i] = boundary
    motion = motion_of(m.move.time, m)
    trajectory = m.move.trajectory()
    template = template_of(motion, by_clock, "body", 2)
    fractions = np.array([0.13, 0.47, 0.86])
    for interval in range(4):
        ends = [pyo.value(motion.time_at(motion.intervals[interval][k])) for k in (0, -1)]
        clocks = ends[0] + fractions * (ends[1] - ends[0])
        at = trajectory(clocks)
        expected = np.stack([at["x"] + 0.1 * clocks, at["y"] * np.cos(clocks), np.cos(at["theta"] - 2.0)], axis=1)
        poses = [motion.pose_at(by_clock, interval, fraction).numbers() for fraction in fractions]
        found = np.array([[*translation, rotation[0, 0]] for rotation, translation in poses])
        assert found == pytest.approx(expected, abs=1e-12)
        where = np.full(3, interval)
        entries = template.values(where, fractions)
        assert entries[:, [4, 5, 0]] == pytest.approx(expected, abs=1e-12)
        for column, form in zip(entries.T, template.taylor_forms(where, fractions - 0.1, fractions + 0.1), strict=True):
            assert (form.value.low <= column).all()
            assert (column <= form.value.high).all()


@pytest.mark.parametrize("points", ["time", "points"])
def test_intervals_are_the_elements_of_a_phase(points: str) -> None:
    m = on_a_phase(path, "gauss", 2, elements=3, duration=2.0)
    motion = motion_of(m.move.component(points), m.move)
    assert motion.points == tuple(m.move.component(points))
    boundaries = m.move.grid.mesh.boundaries
    assert [(nodes[0], nodes[-1]) for nodes in motion.intervals] == list(pairwise(boundaries))
    assert sorted({node for nodes in motion.intervals for node in nodes}) == list(m.move.time)


def test_at_a_node_the_rule_itself_is_asked() -> None:
    m = on_a_phase(path, elements=2, duration=2.0)
    motion = motion_of(m.move.time, m.move)
    for interval, nodes in enumerate(motion.intervals):
        for fraction, node in zip(motion.local_fractions(interval), nodes, strict=True):
            assert motion.index_at(interval, fraction) == node
            assert motion.pose_at(by_states, interval, fraction).translation[0] is m.move.x[node]


@pytest.mark.parametrize("given", [["a", "b"], {1, 2}, [3.0]], ids=str)
def test_points_between_which_nothing_is_known_are_refused(given: Any) -> None:
    with pytest.raises(ObstacleError, match="'points'"):
        motion_of(given, pyo.ConcreteModel())


# With a pose, an interval, a fraction of it, and the place there.
Followed = tuple[Motion, Any, int, float, list[float]]


def plain_points() -> Followed:
    m = on_points([(0, 1, 0), (2, 5, 0.5), (2, 0, 1)], times=[0.0, 1.0, 4.0])
    m.known = pyo.Param(m.t, initialize={0: 1.0, 1: 3.0, 4: 5.0})
    m.loose = pyo.Param(m.t, initialize={0: 5.0, 1: 4.0, 4: 8.0}, mutable=True)
    motion = motion_of(m.t, m)
    assert motion.intervals == ((0.0, 1.0), (1.0, 4.0))
    pose = lambda b, t: planar_pose(b.x[t] + t + b.known[t], b.y[t] + b.loose[t])  # noqa: E731
    return motion, pose, 1, 0.25, [2 + 1.75 + 3.5, 3.75 + 5.0]


def indices_beside_time_and_references() -> Followed:
    m = on_points([(0, 0, 0), (1, 0, 0)])
    m.q = pyo.Var(["arm", "leg"], m.t, initialize=lambda m, part, t: t * (3 if part == "arm" else 5))
    m.leg = pyo.Reference(m.q["leg", :])
    m.length = pyo.Param(["arm"], initialize=0.5, mutable=True)

    def pose(b: Any, t: Any) -> Any:
        return planar_pose(b.q["arm", t] * b.length["arm"], b.leg[t] + b.component("x")[t] + b.x[0])

    return motion_of(m.t, m), pose, 0, 0.5, [0.75, 3.0]


def labels_that_print_alike() -> Followed:
    m = on_points([(0, 0, 0), (1, 0, 0)])
    m.q = pyo.Var([0, "0"], m.t, initialize=lambda m, part, t: 2.0 if part == 0 else 7.0)
    return motion_of(m.t, m), lambda b, t: planar_pose(b.q[0, t], b.q["0", t]), 0, 0.4, [2.0, 7.0]


def labels_that_are_equal_to_a_time() -> Followed:
    m = on_points([(0, 0, 0), (1, 0, 0)], times=[0.0, 2.0])
    m.q = pyo.Var([1, 2], m.t, initialize=lambda m, joint, t: joint * t)
    return motion_of(m.t, m), lambda b, t: planar_pose(b.q[1, t], b.q[2, t]), 0, 0.5, [1.0, 2.0]


def phases_over_an_index_set() -> Followed:
    """Which have the same times."""
    m = pyo.ConcreteModel()

    def declare(b: Any, leg: str) -> None:
        b.x = rcp.State(initial_guess=3.0 if leg == "left" else 8.0)

    m.legs = rcp.PhaseBlock(["left", "right"], duration=2.0, elements=2, rule=declare)

    def pose(m: Any, t: Any) -> Any:
        return planar_pose(m.legs["right"].x[t] + m.legs["left"].x[0], m.legs["left"].x[t])

    return motion_of(m.legs["right"].time, m), pose, 1, 0.2, [11.0, 3.0]


def expressions_by_rules() -> Followed:
    m = on_a_phase(path, elements=2, duration=2.0)
    b = m.move
    b.elbow = pyo.Expression(["x", "y"], b.time, rule=lambda b, axis, t: 2 * b.component(axis)[t] + b.time_at(t))
    b.tip = pyo.Expression(b.time, rule=lambda b, t: b.elbow["x", t] ** 2)
    pose = templated(lambda m, t: planar_pose(m.move.tip[t], m.move.elbow["y", t]))
    at = b.trajectory()(0.3)
    return motion_of(b.time, m), pose, 0, 0.3, [(2 * at["x"] + 0.3) ** 2, 2 * at["y"] + 0.3]


@pytest.mark.parametrize(
    "state",
    [
        plain_points, indices_beside_time_and_references, labels_that_print_alike, labels_that_are_equal_to_a_time,
        phases_over_an_index_set, expressions_by_rules,
    ],
)  # fmt: skip
def test_what_a_rule_reads_is_followed(state: Callable[[], Followed]) -> None:
    motion, pose, interval, fraction, place = state()
    assert motion.pose_at(pose, interval, fraction).numbers()[1] == pytest.approx(place)
    values = template_of(motion, pose, "arm", 2).values(np.array([interval]), np.array([fraction]))
    assert values[0, 4:] == pytest.approx(place)


def test_an_expression_that_was_given_another_value_is_refused() -> None:
    motion, pose, *_ = expressions_by_rules()
    motion.block.move.tip[0.0].set_value(7.0)
    with pytest.raises(ObstacleError, match="its rule said"):
        template_of(motion, pose, "arm", 2)


def test_the_parent_may_be_below_or_above() -> None:
    m = pyo.ConcreteModel()
    m.shift = pyo.Var(initialize=4.0)
    m.robot = pyo.Block(["left"])
    inner = on_points([(0, 0, 0), (1, 2, 0)])
    m.robot["left"].inner = inner
    motion = motion_of(inner.t, m.robot["left"])
    below = motion.pose_at(lambda b, t: planar_pose(b.inner.x[t], b.parent_block().shift), 0, 0.5).numbers()[1]
    assert below == pytest.approx([0.5, 4.0])
    motion = motion_of(inner.t, m)
    above = motion.pose_at(lambda b, t: planar_pose(b.robot["left"].inner.y[t], b.model().shift), 0, 0.5).numbers()[1]
    assert above == pytest.approx([1.0, 4.0])


def free_fall(**options: Any) -> pyo.ConcreteModel:
    """``x = t^2`` on a continuous set."""
    m = pyo.ConcreteModel()
    m.t = ContinuousSet(bounds=(0, 2))
    m.x, m.v = pyo.Var(m.t, initialize=1.0), pyo.Var(m.t, initialize=1.0)
    m.dx = DerivativeVar(m.x)
    m.slope = pyo.Constraint(m.t, rule=lambda m, t: m.dx[t] == m.v[t])
    pyo.TransformationFactory("pyrobocop.collocation").apply_to(m, **options)
    for t in m.t:
        m.x[t], m.v[t] = t**2, 2 * t
    for t in m.dx:
        m.dx[t] = 2 * t
    return m


@pytest.mark.parametrize(
    "options",
    [
        {"nfe": 3, "ncp": 2},
        {"nfe": 3, "ncp": 3, "scheme": "lobatto"},
    ],
    ids=str,
)
def test_continuous_sets_follow_their_polynomials(options: dict[str, Any]) -> None:
    m = free_fall(**options)
    motion = motion_of(m.t, m)
    assert len(motion.intervals) == 3

    def pose(b: Any, t: Any) -> Any:
        return planar_pose(b.x[t], t)

    template = template_of(motion, pose, "stone", 2)
    for interval in range(3):
        for fraction in (0.2, 0.7):
            _, (x, index) = motion.pose_at(pose, interval, fraction).numbers()
            assert x == pytest.approx(index**2, abs=1e-12)
            entries = template.values(np.array([interval]), np.array([fraction]))[0]
            assert entries[4:] == pytest.approx([x, index], abs=1e-12)
    with pytest.raises(ObstacleError, match=r"'v\[t\]'.*derivative"):
        motion.pose_at(lambda b, t: planar_pose(b.v[t], 0), 0, 0.3)


def along(b: Any, t: Any) -> Any:
    return planar_pose(b.x[t], 0)


def test_reports_say_which_motion_along_continuous_sets() -> None:
    report = check(free_fall(nfe=2), Polytope.box(0.4, 0.2), [FAR], 0.1, pose=along)
    assert not report.motion_is_assumed
    assert "polynomials of the states along 't'" in str(report).splitlines()[0]


def test_a_list_of_members_is_refused_when_the_block_is_added() -> None:
    m = free_fall(nfe=3)
    m.robot = pyo.Block()
    m.robot.x = pyo.Reference(m.x)
    options = {"body": Polytope.box(0.4, 0.2), "pose": along}
    for block in (m, m.robot):
        with pytest.raises(ObstacleError, match="'x.t.'.*Give 't' itself" if block is m else "Give 't' itself"):
            block.avoid = rcp.ObstacleAvoidanceBlock(list(m.t), obstacles={"far": FAR}, clearance=0.1, **options)
        assert block.component("avoid") is None
        with pytest.raises(ObstacleError, match="Give 't' itself"):
            block.inside = rcp.Containment(list(m.t), region=Polytope.box(9, 9), **options)


def test_bodies_survive_pickling() -> None:
    """A lost rule is missed when it is asked; a body never comes to rest by being stored."""
    kept = pickle.loads(pickle.dumps(Body(Polytope.box(1, 1), along)))
    assert kept.pose.rule is along
    lost = pickle.loads(pickle.dumps(Body(Polytope.box(1, 1), lambda b, t: along(b, t))))
    assert lost.moves
    with pytest.raises(ModelError, match="survive pickling"):
        lost.pose(pyo.ConcreteModel(), 0)
