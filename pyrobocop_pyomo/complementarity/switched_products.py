"""The transformation `pyrobocop.products_to_complementarity`: rows that a product is zero become pairs, reversibly."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

from pyomo.common.autoslots import AutoSlots
from pyomo.common.config import ConfigDict, ConfigValue
from pyomo.common.modeling import unique_component_name
from pyomo.contrib.fbbt.expression_bounds_walker import ExpressionBoundsVisitor
from pyomo.core.base import Transformation, TransformationFactory
from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint, ConstraintData
from pyomo.core.expr.numeric_expr import NegationExpression, PowExpression, ProductExpression
from pyomo.core.expr.numvalue import native_types, value
from pyomo.core.expr.relational_expr import InequalityExpression

from pyrobocop_pyomo.errors import ComplementarityError
from pyrobocop_pyomo.modeling.activity import deactivate
from pyrobocop_pyomo.modeling.expressions import holds_variable

from .component import Complementarity
from .preconditions import refuse_foreign_token, refuse_unusable
from .statement import ANY_SIGN, Complements, complements, either_zero

BLOCK_NAME = "products_as_pairs"


class ProductRecord(AutoSlots.Mixin):
    """Private data of a generated block.

    Attributes
    ----------
    rows : list of ConstraintData or None
        That the pairs stand for, in their order; None on a block that this package did not generate.
    """

    __slots__ = ("rows",)

    def __init__(self) -> None:
        self.rows: list[Any] | None = None


Block.register_private_data_initializer(ProductRecord)


@dataclass(frozen=True, eq=False)
class ProductToken:
    """What `ProductsToComplementarity.revert` needs to undo one application.

    Attributes
    ----------
    model : Block
        The model that was transformed.
    block : Block
        Holds the pairs.
    """

    model: Any
    block: Any


def zero_product(row: Any) -> tuple[Any, Any] | None:
    """The two factors of a row that says that their product is zero; None for any other row.

    Such are ``a * b == 0`` and, where no factor is negative by the bounds of its variables, ``a * b <= 0``. Numbers
    before the product are left out, and of a power ``x**2`` its base is taken, which is zero where the power is.
    """
    lower, upper = (_finite(bound) for bound in (row.lower, row.upper))
    body = _without_number(row.body)
    if upper != 0.0 or lower not in (0.0, None) or not isinstance(body, ProductExpression):
        return None
    if lower is None and not (body is row.body and all(_bounds(factor)[0] >= 0.0 for factor in body.args)):
        return None
    first, second = map(_base, body.args)
    return (first, second) if holds_variable(first) and holds_variable(second) and first is not second else None


def pair_of_factors(first: Any, second: Any) -> Complements | None:
    """State by a pair that one of two factors is zero; None where the bounds of the variables say no sign of either."""
    signed = [_with_sign(factor) for factor in (first, second)]
    if signed[0] is not None and signed[1] is not None:
        return complements(*signed)
    if signed[0] is not None:
        return either_zero(signed[0], second)
    return None if signed[1] is None else either_zero(signed[1], first)


def as_line(pair: Complements) -> str:
    """The pair as a line of Python."""
    which = "either_zero" if pair.second_bound == ANY_SIGN else "complements"
    return f"rcp.{which}({_shown(pair.first)}, {_shown(pair.second)})"


@TransformationFactory.register(
    "pyrobocop.products_to_complementarity", doc="Turn rows that a product is zero into pairs, reversibly."
)
class ProductsToComplementarity(Transformation):
    """Replace rows ``a * b == 0`` by pairs, which this package solves by their branches.

    The derivatives of such a product vanish where both factors do, and solvers stall there. Where the bounds of the
    variables say that neither factor is negative, the pair is ``complements(a >= 0, b >= 0)``; where they say the sign
    of one, it is ``either_zero(a >= 0, b)``. Rows of any other kind stay, as do products whose factors both have any
    sign. Points that meet the row and the bounds meet the pair, and the other way round.

    Option of ``apply_to`` and ``create_using``: ``targets`` (blocks, constraints or single rows; default all). Rows are
    deactivated and never changed; those in disjuncts are left alone.
    """

    CONFIG = ConfigDict("pyrobocop.products_to_complementarity")
    CONFIG.declare(
        "targets", ConfigValue(default=None, description="Blocks, constraints or single rows to take; default all.")
    )

    def _apply_to(self, model: Any, **options: Any) -> ProductToken:
        config = self.CONFIG({**options.pop("options", {}), **options})
        refuse_unusable(model)
        found = [(row, pair) for row in _rows(model, config.targets) if (pair := _pair_of_row(row)) is not None]
        if not found:
            where = "it" if config.targets is None else "the targets"
            raise ComplementarityError(
                f"'{model.name}': no active row in {where} says that a product is zero of which one factor has a known "
                "sign. Give the factor that is never negative a bound: bounds=(0, None)."
            )
        rows = [row for row, _ in found]
        block = Block(concrete=True)
        # Rows of one component that state the same at different times, as pairs of one family.
        block.pairs = Complementarity(
            range(len(found)),
            rule=lambda b, i: found[i][1],
            family=lambda b, i: (rows[i].parent_component().name, _without_time(rows[i].index())),
        )
        _record_of(block).rows = rows
        model.add_component(unique_component_name(model, BLOCK_NAME), block)
        deactivate(rows)
        return ProductToken(model, block)

    def revert(self, model: Any, token: ProductToken | None = None) -> None:
        """Undo one application, or all of them.

        Parameters
        ----------
        model : Block
            The model that `apply_to` was called with.
        token : ProductToken, optional
            What `apply_to` returned. Without it everything on this model is undone, which also serves a clone.

        Raises
        ------
        ComplementarityError
            If there is nothing to undo, or if the token is used up or belongs to another model.
        """
        refuse_foreign_token(model, token)
        present = list(_generated_on(model))
        wanted = present if token is None else [block for block in present if block is token.block]
        if not wanted:
            raise ComplementarityError(
                f"'{model.name}': nothing to revert; it has no pairs in place of products, or was reverted before."
            )
        for block in wanted:
            rows = _record_of(block).rows
            model.del_component(block)
            for row in rows or ():
                row.activate()

    def source_of(self, pair: Any) -> Any:
        """Return the row that a generated pair stands for."""
        rows = _record_of(pair.parent_block()).rows
        if rows is None:
            raise ComplementarityError(f"'{pair.name}': was not generated by pyrobocop.products_to_complementarity.")
        return rows[pair.index()]


def _rows(model: Any, targets: Sequence[Any] | None) -> Iterator[Any]:
    if targets is None:
        yield from model.component_data_objects(Constraint, active=True, descend_into=Block)
        return
    for target in targets:
        if target.ctype is Constraint:
            yield from (
                row for row in ([target] if isinstance(target, ConstraintData) else target.values()) if row.active
            )
        elif target.ctype is Block:
            yield from target.component_data_objects(Constraint, active=True, descend_into=Block)
        else:
            raise ComplementarityError(f"'{target.name}': is neither a block nor a constraint; give such as targets.")


def _pair_of_row(row: Any) -> Complements | None:
    factors = zero_product(row)
    return None if factors is None else pair_of_factors(*factors)


def _with_sign(factor: Any) -> Any:
    """The factor with its sign as a relation; None where its bounds say none."""
    least, most = _bounds(factor)
    if least >= 0.0:
        return factor >= 0
    return factor <= 0 if most <= 0.0 else None


def _bounds(expression: Any) -> tuple[float, float]:
    """By interval arithmetic, from the declared bounds of variables: fixed ones may be freed again."""
    return ExpressionBoundsVisitor(use_fixed_var_values_as_bounds=False).walk_expression(expression)


def _base(factor: Any) -> Any:
    """What is zero where the factor is."""
    factor = _without_number(factor)
    if isinstance(factor, PowExpression):
        base, power = factor.args
        if power.__class__ in native_types and power > 0 and power == int(power):
            return _without_number(base)
    return factor


def _without_number(expression: Any) -> Any:
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


def _shown(side: Any) -> str:
    if not isinstance(side, InequalityExpression):
        return str(side)
    low, high = side.args
    return f"{low} <= 0" if high.__class__ in native_types else f"{high} >= 0"


def _without_time(index: Any) -> Any:
    return index[1:] if isinstance(index, tuple) else ()


def _record_of(block: Any) -> ProductRecord:
    return block.private_data()


def _generated_on(model: Any) -> Iterator[Any]:
    for block in list(model.component_objects(Block, descend_into=False)):
        # The name is looked at first so that no private data appear on blocks of the user.
        if block.local_name.startswith(BLOCK_NAME) and not block.is_indexed() and _record_of(block).rows is not None:
            yield block
