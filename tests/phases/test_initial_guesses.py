"""Guesses given after the declaration: what they set, what they leave alone, and what they refuse."""

import math
from typing import Any

import numpy as np
import pytest
from harness.phases import SCHEMES, one_phase
from hypothesis import given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import InitialGuessError
from pyrobocop_pyomo.phases.phase_values import PhaseValues

# Not the midpoint rule: at ends of elements its lines have no values of other polynomials.
ALL = [each for each in SCHEMES if each.name != "gauss(1)"] + [
    rcp.schemes.lobatto(4),
    rcp.schemes.find_scheme("explicit_euler"),
]
schemes = st.sampled_from(ALL)
meshes = st.lists(st.floats(0.05, 1), min_size=1, max_size=5).map(
    lambda widths: [0.0, *(np.cumsum(widths) / np.sum(widths)).tolist()[:-1], 1.0]
)


def phase(scheme: Any = "radau", mesh: Any = None, duration: Any = 1.0, **declarations: Any) -> Any:
    return one_phase(duration=duration, mesh=mesh, scheme=scheme, **declarations)[1]


def values(variable: Any) -> list[float]:
    return [variable[t].value for t in variable]


@given(before=schemes, after=schemes, first=meshes, second=meshes, data=st.data())
def test_a_polynomial_is_the_same_on_every_other_grid(
    before: Any, after: Any, first: Any, second: Any, data: st.DataObject
) -> None:
    degree = len(before.state_nodes) - 1
    numbers = st.floats(-2, 2)
    state = np.polynomial.Polynomial(data.draw(st.lists(numbers, min_size=1, max_size=degree + 1)))
    control = np.polynomial.Polynomial(data.draw(st.lists(numbers, min_size=1, max_size=before.stages)))
    source = phase(
        before,
        first,
        x=rcp.State(initial_guess=state),
        u=rcp.Control(initial_guess=control),
        k=rcp.Parameter(initial_guess=2.5),
    )
    target = phase(after, second, x=rcp.State(), u=rcp.Control(), k=rcp.Parameter())
    target.initialize(source.trajectory())
    np.testing.assert_allclose(values(target.x), [state(t) for t in target.time], atol=1e-10)
    np.testing.assert_allclose(values(target.u), [control(t) for t in target.points], atol=1e-10)
    assert target.k.value == 2.5


@pytest.mark.parametrize("scheme", ALL, ids=str)
def test_a_trajectory_on_its_own_grid_changes_nothing(scheme: Any) -> None:
    """Also where a control jumps at element ends, which rounding must not mix up."""
    rng = np.random.default_rng(0)
    mesh = np.linspace(0, 1, 8).tolist()
    options: dict[str, Any] = {"x": rcp.State(), "u": rcp.Control()}
    b = phase(scheme, mesh, **options)
    for variable in b.u.values():
        variable.value = float(rng.normal())
    b.initialize(x=lambda t: t * (1 - t))
    for duration in (1.0, 1 / 3, rcp.Duration(bounds=(0.1, 2))):
        stretched = duration if isinstance(duration, float) else 1.0
        same = phase(scheme, [t * stretched for t in mesh], duration, **options)
        same.initialize(b.trajectory())
        np.testing.assert_allclose(values(same.x), values(b.x), atol=1e-12)
        np.testing.assert_allclose(values(same.u), values(b.u), atol=1e-12)


def test_a_horizon_is_stretched_onto_another() -> None:
    short = phase(duration=1.0, x=rcp.State(initial_guess=lambda t: 3 * t))
    long = phase(duration=4.0, x=rcp.State())
    dx = long.derivative(long.x)
    long.initialize(short.trajectory())
    assert values(long.x) == pytest.approx([3 * t / 4 for t in long.time])
    assert values(dx) == pytest.approx([0.75] * len(dx))
    free = phase(duration=rcp.Duration(bounds=(0.5, 2)), x=rcp.State())
    free.derivative(free.x)
    free.initialize(phase(duration=1.6, x=rcp.State(initial_guess=lambda t: 3 * t)).trajectory())
    assert free.duration.value == pytest.approx(1.6)
    assert values(free.x_derivative) == pytest.approx([3.0] * 30)
    free.initialize(phase(duration=7.0, x=rcp.State()).trajectory())
    assert free.duration.value == 2.0  # its bound
    free.duration.fix(1.1)
    free.initialize(short.trajectory())
    assert free.duration.value == 1.1


def test_held_controls_take_the_middle_of_their_elements() -> None:
    held = rcp.Control(parametrization="piecewise_constant")
    b = phase(mesh=[0, 0.5, 1.0], u=held)
    b.initialize(u=lambda t: t)
    assert values(b.u_per_element) == [0.25, 0.75]
    b.initialize(u=[1, 2])
    finer = phase(mesh=[0, 0.25, 0.5, 0.75, 1.0], u=held)
    finer.initialize(b.trajectory())
    assert values(finer.u_per_element) == pytest.approx([1, 1, 2, 2])


def test_by_name_by_variable_and_over_a_trajectory() -> None:
    b = phase(duration=rcp.Duration(bounds=(0.5, 2)), x=rcp.State(), y=rcp.State(), k=rcp.Parameter(bounds=(0, 1)))
    b.derivative(b.x)
    b.initialize({b.x: math.sin, "k": 7}, duration=1.5, x_derivative=-1)
    assert values(b.x) == [math.sin(t) for t in b.time]
    assert (b.k.value, b.duration.value, set(values(b.x_derivative)), set(values(b.y))) == (1, 1.5, {-1.0}, {0.0})
    b.initialize(b.trajectory(), y=3)
    assert set(values(b.y)) == {3.0}


KINDS = {"start": rcp.Start, "duration": rcp.Duration, "x": rcp.State, "u": rcp.Control, "k": rcp.Parameter}


@given(guess=st.floats(1e-3, 9))
def test_a_declared_guess_outside_bounds_moves_to_the_nearest(guess: float) -> None:
    b = phase(**{name: kind(bounds=(1, 2), initial_guess=guess) for name, kind in KINDS.items()})
    assert {number for name in KINDS for number in values(getattr(b, name))} == {np.clip(guess, 1, 2)}


def test_what_is_fixed_stays_and_bounds_are_respected() -> None:
    b = phase(x=rcp.State(initial=0, final=(2, 3), bounds=(-1, 4)), u=rcp.Control(bounds=(0, 1)))
    b.u[b.points.first()].fix(0.5)
    bounds = [(v.lb, v.ub, v.fixed) for v in (*b.x.values(), *b.u.values())]
    b.initialize(x=9, u=-1)
    assert values(b.x)[0] == 0
    assert set(values(b.x)[1:-1]) == {4.0}
    assert values(b.x)[-1] == 3
    assert values(b.u)[0] == 0.5
    assert set(values(b.u)[1:]) == {0.0}
    assert bounds == [(v.lb, v.ub, v.fixed) for v in (*b.x.values(), *b.u.values())]


@pytest.mark.parametrize(
    ("initial", "final", "line"),
    [
        (0, 3, (0, 3)),
        (1, None, (1, 1)),
        (None, 2, (2, 2)),
        (None, None, (7, 7)),
        (0, (1, 2), (0, 1)),
        ((-1, 1), 5, (1, 5)),
        ((0, 1), (3, 4), (1, 3)),
        ((0, 4), (3, 6), (4, 4)),
    ],
)
def test_straight_lines(initial: Any, final: Any, line: tuple[float, float]) -> None:
    b = phase(
        rcp.schemes.gauss_legendre(2),
        x=rcp.State(initial=initial, final=final, initial_guess=7),
        u=rcp.Control(initial_guess=5),
    )
    b.derivative(b.x)
    b.initialize_straight_lines()
    start, end = line
    assert values(b.x) == pytest.approx([start + (end - start) * t for t in b.time])
    if start != 7:  # a state without an end of its own keeps its initial guess, and its derivative too
        assert values(b.x_derivative) == pytest.approx([end - start] * len(b.points), abs=1e-12)
    assert set(values(b.u)) == {5.0}


@pytest.mark.parametrize(
    ("guess", "message"),
    [
        ({"z": 1}, r"phase 'p': an initial guess is given for 'z', which it does not have; it has x, u"),
        ({"duration": 2}, "for 'duration', which it does not have"),
        ({"u": float("nan")}, "'u': value 0 of the initial guess is nan"),
        ({"u": "fast"}, "'u': the initial guess is not made of numbers"),
        (5.0, "a trajectory or a mapping of names to initial guesses, not a float"),
    ],
)
def test_what_does_not_fit_is_named_and_nothing_is_set(guess: Any, message: str) -> None:
    b = phase(x=rcp.State(initial_guess=1), u=rcp.Control(initial_guess=1))
    with pytest.raises(InitialGuessError, match=message):
        b.initialize(guess, u=2) if not isinstance(guess, dict) else b.initialize({"x": 4, **guess})
    assert set(values(b.x)) == set(values(b.u)) == {1.0}


def test_a_guess_is_given_once_by_a_phase_of_its_own() -> None:
    b, other = phase(x=rcp.State()), phase(x=rcp.State(), y=rcp.State())
    with pytest.raises(InitialGuessError, match="'x', which it does not have; it has x"):
        b.initialize({other.x: 1})
    with pytest.raises(InitialGuessError, match="twice, by name and by variable"):
        b.initialize({b.x: 1}, x=2)
    with pytest.raises(
        InitialGuessError, match=r"trajectory 'p' has y; the phase has x\. An initial guess needs a name in common"
    ):
        b.initialize(phase(y=rcp.State()).trajectory())
    with pytest.raises(InitialGuessError, match=r"'duration': the initial guess is -1; it must be positive"):
        phase(duration=rcp.Duration(bounds=(1, 2))).initialize(duration=-1)


@given(schemes, meshes)
def test_without_a_guess_a_state_stays_at_its_stated_end(scheme: Any, mesh: Any) -> None:
    b = phase(
        scheme,
        mesh,
        both=rcp.State(initial=1.0, final=3.0),
        first=rcp.State(initial=2.0, bounds=(None, 2.5)),
        last=rcp.State(final=-1.0),
        ranges=rcp.State(initial=(0.0, 1.0), final=(3.0, 4.0)),
        none=rcp.State(),
        given=rcp.State(initial=1.0, final=3.0, initial_guess=0.5),
    )
    assert set(values(b.both)[:-1]) == {1.0}
    assert set(values(b.ranges)[1:-1]) <= {0.0}
    assert (set(values(b.first)), set(values(b.last)), set(values(b.none))) == ({2.0}, {-1.0}, {0.0})
    assert set(values(b.given)[1:-1]) <= {0.5}


# --------------------------------------------------------------------
# The values of a phase as arrays and back, whatever its signals are.


KNOTS = (0.0, 0.5, 2.0)


def model(scheme: Any = "radau", stages: int = 2) -> Any:
    m, b = one_phase(duration=2, mesh=[0, 0.3, 0.5, 1.2, 2.0], scheme=scheme, stages=stages)
    b.x = rcp.State(initial=0, initial_guess=lambda t: t**2, derivative_bounds=(-9, 9))
    b.z = rcp.Algebraic(initial_guess=lambda t: 1 + t)
    b.u = rcp.Control(initial_guess=lambda t: 3 * t)
    b.constant = rcp.Control(parametrization="piecewise_constant", knots=KNOTS, initial_guess=[4, 5])
    b.linear = rcp.Control(parametrization="piecewise_linear", knots=KNOTS, initial_guess=[0, 1, -2])
    b.k = rcp.Parameter(initial_guess=7)
    b.ode(lambda b, t: {b.x: b.u[t] + b.constant[t] + b.linear[t] + b.k * b.z[t]})
    return m


def test_values_are_read_set_and_sampled_where_they_live() -> None:
    m = model()
    b = m.p
    values = PhaseValues(b)
    before = values.read()
    assert {name: len(numbers) for name, numbers in before.items()} == {
        "x": 9, "z": 8, "u": 8, "constant": 2, "linear": 3, "x_derivative": 8
    }  # fmt: skip
    trajectory = values.trajectory(before)
    sampled = values.sampled(trajectory, lambda t: t)
    for name in ("x", "z", "u", "constant", "linear"):
        np.testing.assert_allclose(sampled[name], before[name], atol=1e-12)
    values.set({name: 2 * numbers for name, numbers in before.items()})
    assert b.x[0.0].value == 0  # fixed
    assert b.constant_per_interval[1].value == 10
    assert b.linear_at_knots[2].value == -4
    values.set(before)
    np.testing.assert_allclose(b.trajectory()([0.1, 1.1, 1.9])["linear"], np.interp([0.1, 1.1, 1.9], KNOTS, [0, 1, -2]))


@pytest.mark.parametrize(("scheme", "stages"), [("radau", 1), ("radau", 3), ("gauss", 2)])
def test_nodes_know_what_a_signal_is_at_any_time(scheme: str, stages: int) -> None:
    m = model(scheme, stages)
    b = m.p
    trajectory = b.trajectory()
    for name in ("z", "u", "constant", "linear"):
        nodes = b.record.nodes(name)
        variables = nodes.variables(b)
        for time in (0.0, 0.1, 0.3, 0.5, 0.9, 1.2, 2.0):
            value = sum(weight * variables[i].value for i, weight in nodes.weights_at(time))
            assert value == pytest.approx(trajectory(time)[name], abs=1e-9)
