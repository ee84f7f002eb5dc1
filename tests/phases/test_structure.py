"""A built phase has the variables and rows that the formulas say, and the structural index that is allowed."""

import pickle
from typing import Any

import pyomo.environ as pyo
import pytest
from harness.phases import each_collocated, free_variables, one_phase, rank, rows, undetermined
from pyomo.mpec import Complementarity as PyomoComplementarity
from pyomo.mpec import complements as pyomo_complements

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.row_violations import largest_violation
from pyrobocop_pyomo.phases.structure import PointStructure, middle_point


def plant(scheme: rcp.schemes.Scheme, parametrization: str = "collocated", **options: Any) -> pyo.ConcreteModel:
    """Two states, an algebraic, a control, a parameter."""
    m, b = one_phase(x=rcp.State(initial=0), **{"duration": 2, "elements": 6, "scheme": scheme, **options})
    b.v = rcp.State(initial=0)
    b.f = rcp.Algebraic()
    b.u = rcp.Control(bounds=(-1, 1), parametrization=parametrization)
    b.k = rcp.Parameter(bounds=(1, 2), initial_guess=1.5)
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.f[t]})
    b.residual(lambda b, t: b.f[t] == b.u[t] - b.k * b.x[t], name="spring")
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2 + b.x[t]))
    return m


each_control = pytest.mark.parametrize("parametrization", ["collocated", "piecewise_constant"])


@each_collocated
@each_control
def test_counts_follow_the_formulas(scheme: rcp.schemes.Scheme, parametrization: str) -> None:
    m, n, s = plant(scheme, parametrization), 6, scheme.stages
    ends = 0 if scheme.stiffly_accurate else n
    per_state = 1 + n * s + ends
    controls = n if parametrization == "piecewise_constant" else n * s
    assert len(list(m.component_data_objects(pyo.Var))) == 2 * per_state + n * s + controls + 1
    assert len(rows(m)) == 2 * (n * s + ends) + n * s
    assert len(free_variables(m)) - len(rows(m)) == controls + 1
    assert list(m.p.time) == list(m.p.grid.times)
    assert list(m.p.points) == list(m.p.u.keys()) == list(m.p.f.keys())


@each_collocated
@each_control
def test_every_variable_is_determined(scheme: rcp.schemes.Scheme, parametrization: str) -> None:
    m = plant(scheme, parametrization, duration=rcp.Duration(bounds=(1, 2)))
    m.p.check()
    assert undetermined(m) == []
    assert rank(m) == len(rows(m))


@pytest.mark.parametrize("duration", [2, rcp.Duration(bounds=(1, 9))])
def test_bounds_in_time_are_rows_that_follow_the_time(duration: Any) -> None:
    _, b = one_phase(duration=duration, elements=2, stages=2, u=rcp.Control(bounds=lambda t: (-1, 9 - t)))
    b.v = rcp.State(index=2, bounds=lambda t: (None, [t, 2 * t]))
    for variable in (b.u[b.final_time], b.v[1, b.final_time]):
        variable.set_value(8.0)
    assert largest_violation(b.u_bounds.values()) == pytest.approx(8.0 - 9.0 + pyo.value(b.duration))
    assert largest_violation(b.v_1_bounds.values()) == pytest.approx(8.0 - 2 * pyo.value(b.duration))


def test_boundary_values_fix_bound_or_leave_free() -> None:
    _, b = one_phase(elements=2, fixed=rcp.State(initial=1, final=2, bounds=(0, 5), initial_guess=4))
    b.bound = rcp.State(initial=(-1, 3), final=(None, 4), bounds=(0, 5), initial_guess=4.5)
    b.free = rcp.State(bounds=(0, 5), initial_guess=9)
    first, last = b.initial_time, b.final_time
    assert [(b.fixed[t].fixed, b.fixed[t].value) for t in (first, last)] == [(True, 1), (True, 2)]
    assert (b.bound[first].bounds, b.bound[last].bounds) == ((0, 3), (0, 4))
    assert (b.bound[first].value, b.bound[last].value) == (3, 4)
    assert all(variable.value == 5 and not variable.fixed for variable in b.free.values())


def test_a_duration_starts_within_its_bounds() -> None:
    m = pyo.ConcreteModel()
    m.a = rcp.PhaseBlock(duration=rcp.Duration(bounds=(1, 4)))
    m.b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(1, 4), initial_guess=9))
    m.c = rcp.PhaseBlock(duration=rcp.Duration(bounds=(1, None)))
    assert [phase.duration.value for phase in (m.a, m.b, m.c)] == [2, 4, 1]


def test_a_mesh_end_that_differs_by_rounding_is_the_horizon() -> None:
    m = pyo.ConcreteModel()
    m.p = rcp.PhaseBlock(start=0.1, duration=0.2, mesh=[0.1, 0.2, 0.3])  # 0.1 + 0.2 is 0.30000000000000004
    assert m.p.final_time == 0.3


# --------------------------------------------------------------------
# The structural index: what is refused, what is let through, and who is named.


LENGTH, GRAVITY = 1.0, 9.81


def pendulum(constraint: Any, **options: Any) -> pyo.ConcreteModel:
    """A mass on a rod in Cartesian coordinates; the rod is stated as position, velocity or acceleration."""
    m, b = one_phase("swing", model="pendulum", **{"duration": 1, "elements": 5, "stages": 2, **options})
    for name, initial in {"x": LENGTH, "y": 0.0, "u": 0.0, "v": 0.0}.items():
        setattr(b, name, rcp.State(initial=initial, initial_guess=initial))
    b.tension = rcp.Algebraic()
    b.ode(mass)
    b.residual(constraint)
    return m


def mass(b: Any, t: float) -> Any:
    along = b.tension[t]
    return {b.x: b.u[t], b.y: b.v[t], b.u: -along * b.x[t], b.v: -along * b.y[t] - GRAVITY}


def position(b: Any, t: float) -> Any:
    return b.x[t] ** 2 + b.y[t] ** 2 == LENGTH**2


def velocity(b: Any, t: float) -> Any:
    return b.x[t] * b.u[t] + b.y[t] * b.v[t] == 0


def acceleration(b: Any, t: float) -> Any:
    return b.u[t] ** 2 + b.v[t] ** 2 - GRAVITY * b.y[t] == b.tension[t] * (b.x[t] ** 2 + b.y[t] ** 2)


def accelerations_as_derivatives(b: Any, t: float) -> Any:
    """The same through the derivatives, which the ode has given: they hold the tension."""
    return (
        b.u[t] ** 2
        + b.v[t] ** 2
        + b.x[t] * b.derivative(b.u)[t]
        + b.y[t] * b.derivative(b.v)[t]
        == 0
    )  # fmt: skip


@pytest.mark.parametrize("constraint", [acceleration, accelerations_as_derivatives])
def test_index_one_passes(constraint: Any) -> None:
    pendulum(constraint).swing.check()


@pytest.mark.parametrize("constraint", [position, velocity])
def test_a_higher_index_is_refused_with_the_equation_and_the_unknown(constraint: Any) -> None:
    m = pendulum(constraint)
    with pytest.raises(ModelError) as caught:
        m.swing.check()
    message = str(caught.value)
    assert f"equation '{constraint.__name__}' holds no derivative and no algebraic to determine" in message
    assert "nothing determines unknown 'tension'" in message
    assert "allow_higher_index=True" in message


@pytest.mark.casadi
def test_an_expert_may_allow_it_and_gets_the_motion() -> None:
    m = pendulum(velocity, allow_higher_index=True, elements=20, stages=3)
    rcp.solve(m, options={"tol": 1e-11}).raise_for_status()
    b, end = m.swing, 1.0
    energy = (b.u[end].value ** 2 + b.v[end].value ** 2) / 2 + GRAVITY * b.y[end].value
    assert energy == pytest.approx(0.0, abs=1e-4)
    assert b.x[end].value ** 2 + b.y[end].value ** 2 == pytest.approx(LENGTH**2, abs=1e-6)


def test_the_permission_survives_clone_and_pickle() -> None:
    m = pendulum(position, allow_higher_index=True)
    m.clone().swing.check()
    pickle.loads(pickle.dumps(m)).swing.check()


def test_equations_that_share_an_unknown_are_named_with_it() -> None:
    _, b = one_phase(elements=2, x=rcp.State(initial=0), y=rcp.Algebraic(), z=rcp.Algebraic())
    b.ode(lambda b, t: {b.x: b.z[t]})

    b.residual(lambda b, t: {"left": b.y[t] == b.x[t], "right": b.y[t] == 2 * b.x[t]}, name="springs")
    with pytest.raises(ModelError, match=r"equations 'springs\[left\]', 'springs\[right\]' share only unknown"):
        b.check()


def no_motion(b: Any, t: float) -> Any:
    return b.v[t] == 0


def newton(b: Any, t: float) -> Any:
    return b.derivative(b.v)[t] == b.u[t] - b.x[t]


def test_a_kept_derivative_is_an_unknown_like_any_other() -> None:
    def pushed(residual: Any) -> Any:
        m, b = one_phase(elements=2, x=rcp.State(initial=0), v=rcp.State(initial=0, derivative_bounds=(-1, 1)))
        b.f, b.u = rcp.Algebraic(), rcp.Control()
        b.ode(lambda b, t: {b.x: b.v[t], b.v: b.f[t] + b.u[t]})
        b.residual(residual)
        return m.p

    with pytest.raises(ModelError, match="equation 'no_motion' holds no derivative"):
        pushed(no_motion).check()
    b = pushed(newton)
    b.check()
    structure = PointStructure(b, middle_point(b.record))
    assert list(structure.unknowns) == ["derivative of v", "f"]
    assert list(structure.rows) == ["ode of v", "newton"]


@pytest.mark.parametrize("package", ["ours", "pyomo"])
def test_a_pair_determines_an_algebraic_that_it_holds(package: str) -> None:
    _, b = one_phase(elements=2, x=rcp.State(initial=1), force=rcp.Algebraic(bounds=(0, None)))
    b.ode(lambda b, t: {b.x: b.force[t]})
    if package == "ours":
        b.complementarity(lambda b, t: rcp.complements(b.x[t] >= 0, b.force[t] >= 0), name="contact")
    else:
        b.contact = PyomoComplementarity(b.points, rule=lambda b, t: pyomo_complements(b.x[t] >= 0, b.force[t] >= 0))
    b.check()
    structure = PointStructure(b, middle_point(b.record))
    assert structure.undetermined == []
    assert list(structure.helpers) == ["contact"]


def test_an_equation_that_determines_a_control_passes() -> None:
    """A feedback law stated as a residual: unusual, since the control is then an algebraic, but nothing is wrong."""
    _, b = one_phase(elements=2, x=rcp.State(initial=1), u=rcp.Control(), z=rcp.Algebraic(bounds=(0, None)))
    b.ode(lambda b, t: {b.x: b.u[t] + b.z[t]})

    b.residual(lambda b, t: b.u[t] == -b.x[t], name="feedback")
    b.complementarity(lambda b, t: rcp.complements(b.x[t] >= 0, b.z[t] >= 0), name="stop")
    b.check()
    structure = PointStructure(b, middle_point(b.record))
    assert structure.leftover_rows == ["feedback"]
    assert not structure.has_higher_index


@pytest.mark.parametrize("way", ["pair", "equality"])
def test_what_determines_an_algebraic_may_skip_the_middle(way: str) -> None:
    _, b = one_phase(elements=4, x=rcp.State(initial=1), force=rcp.Algebraic(bounds=(0, None)))
    b.ode(lambda b, t: {b.x: b.force[t] - b.x[t]})
    middle = middle_point(b.record)
    kept = [t for t in b.points if t != middle]
    if way == "equality":
        b.beside = pyo.Constraint(kept, rule=lambda b, t: b.force[t] == b.x[t])
    else:
        b.complementarity(lambda b, t: [] if t == middle else rcp.complements(b.force[t] >= 0, b.x[t] >= 0))
    b.check()
