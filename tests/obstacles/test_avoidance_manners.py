"""Avoidance blocks behave as Pyomo's own blocks do: cloned, pickled, indexed, deactivated, on any set of points."""

import math
import pickle
from collections.abc import Iterator

import pyomo.dae as dae
import pyomo.environ as pyo
import pytest
from harness.scenes import ARROW, WALL, avoiding, exact, placed, turning_move
from pyomo.core.expr.visitor import identify_variables

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import check_pose
from pyrobocop_pyomo.planning.recovery import PlanningPoint, PlanStart, Recovery


def assert_own_variables(m):
    for row in m.component_data_objects(pyo.Constraint):
        assert all(variable.model() is m for variable in identify_variables(row.body)), row.name


@pytest.mark.parametrize("how", ["clone", "pickle"])
def test_a_copy_is_refined_without_its_original(how):
    m = turning_move(height=3)
    avoid = avoiding(m)
    copied = m.clone() if how == "clone" else pickle.loads(pickle.dumps(m))
    copy = copied.move.avoid
    copy.initialize()
    assert all(variable.value is None for variable in avoid.component_data_objects(pyo.Var))
    copy.split(*next(iter(copy.separations)))
    assert len(copy.separations) == len(avoid.separations) + 1
    assert_own_variables(copied)
    assert_own_variables(m)


def test_a_pickle_has_what_a_pose_rule_has_said():
    m = turning_move(height=3)
    body = rcp.Body(ARROW, pose=placed)
    alone = pickle.dumps(body)
    avoiding(m, bodies={"arrow": body})
    assert pickle.dumps(body) == alone  # nothing of the model
    m = turning_move(height=3)
    avoiding(m, bodies={"arrow": rcp.Body(ARROW, pose=lambda b, t: placed(b, t))})
    again = pickle.loads(pickle.dumps(m))
    again.move.avoid.initialize()
    assert min(again.move.avoid.separation_gaps().values()) > 0
    assert str(again.move.avoid.verify()) == str(m.move.avoid.verify())


def test_on_a_discretised_continuous_set():
    m = pyo.ConcreteModel()
    m.t = dae.ContinuousSet(bounds=(0, 1))
    m.x = pyo.Var(m.t, initialize=0)
    m.rate = dae.DerivativeVar(m.x, wrt=m.t)
    m.u = pyo.Var(m.t)
    m.ode = pyo.Constraint(m.t, rule=lambda m, t: m.rate[t] == m.u[t])
    pyo.TransformationFactory("pyrobocop.collocation").apply_to(m, wrt=m.t, nfe=4)
    m.avoid = rcp.ObstacleAvoidanceBlock(
        m.t, body=ARROW, pose=lambda b, t: rcp.planar_pose(b.x[t], 0), obstacles=[WALL], clearance=0.1
    )
    m.avoid.initialize()
    assert len(m.avoid.separations) == 4
    assert m.avoid.verify().safe is None  # its rows say nothing between the points


def test_unions_are_watched_part_by_part():
    m = turning_move(height=3)
    hall = [rcp.Polytope.box(0.2, 1, center=(1.5, 0)), rcp.Polytope.box(0.2, 1, center=(2.5, 0))]
    avoid = avoiding(m, obstacles={"hall": hall})
    avoid.initialize()
    assert {index[1] for index in avoid.separations} == {"hall[1]", "hall[2]"}
    assert list(avoid.clearance) == [("arrow", "hall")]
    times = avoid.record.segments[next(iter(avoid.separations))].times
    assert min(avoid.separation_gaps().values()) <= min(min(exact(m.move, ARROW, part, times)) for part in hall)


# --------------------------------------------------------------------
# The best round is always given back, whatever happens to the rounds after it.


def flight() -> pyo.ConcreteModel:
    """Half a turn in two elements: a quaternion that has length one at the nodes, and less between them."""
    m = pyo.ConcreteModel()
    m.fly = f = rcp.PhaseBlock(duration=1.0, elements=2, stages=1)
    for name in ("x", "qw", "qz"):
        setattr(f, name, rcp.State())
    for k, t in enumerate(f.time):
        f.x[t], f.qw[t], f.qz[t] = float(k), math.cos(k * math.pi / 4), math.sin(k * math.pi / 4)
    f.avoid = rcp.ObstacleAvoidanceBlock(
        f.time,
        body=rcp.Polytope.box(1, 0.6, 0.1),
        pose=lambda f, t: rcp.spatial_pose((f.x[t], 0, 0), quaternion=(f.qw[t], 0, 0, f.qz[t])),
        obstacles={"post": rcp.Polytope.box(0.3, 0.3, 4, center=(1, 5, 0))},
        clearance=0.05,
    )
    return m


def test_poses_between_nodes_are_not_judged_when_a_round_is_restored() -> None:
    m = flight()
    block = m.fly.avoid
    block.initialize()
    point = PlanningPoint(m)
    first, second, start = next(iter(block.separations))
    _, right = block.split(first, second, start)
    between = block.record.poses[first, right[2]]
    with pytest.raises(ObstacleError, match="differs from the identity"):
        check_pose(between, "body")
    m.fly.x[0.0] = 7.0
    point.restore()
    assert m.fly.x[0.0].value == 0.0
    assert all(variable.value is not None for variable in block.component_data_objects(pyo.Var))
    block.initialize()


@pytest.mark.ipopt
def test_a_start_that_cannot_be_made_does_not_lose_the_rounds_before(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    m = turning_move(elements=2)
    avoiding(m, obstacles={"wall": rcp.Polytope.box(0.2, 40, center=(2, 0))})

    def starts(self: Recovery) -> Iterator[PlanStart]:
        yield PlanStart("first")
        raise ObstacleError("no such start")

    monkeypatch.setattr(Recovery, "starts", starts)
    result = rcp.solve(m, options={"max_iter": 3})
    assert not result.safe
    assert result.rounds
    assert "no such start" in caplog.text
