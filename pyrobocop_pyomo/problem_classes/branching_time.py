"""The time as a problem class gets it when its formulas hold for all times, and the way that its branches go."""

from __future__ import annotations

from typing import Any

from pyomo.common.numeric_types import native_numeric_types

from pyrobocop_pyomo.errors import ProblemClassError
from pyrobocop_pyomo.modeling.expression_arrays import ArrayEntry

# A class that compares the time more often is called at each point.
_MOST_COMPARISONS = 20


class BranchInTime:
    """One way through the comparisons of the time.

    Parameters
    ----------
    first, last : float
        Between which the time is.
    answers : tuple of bool
        Of the first comparisons; further ones are true.

    Attributes
    ----------
    made : list of (relation, bool)
        The comparisons that the times so far do not decide, as expressions, with their answers.
    """

    def __init__(self, first: float, last: float, answers: tuple[bool, ...] = ()) -> None:
        self._first, self._last, self._answers = first, last, answers
        self.made: list[tuple[Any, bool]] = []

    def decide(self, relation: Any, number: float, *, is_before: bool) -> bool:
        """Whether the time is before a number, or after it.

        Raises
        ------
        ProblemClassError
            When the time is compared too often.
        """
        if number >= self._last or number < self._first:
            return (number >= self._last) is is_before
        if len(self.made) == _MOST_COMPARISONS:
            raise ProblemClassError(f"the time is compared more than {_MOST_COMPARISONS} times.")
        answer = self._answers[len(self.made)] if len(self.made) < len(self._answers) else True
        self.made.append((relation, answer))
        if answer is is_before:
            self._last = number
        else:
            self._first = number
        return answer


class BranchingTime(ArrayEntry):
    """All times: NumPy's functions can be applied, a comparison with a number goes one way, and it is no key."""

    __slots__ = ("_branch",)
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, expression: Any, branch: BranchInTime) -> None:
        super().__init__(expression)
        self._branch = branch


def _compared(name: str, *, is_before: bool) -> Any:
    plain = getattr(ArrayEntry, f"__{name}__")

    def apply(self: BranchingTime, other: Any) -> Any:
        relation = plain(self, other)
        if other.__class__ not in native_numeric_types:
            return relation
        return self._branch.decide(relation, float(other), is_before=is_before)

    return apply


for _name in ("le", "lt", "ge", "gt"):
    setattr(BranchingTime, f"__{_name}__", _compared(_name, is_before=_name in ("le", "lt")))
