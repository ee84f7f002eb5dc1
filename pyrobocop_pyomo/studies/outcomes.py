"""What all studies give back: outcomes of single solves, the answer among them, and one table for all of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cmp_to_key
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar

from pyrobocop_pyomo.errors import SolveFailed
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.modeling.variable_values import Values
from pyrobocop_pyomo.optional_imports import pandas
from pyrobocop_pyomo.planning.solve import solve
from pyrobocop_pyomo.presentation import Presented, aligned, disclosed_text, table
from pyrobocop_pyomo.solving import Quality, SolveResult, StopReason


@dataclass(frozen=True, eq=False, kw_only=True)
class Outcome(Presented):
    """What became of one solve of a study.

    Attributes
    ----------
    result : SolveResult or None
        None where building or solving raised an error.
    error : str
        That error, empty otherwise.
    seconds : float
        Elapsed, with all that the study did for this solve.
    values : list of float or None
        Values of the variables at the point.
    """

    result: SolveResult | None = None
    error: str = ""
    seconds: float = 0.0
    values: Values = field(default_factory=list, repr=False)

    @property
    def feasible(self) -> bool:
        """True when the point is feasible, whether it is shown to be optimal or not."""
        return self.result is not None and self.result.quality is not Quality.INFEASIBLE

    @property
    def objective(self) -> float:
        """Objective of a feasible point; NaN otherwise."""
        return self.result.objective if self.result is not None and self.feasible else math.nan

    @property
    def iterations(self) -> int:
        """Ipopt's iterations in all runs of this solve."""
        return 0 if self.result is None else self.result.iterations

    @property
    def verdict(self) -> str:
        """The quality in one word, or ``error``."""
        return "error" if self.result is None else self.result.quality.name.lower()

    @property
    def certificate(self) -> str:
        """The certificate in one word; empty where there is no result."""
        return "" if self.result is None else self.result.certificate.name.lower()

    @property
    def reason(self) -> str:
        """Why there is no feasible point, or why it is not shown to be optimal; empty for an optimal point."""
        if self.result is None:
            return self.error
        if self.result.solved:
            return ""
        stopped = self.result.stop_reason
        if self.result.quality is Quality.OPTIMAL:
            return "The motion is not proven to be safe."
        return self.result.quality.value if stopped is StopReason.FINISHED else stopped.value

    @property
    def remark(self) -> str:
        """The reason; of an optimal point what its mesh makes doubtful."""
        mesh = None if self.result is None else self.result.errors_of_answer
        if self.reason or mesh is None:
            return self.reason
        return f"COARSE MESH: {mesh.in_words()}" if mesh.is_large else "" if mesh.is_known else mesh.in_short()

    @property
    def cut_short(self) -> bool:
        """True when the time limit or Ctrl-C ended the solve."""
        return self.result is not None and self.result.stop_reason.is_final

    def _summary(self) -> str:
        return self.reason if self.result is None else self.result.one_line()


OutcomeType = TypeVar("OutcomeType", bound=Outcome)


def ranked(outcomes: Iterable[OutcomeType]) -> tuple[OutcomeType, ...]:
    """The best first, by `Standing`; equally good ones as they came; those without a result last."""

    def compare(one: Outcome, other: Outcome) -> int:
        if one.result is None or other.result is None:
            return (one.result is None) - (other.result is None)
        if one.result.standing.is_better_than(other.result.standing):
            return -1
        return int(other.result.standing.is_better_than(one.result.standing))

    return tuple(sorted(outcomes, key=cmp_to_key(compare)))


def seconds_left(deadline: Deadline) -> float | None:
    """What is left for a solve; a moment where nothing is, so that it still says what it started from."""
    return None if deadline.left is None else max(deadline.left, 1e-3)


def solve_as_given(model: Any, **options: Any) -> SolveResult:
    """Solve one problem of a study on the meshes that it has: what is compared stands on the same ones."""
    return solve(model, **{"mesh_tolerance": None, **options})


class Column(NamedTuple):
    """A column of a table of outcomes.

    Attributes
    ----------
    name : str
    value : callable
        From an outcome to its entry.
    style : str
        Format of a number in the text; numbers are aligned right, words left.
    """

    name: str
    value: Callable[[Any], Any]
    style: str = ""

    def text(self, outcome: Any) -> str:
        """The entry in the text."""
        value = self.value(outcome)
        return format(value, self.style) if value == value else "-"


COMMON_COLUMNS = (
    Column("objective", lambda outcome: outcome.objective, ".7g"),
    Column("quality", lambda outcome: outcome.verdict),
    Column("certificate", lambda outcome: outcome.certificate),
    Column("iterations", lambda outcome: outcome.iterations, "d"),
    Column("seconds", lambda outcome: outcome.seconds, ".2f"),
    Column("reason", lambda outcome: outcome.remark),
)


@dataclass(frozen=True, eq=False, kw_only=True)
class StudyResult(Presented, Sequence[OutcomeType], Generic[OutcomeType]):
    """The answer of a study: a sequence of its outcomes, which prints as a table.

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
    outcomes: tuple[OutcomeType, ...]
    remaining: tuple[Any, ...] = ()
    seconds: float = 0.0
    doubts: tuple[str, ...] = ()

    item: ClassVar[str] = "start"  # what an outcome is of
    numbered_by: ClassVar[str] = "rank"
    own_columns: ClassVar[tuple[Column, ...]] = ()

    @property
    def best(self) -> OutcomeType:
        """The outcome that answers the study; its point is the one on the model.

        Raises
        ------
        SolveFailed
            When no outcome has a point.
        """
        order = self._best_first()
        if order and order[0].result is not None:
            return order[0]
        why = self.outcomes[-1].reason if self.outcomes else "Nothing was tried."
        raise SolveFailed(f"'{self.name}': no {self.item} could be solved. {why}", self)

    @property
    def result(self) -> SolveResult:
        """The result of `best`.

        Raises
        ------
        SolveFailed
            When no outcome has a point.
        """
        found = self.best.result
        assert found is not None
        return found

    @property
    def reached(self) -> bool:
        """Whether the study reached its goal, at a point that is optimal and, where there are obstacles, safe."""
        return bool(self.outcomes) and self.outcomes[0].result is not None and self.outcomes[0].result.solved

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
        if not self.reached:
            self.result.raise_for_status()

    def to_pandas(self) -> Any:
        """A data frame with a row per outcome, in their order."""
        rows = [{column.name: column.value(outcome) for column in self.columns} for outcome in self.outcomes]
        index = pandas.RangeIndex(1, len(rows) + 1, name=self.numbered_by)
        return pandas.DataFrame(rows, index=index, columns=[column.name for column in self.columns])

    def table(self) -> str:
        """The outcomes as a table in text; of their reasons the first sentence only."""
        header, *rows = self._rows()
        # A number such as 0.5 ends no sentence.
        rows = [[*others, reason.partition("\n")[0].partition(". ")[0]] for *others, reason in rows]
        return aligned([header, *rows], [">", *(">" if column.style else "<" for column in self.columns)])

    def _rows(self) -> list[list[str]]:
        """The header, and one row per outcome; the last column is the reason."""
        columns = self.columns
        rows = ([str(n), *(column.text(one) for column in columns)] for n, one in enumerate(self.outcomes, start=1))
        return [[self.numbered_by, *(column.name for column in columns)], *rows]

    @property
    def columns(self) -> tuple[Column, ...]:
        """Columns of the table: those of this kind of study, then those of all."""
        return (*self.own_columns, *COMMON_COLUMNS)

    def __len__(self) -> int:
        return len(self.outcomes)

    def __getitem__(self, place: Any) -> Any:
        return self.outcomes[place]

    def _best_first(self) -> Sequence[OutcomeType]:
        """Where outcomes are in the order of a ranking, as they are."""
        return self.outcomes

    def _summary(self) -> str:
        solved = sum(outcome.result is not None and outcome.result.solved for outcome in self.outcomes)
        count, left = len(self.outcomes), len(self.remaining)
        not_tried = f", {left} not tried" if left else ""
        doubtful = ", DOUBTFUL" if self.doubts else ""
        return f"'{self.name}': {count} outcome{'s' * (count != 1)}, {solved} solved{not_tried}{doubtful}"

    def _html_parts(self) -> list[str]:
        header, *rows = self._rows()
        return [*(disclosed_text("DOUBTFUL", doubt) for doubt in self.doubts), table(header, rows)]

    def __str__(self) -> str:
        undone = f"\n{len(self.remaining)} {self.item}s were left undone" if self.remaining else ""
        return "\n".join([*(f"DOUBTFUL: {doubt}" for doubt in self.doubts), self.table() + undone])
