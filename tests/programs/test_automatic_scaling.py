"""Ipopt sees programs without pairs in variables, rows and an objective of size one, and nobody else does."""

import math

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.checked import solution
from harness.phases import integrator, one_phase
from harness.routes import every_backend
from harness.scenes import avoiding, turning_move
from harness.small_problems import corner

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.ipopt.suffixes import scaling_factors
from pyrobocop_pyomo.programs.automatic_scaling import AutomaticScaling, automatic_scaling, variable_sizes
from pyrobocop_pyomo.programs.compiled_model import CompiledModel, ComponentGroups
from pyrobocop_pyomo.programs.nonlinear_program import PrimalDualPoint
from pyrobocop_pyomo.programs.wrapped_programs import ScaledProgram

SUFFIXES = ("dual", "ipopt_zL_out", "ipopt_zU_out")


def scaled_at(compiled: CompiledModel) -> AutomaticScaling:
    return automatic_scaling(compiled, scaling_factors(compiled, missing=math.nan))


def braking(metre: float = 1.0, second: float = 1.0) -> pyo.ConcreteModel:
    """A car with drag from 30 m/s to rest after 200 m: least effort, speed and force bounded, free duration."""
    m = pyo.ConcreteModel(name="braking")
    duration = rcp.Duration(bounds=(5 * second, 14 * second), initial_guess=12 * second)
    m.car = b = rcp.PhaseBlock(duration=duration, elements=8, stages=2)
    speed, rate = metre / second, metre / second**2
    b.x = rcp.State(initial=0, final=200 * metre, initial_guess=lambda s: 200 * s * metre)
    b.v = rcp.State(initial=30 * speed, final=0, bounds=(0, 40 * speed), initial_guess=lambda s: 30 * (1 - s) * speed)
    b.a = rcp.Control(bounds=(-1.92 * rate, 2 * rate))

    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.a[t] - 1e-3 * b.v[t] ** 2 / metre})

    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.a[t] ** 2) + 0.1 * rate**2 * b.duration)
    for name in SUFFIXES:
        m.add_component(name, pyo.Suffix(direction=pyo.Suffix.IMPORT))
    return m


@pytest.mark.ipopt
@pytest.mark.parametrize("metre", [1.0, 3.28084, 1e3, 1e-3])
@pytest.mark.parametrize("second", [1.0, 1 / 3600, 1e3])
def test_units_change_neither_the_answer_nor_the_way_there(metre: float, second: float) -> None:
    reference, other = braking(), braking(metre, second)
    expected, found = rcp.solve(reference), rcp.solve(other)
    found.raise_for_status()
    assert abs(found.iterations - expected.iterations) <= 0.3 * expected.iterations
    unit = metre**2 / second**3
    assert found.objective == pytest.approx(unit * expected.objective, rel=1e-6)
    # A row of x in metres: its multiplier is of the objective's unit per metre.
    for point, row in reference.car.x_collocation.items():
        assert other.dual[other.car.x_collocation[point]] == pytest.approx(
            unit / metre * reference.dual[row], rel=1e-4, abs=1e-6 * unit / metre
        )


@every_backend
def test_what_comes_back_is_in_the_units_of_the_model(backend: str) -> None:
    with_scaling, without = braking(), braking()
    first = rcp.solve(with_scaling, backend=backend, options={"tol": 1e-10})
    second = rcp.solve(without, backend=backend, options={"tol": 1e-10, "nlp_scaling_method": "gradient-based"})
    first.raise_for_status()
    assert second.scaling is None
    assert first.scaling is not None
    assert str(first.scaling) in first.report()
    assert first.scaling.variables["car.v"] == pytest.approx((30 * 40) ** 0.5)
    assert first.objective == pytest.approx(second.objective, rel=1e-7)
    assert pyo.value(with_scaling.effort) == pytest.approx(first.objective, rel=1e-14)
    for name in SUFFIXES:
        expected = {key.name: value for key, value in without.component(name).items()}
        found = {key.name: value for key, value in with_scaling.component(name).items()}
        largest = max(map(abs, expected.values()))
        assert largest > 1e-3, f"{name}: nothing is compared"
        for key in expected.keys() | found.keys():
            assert found.get(key, 0.0) == pytest.approx(expected.get(key, 0.0), rel=1e-4, abs=1e-5 * largest), key
    assert not [part for part in with_scaling.component_objects(pyo.Suffix) if part.local_name == "scaling_factor"]


@pytest.mark.casadi
def test_the_scaled_program_has_the_same_derivatives_and_points() -> None:
    compiled = CompiledModel(braking(), "vectorised")
    nlp, scales = compiled.nlp, scaled_at(compiled).scales
    scaled, x = ScaledProgram(nlp, scales), compiled.current_point()
    rng = np.random.default_rng(1)
    x = np.clip(x + 0.01 * scales.x * rng.standard_normal(nlp.n), nlp.x_lower, nlp.x_upper)
    point = PrimalDualPoint(x, rng.standard_normal(nlp.m), rng.random(nlp.n), rng.random(nlp.n))
    there = scales.scaled(point)
    back = scales.unscaled(there, nlp)
    for name in ("x", "g_multipliers", "lower_multipliers", "upper_multipliers"):
        assert getattr(back, name) == pytest.approx(getattr(point, name), rel=1e-14)
    step, h = rng.standard_normal(nlp.n), 1e-6
    rows, columns = scaled.jacobian_structure
    slope = np.zeros(nlp.m)
    np.add.at(slope, rows, scaled.jacobian(there.x) * step[columns])
    above, below = scaled.constraints(there.x + h * step), scaled.constraints(there.x - h * step)
    assert slope == pytest.approx((above - below) / (2 * h), rel=1e-5, abs=1e-7)
    rise = scaled.objective(there.x + h * step) - scaled.objective(there.x - h * step)
    assert scaled.gradient(there.x) @ step == pytest.approx(rise / (2 * h), rel=1e-5, abs=1e-8)
    assert there.g_multipliers is not None
    whole = scaled.hessian(there.x, 1.0, there.g_multipliers)
    plain = nlp.hessian(x, 1.0, np.asarray(point.g_multipliers)) / scales.objective
    i, j = scaled.hessian_structure
    assert whole == pytest.approx(plain * scales.x[i] * scales.x[j], rel=1e-12)


@pytest.mark.ipopt
def test_a_suffix_of_the_user_wins() -> None:
    m = braking()
    m.scaling_factor = pyo.Suffix(direction=pyo.Suffix.EXPORT)
    m.scaling_factor[m.car.v] = 0.01
    m.scaling_factor[m.effort] = 0.5
    result = solution(m)
    assert result.scaling is not None
    assert result.scaling.variables["car.v"] == pytest.approx(100.0)
    assert result.scaling.rows["car.v_collocation"] == pytest.approx(100.0)
    assert result.scaling.objective == pytest.approx(2.0)


@pytest.mark.ipopt
def test_ipopts_own_option_is_taken_as_it_is() -> None:
    m = braking()
    m.scaling_factor = pyo.Suffix(direction=pyo.Suffix.EXPORT)
    m.scaling_factor[m.car.v] = 0.1
    result = solution(m, options={"nlp_scaling_method": "user-scaling"})
    assert result.scaling is None


@pytest.mark.ipopt
def test_pairs_stay_in_the_units_of_the_model() -> None:
    assert rcp.solve(corner((1000, 0), (1000, 1))).scaling is None


def test_values_over_time_are_one_group() -> None:
    m = pyo.ConcreteModel()
    m.t = pyo.Set(initialize=[0, 0.5, 1.0])
    m.x, m.p = pyo.Var([1, 2], m.t), pyo.Var(["mass", "length"])
    m.s = pyo.Var()
    groups = ComponentGroups([*m.x.values(), *m.p.values(), m.s])
    assert groups.names == ["x[1]", "x[2]", "p[mass]", "p[length]", "s"]
    assert groups.numbers.tolist() == [0, 0, 0, 1, 1, 1, 2, 3, 4]
    assert groups.groups_of(m.x) == [0, 1]
    assert groups.groups_of(m.t) == []


@pytest.mark.ipopt
def test_models_with_obstacles_stay_in_their_units() -> None:
    m = turning_move()
    avoiding(m)
    result = solution(m)
    assert result.scaling is None


@pytest.mark.ipopt
def test_an_objective_that_is_constant_but_for_rounding_is_not_divided_by_it() -> None:
    m = pyo.ConcreteModel()
    m.angle = pyo.Var(initialize=1.0)
    m.bound = pyo.Constraint(expr=pyo.sin(m.angle) == 0.5)
    m.cost = pyo.Objective(expr=2.5 * pyo.cos(m.angle) ** 2 + 2.5 * pyo.sin(m.angle) ** 2)
    result = solution(m)
    assert result.strategy == "solve"
    assert result.scaling is not None
    assert result.scaling.objective > 1e-9


@pytest.mark.casadi
@pytest.mark.parametrize(("first", "expected"), [(math.sin(2 * math.pi), 1.0), (1e-3, 1e-3)])
def test_what_rounding_leaves_of_zero_is_no_size(first: float, expected: float) -> None:
    m, b = one_phase("go", model="wave", duration=1.0, elements=4, x=rcp.State(index=2, initial=[1.0, first]))
    b.u = rcp.Control(bounds=(-1, 1))
    b.ode(lambda b, t: {b.x: [b.x[1, t], b.u[t] - b.x[0, t]]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] @ b.x[t]))
    result = solution(m, backend="casadi", mesh_tolerance=None)
    assert result.strategy == "solve"
    assert result.scaling is not None
    assert 0.1 * expected <= result.scaling.variables["go.x_1"] <= 10 * expected


@pytest.mark.casadi
@pytest.mark.parametrize(("elements", "expected"), [(200, 1.0), (500, 0.5), (2000, 0.125)])
def test_the_objective_keeps_its_size_beside_the_barrier_on_a_fine_mesh(elements: int, expected: float) -> None:
    """The barrier is a sum over all bounds: the objective is divided by less in proportion to their number."""

    def size(elements: int) -> float:
        m, b = integrator(x={"initial": 1.0}, u={"bounds": (-2, 2)}, elements=elements, stages=2)
        m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.u[t] ** 2))
        return scaled_at(CompiledModel(m, "vectorised")).scales.objective

    assert size(elements) == pytest.approx(expected * size(100), rel=0.02)


@pytest.mark.casadi
def test_sizes_at_a_point_do_not_need_the_rows_that_were_taken_back_since() -> None:
    m = pyo.ConcreteModel()
    m.x = pyo.Var(bounds=(0, None), initialize=2.0)
    m.relaxed = pyo.Constraint(expr=3.0 * m.x >= 1.0)
    m.cost = pyo.Objective(expr=m.x**2)
    compiled = CompiledModel(m, "casadi")
    before = variable_sizes(compiled)
    m.del_component(m.relaxed)
    assert variable_sizes(compiled) == pytest.approx(before)


def exchanger(left: float) -> pyo.ConcreteModel:
    """A steady tube that holds a solvent and a trace of something; its rates are zero, or what rounding has left."""
    m = pyo.ConcreteModel(name="exchanger")
    m.length = pyo.Var(initialize=4.85, bounds=(1, 10))
    m.enthalpy = pyo.Var(initialize=3e7)
    m.heat = pyo.Constraint(expr=m.enthalpy == 6.2e6 * m.length)
    for name, size in (("solvent", 55.4), ("trace", 1e-11)):
        b = pyo.Block()
        m.add_component(name, b)
        b.flow, b.holdup = pyo.Var([0, 1], initialize=size), pyo.Var([0, 1], initialize=10 * size)
        b.slope, b.rate = pyo.Var(initialize=left * size), pyo.Var(initialize=-0.3 * left * size)
        b.flow[0].fix()
        b.holdup[0].fix()
        b.in_space = pyo.Constraint(expr=b.slope == 2 * (b.flow[1] - b.flow[0]))
        b.in_time = pyo.Constraint(expr=b.rate == 0.02 * (b.holdup[1] - b.holdup[0]))
        b.balance = pyo.Constraint(expr=b.slope + b.rate * m.length == 0)
        b.held = pyo.Constraint(expr=b.holdup[1] == 10 * b.flow[1])
    return m


@pytest.mark.casadi
@pytest.mark.parametrize("left", [1e-19, -3e-16, 1e-17])
def test_what_rounding_leaves_of_zero_is_the_size_of_nothing(left: float) -> None:
    """A product's derivative by one factor is the other: where that is rounding, it tells no sizes."""
    exact, rounded = (scaled_at(CompiledModel(exchanger(rest), "vectorised")).record for rest in (0.0, left))
    assert rounded.variables == pytest.approx(exact.variables, abs=0)
    assert rounded.variables["solvent.slope"] == pytest.approx(2 * 55.4)
    assert rounded.variables["trace.slope"] == pytest.approx(2e-11, rel=1e-6, abs=0)
    assert rounded.rows == pytest.approx(exact.rows, abs=0)
