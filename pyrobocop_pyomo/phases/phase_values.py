"""All values of a phase as arrays, and back: read, sampled from a trajectory, set, made a trajectory."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from operator import attrgetter
from typing import Any

import numpy as np
from pyomo.core.base.expression import Expression
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.complementarity import Complementarity, canonical_form, side_values
from pyrobocop_pyomo.errors import PyRobocopError, TrajectoryError
from pyrobocop_pyomo.modeling.row_violations import number_or_nan
from pyrobocop_pyomo.modeling.variable_values import checksum, put_values
from pyrobocop_pyomo.numerics import Array, Grid
from pyrobocop_pyomo.trajectories import Trajectory

from .declarations import Control, Parameter
from .horizon import real_grid
from .nodes import IntervalNodes, KnotNodes, Nodes
from .record import PhaseRecord

_VALUE = attrgetter("value")


class PhaseValues:
    """The values of states, algebraics, controls and kept derivatives, each an array over its own nodes.

    Parameters
    ----------
    phase : PhaseBlock

    Raises
    ------
    TrajectoryError
        When Pyomo's ``core.scale_model`` was applied to the model.

    Attributes
    ----------
    nodes : dict of name to Nodes
        Where the values of each name live. A kept derivative has the name ``<state>_derivative``.
    variables : dict of name to list of VarData
        What holds them.
    """

    def __init__(self, phase: Any) -> None:
        record: PhaseRecord = phase.record
        if hasattr(phase.model(), "component_scaling_factor_map"):
            raise TrajectoryError(
                f"phase '{phase.name}': core.scale_model has changed the units of its values, and its rules are stated "
                "in the former ones. Carry the solution to the model that it was made from: "
                "pyo.TransformationFactory('core.scale_model').propagate_solution(scaled, model)."
            )
        self._phase, self._record, self._grid = phase, record, record.grid
        derivatives = [f"{name}_derivative" for name in sorted(record.kept_derivatives)]
        names = [*record.names_of_states, *record.names_of_signals, *derivatives]
        self.nodes: dict[str, Nodes] = {name: record.nodes(name) for name in names}
        self.variables = {name: nodes.variables(phase) for name, nodes in self.nodes.items()}

    def read(self) -> dict[str, Array]:
        """The values now, by name.

        Raises
        ------
        TrajectoryError
            When a variable has no value.
        """
        return {name: read_values(variables) for name, variables in self.variables.items()}

    def set(self, values: Mapping[str, Array]) -> None:
        """Set values by name; what is fixed stays, and what is not named."""
        for name, numbers in values.items():
            variables, found = self.variables[name], numbers.tolist()
            if len(variables) != len(found):
                raise ValueError(f"'{name}' has {len(variables)} values; given are {len(found)}.")
            free = [i for i, variable in enumerate(variables) if not variable.fixed]
            put_values([variables[i] for i in free], [found[i] for i in free])

    def sampled(self, trajectory: Trajectory, place: Callable[[float], float]) -> dict[str, Array]:
        """The values that a trajectory means for the names that it has.

        Its own polynomials are evaluated. At an element boundary it answers for the element that ends there, except
        where the nodes ask for the one that begins.

        Parameters
        ----------
        trajectory : Trajectory
        place : callable
            From the time indices of the phase to the times of the trajectory.
        """
        # Between schemes, rates of the polynomial through the new nodes would be less exact than the trajectory's own.
        rates = replace(trajectory, states={}, signals=trajectory.rates, piecewise_linear={}, expressions={})
        results: dict[Any, dict[str, Array]] = {}
        found = {}
        for name, nodes in self.nodes.items():
            derivative = name not in self._record.declarations
            source, known = (rates, name.removesuffix("_derivative")) if derivative else (trajectory, name)
            if known in source.names:
                key = (derivative, type(nodes), nodes.sample_times)
                if key not in results:
                    results[key] = source(sample_times(trajectory.grid, nodes, place))
                found[name] = nodes.from_samples(results[key][known])
        return found

    def trajectory(self, values: Mapping[str, Array] | None = None, *, evaluate: bool = True) -> Trajectory:
        """Values as a trajectory in real time; those that the phase has now by default.

        Parameters
        ----------
        values : mapping of name to array, optional
        evaluate : bool
            Also evaluate what is an expression: sides of pairs, derivatives, and the user's Expressions over time.

        Raises
        ------
        TrajectoryError
            When a variable has no value.
        """
        phase, record, outcome, grid = self._phase, self._record, None, real_grid(self._phase)
        if values is None:
            values = self.read()
            outcome = self._outcome_of(values)
        kept = {name: values[f"{name}_derivative"] for name in record.kept_derivatives}
        controls = {name: self.nodes[name] for name in record.names(Control)}
        return Trajectory(
            name=phase.name,
            grid=grid,
            states={name: values[name] for name in record.names_of_states},
            signals={name: self.nodes[name].at_points(values[name]) for name in record.names_of_signals},
            parameters={name: float(value(phase.component(name))) for name in record.names(Parameter)},
            pairs=pairs_of_phase(phase) if evaluate else {},
            rates=self._rates() if evaluate else kept,
            piecewise_linear={
                name: np.array([np.interp(of.times, self._grid.mesh.boundaries, grid.mesh.boundaries), values[name]])
                for name, of in controls.items()
                if isinstance(of, KnotNodes)
            },
            piecewise_constant=frozenset(name for name, of in controls.items() if isinstance(of, IntervalNodes)),
            families=record.families,
            expressions=expression_values(phase) if evaluate else {},
            phase=phase,
            outcome=outcome,
        )

    def _rates(self) -> dict[str, Array]:
        """Derivatives of the states at the points, where they have any."""
        phase, record = self._phase, self._record
        known = (record.rates.keys() | record.kept_derivatives) - record.discrete_states
        rates = {name: phase.derivative(name) for name in record.names_of_states if name in known}
        return {name: np.array([number_or_nan(of[t]) for t in self._grid.points]) for name, of in rates.items()}

    def _outcome_of(self, values: Mapping[str, Array]) -> str:
        """How the solve ended that has left these values; otherwise that none has."""
        if self._record.outcome is None:
            return "not solved by rcp.solve"
        words, fingerprint = self._record.outcome
        return words if fingerprint == self._fingerprint(values) else "changed since rcp.solve"

    def _fingerprint(self, values: Mapping[str, Array]) -> int:
        phase, record = self._phase, self._record
        parameters = [float(value(phase.component(name))) for name in record.names(Parameter)]
        return checksum(np.concatenate([*values.values(), parameters, real_grid(phase).mesh.boundaries]).tolist())

    def note_outcome(self, words: str) -> None:
        """Keep how the solve ended that has left the values."""
        self._record.outcome = (words, self._fingerprint(self.read()))


def expression_values(phase: Any) -> dict[str, Array]:
    """The Expressions of a phase over its times or points now, without controls that are such; NaN where undefined."""
    return {
        component.local_name: np.array([number_or_nan(component[t]) if t in component else np.nan for t in times])
        for component in phase.component_objects(Expression, descend_into=False)
        for times in (phase.time, phase.points)
        if component.index_set() is times and component.local_name not in phase.record.declarations
    }


def read_values(
    variables: list[Any],
    error: type[PyRobocopError] = TrajectoryError,
    what_is_wrong: str = "has no value. Solve the model first, or give it an initial guess.",
) -> Array:
    """The values of variables.

    Raises
    ------
    PyRobocopError
        Of the class given, when a variable has no value.
    """
    values = list(map(_VALUE, variables))
    if None in values:
        raise error(f"'{variables[values.index(None)].name}' {what_is_wrong}")
    return np.array(values, dtype=float)


def sample_times(grid: Grid, nodes: Nodes, place: Callable[[float], float]) -> Array:
    """Where on a grid to ask for the samples that nodes want; see `PhaseValues.sampled`."""
    boundaries = np.array(grid.mesh.boundaries)
    times = np.clip([place(t) for t in nodes.sample_times], boundaries[0], boundaries[-1])
    # A control may jump at an element end, and rounding must not carry a time to the other side of it.
    nearest = boundaries[np.abs(times[:, None] - boundaries[None, :]).argmin(axis=1)]
    times = np.where(np.abs(times - nearest) < 1e-12 * (1 + np.abs(boundaries).max()), nearest, times)
    return times if nodes.begins is None else np.where(nodes.begins, np.nextafter(times, boundaries[-1]), times)


def pairs_of_phase(phase: Any) -> dict[str, Array]:
    """Both sides of every pair over the points, by the name under which the user stated it; a range has two."""
    series: dict[str, Array] = {}
    position = {time: i for i, time in enumerate(phase.record.grid.points)}
    for component in phase.component_objects(Complementarity, descend_into=False):
        for index, data in component.items():
            time, *labels = index if isinstance(index, tuple) else (index,)
            if time not in position:
                continue
            name = component.local_name + "".join(f"[{label}]" for label in labels)
            for pair in canonical_form(data).pairs:
                label = f"{name} ({pair.role})" if pair.role else name
                sides = series.setdefault(label, np.full((2, len(position)), np.nan))
                sides[:, position[time]] = side_values(pair, np.nan)
    return series
