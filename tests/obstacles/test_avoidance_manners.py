"""Avoidance blocks behave as Pyomo's own blocks do: cloned, pickled, indexed, deactivated, on any set of points."""

import pickle

import pyomo.dae as dae
import pyomo.environ as pyo
import pytest
from harness.scenes import ARROW, WALL, avoiding, exact, placed, turning_move
from pyomo.core.expr.visitor import identify_variables

import pyrobocop_pyomo as rcp


def effort_of(m):
    pyo.SolverFactory("ipopt").solve(m)
    return pyo.value(m.effort)


@pytest.mark.executable
@pytest.mark.parametrize("how", ["clone", "pickle"])
def test_copies_live_on_their_own(how):
    m = turning_move()
    avoiding(m)
    copy = m.clone() if how == "clone" else pickle.loads(pickle.dumps(m))
    copy.move.avoid.initialize()
    assert all(variable.value is None for variable in m.move.avoid.component_data_objects(pyo.Var))
    effort = effort_of(copy)
    m.move.avoid.initialize()
    assert effort == pytest.approx(effort_of(m), rel=1e-7)
    assert_own_variables(copy)


def assert_own_variables(m):
    for row in m.component_data_objects(pyo.Constraint):
        assert all(variable.model() is m for variable in identify_variables(row.body)), row.name


def test_a_copy_is_refined_without_its_original():
    m = turning_move(height=3)
    avoid = avoiding(m)
    copy = m.clone().move.avoid
    index = next(iter(copy.separations))
    copy.initialize()
    copy.split(*index)
    assert len(copy.separations) == len(avoid.separations) + 1
    assert_own_variables(copy.model())
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


@pytest.mark.executable
def test_deactivated_blocks_ask_nothing():
    straight = turning_move()
    m = turning_move()
    avoiding(m).initialize()
    m.move.avoid.deactivate()
    assert effort_of(m) == pytest.approx(effort_of(straight), rel=1e-9)
    m.move.avoid.activate()
    assert effort_of(m) > effort_of(straight) + 1


@pytest.mark.executable
def test_deactivated_rows_stay_so_on_a_clone():
    m = turning_move()
    avoid = avoiding(m)
    avoid.initialize()
    avoid.first_shape.deactivate()
    copy = m.clone()
    assert not any(row.active for row in copy.move.avoid.first_shape.values())
    assert effort_of(copy) == pytest.approx(effort_of(turning_move()), rel=1e-6)


def robots(m, i):
    return rcp.Body(ARROW, pose=lambda block, t: rcp.planar_pose(block.x[i, t], block.y[i, t]))


def test_indexed_blocks():
    m = pyo.ConcreteModel()
    m.x = pyo.Var([1, 2], range(3), initialize=0)
    m.y = pyo.Var([1, 2], range(3), initialize=3)

    def build(block, i):
        block.build([0, 1, 2], bodies={"arrow": robots(m, i)}, obstacles=[WALL, WALL.padded(0.1)], clearance=0.1 * i)

    m.avoid = rcp.ObstacleAvoidanceBlock([1, 2], rule=build)
    for i in (1, 2):
        m.avoid[i].initialize()
        assert pyo.value(m.avoid[i].clearance["arrow", "obstacle 2"]) == 0.1 * i
        assert len(m.avoid[i].separations) == 4
    assert m.clone().avoid[2].separation_gaps() == m.avoid[2].separation_gaps()


def test_in_a_rule_of_an_abstract_model():
    m = pyo.AbstractModel()
    m.t = pyo.Set(initialize=[0, 1, 2], ordered=True)
    m.x = pyo.Var(m.t, initialize=0)
    m.avoid = rcp.ObstacleAvoidanceBlock(
        m.t, body=ARROW, pose=lambda b, t: rcp.planar_pose(b.x[t], 0), obstacles=[WALL], clearance=0.1
    )
    instance = m.create_instance()
    instance.avoid.initialize()
    assert len(instance.avoid.separations) == 2
    assert instance.avoid.record.points is instance.t


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


def test_any_set_point_by_point():
    m = pyo.ConcreteModel()
    m.where = pyo.Set(initialize=["here", "there"])
    m.x = pyo.Var(m.where, initialize=0)
    options = {"body": ARROW, "obstacles": [WALL], "clearance": 0.1}
    pose = lambda b, p: rcp.planar_pose(b.x[p], 0)  # noqa: E731
    m.avoid = rcp.ObstacleAvoidanceBlock(m.where, pose=pose, between=None, **options)
    m.avoid.initialize()
    assert {index[2] for index in m.avoid.separations} == {"here", "there"}


def test_unions_are_watched_part_by_part():
    m = turning_move(height=3)
    hall = [rcp.Polytope.box(0.2, 1, center=(1.5, 0)), rcp.Polytope.box(0.2, 1, center=(2.5, 0))]
    avoid = avoiding(m, obstacles={"hall": hall})
    avoid.initialize()
    assert {index[1] for index in avoid.separations} == {"hall[1]", "hall[2]"}
    assert list(avoid.clearance) == [("arrow", "hall")]
    times = avoid.record.segments[next(iter(avoid.separations))].times
    assert min(avoid.separation_gaps().values()) <= min(min(exact(m.move, ARROW, part, times)) for part in hall)
