"""`TablePath`: the pose rule of a body that moves along a table of times and positions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import native_numeric_types

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Pose, planar_pose, spatial_pose
from pyrobocop_pyomo.numerics.arrays import Array, finite_numbers, increasing_numbers
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE

from .table_functions import TableFunction


class TablePath:
    """A pose rule along a table: at each of the times the body is at a given place.

    It is the ``pose`` of a `Body`: ``Body(shape, pose=TablePath(times, x, y, theta))``. Between the rows it is followed
    exactly, also where they fall inside of the intervals of the plan, and where the duration of the plan is free.

    Parameters
    ----------
    times : sequence of float, shape (k,)
        Increasing.
    x, y : float or sequence of float, shape (k,)
    theta : float or sequence of float, shape (k,)
        Heading (yaw) in radians. From row to row it turns the shorter way: 3.1 is followed by -3.1 without a turn.
    z : float or sequence of float, optional
        Makes the pose one in space.
    roll, pitch : float or sequence of float
        In space, as ``euler`` of `spatial_pose`.
    kind : str
        ``"linear"`` from row to row, or ``"cubic"``: the natural spline.
    hold_ends : bool
        Whether the body rests where the table begins before the first time, and where it ends after the last one.
        Otherwise plans must not reach beyond.
    clock : callable, optional
        ``clock(block, t)`` returns the time of the table. By default ``block.time_at(t)`` where the rule is that of
        a phase, else ``t`` itself. A table that started 3.5 before the plan: ``lambda b, t: b.time_at(t) + 3.5``.

    Raises
    ------
    ObstacleError
        When columns do not fit the times, or times do not increase.

    Examples
    --------
    >>> import pyrobocop_pyomo as rcp
    >>> path = rcp.TablePath([0.0, 1.0, 3.0], x=[0.0, 2.0, 2.0], y=[0.0, 0.0, 4.0])
    >>> truck = rcp.Body(rcp.Polytope.box(2, 1), pose=path)
    >>> path(None, 2.0).translation
    (2.0, 2.0)
    """

    def __init__(
        self,
        times: Sequence[float],
        x: Any,
        y: Any,
        theta: Any = 0.0,
        *,
        z: Any = None,
        roll: Any = 0.0,
        pitch: Any = 0.0,
        kind: str = "linear",
        hold_ends: bool = False,
        clock: Callable[[Any, Any], Any] | None = None,
    ) -> None:
        if kind not in ("linear", "cubic"):
            raise ObstacleError(f'TablePath: kind is {kind!r}; it is "linear" or "cubic".')
        self.times = increasing_numbers(times, "TablePath: times", ObstacleError)
        self.kind, self.hold_ends, self.clock = kind, bool(hold_ends), clock
        given = {"x": x, "y": y, "theta": theta}
        if z is not None:
            given |= {"z": z, "roll": roll, "pitch": pitch}
        self.columns = {name: self._column(name, column) for name, column in given.items()}
        # What is the same in all rows is a number only where the body is known to rest beyond them.
        moving = [name for name, column in self.columns.items() if np.ptp(column) > 0.0 or not self.hold_ends]
        self._moving = tuple(moving)
        self._table = TableFunction(
            "table path",
            self.times,
            np.stack([self.columns[name] for name in moving], axis=1) if moving else np.zeros((len(self.times), 1)),
            moving or ["rest"],
            kind=kind,
            holds=self.hold_ends,
        )

    def _column(self, name: str, given: Any) -> Array:
        column = finite_numbers(given, f"TablePath: {name}", ObstacleError)
        if column.ndim == 0:
            column = np.full(len(self.times), float(column))
        if column.shape != self.times.shape:
            raise ObstacleError(
                f"TablePath: {name} has the shape {column.shape}; expected one number for each of the "
                f"{len(self.times)} times, or one for all."
            )
        return np.unwrap(column) if name in ("theta", "roll", "pitch") else column

    def __deepcopy__(self, memo: dict[int, Any]) -> TablePath:
        return self  # immutable: cloned models share it

    def __repr__(self) -> str:
        return f"TablePath({len(self.times)} rows from {self.times[0]:g} to {self.times[-1]:g}, {self.kind})"

    skips_points = True  # it is called at each point, since beyond its ends a table says nothing

    def __call__(self, block: Any, t: Any) -> Pose:
        """The pose at an index."""
        time = self._time(block, t)
        if time.__class__ in native_numeric_types or isinstance(time, np.number):
            time = self._inside(float(time))
        at = {name: float(column[0]) for name, column in self.columns.items()}
        at |= dict(zip(self._moving, self._table(time), strict=False))
        if "z" not in at:
            return planar_pose(at["x"], at["y"], at["theta"])
        return spatial_pose((at["x"], at["y"], at["z"]), euler=(at["roll"], at["pitch"], at["theta"]))

    def _time(self, block: Any, t: Any) -> Any:
        if self.clock is not None:
            return self.clock(block, t)
        of_phase = getattr(block, "has_normalised_time", None) is not None
        return block.time_at(t) if of_phase else t

    def _inside(self, time: float) -> float:
        start, end = float(self.times[0]), float(self.times[-1])
        nearly = NEGLIGIBLE * (end - start)
        if not self.hold_ends and not start - nearly <= time <= end + nearly:
            raise ObstacleError(
                f"{self!r} says nothing about time {time:g}. Extend the table, or let the body rest at its ends by "
                "hold_ends=True."
            )
        return min(max(time, start), end)
