"""`Trajectory`: the values of a phase over time, read by name and interpolated by the scheme's polynomial.

Files of named arrays.
"""

from __future__ import annotations

import json
import os
import shutil
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
from numpy.typing import ArrayLike

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.modeling.variable_families import FamilyNames
from pyrobocop_pyomo.numerics import Array, Grid, Indices, Mesh, Scheme
from pyrobocop_pyomo.optional_imports import pandas
from pyrobocop_pyomo.plotting import plot_signals
from pyrobocop_pyomo.presentation import Presented

# What JSON, NumPy and the archive raise for bytes that are damaged or mean something else.
_DAMAGED = (
    *(ArithmeticError, EOFError, LookupError, MemoryError, OSError, RuntimeError, SyntaxError, TypeError, ValueError),
    *(struct.error, tokenize.TokenError, zipfile.BadZipFile, zlib.error),
)


_FORMAT = 1


def write_archive(path: str | Path, facts: Mapping[str, Any], groups: Mapping[str, Mapping[str, Array]]) -> Path:
    """Write groups of named arrays, at once or not at all: whoever reads meanwhile finds the file before or this one.

    Parameters
    ----------
    path : str or Path
        The suffix ``.npz`` is added where it is missing.
    facts : mapping
        What fits into JSON.
    groups : mapping of str to (mapping of str to array)

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    OSError
        When it cannot be written, as on a full disk; the file before is as it was.
    """
    path = Path(path)
    path = path if path.suffix == ".npz" else path.with_name(path.name + ".npz")
    # Names travel in the facts: a pair's name holds characters that an archive member should not.
    header = {"format": _FORMAT, "facts": dict(facts), "names": {group: list(named) for group, named in groups.items()}}
    arrays = {f"{group}_{i}": values for group, named in groups.items() for i, values in enumerate(named.values())}
    members: dict[str, Any] = {"header": np.array(json.dumps(header)), **arrays}
    # In the same folder: a rename there is atomic. Threads and processes may write to the same path.
    temporary = path.with_name(f".{path.stem}-{uuid4().hex}.npz")
    try:
        with temporary.open("xb") as file:
            np.savez_compressed(file, **members)
            file.flush()
            os.fsync(file.fileno())
        if path.exists():
            shutil.copymode(path, temporary)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
    return path


def read_archive(path: str | Path) -> tuple[dict[str, Any], dict[str, dict[str, Array]]]:
    """Read what `write_archive` wrote: the facts and the groups.

    Raises
    ------
    TrajectoryError
        When the file is not there, is damaged or holds something else.
    """
    try:
        # Opened here, because NumPy does not close the file of a damaged archive.
        with Path(path).open("rb") as file, np.load(file, allow_pickle=False) as archive:
            header = json.loads(str(archive["header"]))
            written_in = header["format"]
            if written_in == _FORMAT:
                groups = {
                    group: {name: archive[f"{group}_{i}"] for i, name in enumerate(names)}
                    for group, names in header["names"].items()
                }
                return header["facts"], groups
    except _DAMAGED as error:
        raise TrajectoryError(
            f"{path}: no trajectory can be read from it ({type(error).__name__}: {error})."
        ) from error
    raise TrajectoryError(f"{path}: written in format {written_in}; this version reads format {_FORMAT}.")


SOLVED = "solved"
_GROUPS = ("states", "signals", "pairs", "rates", "piecewise_linear", "expressions")


@dataclass(frozen=True, eq=False)
class Trajectory(Presented):
    """The values of one phase.

    Attributes
    ----------
    name : str
        Name of the phase.
    grid : Grid
        Scheme and mesh in real time, also where the duration was a variable.
    states : dict of name to array, shape (len(time),)
        Values at every element boundary and collocation point.
    signals : dict of name to array, shape (len(points),)
        Algebraics and controls, at the collocation points.
    rates : dict of name to array, shape (len(points),)
        Derivatives of the states at the collocation points; may be empty.
    piecewise_linear : dict of name to array, shape (2, knots)
        Times and values of the controls that are linear between knots.
    piecewise_constant : frozenset of str
        Those of the signals that are constant over each element.
    parameters : dict of name to float
        Values that do not change in time.
    pairs : dict of name to array, shape (2, len(points))
        Both sides of each complementarity pair, in canonical form ``0 <= a ⟂ b >= 0``.
    expressions : dict of name to array, shape (len(time),) or (len(points),)
        Values of the phase's Expressions over its times or its points.
    families : dict of name to FamilyNames
        Vectors and matrices among all these, whose components have names of their own.
    phase : PhaseBlock or None
        Where the values came from; None after loading from a file.
    outcome : str or None
        How the solve ended that left the values: "solved", "feasible", "infeasible", "NOT SAFE" or "DOUBTFUL"; or that
        no solve did. None where nobody says, as after a simulation.

    Notes
    -----
    Values are attributes too: ``trajectory.theta``; those of a vector or a matrix have its shape, and time last. Called
    with times, the trajectory interpolates all signals.
    """

    name: str
    grid: Grid
    states: Mapping[str, Array]
    signals: Mapping[str, Array]
    parameters: Mapping[str, float]
    pairs: Mapping[str, Array]
    rates: Mapping[str, Array] = field(default_factory=dict)
    piecewise_linear: Mapping[str, Array] = field(default_factory=dict)
    piecewise_constant: frozenset[str] = frozenset()
    families: Mapping[str, FamilyNames] = field(default_factory=dict)
    expressions: Mapping[str, Array] = field(default_factory=dict)
    phase: Any = field(default=None, repr=False)
    outcome: str | None = None

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or "states" not in self.__dict__:  # a copy that is being made has no fields yet
            raise AttributeError(f"a trajectory has no '{name}'.")
        held = {**self.states, **self.signals, **self.parameters, **self.expressions}
        if name in held:
            return held[name]
        if name in self.families:
            return family_values(self.families[name], [getattr(self, member) for member in self.families[name].members])
        names = [*held, *self.families]
        near = get_close_matches(name, names, n=1)
        meant = f"Did you mean '{near[0]}'? " if near else ""
        raise AttributeError(
            f"trajectory '{self.name}' has no '{name}'. {meant}It has {', '.join(names) or 'nothing'}; and time, "
            "points and duration."
        )

    def __getitem__(self, name: str) -> Any:
        """The values by name: ``trajectory["theta"]`` is ``trajectory.theta``."""
        if not isinstance(name, str):
            raise TypeError(
                f"trajectory '{self.name}' is indexed by names, not by {name!r}: trajectory['x'] are the values at "
                "trajectory.time, trajectory(0.5)['x'] is the value at one time."
            )
        try:
            return getattr(self, name)
        except AttributeError as error:
            raise KeyError(str(error)) from None

    @cached_property
    def time(self) -> Array:
        """Times of the states, shape ``(T,)``."""
        return np.array(self.grid.times)

    @cached_property
    def points(self) -> Array:
        """Collocation points, the times of algebraics and controls, shape ``(N * s,)``."""
        return np.array(self.grid.points)

    @property
    def duration(self) -> float:
        """Length of the horizon."""
        return self.grid.mesh.boundaries[-1] - self.grid.mesh.boundaries[0]

    @property
    def names(self) -> list[str]:
        """Names of everything that changes in time."""
        return [*self.over_time, *self.over_points]

    @cached_property
    def over_time(self) -> dict[str, Array]:
        """The states, and the expressions that have values at their times."""
        return {**self.states, **{name: of for name, of in self.expressions.items() if len(of) == len(self.time)}}

    @cached_property
    def over_points(self) -> dict[str, Array]:
        """Algebraics and controls, and the other expressions."""
        return {**self.signals, **{name: of for name, of in self.expressions.items() if name not in self.over_time}}

    @property
    def title(self) -> str:
        """The name, and beside it what tells these values from an answer."""
        return self.name if self.outcome in (None, SOLVED) else f"{self.name} ({self.outcome})"

    @property
    def stepwise(self) -> set[str]:
        """Names of the signals whose polynomial has degree zero: it jumps at element ends, and is drawn as a step."""
        return (
            set(self.piecewise_constant)
            if self.grid.scheme.stages > 1
            else set(self.over_points) - set(self.piecewise_linear)
        )

    def __call__(self, t: ArrayLike) -> dict[str, Any]:
        """Values of every state, algebraic, control and expression at given times.

        At an element boundary the element that ends there is evaluated, as the equations of a stiffly
        accurate scheme are.

        Parameters
        ----------
        t : float or array, shape (m,)
            Times within the horizon.

        Returns
        -------
        dict of name to float, or to array of shape (m,)
            Asked for the name of a vector or a matrix, it makes the array of all its components.

        Raises
        ------
        TrajectoryError
            When a time is not a number within the horizon.
        """
        times = np.atleast_1d(np.asarray(t, dtype=float))
        boundaries = np.array(self.grid.mesh.boundaries)
        slack = 1e-9 * self.duration
        if times.ndim != 1:
            raise TrajectoryError(f"trajectory '{self.name}': times of shape {times.shape}; give a number or a list.")
        within = (times >= boundaries[0] - slack) & (times <= boundaries[-1] + slack)  # False for a NaN as well
        if not within.all():
            raise TrajectoryError(
                f"trajectory '{self.name}' runs from {boundaries[0]:g} to {boundaries[-1]:g}; asked was t = "
                f"{times[~within][0]:g}."
            )
        element = np.clip(np.searchsorted(boundaries, times, side="left") - 1, 0, self.grid.mesh.elements - 1)
        local = np.clip((times - boundaries[element]) / self.grid.mesh.widths[element], 0.0, 1.0)
        stage_weights = self.grid.scheme.stage_polynomial_at(local)
        values = {name: self._interpolate_state(name, element, local) for name in self.over_time}
        values |= {
            name: self._interpolate(self.element_signals(name), stage_weights, element) for name in self.over_points
        }
        values |= {name: np.interp(times, *knots) for name, knots in self.piecewise_linear.items()}
        return _Values(self.families, values if np.ndim(t) else {name: float(of[0]) for name, of in values.items()})

    def element_polynomials(self, fractions: ArrayLike) -> dict[str, Array]:
        """Every state, algebraic and control at the same local fractions of each element, by its polynomial there.

        Parameters
        ----------
        fractions : array, shape (k,)
            From 0 at the start of an element to 1 at its end.

        Returns
        -------
        dict of name to array, shape (N, k)
        """
        mesh, local = self.grid.mesh, np.asarray(fractions, dtype=float)
        element, everywhere = np.repeat(np.arange(mesh.elements), len(local)), np.tile(local, mesh.elements)
        weights, times = self.grid.scheme.stage_polynomial_at(local).T, mesh.widths[:, None] * local
        times += np.array(mesh.boundaries[:-1])[:, None]
        states = {name: self._interpolate_state(name, element, everywhere).reshape(times.shape) for name in self.states}
        signals = {name: self.element_signals(name) @ weights for name in self.signals}
        return states | signals | {name: np.interp(times, *knots) for name, knots in self.piecewise_linear.items()}

    def _interpolate_state(self, name: str, element: Indices, local: Array) -> Array:
        scheme = self.grid.scheme
        per_element = self.element_states(name)
        # The values at the nodes alone may leave the polynomial one degree short.
        if not (scheme.starts_on_a_stage and name in self.rates):
            return self._interpolate(per_element, scheme.state_at(local), element)
        increments = self._interpolate(self._per_stage(self.rates[name]), scheme.increments_at(local), element)
        return per_element[element, 0] + self.grid.mesh.widths[element] * increments

    @staticmethod
    def _interpolate(per_element: Array, weights: Array, element: Indices) -> Array:
        return np.einsum("tk,tk->t", weights, per_element[element])

    def element_states(self, name: str) -> Array:
        """A state per element at its nodes, the element start first, shape ``(N, nodes)``."""
        return self.over_time[name][self.grid.node_positions]

    def element_signals(self, name: str) -> Array:
        """An algebraic or control per element at the stages, shape ``(N, s)``."""
        return self._per_stage(self.over_points[name])

    def element_rates(self, name: str) -> Array:
        """The derivative of a state per element at the stages, shape ``(N, s)``."""
        return self._per_stage(self.rates[name])

    def _per_stage(self, values: Array) -> Array:
        return values[self.grid.stage_positions]

    def verify(self, phase: Any = None) -> Any:
        """Check these values against the equations of a phase, recomputed independently of the solver.

        Parameters
        ----------
        phase : PhaseBlock, optional
            The phase to check against; the one that the trajectory came from by default.

        Raises
        ------
        TrajectoryError
            When the trajectory knows no phase and none is given.

        Notes
        -----
        Rules that read other phases take their values from the model, as long as these values stand there too; else
        they are not checked.
        """
        verifier = self.phase if phase is None else phase
        if verifier is None:
            raise TrajectoryError(
                f"trajectory '{self.name}' was loaded from a file, or read along a ContinuousSet, and knows no "
                "equations. Hand over the PhaseBlock that states them: verify(phase=...). Equations of pyomo.dae are "
                "rows at points: compare with twice as many elements."
            )
        return verifier.verify(self)

    def plot(self, names: list[str] | Mapping[str, str] | None = None, *, figure: Any = None) -> Any:
        """Draw signals over time; returns the Matplotlib figure.

        Parameters
        ----------
        names : list of str, or mapping of name to label, optional
            What to draw, and what to write beside it; the name of a vector stands for its components. All states,
            algebraics and controls under their names by default.
        figure : Figure or SubFigure, optional
            Where to draw; by default a new figure, whose title is the name of the phase and, unless it was solved, the
            outcome.

        Raises
        ------
        TrajectoryError
            When a name is unknown, or none is given.
        """
        return drawn_parts(self, (self,), f"trajectory '{self.name}'", self.title, names, figure)

    def to_pandas(self) -> Any:
        """A data frame: one row per time, one column per state, algebraic, control and expression.

        What lives at collocation points only is evaluated by its polynomial at the other times.
        """
        return pandas.DataFrame(dict(self(self.time)), index=pandas.Index(self.time, name="time"))

    def save(self, path: str | Path) -> Path:
        """Write a ``.npz`` file of arrays and JSON (no pickle); returns the file written."""
        facts = {
            "name": self.name,
            "scheme": self.grid.scheme.name,
            "parameters": dict(self.parameters),
            "piecewise_constant": sorted(self.piecewise_constant),
            "families": [[names.name, names.axes, names.in_time] for names in self.families.values()],
            "outcome": self.outcome,
        }
        scheme = self.grid.scheme
        grid = {"boundaries": np.array(self.grid.mesh.boundaries), "c": scheme.c}
        return write_archive(path, facts, {"grid": grid, **{name: getattr(self, name) for name in _GROUPS}})

    @classmethod
    def load(cls, path: str | Path) -> Trajectory:
        """Read what `save` wrote; to verify it, a phase has to be named.

        Raises
        ------
        TrajectoryError
            When the file is not there, is damaged or holds no trajectory.
        """
        facts, groups = read_archive(path)
        try:
            return cls._from_archive(facts, groups)
        except KeyError as error:
            raise TrajectoryError(f"{path}: an archive that holds no trajectory ({error} is missing).") from error
        except (TypeError, ValueError, AttributeError, IndexError) as error:
            raise TrajectoryError(f"{path}: an archive that holds no trajectory ({error}).") from error

    @classmethod
    def _from_archive(cls, facts: dict[str, Any], groups: dict[str, dict[str, Array]]) -> Trajectory:
        grid = groups.pop("grid")
        scheme = Scheme(facts["scheme"], grid["c"])
        read = cls(
            name=facts["name"],
            grid=Grid(scheme, Mesh(tuple(grid["boundaries"].tolist()))),
            parameters={str(name): float(number) for name, number in facts["parameters"].items()},
            piecewise_constant=frozenset(facts["piecewise_constant"]),
            families={names.name: names for names in map(_names_read, facts.get("families", ()))},
            outcome=facts.get("outcome"),
            **groups,
        )
        states, points = len(read.grid.times), len(read.grid.points)
        expected: dict[str, list[tuple[int, ...]]] = {
            "states": [(states,)], "signals": [(points,)], "rates": [(points,)], "pairs": [(2, points)],
            "expressions": [(states,), (points,)],
        }  # fmt: skip
        for group, shapes in expected.items():
            for name, values in getattr(read, group).items():
                if values.shape not in shapes or values.dtype.kind not in "fiu":
                    raise TrajectoryError(f"'{name}' has shape {values.shape}, and its grid asks for {shapes[0]}")
        for name, knots in read.piecewise_linear.items():
            if knots.ndim != 2 or knots.shape[0] != 2 or knots.dtype.kind != "f":
                raise TrajectoryError(f"'{name}' has knots of shape {knots.shape} in place of (2, knots)")
        return read

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self.names, *self.parameters, *self.families})

    def _summary(self) -> str:
        start, end = self.grid.mesh.boundaries[0], self.grid.mesh.boundaries[-1]
        counts = {"state": len(self.states), "signal": len(self.signals), "element": self.grid.mesh.elements}
        of = [f"{count} {what}{'s' * (count != 1)}" for what, count in counts.items()]
        outcome = "" if self.outcome is None else f", {self.outcome}"
        return f"'{self.name}'{outcome}, t = {start:g} .. {end:g}: {', '.join(of)}: {', '.join(self.names)}"


class _Values(dict[str, Any]):
    """Values by name; the values of a vector or matrix are stacked from its members' when they are first requested."""

    def __init__(self, families: Mapping[str, FamilyNames], values: Mapping[str, Any]) -> None:
        super().__init__(values)
        self._families = families

    def __missing__(self, name: str) -> Any:
        if name not in self._families:
            raise KeyError(name)
        return family_values(self._families[name], [self[member] for member in self._families[name].members])


def members_of(families: Mapping[str, FamilyNames], name: str) -> list[str]:
    """Names of the components of a vector or a matrix; of anything else its own name."""
    return families[name].members if name in families else [name]


def member_labels(families: Mapping[str, FamilyNames], labels: Mapping[str, str]) -> dict[str, str]:
    """What to write beside each component, given what to write beside all of them."""
    found: dict[str, str] = {}
    for name, label in labels.items():
        of = families[name].labels if name in families else [""]
        members = members_of(families, name)
        found |= {member: f"{label} {one}".rstrip() for member, one in zip(members, of, strict=True)}
    return found


def family_values(names: FamilyNames, of_members: Sequence[Any]) -> Array:
    """The values of all components as one array, of the family's shape and that of a component's values."""
    values = np.array(of_members, dtype=float)
    return values.reshape((*names.shape, *values.shape[1:]))


def _names_read(stored: Sequence[Any]) -> FamilyNames:
    name, axes, in_time = stored
    labels = tuple(tuple(tuple(label) if isinstance(label, list) else label for label in axis) for axis in axes)
    return FamilyNames(name, labels, in_time)


def drawn_parts(
    read: Any,
    parts: Sequence[Trajectory],
    called: str,
    title: str,
    names: list[str] | Mapping[str, str] | None,
    figure: Any,
) -> Any:
    """The picture of a trajectory, or of a joined one, whose parts are several."""
    declared = {name for part in parts for name in (*part.states, *part.signals)}
    wanted = [name for name in read.names if name in declared] if names is None else names
    chosen = [member for name in wanted for member in members_of(read.families, name)]
    unknown = [name for name in chosen if name not in read.names]
    if unknown or not chosen:
        missing = f"has no '{unknown[0]}'" if unknown else "was given no name of what to draw"
        raise TrajectoryError(f"{called} {missing}; it has {', '.join(read.names)}.")
    pieces = [np.unique([*part.time, *np.linspace(part.time[0], part.time[-1], 400)]) for part in parts]
    values = [(part(piece), nothing_known(piece)) for part, piece in zip(parts, pieces, strict=True)]
    over_time = {name: (read.time, of) for name, of in read.over_time.items()}
    nodes = {**over_time, **{name: (read.points, of) for name, of in read.over_points.items()}}
    return plot_signals(
        title if figure is None else "",
        _apart(pieces),
        {name: _apart([of.get(name, nothing) for of, nothing in values]) for name in chosen},
        nodes,
        {name for name in chosen if all(name not in part.names or name in part.stepwise for part in parts)},
        labels=member_labels(read.families, names) if isinstance(names, Mapping) else None,
        figure=figure,
    )


def nothing_known(times: Array) -> Array:
    """A NaN at each time."""
    return np.full(times.shape, np.nan)


def _apart(pieces: list[Array]) -> Array:
    """Pieces one after the other; a NaN between two breaks the line: what jumps is not drawn as a slope."""
    return np.concatenate([pieces[0], *(part for piece in pieces[1:] for part in ([np.nan], piece))])
