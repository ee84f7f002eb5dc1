"""Every exception that this package raises on purpose.

::

    PyRobocopError
    ├── ModelError (ValueError)          what the user stated cannot be built
    │   ├── SchemeError                  a collocation scheme that does not exist or is inconsistent
    │   ├── MeshError                    element boundaries that are no mesh
    │   ├── RemeshingError               a phase that cannot get another mesh in place
    │   ├── DeclarationError             a state, control, ... or phase option that contradicts itself
    │   ├── TranscriptionError           equations that do not fit the declared variables
    │   ├── LinkError                    two phases that cannot be joined
    │   ├── InitialGuessError            an initial guess of the wrong shape, or not finite
    │   │   └── PathNotFound             a search for a path that ended without one
    │   ├── StructureChanged             a compiled model whose free variables or rows have changed since
    │   ├── ExpressionArrayError         a function of NumPy that has no meaning for expressions
    │   ├── GeometryError                a shape or a pose that is invalid: not convex, not closed, mirrored
    │   ├── ProblemClassError            a class with PyRoboCOP's methods that contradicts itself
    │   ├── ObstacleError                obstacles that cannot be avoided as stated
    │   ├── FunctionError                a function in Python whose arrays have a wrong shape, or a wrong derivative
    │   ├── EstimationError              data, outputs or parameters that do not fit together
    │   │   └── NotIdentifiable          parameters that the measurements do not see
    │   ├── KeywordError (TypeError)     a keyword that a function does not have
    │   ├── TeamError                    a team whose agents, shared quantities or graph do not fit together
    │   ├── ContradictionError           fixed values that violate a constraint, whatever the free ones are
    │   └── ComplementarityError         a pair that cannot be brought into 0 <= a ⟂ b >= 0
    ├── SolverNotFoundError              no Ipopt, or no derivatives for it, on this machine
    ├── BuildFailed (RuntimeError)       a step of building the executable, ASL's library or the linear solver failed
    ├── SolverOptionError (ValueError)   an option that Ipopt does not know, or a value that it refuses
    ├── EvaluationError (ArithmeticError) a value or a derivative of a nonlinear program does not exist or is not finite
    ├── SimulationFailed (RuntimeError)  a forward simulation that could not go on
    ├── TimeLimitReached (RuntimeError)  a computation that has no answer to give at its time limit
    ├── SingularMatrix (ArithmeticError) a matrix without an inverse, or with entries that are not finite
    ├── SensitivityError (ArithmeticError) a solution that has no derivative with respect to its data
    ├── SolveFailed (RuntimeError)       a solve that ended without the point that was asked for
    │   ├── HomotopyStalled              a path of data that could not be followed to its end
    │   └── TeamFailed                   a team whose rounds ended without a plan that holds
    ├── EngineError (RuntimeError)       where a team's agents live cannot be started, reached or sent what they need
    ├── CheckpointError (ValueError)     a file that a team cannot go on from
    └── TrajectoryError (ValueError)     a trajectory that cannot be read, evaluated or verified

`ModelError` and `TrajectoryError` are `ValueError` as well, so that code which knows nothing of this
package, Pyomo's own included, treats them as what they are: bad values.
"""

from __future__ import annotations

import pyomo.common.errors


class PyRobocopError(Exception):
    """Root of the tree: catching it catches everything that the package raises on purpose."""


class ModelError(PyRobocopError, ValueError):
    """What the user stated cannot be built."""


class SchemeError(ModelError):
    """A collocation scheme that does not exist or whose tableau is inconsistent."""


class MeshError(ModelError):
    """Element boundaries that do not form a mesh."""


class RemeshingError(ModelError):
    """A phase that cannot get another mesh in place: something on the model would be left behind."""


class DeclarationError(ModelError):
    """A declaration (state, control, phase option) that contradicts itself or another one."""


class TranscriptionError(ModelError):
    """Equations that do not fit the declared variables."""


class LinkError(ModelError):
    """Two phases that cannot be joined in the way asked for."""


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


class ExpressionArrayError(ModelError):
    """A function of NumPy, or a question of Python, that has no meaning for expressions."""


class GeometryError(ModelError):
    """A shape or a pose that is invalid: corners that are not convex, an open set, a mirrored rotation."""


class ProblemClassError(ModelError):
    """A class with PyRoboCOP's methods lacks one of them, contradicts itself, or fails when a method is evaluated."""


class ObstacleError(ModelError):
    """Obstacles that cannot be avoided as stated: a clearance of zero, a fixed pose that is too close."""


class FunctionError(ModelError):
    """A function in Python that is called or built wrongly, or whose derivatives are wrong."""


class EstimationError(ModelError):
    """Data, outputs or parameters of an estimation that do not fit together or to the model."""


class NotIdentifiable(EstimationError):
    """Parameters, or combinations of them, that the measurements do not see.

    Attributes
    ----------
    diagnosis : Diagnosis
        What is not seen, as findings.
    """

    def __init__(self, message: str, diagnosis: object = None) -> None:
        super().__init__(message)
        self.diagnosis = diagnosis


class KeywordError(ModelError, TypeError):
    """A function was given a keyword that it does not have; the message names the nearest one."""


class TeamError(ModelError):
    """A team whose agents, shared quantities, penalties or graph do not fit together."""


class StructureChanged(ModelError):
    """The free variables or the rows of a model have changed since it was compiled for repeated solves."""


class SolverNotFoundError(PyRobocopError):
    """No Ipopt, or no derivatives for it, could be found; the message lists the remedies."""


class BuildFailed(PyRobocopError, RuntimeError):
    """A step of building the executable, PyNumero's library or the linear solver failed; the message has its output."""


class SolverOptionError(PyRobocopError, ValueError):
    """An option that Ipopt does not know, or a value that it refuses."""


class EvaluationError(PyRobocopError, ArithmeticError):
    """A value or a derivative of a nonlinear program does not exist, or is not finite.

    Programs raise it, and nothing else, for a logarithm of a negative number, an overflow, the derivative of a square
    root at zero, and for Params or fixed variables that an expression is not defined for.
    """


class TimeLimitReached(PyRobocopError, RuntimeError):
    """The time limit passed in a computation that has no answer before its end."""


class SingularMatrix(PyRobocopError, ArithmeticError):
    """A matrix that has no inverse, to working precision, or entries that are not finite."""


class SensitivityError(PyRobocopError, ArithmeticError):
    """A solution has no derivative with respect to its data: it has a kink there, or is not unique."""


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
    """A solve ended without the point that was asked for.

    Attributes
    ----------
    result : object or None
        The result whose ``raise_for_status`` raised; the best point found is on the model.
    """

    def __init__(self, message: str, result: object = None) -> None:
        super().__init__(message)
        self.result = result


class HomotopyStalled(SolveFailed):
    """A path of data could not be followed to its end; the model holds the last data that were solved, with the point.

    Attributes
    ----------
    result : HomotopyResult
        What was solved.
    position : float
        How much of the path, from 0 to 1; negative where even its start could not be solved.
    """

    def __init__(self, message: str, result: object, position: float) -> None:
        super().__init__(message, result)
        self.position = position


class TeamFailed(SolveFailed):
    """The rounds of a team ended without a plan that holds physically, or without agreement."""


class EngineError(PyRobocopError, RuntimeError):
    """An engine that is not installed, cannot be started or reached, or an agent that cannot be sent to it."""


class CheckpointError(PyRobocopError, ValueError):
    """A file that a team cannot go on from: missing, damaged, or written by another team."""


class TrajectoryError(PyRobocopError, ValueError):
    """A trajectory that cannot be read, evaluated or verified."""
