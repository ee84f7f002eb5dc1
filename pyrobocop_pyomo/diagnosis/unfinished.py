"""Components that a transformation has to make rows of first: without it no solver sees what they say."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pyomo.core.base.block import Block
from pyomo.dae import DerivativeVar, Integral
from pyomo.gdp import Disjunct, Disjunction

from pyrobocop_pyomo.modeling.activity import BLOCK_TYPES

from .findings import Finding, Subject, error_about, quoted


def unfinished_findings(block: Any) -> Iterator[Finding]:
    """Derivatives and integrals along sets that were not discretised, and disjunctions that were not transformed.

    What is transformed has another type, or is not active any more.
    """
    along: dict[str, list[str]] = {}
    for component in block.component_objects((DerivativeVar, Integral), active=True, descend_into=BLOCK_TYPES):
        is_derivative = component.ctype is DerivativeVar
        for domain in component.get_continuousset_list() if is_derivative else [component.get_continuousset()]:
            if "scheme" not in domain.get_discretization_info():
                along.setdefault(domain.name, []).append(component.name)
    for name, components in along.items():
        yield _error(
            f"the ContinuousSet '{name}' was not discretised: nothing ties {quoted(components)} to values along it.",
            components,
            f"Call pyo.TransformationFactory('pyrobocop.collocation').apply_to(m, wrt=m.{name}, nfe=20), or Pyomo's "
            "'dae.collocation', before the solve.",
        )
    choices = [*block.component_data_objects((Disjunction, Disjunct), active=True, descend_into=Block)]
    if choices:
        names = list(dict.fromkeys(data.parent_component().name for data in choices))
        yield _error(
            f"{quoted(names)} {'is a choice' if len(names) == 1 else 'are choices'} of pyomo.gdp, which no interior "
            "method sees.",
            names,
            "Apply 'gdp.bigm' or 'gdp.hull' and use a mixed-integer solver, or SolverFactory('gdpopt'); or state the "
            "choice as a pair, which rcp.solve takes.",
        )


def _error(message: str, components: list[str], remedy: str) -> Finding:
    return error_about(Subject.STATEMENT, message, tuple(components), remedy)
