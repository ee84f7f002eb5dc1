"""`print(result)`: one line on success, a second one where there is a doubt, and at most eight after a failure."""

from __future__ import annotations

from collections.abc import Iterable
from textwrap import shorten
from typing import Any

from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.presentation import percent

from .iterates import Quality, StopReason

MOST_LINES = 8
# Of a line that is shown; `report()` has all of it.
MOST_CHARACTERS = 400
# So many violated components, and so many of what stands against a solution, are named.
SHOWN_VIOLATIONS, SHOWN_OBSTRUCTIONS = 2, 3
# A remark that begins so is about a point that is not the answer.
FIRST_RUN = "Where the first run"

_NEARBY = {
    Certificate.PROVEN: "no better branch nearby",
    Certificate.DESCENT: "another branch descends",
    Certificate.UNKNOWN: "whether another branch descends is not known",
}
_ENDS = {
    StopReason.ITERATION_LIMIT: "the iteration limit was reached",
    StopReason.TIME_LIMIT: "the time limit was reached",
    StopReason.INTERRUPTED: "it was interrupted",
    StopReason.INFEASIBLE: "no point nearby violates less",
    StopReason.DIVERGED: "variables grow without end",
    StopReason.FAILED: "Ipopt failed",
}
_REMEDIES = {
    StopReason.ITERATION_LIMIT: "Raise it with options={'max_iter': ...}, or try another initial guess.",
    StopReason.TIME_LIMIT: "Raise time_limit.",
    StopReason.INFEASIBLE: "Relax what is not met, or try another initial guess.",
    StopReason.DIVERGED: "Bound what grows, or give it a cost; check the sign of the objective.",
    StopReason.FAILED: "Try another initial guess, or tee=True to see Ipopt's log.",
}


def short_text(result: Any) -> str:
    """What a user needs to know first.

    Parameters
    ----------
    result : SolveResult
    """
    lines = [_first_line(result), *_doubts(result)]
    if result.quality is Quality.INFEASIBLE:
        lines += _failure(result)
    elif not result.solved:
        lines += _suggestion(result)
    return "\n".join(shorten(line, MOST_CHARACTERS, placeholder=" ...") for line in lines[:MOST_LINES])


def _first_line(result: Any) -> str:
    mesh, violation = result.errors_of_answer, result.constraint_violation
    iterations = f"{result.iterations} iteration{'' if result.iterations == 1 else 's'}"
    exact = []
    if result.quality is Quality.INFEASIBLE:
        exact.append(f"violated by {violation:.2g}")
    elif result.residuals:
        exact.append(_pairs(result))
    elif mesh.phases or violation > 0.0:
        exact.append(f"{'equations' if mesh.phases else 'constraints'} to {max(violation, 1e-16):.0e}")
    if not result.residuals and (error := mesh.relative_objective_error) is not None:
        exact.append(f"mesh error {percent(error)} on {sum(of.elements or 0 for of in mesh.phases.values())} elements")
    done = f"objective {result.objective:.6g}, {iterations}, {result.seconds:.2g} s"
    return f"{result.name}: {_verdict(result)}. {'; '.join((done, ', '.join(exact))) if exact else done}"


def _verdict(result: Any) -> str:
    ended = f": {_ENDS[result.stop_reason]}" if result.stop_reason in _ENDS else ""
    unsafe = ", NOT SAFE" if result.advice_on_motion else ""
    if result.quality is Quality.INFEASIBLE:
        least = result.least_violation
        if least is not None and least.is_proof:
            return "NOT SOLVED, and proven to have no solution"
        return f"NOT SOLVED{unsafe}{ended}"
    if result.quality is Quality.FEASIBLE:
        return f"feasible, but not shown to be optimal{unsafe}{ended}"
    return f"solved{unsafe}" if unsafe or result.safety is None else "solved, and safe"


def _pairs(result: Any) -> str:
    count = len(result.residuals)
    exact = result.largest_natural_residual
    met = "exact" if exact <= 1e-12 else f"to {exact:.0e}"
    pairs = f"{count} pair{'s' if count > 1 else ''} {met}"
    return pairs if result.quality is not Quality.OPTIMAL else f"{pairs}, {_NEARBY[result.certificate]}"


def _doubts(result: Any) -> Iterable[str]:
    for doubt in result.doubts:
        yield f"DOUBTFUL: {doubt.message} {doubt.remedy}"
    if result.rounding is not None:
        yield str(result.rounding)
    if result.changed:
        yield f"CHANGED: {result.changed}"
    mesh = result.errors_of_answer
    if mesh.is_large:
        yield f"COARSE MESH: {mesh.in_words()}"
    yield from mesh.bounds_passed
    if result.advice_on_motion:
        yield result.advice_on_motion


def _failure(result: Any) -> Iterable[str]:
    """What is not met, what stands against a solution, and one thing to do."""
    for violation in result.violations[:SHOWN_VIOLATIONS]:
        yield f"not met: {violation}"
    least = result.least_violation
    if least is not None and least.obstructions:
        yield "What stands against it, of which one must give way:"
        for obstruction in least.obstructions[:SHOWN_OBSTRUCTIONS]:
            yield f"- {obstruction}"
    yield from _suggestion(result)


def _suggestion(result: Any) -> Iterable[str]:
    """One thing to do: what was noticed on the way, or what helps against how it ended."""
    noticed = [remark for remark in result.remarks if not remark.startswith(FIRST_RUN)]
    remedy = _REMEDIES.get(result.stop_reason)
    proven = result.least_violation is not None and result.least_violation.is_proof
    if not proven and (noticed or remedy):
        yield noticed[0] if noticed else str(remedy)
