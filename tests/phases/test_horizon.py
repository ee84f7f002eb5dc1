"""Start, duration and element boundaries as variables."""

import copy
import math
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.checked import unchanged
from harness.phases import contents, integrator, one_phase, rest_to_rest
from mistakes.entries import cart, driven, newton
from pyomo.core.expr.visitor import identify_variables

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.time_index import TimeIndex


def in_least_time(elements: int, low: float, high: float, **options: Any) -> pyo.ConcreteModel:
    """Full force, then full brake."""
    options = {"free_element_widths": (0.1, 3), "stages": 2, **options}
    duration = rcp.Duration(bounds=(0.1, 10), initial_guess=1.5)
    held = {"parametrization": "piecewise_constant"}
    return rest_to_rest(force=(low, high), u=held, duration=duration, elements=elements, **options)


@pytest.mark.ipopt
@pytest.mark.parametrize("elements", [2, 3, 5])
@pytest.mark.parametrize(("low", "high"), [(-1.0, 1.0), (-2.0, 1.0), (-0.5, 1.0)])
def test_the_switch_of_a_minimum_time_plan_falls_on_an_element_end(elements: int, low: float, high: float) -> None:
    m = in_least_time(elements, low, high)
    result = rcp.solve(m)
    least = math.sqrt(2 * (1 / high - 1 / low))
    switch = least * -low / (high - low)
    assert result.objective == pytest.approx(least, abs=1e-6)
    boundaries = np.array(m.p.trajectory().grid.mesh.boundaries)
    assert np.abs(boundaries - switch).min() < 1e-5
    verdict = m.p.trajectory().verify()
    assert verdict.largest_violation < 1e-6
    assert verdict.horizon_error < 1e-6


@pytest.mark.parametrize("scheme", ["radau", "gauss", "trapezoid", "hermite_simpson", "explicit_euler"])
def test_moved_elements_integrate_and_tell_the_time(scheme: str) -> None:
    """With boundaries put anywhere, integrals and the clock are those of the moved mesh."""
    _, b = one_phase(duration=3.0, start=1.0, elements=4, scheme=scheme, free_element_widths=(0.2, 3))
    cost = b.integral(lambda b, t: b.time_at(t))
    for each, fraction in zip(b.boundary.values(), [0, 0.1, 0.35, 0.8, 1.0], strict=True):
        each.set_value(fraction)
    assert pyo.value(cost) == pytest.approx((4.0**2 - 1.0) / 2, rel=1e-12 if scheme != "explicit_euler" else 0.2)
    clocks = [pyo.value(b.time_at(t)) for t in b.time]
    assert clocks == sorted(clocks)
    assert clocks[0] == 1.0
    assert clocks[-1] == pytest.approx(4.0)
    assert {round(t, 12) for t in (1.3, 2.05, 3.4)} <= {round(t, 12) for t in clocks}
    b.x = rcp.State(initial_guess=0)
    np.testing.assert_allclose(b.trajectory().time, clocks)


@pytest.mark.ipopt
def test_a_free_start_waits_for_the_best_moment() -> None:
    # The wind blows as (t - 4)^2: a ride of length 2 is cheapest around 4.
    start = rcp.Start(bounds=(0, 10), initial_guess=1)
    m, b = integrator(x={"initial": 0, "final": 1}, duration=2.0, start=start, elements=5)
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2 + (b.time_at(t) - 4) ** 2))
    assert rcp.solve(m).solved
    assert m.p.start.value == pytest.approx(3.0, abs=1e-6)
    trajectory = b.trajectory()
    assert (trajectory.time[0], trajectory.time[-1]) == pytest.approx((3.0, 5.0), abs=1e-6)
    assert trajectory.verify().largest_violation < 1e-7


@pytest.mark.ipopt
def test_a_phase_can_start_where_another_ends() -> None:
    m = pyo.ConcreteModel()
    m.first = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.5, 2), initial_guess=1), elements=3)
    m.second = rcp.PhaseBlock(duration=1.0, start=m.first.duration + 0.5, elements=3)
    for b in (m.first, m.second):
        b.x = rcp.State(initial=0)
        b.ode(lambda b, t: {b.x: b.time_at(t)})
    m.first.duration.fix(1.5)
    m.cost = pyo.Objective(expr=0.0 * m.first.x[1.0])
    assert rcp.solve(m).solved
    assert m.second.x[1.0].value == pytest.approx((3.0**2 - 2.0**2) / 2)
    copy = m.clone()
    copy.first.duration.fix(0.5)
    assert pyo.value(copy.second.time_at(0.0)) == 1.0
    assert pyo.value(m.second.time_at(0.0)) == 2.0


@pytest.mark.parametrize("duration", [0.0, -1.0, None])
def test_a_duration_without_a_positive_value_is_refused_by_name(duration: float | None) -> None:
    m = in_least_time(3, -2, 1)
    plan = m.p.trajectory()
    m.p.duration.set_value(duration, skip_validation=True)
    m.p.check()  # for a solver it is a guess
    for read in (m.p.trajectory, m.p.reintegrate, lambda: m.p.initialize(plan)):
        with pytest.raises(ModelError, match=r"phase 'p': its duration has the value .*must be positive.*p.duration"):
            read()
    m.p.duration.fix()
    with pytest.raises(ModelError, match="phase 'p': its duration has the value"):
        m.p.check()


def test_a_motion_that_lasts_longer_than_a_plan_may_is_verified_in_silence(caplog: pytest.LogCaptureFixture) -> None:
    m = in_least_time(3, -2, 1)
    m.p.duration.set_value(50.0, skip_validation=True)
    motion = m.p.trajectory()
    m.p.duration.set_value(5.0)
    verified = motion.verify()
    assert verified.bounds > 1.0
    assert not caplog.records
    assert m.p.duration.value == 5.0


def test_bounds_that_have_to_know_a_time_that_is_to_be_found_are_refused_as_a_rule_is() -> None:
    _, b = one_phase(duration=rcp.Duration(bounds=(1, 9)), elements=3)
    with pytest.raises(ModelError, match=r"'u_bounds'.*of t, is true"):
        b.u = rcp.Control(bounds=lambda t: (0, 1 if t < 0.5 else 2))
    assert b.component("u") is None


# --------------------------------------------------------------------
# What a newcomer writes first about the time: the message names the place and what to write instead; that works.


def test_a_boundary_is_found_by_its_number_whatever_its_rounding():
    _, b = one_phase(duration=2.4, elements=24, x=rcp.State(), v=rcp.State(index=2))
    for number in range(25):
        time = number / 10  # the boundary at 0.8 is 0.7999999999999999
        assert b.x[time].index() in b.time
        assert abs(b.v[1, time].index() - time) < 1e-12
    with pytest.raises(KeyError, match="no value of its own"):
        b.x[0.8 + 1e-9]


@pytest.mark.ipopt
def test_a_variable_of_the_user_is_the_duration():
    m = pyo.ConcreteModel()
    m.T = pyo.Var(bounds=(0.5, 5), initialize=2)
    b = cart(m, duration=m.T)
    b.ode(newton)
    m.soon = pyo.Objective(expr=m.T)
    of_declaration = pyo.ConcreteModel()
    c = cart(of_declaration, duration=rcp.Duration(bounds=(0.5, 5), initial_guess=2))
    c.ode(newton)
    of_declaration.soon = pyo.Objective(expr=c.duration)
    assert rcp.solve(m).solved
    assert rcp.solve(of_declaration).solved
    assert m.T.value == pytest.approx(c.duration.value, rel=1e-7)
    assert b.duration.value == pytest.approx(m.T.value, rel=1e-9)
    copy = m.clone()
    assert {id(data) for data in identify_variables(copy.p.duration_as_stated.body)} == {
        id(copy.T),
        id(copy.p.duration),
    }


@pytest.mark.ipopt
def test_a_param_of_the_user_is_the_duration_also_after_it_has_changed():
    m = pyo.ConcreteModel()
    m.T = pyo.Param(initialize=2.0, mutable=True)
    driven(m, duration=m.T)
    for duration in (2.0, 3.0):
        m.T.set_value(duration)
        assert rcp.solve(m).solved
        # x(t) is the cubic of least effort: 12 (distance)^2 / T^3.
        assert pyo.value(m.effort) == pytest.approx(12.0 / duration**3, rel=1e-6)


@pytest.mark.parametrize(
    "make", [lambda m: pyo.Var(bounds=(-1, 1)), lambda m: pyo.Param(initialize=-2.0, mutable=True), lambda m: pyo.Var()]
)
def test_a_duration_that_may_be_negative_is_refused_by_name(make):
    m = pyo.ConcreteModel()
    m.T = make(m)
    with pytest.raises(ModelError, match=r"the duration 'T' has the value .*must be one positive number"):
        cart(m, duration=m.T)


# --------------------------------------------------------------------
# Where the time of a phase is to be found, ``t`` is an index where it looks something up, and the time in formulas.


LONG = rcp.Duration(bounds=(3, 3), initial_guess=3)
HORIZONS: dict[str, dict[str, Any]] = {
    "free duration": {"duration": LONG},
    "free start": {"duration": 3.0, "start": rcp.Start(bounds=(0, 0))},
    "free elements": {"duration": 3.0, "free_element_widths": (0.5, 2)},
}


def ramp(scheme: str = "radau", **horizon: Any) -> tuple[pyo.ConcreteModel, Any]:
    m, b = one_phase("go", elements=4, scheme=scheme, **horizon)
    b.x, b.z, b.u = rcp.State(initial=0), rcp.Algebraic(), rcp.Control(bounds=(0, 1))
    return m, b


def as_ode(b: Any, of_time: Callable[[Any, Any], Any]) -> None:
    b.ode(lambda b, t: {b.x: of_time(b, t)}, name="said")


def as_integral(b: Any, of_time: Callable[[Any, Any], Any]) -> None:
    def said(b: Any, t: Any) -> Any:
        return of_time(b, t)

    b.integral(said)


STATEMENTS: dict[str, Callable[[Any, Callable[[Any, Any], Any]], Any]] = {
    "ode": as_ode,
    "step": lambda b, rule: b.step_map(lambda b, t, previous: {b.x: previous.x + rule(b, t)}, name="said"),
    "residual": lambda b, rule: b.residual(lambda b, t: b.z[t] - rule(b, t), name="said"),
    "constraint": lambda b, rule: b.constraint(lambda b, t: (0, b.x[t], rule(b, t)), name="said"),
    "boundaries": lambda b, rule: b.constraint_at_boundaries(lambda b, t: b.x[t] <= 1 + rule(b, t), name="said"),
    "pairs": lambda b, rule: b.complementarity(
        lambda b, t: rcp.complements(b.u[t] >= 0, rule(b, t) - b.z[t] >= 0), name="said"
    ),
    "integral": as_integral,
    "law": lambda b, rule: b.declare("said", rcp.mechanics.AbsoluteValue(lambda b, t: b.x[t] - rule(b, t))),
}


def rows(b: Any) -> list[str]:
    parts = b.component_data_objects((pyo.Constraint, pyo.Expression, rcp.Complementarity), descend_into=True)
    return [str([*map(str, part.args)] if part.ctype is rcp.Complementarity else part.expr) for part in parts]


@pytest.mark.parametrize("horizon", HORIZONS)
@pytest.mark.parametrize("kind", STATEMENTS)
def test_in_every_kind_of_rule_it_is_the_time(kind: str, horizon: str) -> None:
    stated = []
    for of_time in (lambda b, t: 2 * t, lambda b, t: 2 * b.time_at(t)):
        _, b = ramp("implicit_euler" if kind == "step" else "radau", **HORIZONS[horizon])
        STATEMENTS[kind](b, of_time)
        stated.append(rows(b))
    assert stated[0] == stated[1] != []


@pytest.mark.parametrize("horizon", HORIZONS)
@pytest.mark.parametrize("kind", STATEMENTS)
def test_every_kind_of_rule_is_refused_that_needs_its_number(kind: str, horizon: str) -> None:
    _, b = ramp("implicit_euler" if kind == "step" else "radau", **HORIZONS[horizon])
    message = r"phase 'go'.*said.* uses t as a number.*pyo\.sin\(t\)"
    with unchanged(contents, b), pytest.raises(ModelError, match=message):
        STATEMENTS[kind](b, lambda b, t: math.sin(t))


FORMULAS: dict[str, Callable[[Any, Any], Any]] = {
    "added": lambda b, t: t + b.x[t],
    "subtracted from a number": lambda b, t: 1 - t,
    "times a duration": lambda b, t: b.duration * t,
    "a power": lambda b, t: t**2,
    "a function of Pyomo": lambda b, t: pyo.sin(t),
    "a function of NumPy": lambda b, t: np.sin(t),
    "in an array": lambda b, t: (np.array([1.0, 2.0]) * t)[0],
    "in an array of expressions": lambda b, t: rcp.array([b.x[t], t]) @ np.array([1.0, 2.0]),
    "compared by Pyomo": lambda b, t: pyo.Expr_if(t <= 2, 1.0, 0.0),
    "equal to an expression": lambda b, t: pyo.Expr_if(b.x[t] == t, 1.0, 0.0),
}
NUMBERS: dict[str, Callable[[Any, Any], Any]] = {
    "a function of Python": lambda b, t: math.sin(t),
    "an interpolation": lambda b, t: np.interp(t, [0, 3], [0, 1]),
    "compared": lambda b, t: 1.0 if t < 2 else 0.0,
    "the larger one": lambda b, t: max(t, 0.3),
    "truth": lambda b, t: 1.0 if t else 0.0,
}


@pytest.mark.parametrize("use", FORMULAS)
def test_every_formula_means_the_time_on_the_grid_and_between_its_points(use: str) -> None:
    values = []
    for duration in (3.0, LONG):
        _, b = ramp(duration=duration)
        as_ode(b, FORMULAS[use])
        b.u.set_values(dict.fromkeys(b.u, 0.5))
        b.x.set_values(dict.fromkeys(b.x, 0.25))
        rates = [pyo.value(rate) for rate in b.derivative(b.x).values()]
        values.append(np.array([*rates, *b.simulate()["x"]]))
    np.testing.assert_allclose(values[0], values[1], rtol=1e-12)


@pytest.mark.parametrize("use", NUMBERS)
def test_every_way_of_using_it_as_a_number_is_refused(use: str) -> None:
    _, b = ramp(duration=LONG)
    with pytest.raises(ModelError, match=r"ode 'said'( uses t as a number.*pyo\.sin|.*or of t, is true)"):
        as_ode(b, NUMBERS[use])


def test_it_is_an_index_wherever_the_point_is_one() -> None:
    m, b = ramp(duration=LONG)
    m.of_joint = pyo.Var([1, 2], b.points, initialize=0)
    first, table = b.points.first(), {t: i for i, t in enumerate(b.points)}
    labels = []

    @b.ode
    def said(b: Any, t: Any) -> Any:
        before = b.x[b.time.prev(t)]
        at_start = 1.0 if t == first and t in b.points and first == t and t != 0.3 else 0.0
        labels.append(f"{t:.3f} {t}")
        return {b.x: before + b.u.at(t) + at_start + table[t] + m.of_joint[1, t] + b.points.ord(t) + b.time_at(t)}

    assert labels == [f"{t:.3f} {t}" for t in b.points]
    assert b.derivative(b.x)[first].to_string()


def test_it_survives_a_pickle_and_equals_keys_of_any_kind() -> None:
    t = TimeIndex(0.5, "a rule", None)
    assert pickle.loads(pickle.dumps(t)) == t
    assert {t, 0.5} == {0.5}
    assert t != "name"
    assert t != ("joint", 0.5)
    assert t is not None


# --------------------------------------------------------------------
# Phases, links and pairs of an AbstractModel get their data, and their rules read the instance.


DATA = {None: {"k": {None: 0.7}, "legs": {None: ["a", "b", "c"]}, "x0": {"a": 1.0, "b": 2.0, "c": 3.0}}}


def abstract() -> Any:
    m = pyo.AbstractModel("legs")
    m.k, m.legs = pyo.Param(mutable=True), pyo.Set(ordered=True)
    m.x0 = pyo.Param(m.legs)
    return m


def check(phase: Any, k: float) -> None:
    """The first stage of implicit Euler from what the guess holds."""
    assert phase.trajectory().verify().defect == pytest.approx(k, abs=1e-12)


def test_rules_read_the_instance_and_the_copy_of_the_instance() -> None:
    m = abstract()

    def leg(b: Any) -> None:
        b.x = rcp.State(initial=1.0, initial_guess=1.0)
        b.ode(lambda b, t: {b.x: -b.model().k * b.x[t]})

    m.p = rcp.PhaseBlock(elements=2, scheme="implicit_euler", rule=leg)
    instance = m.create_instance(DATA)
    twin = copy.deepcopy(instance)
    instance.k = 5.0
    check(instance.p, 5.0)
    check(twin.p, 0.7)
    other = m.create_instance(DATA)
    check(other.p, 0.7)


def test_indexed_phases_and_their_links_come_with_the_data() -> None:
    m = abstract()

    def leg(b: Any, name: str) -> None:
        b.x = rcp.State(initial_guess=b.model().x0[name])
        b.ode(lambda b, t: {b.x: -b.model().k * b.x[t]})

    m.p = rcp.PhaseBlock(m.legs, elements=2, rule=leg)
    m.impacts = rcp.Link(m.p, jump=lambda pre, post: {"x": 0.5 * pre.x})
    m.first = rcp.Link(
        pyo.Set(initialize=["c"]), phases=lambda m, name: (m.p["a"], m.p[name]), jump=lambda pre, post: {"x": pre.x}
    )
    instance = m.create_instance(DATA)
    assert list(instance.impacts) == ["b", "c"]
    assert str(instance.impacts["c"].jump["x"].body) == "0.5*p[b].x[1.0] - p[c].x[0.0]"
    assert instance.first["c"].first is instance.p["a"]
    assert instance.impacts["b"].violation == pytest.approx(1.5)


def test_pairs_and_obstacles_come_with_the_data() -> None:
    m = abstract()
    m.v, m.w = pyo.Var(m.legs, bounds=(0, None), initialize=2), pyo.Var(m.legs, bounds=(0, None), initialize=3)
    m.c = rcp.Complementarity(m.legs, rule=lambda m, j: rcp.complements(m.v[j] >= m.x0[j], m.k * m.w[j] >= 0))

    def leg(b: Any) -> None:
        b.x = rcp.State(initial_guess=lambda t: t)
        b.ode(lambda b, t: {b.x: b.model().k})

    def keep_off(b: Any) -> None:
        b.build(
            b.model().p.time, body=rcp.Polytope.box(0.2, 0.2), clearance=0.01,
            pose=lambda m, t: rcp.planar_pose(m.p.x[t], 0.0),
            obstacles={"post": rcp.Polytope.box(0.2, 0.2).placed(rcp.planar_pose(3.0, 0.0))},
        )  # fmt: skip

    m.p = rcp.PhaseBlock(elements=2, rule=leg)
    m.off = rcp.ObstacleAvoidanceBlock(rule=keep_off)
    instance = m.create_instance(DATA)
    assert [pair.name for pair in rcp.active_pairs(instance)] == ["c[a]", "c[b]", "c[c]"]
    twin = instance.clone()
    instance.p.initialize(x=lambda t: 2 * t)
    (near,), (far,) = instance.off.verify().body_pairs, twin.off.verify().body_pairs
    assert near.distance == pytest.approx(3 - 2 - 0.2, abs=1e-6)
    assert far.distance == pytest.approx(3 - 1 - 0.2, abs=1e-6)
