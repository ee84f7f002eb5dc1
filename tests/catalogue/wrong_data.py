"""Mistakes in values, numbers, units, and in what a model holds besides its phases."""

from __future__ import annotations

from typing import Any

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.diagnosis import Subject

from .entries import Mistake, effort, found_by_diagnosis, pendulum, pushed, rod

NAN, INF = float("nan"), float("inf")


# -------------------------------------------------------------------- start and end


@found_by_diagnosis(
    Subject.START, "phase 'swing': the initial values violate residual 'rod' by 3 at t = 0: x = 2", "swing.rod"
)
def inconsistent_start(m: Any) -> Mistake:
    b = pendulum(m, allow_higher_index=True)
    yield
    b.x[0].fix(2)
    b.residual(rod)


@found_by_diagnosis(Subject.START, "the final values violate constraint 'corridor' by 0.5 at t = 1", "p.corridor")
def end_outside_a_path_constraint(m: Any) -> Mistake:
    b = pushed(m)
    b.x[1].fix(1.5)
    yield

    def corridor(b: Any, t: float) -> Any:
        return b.x[t] <= 1

    b.constraint(corridor)


@found_by_diagnosis(
    Subject.CONTRADICTION, "hold only .* 'p.y_collocation'. Fixed at both ends: 'p.y'", "p.y_collocation"
)
def more_ends_fixed_than_possible(m: Any) -> Mistake:
    b = pushed(m)
    yield
    b.y = rcp.State(initial=0, final=3)
    b.ode(lambda b, t: {b.y: 1.0})


# -------------------------------------------------------------------- numbers


@found_by_diagnosis(
    Subject.DATA, "number nan, in right-hand side of 'y' of phase 'p' at t = 0.83.*, and at 1 more point", "p.y"
)
def right_hand_side_without_a_value(m: Any) -> Mistake:
    b = pushed(m)
    b.y = rcp.State(initial=0)
    yield

    def gust(b: Any, t: float) -> Any:
        return {b.y: b.x[t] + (NAN if t > 0.75 else 1.0)}

    b.ode(gust)


@found_by_diagnosis(Subject.DATA, r"by p.y\[.* = 0, in right-hand side of 'y' .* t = .*, and at 7 more points", "p.y")
def division_by_zero_at_the_guess(m: Any) -> Mistake:
    b = pushed(m)
    b.y = rcp.State(initial=0)
    yield

    def fall(b: Any, t: float) -> Any:
        return {b.y: b.x[t] / b.y[t]}

    b.ode(fall)


@found_by_diagnosis(Subject.DATA, "the number -?inf, in constraint 'p.limit' at t = 0.08", "p.limit")
def infinite_coefficient(m: Any) -> Mistake:
    b = pushed(m)
    yield

    def limit(b: Any, t: float) -> Any:
        return INF * b.x[t] <= 1

    b.constraint(limit)


@found_by_diagnosis(Subject.DATA, r"derivative of sqrt.* p.z\[0.08.*, in constraint 'p.speed' at t = 0.08", "p.speed")
def root_of_zero(m: Any) -> Mistake:
    b = pushed(m)
    b.z = rcp.Algebraic(initial_guess=0, bounds=(0, None))
    yield

    def speed(b: Any, t: float) -> Any:
        return pyo.sqrt(b.z[t]) == b.x[t]

    b.residual(speed)


@found_by_diagnosis(Subject.DATA, r"parameter 'table\[2\]' is nan", "table[2]")
def hole_in_a_table(m: Any) -> Mistake:
    pushed(m)
    yield
    m.table = pyo.Param([1, 2, 3], initialize={1: 0.0, 2: NAN, 3: 1.0}, mutable=True)


@found_by_diagnosis(Subject.UNITS, "'p.fast': .*not consistent", "p.fast")
def units_that_do_not_match(m: Any) -> Mistake:
    m.p = b = rcp.PhaseBlock(elements=3, time_units=pyo.units.s)
    b.x = rcp.State(initial=0, units=pyo.units.m)
    b.u = rcp.Control(units=pyo.units.m / pyo.units.s)
    b.ode(lambda b, t: {b.x: b.u[t]})
    yield

    def fast(b: Any, t: float) -> Any:
        return b.u[t] <= 3 * pyo.units.N

    b.constraint(fast)


# -------------------------------------------------------------------- what a model holds besides


@found_by_diagnosis(Subject.STATEMENT, "'gear' is a discrete variable", "gear")
def discrete_variable(m: Any) -> Mistake:
    b = pushed(m)
    yield
    m.gear = pyo.Var(domain=pyo.Binary, initialize=0)
    m.limit = pyo.Constraint(expr=b.u[1.0] <= m.gear)


@found_by_diagnosis(Subject.STATEMENT, r"'p.contact\[.*side 'p.u\[.*' has two finite bounds", "p.contact")
def complementary_side_with_two_bounds(m: Any) -> Mistake:
    b = pushed(m)
    b.z = rcp.Algebraic(bounds=(0, None))
    yield

    def contact(b: Any, t: float) -> Any:
        return rcp.complements(b.u[t], b.z[t])

    b.complementarity(contact)


@found_by_diagnosis(Subject.STATEMENT, "phase 'p' has no state", "p")
def phase_without_a_state(m: Any) -> Mistake:
    m.p = rcp.PhaseBlock(elements=2)
    m.p.u = rcp.Control()
    m.cost = pyo.Objective(expr=m.p.integral(effort))
    yield


@found_by_diagnosis(Subject.UNDETERMINED, "1 variables are in no active row.* example 'slack'", "slack")
def variable_of_the_users_in_no_row(m: Any) -> Mistake:
    pushed(m)
    yield
    m.slack = pyo.Var(initialize=0)
