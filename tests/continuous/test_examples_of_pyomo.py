"""The kinds of models that pyomo.dae documents go through unchanged, with the answers of dae.collocation."""

from __future__ import annotations

import pyomo.environ as pyo
import pytest
from catalogue import pyomo_examples
from harness.dae import driven_tank
from pyomo.dae.simulator import Simulator

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError

OURS, THEIRS = "pyrobocop.collocation", "dae.collocation"


def cost(m):
    return pyo.value(next(m.component_data_objects(pyo.Objective, active=True)))


def optimum(m):
    pyo.SolverFactory("pyrobocop.ipopt").solve(m, options={"tol": 1e-10})
    return cost(m)


@pytest.mark.casadi
@pytest.mark.parametrize(
    ("name", "elements"),
    [("parameter_estimation", 6), ("car", 8), ("distillation", 10), ("disease", 8)],
)
def test_optimum_is_that_of_dae_collocation(name, elements):
    found = []
    for transformation in (OURS, THEIRS):
        m = getattr(pyomo_examples, name)()
        pyo.TransformationFactory(transformation).apply_to(m, nfe=elements, ncp=3)
        found.append(optimum(m))
    assert found[0] == pytest.approx(found[1], rel=1e-6, abs=1e-8)


@pytest.mark.casadi
@pytest.mark.parametrize("points", [1, 2])
@pytest.mark.parametrize("name", ["optimal_control", "path_constraint"])
def test_fewer_points_of_a_control(name, points):
    found = []
    for transformation in (OURS, THEIRS):
        m = getattr(pyomo_examples, name)()
        discretiser = pyo.TransformationFactory(transformation)
        discretiser.apply_to(m, nfe=5, ncp=4)
        assert discretiser.reduce_collocation_points(m, var=m.u, ncp=points, contset=m.t) is m
        found.append(optimum(m))
    assert found[0] == pytest.approx(found[1], abs=1e-6)
    if points == 1:
        first = [m.u[t].value for t in m.t if 0 < t <= 0.2]
        assert first == pytest.approx([first[0]] * 4)


@pytest.mark.casadi
def test_two_scenarios_of_a_gas_pipe():
    """Differences in space, collocation in time; a steady start, and one decision until the scenarios part."""
    found = []
    for transformation in (OURS, THEIRS):
        m = pyomo_examples.gas_pipe()
        pyo.TransformationFactory("dae.finite_difference").apply_to(m, nfe=2, wrt=m.z, scheme="FORWARD")
        pyo.TransformationFactory(transformation).apply_to(m, nfe=4, ncp=2, wrt=m.t)
        found.append((optimum(m), [m.p[k, 4, z].value for k in m.scenario for z in m.z]))
    assert found[0][0] == pytest.approx(found[1][0], rel=1e-6)
    assert found[0][1] == pytest.approx(found[1][1], rel=1e-5)


def test_fewer_points_that_cannot_be():
    m = pyomo_examples.optimal_control()
    discretiser = pyo.TransformationFactory(OURS)
    with pytest.raises(ModelError, match="contset: 't' was not discretised by pyrobocop.collocation"):
        discretiser.reduce_collocation_points(m, var=m.u, ncp=1, contset=m.t)
    discretiser.apply_to(m, nfe=2, ncp=3)
    for variable, points, match in (
        (m.x1, 1, "'x1': has a derivative with respect to 't'"),
        (m.u, 4, "'u': ncp = 4, but 't' has 3 points in each element"),
        (m.cost, 1, "var: 'cost' is no variable that is indexed by 't'"),
    ):
        with pytest.raises(ModelError, match=match):
            discretiser.reduce_collocation_points(m, var=variable, ncp=points, contset=m.t)
    assert discretiser.reduce_collocation_points(m, var=m.u, ncp=3, contset=m.t) is m
    assert m.find_component("u_interpolation_constraints") is None
    m = driven_tank(initialize=0)
    discretiser.apply_to(m, nfe=2, scheme="lobatto")
    with pytest.raises(ModelError, match="neighbouring elements share a point"):
        discretiser.reduce_collocation_points(m, var=m.u, ncp=1, contset=m.t)


@pytest.mark.casadi
def test_jobs_in_an_order_that_is_still_to_be_chosen():
    found = []
    for transformation in (OURS, THEIRS):
        m = pyomo_examples.scheduling()
        pyo.TransformationFactory(transformation).apply_to(m, nfe=4, ncp=3)
        pyo.TransformationFactory("gdp.bigm").apply_to(m, bigM=50)
        for chosen, disjunct in zip((1, 0), m.order.disjuncts, strict=True):
            disjunct.binary_indicator_var.fix(chosen)
        found.append(optimum(m))
    assert found[0] == pytest.approx(found[1], rel=1e-6)


@pytest.mark.casadi
def test_start_from_the_simulator_of_pyomo():
    """The simulator reads the model before the transformation, and gives initial values after it."""
    m = pyomo_examples.pendulum()
    simulator = Simulator(m, package="scipy")
    simulator.simulate(numpoints=40, integrator="dopri5")
    pyo.TransformationFactory(OURS).apply_to(m, nfe=10, ncp=3)
    simulator.initialize_model()
    guess = m.angle[4].value
    rcp.solve(m, progress=False).raise_for_status()
    assert m.angle[4].value == pytest.approx(guess, abs=5e-3)
