"""Three smooth problems of optimal control and three ways to state them, each written as its users write it."""

from .acrobot import ACROBOT
from .by_casadi import solved_by_casadi
from .by_phase import solved_by_phase
from .by_pyomo_dae import solved_by_pyomo_dae
from .pendulum import PENDULUM
from .problem import Answer, SmoothProblem
from .quadrotor import QUADROTOR

PROBLEMS = {problem.name: problem for problem in (PENDULUM, ACROBOT, QUADROTOR)}

__all__ = [
    "ACROBOT",
    "PENDULUM",
    "PROBLEMS",
    "QUADROTOR",
    "Answer",
    "SmoothProblem",
    "solved_by_casadi",
    "solved_by_phase",
    "solved_by_pyomo_dae",
]
