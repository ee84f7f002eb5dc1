"""Derivatives along several sets together, such as ``d2u/dx dt``: taken along one set at a time.

The derivative along the sets so far is a variable of its own, whose derivative along the next set is taken: ``u``,
``du/dx``, ``d2u/dxdt``, in the order in which the sets were discretised; for polynomials on a grid the order does not
matter. A variable that the model declares for what is in between is used; otherwise one is added. Sets that pyomo.dae
has discretised come first, through the expression that it keeps; for a set that pyomo.dae may discretise later, that
expression is replaced by the variable in between.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any

from pyomo.common.modeling import unique_component_name
from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.var import Var
from pyomo.dae import DerivativeVar

from pyrobocop_pyomo.errors import TranscriptionError

from .record import Discretisation, MixedStep, discretisation_of, discretisation_record_of, open_sets
from .structure import Spot, continuous_sets


class ValuesOf:
    """What pyomo.dae keeps as the expression of a derivative: the value of a variable at an index.

    Parameters
    ----------
    variable : Var
    """

    def __init__(self, variable: Any) -> None:
        self._variable = variable

    def __call__(self, *index: Any) -> Any:
        """The variable at an index."""
        return self._variable[index if len(index) > 1 else index[0]]


def mixed_derivatives(spots: Iterable[Spot]) -> list[Any]:
    """Every derivative along more than one set."""
    return [
        spot.component
        for spot in spots
        if isinstance(spot.component, DerivativeVar)
        if len({id(along) for along in spot.component.get_continuousset_list()}) > 1
    ]


def add_mixed_steps(discretisations: list[Discretisation], spots: list[Spot]) -> None:
    """Find the steps of all mixed derivatives along the discretised sets, and add what is in between.

    Parameters
    ----------
    discretisations : list of Discretisation
        All of the model; `Discretisation.mixed` is written.
    spots : list of Spot

    Raises
    ------
    TranscriptionError
        When the sets were discretised in an order that leaves something undetermined.
    """
    before = {(id(one), id(step.derivative)): step.rate for one in discretisations for step in one.mixed}
    for discretisation in discretisations:
        discretisation.mixed = []
    open_ids = open_sets(continuous_sets(spots))
    partial: dict[tuple[int, frozenset[tuple[int, int]]], Any] = {
        _key(spot.component.get_state_var(), spot.component.get_continuousset_list()): spot.component
        for spot in spots
        if isinstance(spot.component, DerivativeVar)
    }
    for derivative in mixed_derivatives(spots):
        along, variable = derivative.get_continuousset_list(), derivative.get_state_var()
        own = [one for one in _as_applied(discretisations) if any(one.domain is domain for domain in along)]
        if not own:
            continue
        _check_order(derivative, own)
        theirs = [d for d in along if id(d) not in open_ids and not any(one.domain is d for one in own)]
        is_last_open = any(id(domain) in open_ids for domain in along)
        done = list(theirs)
        base = variable
        if theirs:
            base = partial.get(_key(variable, done))
            if base is None:
                base = partial[_key(variable, done)] = _differences(own[0], derivative)
        for i, one in enumerate(own):
            done += [domain for domain in along if domain is one.domain]
            target = partial.get(_key(variable, done))
            if target is None:
                target = partial[_key(variable, done)] = _in_between(own[0], derivative)
            order = sum(domain is one.domain for domain in along)
            one.mixed.append(MixedStep(variable, base, order, target, derivative))
            known = before.get((id(one), id(derivative)))
            if known is not None and known in one.ends:
                one.ends[target] = one.ends.pop(known)
            base = target
            if i == len(own) - 1 and is_last_open:
                own[0].expressions.append((derivative, derivative.get_derivative_expression()))
                derivative.set_derivative_expression(ValuesOf(base))


def by_mixed_order(domains: list[Any], spots: Iterable[Spot]) -> list[Any]:
    """Continuous sets in the order in which to discretise them: with second derivatives in a mixed one last."""
    mixed = [derivative.get_continuousset_list() for derivative in mixed_derivatives(spots)]

    def order(domain: Any) -> int:
        return max((sum(one is domain for one in along) for along in mixed), default=0)

    return sorted(domains, key=order)


def refuse_another_mesh(discretisation: Discretisation) -> None:
    """Raise a `TranscriptionError` where rows along another set were written for the mesh of this one."""
    for step in discretisation.mixed:
        domain = discretisation.domain
        other = next(
            (
                d
                for d in step.derivative.get_continuousset_list()
                if d is not domain and discretisation_of(d) is not None
            ),
            None,
        )
        if other is not None:
            raise TranscriptionError(
                f"'{step.derivative.name}': is a derivative along '{domain.name}' and '{other.name}' together, which "
                "have their meshes already. Start from the model before: create_using returns a discretised copy and "
                "leaves the model alone."
            )


def _check_order(derivative: Any, own: list[Discretisation]) -> None:
    along = derivative.get_continuousset_list()
    for one in own[:-1]:
        if sum(domain is one.domain for domain in along) > 1:
            raise TranscriptionError(
                f"'{derivative.name}': is taken more than once along '{one.domain.name}', which was discretised before "
                f"'{own[-1].domain.name}'. Discretise '{one.domain.name}' last, or pass both sets in one call, "
                "wrt=[...]; of sets along which a derivative is taken more than once, leave all but one to "
                "dae.finite_difference."
            )


def remove_mixed_steps(discretisation: Discretisation) -> None:
    """Give derivatives back the expressions that pyomo.dae has kept for them."""
    for derivative, expression in discretisation.expressions:
        derivative.set_derivative_expression(expression)
    discretisation.expressions.clear()


def _as_applied(discretisations: Iterable[Discretisation]) -> list[Discretisation]:
    """In the order in which the sets were discretised."""

    return sorted(discretisations, key=lambda one: discretisation_record_of(one.domain).order[one.domain])


def _key(variable: Any, along: Iterable[Any]) -> tuple[int, frozenset[tuple[int, int]]]:
    return id(variable), frozenset(Counter(map(id, along)).items())


def _generated_block(discretisation: Discretisation, derivative: Any) -> Any:
    home, parent = Block(concrete=True), derivative.parent_block()
    parent.add_component(unique_component_name(parent, f"{derivative.local_name}_steps"), home)
    discretisation.generated.append(home)
    return home


def _in_between(discretisation: Discretisation, derivative: Any) -> Any:
    home = _generated_block(discretisation, derivative)
    home.rate = Var(derivative.index_set())
    return home.rate


def _differences(discretisation: Discretisation, derivative: Any) -> Any:
    """A variable for what pyomo.dae has made of a derivative so far, with the rows that say so."""
    home = _generated_block(discretisation, derivative)
    home.rate, home.differences = Var(derivative.index_set()), Constraint(derivative.index_set())
    expression = derivative.get_derivative_expression()
    for index in derivative.index_set():
        try:
            side = expression(*(index if isinstance(index, tuple) else (index,)))
        except IndexError:
            continue  # as pyomo.dae does where its differences reach beyond the set
        home.differences.add(index, home.rate[index] == side)
    return home.rate
