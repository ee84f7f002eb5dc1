"""Models as ``.nl`` files in which pairs are rows of type 5.

Pyomo's writers know no `Complementarity`, and lose the constant of a row that is marked as complementary. So each pair
is written by either writer as an equation ``body == 0``, and then the text is changed: the row's line in the segment of
bounds, its constant, which goes to the body, and the counts in the header.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, NamedTuple

from pyomo.common.modeling import unique_component_name
from pyomo.core.base.block import Block, BlockData
from pyomo.core.base.constraint import ConstraintList
from pyomo.core.base.var import VarList
from pyomo.core.expr.numvalue import value
from pyomo.core.expr.visitor import identify_variables
from pyomo.opt import WriterFactory
from pyomo.repn import generate_standard_repn

from pyrobocop_pyomo.complementarity import CanonicalForm, active_sources, canonical_form
from pyrobocop_pyomo.complementarity.pairs import home_of
from pyrobocop_pyomo.errors import EvaluationError, ModelError
from pyrobocop_pyomo.modeling.expressions import value_or_none
from pyrobocop_pyomo.programs.nl_files import checked_writing

from .nl_tokens import HEADER_LINES

WRITERS = ("nl_v2", "nl_v1")
LOWER, UPPER, BOTH = 1, 2, 3


class _PairRow(NamedTuple):
    """A row that is complementary to bounds of a variable."""

    name: str
    row: Any
    which: int
    variable: Any

    @property
    def has_unusual_bounds(self) -> bool:
        """Whether the header counts it: the variable is not just nonnegative."""
        return self.which == UPPER or (self.which == LOWER and self.variable.lb != 0)


def write_nl(model: BlockData, path: Path, writer: str) -> None:
    """Write a ``.nl`` file, and its names; the parameters and errors are those of `write_file`."""
    copy = model.clone()
    stated = _PairRows(copy)
    text, rows, columns = _written(copy, writer)
    if stated.show_variables(set(columns)):
        text, rows, columns = _written(copy, writer)
    by_name = {pair.row.name: pair for pair in stated.written}
    places = {place: by_name[name] for place, name in enumerate(rows) if name in by_name}
    column_of = {name: place for place, name in enumerate(columns)}
    lines = _with_pairs(text, {i: (pair, column_of[pair.variable.name]) for i, pair in places.items()}, model.name)
    rows = [places[place].name if place in places else name for place, name in enumerate(rows)]
    for end, content in ((".nl", lines), (".row", rows), (".col", columns)):
        path.with_suffix(end).write_text("\n".join(content), encoding="utf-8", newline="\n")


def _written(model: BlockData, writer: str) -> list[list[str]]:
    """The lines of a file, the names of its rows and of its variables."""
    with tempfile.TemporaryDirectory(prefix="pyrobocop_") as folder:
        made = Path(folder) / "model.nl"
        with checked_writing(model):
            WriterFactory(writer)(model, str(made), lambda _: True, {"symbolic_solver_labels": True})
        return [made.with_suffix(end).read_text(encoding="utf-8").split("\n") for end in (".nl", ".row", ".col")]


def _with_pairs(lines: list[str], pairs: dict[int, tuple[_PairRow, int]], model: str) -> list[str]:
    """The lines of a file with some of its equations ``body == 0`` as pairs."""
    bodies: dict[int, int] = {}
    bounds = 0
    for number, line in enumerate(lines[HEADER_LINES:], start=HEADER_LINES):
        words = line.partition("#")[0].split()
        if "nan" in words or "nnan" in words:
            raise EvaluationError(f"'{model}': a number in it does not exist. Give Params and fixed variables values.")
        if words == ["r"]:
            bounds = number + 1
        elif words and words[0][0] == "C":
            bodies[int(words[0][1:])] = number
    counts, functions = lines[1].split("#")[0].split(), lines[2].split("#")[0].split()
    nonlinear = sum(place < int(functions[0]) for place in pairs)
    ranges = sum(pair.which == BOTH for pair, _ in pairs.values())
    unusual = sum(pair.has_unusual_bounds for pair, _ in pairs.values())
    counts[4] = str(int(counts[4]) - len(pairs))
    changed = list(lines)
    changed[1] = f" {' '.join(counts)}\t# vars, constraints, objectives, ranges, eqns"
    changed[2] = (
        f" {functions[0]} {functions[1]} {len(pairs) - nonlinear} {nonlinear} {ranges} {unusual}"
        "\t# nonlinear constrs, objs; ccons: lin, nonlin, nd, nzlb"
    )
    for place, (pair, column) in pairs.items():
        constant = -float(lines[bounds + place].split()[1])
        changed[bounds + place] = f"5 {pair.which} {column + 1}"
        if constant:
            changed[bodies[place]] += f"\no0\nn{constant!r}"
    return changed


class _PairRows:
    """States the pairs of a model as equations, each with a variable that it is complementary to.

    Parameters
    ----------
    model : Block
        Gets a block with rows and variables, and its pairs are deactivated: a copy.
    """

    def __init__(self, model: Any) -> None:
        self.written: list[_PairRow] = []
        self._model = model
        self._block = Block(concrete=True)
        self._block.rows, self._block.sides = ConstraintList(), VarList()
        sources = active_sources(model)
        model.add_component(unique_component_name(model, "pairs_as_rows"), self._block)
        for source in sources:
            if home_of(source.parent_block(), model) is not model:
                raise ModelError(f"'{source.name}': lies in a disjunct, and a file has none. Transform these first.")
            self._state(canonical_form(source))
            source.deactivate()

    def show_variables(self, shown: set[str]) -> bool:
        """Put copies in place of variables that are in no row and not in the objective, which no writer shows."""
        hidden = [place for place, pair in enumerate(self.written) if pair.variable.name not in shown]
        for place in hidden:
            pair = self.written[place]
            lower, upper = pair.variable.bounds
            side = self._side(pair.variable, lower=lower)
            side.setub(upper)
            self.written[place] = pair._replace(variable=side)
        return bool(hidden)

    def _state(self, form: CanonicalForm) -> None:
        for row in form.rows:
            self._block.rows.add(row)
        if not form.pairs:
            return
        first, name = form.pairs[0], form.source.name
        if form.between is not None:
            lower, body, upper = form.between
            self._add(name, BOTH, self._within(value(lower), body, value(upper)), first.b)
        elif first.role == "positive":  # of any sign: p - n, and p + n is complementary
            positive, negative = (self._side(None, max(sign * (value_or_none(first.b) or 0), 0)) for sign in (1, -1))
            self._block.rows.add(first.b == positive - negative)
            self._complement(name, first.a, positive + negative)
            self._add(f"{name} (sign)", LOWER, positive, negative)
        else:
            self._complement(name, first.a, first.b)

    def _complement(self, name: str, a: Any, b: Any) -> None:
        """``0 <= a ⟂ b >= 0``, by a bound of a variable where one of the sides is one."""
        for side, other in ((a, b), (b, a)):
            found = self._variable_with_bound(side)
            if found is not None:
                which, variable = found
                self._add(name, which, variable, other if which == LOWER else -other)
                return
        self._add(name, LOWER, self._side(a), b)

    def _within(self, lower: float, body: Any, upper: float) -> Any:
        if getattr(body, "is_variable_type", bool)() and self._may_have(body, lower, upper):
            variable = body
        else:
            variable = self._side(body, lower=None)
        variable.setlb(lower)
        variable.setub(upper)
        return variable

    def _side(self, of: Any, start: float | None = None, lower: float | None = 0.0) -> Any:
        """A new variable; equal to an expression, unless that is None."""
        side = self._block.sides.add()
        side.setlb(lower)
        side.set_value(start if of is None else value_or_none(of), skip_validation=True)
        if of is not None:
            self._block.rows.add(side == of)
        return side

    def _add(self, name: str, which: int, variable: Any, body: Any) -> None:
        if next(identify_variables(body, include_fixed=False), None) is None:
            body = self._side(body, lower=None)  # writers may leave out a row without variables
        self.written.append(_PairRow(name, self._block.rows.add(body == 0), which, variable))

    def _variable_with_bound(self, side: Any) -> tuple[int, Any] | None:
        """The variable whose bound keeps ``side >= 0``, or can be set so that it does, and which bound that is.

        It has no other bound: which one is meant would be read differently by different programs.
        """
        terms = generate_standard_repn(side, compute_values=True, quadratic=False)
        if terms.nonlinear_expr is not None or len(terms.linear_vars) != 1 or abs(terms.linear_coefs[0]) != 1:
            return None
        (variable,) = terms.linear_vars
        if terms.linear_coefs[0] == 1 and self._may_have(variable, 0.0 - terms.constant, None):
            variable.setlb(0.0 - terms.constant)
            return LOWER, variable
        if terms.linear_coefs[0] == -1 and self._may_have(variable, None, terms.constant):
            variable.setub(terms.constant)
            return UPPER, variable
        return None

    def _may_have(self, variable: Any, lower: float | None, upper: float | None) -> bool:
        """Whether these can be the bounds of a variable: it has the same, or none where it gets one."""
        if variable.fixed or not variable.is_continuous():
            return False
        free_to_set = variable.model() is self._model.model()  # a variable of another model is no copy
        return all(
            own == wanted or (own is None and wanted is not None and free_to_set)
            for own, wanted in zip(variable.bounds, (lower, upper), strict=True)
        )
