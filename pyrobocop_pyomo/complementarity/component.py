"""The component that states complementarity pairs."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any

from pyomo.common.modeling import NOTSET
from pyomo.common.timing import ConstructionTimer
from pyomo.core.base.component import ActiveComponentData
from pyomo.core.base.global_set import UnindexedComponent_index
from pyomo.core.base.indexed_component import ActiveIndexedComponent, UnindexedComponent_set
from pyomo.core.base.initializer import Initializer
from pyomo.core.expr.numvalue import native_numeric_types, value
from pyomo.core.expr.relational_expr import RelationalExpression

from pyrobocop_pyomo.errors import ComplementarityError

from .sides import check_sides
from .statement import Complements


def index_without_time(index: Any) -> Any:
    """An index without its first part, which is the time in a phase and usually elsewhere."""
    return index[1:] if isinstance(index, tuple) else ()


class ComplementarityData(ActiveComponentData):
    """One pair of sides, as given.

    Parameters
    ----------
    component : Complementarity or None
        The component that holds this pair.
    """

    __slots__ = ("_bounds", "_family", "_group", "_sides", "_weight")

    def __init__(self, component: Complementarity | None = None) -> None:
        ActiveComponentData.__init__(self, component)
        self._sides: tuple[Any, Any] | None = None
        self._bounds: tuple[str | None, str | None] = (None, None)
        self._group: Hashable = None
        self._family: Hashable = NOTSET
        self._weight: Any = 1

    @property
    def args(self) -> tuple[Any, Any]:
        """The two sides as given; they are never rewritten."""
        if self._sides is None:
            raise ComplementarityError(
                f"'{self.name}': has no sides yet. Construct the model, or assign complements(first, second)."
            )
        return self._sides

    @property
    def bounds(self) -> tuple[str | None, str | None]:
        """Which bound is meant, per side: "lower", "upper", "free" or None."""
        return self._bounds

    @property
    def group(self) -> Hashable:
        """Label of the group that this pair belongs to, or None."""
        return self._group

    @property
    def family(self) -> Hashable:
        """What is equal for those pairs of a component that state the same at different times.

        Where none was given, the index without its first part, which is the time in a phase and usually elsewhere.
        """
        return index_without_time(self.index()) if self._family is NOTSET else self._family

    @property
    def weight(self) -> Any:
        """Measure of the pair in a penalty: a number or an expression of parameters."""
        return self._weight

    def set_value(self, pair: Any) -> None:
        """Give the pair its sides.

        Parameters
        ----------
        pair : Complements or 2-tuple
            The two sides.

        Raises
        ------
        ComplementarityError
            If it is not two sides that can be complementary.
        """
        if pair is Complementarity.Skip:
            del self.parent_component()[self.index()]
            return
        if pair is None:
            raise ComplementarityError(
                f"'{self.name}': the rule returned None. Return complements(first, second), "
                "or Complementarity.Skip to leave the pair out."
            )
        if isinstance(pair, Complements):
            first, second, *bounds = pair
        elif isinstance(pair, (tuple, list)) and len(pair) == 2:
            (first, second), bounds = pair, [None, None]
        else:
            length = f" of length {len(pair)}" if isinstance(pair, (tuple, list)) else ""
            product = isinstance(pair, RelationalExpression)
            raise ComplementarityError(
                f"'{self.name}': expected complements(first, second) or a 2-tuple of sides, "
                f"found {type(pair).__name__}{length}."
                + (" A product a * b == 0 is stated by its factors: complements(a >= 0, b >= 0)." if product else "")
            )
        choices = (bounds[0], bounds[1])
        check_sides(first, second, choices, self)
        self._sides = (first, second)
        self._bounds = choices

    def set_group(self, label: Hashable) -> None:
        """Say which group the pair belongs to; pairs of one block with equal labels belong together."""
        self._group = self._hashable("group", label)

    def set_family(self, label: Hashable) -> None:
        """Say which family the pair belongs to; pairs of one component with equal labels state the same."""
        self._family = self._hashable("family", label)

    def _hashable(self, role: str, label: Hashable) -> Hashable:
        try:
            hash(label)
        except TypeError:
            raise ComplementarityError(
                f"'{self.name}': the {role} label {label!r} is not hashable. Use a number, a string or a tuple."
            ) from None
        return label

    def set_weight(self, weight: Any) -> None:
        """Give the pair its measure in a penalty: a nonnegative number or an expression of parameters."""
        if weight.__class__ not in native_numeric_types and not getattr(weight, "is_numeric_type", bool)():
            raise ComplementarityError(f"'{self.name}': the weight {weight!r} is not a number.")
        if weight.__class__ not in native_numeric_types and weight.is_potentially_variable():
            raise ComplementarityError(
                f"'{self.name}': the weight '{weight}' holds a variable; use numbers and parameters."
            )
        number = value(weight, exception=False)
        if number is not None and not 0 <= number < float("inf"):
            raise ComplementarityError(f"'{self.name}': the weight is {number}; it must be finite and >= 0.")
        self._weight = weight


# Not registered with Pyomo's ModelComponentFactory: that goes by the name of the class, and would make
# ``@model.Complementarity`` mean this class instead of the one of pyomo.mpec.
class Complementarity(ActiveIndexedComponent):
    """Pairs ``0 <= a ⟂ b >= 0``, ranges ``l <= F <= u ⟂ H`` and equalities, scalar or indexed.

    No solver reads this component: Pyomo's writers refuse a model that still holds an active one. Apply the
    transformation ``pyrobocop.relax_complementarity`` first.

    Parameters
    ----------
    *sets : Set
        Index sets.
    rule, expr : callable, mapping or pair
        What gives `complements` (or a 2-tuple of sides, or ``Complementarity.Skip``) for each index.
    group : callable, mapping or hashable, optional
        Label per index: pairs of one block with equal labels are bounded together where the grouping is
        "element".
    family : callable, mapping or hashable, optional
        Label per index: pairs with equal labels state the same at different times, and only these are multiplied with
        each other where the grouping is "crossed". By default the index without its first part.
    weight : callable, mapping, number or Param, optional
        Measure of the pair in a penalty, 1 if not given: a transcription passes step times quadrature weight.

    Examples
    --------
    >>> import pyomo.environ as pyo
    >>> from pyrobocop_pyomo import Complementarity, complements
    >>> m = pyo.ConcreteModel()
    >>> m.t = pyo.Set(initialize=[0, 1])
    >>> m.gap, m.force = pyo.Var(m.t, bounds=(0, None)), pyo.Var(m.t, bounds=(0, None))
    >>> m.gap_or_force = Complementarity(m.t, rule=lambda m, t: complements(m.gap[t] >= 0, m.force[t] >= 0))
    """

    _ComponentDataClass = ComplementarityData

    def __new__(cls, *args: Any, **kwds: Any) -> Any:
        """Choose the scalar or the indexed class."""
        if cls is not Complementarity:
            return super().__new__(cls)
        if not args or (args[0] is UnindexedComponent_set and len(args) == 1):
            return super().__new__(ScalarComplementarity)
        return super().__new__(IndexedComplementarity)

    def __init__(self, *args: Any, **kwds: Any) -> None:
        rule = self._pop_from_kwargs("Complementarity", kwds, ("rule", "expr"), None)
        self._rule = Initializer(rule, treat_sequences_as_mappings=False)
        self._group_rule = Initializer(kwds.pop("group", None), treat_sequences_as_mappings=False)
        self._family_rule = Initializer(kwds.pop("family", None), treat_sequences_as_mappings=False)
        self._weight_rule = Initializer(kwds.pop("weight", None), treat_sequences_as_mappings=False)
        kwds.setdefault("ctype", Complementarity)
        ActiveIndexedComponent.__init__(self, *args, **kwds)

    def construct(self, data: Any = None) -> None:
        """Build the pairs from the rule."""
        if self._constructed:
            return
        self._constructed: bool = True
        timer = ConstructionTimer(self)
        for anonymous in self._anonymous_sets or ():
            anonymous.construct()
        rule, block = self._rule, self.parent_block()
        try:
            if rule is None:
                return
            if rule.constant() and self.is_indexed():
                raise ComplementarityError(
                    f"'{self.name}': one pair cannot serve all indices. Pass a rule, or a mapping from index to pair."
                )
            if rule.contains_indices():
                for index in rule.indices():
                    self[index] = rule(block, index)
            elif self.index_set().isfinite():
                for index in self.index_set():
                    self._setitem_when_not_present(index, rule(block, index))
        except ComplementarityError:
            # Half a component would be relaxed without its other half by whoever goes on after the refusal.
            if block is not None:
                block.del_component(self)
            raise
        finally:
            timer.report()

    def _getitem_when_not_present(self, index: Any) -> Any:
        if self._rule is None:
            raise KeyError(index)
        pair = self._setitem_when_not_present(index, self._rule(self.parent_block(), index))
        if pair is None:
            raise KeyError(index)
        return pair

    def _setitem_when_not_present(self, index: Any, value: Any = NOTSET) -> Any:
        pair = super()._setitem_when_not_present(index, value)
        if pair is None:
            return None
        try:
            if self._group_rule is not None:
                pair.set_group(self._ask(self._group_rule, "group", pair))
            if self._family_rule is not None:
                pair.set_family(self._ask(self._family_rule, "family", pair))
            if self._weight_rule is not None:
                pair.set_weight(self._ask(self._weight_rule, "weight", pair))
        except ComplementarityError:
            self._data.pop(index, None)
            raise
        return pair

    def _ask(self, rule: Any, label: str, pair: ComplementarityData) -> Any:
        try:
            return rule(self.parent_block(), pair.index())
        except KeyError:
            raise ComplementarityError(
                f"'{pair.name}': the mapping given as {label}= has no entry for this index."
            ) from None

    def _pprint(self) -> Any:
        return (
            [
                ("Size", len(self)),
                ("Index", self._index_set if self.is_indexed() else None),
                ("Active", self.active),
            ],
            self.items,
            ("First", "Second", "Group", "Active"),
            lambda index, pair: [*pair.args, pair.group, pair.active],
        )

    def display(self, prefix: str = "", ostream: Any = None) -> None:
        """Print the pairs, as `pprint` does: a pair has no value of its own."""
        if self.active:
            self.pprint(ostream=ostream, prefix=prefix)


class ScalarComplementarity(ComplementarityData, Complementarity):
    """A component that is its own single pair."""

    def __init__(self, *args: Any, **kwds: Any) -> None:
        ComplementarityData.__init__(self, component=self)
        Complementarity.__init__(self, *args, **kwds)
        self._index = UnindexedComponent_index

    def set_value(self, pair: Any) -> None:
        """Give the component its sides; parameters and errors as for one pair."""
        if not self._constructed:
            raise ComplementarityError(
                f"'{self.name}': takes sides only once it is constructed. Create the instance of the model first."
            )
        if not self._data:
            self._data[None] = self
        super().set_value(pair)


class IndexedComplementarity(Complementarity):
    """One pair per index."""
