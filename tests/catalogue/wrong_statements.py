"""Mistakes that are refused where they are made."""

from __future__ import annotations

from typing import Any

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import (
    ComplementarityError,
    DeclarationError,
    InitialGuessError,
    MeshError,
    SchemeError,
    TranscriptionError,
)

from .entries import Mistake, pushed, refused_at_once

NAN, INF = float("nan"), float("inf")


# -------------------------------------------------------------------- horizon, mesh and scheme


@refused_at_once(SchemeError, "phase 'p': unknown scheme 'simpson'; known are")
def unknown_scheme(m: Any) -> Mistake:
    yield
    m.p = rcp.PhaseBlock(scheme="simpson")


@refused_at_once(MeshError, "phase 'p': elements = 0; expected an integer of at least 1")
def zero_elements(m: Any) -> Mistake:
    yield
    m.p = rcp.PhaseBlock(elements=0)


@refused_at_once(MeshError, "must increase, but boundary 1 is 0.6 and boundary 2 is 0.5")
def decreasing_mesh(m: Any) -> Mistake:
    yield
    m.p = rcp.PhaseBlock(mesh=[0, 0.6, 0.5, 1])


@refused_at_once(DeclarationError, "phase 'p': duration = -1; expected a positive number")
def negative_duration(m: Any) -> Mistake:
    yield
    m.p = rcp.PhaseBlock(duration=-1)


@refused_at_once(DeclarationError, "lower bound of the duration is None; it must be positive")
def free_duration_without_lower_bound(m: Any) -> Mistake:
    yield
    m.p = rcp.PhaseBlock(duration=rcp.Duration(bounds=(None, 2)))


@refused_at_once(
    DeclarationError, "control 'w' .*: knot 0.3 is no element boundary; the nearest is 0.25. The mesh is too"
)
def mesh_too_coarse_for_a_held_control(m: Any) -> Mistake:
    b = pushed(m)
    yield
    b.w = rcp.Control(parametrization="piecewise_constant", knots=(0, 0.3, 1))


@refused_at_once(DeclarationError, "control 'w' .* neighbouring elements share a collocation point")
def held_control_with_shared_points(m: Any) -> Mistake:
    b = pushed(m, scheme="lobatto", stages=3)
    yield
    b.w = rcp.Control(parametrization="piecewise_constant")


# -------------------------------------------------------------------- declarations


@refused_at_once(DeclarationError, "state 'y' .*: its final value 2 lies outside its bounds")
def final_value_outside_bounds(m: Any) -> Mistake:
    b = pushed(m)
    yield
    b.y = rcp.State(final=2, bounds=(0, 1))


@refused_at_once(DeclarationError, "bounds = .* hold a NaN")
def bound_that_is_no_number(m: Any) -> Mistake:
    b = pushed(m)
    yield
    b.y = rcp.Algebraic(bounds=(NAN, 1))


@refused_at_once(InitialGuessError, "control 'w'.*: value 1 of the initial guess is nan")
def guess_that_is_no_number(m: Any) -> Mistake:
    b = pushed(m)
    yield
    b.w = rcp.Control(initial_guess=[0, NAN, 0, 0])


@refused_at_once(
    InitialGuessError,
    "state 'y': the initial guess has 3 values; 4 element boundaries|state 'y': the initial guess has 3 values",
)
def guess_of_the_wrong_length(m: Any) -> Mistake:
    b = pushed(m)
    yield
    b.y = rcp.State(initial_guess=[1, 2, 3])


@refused_at_once(DeclarationError, "the name 'x' .* is taken. Choose another")
def name_taken(m: Any) -> Mistake:
    b = pushed(m)
    yield
    b.x = rcp.Control()


# -------------------------------------------------------------------- statements


@refused_at_once(TranscriptionError, "ode 'forgetful' returned nothing at t = .* Is the return statement missing")
def rule_returning_none(m: Any) -> Mistake:
    b = pushed(m)
    b.y = rcp.State(initial=0)
    yield

    def forgetful(b: Any, t: float) -> None:
        {b.y: 1.0}  # noqa: B018

    b.ode(forgetful)


@refused_at_once(TranscriptionError, "'u' is no state; its states are x, v")
def wrong_key_in_an_ode(m: Any) -> Mistake:
    b = pushed(m)
    yield
    b.ode(lambda b, t: {b.u: 1.0})


@refused_at_once(TranscriptionError, "second equation for state 'x'; 'newton' has given one")
def second_equation_for_a_state(m: Any) -> Mistake:
    b = pushed(m)
    yield
    b.ode(lambda b, t: {b.x: 1.0})


@refused_at_once(ComplementarityError, "a side is the constant 1")
def pair_of_constants(m: Any) -> Mistake:
    b = pushed(m)
    yield

    def constants(b: Any, t: float) -> Any:
        return rcp.complements(1.0, 2.0)

    b.complementarity(constants)
