"""Problems from ``.nl`` files, with rows of type 5: a row that is complementary to a variable.

References
----------
Gay (2005), Writing .nl Files, technical report, Sandia National Laboratories
Ferris, Fourer and Gay (1999), Expressing complementarity problems in an algebraic modeling language and communicating
them to solvers, SIAM J. Optim. 9(4), doi:10.1137/S105262349833338X
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

from pyrobocop_pyomo.errors import ModelError

from .arithmetic import Arithmetic
from .file_problem import FilePair, FileProblem, FileRow, FileStatement
from .nl_tokens import NlTokens, open_nl

# Codes of operators, with the name of each and the count of its arguments; None where the file says how many.
_OPERATORS: dict[int, tuple[str, int | None]] = {
    0: ("+", 2), 1: ("-", 2), 2: ("*", 2), 3: ("/", 2), 5: ("**", 2), 6: ("positive part of difference", 2),
    11: ("min", None), 12: ("max", None), 13: ("floor", 1), 14: ("ceil", 1), 15: ("abs", 1), 16: ("neg", 1),
    22: ("<", 2), 23: ("<=", 2), 24: ("==", 2), 28: (">=", 2), 29: (">", 2), 34: ("not", 1), 35: ("choose", 3),
    37: ("tanh", 1), 38: ("tan", 1), 39: ("sqrt", 1), 40: ("sinh", 1), 41: ("sin", 1), 42: ("log10", 1),
    43: ("log", 1), 44: ("exp", 1), 45: ("cosh", 1), 46: ("cos", 1), 47: ("atanh", 1), 49: ("atan", 1),
    50: ("asinh", 1), 51: ("asin", 1), 52: ("acosh", 1), 53: ("acos", 1), 54: ("sum", None),
}  # fmt: skip
_INFINITE = 1e300  # AMPL's infinity is the largest double

Token = float | int | tuple[str, int]


@dataclass
class _Function:
    """A nonlinear part and linear terms."""

    tokens: list[Token] = field(default_factory=lambda: [0.0])
    terms: list[tuple[int, float]] = field(default_factory=list)

    def value(self, variables: Sequence[Any], arithmetic: Arithmetic) -> Any:
        total = arithmetic.evaluate(self.tokens, variables)
        terms = [factor * variables[i] for i, factor in self.terms if factor != 0.0]
        return total + sum(terms) if terms else total


@dataclass
class _NlContent:
    """The segments of a file. Indices of variables from its count of variables on are those of defined ones."""

    rows: list[_Function]
    objectives: list[_Function]
    senses: list[int]
    row_bounds: list[tuple[float, float]]
    row_names: Sequence[str]
    complementary: dict[int, tuple[int, int]] = field(default_factory=dict)  # row -> which bounds, variable
    bounds: list[tuple[float, float]] = field(default_factory=list)
    start: dict[int, float] = field(default_factory=dict)
    defined: dict[int, _Function] = field(default_factory=dict)  # in the order of the file: each before its use

    def evaluate(self, variables: Sequence[Any], arithmetic: Arithmetic) -> FileStatement:
        known = [*variables, *([None] * (max(self.defined, default=-1) + 1 - len(variables)))]
        for index, function in self.defined.items():
            known[index] = arithmetic.share(function.value(known, arithmetic))
        rows: list[FileRow] = []
        pairs: list[FilePair] = []
        for index, function in enumerate(self.rows):
            name, body = self.row_names[index], function.value(known, arithmetic)
            which, variable = self.complementary.get(index, (0, 0))
            if not which:
                lower, upper = self.row_bounds[index]
                rows.append(FileRow(name, lower, body, upper))
                continue
            lower, upper = self.bounds[variable]
            lower, upper = lower if which & 1 else -math.inf, upper if which & 2 else math.inf
            pairs.append(FilePair(name, lower, variables[variable], upper, body))
        objective = self.objectives[0].value(known, arithmetic) if self.objectives else 0.0
        return FileStatement(objective, rows, pairs)


def read_nl(path: Path) -> FileProblem:
    """Read a ``.nl`` file; the parameters and errors are those of `read_file`."""
    header, tokens = open_nl(path.read_bytes(), path)
    (n, m, objectives), discrete = header[0][:3], header[5]
    if sum(discrete):
        raise ModelError(f"{path}: {sum(discrete)} of its {n} variables are discrete. Only continuous ones are read.")
    content = _NlContent(
        rows=[_Function() for _ in range(m)],
        objectives=[_Function() for _ in range(objectives)],
        senses=[0] * objectives,
        row_bounds=[(-math.inf, math.inf)] * m,
        row_names=_names(path.with_suffix(".row"), m),
        bounds=[(-math.inf, math.inf)] * n,
    )
    reader = _SegmentReader(path, tokens, content)
    try:
        while letter := tokens.letter():
            reader.segment(letter)
    except (ValueError, IndexError, struct.error) as error:
        if isinstance(error, ModelError):
            raise
        raise reader.refusal(f"cannot be read ({error})") from error
    for row, (which, variable) in content.complementary.items():
        for bit, bound in enumerate(content.bounds[variable]):
            if which & (1 << bit) and math.isinf(bound):
                raise ModelError(
                    f"{path}: row {row} is complementary to the {('lower', 'upper')[bit]} bound of variable "
                    f"{variable}, which has none."
                )
    return FileProblem(
        name=path.stem,
        variables=_names(path.with_suffix(".col"), n),
        lower=[lower for lower, _ in content.bounds],
        upper=[upper for _, upper in content.bounds],
        start=[content.start.get(index) for index in range(n)],
        maximise=bool(content.senses[:1] and content.senses[0]),
        evaluate=content.evaluate,
    )


class _SegmentReader:
    """Reads segments into the content of a file."""

    def __init__(self, path: Path, tokens: NlTokens, content: _NlContent) -> None:
        self._path, self._tokens, self._content = path, tokens, content

    def refusal(self, what: str) -> ModelError:
        """An error that says where."""
        return ModelError(f"{self._path}, {self._tokens.place()}: {what}.")

    def segment(self, letter: str) -> None:
        """Read the segment that a letter begins."""
        read = getattr(self, f"_segment_{letter}", None)
        if read is None:
            raise self.refusal(
                f"'{letter}' begins no segment that is known here; logical constraints and functions in other "
                "libraries are not read"
            )
        read()

    def _segment_C(self) -> None:
        row = self._content.rows[self._tokens.integer()]
        row.tokens = self._expression()

    def _segment_O(self) -> None:
        index, sense = self._tokens.integer(), self._tokens.integer()
        self._content.objectives[index].tokens, self._content.senses[index] = self._expression(), sense

    def _segment_V(self) -> None:
        index, count, _ = (self._tokens.integer() for _ in range(3))
        terms = self._terms(count)
        self._content.defined[index] = _Function(self._expression(), terms)

    def _segment_J(self) -> None:
        index, count = self._tokens.integer(), self._tokens.integer()
        self._content.rows[index].terms = self._terms(count)

    def _segment_G(self) -> None:
        index, count = self._tokens.integer(), self._tokens.integer()
        self._content.objectives[index].terms = self._terms(count)

    def _segment_x(self) -> None:
        self._content.start.update(self._terms(self._tokens.integer()))

    def _segment_d(self) -> None:
        self._terms(self._tokens.integer())  # start values of multipliers

    def _segment_k(self) -> None:
        for _ in range(self._tokens.integer()):
            self._tokens.integer()  # how many entries the columns of the Jacobian have

    _segment_K = _segment_k

    def _segment_S(self) -> None:
        kind, count, _ = self._tokens.integer(), self._tokens.integer(), self._tokens.word()
        for _ in range(count):
            self._tokens.integer()
            self._tokens.number() if kind & 4 else self._tokens.integer()

    def _segment_b(self) -> None:
        content = self._content
        for index in range(len(content.bounds)):
            content.bounds[index] = self._range(self._tokens.letter())

    def _segment_r(self) -> None:
        content = self._content
        for index in range(len(content.rows)):
            kind = self._tokens.letter()
            if kind != "5":
                content.row_bounds[index] = self._range(kind)
                continue
            which, variable = self._tokens.integer(), self._tokens.integer() - 1
            if not (0 <= which <= 3 and 0 <= variable < len(content.bounds)):
                raise self.refusal(f"row {index} cannot be complementary to bounds {which} of variable {variable}")
            content.row_bounds[index] = (0.0, 0.0)  # where the variable is free, the row is zero
            content.complementary[index] = (which, variable)

    def _range(self, kind: str) -> tuple[float, float]:
        if kind not in "01234" or not kind:
            raise self.refusal(f"'{kind}' is no kind of bounds")
        if kind == "3":
            return -math.inf, math.inf
        first = self._bound()
        if kind == "0":
            return first, self._bound()
        return {"1": (-math.inf, first), "2": (first, math.inf), "4": (first, first)}[kind]

    def _bound(self) -> float:
        number = self._tokens.number()
        return number if abs(number) < _INFINITE else math.copysign(math.inf, number)

    def _terms(self, count: int) -> list[tuple[int, float]]:
        return [(self._tokens.integer(), self._tokens.number()) for _ in range(count)]

    def _expression(self) -> list[Token]:
        found: list[Token] = []
        wanted = 1
        while wanted:
            letter = self._tokens.letter()
            wanted -= 1
            if letter == "n":
                found.append(self._tokens.number())
            elif letter in ("s", "l"):
                found.append(float(self._tokens.short() if letter == "s" else self._tokens.integer()))
            elif letter == "v":
                found.append(self._tokens.integer())
            elif letter == "o":
                name, count = self._operator()
                found.append((name, count))
                wanted += count
            else:
                self._refuse_leaf(letter)
        return found

    def _operator(self) -> tuple[str, int]:
        code = self._tokens.integer()
        if code not in _OPERATORS:
            raise self.refusal(f"the operator o{code} is not known here")
        name, count = _OPERATORS[code]
        return name, self._tokens.integer() if count is None else count

    def _refuse_leaf(self, letter: str) -> NoReturn:
        what = {"f": "functions in other libraries", "h": "strings", "": "a file that ends in an expression"}
        raise self.refusal(f"{what.get(letter, repr(letter))} cannot be read")


def _names(path: Path, count: int) -> tuple[str, ...]:
    """Names from a ``.row`` or ``.col`` file, numbers where there is none or it is of something else."""
    names = path.read_text(encoding="utf-8").split("\n")[:count] if path.is_file() else []
    complete = len(set(filter(None, map(str.strip, names)))) == count
    return tuple(map(str.strip, names)) if complete else tuple(map(str, range(count)))
