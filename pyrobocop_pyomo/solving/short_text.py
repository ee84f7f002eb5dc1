"""`print(result)`: one line on success, one more on pairs and for each doubt, and at most eight after a failure."""

from __future__ import annotations

import math
from collections.abc import Iterable
from textwrap import shorten
from typing import Any

from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.phases import phases_of
from pyrobocop_pyomo.presentation import percent

from .iterates import Quality, StopReason
from .least_violation import STANDS_AGAINST, Least
from .obstructions import first_try
from .result_text import CLEAR_START

MOST_LINES = 8
# Of a line that is shown; `report()` has all of it.
MOST_CHARACTERS = 400
# So many violated components, and so many together with what stands against a solution, are named.
SHOWN_VIOLATIONS, SHOWN_OBSTRUCTIONS = 2, 5
IN_THE_WAY = "What stands against a solution near the best point found:"
FAR = " If you know that there is a solution, start nearer to it: try another initial guess."
# A remark that begins so is about a point that is not the answer.
FIRST_RUN = "Where the first run"

_NEARBY = {
    Certificate.PROVEN: "no better choice of zero sides nearby",
    Certificate.DESCENT: "another choice of zero sides is better",
    Certificate.UNKNOWN: "whether another choice of zero sides is better is not known",
}
_ENDS = {
    StopReason.ITERATION_LIMIT: "the iteration limit was reached",
    StopReason.TIME_LIMIT: "the time limit was reached",
    StopReason.INTERRUPTED: "it was interrupted",
    StopReason.INFEASIBLE: "no point nearby violates less",
    StopReason.DIVERGED: "variables grow without end",
    StopReason.FAILED: "Ipopt could not go on",
}


def short_text(result: Any) -> str:
    """What a user needs to know first.

    Parameters
    ----------
    result : SolveResult
    """
    lines = [_first_line(result)]
    if result.residuals and result.quality is not Quality.INFEASIBLE:
        lines.append(_pairs(result))
    lines += _doubts(result)
    if result.quality is Quality.INFEASIBLE:
        lines += _failure(result)
    elif not result.solved:
        lines += _suggestion(result)
    return "\n".join(shorten(line, MOST_CHARACTERS, placeholder=" ...") for line in lines[:MOST_LINES])


def _first_line(result: Any) -> str:
    mesh, violation = result.errors_of_answer, result.constraint_violation
    if result.quality is Quality.INFEASIBLE:
        violation = max(violation, result.largest_natural_residual)
    iterations = f"{result.iterations} iteration{'' if result.iterations == 1 else 's'}"
    exact = []
    if result.quality is Quality.INFEASIBLE:
        # How far a plane between shapes is passed says less than how far they overlap, which the next line says.
        if not math.isfinite(violation):
            exact.append("expressions have no value")
        elif not _is_in_the_way(result):
            exact.append(f"largest violation {violation:.2g} in the model's units")
    elif not result.best.diverged:
        if mesh.phases or violation > 0.0:
            exact.append(f"{'equations' if mesh.phases else 'constraints'} to {max(violation, 1e-16):.0e}")
        if mesh.phases:
            exact.append(_mesh(mesh))
    # The objective of a point that is no solution says nothing.
    objective = "" if result.quality is Quality.INFEASIBLE else f"objective {result.objective:.6g}, "
    done = f"{objective}{iterations}, {format(result.seconds, '.2g' if result.seconds < 10 else '.0f')} s"
    return f"{result.name}: {_verdict(result)}. {'; '.join((done, ', '.join(exact))) if exact else done}"


def _mesh(mesh: Any) -> str:
    """What the mesh makes of the objective, or where that is not known of the motion."""
    elements = f"on {sum(of.elements or 0 for of in mesh.phases.values())} elements"
    if (error := mesh.relative_objective_error) is not None:
        return f"mesh error {percent(error)} {elements}"
    if (error := mesh.motion_error) is not None:
        return f"mesh error of the motion {percent(error)} {elements}, of the objective not known"
    return "mesh error not known: result.report() says why"


def _verdict(result: Any) -> str:
    ended = f": {_ENDS[result.stop_reason]}" if result.stop_reason in _ENDS else ""
    unsafe = ", NOT SAFE" if result.advice_on_motion else ""
    if result.quality is Quality.INFEASIBLE:
        least = result.least_violation
        if least is not None and least.is_proof:
            return "NOT SOLVED, and proven to have no solution"
        return f"NOT SOLVED{unsafe}{ended}"
    if result.best.diverged:
        return f"NOT SOLVED{unsafe}{ended}"
    if result.quality is Quality.FEASIBLE:
        return f"feasible, but not shown to be optimal{unsafe}{ended}"
    if unsafe:
        return "NOT SAFE"
    kept = "clearances kept at all times" if result.safety is not None and result.safety.between else "clearances kept"
    return "solved" if result.safety is None else f"solved, and safe: {kept}"


def _pairs(result: Any) -> str:
    count = len(result.residuals)
    exact = result.largest_natural_residual
    met = "exact" if exact <= 1e-12 else f"to {exact:.0e}"
    pairs = f"{count} complementarity pair{'s' if count > 1 else ''} {met}"
    return f"{pairs}, {_NEARBY[result.certificate]}" if result.quality is Quality.OPTIMAL else pairs


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
    if motion := _motion(result):
        yield motion.removesuffix(f" {CLEAR_START}")


def _motion(result: Any) -> str:
    """What a motion lacks; where no motion exists at all, obstacles are not what is in the way."""
    least = result.least_violation
    return "" if least is not None and least.is_proof else str(result.advice_on_motion)


def _is_in_the_way(result: Any) -> bool:
    """Whether bodies that come too close are what a motion lacks."""
    return _motion(result).endswith(CLEAR_START)


def _failure(result: Any) -> Iterable[str]:
    """What is not met, what stands against a solution, and one thing to do."""
    least = result.least_violation
    # What helps is the last line, and must not be cut off by what is said of a motion.
    is_long = bool(result.advice_on_motion) and least is not None and bool(least.obstructions)
    overlaps = _is_in_the_way(result)
    unmet = [one for one in result.violations if not (overlaps and one.where.startswith("clearance between"))]
    unmet = unmet[: 1 if is_long else SHOWN_VIOLATIONS]
    for violation in unmet:
        yield f"not met: {violation}"
    if least is not None and least.obstructions:
        yield STANDS_AGAINST if least.is_proof else f"Not proven to be impossible. {IN_THE_WAY}"
        shown = list(least.obstructions[: SHOWN_OBSTRUCTIONS - max(len(unmet), 1)])
        fixed = [obstruction for obstruction in least.obstructions if obstruction.is_fixed]
        if fixed and not any(obstruction.is_fixed for obstruction in shown):
            shown[-1] = fixed[0]  # an end that was given wrongly is what a user looks for
        left = len(least.obstructions) - len(shown)
        for obstruction in shown:
            yield f"- {obstruction}{f', and {left} more' if left and obstruction is shown[-1] else ''}"
    yield from _suggestion(result)


def _has_given_time(result: Any) -> bool:
    """Whether a phase of the model lasts as long as a number says: no bound in the model stands for it."""
    model = result.model()
    return model is not None and any(not phase.has_free_duration for phase in phases_of(model))


def _suggestion(result: Any) -> Iterable[str]:
    """One thing to do: what was noticed on the way, or what helps against how it ended."""
    noticed = [remark for remark in result.remarks if not remark.startswith(FIRST_RUN)]
    remedy, least = result.stop_reason.remedy, result.least_violation
    against = ""
    if least is not None and least.obstructions:
        time = _has_given_time(result)
        against = first_try(least.obstructions, least.relief, time, exactly=least.is_proof)
    if least is not None and least.is_proof:
        yield from filter(None, [against])
    elif result.stop_reason is StopReason.DIVERGED:
        yield " ".join([*noticed[:1], remedy])
    elif noticed:
        yield noticed[0]
    elif _is_in_the_way(result):
        yield CLEAR_START
    elif result.stop_reason in (StopReason.ITERATION_LIMIT, StopReason.TIME_LIMIT):
        yield remedy
    elif least is not None and least.kind is Least.NONE:
        yield str(least)
    elif result.stop_reason is StopReason.INFEASIBLE and against:
        yield f"{against}{FAR}"
    elif remedy:
        yield remedy
