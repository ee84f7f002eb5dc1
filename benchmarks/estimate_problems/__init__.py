"""Smooth problems for which the estimated error of the objective is compared with the true one."""

from __future__ import annotations

from math import pi, sqrt, tanh

from . import one_phase, with_more
from .problem import FINE, FINER, EstimateProblem

_RADAU_2 = {"scheme": "radau", "stages": 2}
_GAUSS_2 = {"scheme": "gauss", "stages": 2}
_GAUSS_3 = {"scheme": "gauss", "stages": 3}
_LOBATTO_3 = {"scheme": "lobatto", "stages": 3}
_TRAPEZOID = {"scheme": "trapezoid"}
_EULER = {"scheme": "implicit_euler"}
_EXPLICIT_EULER = {"scheme": "explicit_euler"}
_RADAU_4 = {"scheme": "radau", "stages": 4}
_MIDPOINT = {"scheme": "implicit_midpoint"}

PROBLEMS = (
    EstimateProblem("integrator", "", one_phase.integrator, _EXPLICIT_EULER, (1, 2, 4), exact=tanh(3.0)),
    EstimateProblem(
        "unstable_regulator", "final value", one_phase.unstable_regulator, _EULER, (1, 2, 4),
        exact=1.0 / (sqrt(2.0) / tanh(2.0 * sqrt(2.0)) - 1.0),
    ),
    EstimateProblem("steepest_descent", "free time", one_phase.steepest_descent, _GAUSS_2, (2, 3, 4), exact=pi / 2),
    EstimateProblem("hanging_chain", "integral constraint", one_phase.hanging_chain, _GAUSS_3),
    EstimateProblem(
        "below_a_ceiling", "bound of a state", one_phase.below_a_ceiling, _EULER, (5, 10, 20), (10, 20, 40), exact=4.0
    ),
    EstimateProblem("van_der_pol", "bound of a state", one_phase.van_der_pol, _TRAPEZOID, (5, 10, 20), (10, 20, 40)),
    EstimateProblem("rayleigh", "", one_phase.rayleigh, _EXPLICIT_EULER, second_meshes=(40, 80, 160)),
    EstimateProblem("moving_limit", "limit of time", one_phase.moving_limit, _EULER, (5, 10, 20), (10, 20, 40)),
    EstimateProblem("mixed_limit", "limit of state and control", one_phase.mixed_limit, _GAUSS_3, (5, 10, 20)),
    EstimateProblem("stirred_tank", "", one_phase.stirred_tank, _EULER),
    EstimateProblem("batch_reactor", "maximised", one_phase.batch_reactor, _RADAU_2, (2, 4, 8)),
    EstimateProblem("orbit_raising", "data of time", one_phase.orbit_raising, _MIDPOINT, (4, 8, 12), (10, 20, 40)),
    EstimateProblem("ship", "free time", one_phase.ship, _EULER, (2, 4, 8), (10, 20, 40)),
    EstimateProblem("epidemic", "two controls", one_phase.epidemic, _RADAU_2, (3, 6, 12), (5, 10, 20)),
    EstimateProblem("cart_pole", "", one_phase.cart_pole, _LOBATTO_3, (15, 20, 30), (10, 20, 30)),
    EstimateProblem("bead_on_a_wire", "algebraic", with_more.bead_on_a_wire, _RADAU_2, (2, 4, 8)),
    EstimateProblem("fitted_decay", "parameters", with_more.fitted_decay, _EULER, (2, 4, 8), (10, 20, 40)),
    EstimateProblem("tuned_spring", "parameter, free time", with_more.tuned_spring, _GAUSS_2, (1, 2, 4), (2, 4, 8)),
    EstimateProblem("tracking", "data of time", with_more.tracking, _RADAU_4, (2, 4, 8), (2, 3, 6)),
    EstimateProblem("table_of_wind", "table", with_more.table_of_wind, _EULER, (2, 4, 8)),
    EstimateProblem("two_linked", "two phases, free times", with_more.two_linked, _EULER, (1, 2, 4), (5, 10, 20)),
    EstimateProblem(
        "by_parts", "two phases", with_more.by_parts, _LOBATTO_3, (1, 2, 3), (2, 4, 8), exact=sqrt(tanh(3.0))
    ),
)  # fmt: skip

__all__ = ["FINE", "FINER", "PROBLEMS", "EstimateProblem"]
