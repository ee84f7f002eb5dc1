"""Joined phases are one motion: what is cut and linked, jumps or closes does so exactly."""

import math
import pickle
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import contents, each_scheme, one_phase, solve
from pyomo.core.expr.visitor import identify_variables

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError

# ---------------------------------------------------------------- a phase cut in two


def state_driven(b: Any, initial: float | None = None, final: float | None = None) -> None:
    """A forced, unstable motion whose right-hand side and cost depend on time."""
    b.x = rcp.State(initial=initial, final=final, initial_guess=1)
    b.v = rcp.State(initial=initial, initial_guess=1)
    b.u = rcp.Control()
    b.ode(driven)


def driven(b: Any, t: float) -> dict[Any, Any]:
    return {b.x: b.v[t], b.v: pyo.sin(b.x[t]) * pyo.cos(2 * b.time_at(t)) + b.u[t]}


def running_cost(b: Any) -> Any:
    return b.integral(lambda b, t: b.u[t] ** 2 + pyo.exp(-b.time_at(t)) * b.x[t] ** 2)


def uncut(scheme: rcp.schemes.Scheme, mesh: Any) -> pyo.ConcreteModel:
    m, _ = one_phase("whole", duration=2, mesh=mesh, scheme=scheme)
    state_driven(m.whole, initial=1, final=0.5)
    m.cost = pyo.Objective(expr=running_cost(m.whole))
    solve(m, 1e-11)
    return m


def same_control(pre: Any, post: Any) -> Any:
    return post.u == pre.u


@pytest.mark.casadi
@each_scheme
@pytest.mark.parametrize("kind", ["known start", "start of a phase", "free duration"])
def test_a_phase_cut_in_two_and_linked_gives_the_uncut_cost_and_trajectory(
    scheme: rcp.schemes.Scheme, kind: str
) -> None:
    mesh = [0, 0.3, 0.8, 1.3, 2.0]
    whole = uncut(scheme, mesh)
    m = pyo.ConcreteModel()
    if kind == "free duration":
        normalised = [0, 0.375, 1.0]
        m.a = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.1, 1)), mesh=normalised, scheme=scheme)
        m.a.duration.fix(0.8)
        m.b = rcp.PhaseBlock(duration=1.2, start=m.a, mesh=[0, 0.5 / 1.2, 1.0], scheme=scheme)
    else:
        m.a = rcp.PhaseBlock(duration=0.8, mesh=mesh[:3], scheme=scheme)
        m.b = rcp.PhaseBlock(duration=1.2, start=m.a if kind != "known start" else 0.8, mesh=mesh[2:], scheme=scheme)
    state_driven(m.a, initial=1)
    state_driven(m.b, final=0.5)
    # Where neighbouring elements share a point, the uncut control has one value at the cut.
    m.cut = rcp.Link(m.a, m.b, jump=same_control if m.a.grid.elements_share_points else None)
    m.cost = pyo.Objective(expr=running_cost(m.a) + running_cost(m.b))
    m.a.check()
    m.b.check()
    solve(m, 1e-11)
    assert pyo.value(m.cost) == pytest.approx(pyo.value(whole.cost), abs=1e-8)
    joined, reference = rcp.join_trajectories([m.a, m.b]), whole.whole.trajectory()
    assert joined.boundaries == pytest.approx([0, 0.8, 2.0], abs=1e-14)
    inner = np.linspace(0, 2, 37)  # none of them an element end, where a control may have two values
    for name in ("x", "v", "u"):
        assert joined(inner)[name] == pytest.approx(reference(inner)[name], abs=1e-7)
    assert m.cut.violation < 1e-9
    assert m.a.trajectory().verify().largest_violation < 1e-8
    assert m.b.trajectory().verify().largest_violation < 1e-8
    assert m.b.trajectory().time[0] == pytest.approx(0.8, abs=1e-14)


@pytest.mark.casadi
def test_free_durations_in_a_chain_pass_their_clock_on() -> None:
    """x' = 2 clock over three phases of unknown length ends at the square of the whole time."""
    m = pyo.ConcreteModel()
    for name, before in (("one", 0.5), ("two", "one"), ("three", "two")):
        start = m.component(before) if isinstance(before, str) else before
        m.add_component(name, rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.1, 3)), start=start, elements=1))
        phase = m.component(name)
        phase.x = rcp.State(initial=0.25 if name == "one" else None)
        phase.ode(lambda b, t: {b.x: 2 * b.time_at(t)})
    m.joints = rcp.Link([1, 2], phases=lambda m, k: ((m.one, m.two), (m.two, m.three))[k - 1])
    m.ends = pyo.ConstraintList()
    for phase, end in ((m.one, 1.0), (m.two, 4.0), (m.three, 9.0)):
        m.ends.add(phase.x[1] == end)
    m.nothing = pyo.Objective(expr=0)
    solve(m, 1e-12)
    assert [p.duration.value for p in (m.one, m.two, m.three)] == pytest.approx([0.5, 1.0, 1.0], abs=1e-9)
    assert pyo.value(m.three.time_at(1)) == pytest.approx(3.0, abs=1e-9)
    assert m.three.trajectory().time[[0, -1]] == pytest.approx([2.0, 3.0], abs=1e-9)
    assert m.three.trajectory().verify().horizon_error < 1e-9
    for copy in (m.clone(), pickle.loads(pickle.dumps(m.clone()))):
        used = {id(v) for v in identify_variables(copy.three.time_at(1))}
        assert used == {id(p.duration) for p in (copy.one, copy.two, copy.three)}


# ---------------------------------------------------------------- jumps


def state_fall(b: Any, *index: Any) -> None:
    b.height = rcp.State(final=0)
    b.speed = rcp.State()
    b.ode(fall)


def fall(b: Any, t: float) -> dict[Any, Any]:
    return {b.height: b.speed[t], b.speed: -9.81}


def bounce(pre: Any, post: Any) -> dict[str, Any]:
    return {"speed": -0.8 * pre.speed}


def bounce_as_relation(pre: Any, post: Any) -> Any:
    return post.speed == -0.8 * pre.speed


def bouncing(jump: Any = bounce) -> pyo.ConcreteModel:
    m = pyo.ConcreteModel()
    m.falls = rcp.PhaseBlock([0, 1, 2], duration=rcp.Duration(bounds=(0.1, 2)), elements=1, rule=state_fall)
    m.falls[0].height[0].fix(1)
    m.falls[0].speed[0].fix(0)
    m.impacts = rcp.Link(m.falls, jump=jump)
    m.nothing = pyo.Objective(expr=0)
    return m


@pytest.mark.casadi
@pytest.mark.parametrize("jump", [bounce, bounce_as_relation, lambda pre, post: [bounce_as_relation(pre, post)]])
def test_a_jump_holds_exactly_and_the_rest_continues(jump: Any) -> None:
    m = bouncing(jump)
    assert list(m.impacts) == [1, 2]
    assert list(m.impacts[1].continuity) == ["height"]
    solve(m, 1e-12)
    first = math.sqrt(2 / 9.81)
    exact = [first, 2 * first * 0.8, 2 * first * 0.64]
    assert [b.duration.value for b in m.falls.values()] == pytest.approx(exact, abs=1e-10)
    for link in m.impacts.values():
        assert link.post.speed.value == pytest.approx(-0.8 * link.pre.speed.value, abs=1e-12)
        assert link.post.height.value == pytest.approx(link.pre.height.value, abs=1e-12)
        assert link.violation < 1e-10


@pytest.mark.casadi
def test_links_live_in_clones_and_pickles() -> None:
    m = bouncing()
    clone = m.clone()
    back = pickle.loads(pickle.dumps(m))
    for copy in (clone, back):
        assert contents(copy) == contents(m)
        assert copy.impacts[2].first is copy.falls[1]
        assert copy.impacts[2].second is copy.falls[2]
        rows = list(copy.impacts[1].component_data_objects(pyo.Constraint))
        assert all(v.model() is copy for row in rows for v in identify_variables(row.body))
        solve(copy, 1e-12)
        assert copy.impacts[2].violation < 1e-10
    assert m.falls[2].duration.value != clone.falls[2].duration.value


def test_a_violation_is_measured_and_unknown_where_a_value_is_missing() -> None:
    m = bouncing()
    m.falls[0].height[1].unfix()
    m.falls[0].height[1].set_value(0.25)
    assert m.impacts[1].violation == 0.25
    m.falls[0].height[1].set_value(None)
    assert math.isnan(m.impacts[1].violation)


def test_a_jump_may_read_controls_algebraics_parameters_durations_and_the_users_own_components() -> None:
    m = pyo.ConcreteModel()
    for name, scheme in (("a", rcp.schemes.gauss_legendre(2)), ("b", rcp.schemes.radau(2))):
        m.add_component(
            name, rcp.PhaseBlock(elements=2, scheme=scheme, duration=rcp.Duration(bounds=(1, 2), initial_guess=2))
        )
        p = m.component(name)
        p.x, p.u, p.k = rcp.State(), rcp.Control(), rcp.Parameter(initial_guess=3)
        p.g = pyo.Param(initialize=10)
        p.twice = pyo.Expression(p.time, rule=lambda b, t: 2 * b.x[t])
        p.initialize(u=lambda t: 1 + 4 * t, x=lambda t: t)
    link = m.link = rcp.Link(m.a, m.b)
    assert pyo.value(link.pre.u) == pytest.approx(5.0)
    assert pyo.value(link.post.u) == pytest.approx(1.0)
    m.back = rcp.Link(m.b, m.a)
    assert m.back.pre.u is m.b.u[1.0]
    assert m.back.pre.k is m.b.k
    assert m.back.pre.g is m.b.g
    assert pyo.value(m.back.pre.twice) == 2.0


@each_scheme
def test_the_end_of_a_linear_control_is_its_knot(scheme: rcp.schemes.Scheme) -> None:
    m, _ = one_phase("a", elements=3, scheme=scheme, x=rcp.State())
    m.a.u = rcp.Control(parametrization="piecewise_linear", initial_guess=lambda t: 1 + t**2)
    m.link = rcp.Link(m.a, m.a, jump=same_control)
    assert m.link.pre.u is m.a.u_at_knots[3]
    assert m.link.post.u is m.a.u_at_knots[0]
    assert list(m.link.continuity) == ["x"]
    joined = rcp.join_trajectories([m.a, m.a])
    assert joined([1.0, 2.0])["u"] == pytest.approx([2.0, 2.0])
    assert joined([0.0, 1.0], after=True)["u"] == pytest.approx([1.0, 1.0])


# ---------------------------------------------------------------- selections, maps, parameters, periodic motions


def two(**options: Any) -> tuple[pyo.ConcreteModel, Any, Any]:
    m = pyo.ConcreteModel(name="two")
    m.a = rcp.PhaseBlock(elements=2)
    m.b = rcp.PhaseBlock(elements=2)
    for b in (m.a, m.b):
        b.x, b.y = rcp.State(), rcp.State()
        b.k = rcp.Parameter()
    return m, m.a, m.b


def test_states_are_selected_omitted_and_mapped() -> None:
    m, a, b = two()
    m.chosen = rcp.Link(a, b, states=["x"])
    m.by_variable = rcp.Link(a, b, states=[a.y])
    m.but = rcp.Link(a, b, omit="x")
    m.mirror = rcp.Link(a, b, states={"x": "y", a.y: b.x})
    m.none = rcp.Link(a, b, states=[], parameters=["k"])
    assert list(m.chosen.continuity) == ["x"]
    assert list(m.by_variable.continuity) == list(m.but.continuity) == ["y"]
    assert {v.name for v in identify_variables(m.mirror.continuity["y"].body)} == {"a.x[1.0]", "b.y[0.0]"}
    assert len(m.mirror.continuity) == 2
    assert len(m.none.continuity) == 0
    assert str(m.none.shared["k"].expr) == "a.k - b.k  ==  0"


@pytest.mark.casadi
def test_a_periodic_motion_closes() -> None:
    """Of all periodic motions of a driven oscillator there is one; its amplitude is known."""
    m, b = one_phase("swing", duration=2 * math.pi / 3, elements=12, stages=4)
    b.x, b.v, b.travelled = rcp.State(), rcp.State(), rcp.State(initial=0)
    b.ode(lambda b, t: {b.x: b.v[t], b.v: -b.x[t] - 0.1 * b.v[t] + pyo.cos(3 * t), b.travelled: b.v[t] ** 2})
    m.closed = rcp.Link(b, b, omit=["travelled"])
    m.nothing = pyo.Objective(expr=0)
    solve(m)
    exact = 1 / (1 - 9 + 0.3j)
    assert b.x[0].value == pytest.approx(exact.real, abs=1e-9)
    assert b.x[b.final_time].value == pytest.approx(exact.real, abs=1e-9)
    assert b.v[0].value == pytest.approx((3j * exact).real, abs=1e-9)
    assert b.travelled[b.final_time].value > 0.01


# ---------------------------------------------------------------- what cannot be joined


ELSEWHERE, _ = one_phase(model="elsewhere", elements=1, x=rcp.State())


def lonely(m: pyo.ConcreteModel, states: tuple[str, ...]) -> Any:
    m.c = rcp.PhaseBlock(elements=1)
    for name in states:
        m.c.declare(name, rcp.State())
    return m.c


def fixed_apart(m: pyo.ConcreteModel) -> Any:
    m.a.x[1].fix(1)
    m.b.x[0].fix(2)
    return rcp.Link(m.a, m.b)


def joined(**options: Any) -> Callable[[Any], Any]:
    return lambda m: rcp.Link(m.a, m.b, **options)


JUMPS = {
    "to no state": (lambda pre, post: {"z": 0}, "its jump: phase 'b': 'z' is no state; its states are x, y"),
    "with a variable as key": (lambda pre, post: {post.x: 0}, "cannot be the key of a dict. Write {'speed': ...}"),
    "results None": (lambda pre, post: None, "Is the return statement missing?"),
    "results a relation": (lambda pre, post: {"x": post.x == pre.x}, "as the start of 'x'; expected an expression"),
    "reads what is not there": (
        lambda pre, post: {"x": pre.mass},
        "phase 'a' has no 'mass', which a link asks for at its end; declared are x, y, k",
    ),
}
REFUSED = {
    **{f"jump {case}": (joined(jump=jump), message) for case, (jump, message) in JUMPS.items()},
    "another model": (
        lambda m: rcp.Link(m.a, ELSEWHERE.p),
        "'p' belongs to the model 'elsewhere', the link to 'two'",
    ),
    "no phase": (lambda m: rcp.Link(m.a, m), "'two' is no PhaseBlock"),
    "three phases": (lambda m: rcp.Link(m.a, m.b, m.a), r"expected two phases \(first, second\)"),
    "indexed phase": (lambda m: rcp.Link(m.a, rcp.PhaseBlock([1, 2], rule=state_fall)), "give one of its phases"),
    "missing in first": (
        lambda m: rcp.Link(lonely(m, ("x",)), m.a),
        "nothing gives the start of state 'y'; 'c' has the states x. Give 'y' in jump=, or leave it alone by omit",
    ),
    "missing in second": (
        lambda m: rcp.Link(m.a, lonely(m, ("x",))),
        "state 'y' of 'a' goes nowhere; 'c' has the states x. Use it in jump=, or leave it alone by omit",
    ),
    "unknown state": (joined(states=["z"]), "'z' is no state; its states are x, y"),
    "continues and jumps": (
        joined(states=["x", "y"], jump=lambda pre, post: {"x": 0}),
        "start of state 'x' is given twice. Take it out of states=",
    ),
    "states and omit": (joined(states=["x"], omit=["y"]), "Give one of them"),
    "omit unknown": (joined(omit=["z"]), "omit= names 'z', which is a state of neither phase"),
    "jump to a state of the first": (lambda m: joined(jump=lambda pre, post: {m.a.x: 0})(m), "'b': 'x' is no state"),
    "jump twice": (lambda m: joined(jump=lambda pre, post: {"x": 0, m.b.x: 1})(m), "start of 'x' twice"),
    "unknown parameter": (joined(parameters=["x"]), "'x' is no parameter of 'a'; .* are k"),
    "fixed apart": (fixed_apart, r"'a.x\[1.0\]' has the fixed value 1, but 'b.x\[0.0\]' is fixed at 2. Leave one"),
    "rule raises": (joined(rule=lambda link: link.pre.nothing), "has no 'nothing'"),
    "no rule for phases": (lambda m: rcp.Link([1, 2]), "An indexed one takes index sets and phases=rule"),
    "phases twice": (joined(phases=max), "it was given both"),
    "a family of one": (lambda m: rcp.Link(rcp.PhaseBlock([1])), "takes two or more"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_joined_is_named_and_nothing_stays(case: str) -> None:
    make, message = REFUSED[case]
    m, _, _ = two()
    before = contents(m)

    def add() -> None:
        nonlocal before
        link = make(m)
        before = contents(m)
        m.link = link

    with pytest.raises(ModelError, match=message) as caught:
        add()
    assert m.component("link") is None
    assert contents(m) == before
    assert "link" in str(caught.value).lower()
    m.link = rcp.Link(m.a, m.b, omit=["x"])
    assert len(m.link.continuity) == 1


@pytest.mark.casadi
def test_ends_that_are_fixed_to_the_same_value_may_be_linked() -> None:
    m, a, b = two()
    for p in (a, b):
        p.ode(lambda b, t: {b.x: b.k, b.y: 0})
    a.x[0].fix(0)
    a.x[1].fix(1)
    b.x[0].fix(1)
    b.k.fix(2)
    a.y[0].fix(0)
    m.link = rcp.Link(a, b)
    m.nothing = pyo.Objective(expr=0)
    solve(m)
    assert b.x[1].value == pytest.approx(3)


def test_a_users_rule_adds_equations_of_its_own() -> None:
    m, a, b = two()

    def touch(link: Any) -> None:
        link.on_the_ground = pyo.Constraint(expr=link.pre.y == 0)

    m.landing = rcp.Link(a, b, rule=touch)
    assert m.landing.on_the_ground.body is a.y[1]
    many = partial(lambda m, k: (m.a, m.b) if k == "there" else (m.b, m.a))
    m.ways = rcp.Link(["there", "back"], phases=many, rule=lambda link, k: setattr(link, "word", k))
    assert m.ways["back"].first is b
    assert m.ways["back"].word == "back"
