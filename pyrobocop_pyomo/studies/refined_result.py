"""What `solve_refined` gives back: the last model, its result, and one line per mesh."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.errors import SolveFailed, TrajectoryError
from pyrobocop_pyomo.optional_imports import pandas
from pyrobocop_pyomo.solving.iterates import Quality
from pyrobocop_pyomo.solving.solve_result import SolveResult
from pyrobocop_pyomo.trajectories import Trajectory

Array = NDArray[np.float64]

REFINEMENT_HEADER = (
    f"{'mesh':>4} {'elements':>8} {'error':>9} {'objective':>16} {'iterations':>10} {'seconds':>8}  quality"
)


class RefinementEnd(enum.Enum):
    """Why refinement ended; the value is a sentence."""

    REACHED = "Every element's error is within the tolerance."
    MESH_LIMIT = "The limit of meshes was reached. Raise most_meshes, or start from a finer mesh."
    ELEMENT_LIMIT = "The next mesh would exceed the limit of elements. Raise most_elements or the tolerance."
    FAILED = "No acceptable point was found on this mesh. Start from another mesh or guess, or look with tee=True."


@dataclass(frozen=True)
class RefinementStep:
    """One mesh.

    Attributes
    ----------
    elements : int
        Of all refined phases together.
    error : float
        Largest error of an element; NaN where the solve failed.
    objective : float
    iterations : int
        Of Ipopt.
    seconds : float
        Building, solving and estimating.
    quality : Quality
        Of the solved point.
    """

    elements: int
    error: float
    objective: float
    iterations: int
    seconds: float
    quality: Quality

    def row(self, number: int) -> str:
        """This mesh as a line of the table."""
        return (
            f"{number:>4} {self.elements:>8} {self.error:>9.1e} {self.objective:>16.9g} {self.iterations:>10} "
            f"{self.seconds:>8.2f}  {self.quality.name}"
        )


@dataclass(frozen=True, eq=False)
class RefinedResult:
    """The answer of `solve_refined`; printing it shows the table of meshes.

    Attributes
    ----------
    model : ConcreteModel
        On the last mesh, holding its answer.
    result : SolveResult
        Of the last solve.
    trajectories : dict of phase name to Trajectory
        The answer.
    errors : dict of phase name to array, shape (N,)
        Errors of the last mesh's elements; empty after a failure.
    steps : list of RefinementStep
        One per mesh.
    tolerance : float
        What was asked for.
    end : RefinementEnd
        Why it ended.
    """

    model: Any = field(repr=False)
    result: SolveResult = field(repr=False)
    trajectories: Mapping[str, Trajectory] = field(repr=False)
    errors: Mapping[str, Array] = field(repr=False)
    steps: list[RefinementStep]
    tolerance: float
    end: RefinementEnd

    @property
    def reached(self) -> bool:
        """True when every element's error is within the tolerance, and the last point is optimal."""
        return self.end is RefinementEnd.REACHED and self.result.solved

    @property
    def trajectory(self) -> Trajectory:
        """The answer, where one phase was refined.

        Raises
        ------
        TrajectoryError
            When there are several.
        """
        if len(self.trajectories) != 1:
            raise TrajectoryError(
                f"refined were {', '.join(self.trajectories)}: read trajectories['{next(iter(self.trajectories))}']."
            )
        return next(iter(self.trajectories.values()))

    @property
    def iterations(self) -> int:
        """Ipopt's iterations on all meshes together."""
        return sum(step.iterations for step in self.steps)

    @property
    def seconds(self) -> float:
        """Time of all meshes together."""
        return sum(step.seconds for step in self.steps)

    def raise_for_status(self) -> None:
        """Do nothing when the tolerance was reached at an optimal point.

        Raises
        ------
        SolveFailed
            Otherwise; this object is its attribute ``result``.
        """
        if self.reached:
            return
        last = self.steps[-1]
        raise SolveFailed(
            f"'{self.result.name}': {self.end.value} Mesh {len(self.steps)} has {last.elements} elements and the error "
            f"{last.error:.1e}; asked was {self.tolerance:g}. {self.result.quality.value}",
            self,
        )

    def to_pandas(self) -> Any:
        """The table of meshes as a data frame."""
        columns = ("elements", "error", "objective", "iterations", "seconds")
        rows = [
            {**{name: getattr(step, name) for name in columns}, "quality": step.quality.name} for step in self.steps
        ]
        return pandas.DataFrame(rows, index=pandas.RangeIndex(1, len(rows) + 1, name="mesh"))

    def __str__(self) -> str:
        rows = [step.row(i) for i, step in enumerate(self.steps, start=1)]
        return "\n".join(
            [f"{self.result.name}: {self.end.value} Asked was {self.tolerance:g}.", REFINEMENT_HEADER, *rows]
        )
