"""Nonsmooth problems of optimal control with known answers: switches, sliding, friction, impacts, hysteresis."""

from . import (
    belt,
    cart_pole_with_friction,
    discs,
    friction,
    hop,
    overflow,
    pushed_blocks,
    relay_feedback,
    signum,
    sliding,
    thermostat,
    throw,
    turbo_car,
    turbo_car_with_hysteresis,
)
from .problem import Assessment, NonsmoothProblem

PROBLEMS = {
    problem.name: problem
    for problem in (
        signum.PROBLEM,
        sliding.STEP,
        sliding.MODES,
        relay_feedback.PROBLEM,
        friction.PROBLEM,
        belt.PROBLEM,
        turbo_car.PROBLEM,
        turbo_car_with_hysteresis.PROBLEM,
        thermostat.PROBLEM,
        pushed_blocks.PROBLEM,
        overflow.PROBLEM,
        throw.PROBLEM,
        discs.PROBLEM,
        hop.PROBLEM,
        cart_pole_with_friction.PROBLEM,
    )
}

__all__ = ["PROBLEMS", "Assessment", "NonsmoothProblem"]
