"""Mistakes that show in a solve: no solution, no lower end, no value, a wrong scheme, a bad guess."""

from typing import Any

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

from .entries import cart, driven, effort, fails


@fails(
    "equation of 'x' of phase 'p' at t = ",
    "no values meet them together",
    "'p.u' <= 2 at ",
    "'p.x' fixed at 1",
    on=None,
)
def too_little_time(m: Any, followed: bool) -> None:
    driven(m, duration=2.0 if followed else 0.5)


@fails("What grows: ", "'p.u'", "Bound what grows", on=None)
def an_objective_without_a_lower_end(m: Any, followed: bool) -> None:
    b = cart(m, final=None, force=2.0 if followed else None)
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t]})
    m.far = pyo.Objective(expr=b.x.at_end, sense=pyo.maximize)


@fails("'wall' by 0.1 at t = 2", "leave one of them free", on=driven)
def an_end_value_behind_a_wall(b: Any, followed: bool) -> None:
    b.constraint(lambda b, t: b.x[t] <= (1.1 if followed else 0.9), name="wall")


@fails("'effort' holds abs(...)", "two controls with bounds=(0, None)")
def an_absolute_value_as_objective(b: Any, followed: bool) -> dict[str, Any] | None:
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t]})
    if not followed:
        b.model().effort = pyo.Objective(expr=b.integral(lambda b, t: abs(b.u[t])))
        return {"strategies": "solve"}  # by default a second try puts the parts in its place
    b.plus, b.minus = rcp.Control(bounds=(0, None)), rcp.Control(bounds=(0, None))
    b.constraint(lambda b, t: b.u[t] == b.plus[t] - b.minus[t])
    b.model().effort = pyo.Objective(expr=b.integral(lambda b, t: b.plus[t] + b.minus[t]))
    return None


@fails("log(...) of p.x[", "'v' of phase 'p' at t = ", "by bounds")
def a_logarithm_that_the_start_rules_out(b: Any, followed: bool) -> None:
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] - 0.1 * pyo.log(b.x[t] + (0.5 if followed else -0.5))})
    b.model().effort = pyo.Objective(expr=b.integral(effort))


@fails("the number nan", "'v' of phase 'p' at t = ")
def a_constant_that_is_no_number(b: Any, followed: bool) -> None:
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] + (0.0 if followed else float("nan"))})
    b.model().effort = pyo.Objective(expr=b.integral(effort))


@fails("iteration limit", "max_iter")
def too_few_iterations(b: Any, followed: bool) -> Any:
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] - 0.5 * pyo.sin(3 * b.x[t])})
    b.model().effort = pyo.Objective(expr=b.integral(effort))
    return {"options": {"max_iter": 200 if followed else 1}}


@fails("Ipopt reached its iteration limit", "Raise it with options={'max_iter'", "along random configurations", on=None)
def a_guess_through_an_obstacle_and_few_iterations(m: Any, followed: bool) -> Any:
    m.p = b = rcp.PhaseBlock(duration=2.0, elements=8, stages=1)
    b.x, b.y = rcp.State(initial=0, final=4), rcp.State(initial=0, final=0)
    b.vx, b.vy = rcp.Control(), rcp.Control()
    b.ode(lambda b, t: {b.x: b.vx[t], b.y: b.vy[t]})
    b.avoid = rcp.ObstacleAvoidanceBlock(
        b.time,
        bodies={"cart": rcp.Body(rcp.Polytope.box(0.4, 0.4), pose=lambda b, t: rcp.planar_pose(b.x[t], b.y[t], 0.0))},
        obstacles={"wall": rcp.Polytope.box(0.4, 2, center=(2, 0.3))},
        clearance=0.05,
    )
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.vx[t] ** 2 + b.vy[t] ** 2))
    b.initialize_straight_lines()
    if followed:
        around = {"x": [0, 1.5, 2.5, 4], "y": [0, -1.2, -1.2, 0]}
        b.initialize(rcp.scenes.waypoint_initial_guess(b, around, even_in="xy"))
    return {"options": {"max_iter": 100 if followed else 2}}


@fails("Phase 'p' has pairs and several stages per element", "take stages=1, or two phases with a jump", on=None)
def several_stages_at_an_impact(m: Any, followed: bool) -> Any:
    m.p = b = rcp.PhaseBlock(duration=1.0, elements=6, stages=1 if followed else 3)
    b.x, b.v = rcp.State(initial=1.0), rcp.State(initial=0)
    b.force = rcp.Algebraic(bounds=(0, None))
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.force[t] - 9.81})
    b.complementarity(lambda b, t: rcp.complements(b.x[t] >= 0, b.force[t] >= 0))
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.force[t] ** 2))
    return {"strategies": "tight"}
