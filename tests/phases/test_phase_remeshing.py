"""Another mesh in place: the model is the one that would have been built on it, and what stays is what it was."""

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.checked import unchanged
from harness.phases import one_phase, text
from hypothesis import given, settings
from hypothesis import strategies as st
from pyomo.core.expr.visitor import identify_variables

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.numerics import Mesh
from pyrobocop_pyomo.phases import why_not_remeshed
from pyrobocop_pyomo.phases.remeshing import put_on_meshes

COARSE, FINE = (0.0, 0.25, 0.5, 1.0), (0.0, 0.1, 0.25, 0.5, 0.6, 0.75, 1.0)

SCHEMES: dict[str, dict[str, Any]] = {
    "radau 1": {"stages": 1},
    "radau 2": {"stages": 2},
    "radau 3": {"stages": 3},
    "gauss 2": {"scheme": "gauss", "stages": 2},
    "implicit midpoint": {"scheme": "implicit_midpoint"},
    "explicit Euler": {"scheme": "explicit_euler"},
    "trapezoid": {"scheme": "trapezoid"},
}


def every_statement(mesh: Any, **options: Any) -> Any:
    """All kinds of declarations and statements that any scheme takes."""
    m, b = one_phase("body", duration=1.0, mesh=mesh, x=rcp.State(initial=0, final=(0.5, 2), bounds=(-5, 5)), **options)
    b.v = rcp.State(initial=0, derivative_bounds=(-3, 3))
    b.z = rcp.State(initial=1, bounds=lambda t: (-1 - t, 1 + t))
    b.force = rcp.Algebraic(bounds=(0, None), initial_guess=0.5)
    b.u = rcp.Control(bounds=(-1, 1))
    b.steps = rcp.Control(parametrization="piecewise_linear", rate_bounds=(-4, 4))
    b.knotted = rcp.Control(parametrization="piecewise_linear", knots=(0, 0.5, 1), bounds=(-2, 2))
    b.mass = rcp.Parameter(bounds=(0.5, 2), initial_guess=1)
    b.ode(lambda b, t: {b.x: b.v[t], b.v: (b.u[t] + b.force[t] + b.steps[t]) / b.mass})

    b.residual(lambda b, t: b.derivative(b.z)[t] + b.z[t] ** 3 == b.u[t] + b.knotted[t], name="implicit")

    b.complementarity(lambda b, t: [rcp.complements(b.force[t] >= 0, b.x[t] >= 0)], name="contact")

    b.constraint(lambda b, t: {"speed": (-4, b.v[t], 4), "both": b.x[t] + b.z[t] <= 5}, name="limits")

    b.constraint_at_boundaries(lambda b, t: b.x[t] ** 2 <= 25, name="inside")

    effort = b.integral(lambda b, t: b.u[t] ** 2) + b.integral(lambda b, t: b.rate_of(b.steps)[t] ** 2)
    m.cost = pyo.Objective(expr=effort + b.integral(lambda b, t: (b.x[t] - t**2) ** 2) + b.x[b.final_time] ** 2)
    return m


def stepwise(mesh: Any, **options: Any) -> Any:
    """Piecewise constant controls, their rates, and a law of the package."""
    m, b = one_phase("body", duration=1.0, mesh=mesh, stages=2, x=rcp.State(initial=0, units=pyo.units.m), **options)
    b.u = rcp.Control(parametrization="piecewise_constant", rate_bounds=(-9, 9), bounds=(-3, 3))
    b.drive = rcp.Control()
    b.push = rcp.mechanics.AbsoluteValue(b.drive)
    b.ode(lambda b, t: {b.x: b.u[t] + b.push[t]})
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2 + b.drive[t] ** 2))
    return m


def free_horizon(mesh: Any, **options: Any) -> Any:
    """A free duration, moving elements, a second phase after it, and a link."""
    m = pyo.ConcreteModel()
    m.first = a = rcp.PhaseBlock(
        duration=rcp.Duration(bounds=(0.5, 2)), mesh=mesh, stages=2, free_element_widths=(0.3, 3), **options
    )
    m.second = b = rcp.PhaseBlock(duration=1.0, start=m.first, elements=2, stages=2)
    for phase in (a, b):
        phase.x, phase.u = rcp.State(), rcp.Control(rate_bounds=(-50, 50))
        phase.ode(lambda b, t: {b.x: b.u[t] * b.time_at(t)})
    m.link = rcp.Link(m.first, m.second)
    m.time = pyo.Objective(expr=a.duration + a.integral(lambda b, t: b.u[t] ** 2) + b.integral(lambda b, t: b.x[t]))
    return m


def jumping(mesh: Any, **options: Any) -> Any:
    """A link whose jump reads a control, which has no value at the end of the phase but by its polynomial."""
    m = pyo.ConcreteModel()
    m.before = rcp.PhaseBlock(duration=1.0, mesh=mesh, scheme="gauss", stages=2, **options)
    m.after = rcp.PhaseBlock(duration=1.0, elements=2, start=1.0)
    for b in (m.before, m.after):
        b.x, b.u = rcp.State(), rcp.Control()
        b.ode(lambda b, t: {b.x: b.u[t]})
    m.link = rcp.Link(m.before, m.after, jump=lambda pre, post: {"x": -0.5 * pre.x + pre.u})
    return m


def stepped(mesh: Any, **options: Any) -> Any:
    """A state that a step map leads."""
    m, b = one_phase("body", duration=1.0, mesh=mesh, scheme="implicit_euler", **options)
    b.count, b.u = rcp.State(initial=0), rcp.Control()
    b.step_map(lambda b, t, previous: {b.count: previous.count + b.u[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.count[t] * b.u[t]))
    return m


def users_own(mesh: Any, **options: Any) -> Any:
    """Components beside the phase, which read the ends of it and values that follow the mesh."""
    m, b = one_phase("body", duration=1.0, mesh=mesh, stages=2, **options)
    m.weight = pyo.Param(initialize=2.0, mutable=True)
    m.slack = pyo.Var(bounds=(0, 1), initialize=0.5)
    b.x, b.u = rcp.State(initial=0), rcp.Control()
    b.ode(lambda b, t: {b.x: m.weight * b.u[t] + 1})
    m.soft = pyo.Constraint(expr=b.x.at(0.3) <= 1 + m.slack)
    b.highest = pyo.Expression(expr=b.x.at_end - b.x[b.initial_time])
    m.pairs = rcp.Complementarity(expr=rcp.complements(m.slack >= 0, b.highest >= 0))
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2) + m.slack)
    return m


CASES: dict[str, Callable[[Any], Any]] = {
    **{f"every statement, {name}": lambda mesh, o=o: every_statement(mesh, **o) for name, o in SCHEMES.items()},
    "stepwise": stepwise,
    "free horizon": free_horizon,
    "jumping": jumping,
    "stepped": stepped,
    "users' own": users_own,
}
each_case = pytest.mark.parametrize("build", CASES.values(), ids=CASES)


def rows(m: Any) -> dict[str, tuple[Any, ...]]:
    """What every part of a model says at its current values, by name."""
    found: dict[str, tuple[Any, ...]] = {}
    for variable in m.component_data_objects(pyo.Var):
        found[variable.name] = (variable.lb, variable.ub, variable.fixed, variable.domain.name)
    for row in m.component_data_objects(pyo.Constraint):
        read = sorted(v.name for v in identify_variables(row.body, include_fixed=True))
        found[row.name] = (pyo.value(row.body), row.lb, row.ub, row.active, read)
    for component in m.component_objects(rcp.Complementarity):
        for pair in component.values():
            found[pair.name] = (*(str(side) for side in pair.args), pair.group, pair.weight)
    for objective in m.component_data_objects(pyo.Objective):
        read = sorted({v.name for v in identify_variables(objective.expr, include_fixed=True)})
        found[objective.name] = (pyo.value(objective.expr), read)
    return found


def same_values(m: Any, other: Any, seed: int = 0) -> None:
    """Random numbers, the same for variables of the same name."""
    generator = np.random.default_rng(seed)
    numbers = {variable.name: generator.uniform(0.2, 0.9) for variable in other.component_data_objects(pyo.Var)}
    for model in (m, other):
        for variable in model.component_data_objects(pyo.Var):
            variable.set_value(numbers[variable.name], skip_validation=True)


def assert_same(m: Any, other: Any) -> None:
    names = {v.name for v in m.component_data_objects(pyo.Var)}
    assert names == {v.name for v in other.component_data_objects(pyo.Var)}
    same_values(m, other)
    ours, theirs = rows(m), rows(other)
    assert set(ours) == set(theirs)
    for name, wanted in theirs.items():
        for entry, expected in zip(ours[name], wanted, strict=True):
            close = isinstance(expected, float) and not isinstance(entry, bool)
            assert entry == (pytest.approx(expected, rel=1e-9, abs=1e-12) if close else expected), name


def phase_of(m: Any) -> Any:
    return rcp.phases_of(m)[0]


# ------------------------------------------------------------------------------------------- as if built on the mesh


@each_case
@pytest.mark.parametrize("meshes", [(COARSE, FINE), (FINE, COARSE)], ids=["finer", "coarser"])
def test_the_model_is_the_one_that_is_built_on_the_mesh(build: Callable[[Any], Any], meshes: Any) -> None:
    before, after = meshes
    m, wanted = build(before), build(after)
    phase_of(m).remesh(after)
    assert phase_of(m).grid.mesh == Mesh(after)
    assert list(phase_of(m).time) == list(phase_of(wanted).time)
    assert_same(m, wanted)


def test_elements_that_move_may_become_one() -> None:
    m = free_horizon(COARSE)
    m.first.remesh(1)
    assert_same(m, free_horizon((0.0, 1.0)))


@each_case
def test_what_was_read_on_the_mesh_before_is_not_said_on_the_next_one(build: Callable[[Any], Any]) -> None:
    m = build(COARSE)
    for mesh in (FINE, COARSE):
        rows(m)
        put_on_meshes({phase_of(m): mesh})  # without the comparison with the rules, which makes them anew as well
    assert_same(m, build(COARSE))


@each_case
def test_copies_and_the_original_go_their_own_ways(build: Callable[[Any], Any]) -> None:
    m, wanted = build(COARSE), build(FINE)
    before = text(m)
    for copy in (m.clone(), pickle.loads(pickle.dumps(m))):
        phase_of(copy).remesh(FINE)
        assert text(m) == before
        assert_same(copy, wanted)
        assert_same(copy.clone(), wanted)


def test_phases_that_read_each_other_get_their_meshes_at_once() -> None:
    def build(mesh: Any) -> Any:
        m = pyo.ConcreteModel()
        for name in ("leader", "follower"):
            m.add_component(name, rcp.PhaseBlock(duration=1.0, mesh=mesh, stages=2))
        m.leader.x, m.leader.u = rcp.State(initial=0), rcp.Control()
        m.follower.x = rcp.State(initial=1)
        m.leader.ode(lambda b, t: {b.x: b.u[t]})
        m.follower.ode(lambda b, t: {b.x: m.leader.x[t] - b.x[t]})
        return m

    m = build(COARSE)
    for alone in (m.leader, m.follower):
        with unchanged(text, m), pytest.raises(ModelError, match="remesh_phases|leader"):
            alone.remesh(FINE)
    rcp.remesh_phases({m.leader: FINE, m.follower: Mesh(FINE)})
    assert_same(m, build(FINE))


# ------------------------------------------------------------------------------------------------------ what stays


@each_case
def test_components_and_variables_at_times_that_stay_are_the_same_objects(build: Callable[[Any], Any]) -> None:
    m = build(COARSE)
    b = phase_of(m)
    components = dict(b.component_map())
    name = b.record.names_of_states[0]
    variables = {t: b.component(name)[t] for t in COARSE}
    ends = [b.component(control)[b.points.last()] for control in b.record.names(rcp.Control)]
    b.remesh(FINE)
    assert {name: b.component(name) for name in components} == components
    assert list(b.component_map()) == list(components)
    assert all(b.component(name)[t] is variable and variable.index() == t for t, variable in variables.items())
    if b.points.last() == 1.0:
        assert [b.component(control)[1.0] for control in b.record.names(rcp.Control)] == ends


@settings(max_examples=15, deadline=None)
@given(cuts=st.sets(st.floats(0.05, 0.95).map(lambda x: round(x, 3)), min_size=1, max_size=4), degree=st.integers(1, 3))
def test_a_polynomial_that_the_elements_hold_survives_any_mesh(cuts: set[float], degree: int) -> None:
    m = every_statement(COARSE, stages=3)
    b = m.body
    b.initialize(x=lambda t: t**degree, u=lambda t: t ** min(degree, 2) / 2, steps=lambda t: 3 * t)
    b.remesh((0.0, *sorted(cuts | {0.5}), 1.0))
    for t in b.time:
        assert b.x[t].value == pytest.approx(t**degree, abs=1e-9)
    for t in b.points:
        assert b.u[t].value == pytest.approx(t ** min(degree, 2) / 2, abs=1e-9)
        assert pyo.value(b.steps[t]) == pytest.approx(3 * t, abs=1e-9)
    b.remesh(COARSE)
    assert [b.x[t].value for t in COARSE] == pytest.approx([t**degree for t in COARSE], abs=1e-9)


def test_what_the_user_has_set_stays_or_is_refused_by_name() -> None:
    m = stepwise(COARSE)
    b = m.body
    b.x[0.0].fix(0.7)
    b.x[0.5].setub(1.5)
    b.u.fix(2.0)
    b.drive.setlb(-4)
    b.remesh(FINE)
    assert (b.x[0.0].fixed, b.x[0.0].value, b.x[0.5].ub) == (True, 0.7, 1.5)
    assert [t for t in b.time if b.x[t].fixed or b.x[t].ub is not None] == [0.0, 0.5]
    assert all(b.u[t].fixed for t in b.points)
    assert all(b.drive[t].lb == -4 for t in b.points)
    for change, words in ((b.x[0.6].setub, r"'x': the bounds at t = 0\.6"), (b.u_per_element[0].fix, "'u': the fixed")):
        b.u.unfix()
        change(1.2)
        with unchanged(text, m), pytest.raises(ModelError, match=words):
            b.remesh(COARSE)
        b.x[0.6].setub(None)


def test_rows_that_are_deactivated_stay_so() -> None:
    m = every_statement(COARSE, stages=1)
    m.body.limits.deactivate()
    m.body.inside[0.5].deactivate()
    m.body.remesh(FINE)
    assert not any(row.active for row in m.body.limits.values())
    assert [t for t in FINE if not m.body.inside[t].active] == [0.5]
    m.body.inside[0.6].deactivate()
    with unchanged(text, m), pytest.raises(ModelError, match=r"inside.*0\.6"):
        m.body.remesh(COARSE)


def test_suffixes_forget_what_is_gone_and_follow_what_stays() -> None:
    m = users_own(COARSE)
    m.dual = pyo.Suffix(direction=pyo.Suffix.IMPORT)
    rows_before = list(m.body.x_collocation.values())
    m.dual.update({row: float(i) for i, row in enumerate(rows_before)})
    stays = m.dual[m.body.x_collocation[0.5]]
    m.body.remesh(FINE)
    assert m.dual[m.body.x_collocation[0.5]] == stays
    assert all(part.model() is m for part in m.dual)
    assert len(m.dual) < len(rows_before) + 1


def test_a_derivative_that_was_asked_for_follows() -> None:
    m, _ = one_phase("b", duration=1.0, elements=2, stages=1, x=rcp.State(initial=0), u=rcp.Control())
    m.b.ode(lambda b, t: {b.x: 2 * b.u[t]})
    speed = m.b.derivative(m.b.x)

    m.b.constraint(lambda b, t: b.derivative(b.x)[t] <= 1, name="slow")

    m.b.remesh(4)
    assert list(speed) == list(m.b.points)
    assert {v.name for v in identify_variables(m.b.slow[0.75].body)} == {"b.u[0.75]"}


# ------------------------------------------------------------------------------------------- what was said is kept


def limited_by_a_loop(mesh: Any) -> Any:
    """A rule for each limit, which holds the variable of the loop, a number of the module and a value of a Param."""
    m, b = one_phase("body", duration=1.0, mesh=mesh, stages=2, x=rcp.State(index=3, initial=0), u=rcp.Control(index=3))
    m.k = pyo.Param(initialize=2.0, mutable=True)
    b.ode(lambda b, t: {b.x: b.u[t]})
    for i, limit in enumerate((0.1, 0.15, 0.2)):
        of_loop = lambda b, t: b.u[i, t] <= limit * GLOBAL[0] * pyo.value(m.k) * (1 + t)  # noqa: B023, E731
        b.constraint(of_loop, name=f"limit_{i}")
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: GLOBAL[0] * b.u[0, t] ** 2))
    return m


GLOBAL = [1.0]


@pytest.mark.parametrize("clones", [0, 1, 2])
def test_what_surrounds_a_rule_counts_as_it_was_when_the_rule_was_stated(clones: int) -> None:
    m, wanted = limited_by_a_loop(COARSE), limited_by_a_loop(FINE)
    GLOBAL[0] = 7.0
    m.k.set_value(9.0)
    wanted.k.set_value(9.0)
    try:
        for _ in range(clones):
            m = m.clone()
        m.body.remesh(FINE)
        assert_same(m, wanted)
        m.body.remesh(COARSE)
        GLOBAL[0] = 1.0
        m.k.set_value(2.0)
        assert_same(m, limited_by_a_loop(COARSE))
    finally:
        GLOBAL[0] = 1.0


# ----------------------------------------------------------------------------------------------------------- refusals


def _sum_over_points(m: Any) -> None:
    m.cost.deactivate()
    m.culprit = pyo.Objective(expr=sum(m.body.u[t] ** 2 for t in m.body.points))


def _ramp_between_points(m: Any) -> None:
    points = m.body.points
    m.culprit = pyo.Constraint(points, rule=lambda m, t: (
        pyo.Constraint.Skip if t == points.first() else m.body.u[t] - m.body.u[points.prev(t)] <= 0.1
    ))  # fmt: skip


def _delay_by_hand(m: Any) -> None:
    times = list(m.body.time)
    m.body.constraint(lambda b, t: b.x[times[max(times.index(t) - 2, 0)]] <= b.u[t], name="culprit")


def _data_by_time(m: Any) -> None:
    table = dict.fromkeys(m.body.points, 1.0)
    m.body.constraint(lambda b, t: b.u[t] <= table.get(t, 0.0), name="culprit")


def _changed_row(m: Any) -> None:
    m.body.constraint(lambda b, t: b.u[t] <= 3, name="culprit")
    m.body.culprit[m.body.points.last()].set_value(m.body.u[m.body.points.last()] <= 2)


def _changed_integral(m: Any) -> None:
    m.body.culprit = rcp.Control()
    m.culprit = pyo.Expression(expr=m.body.integral(lambda b, t: b.culprit[t]))
    m.body.stated_integrals[2].set_value(m.body.culprit[m.body.points.last()])


def _integral_changed_before_the_last(m: Any) -> None:
    _changed_integral(m)
    m.another = pyo.Expression(expr=m.body.integral(lambda b, t: b.culprit[t] ** 2))


KEEPS: dict[str, Callable[[Any], Any]] = {
    "a row": lambda m: m.add_component("culprit", pyo.Constraint(expr=m.body.u[m.body.points.first()] <= 1)),
    "data": lambda m: m.add_component("culprit", pyo.Param(m.body.points, initialize=lambda m, t: 1 + t, mutable=True)),
    "a rule": lambda m: m.body.add_component("culprit", pyo.Expression(m.body.points, rule=lambda b, t: 2 * b.u[t])),
    "a sum over points": _sum_over_points,
    "a ramp between points": _ramp_between_points,
    "a delay by hand": _delay_by_hand,
    "data by time": _data_by_time,
    "a fixed time in a rule": lambda m: m.body.constraint(
        lambda b, t: b.x[t] <= 1 + b.x[m.body.points.first()], name="culprit"
    ),
    "bounds that jump": lambda m: m.body.declare("culprit", rcp.Control(bounds=lambda t: (0, 1 if t < 0.3 else 2))),
    "a changed row": _changed_row,
    "a changed integral": _changed_integral,
    "a changed integral before another": _integral_changed_before_the_last,
}


@pytest.mark.parametrize("case", KEEPS)
def test_what_keeps_the_mesh_is_named_and_nothing_has_changed(case: str) -> None:
    m = users_own(COARSE)
    KEEPS[case](m)
    mesh = m.body.grid.mesh
    with unchanged(text, m), pytest.raises(ModelError, match=r"culprit|stated_integrals\[2\]") as refused:
        m.body.remesh(FINE)
    assert why_not_remeshed(m.body) == str(refused.value)
    assert m.body.grid.mesh == mesh
    assert list(m.body.time) == list(m.body.grid.times)


def test_a_relaxed_model_keeps_its_mesh() -> None:
    m = every_statement(COARSE)
    pyo.TransformationFactory("pyrobocop.relax_complementarity").apply_to(m)
    with pytest.raises(ModelError, match="relaxed"):
        m.body.remesh(FINE)


def test_a_mesh_has_to_be_one_of_the_phase() -> None:
    m = every_statement(COARSE)
    for mesh, words in (
        ((0, 0.5, 2), "runs from 0 to 2"), ((0, 0.5, 0.5, 1), "increase"), (3, "knot 0.5 is no element boundary"),
    ):  # fmt: skip
        with unchanged(text, m), pytest.raises(ModelError, match=words):
            m.body.remesh(mesh)
    with pytest.raises(ModelError, match="no PhaseBlock"):
        rcp.remesh_phases({m: 3})
