"""One run of Ipopt within the procedure, with what was recomputed at its end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus

from .tolerances import Tolerances


@dataclass(frozen=True)
class Step:
    """One run of Ipopt within the procedure.

    Attributes
    ----------
    label : str
        What kind of run it was.
    delta : float or None
        The bound of the products at its end; None for a problem without pairs.
    mu : float or None
        Ipopt's barrier parameter at its end, where it is known.
    status : IpoptStatus
    iterations : int
    seconds : float
    objective : float
        The user's objective at its last point.
    constraint_violation, largest_product, largest_natural_residual : float
        Recomputed at its last point.
    path : sequence of (mu, delta)
        Per iteration, where delta followed mu inside the run.
    """

    label: str
    delta: float | None
    mu: float | None
    status: IpoptStatus
    iterations: int
    seconds: float
    objective: float
    constraint_violation: float
    largest_product: float
    largest_natural_residual: float
    path: Sequence[tuple[float, float]] = field(default=(), repr=False)

    def excess(self, tolerances: Tolerances) -> float:
        """How far the residuals exceed the tolerances; 1 if they do not."""
        found = max(self.constraint_violation / tolerances.feasibility, self.largest_product / tolerances.product, 1.0)
        return found if found == found else float("inf")

    def __str__(self) -> str:
        delta = "-" if self.delta is None else f"{self.delta:.1e}"
        return (
            f"{self.label:<22} {delta:>8} {self.iterations:>6} {self.objective:>14.7g} "
            f"{self.constraint_violation:>9.1e} {self.largest_product:>9.1e} {self.seconds:>8.2f}  {self.status.name}"
        )


STEP_HEADER = (
    f"{'step':<22} {'delta':>8} {'iter':>6} {'objective':>14} {'violation':>9} {'max a*b':>9} {'seconds':>8}  status"
)
