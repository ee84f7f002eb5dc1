"""Bodies among obstacles: snapshots over time, and animations with their files, in the plane and in space.

Outlines of convex shapes in the plane and their faces in space; padded, and cut off where they are unbounded.
"""

from __future__ import annotations

import shutil
import tempfile
import weakref
from base64 import b64encode
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.geometry.polyhedra import EmptyInterior, affine_basis, affine_rank, convex_hull, corners_of
from pyrobocop_pyomo.geometry.polytope import on_unit_ball
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.optional_imports import animation, art3d, matplotlib

from .figures import evenly_moved, figure_or_new, time_colours

# ------------------------------------------------------------------------------------------------------------- outlines


def outline(shape: Any, view: Array | None = None) -> Array:
    """Corners of a shape in the plane, counter-clockwise.

    Parameters
    ----------
    shape : Polytope
        Of dimension two; read are its corners, with their ellipsoids, its rays and its radius.
    view : array, shape (2, 2), optional
        Lower and upper corner of what is seen; the outline of a shape with rays ends a little outside of it, those of
        others are left whole.

    Returns
    -------
    array, shape (k, 2)
        Three corners or more; two for a segment and one for a point without padding; none for what lies wholly
        outside the view.
    """
    points = _within(shape, view)
    return convex_outline(points) if len(points) else points


def faces(shape: Any, view: Array | None = None) -> list[Array]:
    """Polygons that bound a shape in space.

    Parameters
    ----------
    shape : Polytope
        Of dimension three.
    view : array, shape (2, 3), optional
        Lower and upper corner of what is seen; what is outside is cut off, since axes in space hide nothing.

    Returns
    -------
    list of arrays, shape (k, 3)
        Corners of each face in order. A flat shape has one face, a segment one of two corners, a point one of one.
    """
    points = _within(shape, view)
    return convex_faces(points) if len(points) else []


def _within(shape: Any, view: Array | None) -> Array:
    """Points whose hull is what is seen of a shape; in the plane a bounded one is left whole, and flat ones are."""
    points = padded(np.asarray(shape.images(_unit_ball(shape.dimension)), dtype=float), float(shape.radius))
    frame = _frame(view, points) if view is None or shape.dimension == 2 else np.asarray(view, dtype=float)
    if shape.is_bounded:
        is_inside = np.all(frame[0] <= points.min(axis=0)) and np.all(points.max(axis=0) <= frame[1])
        if shape.dimension == 2 or view is None or is_inside or affine_rank(points, shape.rays) < 3:
            return points
        _, normals, offsets = convex_hull(points)
    else:
        normals, offsets = shape.halfspaces[0], shape.halfspaces[1] + shape.radius
    sides = np.eye(shape.dimension)
    try:
        return corners_of(np.vstack([normals, sides, -sides]), np.concatenate([offsets, frame[1], -frame[0]]))[0]
    except EmptyInterior:  # it is out of sight
        return points[:0]


def convex_outline(points: Array) -> Array:
    """Corners of the convex hull of points that lie in one plane, in order; counter-clockwise where that is all space.

    Of points on a line the two ends, of one point itself.
    """
    basis = affine_basis(points, np.zeros((0, points.shape[1])))
    if not len(basis):
        return points[:1]
    flat = len(basis) < points.shape[1]  # as it is elsewhere, for the basis may mirror the order
    return np.asarray(points[convex_hull(points @ basis.T if flat else points).corners])


def convex_faces(points: Array) -> list[Array]:
    """Faces of the convex hull of points in space, each as its corners in order; flat sets are one face."""
    if affine_rank(points, np.zeros((0, 3))) < 3:
        return [convex_outline(points)]
    hull = convex_hull(points)
    near = NEGLIGIBLE * float(np.ptp(points, axis=0).max())
    depths = hull.offsets - points @ hull.normals.T
    return [convex_outline(points[depth <= near]) for depth in depths.T]


def padded(points: Array, radius: float) -> Array:
    """Points whose hull is that of the given points with a margin; the points themselves without one."""
    if not radius:
        return points
    return (points[:, None, :] + radius * _unit_ball(points.shape[1])).reshape(-1, points.shape[1])


def _unit_ball(dimension: int) -> Array:
    return on_unit_ball(dimension, 48 if dimension == 2 else 160)


def _frame(view: Array | None, points: Array) -> Array:
    """The view with a margin, so that the cut itself is not seen; without a view, the surroundings of the corners."""
    if view is None:
        size = max(float(np.ptp(points, axis=0).max()), 1.0)
        view = np.array([points.min(axis=0) - size, points.max(axis=0) + size])
    margin = 0.02 * (view[1] - view[0]).max()
    return np.array([view[0] - margin, view[1] + margin])


# --------------------------------------------------------------------------------------------------------------- scenes


def draw_scene(
    time: Array,
    bodies: Sequence[BodyPath],
    obstacles: Sequence[Any] = (),
    *,
    snapshots: int = 12,
    view: Any = None,
    title: str = "",
    figure: Any = None,
) -> Any:
    """Draw bodies at several times, light to dark, among obstacles in grey.

    The same colour means the same time for every body. A dashed line is the path of a body's reference point, a circle
    marks where it starts, a star where it ends.

    Parameters
    ----------
    time : array, shape (T,)
        Seconds.
    bodies : sequence of BodyPath
        With a pose for each time.
    obstacles : sequence of Polytope
        What stands still; padded ones have round corners, those with rays end at the edge of the picture.
    snapshots : int
        How many times are drawn, with about equal motion between them.
    view : (lower, upper), optional
        Corners of what is shown, shape (2, d). By default all motion is seen, and what is near it.
    title : str
    figure : Figure or SubFigure, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.figure.Figure or SubFigure

    Raises
    ------
    ObstacleError
        When there is no body, bodies or obstacles differ in dimension, or the number of poses is not that of times.
    """
    scene = _Scene(time, bodies, obstacles, view)
    figure = figure_or_new(figure, 6.4, 6.0)
    axis = scene.axis(figure, title)
    colours = time_colours(scene.time)
    chosen = evenly_moved(np.concatenate([body.places() for body in bodies], axis=1), snapshots)
    for body in bodies:
        local = body.polygons()
        for layer, i in enumerate(chosen.tolist()):
            colour = colours.to_rgba(scene.time[i])
            for polygon in body.at(i, local):
                # Each snapshot covers the earlier ones a little: where they overlap, the eye can tell which came later.
                _add_polygon(axis, polygon, (*colour[:3], 0.13), colour, 2 + 0.01 * layer)
    scene.set_limits(axis)
    room = {"shrink": 0.6, "pad": 0.12} if scene.dimension == 3 else {}
    figure.colorbar(colours, ax=axis, label="time [s]", **room)
    return figure


class _Scene:
    """Bodies and obstacles that fit together, and the axes that they are drawn on; parameters as of `draw_scene`."""

    def __init__(self, time: Array, bodies: Sequence[BodyPath], obstacles: Sequence[Any], view: Any) -> None:
        self.time, self.bodies, self.obstacles = np.asarray(time, dtype=float), bodies, obstacles
        if not bodies:
            raise ObstacleError("a scene without a body: nothing would move. Give at least one BodyPath.")
        self.dimension = bodies[0].dimension
        for item in (*bodies, *obstacles):
            if item.dimension != self.dimension:
                raise ObstacleError(
                    f"'{item.name}' has dimension {item.dimension} and '{bodies[0].name}' has {self.dimension}: a "
                    "scene is either planar or spatial."
                )
        for body in bodies:
            if len(body.translation) != len(self.time):
                raise ObstacleError(f"body '{body.name}' has {len(body.translation)} poses at {len(self.time)} times.")
        self.is_fitted = view is None
        self.window = _window(bodies, obstacles) if view is None else np.asarray(view, dtype=float)

    def axis(self, figure: Any, title: str) -> Any:
        """Axes with the obstacles and the paths of the bodies."""
        width, is_flat = self.window[1] - self.window[0], self.dimension == 2
        axis = figure.subplots(subplot_kw={} if is_flat else {"projection": "3d"})
        # Axes with a fixed aspect may show more than the window.
        beyond = width.max() * np.array([[-3.0], [3.0]]) if is_flat and self.is_fitted else 0.0
        for obstacle in self.obstacles:
            face = (0.72, 0.72, 0.72, 1.0) if is_flat else (0.55, 0.55, 0.55, 0.35)
            # Facets approximate round shapes, so their edges are faint.
            is_round = obstacle.radius or obstacle.ellipsoids is not None
            edge = (0.45, 0.45, 0.45, 1.0) if is_flat else (0.4, 0.4, 0.4, 0.1 if is_round else 0.8)
            for polygon in _polygons(obstacle, self.window + beyond):
                _add_polygon(axis, polygon, face, edge, 1)
        if is_flat:
            axis.set_aspect("equal", adjustable="datalim" if self.is_fitted else "box")
            axis.grid(alpha=0.25)
            axis.set_axisbelow(True)
        else:
            axis.set_zlabel("z [m]")
            axis.set_box_aspect(width)
        for body in self.bodies:
            _draw_path(axis, body, named=len(self.bodies) > 1)
        axis.set_xlabel("x [m]")
        axis.set_ylabel("y [m]")
        axis.set_title(title)
        return axis

    def set_limits(self, axis: Any) -> None:
        """Set the limits, once everything is drawn."""
        # Where Matplotlib may fit the limits to the shape of the axes, it complains about limits that are fixed.
        free = self.is_fitted and self.dimension == 2
        axis.set_xlim(*self.window[:, 0], auto=free)
        axis.set_ylim(*self.window[:, 1], auto=free)
        if self.dimension == 3:
            axis.set_zlim(*self.window[:, 2])


def _polygons(shape: Polytope, view: Array | None = None) -> list[Array]:
    """What is drawn of a shape, as far as it is in the view."""
    polygons = faces(shape, view) if shape.dimension == 3 else [outline(shape, view)]
    return [polygon for polygon in polygons if len(polygon)]


def _add_polygon(axis: Any, corners: Array, face: Any, edge: Any, layer: float) -> Any:
    """One polygon onto an axis of either kind; a point becomes a dot."""
    width = 0.8 if corners.shape[1] == 3 else 1.4
    if len(corners) == 1:
        return axis.plot(*corners.T, "o", color=edge, markersize=4, zorder=layer)[0]
    if corners.shape[1] == 3:
        patch = art3d.Poly3DCollection([corners], facecolor=face, edgecolor=edge, linewidth=width, zorder=layer)
        return axis.add_collection3d(patch)
    patch = matplotlib.patches.Polygon(corners, facecolor=face, edgecolor=edge, linewidth=width, zorder=layer)
    return axis.add_patch(patch)


def _draw_path(axis: Any, body: BodyPath, *, named: bool) -> None:
    """The path of the reference point, with a circle at its start and a star at its end."""
    path = body.translation
    axis.plot(*path.T, color="black", linewidth=1.2, linestyle=(0, (4, 2)), zorder=99)
    axis.plot(*path[:1].T, "o", color="white", markeredgecolor="black", markersize=6, zorder=100)
    axis.plot(*path[-1:].T, "*", color="white", markeredgecolor="black", markersize=11, zorder=100)
    if named:
        axis.text(*path[0], f"  {body.name}", fontsize="small", zorder=101)


def _window(bodies: Sequence[BodyPath], obstacles: Sequence[Any]) -> Array:
    """The part of a scene to show: all motion, with room around it, and obstacles as far as they are near.

    The picture ends at one and a half times the motion: a long wall would otherwise shrink the motion to a dot.
    """
    reach = max(float(part.radius) for body in bodies for part in body.parts)  # type: ignore[union-attr]
    places = np.concatenate([body.places().reshape(-1, body.dimension) for body in bodies])
    lower, upper = places.min(axis=0) - reach, places.max(axis=0) + reach
    room = 0.5 * max(float((upper - lower).max()), 1e-9)
    low, high = lower - 0.08 * room, upper + 0.08 * room
    for obstacle in obstacles:
        # More room along rays, so that an unbounded wall at the edge looks like a wall and not like a line.
        rays = np.concatenate([np.zeros((1, len(lower))), np.reshape(obstacle.rays, (-1, len(lower)))])
        before = obstacle.bounding_box[0] - room * np.where(rays.min(axis=0) < -1e-9, 0.3, 0.08)
        after = obstacle.bounding_box[1] + room * np.where(rays.max(axis=0) > 1e-9, 0.3, 0.08)
        low = np.minimum(low, np.maximum(before, lower - 0.5 * room))
        high = np.maximum(high, np.minimum(after, upper + 0.5 * room))
    return np.array([low, high])


def animate_scene(
    time: Array,
    bodies: Sequence[BodyPath],
    obstacles: Sequence[Any],
    path: str | Path | None = None,
    *,
    frames: int = 60,
    seconds: float | None = None,
    view: Any = None,
    title: str = "",
    size: tuple[float, float] = (5.0, 4.6),
) -> AnimationFile:
    """Write an animation of bodies that move among obstacles; in a notebook, what is returned plays.

    Parameters
    ----------
    time : array, shape (T,)
        Seconds.
    bodies, obstacles, view, title
        As in `draw_scene`.
    path : str or Path, optional
        Where to write: a name that ends in ``.mp4`` makes a film (by the program ffmpeg), any other a GIF, whose suffix
        is made ``.gif``. A temporary GIF by default.
    frames : int
        Pictures, at equal distances in time; each shows the poses of the given time nearest to its own.
    seconds : float, optional
        How long the animation runs; as long as the motion, but between 2 and 10 s, by default. The last picture stays
        for another second.
    size : (width, height)
        Of the picture, inches; 100 pixels each.

    Returns
    -------
    AnimationFile
        Path of the file written.

    Raises
    ------
    ObstacleError
        As in `draw_scene`, or when there are fewer than two frames, no time for them, or no ffmpeg for a film.
    """
    scene = _Scene(time, bodies, obstacles, view)
    time = scene.time
    lasts = float(np.clip(time[-1] - time[0], 2.0, 10.0)) if seconds is None else float(seconds)
    if frames < 2 or not lasts > 0:
        raise ObstacleError(f"an animation of {frames} frames in {lasts:g} s; give at least 2, and a positive time.")
    target = animation_file(path)
    figure = matplotlib.figure.Figure(figsize=size, dpi=100, layout="constrained")
    axis = scene.axis(figure, title)
    scene.set_limits(axis)
    polygons = [body.polygons() for body in bodies]
    write = axis.text2D if scene.dimension == 3 else axis.text
    label = write(0.02, 0.97, "", transform=axis.transAxes, verticalalignment="top", fontsize="small")

    # Frames are written directly: `FuncAnimation` draws an additional first frame.
    writer = (animation.FFMpegWriter if is_film(target) else animation.PillowWriter)(fps=frames / lasts)
    writer.setup(figure, str(target), dpi=100)
    shown: list[Any] = []
    wanted = np.linspace(time[0], time[-1], frames)
    for frame in [*wanted, *[wanted[-1]] * max(1, round(frames / lasts))]:
        i = int(np.abs(time - frame).argmin())
        for patch in shown:
            patch.remove()
        shown = [
            _add_polygon(axis, corners, (0.13, 0.33, 0.55, 0.45), (0.13, 0.33, 0.55, 1.0), 3)
            for body, local in zip(bodies, polygons, strict=True)
            for corners in body.at(i, local)
        ]
        label.set_text(f"{frame:.2f} s")
        if frame == wanted[0]:
            # The layout is computed once, so that the picture does not shift between frames.
            figure.draw_without_rendering()
            figure.set_layout_engine("none")
        writer.grab_frame()
    writer.finish()
    return target


@dataclass(frozen=True, eq=False)
class BodyPath:
    """A body of one or several convex parts, and its pose at each time.

    Attributes
    ----------
    parts : Polytope, or sequence of Polytope
        In the frame of the body.
    rotation : array, shape (T, d, d)
        At each time.
    translation : array, shape (T, d)
        Of the body's reference point, the origin of its frame.
    name : str
    """

    parts: Polytope | Sequence[Polytope]
    rotation: Array
    translation: Array
    name: str = "body"

    def __post_init__(self) -> None:
        parts = (self.parts,) if isinstance(self.parts, Polytope) else tuple(self.parts)
        object.__setattr__(self, "parts", parts)
        for name in ("rotation", "translation"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), float))
        size, d = self.translation.shape, self.translation.shape[-1] if self.translation.ndim == 2 else 0
        if self.rotation.shape != (*size, d) or any(part.dimension != d for part in parts):
            raise ObstacleError(
                f"body '{self.name}': parts of dimension {[part.dimension for part in parts]}, rotations of shape "
                f"{self.rotation.shape}, translations of shape {size}; expected are (T, d, d) and (T, d)."
            )

    @classmethod
    def planar(cls, parts: Any, x: Any, y: Any, theta: Any, name: str = "body") -> BodyPath:
        """From arrays of positions and of rotations in radians, shape (T,) each."""
        c, s = np.cos(np.asarray(theta, float)), np.sin(np.asarray(theta, float))
        rotation = np.moveaxis(np.array([[c, -s], [s, c]]), -1, 0)
        return cls(parts, rotation, np.column_stack([x, y]), name)

    @property
    def dimension(self) -> int:
        """Two or three."""
        return int(self.translation.shape[1])

    def places(self) -> Array:
        """All corners over time, shape (T, v, d)."""
        corners = np.concatenate([part.covering for part in self.parts])  # type: ignore[union-attr]
        return corners @ self.rotation.transpose(0, 2, 1) + self.translation[:, None, :]

    def polygons(self) -> list[Array]:
        """What is drawn of it, in its own frame."""
        return [polygon for part in self.parts for polygon in _polygons(part)]  # type: ignore[union-attr]

    def at(self, i: int, polygons: Sequence[Array]) -> Iterator[Array]:
        """Polygons of the body's frame, moved to where the body is at the i-th time."""
        for polygon in polygons:
            yield polygon @ self.rotation[i].T + self.translation[i]


class AnimationFile(type(Path())):  # type: ignore[misc]  # PosixPath, or WindowsPath
    """Path of a GIF or MP4 file; at the end of a notebook cell, its animation plays.

    The notebook holds a copy of the animation, and needs the file no longer. A temporary file is there as long as this
    object, and is removed with it, at the latest when Python ends; `save` keeps it.
    """

    def save(self, path: str | Path) -> AnimationFile:
        """Copy the animation to another file, and return its path.

        Parameters
        ----------
        path : str or Path
            Its suffix is made that of this file: films are written by ``animate(path)``.

        Raises
        ------
        FileNotFoundError
            When the file of this animation is gone.
        """
        target = AnimationFile(Path(path).with_suffix(self.suffix))
        if not (target.exists() and target.samefile(self)):
            shutil.copyfile(self, target)
        return target

    def _repr_html_(self) -> str | None:
        if not self.is_file():
            return None
        data = b64encode(self.read_bytes()).decode("ascii")
        if is_film(self):
            return f'<video controls autoplay loop muted src="data:video/mp4;base64,{data}"></video>'
        return f'<img alt="animation" src="data:image/gif;base64,{data}"/>'


def animation_file(path: str | Path | None) -> AnimationFile:
    """Where an animation goes: ``.mp4`` as named, any other as ``.gif``; None: a temporary file.

    Raises
    ------
    ObstacleError
        For MP4 without the program that writes it.
    """
    if path is None:
        folder = tempfile.mkdtemp(prefix="pyrobocop_")
        made = AnimationFile(Path(folder) / "animation.gif")
        weakref.finalize(made, shutil.rmtree, folder, ignore_errors=True)
        return made
    if not is_film(Path(path)):
        return AnimationFile(Path(path).with_suffix(".gif"))
    if not animation.FFMpegWriter.isAvailable():
        raise ObstacleError(
            f"'{path}': MP4 files are written by the program ffmpeg, and Matplotlib does not find it. Install it (apt "
            "install ffmpeg, brew install ffmpeg, conda install ffmpeg), set matplotlib.rcParams['animation."
            "ffmpeg_path'], or write a file that ends in .gif, which needs nothing."
        )
    return AnimationFile(path)


def is_film(path: Path) -> bool:
    """Whether a file is written by ffmpeg; others are GIFs."""
    return path.suffix.lower() == ".mp4"
