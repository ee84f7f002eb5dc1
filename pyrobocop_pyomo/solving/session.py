"""A relaxed model under solution: one run of Ipopt after another, each from a point that is given."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Protocol

from pyrobocop_pyomo.complementarity import BarrierSchedule
from pyrobocop_pyomo.ipopt.ipopt_outcome import IterationRecord
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import PrimalDualPoint

from .automatic_scaling import AutomaticScaling
from .ipopt_options import IpoptOptions
from .iterates import Iterate

OnIteration = Callable[[IterationRecord], Any]


class Session(Protocol):
    """Two ways to do the same: in process, or through the executable.

    The iterates that it returns are not checked yet by what the user stated, and their point is on the model.

    Attributes
    ----------
    solver, derivatives : str
        Which Ipopt, and which derivatives, for people to read.
    approximate : bool
        Whether it solves a problem that only resembles the model: its points violate the model's constraints.
    scaling : AutomaticScaling or None
        What the program of the last run was divided by for Ipopt: sizes at the point where it started. Nothing of it is
        left in what comes back.
    """

    solver: str
    derivatives: str
    approximate: bool
    scaling: AutomaticScaling | None

    def run(
        self, delta: float | None, options: Mapping[str, Any], deadline: Deadline, start: Iterate | None = None
    ) -> Iterate:
        """Solve with a fixed delta from the point on the model, with the multipliers of `start` where it is given."""
        ...

    def follow(self, schedule: BarrierSchedule, options: IpoptOptions, deadline: Deadline) -> Iterator[Iterate]:
        """Solve with delta following the barrier parameter, from the point on the model."""
        ...

    def compiled(self, *, anew: bool = False) -> CompiledModel | None:
        """The relaxed model as numbers, at the last delta; None where nothing here can take its derivatives.

        It may have been compiled before, unless it is requested as it is now.
        """
        ...

    def missing_rank(self) -> int:
        """Equations that are dependent at the point on the model, to first order; 0 where that is not known."""
        ...

    def coarsened(self, elements: int) -> Session | None:
        """A session of the same model on about so many elements; None where there is no such program."""
        ...

    def with_elastic_rows(self, price: float) -> Session | None:
        """A session of the same model whose rows may be violated; None where there is no such program.

        Parameters
        ----------
        price : float
            Of a violation of the size of its row, in sizes of the objective; without sizes, of a unit in its slopes.
        """
        ...

    def primal_dual(self, iterate: Iterate, compiled: CompiledModel) -> PrimalDualPoint:
        """The point on the model with the multipliers of an iterate of this session, in the order of `compiled`."""
        ...

    def close(self) -> None:
        """Take everything off the model that the session put there."""
        ...
