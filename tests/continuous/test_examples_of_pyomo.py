"""The kinds of models that pyomo.dae documents go through unchanged, with the answers of dae.collocation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pyomo.environ as pyo
import pytest
from catalogue import pyomo_examples
from catalogue.cart_pole import cart_pole
from harness.dae import driven_tank
from pyomo.contrib import mpc
from pyomo.contrib.doe.examples import reactor_experiment
from pyomo.contrib.mpc.examples.cstr import model as mpc_cstr
from pyomo.contrib.mpc.examples.cstr import run_mpc
from pyomo.contrib.sensitivity_toolbox.examples import HIV_Transmission, feedbackController
from pyomo.dae.simulator import Simulator

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError

OURS, THEIRS = "pyrobocop.collocation", "dae.collocation"


def cost(m):
    return pyo.value(next(m.component_data_objects(pyo.Objective, active=True)))


def optimum(m):
    pyo.SolverFactory("pyrobocop.ipopt").solve(m, options={"tol": 1e-10})
    return cost(m)


@pytest.mark.parametrize(
    ("name", "elements"),
    [("parameter_estimation", 6), ("car", 8), ("distillation", 10), ("disease", 8), ("scheduling", 4)],
)
def test_optimum_is_that_of_dae_collocation(name, elements):
    found = []
    for transformation in (OURS, THEIRS):
        m = getattr(pyomo_examples, name)()
        pyo.TransformationFactory(transformation).apply_to(m, nfe=elements, ncp=3)
        if name == "scheduling":  # the order of its jobs is still to be chosen
            pyo.TransformationFactory("gdp.bigm").apply_to(m, bigM=50)
            for chosen, disjunct in zip((1, 0), m.order.disjuncts, strict=True):
                disjunct.binary_indicator_var.fix(chosen)
        found.append(optimum(m))
    assert found[0] == pytest.approx(found[1], rel=1e-6, abs=1e-8)


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


# --------------------------------------------------------------------
# Dynamic models that Pyomo ships go through with one word changed: the name of the transformation.


pytestmark = [pytest.mark.casadi, pytest.mark.filterwarnings("ignore")]


@pytest.fixture
def renamed(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Whoever asks for a transformation of pyomo.dae gets ours from now on."""
    known = pyo.TransformationFactory._cls

    def rename() -> None:
        for name in (THEIRS, "dae.finite_difference"):
            monkeypatch.setitem(known, name, known[OURS])

    return rename


def experiment_reactor() -> Any:
    data = {
        "CA0": 5.0, "CA_bounds": [1.0, 5.0], "CB0": 0.0, "CC0": 0.0, "t_range": [0, 1],
        "control_points": {"0": 500, "0.125": 300, "0.25": 300, "0.5": 300, "1": 300},
        "T_bounds": [300, 700], "A1": 84.79, "A2": 371.72, "E1": 7.78, "E2": 15.05,
    }  # fmt: skip
    data["control_points"] = {float(t): value for t, value in data["control_points"].items()}
    m = reactor_experiment.ReactorExperiment(data=data, nfe=8, ncp=3).get_labeled_model()
    m.CA[0].fix()
    return m


def control_of_hiv() -> Any:
    m = HIV_Transmission.create_model()
    HIV_Transmission.initialize_model(m, 5, 5, 1)
    return m


def feedback() -> Any:
    m = feedbackController.create_model()
    feedbackController.initialize_model(m, 50)
    return m


MODELS = {
    "reactor of contrib.doe": (experiment_reactor, lambda m: [m.CA[1].value, m.CB[1].value, m.CC[1].value]),
    "HIV of sensitivity_toolbox": (control_of_hiv, lambda m: [pyo.value(m.cf)]),
    "feedback of sensitivity_toolbox": (feedback, lambda m: [pyo.value(m.J)]),
    "tank of contrib.mpc": (mpc_cstr.create_instance, lambda m: [m.conc[t, "A"].value for t in (0, 5, 10)]),
}


def answers(name: str) -> list[float]:
    build, read = MODELS[name]
    m = build()
    rcp.solve(m, progress=False, options={"tol": 1e-10}).raise_for_status()
    return read(m)


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_answers_are_those_of_pyomo_dae(name: str, renamed: Any) -> None:
    expected = answers(name)
    renamed()
    assert answers(name) == pytest.approx(expected, rel=1e-6, abs=1e-8)


@pytest.mark.slow
def test_the_loop_of_contrib_mpc(renamed: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its interface reads, shifts and loads values, and ties the control to samples."""
    monkeypatch.setitem(pyo.SolverFactory._cls, "ipopt", pyo.SolverFactory._cls["pyrobocop.ipopt"])
    start = run_mpc.get_steady_state_data(mpc.ScalarData({"flow_in[*]": 0.3}))
    target = run_mpc.get_steady_state_data(mpc.ScalarData({"flow_in[*]": 1.2}))
    found = []
    for change in (lambda: None, renamed):
        change()
        m, simulated = run_mpc.run_cstr_mpc(start, target)
        found.append([simulated.get_data_from_key(m.conc[:, "A"]), simulated.get_data_from_key(m.flow_in[:])])
    for theirs, ours in zip(*found, strict=True):
        assert ours == pytest.approx(theirs, rel=1e-5)


@pytest.mark.slow
def test_a_cart_with_a_pole_stands_up_on_legendre_points() -> None:
    """The task of ModelingToolkit.jl's issue 5076; the reference has other points and three times the elements."""
    found = []
    for options in ({"nfe": 125, "ncp": 2, "scheme": "LAGRANGE-LEGENDRE"}, {"nfe": 400, "ncp": 3}):
        m = cart_pole()
        pyo.TransformationFactory(OURS).apply_to(m, wrt=m.t, **options)
        rcp.solve(m, progress=False).raise_for_status()
        found.append([pyo.value(m.cost), max(abs(force.value) for force in m.force.values())])
    assert found[0][0] == pytest.approx(found[1][0], rel=1e-4)
    assert found[0][1] == pytest.approx(found[1][1], rel=2e-2)
