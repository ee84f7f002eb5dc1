"""Mistakes that show in a solve: no solution, no lower end, no value, a wrong scheme, a bad guess."""

from __future__ import annotations

from typing import Any

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

from .entries import cart, driven, effort, fails


@fails("equation of 'x' of phase 'p' at t = ", "Relax what is not met")
def too_little_time(m: Any, followed: bool) -> None:
    driven(m, duration=2.0 if followed else 0.5)


@fails("equation of '", "of phase 'p' at t = ", "Relax what is not met")
def too_little_force(m: Any, followed: bool) -> None:
    driven(m, force=2.0 if followed else 0.1)


@fails("What grows: ", "'p.u'", "Bound what grows")
def an_objective_without_a_lower_end(m: Any, followed: bool) -> None:
    b = cart(m, final=None, force=2.0 if followed else None)
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t]})
    m.far = pyo.Objective(expr=b.x.at_end, sense=pyo.maximize)


@fails("'wall' by 0.1 at t = 2", "leave one of them free")
def an_end_value_behind_a_wall(m: Any, followed: bool) -> None:
    b = driven(m)
    b.constraint(lambda b, t: b.x[t] <= (1.1 if followed else 0.9), name="wall")


@fails("'effort' holds abs(...)", "two controls with bounds=(0, None)")
def an_absolute_value_as_objective(m: Any, followed: bool) -> None:
    b = cart(m)
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t]})
    if not followed:
        m.effort = pyo.Objective(expr=b.integral(lambda b, t: abs(b.u[t])))
        return
    b.plus, b.minus = rcp.Control(bounds=(0, None)), rcp.Control(bounds=(0, None))
    b.constraint(lambda b, t: b.u[t] == b.plus[t] - b.minus[t])
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.plus[t] + b.minus[t]))


@fails("sqrt(...) of p.v[", "= -1, in right-hand side of 'v' of phase 'p' at t = ", "element 0, point 1", "by bounds")
def a_root_of_a_negative_number(m: Any, followed: bool) -> None:
    b = cart(m)
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] - 0.1 * pyo.sqrt(b.v[t] + (1 if followed else -1))})
    m.effort = pyo.Objective(expr=b.integral(effort))


@fails("log(...) of p.x[", "'v' of phase 'p' at t = ", "Bounds that keep it away")
def a_logarithm_that_the_start_rules_out(m: Any, followed: bool) -> None:
    b = cart(m)
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] - 0.1 * pyo.log(b.x[t] + (0.5 if followed else -0.5))})
    m.effort = pyo.Objective(expr=b.integral(effort))


@fails("the number nan", "'v' of phase 'p' at t = ")
def a_constant_that_is_no_number(m: Any, followed: bool) -> None:
    b = cart(m)
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] + (0.0 if followed else float("nan"))})
    m.effort = pyo.Objective(expr=b.integral(effort))


@fails("iteration limit", "max_iter")
def too_few_iterations(m: Any, followed: bool) -> Any:
    b = cart(m)
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] - 0.5 * pyo.sin(3 * b.x[t])})
    m.effort = pyo.Objective(expr=b.integral(effort))
    return {"options": {"max_iter": 200 if followed else 1}}
