"""Simulation with pairs follows motions known in closed form, at the order of its steps, and gains no energy."""

import dataclasses
import math
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.checked import solution
from harness.phases import one_phase
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import InitialGuessError, SimulationFailed

G = 9.81
MODELS: list[Any] = []


def phase(elements: int = 50, duration: Any = 1.0, **options: Any) -> Any:
    m, _ = one_phase(**{"duration": duration, "elements": elements, "scheme": "implicit_euler", **options})
    m.p.keep_alive = pyo.Param(initialize=0)
    MODELS.append(m)  # blocks hold their model weakly
    return m.p


def ball(elements: int, duration: Any = 1.5, force_first: bool = False, start: float = 1.0, **options: Any) -> Any:
    b = phase(elements, duration, **options)
    b.x, b.v = rcp.State(initial=start), rcp.State(initial=0.0)
    b.f = rcp.Algebraic(bounds=(0, None))
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.f[t] - G})

    def floor(b: Any, t: float) -> Any:
        sides = (b.f[t] >= 0, b.x[t] >= 0)
        return rcp.complements(*(sides if force_first else sides[::-1]))

    b.complementarity(floor)
    return b


def bouncing(e: float, times: Any) -> Any:
    """Height of a ball that falls from 1 m."""
    heights = []
    for time in times:
        begin, speed = math.sqrt(2 / G), e * math.sqrt(2 * G)
        if time < begin:
            heights.append(1 - G * time**2 / 2)
            continue
        while speed > 1e-9 and time > begin + 2 * speed / G:
            begin, speed = begin + 2 * speed / G, e * speed
        heights.append(max(speed * (time - begin) - G * (time - begin) ** 2 / 2, 0.0))
    return np.array(heights)


@pytest.mark.parametrize("force_first", [False, True])
@pytest.mark.parametrize("e", [0.0, 0.5, 0.8, 1.0])
def test_a_ball_bounces_as_newton_says_the_better_the_finer(e: float, force_first: bool) -> None:
    errors = []
    for elements in (20, 80):
        trajectory = ball(elements, force_first=force_first).simulate(restitution={"floor": e})
        errors.append(np.abs(trajectory.x - bouncing(e, trajectory.time)).mean())
    assert errors[1] < 0.55 * errors[0]
    assert errors[1] < 0.12


def test_without_restitution_the_rows_and_pairs_hold_and_nothing_on_the_model_changes() -> None:
    b = ball(40)
    before = [(v.name, v.value, v.fixed, v.stale) for v in b.component_data_objects(pyo.Var)]
    trajectory = b.simulate()
    assert [(v.name, v.value, v.fixed, v.stale) for v in b.component_data_objects(pyo.Var)] == before
    assert trajectory.verify().largest_violation < 1e-9
    assert set(trajectory.pairs) == {"floor"}
    b.initialize(trajectory)
    for row in b.component_data_objects(pyo.Constraint):
        assert abs(pyo.value(row.body) - pyo.value(row.upper)) < 1e-9


@given(e=st.floats(0, 1), elements=st.integers(4, 25), start=st.floats(0, 2))
@settings(max_examples=12, deadline=None)
def test_no_step_is_too_coarse_to_keep_the_ball_above_the_floor_and_its_energy(
    e: float, elements: int, start: float
) -> None:
    trajectory = ball(elements, start=start).simulate(restitution={"floor": e})
    energy = trajectory.v**2 / 2 + G * trajectory.x
    assert np.diff(energy).max() <= 1e-8
    assert trajectory.x.min() >= -1e-9
    assert np.diff(energy[1:]).min() >= -energy[0] - 1e-9


def test_a_free_duration_and_a_fixed_end_are_no_equations_of_a_simulation() -> None:
    b = ball(60, duration=rcp.Duration(bounds=(1, 3), initial_guess=1.5))
    b.x[1.0].fix(0.7)
    np.testing.assert_allclose(b.simulate().x, ball(60).simulate().x, atol=1e-9)
    assert b.x[1.0].fixed
    assert b.x[1.0].value == 0.7


def brick(friction: float, slope: float, speed: float, kind: type = rcp.Control) -> Any:
    """A brick on a slope: a normal force, friction either way, and the speed of slip, all for the pairs to find."""
    b = phase(40)
    b.s, b.v = rcp.State(initial=0.0), rcp.State(initial=speed)
    b.height, b.rise = rcp.State(initial=0.0), rcp.State(initial=0.0)
    b.normal, b.down, b.up, b.slip = (kind(bounds=(0, None)) for _ in range(4))

    @b.ode
    def newton(b, t):
        along = G * math.sin(slope) + b.down[t] - b.up[t]
        return {b.s: b.v[t], b.v: along, b.height: b.rise[t], b.rise: b.normal[t] - G * math.cos(slope)}

    @b.complementarity
    def coulomb(b, t):
        return {
            "touch": rcp.complements(b.height[t] >= 0, b.normal[t] >= 0),
            "down": rcp.complements(b.slip[t] + b.v[t] >= 0, b.down[t] >= 0),
            "up": rcp.complements(b.slip[t] - b.v[t] >= 0, b.up[t] >= 0),
            "cone": rcp.complements(friction * b.normal[t] - b.down[t] - b.up[t] >= 0, b.slip[t] >= 0),
        }

    return b


@pytest.mark.parametrize("kind", [rcp.Control, rcp.Algebraic])
@pytest.mark.parametrize(("friction", "speed"), [(0.5, 0.0), (0.2, 0.0), (0.5, 1.0), (0.5, -1.0), (0.2, -1.0)])
def test_a_brick_on_a_slope_sticks_and_slips(friction: float, speed: float, kind: type) -> None:
    slope = 0.3
    trajectory = brick(friction, slope, speed, kind).simulate()
    weight, hold = G * math.sin(slope), friction * G * math.cos(slope)
    v = speed
    expected = [speed]
    for width in np.diff(trajectory.time):  # sliding, a step that may end in rest, or rest
        free = v + width * weight
        v = free - math.copysign(min(abs(free), width * hold), free)
        expected.append(v)
    np.testing.assert_allclose(trajectory.v, expected, atol=1e-9)
    assert max(np.abs(sides.min(axis=0)).max() for sides in trajectory.pairs.values()) < 1e-9
    assert np.abs(trajectory.height).max() < 1e-12


def test_what_is_to_be_found_can_be_said() -> None:
    b = brick(0.5, 0.3, 0.0)
    forces = ["normal", "down", "up", "slip"]
    np.testing.assert_array_equal(b.simulate(unknown=forces).v, b.simulate().v)
    given_ = b.simulate(dict.fromkeys(forces, 0.0))  # then the pairs have nothing to find
    assert given_.v[-1] == pytest.approx(G * math.sin(0.3))
    with pytest.raises(InitialGuessError, match=r"at t = 0.025 .* 0 equations and 4 pairs for 3 unknowns .*\(normal"):
        b.simulate(unknown=forces[:3])
    with pytest.raises(InitialGuessError, match="'slip' is both given and to be found"):
        b.simulate({"slip": 0.0}, unknown=forces)
    with pytest.raises(InitialGuessError, match="'weight' is given to a simulation, but it is neither"):
        b.simulate(unknown=["weight"])
    with pytest.raises(InitialGuessError, match=r"restitution is given for 'floor', which is no pair of"):
        b.simulate(restitution={"floor": 0.5})
    with pytest.raises(InitialGuessError, match=r"restitution of 'coulomb\[touch\]' is 2; it is a number from 0 to 1"):
        b.simulate(restitution={"coulomb[touch]": 2})
    with pytest.raises(InitialGuessError, match="restitution is given, but no pair determines anything"):
        b.simulate(dict.fromkeys(forces, 0.0), restitution={"coulomb": 0.5})


def belt(elements: int, stages: int) -> Any:
    """A mass on a spring on a belt of speed 1, held by friction of strength 2: it sticks, and then swings."""
    b = phase(elements, 3.0, scheme="radau", stages=stages)
    b.x, b.v = rcp.State(initial=-0.5), rcp.State(initial=1.0)
    b.friction, b.slower, b.faster = rcp.Algebraic(), rcp.Algebraic(bounds=(0, None)), rcp.Algebraic(bounds=(0, None))
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.friction[t] - 4 * b.x[t]})

    def dry(b: Any, t: float) -> Any:
        return [
            rcp.complements(b.slower[t] >= 0, 2 - b.friction[t] >= 0),
            rcp.complements(b.faster[t] >= 0, 2 + b.friction[t] >= 0),
        ]

    b.residual(lambda b, t: b.slower[t] - b.faster[t] == 1 - b.v[t], name="slip")
    b.complementarity(dry)
    return b


def test_stick_and_slip_on_a_belt_at_the_order_of_the_steps() -> None:
    def error(elements: int, stages: int) -> float:
        trajectory = belt(elements, stages).simulate()
        exact = -0.5 + np.minimum(trajectory.time, 1) + 0.5 * np.sin(2 * np.maximum(trajectory.time - 1, 0))
        assert trajectory.verify().largest_violation < 1e-8
        return float(np.abs(trajectory.x - exact).max())

    coarse, fine = error(30, 1), error(60, 1)
    assert 1.7 < coarse / fine < 2.3
    assert error(30, 2) < 1e-3 * coarse * 3  # the switch is at an element boundary


def test_two_balls_and_two_walls_meet_at_once() -> None:
    b = phase(60, 1.4)
    b.left, b.right = rcp.State(initial=0.0), rcp.State(initial=1.0)
    b.v, b.w = rcp.State(initial=1.0), rcp.State(initial=-1.0)
    b.between, b.at_left, b.at_right = (rcp.Algebraic(bounds=(0, None)) for _ in range(3))

    @b.ode
    def newton(b, t):
        forces = {b.v: b.at_left[t] - b.between[t], b.w: b.between[t] - b.at_right[t]}
        return {b.left: b.v[t], b.right: b.w[t], **forces}

    @b.complementarity
    def contact(b, t):
        return {
            "between": rcp.complements(b.right[t] - b.left[t] >= 0, b.between[t] >= 0),
            "left": rcp.complements(b.left[t] >= 0, b.at_left[t] >= 0),
            "right": rcp.complements(1 - b.right[t] >= 0, b.at_right[t] >= 0),
        }

    trajectory = b.simulate(restitution={"contact": 1.0})
    np.testing.assert_allclose(trajectory.left, 1 - trajectory.right, atol=1e-9)  # a mirror image
    np.testing.assert_allclose(trajectory.v**2 + trajectory.w**2, 2.0, atol=1e-6)  # elastic, and nothing else acts
    assert (np.diff(np.sign(trajectory.v)) != 0).sum() == 2  # at 1/2 with each other, at 1 with the walls
    inelastic = b.simulate(restitution={"contact": 0.5, "contact[left]": 0.0, "contact[right]": 0.0})
    np.testing.assert_allclose((inelastic.v[-1], inelastic.w[-1]), (-0.5, 0.5), atol=1e-6)


def test_a_range_and_a_force_of_any_sign() -> None:
    b = phase(40)
    b.v, b.f = rcp.State(initial=2.0), rcp.Algebraic()
    b.ode(lambda b, t: {b.v: -b.f[t]})

    b.complementarity(lambda b, t: rcp.complements(pyo.inequality(-3, b.f[t], 3), -b.v[t]))
    trajectory = b.simulate()
    np.testing.assert_allclose(trajectory.v, np.maximum(2 - 3 * trajectory.time, 0), atol=1e-9)

    c = phase(40)
    c.x, c.f = rcp.State(initial=0.5), rcp.Algebraic()
    c.ode(lambda b, t: {b.x: b.f[t] - 1})
    c.complementarity(lambda b, t: rcp.either_zero(b.x[t] >= 0, b.f[t]), name="stop")
    trajectory = c.simulate()
    np.testing.assert_allclose(trajectory.x, np.maximum(0.5 - trajectory.time, 0), atol=1e-9)
    assert trajectory.verify().natural_residual < 1e-9


def test_a_step_map_and_a_relay_that_reads_another_time() -> None:
    b = phase(20)
    b.x, b.f = rcp.State(initial=1.0), rcp.Algebraic(bounds=(0, None))

    b.step_map(lambda b, t, previous: {b.x: previous.x - 0.1 * b.x[0.0] + b.f[t]})
    b.complementarity(lambda b, t: rcp.complements(b.x[t] >= 0, b.f[t] >= 0))
    trajectory = b.simulate(initial={"x": 0.5})
    np.testing.assert_allclose(trajectory.x, np.maximum(0.5 - 0.05 * np.arange(21), 0), atol=1e-9)


def test_a_step_without_a_solution_is_named_and_what_came_before_is_kept() -> None:
    b = phase(10)
    b.x, b.f = rcp.State(initial=0.45), rcp.Algebraic()
    b.ode(lambda b, t: {b.x: -1 - b.f[t]})  # the force pulls
    b.complementarity(lambda b, t: rcp.complements(b.x[t] >= 0, b.f[t] >= 0))
    with pytest.raises(SimulationFailed, match=r"t = 0.4: the rows of element 4 were not solved \(residual") as caught:
        b.simulate()
    assert caught.value.time == pytest.approx(0.4)
    np.testing.assert_allclose(caught.value.trajectory.x, 0.45 - caught.value.trajectory.time, atol=1e-9)


def test_restitution_needs_one_step_per_element() -> None:
    b = ball(4, scheme="radau", stages=2)
    with pytest.raises(InitialGuessError, match=r"restitution needs one step per element; radau\(2\) has 2 stages"):
        b.simulate(restitution={"floor": 0.5})


def flights(bounces: int) -> Any:
    """A ball with one phase for each flight, at the durations that are known."""
    m = pyo.ConcreteModel()

    def flight(b: Any, k: int) -> None:
        b.x, b.v = rcp.State(initial=1.0 if k == 0 else None, initial_guess=1), rcp.State(initial_guess=1.0)
        b.ode(lambda b, t: {b.x: b.v[t], b.v: -G})

    m.flights = rcp.PhaseBlock(range(bounces + 1), duration=rcp.Duration(bounds=(0.01, 5)), elements=2, rule=flight)
    m.impacts = rcp.Link(m.flights, jump=lambda pre, post: post.v == -0.5 * pre.v)
    MODELS.append(m)
    for k in range(bounces + 1):
        m.flights[k].duration.value = math.sqrt(2 / G) * (1 if k == 0 else 2 * 0.5**k)
    m.flights[0].v[0].fix(0.0)
    return m


def test_linked_phases_are_simulated_one_after_the_other_through_their_impacts() -> None:
    m = flights(2)
    m.flights[1].x[0].fix(7.0)  # what a phase asks of its start is not what the link gives
    trajectory = m.flights[0].simulate()
    for k in (1, 2):
        start = m.impacts[k].start_after(trajectory)
        assert start["x"] == pytest.approx(0, abs=1e-8)
        assert start["v"] == pytest.approx(math.sqrt(2 * G) * 0.5**k, rel=1e-8)
        trajectory = m.flights[k].simulate(initial=start)
    assert m.flights[1].x[0].value == 7.0
    assert m.flights[1].x[0].fixed
    assert trajectory.x[-1] == pytest.approx(0, abs=1e-8)


def test_a_link_that_does_not_give_the_start_says_so() -> None:
    m = flights(1)
    m.other = rcp.Link(m.flights[0], m.flights[1], states=["x"], jump=lambda pre, post: post.v**2 == -1 - pre.x**2)
    with pytest.raises(rcp.errors.ModelError, match="its relations have no solution for the start of 'flights.1.'"):
        m.other.start_after(m.flights[0].simulate())
    m.third = rcp.Link(m.flights[0], m.flights[1], states=["x"], jump=lambda pre, post: post.v + post.x >= 0)
    assert set(m.third.start_after(m.flights[0].simulate())) == {"x"}  # an inequality gives nothing


def test_a_plan_is_played_back_to_where_it_is_and_a_wrong_one_is_not() -> None:
    b = brick(0.5, 0.3, 1.0)
    b.push = rcp.Control(initial_guess=lambda t: 3 * t)
    plan = b.simulate()
    for away in (0.0, 0.25):
        b.initialize(dataclasses.replace(plan, states={**plan.states, "v": plan.v + away * plan.time}))
        played = b.simulate(method="scheme")
        assert all(np.abs(played.states[name] - plan.states[name]).max() < 1e-9 for name in plan.states)


def test_contact_laws_are_simulated_as_they_are_declared() -> None:
    b = phase(60, 1.2)
    b.x = rcp.State(initial=1.0)
    b.height, b.rise = rcp.State(initial=0.2), rcp.State(initial=0.0)
    b.floor = rcp.mechanics.HardWall(b.height)
    b.drag = rcp.mechanics.CoulombFriction(b.x, 8.0, 0.5)
    b.above = rcp.mechanics.AbsoluteValue(lambda b, t: 3.0 * b.rise[t] + 1.0)
    b.below = rcp.mechanics.AbsoluteValue(lambda b, t: 3.0 * b.rise[t] - 1.0)
    motor = lambda b, t: (b.above[t] - b.below[t]) / 2  # noqa: E731
    b.ode(lambda b, t: {b.x: b.drag[t], b.height: b.rise[t], b.rise: b.floor[t] - G - motor(b, t)})
    trajectory = b.simulate(restitution={"floor": 0.5})
    np.testing.assert_allclose(trajectory.x, np.maximum(1.0 - 4 * trajectory.time, 0), atol=1e-6)
    np.testing.assert_allclose(
        (trajectory.above - trajectory.below) / 2, np.clip(3 * trajectory.rise[1:], -1, 1), atol=1e-9
    )
    assert trajectory.height.min() >= -1e-9
    assert trajectory.rise.max() > 0.5


# --------------------------------------------------------------------
# Ranges and equalities stated in a phase: dry friction, which needs one range where it took two pairs before.


def sliding(speed: float) -> Any:
    """A unit mass under friction between -1 and 1: it slows down by 1 per second, and then it stays where it is."""
    m, b = one_phase(model="sliding", duration=2, elements=20, scheme="implicit_euler", position=rcp.State(initial=0))
    b.speed = rcp.State(initial=speed, initial_guess=speed)
    b.friction = rcp.Algebraic(bounds=(-1, 1), initial_guess=0)
    b.half = rcp.Algebraic(initial_guess=0)
    b.ode(lambda b, t: {b.position: b.speed[t], b.speed: b.friction[t]})

    b.complementarity(lambda b, t: rcp.complements(b.friction[t], b.speed[t]), name="stick_or_slip")

    b.complementarity(lambda b, t: rcp.complements(2 * b.half[t] == b.speed[t], b.friction[t]), name="definition")

    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.friction[t] ** 2))
    return m


@pytest.mark.asl
@pytest.mark.parametrize("sign", [1, -1])
def test_dry_friction_is_one_range_whose_parts_are_in_the_trajectory_and_are_verified(sign: int) -> None:
    m = sliding(sign * 1.0)
    solution(m)
    trajectory = m.p.trajectory()
    expected = sign * np.maximum(1 - trajectory.time, 0)
    assert trajectory.speed == pytest.approx(expected, abs=1e-3)
    assert trajectory.half == pytest.approx(expected[1:] / 2, abs=1e-3)
    names = {name for name in trajectory.pairs if name.startswith("stick_or_slip")}
    assert names == {"stick_or_slip (lower)", "stick_or_slip (upper)"}
    assert "definition" not in trajectory.pairs
    for one, other in (trajectory.pairs[name] for name in names):
        assert np.nanmin(one) >= -1e-6
        assert np.nanmax(np.minimum(one, other)) <= 1e-3
    assert trajectory.verify().product <= 1e-6
    m.p.half[m.p.initial_time + 1].set_value(7)
    assert m.p.trajectory().verify().equations > 1
