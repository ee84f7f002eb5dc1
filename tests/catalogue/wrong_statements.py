"""Mistakes that are refused where they are made."""

from __future__ import annotations

from typing import Any

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import InitialGuessError, ModelError

from .entries import Mistake, pushed, refused_at_once

NAN, INF = float("nan"), float("inf")


# -------------------------------------------------------------------- horizon, mesh and scheme


@refused_at_once(ModelError, "phase 'p': elements = 0; expected an integer of at least 1")
def zero_elements(m: Any) -> Mistake:
    yield
    m.p = rcp.PhaseBlock(elements=0)


@refused_at_once(ModelError, "must increase, but boundary 1 is 0.6 and boundary 2 is 0.5")
def decreasing_mesh(m: Any) -> Mistake:
    yield
    m.p = rcp.PhaseBlock(mesh=[0, 0.6, 0.5, 1])


@refused_at_once(ModelError, "phase 'p': duration = -1; expected a positive number")
def negative_duration(m: Any) -> Mistake:
    yield
    m.p = rcp.PhaseBlock(duration=-1)


@refused_at_once(ModelError, "lower bound of the duration is None; it must be positive")
def free_duration_without_lower_bound(m: Any) -> Mistake:
    yield
    m.p = rcp.PhaseBlock(duration=rcp.Duration(bounds=(None, 2)))


@refused_at_once(ModelError, "control 'w' .*: knot 0.3 is no element boundary; the nearest is 0.25. The mesh is too")
def mesh_too_coarse_for_a_held_control(m: Any) -> Mistake:
    b = pushed(m)
    yield
    b.w = rcp.Control(parametrization="piecewise_constant", knots=(0, 0.3, 1))


@refused_at_once(ModelError, "control 'w' .* neighbouring elements share a collocation point")
def held_control_with_shared_points(m: Any) -> Mistake:
    b = pushed(m, scheme="lobatto", stages=3)
    yield
    b.w = rcp.Control(parametrization="piecewise_constant")


# -------------------------------------------------------------------- declarations


@refused_at_once(ModelError, "state 'y' .*: its final value 2 lies outside its bounds")
def final_value_outside_bounds(m: Any) -> Mistake:
    b = pushed(m)
    yield
    b.y = rcp.State(final=2, bounds=(0, 1))


@refused_at_once(ModelError, "bounds = .* hold a NaN")
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
