"""Discretising one continuous set of a model, and undoing that; integrals by the quadrature of the scheme.

Sums over the points that a continuous set happens to have: they would be incomplete once it has more.

Pyomo does not know that an expression was written as ``sum(... for t in m.t)``. Where there is a rule, it is run again
after the set has grown, and the variables are compared. Where there is only an expression, it is taken for a sum over
the set when one term is repeated at all of its points, or at all but the first or the last.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import partial
from typing import Any

from pyomo.core.base.constraint import Constraint
from pyomo.core.base.expression import Expression
from pyomo.core.base.initializer import ConstantInitializer
from pyomo.core.base.objective import Objective
from pyomo.core.base.var import Var
from pyomo.core.expr import MonomialTermExpression, NegationExpression, ProductExpression, SumExpression
from pyomo.core.expr.numvalue import value
from pyomo.dae import DerivativeVar, Integral

from pyrobocop_pyomo.complementarity import Complementarity
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.expression_arrays import plain_scalar
from pyrobocop_pyomo.modeling.failures import failures_as, undone_on_failure
from pyrobocop_pyomo.modeling.pyomo_internals import parts_of, put_rule, stated_rule
from pyrobocop_pyomo.modeling.shared_nodes import NodesOnce, variables_in_any, variables_read
from pyrobocop_pyomo.numerics import Grid
from pyrobocop_pyomo.transcription import quadrature

from .derivatives import add_collocation, substitute_derivatives, write_rows
from .expansion import Family, expand, refuse_what_cannot_grow
from .holding_rows import HoldingRows, undecided_parts
from .structure import (
    Discretisation,
    Spot,
    axis_on,
    continuous_sets,
    discretisation_of,
    discretisations_beside,
    rule_of,
    spots,
)
from .values import add_shown_values, families, find_definitions, find_shown_values

# ---------------------------------------------------------------------------------------------------- sums over the set


_WITH_COEFFICIENTS = (ProductExpression, MonomialTermExpression, NegationExpression)


def check_possible_sum(component: Any, index: Any, domain: Any) -> None:
    """Raise a `ModelError` when the rule of an expression now reads more than it holds."""
    where = (
        f"'{component.name}': holds variables at several points of '{domain.name}', and its rule fails now that the "
        "set has more"
    )
    with failures_as(ModelError, where):
        result = rule_of(component)(component.parent_block(), index)
    if set(map(id, variables_read(result))) - variables_in_any([component[index].expr]).keys():
        raise _refusal(component, index, domain)


def find_possible_sums(spots: list[Spot], domain: Any) -> list[tuple[Any, Any]]:
    """Component and index of the expressions to check again after the set has grown.

    Raises
    ------
    ModelError
        When an expression without a rule looks like a sum over the set.
    """
    points = tuple(domain)
    place = {
        id(data): (family, time)
        for spot in spots
        if spot.component.ctype in (Var, DerivativeVar, Expression)
        for family, time, data in spot.members_along(domain)
    }
    # Named expressions are checked by themselves.
    named = [spot.component for spot in spots if spot.component.ctype in (Integral, Expression)]
    leaves = frozenset(id(data) for component in named for data in component.values())
    possible_sums = []
    for spot in spots:
        if spot.component.ctype not in (Objective, Constraint, Expression) or isinstance(spot.component, Integral):
            continue
        if spot.component.is_reference():
            continue
        axis = axis_on(spot.component, domain)
        around = {time for outer, time in spot.outer if outer is domain}
        for index, data in spot.component.items():
            own = around if axis is None else {axis.time(index)}
            times = {place[key][1] for key in variables_in_any([data.expr], leaves) if key in place}
            if len(times | own) < 2:
                continue
            rule = rule_of(spot.component)
            if rule is not None and not isinstance(rule, ConstantInitializer):
                possible_sums.append((spot.component, index))
                continue
            terms = _Terms(place, leaves)
            terms.of(data.expr)
            if _covers(terms.repeated, points):
                raise _refusal(spot.component, index, domain)
    return possible_sums


def _covers(times: set[float], points: tuple[float, ...]) -> bool:
    return len(times) > 1 and times >= min(set(points[1:]), set(points[:-1]), key=lambda inner: len(inner - times))


def _refusal(component: Any, index: Any, domain: Any) -> ModelError:
    where = "" if index is None else f"[{index}]"
    return ModelError(
        f"'{component.name}{where}': is a sum over the points that '{domain.name}' had when it was written, "
        "and would miss all others. For an integral over time write an Integral; for a sum over the final "
        "mesh build it after the transformation; for a sum over chosen points, such as times of measurements, give "
        "it a function, rule=..., that sums over those."
    )


class _Terms(NodesOnce):
    """Finds times at which the same term is repeated in one sum: the trace of a sum over a set.

    Terms are the same when they differ in times, and in the size of numbers, only. What is found at an expression is
    its form, whether a number below zero stands before it, and its times.

    Parameters
    ----------
    place : mapping of the id of a variable to (family, time)
    leaves : collection of int
        Ids of named expressions that are not looked into.

    Attributes
    ----------
    repeated : set of float
    """

    def __init__(self, place: Mapping[int, tuple[Any, float]], leaves: Collection[int]) -> None:
        super().__init__()
        self._place, self._leaves = place, leaves
        self.repeated: set[float] = set()

    def goes_below(self, node: Any) -> bool:
        return super().goes_below(node) and node.is_potentially_variable() and id(node) not in self._leaves

    def of_leaf(self, leaf: Any) -> Any:
        if not leaf.is_potentially_variable():
            return value(leaf, exception=False) or 0
        family, time = self._place.get(id(leaf), (id(leaf), None))
        return family, False, frozenset(() if time is None else (time,))

    def of_operation(self, node: Any, found: list[Any]) -> Any:
        parts = [each for each in found if each.__class__ is tuple]
        if isinstance(node, SumExpression):
            times_of: dict[Any, set[frozenset[float]]] = {}
            for *form, times in parts:
                if times:
                    times_of.setdefault(tuple(form), set()).add(times)
            self.repeated.update(*(times for of in times_of.values() if len(of) > 1 for times in of))
        if len(parts) == 1 and (node.is_named_expression_type() or isinstance(node, _WITH_COEFFICIENTS)):
            ((form, is_negative, times),) = parts
            negations = sum(1 for each in found if each.__class__ is not tuple and each < 0)
            negations += isinstance(node, NegationExpression)
            return form, is_negative ^ (negations % 2 == 1), times
        return (type(node), *(part[:2] for part in parts)), False, frozenset().union(*(part[2] for part in parts))


# ------------------------------------------------------------------------------------------------------- discretisation


DAE_NAMES = {"radau": "LAGRANGE-RADAU", "gauss": "LAGRANGE-LEGENDRE"}


def discretise(domain: Any, points: tuple[float, ...], grid: Grid) -> Discretisation:
    """Discretise one continuous set; on failure it is not, and all else as it was.

    Parameters
    ----------
    domain : ContinuousSet
    points : tuple of float
        The points that the set has.
    grid : Grid
        On a mesh with all of these points.
    """
    root = domain.model()
    found = list(spots(root))
    refuse_what_cannot_grow(found, domain)
    possible_sums = find_possible_sums(found, domain)
    discretisation = Discretisation(domain, grid, points)
    integrals = integrals_along(found, domain)
    for integral in integrals:
        remember_integrand(integral)
    discretisation.formulas = [(data, data.expr) for integral in integrals for data in integral.values()]
    with undone_on_failure(partial(undo_discretisation, discretisation)):
        domain.update(sorted({*grid.times, *grid.points}.difference(points)))
        # Rules may ask for the element of a point, which depends on the scheme where the point is a boundary.
        domain._fe = list(grid.mesh.boundaries)
        domain.get_discretization_info().update(
            scheme=DAE_NAMES.get(grid.scheme.name.split("(")[0], grid.scheme.name),
            nfe=grid.mesh.elements,
            ncp=grid.scheme.stages,
            tau_points=grid.scheme.state_nodes.tolist(),
        )
        expand(found, domain, points)
        found = list(spots(root))
        add_collocation(discretisation, found)
        _inherit(found, discretisation)
        discretisations_beside(domain)[domain] = discretisation
        for integral in integrals_along(found, domain):
            integrate(integral, discretisation)
        for possible_sum in possible_sums:
            check_possible_sum(*possible_sum, domain)
        rows = HoldingRows(list(spots(root)), discretisation)
        rows.deactivate_rows()
        _show_values(root, rows, discretisation)
        _mark_pairs(found, discretisation)
    return discretisation


def discretisations_on(root: Any) -> list[Discretisation]:
    """The discretisations of all sets of a model."""
    found = map(discretisation_of, continuous_sets(list(spots(root))))
    return [discretisation for discretisation in found if discretisation is not None]


def _show_values(root: Any, rows: HoldingRows, discretisation: Discretisation) -> None:
    """Give values to variables without one, as far as that restricts nothing else; fix the others to None."""
    absent = rows.absent
    in_pairs = absent.keys() & {key for _, ids in rows.first_pairs for key in ids}
    alone = {key: place for key, place in absent.items() if key not in in_pairs}
    sources = find_shown_values(list(spots(root)), alone, rows.used - in_pairs, discretisation)
    definitions = find_definitions([row for row, _ in rows.undetermined], absent, sources)
    hold = {id(row): row for row in definitions.values()}
    parts = undecided_parts(rows.undetermined, absent.keys())
    for part, ids in parts:
        if hold.keys() >= set(map(id, part)) and rows.asked_for.isdisjoint(ids):
            continue  # with the values that controls show
        if all(rows.is_first(absent[key][1]) for key in ids):
            # The model may fix later what is left to choose, and an implicit equation of derivatives gives them.
            hold.update((id(row), row) for row in part)
            for key in rows.given_by_shown_values(part, ids, sources.keys(), definitions) or ids:
                del absent[key]
    for key in rows.asked_for & absent.keys() - sources.keys() - definitions.keys():
        del absent[key]
    for pair, held in rows.first_pairs:
        if absent.keys().isdisjoint(held) and not in_pairs.isdisjoint(held):
            hold[id(pair)] = pair
    for row in hold.values():
        row.activate()
    discretisation.deactivated = [row for row in discretisation.deactivated if id(row) not in hold]
    shown = {key: pair for key, pair in sources.items() if key in absent and key not in definitions}
    following = {key: rows.what_follows(part, ids - shown.keys()) for part, ids in parts for key in ids & shown.keys()}
    discretisation.shown = [(*pair, following.get(key, ())) for key, pair in shown.items()]
    added = {id(block) for block in discretisation.generated}
    discretisation.before += [(data, data.value) for data, _ in absent.values() if id(data.parent_block()) not in added]
    for key, (data, _) in absent.items():
        data.unfix()
        if key not in definitions and key not in sources:
            data.fix(None, skip_validation=True)
            data.stale = True
    add_shown_values(discretisation)


def undo_discretisation(discretisation: Discretisation) -> None:
    """Take a discretisation back, before derivatives are substituted.

    The set and its components are as before, except what the user has fixed since.
    """
    domain = discretisation.domain
    for block in discretisation.generated:
        block.parent_block().del_component(block)
    discretisation.generated.clear()
    for data in discretisation.deactivated:
        data.activate()
    for data, number in reversed(discretisation.before):
        if not data.fixed or data.value is None:  # otherwise the user has fixed it since
            data.unfix()
            data.set_value(number, skip_validation=True)
    for data, formula in discretisation.formulas:
        data.set_value(formula)
    kept = set(discretisation.points)
    for spot in spots(domain.model()):
        axis = axis_on(spot.component, domain)
        if axis is not None and not spot.component.is_reference():
            for index in [index for index in parts_of(spot.component) if axis.time(index) not in kept]:
                del parts_of(spot.component)[index]
    for time in [time for time in domain if time not in kept]:
        domain.discard(time)
    domain._fe = sorted(kept)
    domain.get_discretization_info().clear()
    discretisations_beside(domain).pop(domain, None)


def _inherit(found: list[Spot], discretisation: Discretisation) -> None:
    old, points = set(discretisation.points), frozenset(discretisation.grid.points)
    for _, is_state, along in families(found, discretisation):
        component = next(iter(along.values())).parent_component()
        is_in_blocks = axis_on(component, discretisation.domain) is None
        of_old, of_new = ([(t, data) for t, data in along.items() if (t in old) is is_old] for is_old in (True, False))
        Family(is_state, is_in_blocks, points, of_old, of_new).inherit(discretisation.domain)


def _mark_pairs(found: list[Spot], discretisation: Discretisation) -> None:
    """Set the element, the family and the quadrature weight of pairs, where the user has not."""
    elements, weights = discretisation.grid.element_of, discretisation.grid.quadrature_weights
    for spot in found:
        if spot.component.ctype is not Complementarity:
            continue
        for family, time, data in spot.members_along(discretisation.domain):
            if spot.component._group_rule is None and (time in elements or data.active):
                data.set_group(elements.get(time, 0))  # at the first point, which no quadrature weighs, 0
            if spot.component._family_rule is None and time in elements:
                data.set_family(family[-1][1])
            if spot.component._weight_rule is None and time in elements:
                data.set_weight(weights[time])


def _itself(component: Any) -> Any:
    return component


def finalise(discretisation: Discretisation) -> None:
    """The last steps, which cannot fail: substitute, and leave the rest as pyomo.dae does for its own tools."""
    domain = discretisation.domain
    found = list(spots(domain.model()))
    substitute_derivatives(discretisation, found)
    write_rows(discretisation)
    domain.set_changed(True)
    for spot in found:
        component = spot.component
        if isinstance(component, DerivativeVar):
            known = component.get_state_var()._derivative
            known[tuple(sorted(str(along) for along in component.get_continuousset_list()))] = partial(
                _itself,
                component,  # a pickle can hold it, and a clone follows it
            )
            if component.ctype is DerivativeVar and component.is_fully_discretized():
                component.parent_block().reclassify_component_type(component, Var)
    for integral in integrals_along(found, domain):
        if integral.ctype is Integral:  # pyomo.dae makes it an expression as well
            integral.parent_block().reclassify_component_type(integral, Expression)
        # The wrapped rule is not needed any more, and no pickle can hold it.
        put_rule(integral, None)


def integrals_along(spots: list[Spot], domain: Any) -> list[Any]:
    """Every integral over a set."""
    return [
        spot.component
        for spot in spots
        if isinstance(spot.component, Integral) and spot.component.get_continuousset() is domain
    ]


def remember_integrand(integral: Any) -> None:
    """Keep the user's own rule as ``integrand`` of the integral: pyomo.dae wraps it in the trapezoidal rule.

    Raises
    ------
    ModelError
        When the rule cannot be found.
    """
    if not hasattr(integral, "integrand"):
        # pyomo.dae has no public way to the integrand; it lives in the environment of the wrapped rule.
        wrapped = getattr(stated_rule(integral), "_fcn", None)
        integral.integrand = getattr(wrapped, "__globals__", {}).get("rule")
    if not callable(integral.integrand):
        raise ModelError(f"'{integral.name}': its integrand cannot be read; give it as rule=... a function.")


def integrate(integral: Any, discretisation: Discretisation) -> None:
    """Give an integral its value as an expression at the collocation points."""
    rule, block, place = integral.integrand, integral.parent_block(), integral.loc
    indices = list(integral.index_set()) if integral.is_indexed() else [None]
    for index in indices:
        others = index if isinstance(index, tuple) else () if index is None else (index,)
        before, after = others[:place], others[place:]
        what = f"'{integral.name}': the integrand"
        integrand = {
            time: plain_scalar(rule(block, *before, time, *after), what) for time in discretisation.grid.points
        }
        value = quadrature(integrand.__getitem__, discretisation.grid.quadrature_weights)
        if index in parts_of(integral):
            parts_of(integral)[index].set_value(value)
        else:
            integral._setitem_when_not_present(index, value)
