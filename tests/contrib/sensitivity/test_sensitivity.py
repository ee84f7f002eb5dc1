"""`sensitivity` against re-solves, for every place where data can enter a model."""

import numpy as np
import pyomo.environ as pyo
import pytest
from pyomo.mpec import Complementarity as MpecComplementarity
from pyomo.mpec import complements as mpec_complements

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.contrib.sensitivity import Sensitivity
from pyrobocop_pyomo.errors import EvaluationError, ModelError
from pyrobocop_pyomo.solving.result_text import ActiveSide

pytestmark = pytest.mark.asl

TIGHT = {"tol": 1e-11}


def everywhere(sense=pyo.minimize, least_z: float = 0.7) -> pyo.ConcreteModel:
    """Data in the objective, in rows and their bounds, in bounds of variables, in both sides of a pair, indexed."""
    m = pyo.ConcreteModel(name="everywhere")
    m.p = pyo.Param(initialize=1.3, mutable=True)
    m.q = pyo.Param([1, 2], initialize={1: 0.4, 2: 2.0}, mutable=True)
    m.least = pyo.Param(initialize=least_z, mutable=True)
    m.x = pyo.Var(bounds=(0, None), initialize=1)
    m.y = pyo.Var(bounds=(0, None), initialize=1)
    m.z = pyo.Var(domain=pyo.NonNegativeReals, bounds=(m.least, 5), initialize=1)
    m.w = pyo.Var(initialize=0)
    m.energy = pyo.Expression(expr=m.w**2 * m.q[2] + m.p**2)
    m.pair = rcp.Complementarity(expr=rcp.complements(m.x - m.q[1] >= 0, m.y - m.p * m.w >= 0))
    m.balance = pyo.Constraint(expr=m.w + m.x * m.z == m.q[2] * m.p)
    m.limit = pyo.Constraint(expr=pyo.inequality(-10, m.y + m.w, 10))
    sign = 1 if sense == pyo.minimize else -1
    m.cost = pyo.Objective(expr=sign * ((m.x - 2 * m.p) ** 2 + (m.y - 1) ** 2 + m.z**2 + m.energy), sense=sense)
    return m


def compared_with_resolves(m: pyo.ConcreteModel, parameters, step: float = 1e-4) -> Sensitivity:
    """Every derivative against a central difference of solves from the solution."""
    result = rcp.solve(m, mesh_tolerance=None, options=TIGHT)
    result.raise_for_status()
    found = rcp.studies.sensitivity(m, result, parameters)
    start = [v.value for v in found.variables]
    for k, parameter in enumerate(found.parameters):
        middle = pyo.value(parameter)
        ends = []
        for change in (step, -step):
            for variable, number in zip(found.variables, start, strict=True):
                variable.set_value(number)
            parameter.set_value(middle + change)
            again = rcp.solve(m, mesh_tolerance=None, options=TIGHT, strategies=("tight", "barrier"))
            again.raise_for_status()
            ends.append(np.array([again.objective, *(v.value for v in found.variables)]))
        parameter.set_value(middle)
        difference = (ends[0] - ends[1]) / (2 * step)
        expected = np.concatenate([[found.objective_gradient[k]], found.matrix[:, k]])
        assert difference == pytest.approx(expected, rel=2e-4, abs=2e-5), parameter.name
    for variable, number in zip(found.variables, start, strict=True):
        variable.set_value(number)
    return found


@pytest.mark.parametrize("sense", [pyo.minimize, pyo.maximize], ids=["minimise", "maximise"])
def test_every_place_of_a_parameter(sense):
    m = everywhere(sense)
    found = compared_with_resolves(m, [m.p, m.q, m.least])
    assert [parameter.name for parameter in found.parameters] == ["p", "q[1]", "q[2]", "least"]
    assert found.derivative(m.x, m.p) != 0
    assert found.derivative(m.x, m.q[1]) == 0  # the first side is positive
    sign = 1 if sense == pyo.minimize else -1
    assert sign * found.objective_derivative(m.p) > 0


def test_a_parameter_in_an_active_bound_of_a_variable_and_in_the_other_branch():
    m = everywhere(least_z=2.5)
    m.y.set_value(3)
    m.cost.expr += 4 * (m.y - 4) ** 2 + 50 * m.x  # now the first side is zero
    found = compared_with_resolves(m, [m.p, m.q, m.least])
    assert found.derivative(m.z, m.least) == pytest.approx(1.0)
    assert found.derivative(m.x, m.q[1]) == pytest.approx(1.0)
    assert any("lower bound of 'z'" in name for name in found.constraints)
    assert any("the first side of 'pair'" in name for name in found.constraints)


def test_a_row_with_data_on_both_of_its_ends():
    m = pyo.ConcreteModel()
    m.low, m.high = pyo.Param(initialize=-1.0, mutable=True), pyo.Param(initialize=2.0, mutable=True)
    m.x, m.y = pyo.Var(initialize=0), pyo.Var(initialize=0)
    m.row = pyo.Constraint(expr=(m.low, m.x + 2 * m.y, m.high))
    m.cost = pyo.Objective(expr=(m.x - 3) ** 2 + (m.y - 3) ** 2)
    found = compared_with_resolves(m, [m.low, m.high])
    assert found.derivative(m.x, m.low) == 0
    assert found.derivative(m.x, m.high) == pytest.approx(1 / 5)
    assert found.constraints == ["the upper bound of 'row'"]


def test_a_pair_of_pyomo_mpec_and_a_fixed_variable_as_data():
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(0, None), initialize=1), pyo.Var(bounds=(0, None), initialize=1)
    m.data = pyo.Var(initialize=2.0)
    m.data.fix()
    m.pair = MpecComplementarity(expr=mpec_complements(m.x + m.y >= m.data, m.y >= 0))
    m.cost = pyo.Objective(expr=m.x**2 + 2 * (m.y - 1) ** 2)
    found = compared_with_resolves(m, m.data)
    assert found.derivative(m.x, m.data) + found.derivative(m.y, m.data) == pytest.approx(1.0)
    assert m.data.fixed


@pytest.mark.parametrize(("goal", "expected"), [(-3.0, (1.0, 0.0)), (0.25, (0.0, 0.0)), (4.0, (0.0, 1.0))])
def test_a_range_against_a_free_side(goal, expected):
    """x at its lower bound where y > 0, at its upper one where y < 0, and y = 0 in between."""
    m = pyo.ConcreteModel()
    m.low, m.high = pyo.Param(initialize=-1.0, mutable=True), pyo.Param(initialize=2.0, mutable=True)
    m.goal = pyo.Param(initialize=goal, mutable=True)
    m.x, m.y = pyo.Var(initialize=min(max(goal, -1.0), 2.0)), pyo.Var(initialize=-goal)
    m.pair = rcp.Complementarity(expr=rcp.complements(pyo.inequality(m.low, m.x, m.high), m.y))
    m.cost = pyo.Objective(expr=(m.x - m.goal) ** 2 + (m.y + m.goal) ** 2)
    found = compared_with_resolves(m, [m.low, m.high, m.goal])
    assert (found.derivative(m.x, m.low), found.derivative(m.x, m.high)) == pytest.approx(expected)
    assert found.derivative(m.y, m.goal) == pytest.approx(0.0 if goal == 0.25 else -1.0)


def test_a_trajectory_with_contact():
    m = pyo.ConcreteModel(name="mass")
    m.target = pyo.Param(initialize=0.1, mutable=True)
    m.stiffness = pyo.Param(initialize=1.0, mutable=True)
    m.move = b = rcp.PhaseBlock(duration=1.5, elements=15, scheme="implicit_euler")
    b.gap, b.speed = rcp.State(initial=1.0, bounds=(0, None), initial_guess=0.5), rcp.State(initial=-1.0)
    b.contact, b.push = rcp.Algebraic(bounds=(0, None)), rcp.Control(bounds=(-2, 2))
    b.ode(lambda b, t: {b.gap: b.speed[t], b.speed: b.push[t] + m.stiffness * b.contact[t]})

    @b.complementarity
    def wall(b, t):
        return rcp.complements(b.gap[t] >= 0, b.contact[t] >= 0)

    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.push[t] ** 2 + 4 * (b.gap[t] - m.target) ** 2))
    result = rcp.solve(m, options=TIGHT)
    result.raise_for_status()
    found = rcp.studies.sensitivity(m, result, ["target", "stiffness"])
    # Other branches are nearly as good here, and a new solve may end on one: the differences stay on this branch.
    m.held = pyo.ConstraintList()
    for pair, report in zip(rcp.active_pairs(m), result.pairs, strict=True):
        m.held.add((pair.a if report.active is ActiveSide.FIRST else pair.b) == 0)
    b.wall.deactivate()
    smooth = compared_with_resolves(m, ["target", "stiffness"])
    places = {variable.name: row for variable, row in zip(smooth.variables, smooth.matrix, strict=True)}
    for variable, row in zip(found.variables, found.matrix, strict=True):
        assert row == pytest.approx(places[variable.name], rel=1e-5, abs=1e-6), variable.name
    assert found.objective_gradient == pytest.approx(smooth.objective_gradient, abs=1e-7)


def test_prediction_is_first_order_and_takes_names_or_pairs():
    m = everywhere()
    found = rcp.studies.sensitivity(m, rcp.solve(m, options=TIGHT), [m.p])
    gaps = []
    for step in (2e-2, 1e-2):
        predicted = found.predict({"p": 1.3 + step})
        assert predicted[m.x] == found.predict([(m.p, 1.3 + step)])[m.x]
        m.p.set_value(1.3 + step)
        rcp.solve(m, options=TIGHT)
        gaps.append(abs(predicted[m.x] - m.x.value))
        m.p.set_value(1.3)
    assert gaps[0] / gaps[1] == pytest.approx(4.0, rel=0.2)


@pytest.fixture(scope="module")
def answered():
    """A model and its answer, of which no study changes anything."""
    m = everywhere()
    m.unused, m.number = pyo.Param(initialize=1.0, mutable=True), pyo.Param(initialize=1.0)
    return m, rcp.solve(m, options=TIGHT)


def test_nothing_of_the_model_changes(answered):
    m, result = answered
    before = (m.cost.expr.to_string(), m.balance.expr.to_string(), len(list(m.component_objects())))
    values = [v.value for v in m.component_data_objects(pyo.Var)]
    rcp.studies.sensitivity(m, result, [m.p, m.least])
    assert (m.cost.expr.to_string(), m.balance.expr.to_string(), len(list(m.component_objects()))) == before
    assert [v.value for v in m.component_data_objects(pyo.Var)] == values
    assert m.pair.active
    assert m.z.lower is not None


def test_a_biactive_pair_is_refused_by_name():
    m = pyo.ConcreteModel()
    m.p = pyo.Param(initialize=1.0, mutable=True)
    m.x, m.y = pyo.Var(bounds=(0, None), initialize=1), pyo.Var(bounds=(0, None), initialize=1)
    m.pair = rcp.Complementarity(expr=rcp.complements(m.x, m.y))
    m.cost = pyo.Objective(expr=(m.x + m.p) ** 2 + (m.y + m.p) ** 2)
    result = rcp.solve(m)
    assert [pair.name for pair in result.biactive] == ["pair"]
    with pytest.raises(EvaluationError, match=r"1 pairs are biactive .*'pair'"):
        rcp.studies.sensitivity(m, result, m.p)


def test_a_bound_that_nothing_pushes_against_is_refused_by_name():
    m = pyo.ConcreteModel()
    m.p = pyo.Param(initialize=1.0, mutable=True)
    m.x = pyo.Var(bounds=(1, None), initialize=2)
    m.cost = pyo.Objective(expr=(m.x - m.p) ** 2)
    with pytest.raises(EvaluationError, match="a bound of 'x'"):
        rcp.studies.sensitivity(m, rcp.solve(m), m.p)


@pytest.mark.parametrize(
    ("parameter", "message"),
    [
        ("unused", r"'unused' is used in no active constraint"),
        ("number", r"'number': is not mutable"),
        ("x", r"'x': is free, so it is part of the solution"),
        ("cost", r"mutable Params and Vars hold data"),
        ("missing", r"has no component 'missing'"),
    ],
)
def test_what_is_no_data_is_refused(answered, parameter, message):
    m, result = answered
    with pytest.raises(ModelError, match=message):
        rcp.studies.sensitivity(m, result, [parameter])


def test_a_model_that_has_moved_on_is_refused(answered, monkeypatch):
    m, result = answered
    monkeypatch.setattr(m.p, "value", 2.0)
    with pytest.raises(ModelError, match=r"values or data were changed since"):
        rcp.studies.sensitivity(m, result, m.p)


def test_a_relaxed_model_is_refused():
    m = everywhere()
    pyo.TransformationFactory("pyrobocop.relax_complementarity").apply_to(m, lift=True)
    result = rcp.solve(m)
    with pytest.raises(ModelError, match=r"a relaxation is applied"):
        rcp.studies.sensitivity(m, result, m.p)


def test_text_names_each_parameter_and_what_was_not_asked_for_is_refused(answered):
    m, result = answered
    found = rcp.studies.sensitivity(m, result, [m.p, m.least])
    assert all(parameter.name in str(found) for parameter in (m.p, m.least))
    with pytest.raises(ModelError, match=r"'q\[1\]': is not among"):
        found.derivative(m.x, m.q[1])
