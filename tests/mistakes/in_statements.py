"""Mistakes in declarations, and in what is assigned where."""

from typing import Any

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

from .entries import driven, effort, fails, newton, refused


@refused("State", "no keyword 'initail_guess'", "Did you mean 'initial_guess'?")
def a_mistyped_keyword_of_a_state(b: Any, followed: bool) -> None:
    b.z = rcp.State(**{"initial_guess" if followed else "initail_guess": 3})


@refused("Parameter", "no keyword 'value'", "Did you mean 'initial_guess'?")
def a_word_of_another_package(b: Any, followed: bool) -> None:
    b.k = rcp.Parameter(**{"initial_guess" if followed else "value": 3})


@refused("State", "no keyword 'lb'", "Did you mean 'bounds'?")
def a_lower_bound_in_the_words_of_pyomo(b: Any, followed: bool) -> None:
    b.z = rcp.State(bounds=(0, None)) if followed else rcp.State(lb=0)


@refused("Duration", "takes keywords only", "Duration(bounds=...)", on=None)
def a_duration_by_position(m: Any, followed: bool) -> None:
    m.p = rcp.PhaseBlock(duration=rcp.Duration(bounds=(1, 2)) if followed else rcp.Duration(1, 2))


@refused("PhaseBlock", "no keyword 'durration'", "Did you mean 'duration'?", on=None)
def a_mistyped_keyword_of_a_phase(m: Any, followed: bool) -> None:
    m.p = rcp.PhaseBlock(**{"duration" if followed else "durration": 2.0})


@refused("phase 'p'", "duration = (1, 2)", "Duration(bounds=...)", on=None)
def a_pair_as_duration(m: Any, followed: bool) -> None:
    m.p = rcp.PhaseBlock(duration=rcp.Duration(bounds=(1, 2)) if followed else (1, 2))


@refused("phase 'p'", "elements = 10.5", "an integer of at least 1", on=None)
def a_fraction_of_elements(m: Any, followed: bool) -> None:
    m.p = rcp.PhaseBlock(elements=10 if followed else 10.5)


@refused("is not constructed yet", "add it to a ConcreteModel first", on=None)
def a_phase_that_no_model_has(m: Any, followed: bool) -> None:
    phase = rcp.PhaseBlock(duration=1.0, elements=2)
    if followed:
        m.phase = phase
    phase.x = rcp.State()


@refused("state 'z'", "its initial value is [0, 1, 2]", "(lower, upper)")
def a_list_as_initial_value_of_one_number(b: Any, followed: bool) -> None:
    b.z = rcp.State(initial=(0, 1)) if followed else rcp.State(initial=[0, 1, 2])


@refused("state 'z'", "bounds = 5", "a pair (lower, upper)")
def one_number_as_bounds(b: Any, followed: bool) -> None:
    b.z = rcp.State(bounds=(None, 5) if followed else 5)


@refused("state 'z'", "the lower of its bounds, 1, exceeds the upper, -1", "Swap them")
def bounds_the_wrong_way_round(b: Any, followed: bool) -> None:
    b.z = rcp.State(bounds=(-1, 1) if followed else (1, -1))


@refused("phase 'p' has no 'velocity'", "'x', 'v', 'u'")
def a_name_that_was_never_declared(b: Any, followed: bool) -> None:
    _ = b.v if followed else b.velocity


@fails("'force'", "is a Control on 'cart', which is no phase", "m.p.force = rcp.Control(...)", on=driven)
def a_declaration_on_the_model(b: Any, followed: bool) -> None:
    if not followed:
        b.model().force = rcp.Control()
        return
    b.force = rcp.Control(bounds=(-1, 1))
    b.constraint(lambda b, t: b.force[t] == b.u[t] / 2)


@fails("'touch'", "is a pair that no component holds", "rcp.Complementarity(expr=", on=driven)
def a_pair_on_the_model(b: Any, followed: bool) -> None:
    pair = rcp.complements(b.x[2.0] - 1 >= 0, b.u[2.0] + 2 >= 0)
    b.model().touch = rcp.Complementarity(expr=pair) if followed else pair


@fails("states 'x' (", "'v' (", "have no equation", "State its derivative in an ode")
def no_equations(b: Any, followed: bool) -> None:
    b.model().effort = pyo.Objective(expr=b.integral(effort))
    if followed:
        b.ode(newton)


@fails("2 active objectives ('effort', 'late')", "add them up", on=driven)
def two_objectives(b: Any, followed: bool) -> None:
    if followed:
        b.model().effort.set_value(b.model().effort.expr + b.x.at_end)
    else:
        b.model().late = pyo.Objective(expr=b.x.at_end)


@refused("phase 'p': unknown scheme 'rk4'", "radau", on=None)
def a_scheme_that_does_not_exist(m: Any, followed: bool) -> None:
    m.p = rcp.PhaseBlock(scheme="radau" if followed else "rk4")


@refused("PhaseBlock", "no keyword 'nfe'", "Did you mean 'elements'?", on=None)
def elements_in_the_words_of_pyomo_dae(m: Any, followed: bool) -> None:
    m.p = rcp.PhaseBlock(**{"elements" if followed else "nfe": 10})


@refused("PhaseBlock was given 2.0, 10 by position", "PhaseBlock(duration=..., elements=...)", on=None)
def a_phase_by_position(m: Any, followed: bool) -> None:
    m.p = rcp.PhaseBlock(duration=2.0, elements=10) if followed else rcp.PhaseBlock(2.0, 10)


@refused("Polytope(...)", "rcp.Polytope.from_vertices(corners)", on=None)
def a_polytope_by_its_constructor(m: Any, followed: bool) -> None:
    corners = [(0, 0), (1, 0), (0, 1)]
    _ = rcp.Polytope.from_vertices(corners) if followed else rcp.Polytope(corners)


@refused("no attribute 'PathConstraint'", "phase.constraint(lambda b, t: ...)", on=driven)
def a_path_constraint_in_the_words_of_others(b: Any, followed: bool) -> None:
    if followed:
        b.constraint(lambda b, t: b.v[t] <= 2)
    else:
        b.fast = rcp.PathConstraint(lambda b, t: b.v[t] <= 2)


@fails("Ipopt option 'maxiter'", "not a valid option", "Did you mean 'max_iter'?", on=driven)
def an_option_that_ipopt_writes_otherwise(b: Any, followed: bool) -> Any:
    return {"options": {"max_iter" if followed else "maxiter": 200}}
