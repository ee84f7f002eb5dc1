"""Every exception that this package raises on purpose.

::

    PyRobocopError
    ├── ModelError (ValueError)          what the user stated cannot be built, or contradicts itself
    │   ├── ComplementarityError         a pair that cannot be brought into 0 <= a ⟂ b >= 0
    │   ├── ContradictionError           fixed values that violate a constraint, whatever the free ones are
    │   ├── EstimationError              data, outputs or parameters that do not fit together, or are not seen
    │   ├── FunctionError                a function in Python whose arrays have a wrong shape, or a wrong derivative
    │   ├── InitialGuessError            an initial guess of the wrong shape, or not finite
    │   │   └── PathNotFound             a search for a path that ended without one
    │   ├── KeywordError (TypeError)     a keyword that a function does not have
    │   ├── ObstacleError                shapes, poses or obstacles that are invalid or cannot be avoided as stated
    │   └── TeamError                    agents, shared quantities or a checkpoint that do not fit together
    ├── SolverNotFoundError              no Ipopt, or no derivatives for it, on this machine, or none could be built
    ├── EngineError (RuntimeError)       where a team's agents live cannot be started, reached or sent what they need
    ├── EvaluationError (ArithmeticError) a value, a derivative or an inverse does not exist or is not finite
    ├── SimulationFailed (RuntimeError)  a forward simulation that could not go on
    ├── SolveFailed (RuntimeError)       a solve that ended without the point that was asked for
    └── TrajectoryError (ValueError)     a trajectory that cannot be read, evaluated or verified

`ModelError` and `TrajectoryError` are `ValueError` as well, so that code which knows nothing of this
package, Pyomo's own included, treats them as what they are: bad values.
"""

from __future__ import annotations

import pyomo.common.errors


class PyRobocopError(Exception):
    """Root of the tree: catching it catches everything that the package raises on purpose."""


class ModelError(PyRobocopError, ValueError):
    """What the user stated cannot be built, or contradicts itself."""


class InitialGuessError(ModelError):
    """An initial guess that has the wrong length, the wrong type or values that are not finite."""


class PathNotFound(InitialGuessError):
    """A search for a path that ended without one.

    Attributes
    ----------
    expansions : int
        How much was searched, as `CarSearch.max_expansions` counts; 0: not even a disc inside the car has a way.
    """

    def __init__(self, message: str, expansions: int) -> None:
        super().__init__(message)
        self.expansions = expansions


class ContradictionError(ModelError, pyomo.common.errors.InfeasibleConstraintException):
    """Fixed values violate a constraint, whatever the free ones are."""


class ComplementarityError(ModelError):
    """A pair that cannot be brought into the form ``0 <= a ⟂ b >= 0``."""


class ObstacleError(ModelError):
    """A shape, a pose or obstacles that are invalid or cannot be avoided as stated.

    Corners that are not convex, a mirrored rotation, a clearance of zero, a fixed pose that is too close.
    """


class FunctionError(ModelError):
    """A function in Python that is called or built wrongly, or whose derivatives are wrong."""


class EstimationError(ModelError):
    """Data, outputs or labels of an estimation that do not fit together."""


class KeywordError(ModelError, TypeError):
    """A function was given a keyword that it does not have; the message names the nearest one."""


class TeamError(ModelError):
    """Agents, shared quantities, penalties or a checkpoint of a team that do not fit together."""


class SolverNotFoundError(PyRobocopError):
    """No Ipopt, or no derivatives for it, could be found or built; the message lists the remedies."""


class EvaluationError(PyRobocopError, ArithmeticError):
    """A value, a derivative or an inverse does not exist, or is not finite.

    Programs raise it, and nothing else, for a logarithm of a negative number, an overflow, the derivative of a square
    root at zero, and for Params or fixed variables that an expression is not defined for; matrices, where they are
    singular to working precision; sensitivities, where a solution has a kink or is not unique.
    """


class SimulationFailed(PyRobocopError, RuntimeError):
    """A forward simulation that could not go on.

    Attributes
    ----------
    time : float
        Where it stopped.
    trajectory : Trajectory or None
        The elements before; None when it stopped in the first.
    """

    def __init__(self, message: str, time: float, trajectory: object = None) -> None:
        super().__init__(message)
        self.time = time
        self.trajectory = trajectory


class SolveFailed(PyRobocopError, RuntimeError):
    """A solve ended without the point that was asked for: no solution, a plan that does not hold, or no time left.

    Attributes
    ----------
    result : object or None
        The result whose ``raise_for_status`` raised; the best point found is on the model.
    """

    def __init__(self, message: str, result: object = None) -> None:
        super().__init__(message)
        self.result = result


class EngineError(PyRobocopError, RuntimeError):
    """An engine that is not installed, cannot be started or reached, or an agent that cannot be sent to it."""


class TrajectoryError(PyRobocopError, ValueError):
    """A trajectory that cannot be read, evaluated or verified."""
