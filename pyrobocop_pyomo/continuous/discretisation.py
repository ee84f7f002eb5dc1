"""Discretising one continuous set of a model, and undoing that; integrals by the quadrature of the scheme."""

from __future__ import annotations

from functools import partial
from typing import Any

from pyomo.core.base.expression import Expression
from pyomo.core.base.var import Var
from pyomo.dae import DerivativeVar, Integral

from pyrobocop_pyomo.complementarity import Complementarity
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.expression_arrays import plain_scalar
from pyrobocop_pyomo.modeling.failures import undone_on_failure
from pyrobocop_pyomo.numerics import Grid
from pyrobocop_pyomo.transcription import quadrature

from .derivatives import (
    add_collocation,
    derivatives_along,
    remove_collocation,
    substitute_derivatives,
    write_rows,
)
from .expansion import Family, expand, refuse_what_cannot_grow
from .holding_rows import HoldingRows, undecided_parts
from .record import Discretisation, discretisations_beside, discretisations_of
from .shown_values import add_shown_values, clear, find_definitions, find_shown_values
from .structure import Spot, axis_on, continuous_sets, spots
from .sums_over_sets import check_possible_sum, find_possible_sums
from .values import families

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
        domain._fe = list(grid.mesh.boundaries)  # rules may ask for the element of a point
        expand(found, domain)
        found = list(spots(root))
        _inherit(found, discretisation)
        discretisations_beside(domain)[domain] = discretisation
        add_collocation(discretisation, found)
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
    return list(discretisations_of(continuous_sets(list(spots(root)))))


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
    for data, _ in absent.values():
        data.unfix()
    clear({key: place for key, place in absent.items() if key not in definitions and key not in sources})
    add_shown_values(discretisation)


def undo_discretisation(discretisation: Discretisation) -> None:
    """Remove everything that was added for a set before its derivatives are substituted."""
    domain = discretisation.domain
    remove_collocation(discretisation)
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
            for index in [index for index in spot.component._data if axis.time(index) not in kept]:
                del spot.component._data[index]
    for time in [time for time in domain if time not in kept]:
        domain.discard(time)
    domain._fe = sorted(kept)
    discretisations_beside(domain).pop(domain, None)


def _inherit(found: list[Spot], discretisation: Discretisation) -> None:
    old, points = set(discretisation.points), frozenset(discretisation.grid.points)
    discretisation.states = [
        state
        for variable, by_order in derivatives_along(found, discretisation.domain)
        for state in (variable, *(by_order[order] for order in by_order if order < max(by_order)))
    ]
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
    domain, scheme = discretisation.domain, discretisation.grid.scheme
    found = list(spots(domain.model()))
    write_rows(discretisation, substitute_derivatives(discretisation, found))
    family = scheme.name.split("(")[0]
    domain.set_changed(True)
    domain.get_discretization_info().update(
        scheme=DAE_NAMES.get(family, scheme.name),
        nfe=discretisation.grid.mesh.elements,
        ncp=scheme.stages,
        tau_points=scheme.state_nodes.tolist(),
    )
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
        integral._rule = None


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
        wrapped = getattr(integral._rule, "_fcn", None)
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
        if index in integral._data:
            integral._data[index].set_value(value)
        else:
            integral._setitem_when_not_present(index, value)
