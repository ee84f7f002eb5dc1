"""What cannot be discretised is refused by name, with a remedy, and the model is as it was."""

import logging
from itertools import pairwise

import pyomo.environ as pyo
import pytest
from catalogue.dae_models import estimation
from harness.checked import unchanged
from harness.dae import picture, tank
from pyomo.dae import ContinuousSet, DerivativeVar

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError, PyRobocopError, TrajectoryError

COLLOCATION = pyo.TransformationFactory("pyrobocop.collocation")


def equation(m, *indices, rule):
    """In place of the equation of the tank."""
    m.del_component(m.ode)
    m.ode = pyo.Constraint(*indices, rule=rule)


def rate_that_no_row_holds(m):
    equation(m, m.t, rule=lambda m, t: pyo.Constraint.Skip if t == 0 else m.dx[t] == m.u[t])
    m.dx[0].fix(0)


def bounds_that_differ(m):
    m.u[0].setub(1)
    m.u[2].setub(3)


def different_values(m):
    m.u[0].fix(1)
    m.u[2].fix(3)


def constraint_without_rule(m):
    m.del_component(m.drain)
    m.drain = pyo.Constraint(m.t, rule={t: m.z[t] == 0 for t in m.t})


def rule_that_fails_at_a_new_point(m):
    m.feed = pyo.Param(m.t, initialize={0: 1.0, 2: 3.0})
    m.inflow = pyo.Constraint(m.t, rule=lambda m, t: m.u[t] >= m.feed[t])


def sum_in_the_second_set(m):
    m.s = ContinuousSet(bounds=(0, 1))
    m.y = pyo.Var(m.s)
    m.total = pyo.Objective(expr=sum(m.y[s] for s in m.s))


def cost(of):
    return lambda m: m.add_component("cost", pyo.Objective(expr=of(m)))


def row(rule):
    return lambda m: m.add_component("ramp", pyo.Constraint(m.t, rule=rule))


final_penalty = cost(lambda m: (m.x[2] - 3) ** 2 + m.u[2] ** 2)
NO_POINT = r"'%s.*': holds '(u|dx)\[0\]', but radau\(3\) has no collocation point at t = 0: only states"
SUM = r"is a sum over the points that 't' had .* write an Integral"
# What is done to a tank, what is said, and what is asked for, or else four elements.
REFUSED = {
    "initial control": (lambda m: m.add_component("a", pyo.Constraint(expr=m.u[0] == 0)), NO_POINT % "a", {}),
    "initial rate": (cost(lambda m: m.dx[0] ** 2), NO_POINT % "cost", {}),
    "jump from the start": (row(lambda m, t: m.u[t] - m.u[0] <= 1), NO_POINT % r"ramp\[\d", {}),
    "final control": (
        final_penalty,
        r"'cost': holds 'u\[2\]', but gauss\(3\) has no .* radau has one",
        {"scheme": "gauss"},
    ),
    "fixed rate": (
        rate_that_no_row_holds,
        r"'dx\[0\]': is fixed, but no equation that holds at that point has",
        {},
    ),
    "equation over a list": (
        lambda m: equation(m, [t for t in m.t if t > 0], rule=lambda m, t: m.dx[t] == m.u[t]),
        r"has no equation, .* Index the constraint by 't' itself",
        {},
    ),
    "bounds": (bounds_that_differ, r"'u\[0\]' and 'u\[2\]': their upper bounds were set to 1 and 3;", {}),
    "bounds without a value": (lambda m: m.u[0].setub(1), r"'u\[0\]': has upper bounds of its own, but no value", {}),
    "values": (different_values, r"'u\[0\]' at 1, 'u\[2\]' at 3: fixed at different values", {}),
    "no rule": (constraint_without_rule, "'drain': is indexed by 't' but has no function as its rule", {}),
    "choices": (
        lambda m: m.add_component("choice", pyo.BooleanVar(m.t)),
        "'choice': a BooleanVar indexed by 't' cannot be discretised",
        {},
    ),
    "new point": (
        rule_that_fails_at_a_new_point,
        r"'inflow': its rule failed at the new point .*ValueError: .*feed",
        {},
    ),
    "set twice": (lambda m: m.add_component("two", pyo.Var(m.t, m.t)), "'two': is indexed by 't' twice", {}),
    "a second mesh": (
        lambda m: COLLOCATION.apply_to(m, nfe=2),
        r"'t': was discretised already \(LAGRANGE-RADAU\), and no rule is called a second time",
        {},
    ),
    "second set": (sum_in_the_second_set, "'total': is a sum over the points that 's' had", {}),
    "discretised": (
        lambda m: pyo.TransformationFactory("dae.collocation").apply_to(m, nfe=2),
        r"'t': was discretised already \(LAGRANGE-RADAU\)",
        {},
    ),
    "sum": (cost(lambda m: sum(m.x[t] ** 2 for t in m.t)), SUM, {}),
    "sum in an expression": (
        lambda m: m.add_component("mean", pyo.Expression(expr=sum(m.x[t] for t in m.t) / 2)),
        SUM,
        {},
    ),
    "trapezoids": (
        cost(lambda m: sum(0.5 * (b - a) * (m.x[a] ** 2 + m.x[b] ** 2) for a, b in pairwise(m.t))),
        SUM,
        {},
    ),
    "running sum": (row(lambda m, t: sum(m.x[s] for s in m.t if s <= t) <= 10), SUM, {}),
    "no set": (lambda m: None, "wrt: 'x' is no ContinuousSet", {"wrt": "x"}),
    "no scheme": (lambda m: None, "unknown scheme 'radua'", {"scheme": "radua"}),
    "elements": (lambda m: None, "nfe = 3, but the mesh has 2 elements", {"nfe": 3, "mesh": [0, 1, 2]}),
    "short mesh": (lambda m: None, "'t': the mesh ends at 1, but the set ends at 2", {"mesh": [0, 1]}),
}
# What is right at points of another scheme.
RIGHT_ELSEWHERE = ("final control", "bounds without a value")


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_discretised_is_named_and_the_model_is_as_it_was(case, caplog):
    caplog.set_level(logging.CRITICAL)
    spoil, message, options = REFUSED[case]
    m = tank()
    spoil(m)
    if "wrt" in options:
        options = {"wrt": m.component(options["wrt"])}
    with unchanged(picture, m), pytest.raises(ModelError, match=message):
        COLLOCATION.apply_to(m, **(options or {"nfe": 4}))
    if case in RIGHT_ELSEWHERE:
        COLLOCATION.apply_to(m, nfe=4, scheme="lobatto")


def test_abstract_model():
    m = pyo.AbstractModel()
    m.t = ContinuousSet(bounds=(0, 1))
    with pytest.raises(ModelError, match="is not constructed. Create its instance first"):
        COLLOCATION.apply_to(m)


@pytest.mark.parametrize("before", ["ours", "dae.finite_difference"])
def test_a_derivative_along_two_sets(before):
    m = pyo.ConcreteModel()
    m.t, m.z = ContinuousSet(bounds=(0, 1)), ContinuousSet(bounds=(0, 1))
    m.x = pyo.Var(m.t, m.z)
    m.dtz = DerivativeVar(m.x, wrt=(m.t, m.z))
    if before != "ours":
        pyo.TransformationFactory(before).apply_to(m, wrt=m.z, nfe=2)
    held = {c.name: len(c) for c in m.component_objects((pyo.Var, DerivativeVar))}
    with pytest.raises(ModelError, match="'dtz': is a derivative along t and z together"):
        COLLOCATION.apply_to(m, wrt=m.t, nfe=2)
    assert list(m.t) == [0, 1]
    assert {c.name: len(c) for c in m.component_objects((pyo.Var, DerivativeVar))} == held


def test_block_whose_set_lives_elsewhere():
    m = tank()
    m.b = pyo.Block()
    m.b.y = pyo.Var(m.t)
    match = "'b': the set 't' does not live in it but in 'tank'"
    with pytest.raises(ModelError, match="'b': holds no ContinuousSet"):
        COLLOCATION.apply_to(m.b)
    with pytest.raises(ModelError, match=match):
        COLLOCATION.apply_to(m.b, wrt=m.t)


def test_set_in_a_block_that_others_are_indexed_by():
    """They grow with it, wherever they are."""
    m = pyo.ConcreteModel(name="plant")
    m.unit = pyo.Block()
    m.unit.t = ContinuousSet(bounds=(0, 1))
    m.x = pyo.Var(m.unit.t)
    COLLOCATION.apply_to(m.unit, nfe=2)
    assert len(m.x) == len(m.unit.t) == 7


def test_wrong_options():
    with pytest.raises(ValueError, match="nfe"):
        COLLOCATION.apply_to(tank(), nfe=0)
    with pytest.raises(ValueError, match="neither the name of a scheme"):
        COLLOCATION.apply_to(tank(), scheme=3)
    with pytest.raises(ModelError, match=r"'t': the boundaries 0.3 and 0.30000000000000004 are closer"):
        COLLOCATION.apply_to(tank((0, 0.3, 2)), mesh=[0, 0.1 * 3, 2])


def test_what_was_refused_for_one_set_is_discretised_without_it():
    m = tank()
    sum_in_the_second_set(m)
    m.del_component(m.total)
    COLLOCATION.apply_to(m)
    assert len(m.s) == len(m.t) == 31


def test_trajectory_of_what_is_not_there():
    m = tank()
    with pytest.raises(TrajectoryError, match="'t' was not discretised by pyrobocop.collocation"):
        rcp.dae_trajectory(m, m.t)
    COLLOCATION.apply_to(m, nfe=2)
    with pytest.raises(TrajectoryError, match=r"'z\[.*\]' has no value"):
        rcp.dae_trajectory(m, m.t)
    assert issubclass(TrajectoryError, PyRobocopError)


@pytest.mark.parametrize(
    "add",
    [
        final_penalty,
        cost(lambda m: m.x[2] - m.x[0]),
        lambda m: m.add_component("period", pyo.Constraint(expr=m.x[0] == m.x[2])),
        lambda m: m.add_component("start", pyo.ConstraintList(rule=lambda m: iter([m.x[0] >= 0, m.x[2] >= 0]))),
    ],
)
def test_boundary_values_are_no_sums(add):
    m = tank()
    add(m)
    COLLOCATION.apply_to(m, nfe=4)


def test_measurements_by_rule_are_taken_and_without_rule_refused():
    m = estimation()
    COLLOCATION.apply_to(m, nfe=7)
    m = estimation()
    m.del_component(m.misfit)
    m.misfit = pyo.Objective(expr=sum((m.x[t] - m.data[t]) ** 2 for t in m.measured))
    with pytest.raises(ModelError, match=r"'misfit': is a sum over the points .* give it a function, rule="):
        COLLOCATION.apply_to(m, nfe=7)
    m.del_component(m.misfit)
    m.misfit = pyo.Objective(expr=sum((m.x[t] - m.data[t]) ** 2 for t in (0.9, 1.7)))
    COLLOCATION.apply_to(m, nfe=7)
