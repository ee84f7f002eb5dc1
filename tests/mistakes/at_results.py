"""Mistakes at what a solve gives back, and at the names of the package."""

from typing import Any

import pyrobocop_pyomo as rcp

from .entries import driven, fails, refused


@refused("solve() has no keyword 'max_iter'", "options={'max_iter': ...}", on=driven)
def an_option_of_ipopt_as_a_keyword(b: Any, followed: bool) -> None:
    rcp.solve(b.model(), **({"options": {"max_iter": 50}} if followed else {"max_iter": 50}))


@refused("solve() has no keyword 'option'", "Did you mean 'options'?", on=driven)
def a_mistyped_keyword_of_solve(b: Any, followed: bool) -> None:
    rcp.solve(b.model(), **{"options" if followed else "option": {"max_iter": 50}})


@refused("is no model", "rcp.solve(m)", on=driven)
def a_solve_of_nothing(b: Any, followed: bool) -> None:
    rcp.solve(b.model() if followed else None)


@refused("a result has no 'x'", "phase.trajectory()", on=driven)
def a_value_of_the_result(b: Any, followed: bool) -> None:
    result = rcp.solve(b.model())
    _ = b.trajectory().x if followed else result.x


@refused("a result holds no values by name ('x')", "phase.trajectory()['x']", on=driven)
def a_value_of_the_result_by_index(b: Any, followed: bool) -> None:
    result = rcp.solve(b.model())
    _ = b.trajectory()["x"] if followed else result["x"]


@refused("trajectory 'p' has no 'velocity'", "It has x, v, u", on=driven)
def a_name_that_a_trajectory_has_not(b: Any, followed: bool) -> None:
    _ = b.trajectory().v if followed else b.trajectory().velocity


@refused("'p.x', a variable over time, has no 'value'", "phase.trajectory().x as an array", on=driven)
def the_value_of_a_whole_variable(b: Any, followed: bool) -> None:
    _ = b.trajectory().x if followed else b.x.value


@refused("has no attribute 'Solve'", "Did you mean rcp.solve?", on=driven)
def a_capital_letter(b: Any, followed: bool) -> None:
    (rcp.solve if followed else rcp.Solve)(b.model())


@refused("has no attribute 'multistart'", "It is rcp.studies.multistart", on=None)
def a_name_of_a_namespace(m: Any, followed: bool) -> None:
    _ = rcp.studies.multistart if followed else rcp.multistart


@fails("time_limit = '10'", "expected seconds", on=driven)
def a_limit_in_words(b: Any, followed: bool) -> Any:
    return {"time_limit": 10 if followed else "10"}


@fails("'feasibility' is 0", "a number above 0", on=driven)
def a_tolerance_of_zero(b: Any, followed: bool) -> Any:
    return {"tolerances": {"feasibility": 1e-6 if followed else 0}}
