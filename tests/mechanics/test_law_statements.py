"""What a law states on a phase, without a solver: values that satisfy it, names, copies, refusals."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import with_phase
from hypothesis import given, settings
from hypothesis import strategies as st
from pyomo.util.check_units import assert_units_consistent

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError

LAWS = rcp.mechanics
POINTS = 12
# Values of a quantity over all points of one phase: the law is asked at each of them.
series = st.lists(st.floats(-3, 3).map(lambda x: round(x, 3)), min_size=POINTS, max_size=POINTS).map(np.array)
positives = st.floats(0.01, 5).map(lambda x: round(x, 3))
few = settings(max_examples=6, deadline=None)


def phase_with(**values: np.ndarray) -> rcp.PhaseBlock:
    """Controls that are fixed to these values at the points."""
    _, b = with_phase("phase", "law", duration=1.0, elements=POINTS, scheme="implicit_euler")
    for name, numbers in values.items():
        b.declare(name, rcp.Control(initial_guess=numbers))
        b.component(name).fix()
    return b


def signal_at_start(law: Any, **values: np.ndarray) -> np.ndarray:
    """The signal's initial guess, which has to satisfy the law."""
    b = phase_with(**values)
    b.law = law
    assert_satisfied(b)
    return np.array([pyo.value(b.law[t]) for t in b.points])


def assert_satisfied(b: rcp.PhaseBlock) -> None:
    verified = b.trajectory().verify()
    assert max(verified.natural_residual, verified.product, verified.equations, verified.bounds) <= 1e-12


def reads(name: str) -> Callable[[Any, float], Any]:
    return lambda b, t: getattr(b, name)[t]


# ---------------------------------------------------------------- closed formulas


@few
@given(x=series, y=series, lower=st.floats(-2, 2), width=positives)
def test_nonsmooth_functions_are_their_closed_formulas(
    x: np.ndarray, y: np.ndarray, lower: float, width: float
) -> None:
    s, upper = reads("x"), lower + width
    x[0] = 0.0

    def law(made: Any) -> Any:
        return pytest.approx(signal_at_start(made, x=x, y=y), abs=1e-12)

    assert np.abs(x) == law(LAWS.AbsoluteValue(s))
    larger = (x + y + signal_at_start(LAWS.AbsoluteValue(lambda b, t: b.x[t] - b.y[t]), x=x, y=y)) / 2
    assert np.maximum(x, y) == pytest.approx(larger, abs=1e-12)
    above = signal_at_start(LAWS.AbsoluteValue(lambda b, t: b.x[t] - lower), x=x)
    below = signal_at_start(LAWS.AbsoluteValue(lambda b, t: b.x[t] - upper), x=x)
    assert np.clip(x, lower, upper) == pytest.approx((lower + upper + above - below) / 2, abs=1e-12)
    assert np.heaviside(x, 0.5) == law(LAWS.Step(s))


@few
@given(gap=series, rate=series, stiffness=positives, damping=positives)
def test_a_soft_wall_is_a_spring_and_a_damper_that_never_pull(
    gap: np.ndarray, rate: np.ndarray, stiffness: float, damping: float
) -> None:
    spring = signal_at_start(LAWS.SoftWall(reads("gap"), stiffness), gap=gap)
    assert spring == pytest.approx(np.maximum(0, -stiffness * gap))
    damped = LAWS.SoftWall(lambda b, t: b.gap[t] + damping / stiffness * b.rate[t], stiffness)
    expected = np.maximum(0, -stiffness * gap - damping * rate)
    assert signal_at_start(damped, gap=gap, rate=rate) == pytest.approx(expected)


@few
@given(slip=series, normal=positives, coefficient=positives)
def test_friction_opposes_slip_with_full_strength(slip: np.ndarray, normal: float, coefficient: float) -> None:
    force = signal_at_start(LAWS.CoulombFriction(reads("w"), normal, coefficient), w=slip)
    assert force == pytest.approx(-coefficient * normal * np.sign(slip))


def test_the_force_of_a_sticking_or_slipping_finger_leads_to_its_slip() -> None:
    b = phase_with(push=np.full(POINTS, 1.0), along=np.linspace(-0.3, 0.3, POINTS))
    b.slip = LAWS.CoulombSlip(b.push, b.along, coefficient=0.3, fastest=2.0)
    assert_satisfied(b)
    first, last = b.points.first(), b.points.last()
    # At the edge of the cone it slips as fast as it likes, in the direction of its force; elsewhere it sticks.
    b.slip_forward[last].set_value(1.5)
    b.slip_backward[first].set_value(0.5)
    assert_satisfied(b)
    assert [pyo.value(b.slip[t]) for t in (first, last)] == [-0.5, 1.5]
    b.slip_forward[first].set_value(0.2)
    assert b.trajectory().verify().natural_residual == pytest.approx(0.2)


# ---------------------------------------------------------------- names, copies, pickles


def soft_floor(b: Any, t: float) -> Any:
    """A rule that a pickle can hold."""
    return b.x[t]


def rates(b: Any, t: float) -> dict[Any, Any]:
    """Of a point above two walls."""
    return {b.x: b.wall[t] - b.ceiling[t]}


def walled(b: Any, index: int = 0) -> None:
    b.k = rcp.Parameter(bounds=(1, 100), initial_guess=10)
    b.x = rcp.State(initial=-1.0 - index)
    b.wall = LAWS.SoftWall(soft_floor, stiffness=b.k)
    b.ceiling = LAWS.SoftWall(lambda b, t: 1 - b.x[t], stiffness=20)
    b.ode(rates)


def test_a_clone_reads_its_own_parameters() -> None:
    m = pyo.ConcreteModel()
    m.top = pyo.Param(initialize=2.0, mutable=True)
    m.phase = rcp.PhaseBlock(duration=1.0, elements=2, scheme="implicit_euler", rule=walled)
    m.phase.size = LAWS.SoftWall(m.phase.x, stiffness=lambda b, t: m.top + 9)
    m.phase.less = LAWS.AbsoluteValue(lambda b, t: m.phase.x[t] - m.top)  # through a closure
    m.phase.x[1.0].set_value(-1.0)
    m.phase.wall[1.0].set_value(0.0)
    twin = m.clone()

    before = str(twin.phase.trajectory().verify())
    m.top.set_value(-5.0)
    m.phase.k.set_value(2.0)
    assert str(twin.phase.trajectory().verify()) == before
    twin.top.set_value(-5.0)
    twin.phase.k.set_value(2.0)
    assert str(twin.phase.trajectory().verify()) == str(m.phase.trajectory().verify()) != before


def test_nothing_stays_after_a_refusal() -> None:
    b = phase_with(x=np.ones(POINTS))
    before = set(b.component_map())
    b.component("x").unfix()
    with pytest.raises(
        ModelError, match=r"SoftWall .declared at test_law_statements.py:\d+.: gap at t = 0.0833333 gives None"
    ):
        b.wall = LAWS.SoftWall(lambda b, t: None, stiffness=1)
    b.add_component("wall_pairs", pyo.Param(initialize=0))
    with pytest.raises(ModelError, match="wall_pairs"):
        b.wall = LAWS.SoftWall(reads("x"), stiffness=1)
    assert set(b.component_map()) == {*before, "wall_pairs"}


def test_units_follow_from_the_rules() -> None:
    u = pyo.units
    m, b = with_phase("phase", duration=1.0, elements=2, time_units=u.s)
    b.x = rcp.State(initial=0.0, units=u.m)
    b.v = rcp.State(initial=0.0, units=u.m / u.s)
    b.wall = LAWS.SoftWall(b.x, stiffness=100 * u.N / u.m)
    b.stop = LAWS.HardWall(lambda b, t: 1 * u.m - b.x[t], units=u.N)
    b.floor = LAWS.CoulombFriction(b.v, normal=b.wall, coefficient=0.5)
    b.speed = LAWS.AbsoluteValue(b.v)

    @b.ode
    def newton(b, t):
        return {b.x: b.v[t], b.v: (b.wall[t] - b.stop[t] + b.floor[t] - 1 * u.N * u.s / u.m * b.speed[t]) / (2 * u.kg)}

    assert u.get_units(b.floor[1.0]) in (u.N, u.get_units(1 * u.N))
    for rows in m.component_objects(pyo.Constraint):
        assert_units_consistent(rows)
    for pair in rcp.active_pairs(m):
        assert_units_consistent(pair.a)
        assert_units_consistent(pair.b)


# ---------------------------------------------------------------- refusals

REFUSED = {
    "stiffness": (lambda: LAWS.SoftWall(soft_floor, stiffness=-1), "SoftWall .*stiffness = -1; expected a positive"),
    "not a number": (lambda: LAWS.SoftWall(soft_floor, stiffness=math.nan), "stiffness = nan; expected a finite"),
    "a string": (lambda: LAWS.AbsoluteValue("x"), "of = 'x'; expected a finite number, a rule"),
    "coefficient": (lambda: LAWS.CoulombFriction(soft_floor, 1, 0), "coefficient = 0; expected a positive"),
    "pull": (lambda: LAWS.CoulombFriction(soft_floor, -1, 0.5), "normal = -1; expected zero or"),
    "fastest": (lambda: LAWS.CoulombSlip(1, 1, 0.3, fastest=soft_floor), "it is a bound"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_bad_constants_are_refused_by_name_where_they_are_given(case: str) -> None:
    make, message = REFUSED[case]
    with pytest.raises(ModelError, match=message):
        make()


def test_a_component_of_one_point_or_of_another_model_is_refused() -> None:
    b = phase_with(x=np.ones(POINTS))
    other = phase_with(x=np.ones(POINTS))
    for given_, message in (
        (b.x[1.0], "Write it as a rule"),
        (2 * b.x[1.0], "to one point"),
        (other.x, "not on the model"),
    ):
        with pytest.raises(ModelError, match=message):
            b.size = LAWS.AbsoluteValue(given_)
    m = pyo.ConcreteModel()
    m.phases = rcp.PhaseBlock([0, 1], duration=1.0)
    with pytest.raises(ModelError, match="one phase at a time"):
        m.phases.size = LAWS.AbsoluteValue(reads("x"))
    with pytest.raises(ModelError, match=r"write AbsoluteValue\(\)"):
        b.size = LAWS.AbsoluteValue
    b.size = LAWS.AbsoluteValue(b.x)
    with pytest.raises(ModelError, match="taken"):
        b.size = LAWS.AbsoluteValue(b.x)
