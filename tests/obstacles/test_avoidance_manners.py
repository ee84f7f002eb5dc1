"""Avoidance blocks behave as Pyomo's own blocks do: cloned, pickled, indexed, deactivated, on any set of points."""

import pickle

import pyomo.dae as dae
import pyomo.environ as pyo
import pytest
from harness.scenes import ARROW, WALL, avoiding, exact, placed, turning_move
from pyomo.core.expr.visitor import identify_variables

import pyrobocop_pyomo as rcp


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
