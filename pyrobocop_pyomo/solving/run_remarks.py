"""What the runs of a solve have to say to the user."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from pyrobocop_pyomo.ipopt.linear_solvers import FELL_BACK

from .iterates import Iterate


def remarks_on_runs(steps: Iterable[Iterate]) -> Iterator[str]:
    """Sentences for the report of a result."""
    failed = [step.label for step in steps if step.options.get("linear_solver") == FELL_BACK]
    if failed:
        yield (
            f"The linear solver of this package failed in {len(failed)} of the runs ('{failed[0]}'), and MUMPS solved "
            "them again from the same start; options={'linear_solver': 'mumps'} takes it at once."
        )
