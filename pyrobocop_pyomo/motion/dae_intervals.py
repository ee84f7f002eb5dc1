"""Continuous sets that `pyomo.dae` itself has discretised."""

from __future__ import annotations

import itertools
from typing import Any

from pyomo.core.base.var import Var
from pyomo.dae import DerivativeVar

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.modeling.rule_proxies import Series

from .interpolation import NodalInterpolation
from .sources import STATES_ONLY, parent_of


def dae_interpolation(domain: Any) -> NodalInterpolation:
    """Intervals and polynomials of a continuous set.

    With collocation, variables that have a derivative follow the polynomial through the start of the element and its
    collocation points; with finite differences they change linearly from point to point.

    Raises
    ------
    ObstacleError
        When the set is not discretised.
    """
    facts = domain.get_discretization_info()
    if "scheme" not in facts:
        raise ObstacleError(
            f"'{domain.name}': a continuous set that is not discretised. Apply pyrobocop.collocation, or a "
            "transformation of pyomo.dae, before obstacles are added."
        )
    points = tuple(domain)

    def check(series: Series) -> None:
        component = parent_of(series.at(points[0]))
        # Asked when it is needed: derivatives may be declared later. To pyomo.dae those that it has discretised are
        # plain variables.
        if component is None or not any(
            each.get_state_var() is component
            for each in domain.model().component_objects((Var, DerivativeVar), descend_into=True)
            if isinstance(each, DerivativeVar) and any(along is domain for along in each.get_continuousset_list())
        ):
            raise ObstacleError(f"'{series.name}' has no derivative along '{domain.name}'. {STATES_ONLY}")

    if "tau_points" not in facts:
        intervals = tuple(itertools.pairwise(points))
        return NodalInterpolation(intervals, intervals, check)
    boundaries = domain.get_finite_elements()
    intervals = tuple(
        tuple(point for point in points if start <= point <= end) for start, end in itertools.pairwise(boundaries)
    )
    nodes = len(facts["tau_points"])
    return NodalInterpolation(intervals, tuple(each[:nodes] for each in intervals), check)
