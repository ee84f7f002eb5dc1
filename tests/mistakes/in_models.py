"""Mistakes that a diagnosis finds: in equations and unknowns, values, numbers, units, and what else a model holds."""

from typing import Any

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

from .entries import diagnosed, driven

NAN, INF = float("nan"), float("inf")


def pushed(m: Any) -> Any:
    """A cart whose end is free, with two points in each element."""
    b = driven(m, final=None, duration=1, stages=2)
    b.initialize(x=0.1, v=0.1, u=0.1)
    return b


def pendulum(m: Any, followed: bool, **options: Any) -> Any:
    """A mass on a rod in Cartesian coordinates; with the rod as it is, of index three, without it, of index one."""
    m.swing = b = rcp.PhaseBlock(duration=1, elements=3, stages=2, **options)
    for name, initial in {"x": 1.0, "y": 0.0, "u": 0.0, "v": 0.0}.items():
        setattr(b, name, rcp.State(initial=initial, initial_guess=initial))
    b.tension = rcp.Algebraic(initial_guess=1)
    b.ode(lambda b, t: {b.x: b.u[t], b.y: b.v[t], b.u: -b.tension[t] * b.x[t], b.v: -b.tension[t] * b.y[t] - 9.81})
    if followed:
        b.residual(lambda b, t: b.tension[t] == 1, name="rod")
    else:
        b.residual(lambda b, t: b.x[t] ** 2 + b.y[t] ** 2 == 1, name="rod")
    return b


# -------------------------------------------------------------------- equations and unknowns


@diagnosed("phase 'p': too few equations. 2 states and 1 algebraic need 3", "p", pushed)
def a_missing_equation(b: Any, followed: bool) -> None:
    if not followed:
        b.z = rcp.Algebraic()


@diagnosed("1 .* equation 'rod' holds no .* determines unknown 'tension'", "swing.rod", None)
def an_index_of_three(m: Any, followed: bool) -> None:
    pendulum(m, followed)


@diagnosed("phase 'swing': the index is higher than 1 .* 'rod'", "swing.rod", None)
def a_higher_index_that_was_allowed(m: Any, followed: bool) -> None:
    pendulum(m, followed, allow_higher_index=True)


@diagnosed("no equation and no pair is left to determine 'z'", "p.z", pushed)
def a_pair_that_does_not_hold_the_algebraic(b: Any, followed: bool) -> None:
    b.z = rcp.Algebraic(bounds=(0, 1))
    b.constraint(lambda b, t: b.z[t] + b.x[t] <= 3, name="limit")
    b.complementarity(
        lambda b, t: rcp.complements(b.x[t] + 1 >= 0, (b.z[t] if followed else b.u[t] + 1) >= 0), name="stop"
    )


@diagnosed("one of the equations 'p.forces' follows from the others", "p.forces", pushed)
def a_redundant_equation(b: Any, followed: bool) -> None:
    b.y, b.z = rcp.Algebraic(), rcp.Algebraic()
    factor = 3 if followed else 2
    b.residual(lambda b, t: [b.y[t] + b.z[t] == b.x[t], 2 * b.y[t] + factor * b.z[t] == 2 * b.x[t]], name="forces")
    b.check()  # by structure nothing is missing


# -------------------------------------------------------------------- start and end


@diagnosed("initial values violate residual 'rod' by 3 at t = 0: x = 2", "swing.rod", None)
def an_inconsistent_start(m: Any, followed: bool) -> None:
    b = pendulum(m, False, allow_higher_index=True)
    b.x[0].fix(1 if followed else 2)


@diagnosed("the final values violate constraint 'corridor' by 0.5 at t = 1", "p.corridor", pushed)
def an_end_outside_a_path_constraint(b: Any, followed: bool) -> None:
    b.x[1].fix(1.5)
    b.constraint(lambda b, t: b.x[t] <= (2 if followed else 1), name="corridor")


@diagnosed("hold only .* 'p.y_collocation'. Fixed at both ends: 'p.y'", "p.y_collocation", pushed)
def more_ends_fixed_than_possible(b: Any, followed: bool) -> None:
    b.y = rcp.State(initial=0, final=None if followed else 3)
    b.ode(lambda b, t: {b.y: 1.0})


# -------------------------------------------------------------------- numbers and units


@diagnosed("number nan, in right-hand side of 'y' of phase 'p' at t = 0.83.*, and at 1 more point", "p.y", pushed)
def a_right_hand_side_without_a_value(b: Any, followed: bool) -> None:
    b.y = rcp.State(initial=0)
    b.ode(lambda b, t: {b.y: b.x[t] + (NAN if t > 0.75 and not followed else 1.0)})


@diagnosed(r"by p.y\[.* = 0, in right-hand side of 'y' .* t = .*, and at 7 more points", "p.y", pushed)
def a_division_by_zero_at_the_guess(b: Any, followed: bool) -> None:
    b.y = rcp.State(initial=0)
    b.ode(lambda b, t: {b.y: b.x[t] / (b.y[t] + (1 if followed else 0))})


@diagnosed(r"derivative of sqrt.* p.z\[0.08.*, in constraint 'p.speed' at t = 0.08", "p.speed", pushed)
def a_root_of_zero(b: Any, followed: bool) -> None:
    b.z = rcp.Algebraic(initial_guess=1 if followed else 0, bounds=(0, None))
    b.residual(lambda b, t: pyo.sqrt(b.z[t]) == b.x[t], name="speed")


@diagnosed("'p.fast': .*not consistent", "p.fast", None)
def units_that_do_not_match(m: Any, followed: bool) -> None:
    u = pyo.units
    m.p = b = rcp.PhaseBlock(elements=3, time_units=u.s)
    b.x, b.u = rcp.State(initial=0, units=u.m), rcp.Control(units=u.m / u.s)
    b.ode(lambda b, t: {b.x: b.u[t]})
    b.constraint(lambda b, t: b.u[t] <= 3 * (u.m / u.s if followed else u.N), name="fast")


# -------------------------------------------------------------------- what a model holds besides


@diagnosed("'gear' is a discrete variable", "gear", pushed)
def a_discrete_variable(b: Any, followed: bool) -> None:
    b.model().gear = pyo.Var(domain=pyo.Reals if followed else pyo.Binary, initialize=0)
    b.model().limit = pyo.Constraint(expr=b.u[1.0] <= b.model().gear)


@diagnosed(r"'p.contact\[.*side 'p.u\[.*' has two finite bounds", "p.contact", pushed)
def a_complementary_side_with_two_bounds(b: Any, followed: bool) -> None:
    b.z = rcp.Algebraic(bounds=(0, None))
    b.complementarity(lambda b, t: rcp.complements(b.u[t] >= -1 if followed else b.u[t], b.z[t]), name="contact")
