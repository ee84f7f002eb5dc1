"""Rows and integrals that follow a rule are compiled from it: the program is that of what Pyomo shows."""

import pickle

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import one_phase
from harness.program_values import InModelOrder, assert_same
from pyomo.core.expr.visitor import identify_variables
from pyomo.repn.standard_repn import generate_standard_repn

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.modeling.rows_by_rule import RowByRule, sum_by_rule
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.phases.equations import IntegralRule
from pyrobocop_pyomo.phases.row_rules import CollocationRows
from pyrobocop_pyomo.programs.compiled_model import CompiledModel

HORIZONS = {
    "fixed": {"duration": 2.0},
    "uneven": {"duration": 2.0, "mesh": [0.0, 0.1, 0.5, 0.6, 2.0], "elements": None},
    "free start": {"duration": 2.0, "start": rcp.Start(bounds=(0.0, 1.0))},
    "free": {"duration": rcp.Duration(bounds=(0.5, 3.0), initial_guess=1.5)},
    "free elements": {"duration": 2.0, "free_element_widths": (0.5, 2.0)},
    "all free": {"duration": rcp.Duration(bounds=(0.5, 3.0)), "free_element_widths": (0.5, 2.0)},
}


def pendulum(scheme="radau", **horizon):
    """A pendulum whose friction is a parameter of the phase, its torque a vector of one."""
    m, p = one_phase(**{"elements": 4, "scheme": scheme, **horizon})
    m.gain = pyo.Param(initialize=0.7, mutable=True)
    p.angle = rcp.State(initial=0.1, final=3.0, bounds=(-4, 4))
    p.rate = rcp.State(initial=0.0)
    p.torque = rcp.Control(index=1, bounds=(-5, 5))
    p.friction = rcp.Parameter(bounds=(0, 1), initial_guess=0.2)

    @p.ode
    def motion(b, t):
        return {
            b.angle: b.rate[t],
            b.rate: m.gain * b.torque[t][0] - b.friction * b.rate[t] - pyo.sin(b.angle[t]) * b.rate[t] ** 2,
        }

    p.energy = rcp.Algebraic(bounds=(None, 9))
    p.residual(lambda b, t: b.energy[t] == b.rate[t] ** 2 / 2 - pyo.cos(b.angle[t]), name="energy_of")

    @p.constraint
    def limits(b, t):
        return [b.torque[t][0] * b.rate[t] <= 20 * m.gain, (-9.0, b.angle[t] - b.energy[t], m.gain * 13)]

    p.constraint_at_boundaries(lambda b, t: b.rate[t] ** 2 <= 30 - b.friction, name="slow")
    m.cost = pyo.Objective(
        expr=p.integral(lambda b, t: b.torque[t][0] ** 2 + b.angle[t]) + p.rate.at(p.final_time) ** 2
    )
    way = p.integral(lambda b, t: m.gain * abs(b.rate[t]) * b.angle[t])
    m.way = pyo.Constraint(expr=(None, way / 3 + p.friction * p.integral(lambda b, t: b.torque[t][0]), 40))
    return m


def rows_of(m):
    return list(m.component_data_objects(pyo.Constraint, active=True))


def integrals_of(m):
    return list(m.p.stated_integrals.values())


def by_rule(m):
    return [row for row in rows_of(m) if row.__class__ is RowByRule]


def numbers(m):
    """Names of variables and rows, and all numbers of the program at a point."""
    program, rng = InModelOrder(CompiledModel(m)), np.random.default_rng(0)
    x = rng.uniform(0.3, 1.3, program.nlp.n)
    return program.names, program.everything(x, 0.7, rng.normal(size=program.nlp.m))


def assert_same_numbers(found, expected):
    assert found[0] == expected[0]
    assert_same(found[1], expected[1], within=1e-12)
    for name in ("jacobian", "hessian"):
        assert found[1][name].nnz == expected[1][name].nnz


@pytest.mark.parametrize("horizon", HORIZONS)
@pytest.mark.parametrize("scheme", ["radau", "gauss", "implicit_euler", "lobatto"])
def test_a_program_of_rules_is_the_program_of_the_rows(horizon, scheme):
    scheme = rcp.schemes.lobatto(3) if scheme == "lobatto" else scheme
    m = pendulum(scheme, **HORIZONS[horizon])
    m.p.angle[m.p.points.at(2)].fix(0.4)  # a fixed variable is a number of the program
    assert by_rule(m)
    by_rules = numbers(m)
    for part in [*rows_of(m), *integrals_of(m)]:
        part.set_value(part.expr)
    assert not by_rule(m)
    assert not any(map(sum_by_rule, integrals_of(m)))
    assert_same_numbers(by_rules, numbers(m))


def test_copies_and_pickles_have_rows_of_their_own():
    m = pendulum()
    twin, loaded = m.clone(), pickle.loads(pickle.dumps(m))
    assert len(by_rule(twin)) == len(by_rule(loaded)) == len(by_rule(m)) > 0
    for other in (twin, loaded):
        row = by_rule(other)[-1]
        for part in (row, integrals_of(other)[0]):
            assert all(variable.model() is other for variable in identify_variables(part.expr))
        assert_same_numbers(numbers(other), numbers(m))


def test_a_row_that_is_changed_is_what_it_was_changed_to():
    m = pendulum()
    row = by_rule(m)[5]
    row.set_value(m.p.rate[m.p.points.at(3)] == 0.25)
    assert row.__class__ is not RowByRule
    (names, after), (_, before) = numbers(m), numbers(pendulum())
    at = names[1].index(row.name)
    assert after["to lower"][at] != before["to lower"][at]


def test_a_program_is_up_to_date_after_rows_and_integrals_are_read_or_changed():
    m = pendulum()
    program = CompiledModel(m)
    nlp = program.nlp
    assert all(row.expr is row.expr for row in by_rule(m))
    assert pyo.value(m.cost) == pytest.approx(nlp.objective(program.current_point()), rel=1e-12)
    program.update()
    assert program.nlp is nlp  # what was only read is what it was
    next(iter(m.p.stated_integrals.values())).set_value(m.p.friction**2)
    program.update()
    assert program.nlp.objective(program.current_point()) == pytest.approx(pyo.value(m.cost), rel=1e-12)


def test_a_row_that_is_not_there_is_not_made():
    m = pendulum(rcp.schemes.lobatto(3))
    assert 0.0 in m.p.points
    with pytest.raises(KeyError):
        m.p.angle_collocation[0.0]
    index = next(iter(m.p.slow))
    del m.p.slow[index]
    with pytest.raises(KeyError):
        m.p.slow[index]


@pytest.mark.parametrize("read", ["nl", "standard_repn", "text", "copy", "variables"])
def test_pyomo_s_readers_see_ordinary_rows_and_integrals(read, tmp_path):
    m = pendulum()
    if read == "nl":
        m.write(str(tmp_path / "model.nl"))
        assert all(row._expr is not None for row in by_rule(m))
    elif read == "standard_repn":
        nonlinear = generate_standard_repn(m.cost.expr, quadratic=False).nonlinear_vars
        assert {v.name for v in nonlinear} == {v.name for v in identify_variables(m.cost.expr) if "angle" not in v.name}
    elif read == "text":
        assert m.cost.expr.to_string().count("p.torque_0") == len(m.p.points)
    elif read == "copy":
        assert pyo.value(m.cost.expr.clone()) == pytest.approx(pyo.value(m.cost))
    else:
        assert len(list(identify_variables(m.cost.expr))) == len({id(v) for v in variables_in(m.cost.expr)})


@pytest.mark.ipopt
@pytest.mark.parametrize("horizon", HORIZONS)
def test_a_solve_makes_no_row(horizon):
    m = pendulum(**HORIZONS[horizon])
    result = rcp.solve(m)
    assert result.solved
    assert str(result)
    assert m.p.verify(m.p.trajectory()).largest_violation < 1e-6
    made = {row.parent_component().local_name for row in rows_of(m) if row._expr is not None}
    assert made <= {"boundary_width", "energy_of", "way"}
    assert horizon not in ("fixed", "uneven") or not sum_by_rule(integrals_of(m)[0]).is_made


@pytest.mark.ipopt
def test_a_solve_does_not_believe_wrong_integrals(monkeypatch):
    sums = IntegralRule.sums

    def wrong(self, block, indices):
        found = sums(self, block, indices)
        return [each._replace(variables=[[*of[1:], of[0]] for of in each.variables]) for each in found]

    monkeypatch.setattr(IntegralRule, "sums", wrong)
    m = pendulum()
    assert rcp.solve(m, mesh_tolerance=None).objective == pytest.approx(pyo.value(m.cost), rel=1e-9)


@pytest.mark.ipopt
def test_a_solve_does_not_believe_wrong_sums(monkeypatch):
    sums = CollocationRows.sums

    def wrong(self, block, indices):
        *of_states, of_rates = sums(self, block, indices)
        return [*of_states, of_rates._replace(scales=[1.01 * scale for scale in of_rates.scales])]

    monkeypatch.setattr(CollocationRows, "sums", wrong)
    result = rcp.solve(pendulum(), mesh_tolerance=None, strategies="tight")
    assert not result.solved
    assert result.violations


@pytest.mark.ipopt
@pytest.mark.parametrize("horizon", HORIZONS)
def test_a_rule_may_read_nothing(horizon):
    m = pendulum(**HORIZONS[horizon])
    m.p.clock = rcp.State(initial=0.0)
    m.p.ode(lambda b, t: {b.clock: 1.0}, name="time_passes")
    assert rcp.solve(m, mesh_tolerance=None).solved
    assert m.p.clock[m.p.final_time].value == pytest.approx(pyo.value(m.p.duration), rel=1e-9)
