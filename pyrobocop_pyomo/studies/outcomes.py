"""What all studies give back: outcomes of single solves, the answer among them, and one table for all of them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cmp_to_key
from typing import Any

from pyrobocop_pyomo.errors import SolveFailed
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.modeling.variable_values import Values, checksum_of_model
from pyrobocop_pyomo.motion.equations_motion import PLAN_ALONE
from pyrobocop_pyomo.motion.safety_report import joined_report
from pyrobocop_pyomo.obstacles import avoidance_blocks, containments
from pyrobocop_pyomo.optional_imports import pandas
from pyrobocop_pyomo.phases import note_outcome
from pyrobocop_pyomo.planning.solve import solve
from pyrobocop_pyomo.presentation import Presented, aligned
from pyrobocop_pyomo.solving import Quality, SolveResult, StopReason
from pyrobocop_pyomo.solving.iterates import Standing

from .sweep_cases import SweepCase, numbers_of


@dataclass(frozen=True, eq=False, kw_only=True)
class Outcome(Presented):
    """What became of one solve of a study, in numbers and words that a file can keep.

    Attributes
    ----------
    case : SweepCase
    result : SolveResult or None
        None where building or solving raised an error, and where a file has kept the other attributes.
    error : str
        That error, empty otherwise.
    seconds : float
        Elapsed, with all that the study did for this solve.
    values : list of float or None
        Values of the variables at the point.
    numbers : mapping of str to number or list
        What `read` gave.
    started_from : int or None
        Number of the case whose solution led to this one; None where it was solved from the initial guess.
    standing : Standing or None
        By which outcomes are compared; None where there is no point.
    objective : float
        Of a feasible point; NaN otherwise.
    verdict : str
        The quality in one word, or ``error``.
    certificate : str
        In one word; empty where there is no point.
    iterations : int
        Of Ipopt, in all runs of this solve.
    reason : str
        Why there is no feasible point, why it is no solution, or what its mesh makes doubtful; else empty.
    """

    case: SweepCase
    result: SolveResult | None = None
    error: str = ""
    seconds: float = 0.0
    values: Values = field(default_factory=list, repr=False)
    numbers: Mapping[str, Any] = field(default_factory=dict)
    started_from: int | None = None
    standing: Standing | None = None
    objective: float = math.nan
    verdict: str = "error"
    certificate: str = ""
    iterations: int = 0
    reason: str = ""

    @classmethod
    def of(cls, case: SweepCase, result: SolveResult | None, error: str = "", **kept: Any) -> Outcome:
        """The outcome of a case whose solve gave a result, or an error."""
        if result is None:
            return cls(case=case, error=error, reason=error, **kept)
        return cls(
            case=case,
            result=result,
            error=error,
            standing=result.standing,
            objective=math.nan if result.quality is Quality.INFEASIBLE else result.objective,
            verdict=result.quality.name.lower(),
            certificate=result.certificate.name.lower(),
            iterations=result.iterations,
            reason=_reason(result),
            **kept,
        )

    @property
    def name(self) -> str:
        """Of the case."""
        return self.case.name

    @property
    def feasible(self) -> bool:
        """True when the point is feasible, whether it is shown to be optimal or not."""
        return self.standing is not None and self.verdict != Quality.INFEASIBLE.name.lower()

    @property
    def solved(self) -> bool:
        """True when the point is optimal and, where there are obstacles, the motion is clear of them."""
        return self.verdict == Quality.OPTIMAL.name.lower() and _is_safe(self.standing)

    @property
    def cut_short(self) -> bool:
        """True when the time limit or Ctrl-C ended the solve."""
        return self.result is not None and self.result.stop_reason.is_final

    def row(self) -> dict[str, Any]:
        """What the tables of all studies say of it."""
        return {
            "objective": self.objective,
            "quality": self.verdict,
            "certificate": self.certificate,
            "iterations": self.iterations,
            "seconds": round(self.seconds, 2),
            "reason": self.reason,
        }

    def _summary(self) -> str:
        return self.reason or self.verdict if self.result is None else self.result.one_line()


def _is_safe(standing: Standing | None) -> bool:
    return standing is not None and standing.shortfall == 0.0


def _reason(result: SolveResult) -> str:
    stopped, mesh = result.stop_reason, result.errors_of_answer
    if result.quality is not Quality.OPTIMAL:
        return result.quality.value if stopped is StopReason.FINISHED else stopped.value
    if not _is_safe(result.standing):
        return "The motion is not proven to be safe."
    if mesh.is_large:
        return f"COARSE MESH: {mesh.sentence()}; take more elements"
    return "" if mesh.is_known else mesh.in_short()


def ranked(outcomes: Iterable[Outcome]) -> tuple[Outcome, ...]:
    """The best first, by `Standing`; equally good ones as they came; those without a point last."""

    def compare(one: Outcome, other: Outcome) -> int:
        if one.standing is None or other.standing is None:
            return (one.standing is None) - (other.standing is None)
        if one.standing.is_better_than(other.standing):
            return -1
        return int(other.standing.is_better_than(one.standing))

    return tuple(sorted(outcomes, key=cmp_to_key(compare)))


def seconds_left(deadline: Deadline) -> float | None:
    """What is left for a solve; a moment where nothing is, so that it still says what it started from."""
    return None if deadline.left is None else max(deadline.left, 1e-3)


def solve_as_given(model: Any, **options: Any) -> SolveResult:
    """Solve one problem of a study on the meshes that it has: what is compared stands on the same ones."""
    return solve(model, **{"mesh_tolerance": None, **options})


@dataclass(frozen=True, eq=False, kw_only=True)
class StudyResult(Presented, Sequence[Outcome]):
    """The answer of a study: a sequence of its outcomes, in the order of their cases, which prints as a table.

    ``best``, ``result`` and ``reached`` mean the same in every study.

    Attributes
    ----------
    name : str
        Of the model.
    outcomes : tuple of Outcome
        In the order of the table.
    remaining : tuple
        What a time limit or Ctrl-C left undone.
    seconds : float
        Elapsed in all.
    doubts : tuple of str
        Why it may not be what was meant; the first lines of the text say so.
    """

    name: str
    outcomes: tuple[Outcome, ...]
    remaining: tuple[Any, ...] = ()
    seconds: float = 0.0
    doubts: tuple[str, ...] = ()
    # The `CaseSolver` of the model that all cases share; None where each has one of its own.
    _solver: Any = field(default=None, repr=False)

    @property
    def best(self) -> Outcome:
        """The outcome that answers the study, by default the best one, as `Standing` compares results.

        Raises
        ------
        SolveFailed
            When no outcome has a point.
        """
        order = self._best_first()
        if order and order[0].standing is not None:
            return order[0]
        why = self.outcomes[-1].reason if self.outcomes else "Nothing was tried."
        raise SolveFailed(f"'{self.name}': no case could be solved. {why}", self)

    @property
    def result(self) -> SolveResult:
        """The result of `best`.

        Raises
        ------
        SolveFailed
            When no outcome has a point, or a file has kept the numbers of the best one alone.
        """
        best = self.best
        if best.result is None:
            raise SolveFailed(
                f"'{self.name}': the file has no result of case {best.case.number}; load it, and solve the model.", self
            )
        return best.result

    @property
    def reached(self) -> bool:
        """Whether the study reached its goal: by default, whether every case was solved."""
        return not self.remaining and not self.failed

    @property
    def failed(self) -> tuple[Outcome, ...]:
        """Outcomes of what was not solved, or whose numbers could not be read."""
        return tuple(outcome for outcome in self.outcomes if outcome.error or not outcome.solved)

    @property
    def iterations(self) -> int:
        """Ipopt's iterations in all solves together."""
        return sum(outcome.iterations for outcome in self.outcomes)

    def raise_for_status(self) -> None:
        """Do nothing when the goal was reached.

        Raises
        ------
        SolveFailed
            Otherwise; its attribute ``result`` is what fell short of the goal.
        """
        if self.reached:
            return
        if self.best.result is not None:
            self.best.result.raise_for_status()
        first = f" The first is {self.failed[0].name}: {self.failed[0].reason}" if self.failed else ""
        raise SolveFailed(
            f"'{self.name}': {len(self.failed)} cases were not solved, {len(self.remaining)} not tried.{first}",
            self,
        )

    def load(self, place: int) -> SolveResult | None:
        """Put the data and the point of an outcome on the model, and return its result; None where a file has none.

        Parameters
        ----------
        place : int
            Of the outcome in this sequence, from 0.

        Raises
        ------
        SolveFailed
            When it has no point, or a builder made a model of its own for it.
        """
        chosen = self.outcomes[place]
        result, number = chosen.result, chosen.case.number
        if chosen.standing is None:
            raise SolveFailed(f"'{self.name}': case {number} has no point. {chosen.reason}", self)
        if self._solver is None:
            raise SolveFailed(f"'{self.name}': a builder makes the model of case {number}; build it again.", self)
        self._solver.put(chosen.case.data).write(chosen.values)
        if result is None:
            return None
        model = self._solver.model
        note_outcome(model, result.outcome)
        blocks = [*avoidance_blocks(model), *containments(model)]
        if not blocks:
            return result
        # Margins and planes on the model are those of another case: the motion is judged again, as far as it was.
        equations = result.safety is None or PLAN_ALONE not in result.safety.not_replayed
        safety = joined_report(block.verify(equations=equations) for block in blocks)
        return replace(result, safety=safety, fingerprint=checksum_of_model(model))

    def to_pandas(self) -> Any:
        """A data frame with a row per outcome, in their order."""
        index = pandas.RangeIndex(1, len(self) + 1, name="case")
        return pandas.DataFrame(self._rows(), index=index)

    def table(self) -> str:
        """The outcomes as a table in text; of their reasons the first sentence only."""
        rows = self._rows()
        for row in rows:  # a number such as 0.5 ends no sentence
            row["reason"] = row["reason"].partition("\n")[0].partition(". ")[0]
        first = rows[0] if rows else {}
        shown = [[str(number), *map(_shown, row.values())] for number, row in enumerate(rows, start=1)]
        sides = ("<" if isinstance(each, str) else ">" for each in first.values())
        return aligned([["case", *first], *shown], [">", *sides])

    def _rows(self) -> list[dict[str, Any]]:
        """Entries by column: numbers of the cases where they are few, or names; numbers that were read; all others."""
        cases = [numbers_of(outcome.case.data) for outcome in self.outcomes]
        are_alike = all(numbers and numbers.keys() == cases[0].keys() and len(numbers) <= 6 for numbers in cases)
        read = [numbers_of(outcome.numbers) for outcome in self.outcomes]
        unknown = dict.fromkeys((name for numbers in read for name in numbers), math.nan)
        return [
            {**(of_case if are_alike else {"name": outcome.name}), **unknown, **of_outcome, **outcome.row()}
            for outcome, of_case, of_outcome in zip(self.outcomes, cases, read, strict=True)
        ]

    def __len__(self) -> int:
        return len(self.outcomes)

    def __getitem__(self, place: Any) -> Any:
        return self.outcomes[place]

    def _best_first(self) -> Sequence[Outcome]:
        """Outcomes that may be the answer, the first one before the others."""
        return ranked(self.outcomes)

    def _summary(self) -> str:
        solved = sum(outcome.solved for outcome in self.outcomes)
        count, left = len(self.outcomes), len(self.remaining)
        not_tried = f", {left} not tried" if left else ""
        doubtful = ", DOUBTFUL" if self.doubts else ""
        return f"'{self.name}': {count} outcome{'s' * (count != 1)}, {solved} solved{not_tried}{doubtful}"

    def __str__(self) -> str:
        undone = f"\n{len(self.remaining)} cases were left undone" if self.remaining else ""
        return "\n".join([*(f"DOUBTFUL: {doubt}" for doubt in self.doubts), self.table() + undone])


def _shown(entry: Any) -> str:
    """An entry of a table as text."""
    if isinstance(entry, float):
        return "-" if math.isnan(entry) else f"{entry:.7g}"
    return str(entry)
