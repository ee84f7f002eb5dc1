"""The report is about a motion, and says which one: polynomials, or lines between points."""

from typing import Any

import pyomo.environ as pyo
import pytest
from harness.moving import check
from pyomo.dae import ContinuousSet, DerivativeVar

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope, planar_pose

CAR = Polytope.box(0.4, 0.2)


# ---------------------------------------------------------------------------------------------- what a report says


def discretised(**options: Any) -> pyo.ConcreteModel:
    m = pyo.ConcreteModel()
    m.t = ContinuousSet(bounds=(0, 1))
    m.x = pyo.Var(m.t, initialize=0.0)
    m.dxdt = DerivativeVar(m.x, wrt=m.t)
    m.speed = pyo.Constraint(m.t, rule=lambda m, t: m.dxdt[t] == 1)
    pyo.TransformationFactory("pyrobocop.collocation").apply_to(m, **options)
    return m


def along(b: Any, t: Any) -> Any:
    return planar_pose(b.x[t], 0)


FAR = [Polytope.box(1, 1, center=(90, 90))]


def test_reports_say_which_motion_along_continuous_sets() -> None:
    report = check(discretised(nfe=2), CAR, FAR, 0.1, pose=along)
    assert not report.motion_is_assumed
    assert "polynomials of the states along 't'" in str(report).splitlines()[0]


# ------------------------------------------------------------------------------------------- numbers in place of sets


def test_a_list_of_members_is_refused_when_the_block_is_added() -> None:
    m = discretised(nfe=3)
    m.robot = pyo.Block()
    m.robot.x = pyo.Reference(m.x)
    for block, pose in ((m, along), (m.robot, along)):
        with pytest.raises(ObstacleError, match="'x.t.'.*Give 't' itself" if block is m else "Give 't' itself"):
            block.avoid = rcp.ObstacleAvoidanceBlock(
                list(m.t), body=CAR, pose=pose, obstacles={"far": FAR[0]}, clearance=0.1
            )
        assert block.component("avoid") is None
        with pytest.raises(ObstacleError, match="Give 't' itself"):
            block.inside = rcp.Containment(list(m.t), body=CAR, pose=pose, region=Polytope.box(9, 9))
