"""What has to hold before a model is relaxed; each refusal says what to do instead."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from pyomo.core.base import Objective
from pyomo.core.base.var import VarData
from pyomo.core.expr.numvalue import native_types, value

from pyrobocop_pyomo.errors import ComplementarityError, ModelError
from pyrobocop_pyomo.modeling.activity import BLOCK_TYPES
from pyrobocop_pyomo.modeling.expressions import new_leaves

from .forms import CanonicalForm
from .pairs import block_of_rows
from .record import records_above, records_below


def refuse_unusable(model: Any) -> None:
    """Refuse families of blocks, and blocks that are not constructed."""
    if model.is_indexed():
        raise ComplementarityError(
            f"'{model.name}': is a family of blocks. Apply to the model with targets= this component, "
            "or to each member."
        )
    if not model.is_constructed():
        raise ComplementarityError(f"'{model.name}': is not constructed. Apply to model.create_instance().")


def refuse_foreign_token(model: Any, token: Any) -> None:
    """Refuse a token of another model; without a token there is nothing to refuse."""
    if token is not None and token.model is not model:
        raise ComplementarityError(
            f"'{model.name}': the token was made for another model, '{token.model.name}'. "
            "On a clone, call revert(model) without a token."
        )


def refuse_missing_pairs(model: Any, sources: Sequence[Any], targets: Any) -> None:
    """Refuse a model, or targets, without an active pair."""
    if not sources:
        where = "it" if targets is None else "the targets"
        raise ComplementarityError(
            f"'{model.name}': no active complementarity pair in {where}; there is nothing to relax. Activate pairs, "
            "and the blocks that they are in."
        )


def refuse_second_delta(model: Any) -> None:
    """Refuse a block above or below which pairs follow another delta."""
    for record in (*records_above(model), *records_below(model)):
        raise ComplementarityError(
            f"'{model.name}': pairs of '{record.main.parent_block().name}' are relaxed already, with a delta of their "
            f"own on '{record.main.name}'. Revert there first; apply to the outer one of both, with targets= of it."
        )


def refuse_disjuncts(model: Any, sources: Iterable[Any]) -> None:
    """Refuse pairs that hold only where a disjunct is chosen."""
    blocks = {id(source.parent_block()): source for source in sources}  # looked up once for each block
    for source in blocks.values():
        home = block_of_rows(source.parent_block(), model)
        if home is not model:
            raise ComplementarityError(
                f"'{source.name}': lies in the disjunct '{home.name}', and the rows of a relaxation hold whether or "
                "not it is chosen. Choose first, by gdp.fix_disjuncts, or make the pair a choice in it, by "
                "pyrobocop.complementarity_to_disjunctions."
            )


def only_objective(model: Any) -> Any:
    """Return the one active objective; None where there is no objective at all."""
    objectives = list(model.component_data_objects(Objective, active=True, descend_into=BLOCK_TYPES))
    if len(objectives) > 1:
        names = ", ".join(f"'{objective.name}'" for objective in objectives)
        raise ModelError(
            f"'{model.name}' has {len(objectives)} active objectives ({names}); solvers take one. Deactivate the "
            "others, or add them up in a single one."
        )
    return objectives[0] if objectives else None


def refuse_unusable_leaves(forms: Iterable[CanonicalForm], *, discrete_allowed: bool = False) -> None:
    """Refuse NaN as a coefficient, parameter or value of a variable, and unfixed discrete variables."""
    checked: set[int] = set()
    for form in forms:
        expressions = [side for pair in form.pairs for side in (pair.a, pair.b)]
        for row in form.rows:
            expressions += row.args
        for leaf in new_leaves(expressions, checked):
            number: Any = leaf
            if leaf.__class__ not in native_types:
                variable = isinstance(leaf, VarData) or leaf.is_variable_type()
                if variable and not discrete_allowed and not (leaf.is_continuous() or leaf.fixed):
                    raise ComplementarityError(
                        f"'{form.source.name}': holds the discrete variable '{leaf.name}'. Ipopt solves continuous "
                        "problems: relax its domain or fix it, or use pyrobocop.complementarity_to_disjunctions."
                    )
                number = leaf.value if variable else value(leaf, exception=False)
            if number != number:  # true of NaN alone
                raise ComplementarityError(f"'{form.source.name}': {_what_is_nan(leaf)}.")


def _what_is_nan(leaf: Any) -> str:
    if leaf.__class__ in native_types:
        return "a coefficient is NaN. Correct the number that it was computed from"
    if leaf.is_variable_type():
        return f"the value of variable '{leaf.name}' is NaN. Give it a number, or None for no value"
    return f"the parameter '{leaf.name}' is NaN. Give it a number"
