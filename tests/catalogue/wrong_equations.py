"""Mistakes in how equations and unknowns fit together."""

from __future__ import annotations

from typing import Any

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.diagnosis import Subject

from .entries import Mistake, found_by_diagnosis, pendulum, pushed, refused_by_check, rod, rod_in_velocities

# -------------------------------------------------------------------- counts and appearances


@refused_by_check("phase 'p': too few equations. 2 states and 1 algebraic need 3")
def missing_equation(m: Any) -> Mistake:
    b = pushed(m)
    yield
    b.z = rcp.Algebraic()


@refused_by_check("phase 'p': too many equations. 2 states and 1 algebraic need 3 .* 2 in residuals")
def too_many_equations(m: Any) -> Mistake:
    b = pushed(m)
    b.z = rcp.Algebraic()
    yield

    def springs(b: Any, t: float) -> Any:
        return [b.z[t] == b.x[t], b.z[t] == 2 * b.x[t]]

    b.residual(springs)


@refused_by_check("control 'w' .* with the scheme .* has weight 0")
def control_at_a_stage_without_weight(m: Any) -> Mistake:
    b = pushed(m, scheme="explicit", stages=2, controlled="piecewise_constant")
    yield
    b.w = rcp.Control()


@refused_by_check("parameter 'mass' .* appears in no equation, constraint or objective")
def parameter_nowhere(m: Any) -> Mistake:
    b = pushed(m)
    yield
    b.mass = rcp.Parameter(initial_guess=1)


@refused_by_check("algebraic 'z' .* appears in no equation, constraint or objective")
def algebraic_nowhere(m: Any) -> Mistake:
    b = pushed(m)
    yield
    b.z = rcp.Algebraic()

    def of_another(b: Any, t: float) -> Any:
        return b.u[t] == b.x[t]

    b.residual(of_another)


# -------------------------------------------------------------------- index


@refused_by_check(
    "phase 'swing': the index is higher than 1 .* equation 'rod' holds no .* determines unknown 'tension'"
)
def index_three(m: Any) -> Mistake:
    b = pendulum(m)
    yield
    b.residual(rod)


@refused_by_check("index is higher than 1 .* equation 'rod_in_velocities' .* nothing determines unknown 'tension'")
def index_two(m: Any) -> Mistake:
    b = pendulum(m)
    yield
    b.residual(rod_in_velocities)


@refused_by_check(r"equations 'pair\[0\]', 'pair\[1\]' share only unknown 'y', while nothing determines unknown 'z'")
def two_equations_for_one_algebraic(m: Any) -> Mistake:
    b = pushed(m)
    b.y, b.z = rcp.Algebraic(), rcp.Algebraic(bounds=(0, 1))

    def both(b: Any, t: float) -> Any:
        return b.z[t] + b.x[t] <= 3

    b.constraint(both)
    yield

    def pair(b: Any, t: float) -> Any:
        return [b.y[t] == b.x[t], b.y[t] == 2 * b.v[t]]

    b.residual(pair)


@found_by_diagnosis(Subject.INDEX, "phase 'swing': the index is higher than 1 .* 'rod'", "swing.rod")
def higher_index_that_was_allowed(m: Any) -> Mistake:
    b = pendulum(m, allow_higher_index=True)
    yield
    b.residual(rod)


@found_by_diagnosis(Subject.INDEX, "'feedback' can determine controls only", "p.feedback")
def equation_that_determines_a_control(m: Any) -> Mistake:
    b = pushed(m)
    b.z = rcp.Algebraic(bounds=(0, None))
    yield

    def feedback(b: Any, t: float) -> Any:
        return b.u[t] == -b.x[t]

    def stop(b: Any, t: float) -> Any:
        return rcp.complements(b.x[t] + 1 >= 0, b.z[t] >= 0)

    b.residual(feedback)
    b.complementarity(stop)


@found_by_diagnosis(Subject.UNDETERMINED, "no equation and no pair is left to determine 'z'", "p.z")
def pair_that_does_not_hold_the_algebraic(m: Any) -> Mistake:
    b = pushed(m)
    b.z = rcp.Algebraic(bounds=(0, 1))

    def limit(b: Any, t: float) -> Any:
        return b.z[t] + b.x[t] <= 3

    b.constraint(limit)
    yield

    def stop(b: Any, t: float) -> Any:
        return rcp.complements(b.x[t] + 1 >= 0, b.u[t] + 1 >= 0)

    b.complementarity(stop)


@found_by_diagnosis(Subject.DEPENDENT, "one of the equations 'p.forces' follows from the others", "p.forces")
def redundant_equation(m: Any) -> Mistake:
    b = pushed(m)
    b.y, b.z = rcp.Algebraic(), rcp.Algebraic()
    yield

    def forces(b: Any, t: float) -> Any:
        return [b.y[t] + b.z[t] == b.x[t], 2 * b.y[t] + 2 * b.z[t] == 2 * b.x[t]]

    b.residual(forces)
