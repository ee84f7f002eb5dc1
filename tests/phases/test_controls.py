"""Controls in every parametrization: what they look like at a point, and that no row ties them down."""

import itertools
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.checked import unchanged
from harness.phases import contents, integrator, mass, one_phase, undetermined
from pyomo.core.expr.visitor import identify_variables

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError

MESH = [0.0, 0.3, 0.5, 1.2, 2.0]
# The first stage is the start of an element, and the last one not its end.
LEFT = rcp.schemes.Scheme.from_points("left", [0, 0.3, 0.6])


def cart(scheme: str = "radau", stages: int = 3, **control: Any) -> pyo.ConcreteModel:
    rest = {"x": {"initial": 0, "final": 1}, "v": {"initial": 0, "final": 0}}
    m, b = mass(**rest, u=control, duration=2, mesh=MESH, scheme=scheme, stages=stages)
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    return m


@pytest.mark.parametrize("scheme", ["radau", "gauss", "lobatto", LEFT])
@pytest.mark.parametrize("knots", [None, [0, 0.5, 2]])
def test_a_linear_control_is_the_line_between_its_knots(scheme: Any, knots: list[float] | None) -> None:
    b = cart(scheme, parametrization="piecewise_linear", knots=knots).p
    times = knots or MESH
    for value, knot in zip(b.u_at_knots.values(), times, strict=True):
        value.set_value(np.sin(3 * knot))
    for t in b.points:
        assert pyo.value(b.u[t]) == pytest.approx(np.interp(t, times, np.sin(3 * np.array(times))))
    fine = np.linspace(0, 2, 41)
    for state in (b.x, b.v):
        for each in state.values():
            each.set_value(0.0)
    np.testing.assert_allclose(b.trajectory()(fine)["u"], np.interp(fine, times, np.sin(3 * np.array(times))))


@pytest.mark.parametrize("parametrization", ["piecewise_constant", "piecewise_linear"])
@pytest.mark.parametrize("knots", [None, [0, 0.5, 2]])
def test_a_piecewise_control_adds_no_rows_and_leaves_nothing_undetermined(
    parametrization: str, knots: list[float] | None
) -> None:
    plain = cart()
    m = cart(parametrization=parametrization, knots=knots)
    assert len(list(m.component_data_objects(pyo.Constraint))) == len(
        list(plain.component_data_objects(pyo.Constraint))
    )
    variables = {id(v) for e in m.p.u.values() for v in identify_variables(e if e.is_expression_type() else e + 0)}
    assert len(variables) == len(knots or MESH) - (parametrization == "piecewise_constant")
    assert not undetermined(m)
    m.p.check()


def test_a_control_is_held_between_its_knots() -> None:
    b = cart(parametrization="piecewise_constant", knots=[0, 0.5, 2]).p
    assert [b.u_per_interval[0] is b.u[t] for t in b.points] == [t <= 0.5 for t in b.points]


@pytest.mark.ipopt
@pytest.mark.parametrize(
    ("control", "changes", "times"),
    [
        ({"parametrization": "piecewise_linear"}, "u_at_knots", MESH),
        ({"parametrization": "piecewise_constant"}, "u_per_element", (np.array(MESH[1:]) + MESH[:-1]) / 2),
        ({}, "u", None),
    ],
)
def test_rate_bounds_hold_and_the_rate_is_what_they_bound(control: dict, changes: str, times: Any) -> None:
    m = cart(rate_bounds=(-1.0, 1.2), **control)
    m.p.x[2.0].unfix()
    m.p.v[2.0].unfix()
    m.cost.set_value(m.p.integral(lambda b, t: (b.u[t] - 5 * (-1) ** int(4 * t)) ** 2))
    assert rcp.solve(m).solved
    values = np.array([each.value for each in m.p.component(changes).values()])
    rates = np.diff(values) / np.diff(list(m.p.points) if times is None else times)
    # Ipopt keeps rows to 1e-8, and the shortest step here is 0.03.
    assert rates.min() >= -1.0 - 1e-6
    assert rates.max() <= 1.2 + 1e-6
    assert np.abs(rates).max() > 0.99  # they are reached, so they were needed
    seen = {round(pyo.value(rate), 6) for rate in m.p.rate_of(m.p.u).values()}
    assert seen == {round(rate, 6) for rate in rates}


@pytest.mark.ipopt
def test_rate_bounds_are_in_real_time_when_the_duration_is_free() -> None:
    m, b = integrator(
        x={"initial": 0, "final": 1},
        u={"bounds": (0, 5), "parametrization": "piecewise_linear", "rate_bounds": (None, 2.0)},
        duration=rcp.Duration(bounds=(0.5, 9), initial_guess=3),
        elements=8,
    )
    m.start = pyo.Constraint(expr=b.u_at_knots[0] == 0)
    m.T = pyo.Objective(expr=b.duration)
    assert rcp.solve(m).objective == pytest.approx(1.0, abs=1e-6)  # u = 2 t, x = t^2


def test_a_rate_cost_is_the_integral_of_the_squared_slope() -> None:
    m = cart(parametrization="piecewise_linear")
    cost = m.p.integral(lambda b, t: b.rate_of(b.u)[t] ** 2)
    values = [1.0, -1.0, 0.5, 2.0, 2.5]
    for each, number in zip(m.p.u_at_knots.values(), values, strict=True):
        each.set_value(number)
    widths = np.diff(MESH)
    assert pyo.value(cost) == pytest.approx(np.sum(np.diff(values) ** 2 / widths))
    assert m.p.rate_of("u") == m.p.rate_of(m.p.u)


@pytest.mark.ipopt
def test_saved_and_loaded_the_lines_stay_lines(tmp_path: Any) -> None:
    m = cart("implicit_euler", None, parametrization="piecewise_linear")
    rcp.solve(m)
    trajectory = m.p.trajectory()
    back = rcp.Trajectory.load(trajectory.save(tmp_path / "linear"))
    fine = np.linspace(0, 2, 33)
    np.testing.assert_array_equal(back(fine)["u"], trajectory(fine)["u"])
    assert len(set(np.round(trajectory(np.linspace(0, 0.3, 9))["u"], 9))) == 9


WRONG = {
    "knot off the mesh": ({"knots": [0, 0.4, 2]}, r"knot 0.4 is no element boundary; the nearest is (0.3|0.5)"),
    "knots without the ends": ({"knots": [0.3, 2]}, "must increase from 0 to 2, both included"),
    "rate bounds that cross": ({"rate_bounds": (1, -1)}, "the lower of its rate bounds, 1, exceeds the upper"),
    "rate bounds of text": ({"rate_bounds": "fast"}, "rate bounds = 'fast'; expected a pair"),
}


@pytest.mark.parametrize(
    ("case", "parametrization"), list(itertools.product(WRONG, ["piecewise_constant", "piecewise_linear"]))
)
def test_a_control_that_does_not_fit_is_refused_and_leaves_nothing(case: str, parametrization: str) -> None:
    options, message = WRONG[case]
    m, _ = one_phase(duration=2, mesh=MESH)
    message = rf"phase 'p': control 'u' \(declared at test_controls.py:\d+\): (?!.*declared at).*{message}"
    with unchanged(contents, m), pytest.raises(ModelError, match=message):
        m.p.u = rcp.Control(parametrization=parametrization, **options)


def test_what_does_not_go_together_is_refused() -> None:
    with pytest.raises(ModelError, match="knots belong to a piecewise control"):
        rcp.Control(knots=[0, 1])
    m, _ = one_phase(duration=2, scheme="trapezoid")
    with pytest.raises(ModelError, match="share a collocation point, .* Choose 'piecewise_linear'"):
        m.p.u = rcp.Control(parametrization="piecewise_constant")
    m.r = rcp.PhaseBlock(duration=2, scheme=rcp.schemes.Scheme.from_points("left", [0, 0.5]))
    m.r.u = rcp.Control()
    m.r.x = rcp.State(initial=0)
    m.r.ode(lambda b, t: {b.x: b.u[t]})
    with pytest.raises(ModelError, match="phase 'r': control 'u' .*the stage at c = 0 has weight 0 .* Choose"):
        m.r.check()
    m.q = rcp.PhaseBlock(duration=2, elements=4, free_element_widths=(0.5, 2))
    with pytest.raises(ModelError, match="knots of its own do not go with free element widths"):
        m.q.u = rcp.Control(parametrization="piecewise_constant", knots=[0, 0.5, 1])
    m.p.x = rcp.State()
    with pytest.raises(ModelError, match="phase 'p': 'x' is no control; its controls are none"):
        m.p.rate_of(m.p.x)
