"""Results as text: `print(result)` in one to eight lines, the report with everything, and tables of pairs.

What became of each pair: its sides, which of them is zero, and what that costs.
"""

from __future__ import annotations

import enum
import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from textwrap import shorten
from typing import Any

from pyrobocop_pyomo.complementarity import PairResidual
from pyrobocop_pyomo.complementarity.forms import PAIR_ROLES
from pyrobocop_pyomo.diagnosis.least_violation import SHOWN, STANDS_AGAINST, Least
from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.mpcc.multipliers import Multipliers, Stationarity
from pyrobocop_pyomo.numerics.rounding import MET
from pyrobocop_pyomo.phases import phases_of
from pyrobocop_pyomo.presentation import aligned

from .iterates import Quality, StopReason

# ----------------------------------------------------------------------------------------------- the pairs of an answer


_NAME = rf"(.*?)(?:\[([^[]*)\])?( \((?:{'|'.join(PAIR_ROLES)})\))?"


class ActiveSide(enum.Enum):
    """Which side of a pair is zero; the value is the word in tables."""

    FIRST = "first"
    SECOND = "second"
    BIACTIVE = "biactive"
    NEITHER = "neither"


@dataclass(frozen=True)
class PairReport:
    """One pair ``0 <= first ⟂ second >= 0`` at the returned point.

    Attributes
    ----------
    name : str
        Of the pair as declared; where one statement gives two pairs, with "(lower)" or "(upper)".
    first, second : float
        Values of the two sides.
    first_multiplier, second_multiplier : float or None
        By how much the objective gets worse per unit where the side is held at a small positive number instead of
        zero: the minimised objective grows, the maximised one falls. So the signs mean the same in both senses, and
        at a biactive pair two nonnegative ones say that neither side wants to leave zero. Zero for a side that is not
        held; None where the result is not certified, or the point not stationary.
    """

    name: str
    first: float
    second: float
    first_multiplier: float | None = None
    second_multiplier: float | None = None

    @property
    def component(self) -> str:
        """Name of the component that the pair belongs to."""
        return split_name(self.name)[0]

    @property
    def index(self) -> str:
        """Index of the pair in its component as text, empty for a scalar one."""
        return split_name(self.name)[1]

    @property
    def product(self) -> float:
        """``first * second``."""
        return self.first * self.second

    @property
    def natural(self) -> float:
        """``min(first, second)``: zero exactly where the pair is met."""
        return min(self.first, self.second)

    @property
    def active(self) -> ActiveSide:
        """Which side is zero, up to 1e-6."""
        if abs(self.natural) > MET:
            return ActiveSide.NEITHER
        if max(self.first, self.second) <= MET:
            return ActiveSide.BIACTIVE
        return ActiveSide.FIRST if self.first < self.second else ActiveSide.SECOND


def pair_reports(residuals: Sequence[PairResidual], multipliers: Multipliers | None) -> list[PairReport]:
    """Join residuals with the multipliers of the same pairs."""
    if multipliers is None or multipliers.kind is Stationarity.NONE:
        return [PairReport(residual.name, residual.a, residual.b) for residual in residuals]
    return [
        PairReport(residual.name, residual.a, residual.b, nu, xi)
        for residual, nu, xi in zip(residuals, multipliers.nu.tolist(), multipliers.xi.tolist(), strict=True)
    ]


def split_name(name: str) -> tuple[str, str]:
    """Split ``block.pair[1,a] (lower)`` into ``block.pair (lower)`` and ``1,a``; names of blocks keep their indices."""
    stem, index, role = re.fullmatch(_NAME, name, re.DOTALL).groups(default="")  # type: ignore[union-attr]
    return stem + role, index


# ---------------------------------------------------------------------------------------------------------- result text


MOST_LINES = 8
# Of a line that is shown; `report()` has all of it.
MOST_CHARACTERS = 400
IN_THE_WAY = "What stands against a solution near the best point found:"
FAR = " If you know that there is a solution, start nearer to it: try another initial guess."
KEPT_MESH = "The mesh stays as it is"
CLEAR_START = (
    "There may be none. Otherwise start from a clear one: rcp.scenes.waypoint_initial_guess, sampled_path (arms) or "
    "hybrid_a_star (cars), or rcp.studies.multistart."
)
CHANGED = (
    "CHANGED: Variables or parameters of the model have other values than those of which this was found: whether its "
    "motion is safe is not known. Solve again, or ask verify() of its avoidance blocks."
)

_NEARBY = {
    Certificate.PROVEN: "no better choice of zero sides nearby",
    Certificate.DESCENT: "another choice of zero sides is better",
    Certificate.UNKNOWN: "whether another choice of zero sides is better is not known",
}


def short_text(result: Any) -> str:
    """What a user needs to know first.

    Parameters
    ----------
    result : SolveResult
    """
    lines = [first_line(result), *_pairs(result), *_doubts(result)]
    if result.quality is Quality.INFEASIBLE:
        lines += _failure(result)
    elif not result.solved:
        lines += _suggestion(result)
    if len(lines) > MOST_LINES:  # the last line is what helps
        lines[MOST_LINES - 1 :] = lines[-1:]
    return "\n".join(shorten(line, MOST_CHARACTERS, placeholder=" ...") for line in lines)


def first_line(result: Any) -> str:
    """Verdict, objective, effort and errors: the line that stands wherever a result is shown."""
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
        exact += filter(None, [mesh.in_short()])
    # The objective of a point that is no solution says nothing.
    objective = "" if result.quality is Quality.INFEASIBLE else f"objective {result.objective:.6g}, "
    done = f"{objective}{iterations}, {format(result.seconds, '.2g' if result.seconds < 10 else '.0f')} s"
    return f"{result.name}: {verdict(result)}. {'; '.join((done, ', '.join(exact))) if exact else done}"


def verdict(result: Any) -> str:
    """Whether it is solved, and what there is to doubt."""
    marks = {"DOUBTFUL": result.doubts, "CHANGED": result.has_changed, "COARSE MESH": result.errors_of_answer.is_large}
    return ", ".join([_bare_verdict(result), *(mark for mark, holds in marks.items() if holds)])


def _bare_verdict(result: Any) -> str:
    least = result.least_violation
    ended = "" if result.stop_reason is StopReason.FINISHED else f": {result.stop_reason.what.rstrip('.')}"
    if result.stop_reason is StopReason.INFEASIBLE and least is not None:
        ended = f": {least.in_short}"  # what linear programs found there, and not what Ipopt took it for
    unsafe = ", NOT SAFE" if result.was_safe is False else ""
    if result.quality is Quality.INFEASIBLE and least is not None and least.is_proof:
        return "NOT SOLVED, and proven to have no solution"
    if result.quality is Quality.INFEASIBLE or result.best.diverged:
        return f"NOT SOLVED{unsafe}{ended}"
    if result.quality is Quality.FEASIBLE:
        return f"feasible, but not shown to be optimal{unsafe}{ended}{'' if unsafe else _kept(result.safety)}"
    cut_short = {StopReason.INTERRUPTED: " when interrupted", StopReason.TIME_LIMIT: " at the time limit"}
    return "NOT SAFE" if unsafe else f"solved{cut_short.get(result.stop_reason, '')}{_kept(result.safety)}"


def _kept(safety: Any) -> str:
    """The line on a motion that keeps its clearances; nothing where there are none."""
    if safety is None:
        return ""
    if safety.safe is None:
        return f", {shorten(safety.word.removesuffix('.'), MOST_CHARACTERS // 2, placeholder=' ...')}"
    return f", and {safety.word}: clearances kept at all times"


def _pairs(result: Any) -> Iterable[str]:
    count = len(result.residuals)
    if not count or result.quality is Quality.INFEASIBLE:
        return
    exact = result.largest_natural_residual
    met = "exact" if exact <= 1e-12 else f"to {exact:.0e}"
    nearby = f", {_NEARBY[result.certificate]}" if result.quality is Quality.OPTIMAL else ""
    yield f"{count} complementarity pair{'s' if count > 1 else ''} {met}{nearby}"


def _doubts(result: Any) -> Iterable[str]:
    for doubt in result.doubts:
        yield f"DOUBTFUL: {doubt.message} {doubt.remedy}"
    if result.rounding is not None:
        yield str(result.rounding)
    if result.has_changed:
        yield CHANGED
    mesh = result.errors_of_answer
    if mesh.is_large:
        yield f"COARSE MESH: {mesh.sentence()}; take more elements"
    yield from (remark for remark in result.remarks if remark.startswith(KEPT_MESH))
    yield from mesh.bounds_passed
    if motion := _motion(result):
        yield motion.removesuffix(f" {CLEAR_START}")


def _motion(result: Any) -> str:
    """The failure of a motion in one line; nothing where obstacles are not the reason."""
    least, safety = result.least_violation, result.safety
    if result.was_safe is not False or (least is not None and least.is_proof):
        return ""
    if safety.safe is not False:
        return "The motion keeps its clearances, but violates other constraints."
    closest = f"In the closest one {safety.worst} (in the model's units)."
    return f"No motion was found that keeps its clearances. {closest} {CLEAR_START}"


def _is_in_the_way(result: Any) -> bool:
    """Whether bodies that come too close are what a motion lacks."""
    return _motion(result).endswith(CLEAR_START)


def _failure(result: Any) -> Iterable[str]:
    """Violations, obstructions of a solution, and one thing to do."""
    least = result.least_violation
    overlaps = _is_in_the_way(result)
    unmet = [one for one in result.violations if not (overlaps and one.where.startswith("clearance between"))]
    for violation in (unmet := unmet[: SHOWN // 2]):  # with what stands against a solution
        yield f"not met: {violation}"
    if least is not None and least.obstructions:
        yield STANDS_AGAINST if least.is_proof else f"Not proven to be impossible. {IN_THE_WAY}"
        # Of a motion that is not safe another line tells.
        shown = list(least.obstructions[: SHOWN - max(len(unmet), 1) - (result.was_safe is False)])
        if not any(obstruction.is_fixed for obstruction in shown):  # an end that was given wrongly is looked for
            shown[-1] = next((obstruction for obstruction in least.obstructions if obstruction.is_fixed), shown[-1])
        left = len(least.obstructions) - len(shown)
        for obstruction in shown:
            yield f"- {obstruction}{f', and {left} more' if left and obstruction is shown[-1] else ''}"
    yield from _suggestion(result)


def _suggestion(result: Any) -> Iterable[str]:
    """One thing to do, from notes on the way or from the reason of the end."""
    noticed = [remark for remark in result.remarks if not remark.startswith(KEPT_MESH)][:1]
    reason, least = result.stop_reason, result.least_violation
    # No bound in the model stands for the time of a phase that lasts as long as a number says.
    phases = [] if result.model() is None else phases_of(result.model())
    has_given_time = any(not phase.has_free_duration for phase in phases)
    against = "" if least is None else least.first_try(has_given_time=has_given_time)
    if least is not None and least.is_proof:
        helps = [against]
    elif reason is StopReason.DIVERGED:
        helps = [" ".join([*noticed, reason.remedy])]
    else:
        is_limit = reason in (StopReason.ITERATION_LIMIT, StopReason.TIME_LIMIT)
        can_be_met = least is not None and least.kind is Least.NONE and not is_limit
        helps = [*noticed, CLEAR_START if _is_in_the_way(result) else "", against and f"{against}{FAR}"]
        helps += [str(least) if can_be_met else "", reason.remedy]
    yield from list(filter(None, helps))[:1]


def long_report(result: Any, worst: int) -> str:
    """The long text: findings, residuals, runs, clearances, and the worst pairs.

    Parameters
    ----------
    result : SolveResult
    worst : int
        How many pairs to show in each list.
    """
    least, mesh = result.least_violation, result.errors_of_answer
    lines = [
        first_line(result),
        *_pairs(result),
        *_doubts(result),
        *(f"not met: {violation}" for violation in result.violations),
        *([str(least)] if least is not None else ()),
        *([] if result.solved else _suggestion(result)),
        *result.remarks,
        *([str(mesh)] if mesh.phases or mesh.beside else []),
        # A run that never began has neither.
        *([f"{result.solver}, derivatives by {result.derivatives}."] if result.solver else []),
        f"objective {result.objective:.8g}, {_residuals(result)}; {result.iterations} iterations",
        *([] if result.scaling is None else [str(result.scaling)]),
        *([f"{result.safety}\n{result.rounds_table()}"] if result.safety is not None else []),
        result.steps_table(),
    ]
    return "\n\n".join(["\n".join(dict.fromkeys(lines)), *_on_pairs(result, worst)])


def _residuals(result: Any) -> str:
    relative = result.best.relative_violation
    of_scale = "" if relative in (None, result.constraint_violation) else f" ({relative:.1e} of the rows' sizes)"
    pairs = f", max a*b {result.largest_product:.1e}, max min(a, b) {result.largest_natural_residual:.1e}"
    stationarity = "" if result.stationarity is None else f", stationarity {result.stationarity:.1e}"
    return f"constraints {result.constraint_violation:.1e}{of_scale}{pairs if result.residuals else ''}{stationarity}"


def _on_pairs(result: Any, worst: int) -> Iterable[str]:
    pairs, multipliers = result.pairs, result.multipliers
    if not pairs:
        return
    yield component_table(pairs)
    yield (
        f"Decided beforehand by bounds and fixed variables: {result.decided_pairs} of {len(pairs)} pairs.\n"
        f"Stationarity: {'not examined' if multipliers is None else multipliers.kind.value}\n"
        f"Certificate: {result.certificate.value}"
    )
    inexact = sorted((pair for pair in pairs if pair.natural), key=lambda pair: -abs(pair.natural))
    if not inexact:
        yield "All pairs are met exactly."
    cheapest = sorted((pair for pair in pairs if _least_multiplier(pair) < 0.0), key=_least_multiplier)
    for title, shown in (
        ("Worst pairs, by |min(first, second)|", inexact),
        ("Biactive pairs, both sides zero", result.biactive),
        ("Pairs whose zero side would gain most by leaving zero, by multiplier", cheapest),
    ):
        if shown:
            yield f"{title}:\n{pair_table(shown, worst)}"


def pair_table(pairs: Sequence[PairReport], most: int | None = None) -> str:
    """A line per pair; beyond `most` lines, the number of those left out."""
    rows: list[tuple[str, ...]] = [("pair", "first", "second", "product", "min", "zero", "mult. first", "mult. second")]
    rows += map(_cells, pairs[:most])
    left = len(pairs) + 1 - len(rows)
    return aligned(rows, "<>>>>>>>") + (f"\n... and {left} more" if left else "")


def _cells(pair: PairReport) -> tuple[str, ...]:
    sides = f"{pair.first:.6g}", f"{pair.second:.6g}", f"{pair.product:.1e}", f"{pair.natural:.1e}"
    multipliers = ("-" if each is None else f"{each:.5g}" for each in (pair.first_multiplier, pair.second_multiplier))
    return pair.name, *sides, pair.active.value, *multipliers


def component_table(pairs: Sequence[PairReport]) -> str:
    """A line per component: how many of its pairs have which side at zero, and the largest residual."""
    groups: dict[str, list[PairReport]] = {}
    for pair in pairs:
        groups.setdefault(pair.component, []).append(pair)
    rows = [("component", "pairs", *(side.value for side in ActiveSide), "max |min|")]
    for name, members in groups.items():
        counts = Counter(pair.active for pair in members)
        numbers = [str(counts[side]) for side in ActiveSide]
        rows.append((name, str(len(members)), *numbers, f"{max(abs(pair.natural) for pair in members):.1e}"))
    return aligned(rows, "<>>>>>>")


def _least_multiplier(pair: PairReport) -> float:
    return min(pair.first_multiplier or 0.0, pair.second_multiplier or 0.0)
