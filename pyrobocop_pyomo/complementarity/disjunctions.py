"""The transformation `pyrobocop.complementarity_to_disjunctions`: pairs become choices, exactly and reversibly."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pyomo.common.autoslots import AutoSlots
from pyomo.common.collections import ComponentMap
from pyomo.common.config import Bool, ConfigValue, PositiveFloat
from pyomo.common.gc_manager import PauseGC
from pyomo.common.modeling import unique_component_name
from pyomo.core.base import TransformationFactory
from pyomo.core.base.block import Block

from pyrobocop_pyomo.errors import ComplementarityError
from pyrobocop_pyomo.modeling.activity import BLOCK_TYPES, deactivate, enclosing_blocks

from .branches import BoundedSides, add_disjunctions, add_special_ordered_sets
from .canonical import CanonicalForm, CanonicalPair
from .pairs import active_sources, canonical_form, home_of
from .preconditions import refuse_leaves, refuse_nothing, refuse_unusable
from .replaced_rows import ReplacementToken, ReversibleTransformation, targets_option
from .residuals import PairResidual, pair_residuals

BLOCK_NAME = "complementarity_disjunctions"


class DisjunctionRecord(AutoSlots.Mixin):
    """Private data of a generated block.

    Attributes
    ----------
    forms : ComponentMap
        From each statement to its canonical form; None on a block that this package did not generate.
    sources : ComponentMap
        From what was generated to the statement that it came from.
    """

    __slots__ = ("forms", "sources")

    def __init__(self) -> None:
        self.forms: Any = None
        self.sources = ComponentMap()


Block.register_private_data_initializer(DisjunctionRecord)


@TransformationFactory.register(
    "pyrobocop.complementarity_to_disjunctions", doc="Turn complementarity pairs into disjunctions, reversibly."
)
class ComplementarityToDisjunctions(ReversibleTransformation):
    """Replace complementarity pairs by choices ``[a == 0] v [b == 0]`` for mixed-integer solvers.

    Nothing is relaxed: with linear sides and a convex objective the answer is global. A range ``l <= F <= u ⟂ H``
    becomes ``[F == l, H >= 0] v [F == u, H <= 0] v [H == 0]``. Sides that are no bounded variables get one, with
    bounds by interval arithmetic at the present values of the parameters; fixed variables count with their bounds.
    Apply ``gdp.bigm`` or ``gdp.hull`` afterwards; both find their bounds. Discrete variables are welcome in a side.

    Options of ``apply_to`` and ``create_using``: ``targets`` (blocks, components or single pairs; default all),
    ``sos1`` (write special ordered sets of type one in place of disjunctions; they need no bounds) and
    ``default_bound`` (bound of a side for which none can be derived; it becomes a constraint, so choose it large
    enough). The pairs are deactivated and never changed. Revert before a reformulation such as ``gdp.bigm``, which
    has no way back, or apply that to a copy.
    """

    generated = "disjunctions of pairs"
    CONFIG = targets_option("pyrobocop.complementarity_to_disjunctions", "Complementarity components or pairs")
    CONFIG.declare("sos1", ConfigValue(default=False, domain=Bool, description="Write special ordered sets instead."))
    CONFIG.declare(
        "default_bound",
        ConfigValue(default=None, domain=PositiveFloat, description="Bound of a side where none can be derived."),
    )

    def _apply_to(self, model: Any, **options: Any) -> ReplacementToken:
        config = self.CONFIG({**options.pop("options", {}), **options})
        refuse_unusable(model)
        with PauseGC():
            sources = active_sources(model, config.targets)
            refuse_nothing(model, sources, config.targets)
            forms = [canonical_form(source) for source in sources]
            refuse_leaves(forms, discrete_allowed=True)
            # All that can fail is done on blocks that are no part of the model yet.
            fresh = [(home, _build(members, config)) for home, members in _by_home(model, forms)]
            for home, block in fresh:
                home.add_component(unique_component_name(home, BLOCK_NAME), block)
            deactivate(sources)
        return ReplacementToken(model, tuple(block for _, block in fresh))

    def _generated_on(self, model: Any) -> Iterator[Any]:
        """The generated blocks of this model and of the disjuncts in it."""
        return filter(_is_generated, model.block_data_objects(active=None, descend_into=BLOCK_TYPES))

    def _restore(self, block: Any) -> None:
        for source in _record_of(block).forms:
            source.activate()

    def source_of(self, component: Any) -> Any:
        """Return the pair, as declared, that a generated disjunction, disjunct, set, variable or row came from."""
        for block in filter(_is_generated, enclosing_blocks(component)):
            sources = _record_of(block).sources
            while component is not block:
                if component in sources:
                    return sources[component]
                component = component.parent_block()
        raise ComplementarityError(
            f"'{component.name}': was not generated by pyrobocop.complementarity_to_disjunctions."
        )

    def choices_of(self, source: Any) -> list[Any]:
        """Return the disjunction, or the special ordered sets, of a pair; an equality has none."""
        for block in (block for parent in enclosing_blocks(source) for block in self._generated_on(parent)):
            record = _record_of(block)
            if source in record.forms:
                components = [block.component(name) for name in ("choices", "sets")]
                parts = [data for component in components if component is not None for data in component.values()]
                return [data for data in parts if record.sources[data] is source]
        raise ComplementarityError(
            f"'{source.name}': is no disjunction. Apply pyrobocop.complementarity_to_disjunctions to its model first."
        )

    def pairs_of(self, model: Any) -> list[CanonicalPair]:
        """Return the pairs of a model that are disjunctions, in canonical form; a range has two, an equality none."""
        forms = [form for block in self._generated_on(model) for form in _record_of(block).forms.values()]
        return [pair for form in forms for pair in form.pairs]

    def residuals(self, model: Any) -> list[PairResidual]:
        """Evaluate the pairs that are disjunctions at the current values, by their own sides.

        Raises
        ------
        ComplementarityError
            If a variable of a pair has no value.
        """
        return pair_residuals(self.pairs_of(model))


def _build(forms: list[CanonicalForm], config: Any) -> Block:
    block = Block(concrete=True)
    sides = BoundedSides(block, config.default_bound, bounds_needed=not config.sos1)
    generated = (add_special_ordered_sets if config.sos1 else add_disjunctions)(block, sides, forms)
    for form in forms:
        for row in form.rows:
            sides.add_row(form.source, row)
    choices = _record_of(block)
    choices.forms = ComponentMap((form.source, form) for form in forms)
    choices.sources.update([*generated, *sides.generated])
    return block


def _by_home(model: Any, forms: list[CanonicalForm]) -> list[tuple[Any, list[CanonicalForm]]]:
    found: dict[int, tuple[Any, list[CanonicalForm]]] = {}
    for form in forms:
        home = home_of(form.source.parent_block(), model)
        found.setdefault(id(home), (home, []))[1].append(form)
    return list(found.values())


def _record_of(block: Any) -> DisjunctionRecord:
    return block.private_data()


def _is_generated(block: Any) -> bool:
    # The name is looked at first so that no private data appear on blocks of the user.
    return block.local_name.startswith(BLOCK_NAME) and _record_of(block).forms is not None
