"""`ElementInstants`: what a trajectory is at some places of its elements, and what rules say of it there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.polynomials import differentiation_matrix
from pyrobocop_pyomo.trajectories import Trajectory

from .declarations import in_infinities
from .delays import past_of
from .record import Statement
from .rule_formulas import RuleFormulas


class ElementInstants:
    """All elements at some local fractions; arrays have the shape ``(q, N)``.

    Parameters
    ----------
    formulas : RuleFormulas
        Of the rules that `evaluated` evaluates.
    trajectory : Trajectory
    fractions : array, shape (q,)

    Attributes
    ----------
    index, clock : array
        Time indices and times.
    values : dict of name to array or number
        States, algebraics, controls and parameters.
    slopes : dict of state name to array
    """

    def __init__(self, formulas: RuleFormulas, trajectory: Trajectory, fractions: Array) -> None:
        scheme, widths = trajectory.grid.scheme, np.array(trajectory.grid.mesh.widths)
        self._formulas, self.fractions = formulas, fractions
        self.at_stages = scheme.stage_polynomial_at(fractions)
        self.clock, self.index = (
            np.array(mesh.boundaries[:-1]) + fractions[:, None] * np.array(mesh.widths)
            for mesh in (trajectory.grid.mesh, formulas.indices.mesh)
        )
        states = {name: trajectory.element_states(name).T for name in trajectory.states}
        slopes = differentiation_matrix(scheme.state_nodes, fractions)
        self.values: dict[str, Any] = {name: of.T for name, of in trajectory.element_polynomials(fractions).items()}
        self.values |= trajectory.parameters
        self.slopes = {name: slopes @ of / widths for name, of in states.items()}
        # Where a stage is at the start, the values of a state do not determine its polynomial.
        for name in trajectory.rates if scheme.starts_on_a_stage else ():
            self.slopes[name] = self.at_stages @ trajectory.element_rates(name).T
        self._past, self._widths = past_of(trajectory), widths
        self._starts = {name: np.zeros(self.index.shape) + of[0] for name, of in states.items()}

    def _leaves(self, values: Mapping[str, Any]) -> dict[int, Any]:
        formulas, given = self._formulas, (self._past, self.clock, self._widths, self.fractions[:, None])
        leaves = formulas.leaves(values, self.index, self.clock, self.slopes, self._starts)
        leaves |= formulas.of_coupled_phases(self.fractions)
        return leaves | formulas.delayed_numbers(formulas.delays, *given)

    def evaluated(self, expressions: Sequence[Any], values: Mapping[str, Any]) -> list[Array]:
        """Formulas with these values, each of shape ``(q, N)``."""
        found = self._formulas.values(expressions, self._leaves(values))
        return [np.zeros(self.index.shape) + of for of in found]

    def values_stated(self, expressions: Sequence[Any], statement: Statement) -> list[Array]:
        """The values of formulas of a statement.

        Raises
        ------
        TrajectoryError
            When it has none somewhere: naming the part without value, the rule, the time and the element.
        """
        with np.errstate(all="ignore"):
            found = self.evaluated(expressions, self.values)
        for expression, values in zip(expressions, found, strict=True):
            # Of numbers some are infinite: bounds that are none.
            undefined = [] if expression.__class__ is float else np.argwhere(~np.isfinite(values.T)).tolist()
            if not undefined:
                continue
            i, k = undefined[0]
            leaves = self._leaves(self.values)
            here = {key: float(of if np.ndim(of) == 0 else of[k, i]) for key, of in leaves.items()}
            what = self._formulas.undefined_part(expression, here) or "it has no value"
            raise TrajectoryError(
                f"phase '{self._formulas.block.name}': {what}, in the {statement.kind} '{statement.name}' at time "
                f"{self.clock[k, i]:g} (element {i}). The trajectory leaves the values for which it is defined; bound "
                "what it reads, or solve the model first."
            )
        return found

    def bounds(self, name: str) -> tuple[float, float]:
        """Declared bounds, infinite where there are none."""
        return in_infinities(self._formulas.record.declarations[name].bounds_at(0.0, name))
