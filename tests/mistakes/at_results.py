"""Mistakes at what a solve gives back, and at the names of the package."""

from typing import Any

import pyrobocop_pyomo as rcp

from .entries import driven, fails, refused


@refused("solve() has no keyword 'max_iter'", "options={'max_iter': ...}")
def an_option_of_ipopt_as_a_keyword(m: Any, followed: bool) -> None:
    driven(m)
    rcp.solve(m, **({"options": {"max_iter": 50}} if followed else {"max_iter": 50}))


@refused("solve() has no keyword 'option'", "Did you mean 'options'?")
def a_mistyped_keyword_of_solve(m: Any, followed: bool) -> None:
    driven(m)
    rcp.solve(m, **{"options" if followed else "option": {"max_iter": 50}})


@refused("is no model", "rcp.solve(m)")
def a_solve_of_nothing(m: Any, followed: bool) -> None:
    driven(m)
    rcp.solve(m if followed else None)


@refused("a result has no 'x'", "phase.trajectory()")
def a_value_of_the_result(m: Any, followed: bool) -> None:
    b = driven(m)
    result = rcp.solve(m)
    _ = b.trajectory().x if followed else result.x


@refused("a result holds no values by name ('x')", "phase.trajectory()['x']")
def a_value_of_the_result_by_index(m: Any, followed: bool) -> None:
    b = driven(m)
    result = rcp.solve(m)
    _ = b.trajectory()["x"] if followed else result["x"]


@refused("trajectory 'p' has no 'velocity'", "It has x, v, u")
def a_name_that_a_trajectory_has_not(m: Any, followed: bool) -> None:
    b = driven(m)
    _ = b.trajectory().v if followed else b.trajectory().velocity


@refused("'p.x', a variable over time, has no 'value'", "phase.trajectory().x as an array")
def the_value_of_a_whole_variable(m: Any, followed: bool) -> None:
    b = driven(m)
    _ = b.trajectory().x if followed else b.x.value


@refused("has no attribute 'Solve'", "Did you mean rcp.solve?")
def a_capital_letter(m: Any, followed: bool) -> None:
    driven(m)
    (rcp.solve if followed else rcp.Solve)(m)


@refused("has no attribute 'multistart'", "It is rcp.studies.multistart")
def a_name_of_a_namespace(m: Any, followed: bool) -> None:
    _ = rcp.studies.multistart if followed else rcp.multistart


@fails("time_limit = '10'", "expected seconds")
def a_limit_in_words(m: Any, followed: bool) -> Any:
    driven(m)
    return {"time_limit": 10 if followed else "10"}


@fails("'feasibility' is 0", "a number above 0")
def a_tolerance_of_zero(m: Any, followed: bool) -> Any:
    driven(m)
    return {"tolerances": {"feasibility": 1e-6 if followed else 0}}
