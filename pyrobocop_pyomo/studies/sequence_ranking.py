"""What `solve_sequences` gives back: every sequence with its result or the reason why it has none."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from pyomo.core.base.objective import Objective

from pyrobocop_pyomo.errors import ModelError, SolveFailed
from pyrobocop_pyomo.modeling.variable_values import Values, VariableValues
from pyrobocop_pyomo.optional_imports import pandas
from pyrobocop_pyomo.solving.iterate_log import ModelCheck
from pyrobocop_pyomo.solving.iterates import Quality, StopReason
from pyrobocop_pyomo.solving.solve_result import SolveResult


@dataclass(frozen=True, eq=False)
class SequenceOutcome:
    """What became of one sequence.

    Attributes
    ----------
    sequence : tuple of str
    number : int
        Its place in the list that was given, from 0; it decides between equal objectives.
    result : SolveResult or None
        None where building or solving raised an error.
    error : str
        That error, empty otherwise.
    sense : int
        1 where the objective is minimised, -1 where it is maximised.
    seconds : float
        Building included.
    values : list of float or None
        Value of every variable of the model, in its order; NaN where there is none.
    """

    sequence: tuple[str, ...]
    number: int
    result: SolveResult | None = None
    error: str = ""
    sense: int = 1
    seconds: float = 0.0
    values: Values = field(default_factory=list, repr=False)

    @property
    def feasible(self) -> bool:
        """True when the point is feasible, whether it is shown to be optimal or not."""
        return self.result is not None and self.result.quality is not Quality.INFEASIBLE

    @property
    def objective(self) -> float:
        """Objective of the point; NaN where there is none, or none that counts."""
        return self.result.objective if self.feasible and self.result is not None else float("nan")

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
    def standing(self) -> str:
        """The quality in one word, or ``error``."""
        return "error" if self.result is None else self.result.quality.name.lower()

    @property
    def _order(self) -> tuple[Any, ...]:
        if not self.feasible:
            return (1 if self.result is not None else 2, False, 0.0, self.number)
        # A plan that passes through an obstacle is often the cheapest.
        unsafe = self.result is not None and self.result.safe is False
        # Mirrored sequences have equal objectives up to the solver's tolerance, which must not decide the order.
        return (0, unsafe, float(f"{self.sense * self.objective:.6g}"), self.number)


@dataclass(frozen=True, eq=False)
class SequenceRanking(Sequence[SequenceOutcome]):
    """Outcomes in their order: the feasible ones by objective, then those without a feasible point, then errors.

    Where there are obstacles, plans that are proven safe come before all others that are feasible.

    Attributes
    ----------
    outcomes : tuple of SequenceOutcome
        The best first.
    left : tuple of sequences
        Those that Ctrl-C left undone.
    build : callable
        What makes the model of a sequence.
    """

    outcomes: tuple[SequenceOutcome, ...]
    left: tuple[tuple[str, ...], ...] = ()
    build: Callable[..., Any] | None = field(default=None, repr=False)

    @classmethod
    def of(
        cls, outcomes: Sequence[SequenceOutcome], left: Sequence[tuple[str, ...]], build: Callable[..., Any]
    ) -> SequenceRanking:
        """Rank outcomes."""
        return cls(tuple(sorted(outcomes, key=lambda each: each._order)), tuple(left), build)

    def __len__(self) -> int:
        return len(self.outcomes)

    def __getitem__(self, rank: Any) -> Any:
        return self.outcomes[rank]

    def __iter__(self) -> Iterator[SequenceOutcome]:
        return iter(self.outcomes)

    def outcome(self, sequence: Sequence[str]) -> SequenceOutcome:
        """The outcome of a sequence.

        Raises
        ------
        KeyError
            When it was not solved.
        """
        for each in self.outcomes:
            if each.sequence == tuple(sequence):
                return each
        raise KeyError(tuple(sequence))

    @cached_property
    def best(self) -> Any:
        """The model of the best sequence, with its solution.

        Raises
        ------
        SolveFailed
            When no sequence has a feasible point.
        """
        if not self.outcomes or not self.outcomes[0].feasible:
            raise SolveFailed(f"no sequence has a feasible point.\n{self}", self)
        return self.model(self.outcomes[0].sequence)

    def model(self, sequence: Sequence[str]) -> Any:
        """The model of a sequence, built again and given the values that were found, feasible or not.

        Raises
        ------
        KeyError
            When it was not solved.
        SolveFailed
            When an error left no values.
        ModelError
            When ``build`` makes another model than the one that was solved.
        """
        found = self.outcome(sequence)
        if found.result is None or self.build is None:
            raise SolveFailed(f"{' - '.join(found.sequence)}: there is no solution. {found.error}", self)
        model = self.build(found.sequence)
        VariableValues.of_all(model).write(found.values)
        objective = ModelCheck(model).objective()
        if abs(objective - found.result.objective) > 1e-9 * max(1.0, abs(objective)):
            raise ModelError(
                f"{' - '.join(found.sequence)}: the model built again has the objective {objective:.9g} where "
                f"{found.result.objective:.9g} was found. The function that builds it must give the same each time."
            )
        return model

    def to_pandas(self) -> Any:
        """A data frame with a row per sequence, the best first."""
        return pandas.DataFrame(
            [
                {
                    "sequence": " - ".join(each.sequence),
                    "objective": each.objective,
                    "quality": each.standing,
                    "iterations": 0 if each.result is None else each.result.iterations,
                    "seconds": each.seconds,
                    "reason": each.reason,
                }
                for each in self.outcomes
            ],
            index=pandas.RangeIndex(1, len(self.outcomes) + 1, name="rank"),
        )

    def __str__(self) -> str:
        names = [" - ".join(each.sequence) for each in self.outcomes]
        width = max([len("sequence"), *map(len, names)])
        lines = [f"rank  {'sequence':<{width}} {'objective':>14}  {'quality':<10} {'iter':>5} {'seconds':>8}"]
        for rank, (name, each) in enumerate(zip(names, self.outcomes, strict=True), start=1):
            objective = f"{each.objective:.7g}" if each.feasible else "-"
            iterations = "-" if each.result is None else str(each.result.iterations)
            line = (
                f"{rank:>4}  {name:<{width}} {objective:>14}  {each.standing:<10} {iterations:>5} {each.seconds:>8.2f}"
            )
            lines.append(f"{line}  {_first_sentence(each.reason)}".rstrip())
        if self.left:
            lines.append(f"interrupted; not solved: {'; '.join(' - '.join(each) for each in self.left)}")
        return "\n".join(lines)


def _first_sentence(text: str) -> str:
    """Enough for a line of a table; numbers such as 0.5 end no sentence."""
    return text.partition(". ")[0].partition("\n")[0]


def sense_of(model: Any) -> int:
    """1 where the model minimises, -1 where it maximises."""
    objectives = list(model.component_data_objects(Objective, active=True))
    return -1 if len(objectives) == 1 and not objectives[0].is_minimizing() else 1
