"""Mistakes in rules, relations, integrals and times."""

import math
from typing import Any

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

from .entries import cart, driven, effort, fails, newton, refused


@refused("'p.u'", "used as one number", "b.integral(lambda b, t: b.u[t] ** 2)")
def the_integral_of_a_squared_variable(b: Any, followed: bool) -> None:
    b.model().effort = pyo.Objective(expr=b.integral(effort) if followed else b.integral(b.u**2))


@refused("'u'", "integral(lambda b, t: b.u[t])")
def the_integral_of_a_variable(b: Any, followed: bool) -> None:
    b.integral((lambda b, t: b.u[t]) if followed else b.u)


@refused("'p.u' has no value of its own at 0", "the nearest are", "b.u.at(0)")
def a_control_at_the_start(b: Any, followed: bool) -> None:
    b.model().c = pyo.Constraint(expr=(b.u.at(0) if followed else b.u[0]) == 0)


@refused("'p.u' has no value of its own at 0.0", "b.integral(lambda b, t: ...) for a sum over time")
def a_sum_over_the_times_of_the_states(b: Any, followed: bool) -> None:
    b.model().effort = pyo.Objective(expr=b.integral(effort) if followed else sum(b.u[t] ** 2 for t in b.time))


@refused("'p.x', a variable over time, has no 'final'", "b.x.at_end", on=None)
def the_final_value_by_another_name(m: Any, followed: bool) -> None:
    b = cart(m, final=None)
    m.c = pyo.Constraint(expr=(b.x.at_end if followed else b.x.final) >= 1)


@refused("'p.x', a variable over time, has no 'dot'", "in an ode, return {b.x: ...}")
def the_derivative_as_an_attribute(b: Any, followed: bool) -> None:
    b.ode(newton if followed else lambda b, t: [b.x.dot == b.v[t]])


@refused("'p.x' is a variable at all times", "b.x.at(time)")
def a_bound_on_a_whole_variable(b: Any, followed: bool) -> None:
    if followed:
        b.constraint(lambda b, t: b.x[t] <= 0.7)
    else:
        b.model().c = pyo.Constraint(expr=b.x <= 0.7)


@refused("ode 'o'", "'p.v' as the derivative of 'x'", "[t] missing")
def right_hand_sides_without_t(b: Any, followed: bool) -> None:

    @b.ode
    def o(b: Any, t: Any) -> Any:
        return newton(b, t) if followed else {b.x: b.v, b.v: b.u}


@refused("ode 'o'", "reads 'gain' at [t]", "Write b.gain.")
def a_parameter_at_a_time(b: Any, followed: bool) -> None:
    b.gain = rcp.Parameter(bounds=(0, 1))
    b.ode(lambda b, t: {b.x: b.v[t], b.v: (b.gain if followed else b.gain[t]) * b.u[t]}, name="o")


@refused("ode 'o'", "divides numbers by zero at t = 2", "scheme='gauss'")
def a_division_by_the_time_that_is_left(b: Any, followed: bool) -> None:
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] / ((3 if followed else 2) - t)}, name="o")


@refused("ode 'o'", "rule(b, t)", "lambda b, t: ...")
def a_rule_without_time(b: Any, followed: bool) -> None:
    b.ode(newton if followed else lambda b: {b.x: b.v}, name="o")


@refused("ode 'o'", "returned nothing", "return statement missing")
def a_rule_that_returns_nothing(b: Any, followed: bool) -> None:

    @b.ode
    def o(b: Any, t: Any) -> Any:
        rates = newton(b, t)
        if followed:
            return rates
        return None


@refused("ode 'o'", "{b.x: ...}, not {b.x[t]: ...}")
def states_at_one_time_as_keys(b: Any, followed: bool) -> None:
    b.ode(newton if followed else lambda b, t: {b.x[t]: b.v[t], b.v[t]: b.u[t]}, name="o")


@refused("ode 'o'", "np.sin", "pyo.sin(...)")
def a_function_of_numpy(b: Any, followed: bool) -> None:
    sine = pyo.sin if followed else np.sin
    b.ode(lambda b, t: {b.x: sine(b.v[t]), b.v: b.u[t]}, name="o")


@refused("ode 'o'", "whose shapes do not fit", "has n columns", on=None)
def a_matrix_of_the_wrong_shape(m: Any, followed: bool) -> None:
    m.p = b = rcp.PhaseBlock(duration=1.0, elements=2)
    b.z = rcp.State(index=range(3), initial=0)
    matrix = np.eye(3 if followed else 2)
    b.ode(lambda b, t: {b.z: matrix @ b.z[:, t]}, name="o")


@refused("constraint 'c'", "asks whether a relation", "(0, b.x[t], 1)")
def a_chain_of_inequalities(b: Any, followed: bool) -> None:
    b.constraint((lambda b, t: (0, b.x[t], 1)) if followed else (lambda b, t: 0 <= b.x[t] <= 1), name="c")


@refused("constraint 'c'", "is strict", "Write '<='")
def a_strict_inequality(b: Any, followed: bool) -> None:
    b.constraint((lambda b, t: b.x[t] <= 1) if followed else (lambda b, t: b.x[t] < 1), name="c")


@refused("constraint 'c'", "the formula p.x[", "'expression <= 1'")
def a_formula_in_place_of_a_relation(b: Any, followed: bool) -> None:
    b.constraint((lambda b, t: b.x[t] - 1 <= 0) if followed else (lambda b, t: b.x[t] - 1), name="c")


@refused("'p.touch", "complements(a >= 0, b >= 0)")
def a_product_as_a_pair(b: Any, followed: bool) -> None:

    @b.complementarity
    def touch(b: Any, t: Any) -> Any:
        return rcp.complements(b.x[t] >= 0, b.u[t] + 2 >= 0) if followed else b.x[t] * (b.u[t] + 2) == 0


@refused("ode 'o'", "was given a dict", "lambda b, t: {b.x: b.v[t]}")
def equations_as_a_table(b: Any, followed: bool) -> None:
    b.ode(newton if followed else {b.x: b.v, b.v: b.u}, name="o")


@refused("'p.x'", "'start'", "b.x.at_start")
def a_time_that_is_no_time(b: Any, followed: bool) -> None:
    _ = b.x.at_start if followed else b.x["start"]


@refused("'throttle'", "Declare it before the rule is stated")
def a_rule_that_reads_what_was_not_declared(b: Any, followed: bool) -> None:
    b.ode(newton if followed else lambda b, t: {b.x: b.v[t], b.v: b.throttle[t]}, name="o")


@refused("integrand", "Is an index missing?", on=driven)
def an_integrand_without_t(b: Any, followed: bool) -> None:
    b.integral((lambda b, t: b.u[t] ** 2) if followed else (lambda b, t: b.u**2))


@refused("ode 'o'", "'^'", "** 2")
def a_power_of_another_language(b: Any, followed: bool) -> None:
    b.ode(lambda b, t: {b.x: b.v[t] ** 2 if followed else b.v[t] ^ 2, b.v: b.u[t]}, name="o")


@refused("ode 'o'", "derivative of 'x'", "without brackets or a comma behind it")
def a_comma_too_many(b: Any, followed: bool) -> None:
    b.ode(lambda b, t: {b.x: b.v[t] if followed else (b.v[t],), b.v: b.u[t]}, name="o")


@refused("ode 'o'", "computes with a tuple", "a comma too many")
def a_comma_too_many_within_a_term(b: Any, followed: bool) -> None:
    b.ode(lambda b, t: {b.x: b.v[t] if followed else -(b.v[t],), b.v: b.u[t]}, name="o")


@refused("ode 'o'", "derivative of 'x'", "return statement missing")
def a_derivative_of_a_function_that_returns_nothing(b: Any, followed: bool) -> None:
    b.ode(lambda b, t: {b.x: b.v[t] if followed else None, b.v: b.u[t]}, name="o")


@refused("ode 'o'", "derivative of 'x'", "nan")
def a_number_that_does_not_exist(b: Any, followed: bool) -> None:
    b.ode(lambda b, t: {b.x: b.v[t] if followed else math.nan, b.v: b.u[t]}, name="o")


@refused("integrand", "returned a list", "one number or formula")
def a_list_as_integrand(b: Any, followed: bool) -> None:
    b.integral((lambda b, t: b.u[t] + b.v[t]) if followed else (lambda b, t: [b.u[t], b.v[t]]))


@refused("'p.v' has no value of its own at ", "v.delayed(t, delay)")
def a_value_of_a_while_ago(b: Any, followed: bool) -> None:
    b.w = rcp.State(initial=0, history=0.0)
    b.ode(lambda b, t: {b.x: b.w.delayed(t, 0.3) if followed else b.v[t - 0.3], b.v: b.u[t], b.w: b.u[t]}, name="o")


@refused("CoulombFriction has no keyword 'mu'", "Did you mean 'coefficient'?")
def the_coefficient_of_friction_by_its_letter(b: Any, followed: bool) -> None:
    b.floor = rcp.mechanics.CoulombFriction(b.v, normal=9.81, **{"coefficient" if followed else "mu": 0.3})


@refused("phase 'p' has no 'final'", "Did you mean 'final_time'?", on=None)
def the_end_of_a_phase_by_another_name(m: Any, followed: bool) -> None:
    b = cart(m, final=None)
    m.c = pyo.Constraint(expr=b.x[b.final_time if followed else b.final] >= 1)


@refused("'u' is no state", "its states are x, v")
def an_equation_for_a_control(b: Any, followed: bool) -> None:
    b.ode(newton if followed else lambda b, t: {b.x: b.v[t], b.u: 1.0})


@refused("'p.x', a variable over time, has no 'initial' to set", "rcp.State(initial=...")
def an_initial_value_that_is_set_later(b: Any, followed: bool) -> None:
    if followed:
        b.x[0.0].fix(0.2)
    else:
        b.x.initial = 0.2


@refused("ode 'o'", "uses t as a number", "In formulas of Pyomo's functions t is the time", "pyo.sin(t)", on=None)
def a_number_of_a_time_that_is_to_be_found(m: Any, followed: bool) -> None:
    b = cart(m, duration=rcp.Duration(bounds=(1, 3), initial_guess=2))
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] + (pyo.sin(t) if followed else math.sin(t))}, name="o")


@refused("ode 'o'", "reads 'p.v' of another model, 'leader'", "Put both into one model", on=None)
def a_phase_of_another_model(m: Any, followed: bool) -> None:
    b, leader = cart(m), pyo.ConcreteModel(name="leader")
    if followed:
        m.leader = pyo.Block()
    other = cart(m.leader if followed else leader)
    b.ode(lambda b, t: {b.x: other.v[t], b.v: b.u[t]}, name="o")


_POSITIVE = "max(x, 0) is (b.x[t] + b.name[t]) / 2"


def _choice(b: Any, chosen: Any, followed: bool) -> None:
    if followed:
        b.size = rcp.mechanics.AbsoluteValue(lambda b, t: b.x[t])
    b.ode(
        lambda b, t: {b.x: b.v[t], b.v: b.u[t] - ((b.x[t] + b.size[t]) / 2 if followed else chosen(b.x[t]))}, name="o"
    )


@refused("ode 'o'", "'if'", "Step for an 'if x > 0'", _POSITIVE, on=None)
def a_branch_on_a_state(m: Any, followed: bool) -> None:
    _choice(cart(m), lambda x: x if x > 0 else 0, followed)


@refused("ode 'o'", "asks whether a relation", "pyo.Expr_if or complementarity", on=None)
def the_larger_one_of_python(m: Any, followed: bool) -> None:
    _choice(cart(m), lambda x: max(x, 0), followed)


@refused("ode 'o'", "np.maximum", _POSITIVE, on=None)
def the_larger_one_of_numpy(m: Any, followed: bool) -> None:
    _choice(cart(m), lambda x: np.maximum(x, 0), followed)


@refused("ode 'o'", "rounds a variable", "AbsoluteValue", on=None)
def a_remainder(m: Any, followed: bool) -> None:
    _choice(cart(m), lambda x: x % 1, followed)


@refused("ode 'o'", "math.cos", "pyo.sin")
def a_function_of_the_math_module(b: Any, followed: bool) -> None:
    sine = pyo.sin if followed else math.sin
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] + sine(b.x[t])}, name="o")


@refused("ode 'o'", "np.arctan2", "rcp.array")
def a_function_of_numpy_with_two_arguments(b: Any, followed: bool) -> None:
    read = (lambda x: rcp.array([x])[0]) if followed else (lambda x: x)
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] + np.arctan2(read(b.x[t]), 1.0)}, name="o")


@fails("division by p.x[0.0] = 0, which is fixed", "needs another value, or a scheme without a point there", on=None)
def a_division_by_a_start_of_zero(m: Any, followed: bool) -> None:
    b = cart(m, final=None, **({} if followed else {"scheme": "hermite_simpson"}))
    m.effort = pyo.Objective(expr=b.integral(effort) + (b.x.at_end - 1) ** 2)
    b.ode(lambda b, t: {b.x: 1 + b.v[t], b.v: b.u[t] + 0.01 / b.x[t]}, name="o")


@fails("division by p.x[0.0] = 0, which is fixed")
def a_division_by_the_start_itself(b: Any, followed: bool) -> None:
    b.model().effort = pyo.Objective(expr=b.integral(effort))
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] + 1 / (b.x[0] + (1 if followed else 0))}, name="o")
