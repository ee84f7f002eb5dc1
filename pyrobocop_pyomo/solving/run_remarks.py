"""What the runs of a solve have to say to the user."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from pyrobocop_pyomo.complementarity import CanonicalPair
from pyrobocop_pyomo.diagnosis import Finding, Severity, Subject
from pyrobocop_pyomo.ipopt.linear_solvers import FELL_BACK
from pyrobocop_pyomo.mpcc.active_set import Certificate

from .iterates import Iterate
from .side_sizes import SMALLEST_SIZE
from .strategies import ABSOLUTE_VALUES


def remarks_on_runs(steps: Iterable[Iterate], certificate: Certificate) -> Iterator[str]:
    """Sentences for the report of a result.

    Parameters
    ----------
    steps : iterable of Iterate
    certificate : Certificate
        Of the result.
    """
    steps = list(steps)
    if any(step.label == ABSOLUTE_VALUES.name and step.converged for step in steps):
        yield (
            "Absolute values have no derivative at zero: a copy with their two parts was solved, as "
            "pyrobocop.absolute_values_to_complementarity makes it. Stationarity is that of the copy, all else that of "
            "the model."
        )
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


def doubts_on_point(best: Iterate) -> tuple[Finding, ...]:
    """Why the best point of a model without pairs may not be what was meant.

    Parameters
    ----------
    best : Iterate
    """
    if best.certificate is not Certificate.DESCENT:
        return ()
    message = (
        "The point is stationary, but no minimum: along a direction that the constraints leave free the objective "
        "falls, and no better point was reached along it."
    )
    remedy = "Give an initial guess that is not symmetric, or compare several starts: rcp.studies.multistart(model)."
    return (Finding(Severity.WARNING, Subject.OUTCOME, message, (), remedy),)


def doubts_on_pairs(too_small: Sequence[CanonicalPair]) -> tuple[Finding, ...]:
    """Why pairs may not be met although both sides are within the tolerances.

    Parameters
    ----------
    too_small : sequence of CanonicalPair
        Met only if what their sides have left is zero and not small.
    """
    if not too_small:
        return ()
    message = (
        f"Both sides of pair '{too_small[0].name}' differ from zero, and one of them is smaller than {SMALLEST_SIZE:g} "
        f"all the time: whether such pairs are met, {len(too_small)} in all, is not known."
    )
    remedy = "State what is so small in a smaller unit, so that it has values near 1."
    return (Finding(Severity.WARNING, Subject.OUTCOME, message, (), remedy),)
