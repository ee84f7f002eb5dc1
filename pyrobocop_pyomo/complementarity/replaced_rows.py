"""Transformations that put other rows in place of the user's, reversibly, and their common parts.

`pyrobocop.absolute_values_to_complementarity` makes two parts of each absolute value: what a product says by its
factors, and where it is zero or smooth, is found by structure. `pyrobocop.complementarity_to_disjunctions` makes
choices of `pyomo.gdp` of pairs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from typing import Any, ClassVar

from pyomo.common.autoslots import AutoSlots
from pyomo.common.config import ConfigDict, ConfigValue
from pyomo.common.modeling import unique_component_name
from pyomo.core import Any as AnyIndex
from pyomo.core import ConstraintList, NonNegativeIntegers
from pyomo.core.base import Transformation, TransformationFactory
from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective
from pyomo.core.base.var import Var
from pyomo.core.expr.numeric_expr import (
    AbsExpression,
    DivisionExpression,
    NegationExpression,
    ProductExpression,
    SumExpression,
)
from pyomo.core.expr.numvalue import native_types, value
from pyomo.core.expr.visitor import replace_expressions
from pyomo.gdp import Disjunct, Disjunction

from pyrobocop_pyomo.errors import ComplementarityError
from pyrobocop_pyomo.modeling.activity import BLOCK_TYPES, deactivate
from pyrobocop_pyomo.modeling.expressions import ExpressionBounds, holds_variable, is_plain_variable, same_expression
from pyrobocop_pyomo.modeling.shared_nodes import topmost_nodes

from .component import Complementarity, index_without_time
from .forms import CanonicalForm
from .pairs import PAIR_TYPES, PairResidual, active_parts, block_of_rows, canonical_form, pair_residuals
from .preconditions import refuse_foreign_token, refuse_missing_pairs, refuse_unusable, refuse_unusable_leaves
from .statement import complements


class ReplacementRecord(AutoSlots.Mixin):
    """Private data of a generated block.

    Attributes
    ----------
    rows : list of (component data, expression or None) or None
        What was replaced, with what it held before; None for an expression that was deactivated as it is. None in all
        on a block that this package did not generate.
    """

    __slots__ = ("rows",)

    def __init__(self) -> None:
        self.rows: list[tuple[Any, Any]] | None = None


Block.register_private_data_initializer(ReplacementRecord)


@dataclass(frozen=True, eq=False)
class ReplacementToken:
    """What ``revert`` of a transformation needs to undo one application.

    Attributes
    ----------
    model : Block
        The model that was transformed.
    blocks : tuple of Block
        They hold what was generated: one on the model, and one in each disjunct of whose pairs some are replaced.
    """

    model: Any
    blocks: tuple[Any, ...]


class RowReplacement(Transformation):
    """What such transformations share: targets, the block, the record and the way back.

    Subclasses say what they make of the rows. A model that is refused stays as it was.
    """

    CONFIG = ConfigDict("what is replaced")
    CONFIG.declare("targets", ConfigValue(None, description="Blocks, components or their parts to take; default all."))

    kinds: ClassVar[tuple[type, ...]]
    containers: ClassVar[tuple[type, ...]]
    block_name: ClassVar[str]
    generated: ClassVar[str]  # in words, for messages

    def _apply_to(self, model: Any, **options: Any) -> ReplacementToken:
        targets = self.CONFIG({**options.pop("options", {}), **options}).targets
        refuse_unusable(model)
        homes: dict[int, tuple[Any, list[Any]]] = {}
        for row in self._rows(model, targets):
            home = block_of_rows(row.parent_block(), model)
            homes.setdefault(id(home), (home, []))[1].append(row)
        # All that can fail is done on blocks that are no part of the model yet.
        filled = []
        for home, rows in homes.values():
            block = Block(concrete=True)
            if replaced := self._fill(block, rows):
                filled.append((home, block, replaced))
        if not filled:
            where = "it" if targets is None else "the targets"
            raise ComplementarityError(f"'{model.name}': {self._nothing_found(where)}")
        for home, block, replaced in filled:
            home.add_component(unique_component_name(home, self.block_name), block)
            _record_of(block).rows = [(row, None if new is None else row.expr) for row, new in replaced]
            deactivate(row for row, new in replaced if new is None)
            for row, new in replaced:
                if new is not None:
                    row.set_value(new)
        return ReplacementToken(model, tuple(block for _, block, _ in filled))

    def _fill(self, block: Any, rows: list[Any]) -> list[tuple[Any, Any]]:
        """Put on the block what stands for some of the rows.

        Returns
        -------
        list of (component data, expression or None)
            Those rows, with what they hold from now on; None for one to deactivate.
        """
        raise NotImplementedError

    def _nothing_found(self, where: str) -> str:
        raise NotImplementedError

    def revert(self, model: Any, token: ReplacementToken | None = None) -> None:
        """Undo one application, or all of them.

        Parameters
        ----------
        model : Block
            The model that `apply_to` was called with.
        token : ReplacementToken, optional
            What `apply_to` returned. Without it everything on this model is undone, which also serves a clone.

        Raises
        ------
        ComplementarityError
            If there is nothing to undo, or if the token is used up or belongs to another model.
        """
        refuse_foreign_token(model, token)
        present = list(self._generated_on(model))
        wanted = present if token is None else [block for block in present if any(block is one for one in token.blocks)]
        if not wanted:
            raise ComplementarityError(
                f"'{model.name}': nothing to revert; it has no {self.generated}, or was reverted before."
            )
        for block in reversed(wanted):  # the last one holds what the first one made of a row
            rows = rows_of_block(block)
            block.parent_block().del_component(block)
            for row, expression in rows or ():
                if expression is None:
                    row.activate()
                else:
                    row.set_value(expression)

    def _rows(self, model: Any, targets: Any) -> list[Any]:
        return active_parts(model, targets, self.kinds, self.containers)

    def _generated_on(self, model: Any) -> Iterator[Any]:
        for block in model.block_data_objects(active=None, descend_into=BLOCK_TYPES):
            # The name is looked at first so that no private data appear on blocks of the user.
            if block.local_name.startswith(self.block_name) and rows_of_block(block):
                yield block


def rows_of_block(block: Any) -> list[tuple[Any, Any]] | None:
    """What a generated block stands for; see `ReplacementRecord`."""
    return _record_of(block).rows


def _record_of(block: Any) -> ReplacementRecord:
    return block.private_data()


@dataclass
class _Part:
    """Facts about one absolute value.

    Attributes
    ----------
    argument : expression
    family : tuple
        Equal for absolute values that state the same at different times.
    needs_pair : bool
        Whether some row or objective does not push both parts down.
    """

    argument: Any
    family: tuple[Any, ...]
    needs_pair: bool = False


def has_kink(node: Any) -> bool:
    """Whether a node of an expression is an absolute value of something that holds a variable and may be zero."""
    if not (isinstance(node, AbsExpression) and holds_variable(node.arg(0))):
        return False
    if not is_plain_variable(node.arg(0)):
        return True
    lower, upper = node.arg(0).bounds
    return (lower is None or lower <= 0.0) and (upper is None or upper >= 0.0)


def is_smooth_product(node: Any) -> bool:
    """Whether a node is ``e * abs(e)``, as in a drag: it has a continuous derivative, ``2 * abs(e)``."""
    if not isinstance(node, ProductExpression):
        return False
    first, second = map(without_number, node.args)
    return any(
        isinstance(one, AbsExpression) and same_expression(without_number(other), without_number(one.arg(0)))
        for one, other in ((first, second), (second, first))
    )


@TransformationFactory.register(
    "pyrobocop.absolute_values_to_complementarity", doc="Turn absolute values into their two parts, reversibly."
)
class AbsoluteValuesToComplementarity(RowReplacement):
    r"""Replace ``abs(e)`` by ``p + n`` with ``e == p - n`` and ``0 <= p _|_ n >= 0``.

    An absolute value has no derivative where its argument is zero, which is where optima tend to be, and Ipopt does
    not end there. Its two parts have derivatives everywhere.

    The pair is left out where nothing gains by a sum above ``abs(e)``: where the absolute value enters only minimised
    objectives and upper bounds, each time with a factor that is not negative (or maximised objectives and lower bounds,
    with one that is not positive). By ``e == p - n`` and ``p, n >= 0`` the sum is at least ``abs(e)``, and with any sum
    above it the smaller one does as well: the best objective and the points of the user's variables that can be reached
    are the same. Where an objective has a positive factor c, the multipliers of ``p >= 0`` and ``n >= 0`` add up to
    2 c at every stationary point, so one of the parts is zero there. Factors may hold variables with a sign by
    their bounds, such as a free duration; parameters count with their present values.

    Absolute values whose argument is one variable with bounds beyond zero stay, as do products ``e * abs(e)``, which
    have a continuous derivative.

    Option of ``apply_to`` and ``create_using``: ``targets`` (blocks, constraints, objectives, or single ones of them;
    default all). Rows and objectives keep their names and get another expression; those in disjuncts are left alone.
    The parts start at the parts of the values on the model.
    """

    kinds = (Constraint, Objective)
    containers = (Block,)
    block_name = "absolute_values_as_pairs"
    generated = "parts in place of absolute values"

    def _fill(self, block: Any, rows: list[Any]) -> list[tuple[Any, Any]]:
        parts: dict[int, _Part] = {}  # by the argument: equal ones of one variable share their parts
        places: dict[int, list[int]] = {}
        rows_to_fill = []
        for row in rows:
            uses = list(_uses(row))
            for count, (node, needs_pair) in enumerate(uses):
                argument = node.arg(0)
                family = (row.parent_component().name, index_without_time(row.index()), count)
                part = parts.setdefault(id(argument), _Part(argument, family))
                part.needs_pair |= needs_pair
                places.setdefault(id(argument), []).append(id(node))
            if uses:
                rows_to_fill.append(row)
        known = list(parts.values())
        block.positive, block.negative = (Var(range(len(known)), bounds=(0, None)) for _ in range(2))
        sums = {node: block.positive[i] + block.negative[i] for i, key in enumerate(parts) for node in places[key]}
        for i, part in enumerate(known):
            start = value(part.argument, exception=False)
            if start is not None:
                block.positive[i].value, block.negative[i].value = max(start, 0.0), max(-start, 0.0)
        block.difference = Constraint(
            range(len(known)),
            rule=lambda b, i: _replaced(known[i].argument, sums) == b.positive[i] - b.negative[i],
        )
        paired = [i for i, part in enumerate(known) if part.needs_pair]
        if paired:
            block.pairs = Complementarity(
                paired,
                rule=lambda b, i: complements(b.positive[i], b.negative[i]),
                family=lambda b, i: known[i].family,
            )
        return [(row, _replaced(row.expr, sums)) for row in rows_to_fill]

    def _nothing_found(self, where: str) -> str:
        return f"no active row or objective in {where} holds abs(...) of an expression that may be zero."


def _replaced(expression: Any, sums: dict[int, Any]) -> Any:
    plain = expression.__class__ in native_types or not expression.is_expression_type()
    return expression if plain else replace_expressions(expression, sums)


def _uses(row: Any) -> Iterator[tuple[Any, bool]]:
    """The absolute values of a row or an objective, each with whether a sum of parts above it could be of use."""
    objective = row.ctype is Objective
    body = row.expr if objective else row.body
    if next(topmost_nodes((body,), has_kink), None) is None:
        return
    if objective:
        sign = 1 if row.is_minimizing() else -1
    else:
        sign = int(row.has_ub()) - int(row.has_lb())
    # A sign says what a larger node does: 1 costs, -1 gains, 0 is not known.
    stack, seen = [(body, sign)], {}
    while stack:
        node, sign = stack.pop()
        if node.__class__ in native_types or not node.is_expression_type() or (id(node), sign) in seen:
            continue
        seen[id(node), sign] = node  # a temporary node has to live on to keep its id
        if has_kink(node):
            yield node, sign <= 0
            sign = 0
        elif is_smooth_product(node):
            continue
        if isinstance(node, ProductExpression):
            first, second = node.args
            stack += [(second, sign and sign * _sign_of(first)), (first, sign and sign * _sign_of(second))]
        elif isinstance(node, DivisionExpression):
            stack += [(node.arg(1), 0), (node.arg(0), sign and sign * _sign_of(node.arg(1)))]
        else:
            if isinstance(node, NegationExpression):
                sign = -sign
            elif not (isinstance(node, SumExpression) or node.is_named_expression_type()):
                sign = 0
            stack += [(argument, sign) for argument in reversed(node.args)]


def _sign_of(factor: Any) -> int:
    """1 where a factor is never negative, -1 where it is never positive, 0 where nothing is known."""
    least, most = interval_of(factor)
    return 1 if least >= 0.0 else -1 if most <= 0.0 else 0


def is_zero_product(row: Any) -> bool:
    """Whether a row says that the product of two factors with variables is zero.

    Such are ``a * b == 0`` and, where no factor is negative by the bounds of its variables, ``a * b <= 0``. Numbers
    before the product are left out.
    """
    lower, upper = (_finite(bound) for bound in (row.lower, row.upper))
    body = without_number(row.body)
    if upper != 0.0 or lower not in (0.0, None) or not isinstance(body, ProductExpression):
        return False
    if lower is None and not (body is row.body and all(interval_of(factor)[0] >= 0.0 for factor in body.args)):
        return False
    first, second = map(without_number, body.args)
    return holds_variable(first) and holds_variable(second) and first is not second


def interval_of(expression: Any) -> tuple[float, float]:
    """By interval arithmetic, from the declared bounds of variables: fixed ones may be freed again."""
    return ExpressionBounds(use_fixed_var_values_as_bounds=False).walk_expression(expression)


def without_number(expression: Any) -> Any:
    """An expression without its sign and the number before it; as it is where that number is zero or unknown."""
    while expression.__class__ not in native_types and expression.is_expression_type():
        if isinstance(expression, NegationExpression):
            expression = expression.arg(0)
        elif isinstance(expression, ProductExpression) and _finite(expression.arg(0)):
            expression = expression.arg(1)
        else:
            break
    return expression


def _finite(number: Any) -> float | None:
    """The value of what holds no variable, where it is finite."""
    if number is None or holds_variable(number):
        return None
    known = value(number, exception=False)
    return None if known is None or not isfinite(known) else float(known)


# --------------------------------------------------------------------------------------------------------- disjunctions


@TransformationFactory.register(
    "pyrobocop.complementarity_to_disjunctions", doc="Turn complementarity pairs into disjunctions, reversibly."
)
class ComplementarityToDisjunctions(RowReplacement):
    """Replace complementarity pairs by choices ``[a == 0] v [b == 0]`` for mixed-integer solvers.

    Nothing is relaxed: with linear sides and a convex objective the answer is global. A range ``l <= F <= u ⟂ H``
    becomes ``[F == l, H >= 0] v [F == u, H <= 0] v [H == 0]``. Apply ``gdp.bigm`` or ``gdp.hull`` afterwards: they take
    bounds of the sides from the bounds of the variables. Discrete variables are welcome in a side.

    Option of ``apply_to`` and ``create_using``: ``targets`` (blocks, components or single pairs; default all). The
    pairs are deactivated and never changed. Revert before a reformulation such as ``gdp.bigm``, which has no way back,
    or apply that to a copy.
    """

    kinds = PAIR_TYPES
    containers = BLOCK_TYPES
    block_name = "complementarity_disjunctions"
    generated = "disjunctions of pairs"

    def _rows(self, model: Any, targets: Any) -> list[Any]:
        sources = super()._rows(model, targets)
        refuse_missing_pairs(model, sources, targets)
        return sources

    def _fill(self, block: Any, rows: list[Any]) -> list[tuple[Any, Any]]:
        forms = [canonical_form(source) for source in rows]
        refuse_unusable_leaves(forms, discrete_allowed=True)
        block.rows = ConstraintList()
        block.disjuncts = Disjunct(AnyIndex)
        block.choices = Disjunction(NonNegativeIntegers)
        for form in forms:
            sides = [row for pair in form.pairs for row in (pair.a_row, pair.b_row) if row is not None]
            for row in (*form.rows, *sides):
                block.rows.add(row)
        for position, form in enumerate(form for form in forms if form.pairs):
            chosen = []
            for branch, stated in _branches(form).items():
                disjunct = block.disjuncts[position, branch]
                disjunct.rows = ConstraintList()
                for row in stated:
                    disjunct.rows.add(row)
                chosen.append(disjunct)
            block.choices[position] = chosen
        return [(source, None) for source in rows]

    def residuals(self, model: Any) -> list[PairResidual]:
        """Evaluate the pairs that are disjunctions at the current values, by their own sides.

        Raises
        ------
        ComplementarityError
            If a variable of a pair has no value.
        """
        sources = [source for block in self._generated_on(model) for source, _ in rows_of_block(block) or ()]
        return pair_residuals(pair for source in sources for pair in canonical_form(source).pairs)


def _branches(form: CanonicalForm) -> dict[str, list[Any]]:
    pair = form.pairs[0]  # the parts of a free side are zero together
    if form.between is None:
        return {"first": [pair.a == 0], "second": [pair.b == 0]}
    lower, body, upper = form.between
    return {
        "lower": [body == lower, pair.b >= 0],
        "upper": [body == upper, pair.b <= 0],
        "between": [pair.b == 0],
    }
