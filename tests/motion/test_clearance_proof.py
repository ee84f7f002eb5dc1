"""Motions reported as safe are safe, clear motions are reported as such, and collisions between nodes are found."""

import math
import pickle
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.moving import by_states, check, distances_by_shapely, on_a_phase, on_points, placed, sampled
from harness.phases import with_phase
from harness.scenes import keep_clear, on_the_line
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.geometry import Polytope, Pose, distances_of_shapes, planar_pose, spatial_pose
from pyrobocop_pyomo.motion import Body

CAR = Polytope.box(1.0, 0.5)
DENSE = 400
seeds = st.integers(0, 10**6)


def check_against_samples(report: Any, distances: np.ndarray, clearance: float) -> None:
    """Distances found by sampling never contradict a report; ``distances`` is zero in overlap."""
    pair = report.body_pairs[0]
    closest = float(distances.min())
    assert max(pair.proven, 0.0) <= closest + 1e-9
    assert pair.proven <= pair.distance + 1e-12
    if closest < pair.clearance - pair.tolerance - 1e-9:
        assert report.safe is False
    if closest > clearance * 1.01:  # sampling this densely misses far less
        assert report.safe is not False
        assert not report.body_pairs[0].undecided
    assert (report.safe is not False) == (pair.verdict == "clear")
    if pair.violated:
        assert closest <= clearance * 1.01


@settings(max_examples=20)
@given(seed=seeds, clearance=st.floats(0.02, 0.4), offset=st.floats(0.0, 2.5), turn=st.floats(0, 3))
def test_random_planar_motions(seed: int, clearance: float, offset: float, turn: float) -> None:
    """Linear in position and angle between points at any times; distances by shapely at 400 instants per interval."""
    random = np.random.default_rng(seed)
    poses = np.cumsum(random.normal(size=(4, 3)) * [0.8, 0.8, turn], axis=0)
    times = random.uniform(-5, 5) + np.cumsum(random.uniform(0.1, 10.0, 4))
    corners = random.normal(size=(8, 2)) * 0.4
    obstacle = Polytope.hull(corners + poses.mean(axis=0)[:2] + offset * np.array([1.0, 0.5]))
    report = check(on_points(poses, times.tolist()), CAR, [obstacle], clearance)
    dense = placed(CAR.vertices, sampled(poses, DENSE))
    still = np.broadcast_to(obstacle.vertices, (len(dense), *obstacle.vertices.shape))
    check_against_samples(report, distances_by_shapely(dense, still), clearance)
    pair = report.body_pairs[0]
    assert times[pair.interval] - 1e-9 <= pair.time <= times[pair.interval + 1] + 1e-9


@settings(max_examples=12)
@given(
    seed=seeds, clearance=st.floats(0.02, 0.4), offset=st.floats(0.0, 2.0), scheme=st.sampled_from(["radau", "gauss"])
)
def test_random_polynomials_against_a_body_that_moves_by_formula(
    seed: int, clearance: float, offset: float, scheme: str
) -> None:
    random = np.random.default_rng(seed)
    factors = random.normal(size=(3, 3)) * [[0.7], [0.7], [1.5]]

    def path(t: float) -> Any:
        return factors @ [math.sin(3 * t), math.cos(2 * t), t]

    m = on_a_phase(path, scheme, 3, elements=3, duration=2.0)

    def truck(b: Any, t: Any) -> Any:
        return planar_pose(offset + pyo.cos(b.time_at(t)), 0.3 * t**2, 0.8 * pyo.sin(2 * t))

    box = Polytope.box(0.6, 0.4)
    report = check(m.move, CAR, [Body(box, truck)], clearance, points=m.move.time)
    times = np.linspace(0, 2, 3 * DENSE + 1)
    at = m.move.trajectory()(times)
    first = placed(CAR.vertices, np.stack([at["x"], at["y"], at["theta"]], axis=1))
    poses = np.stack([offset + np.cos(times), 0.3 * times**2, 0.8 * np.sin(2 * times)], axis=1)
    check_against_samples(report, distances_by_shapely(first, placed(box.vertices, poses)), clearance)


@settings(max_examples=12)
@given(seed=seeds, clearance=st.floats(0.05, 0.4), spatial=st.booleans(), boxes=st.booleans())
def test_random_motions_of_boxes_and_ellipsoids(seed: int, clearance: float, spatial: bool, boxes: bool) -> None:
    """Thin ones that turn fast: their extent along a normal changes as much as their place does."""
    random = np.random.default_rng(seed)
    count, size = (6, 3) if spatial else (3, 2)
    nodes = np.cumsum(random.normal(size=(3, count)), axis=0)
    m = pyo.ConcreteModel()
    m.t = pyo.RangeSet(0, 2)
    m.q = pyo.Var(m.t, pyo.RangeSet(0, count - 1), initialize=lambda m, t, k: float(nodes[t, k]))

    def placed_at(q: Any) -> Any:
        return spatial_pose(q[:3], euler=q[3:]) if spatial else planar_pose(*q)

    def pose(b: Any, t: Any) -> Any:
        return placed_at([b.q[t, k] for k in range(count)])

    def shaped(center: Any) -> Polytope:
        sizes = random.uniform(0.1, 1.5, size)
        return Polytope.box(*sizes, center=center) if boxes else Polytope.ellipsoid(sizes, center)

    shape = shaped(np.zeros(size))
    wall = shaped(nodes.mean(axis=0)[:size] + random.normal(size=size))
    report = check(m, shape, [wall], clearance, pose=pose)
    at = np.linspace(0, 2, 301)
    q = np.stack([np.interp(at, [0, 1, 2], column) for column in nodes.T], axis=1)
    found, _ = distances_of_shapes([(shape.placed(placed_at(row.tolist())), wall) for row in q])
    check_against_samples(report, np.maximum(found, 0.0), clearance)
    (pair,) = report.body_pairs
    proven = np.repeat(pair.interval_proven, 150)
    assert (np.concatenate([found[:150], found[151:]]) >= proven - 1e-9).all()


@settings(max_examples=20)
@given(at=st.floats(-4, 4).filter(lambda x: abs(x) > 0.01), thickness=st.floats(1e-4, 0.2), size=st.floats(0.01, 0.5))
def test_thin_walls_anywhere_are_found(at: float, thickness: float, size: float) -> None:
    m = on_points([(-5, 0, 0), (5, 0, 0)])
    report = check(m, Polytope.box(size, size), [Polytope.box(thickness, 3, center=(at, 0))], 0.005)
    assert report.body_pairs[0].violated == (0,)
    reached = report.body_pairs[0].time * 10 - 5
    assert abs(reached - at) <= (thickness + size) / 2 + 0.005


@pytest.mark.parametrize(("gap_left", "safe"), [(0.0991, True), (0.0989, False)])
def test_proven_means_up_to_the_tolerance(gap_left: float, safe: bool) -> None:
    """eq-proven with the default of one percent."""
    wall = Polytope.box(20, 1, center=(0, -0.75 - gap_left))
    report = check(on_points([(0, 0, 0), (4, 0, 0)]), CAR, [wall], 0.1)
    assert report.safe is safe
    assert report.body_pairs[0].tolerance == pytest.approx(0.001)


def test_passing_a_corner_at_the_clearance_takes_few_subintervals() -> None:
    """The chord of the swept body is exactly as far as asked, from a corner that no middle normal separates best."""
    angle = math.radians(35)
    normal = np.array([math.cos(angle), math.sin(angle)])
    along = np.array([-normal[1], normal[0]])
    poses = [(*(0.1 * normal + s * along), 0.0) for s in (-2.0, 0.0, 2.0)]
    report = check(on_points(poses), Polytope.point((0, 0)), [Polytope.box(1, 1, center=(-0.5, -0.5))], 0.1)
    assert report.safe
    assert report.body_pairs[0].subintervals <= 6


def test_bodies_that_move_together_keep_their_distance() -> None:
    """Neither of them rests, and the boxes they sweep meet: the second's motion is seen from the first."""
    m = on_points([(0, 0, 0), (6, 1, 0), (9, -2, 0)])
    trailer = Body(Polytope.box(1, 0.5, center=(0, 0.6)), by_states)
    report = check(m, CAR, [trailer], 0.1)
    assert report.safe
    assert report.body_pairs[0].subintervals == 2
    assert report.body_pairs[0].proven == pytest.approx(0.1)


def test_a_free_duration_counts_in_the_users_time() -> None:
    m = on_a_phase(
        lambda t: (10 * t - 5, 0, 0),
        elements=2,
        duration=rcp.Duration(bounds=(1, 9), initial_guess=4.0),
        start=rcp.Start(initial_guess=3.0),
    )
    pair = check(m.move, CAR, [Polytope.box(0.01, 3, center=(-2.5, 0))], 0.1, points=m.move.time).body_pairs[0]
    assert pair.time == pytest.approx(3.0 + 4.0 * 0.25, abs=1e-6)
    assert pair.interval == 0


def test_shapes_without_end() -> None:
    m = on_points([(0, 0, 0), (4, 0, 1.0), (50, 3, -2.0)])
    below = Polytope.from_halfspaces([[0, 1]], [-0.75], bounded=False)
    assert check(m, CAR, [below], 0.1).safe
    assert not check(m, CAR, [Polytope.from_halfspaces([[-1, 0]], [-49], bounded=False)], 0.1).safe


@pytest.mark.heavy
def test_nothing_is_gained_along_a_wall_without_end() -> None:
    """Far from the corner of its description, a normal that leans over the wall by rounding measures too much."""
    for seed in range(30):
        random = np.random.default_rng(seed)
        along, distance, angle = (
            10.0 ** random.uniform(5, 7),
            10.0 ** random.uniform(-3, 0),
            random.uniform(0, 2 * np.pi),
        )
        outwards = np.array([math.cos(angle), math.sin(angle)])
        tangent = np.array([-outwards[1], outwards[0]])
        body = Polytope.hull(random.normal(size=(5, 2)))
        lowest = float((body.vertices @ outwards).min())
        ends = [outwards * (distance * factor - lowest) + tangent * along * factor for factor in (1.0, 1.1)]
        wall = Polytope.from_halfspaces([outwards], [0.0], bounded=False)
        report = check(on_points([(*end, 0.0) for end in ends]), body, [wall], distance / 2)
        assert report.body_pairs[0].proven <= distance + 1e-15 * along, seed


def test_infinite_speed_is_no_proof_but_values_still_are() -> None:
    """The square root has no bounded slope at its start; the interval is halved until its values decide."""
    m = on_points([(0, 0, 0), (1, 0, 0)])
    clear = check(m, CAR, [Polytope.box(1, 1, center=(3, 0))], 0.1, pose=lambda b, t: planar_pose(pyo.sqrt(b.x[t]), 0))
    assert clear.safe
    assert clear.body_pairs[0].subintervals > 1
    through = check(
        m, CAR, [Polytope.box(0.01, 1, center=(1.2, 0))], 0.1, pose=lambda b, t: planar_pose(2 * pyo.sqrt(b.x[t]), 0)
    )
    assert not through.safe


SCHEMES: list[tuple[str, int | None]] = [
    ("implicit_midpoint", None), ("gauss", 2), ("lobatto", 4), ("trapezoid", None), ("radau", 2),
    ("explicit_euler", None),
]  # fmt: skip


@pytest.mark.parametrize(("scheme", "stages"), SCHEMES)
@pytest.mark.parametrize("jump", [1e-7, 4.0])
def test_a_jump_over_an_obstacle_is_no_safe_motion(scheme: str, stages: int | None, jump: float) -> None:
    """Values that are not solved: both elements stand still, the second one beyond the obstacle."""
    m = pyo.ConcreteModel()
    m.move = b = rcp.PhaseBlock(
        duration=2.0, elements=2, scheme=scheme, **({} if stages is None else {"stages": stages})
    )
    b.x, b.rate = rcp.State(), rcp.State()
    b.ode(lambda b, t: {b.x: b.rate[t], b.rate: 0.0})
    for t in b.time:
        b.x[t].set_value(-2.0 if t < 1 else -2.0 + jump)
        b.rate[t].set_value(0.0)
    keep_clear(b, CAR, [Polytope.box(1, 1)], on_the_line)
    report = b.avoid.verify(equations=False)
    assert report.safe is (None if jump < 1.0 else False)  # of the plan alone
    pair = report.body_pairs[0]
    assert pair.verdict in ({"clear"} if jump < 1.0 else {"undecided", "overlap"})
    assert set(pair.undecided) | set(pair.violated) == {
        interval for interval in range(2) if pair.interval_proven[interval] < 0.05 * 0.99
    }


def test_a_state_that_jumps_at_a_node_within_an_element_is_seen() -> None:
    """The polynomial of a Lobatto scheme follows right-hand sides; the values at its middle nodes may lie elsewhere."""
    _, b = with_phase("move", duration=1.0, elements=1, scheme="lobatto", stages=4)
    b.x, b.rate = rcp.State(initial_guess=-2.0), rcp.State(initial_guess=0.0)
    b.ode(lambda b, t: {b.x: b.rate[t], b.rate: 0.0})
    keep_clear(b, CAR, [Polytope.box(1, 1)], on_the_line)
    assert b.avoid.verify().safe
    inner = sorted(b.time)[1]
    b.x[inner].set_value(0.0)  # within the obstacle
    assert not b.avoid.verify().safe
    b.x[inner].set_value(-2.0)
    b.x[b.final_time].set_value(2.0)  # the end of the plan is no start of an element
    assert not b.avoid.verify().safe


@pytest.mark.parametrize(("elements", "rigid"), [(2, False), (10, True)])
def test_a_rod_that_shrinks_between_the_nodes_is_no_proof(elements: int, rigid: bool) -> None:
    """A quaternion of length one at the nodes, which a polynomial cuts short in between: so is the rod."""
    m, b = with_phase("move", duration=1.0, elements=elements, stages=3)
    b.w, b.z = rcp.State(), rcp.State()
    b.w_rate, b.z_rate = rcp.Control(), rcp.Control()
    b.ode(lambda b, t: {b.w: b.w_rate[t], b.z: b.z_rate[t]})
    for t in b.time:
        b.w[t].set_value(math.cos(math.pi * t / 2))
        b.z[t].set_value(math.sin(math.pi * t / 2))

    def pose(m: Any, t: Any) -> Pose:
        return spatial_pose((0, 0, 0), quaternion=(m.move.w[t], 0.0, 0.0, m.move.z[t]))

    rod = Polytope.capsule((0, 0, 0), (2, 0, 0), 0.05)
    report = check(m, rod, [Polytope.box(0.1, 0.1, 0.1, center=(0, 3, 0))], 0.1, points=b.time, pose=pose)
    assert (report.safe is not False) == rigid


def test_what_has_no_pose_does_not_hide_an_overlap() -> None:
    """Between the nodes a square root has no value for a while; what is found too close before that stays found."""
    _, b = with_phase("move", duration=1.0, elements=1, stages=2)
    b.x = rcp.State()
    b.rate = rcp.Control()
    b.ode(lambda b, t: {b.x: b.rate[t]})
    for t, number in zip(b.time, (1.0, 0.01, 0.25), strict=True):
        b.x[t].set_value(number)
    wall = Polytope.box(0.2, 1, center=(0.7, 0))
    keep_clear(b, CAR, [wall], lambda b, t: planar_pose(3 * pyo.sqrt(b.x[t]) - 3, 0.0), 0.2)
    pair = b.avoid.verify(equations=False).body_pairs[0]
    assert pair.violated == (0,)
    assert pair.distance == pytest.approx(0.1)
    assert not pair.safe


def test_undecided_is_not_safe() -> None:
    """The distance is so close to the clearance that few subintervals do not decide."""
    m = on_points([(0, 0, 0), (0, 0, 3.0)])
    corner = math.hypot(0.5, 0.25)
    wall = Polytope.box(1, 4, center=(0.5 + corner + 0.1, 0))
    report = check(m, CAR, [wall], 0.1, tolerance=1e-7, depth=3)
    assert not report.safe
    assert report.body_pairs[0].undecided
    assert report.body_pairs[0].verdict == "undecided"
    assert check(m, CAR, [wall], 0.1, tolerance=1e-7, max_subintervals=3).body_pairs[0].undecided
    proven = check(m, CAR, [wall], 0.1, tolerance=1e-7)
    assert proven.safe
    assert str(proven).startswith("safe along straight lines: 1 body pair keeps its clearance at all times")
    assert "array" not in repr(proven)
    assert "NOT SAFE: 0 of 1 body pairs too close, 1 undecided" in str(report)


def test_the_deepest_instant_of_a_violation_is_reported() -> None:
    """The midpoint is too close already; the search goes on for what a margin has to cover."""
    m = on_points([(-2, 0.9, 0), (2, 0.5, 0)])
    pair = check(m, CAR, [Polytope.box(4, 1, center=(0, 0))], 0.2).body_pairs[0]
    assert pair.distance == pytest.approx(0.5 - 0.75, abs=1e-6)
    assert pair.time == pytest.approx(1.0)
    assert pair.interval_distance.shape == pair.interval_proven.shape == (1,)


def test_reports_are_plain_and_picklable() -> None:
    m = on_points([(0, 0, 0), (4, 0, 0)])
    report = check(m, CAR, [Polytope.box(1, 1, center=(0, 3)), Polytope.box(0.1, 1, center=(2, 0))], 0.1)
    again = pickle.loads(pickle.dumps(report))
    assert str(again) == str(report)
    lines = report.table().splitlines()
    assert lines[0].split() == ["body", "pair", "asked", "closest", "found", "at", "t", "=", "proven", "verdict"]
    assert lines[1].startswith("body - obstacle 2")
    assert lines[1].endswith("overlap")
    assert lines[2].endswith("clear")
    assert "'body' and 'obstacle 2' overlap by " in str(report.worst)


def test_a_pose_of_numbers_is_a_body_that_rests() -> None:
    m = on_points([(0, 0, 0), (4, 0, 0)])
    report = check(m, CAR, [Body(Polytope.box(1, 1), lambda b, t: Pose.identity(2))], 0.1, pose=by_states)
    assert report.body_pairs[0].verdict == "overlap"
