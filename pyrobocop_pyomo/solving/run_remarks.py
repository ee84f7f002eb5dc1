"""What the runs of a solve have to say to the user."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from pyrobocop_pyomo.ipopt.linear_solvers import FELL_BACK
from pyrobocop_pyomo.mpcc.active_set import Certificate

from .iterates import Iterate


def remarks_on_runs(steps: Iterable[Iterate], certificate: Certificate) -> Iterator[str]:
    """Sentences for the report of a result.

    Parameters
    ----------
    steps : iterable of Iterate
    certificate : Certificate
        Of the result.
    """
    steps = list(steps)
    undecided = [step.label for step in steps if "undecided" in step.label]
    if undecided and certificate is Certificate.UNKNOWN:
        yield (
            f"Whether another branch descends is not known: step '{undecided[-1]}' ended at its limit of linear "
            "programs or of time. Pairs with both sides near zero are what makes this search long."
        )
    failed = [step.label for step in steps if step.options.get("linear_solver") == FELL_BACK]
    if failed:
        yield (
            f"The linear solver of this package failed in {len(failed)} of the runs ('{failed[0]}'), and MUMPS solved "
            "them again; options={'linear_solver': 'mumps'} takes it at once."
        )
