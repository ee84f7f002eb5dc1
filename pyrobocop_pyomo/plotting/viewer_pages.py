"""Web pages that hold a scene in motion together with meshcat's viewer, so that a browser needs nothing else."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.optional_imports import meshcat, scipy, umsgpack

from .outlines import convex_faces, convex_outline, faces, outline, padded

# The window is scaled to this size, for which the lights of the viewer are made.
_SIZE = 4.0
_BODY, _OBSTACLE, _FORCE, _PATH = 0x2F6DB5, 0x9A9A9A, 0xD03020, 0x202020

_PAGE = """<!DOCTYPE html>
<html>
<head>
<meta charset="utf-8">
<title>{title}</title>
<style>body {{ margin: 0; overflow: hidden; }} #scene {{ width: 100vw; height: 100vh; }}</style>
</head>
<body>
<div id="scene"></div>
<script>{viewer}</script>
<script>
var viewer = new MeshCat.Viewer(document.getElementById("scene"));
for (const command of {commands}) {{
    viewer.handle_command_bytearray(Uint8Array.from(atob(command), (letter) => letter.charCodeAt(0)));
}}
viewer.animator.mixer.timeScale = {speed};
for (const control of viewer.animator.folder.__folders.default.__controllers) {{
    control.updateDisplay();
}}
// Of the controls, only those of the animation are shown.
viewer.gui.__folders.Scene.close();
viewer.gui.open();
</script>
</body>
</html>
"""


def write_page(
    path: Path,
    time: Array,
    bodies: Sequence[Any],
    obstacles: Sequence[Any],
    arrows: Sequence[tuple[Array, Array]],
    *,
    window: Array,
    speed: float,
    title: str,
) -> None:
    """Write bodies that move among obstacles as a page with meshcat's viewer.

    Parameters
    ----------
    path : Path
    time : array, shape (T,)
        Seconds; those of the page begin at zero.
    bodies : sequence of BodyPath
        What is planar gets a height.
    obstacles : sequence of Polytope
    arrows : sequence of (tip, vector), shape (T, d) each
        Forces of contact: where they act, and as long as they are drawn.
    window : array, shape (2, d)
        Lower and upper corner of what is seen.
    speed : float
        Seconds of the motion in one of the film.
    title : str
    """
    scene = _Scene(np.asarray(time, dtype=float) - time[0], window)
    for i, body in enumerate(bodies):
        place = f"bodies/{i} {_folder(body.name)}"
        # Tops in one plane would flicker where planar bodies overlap.
        height = (1.0 + 0.02 * i) * scene.height
        for j, part in enumerate(body.parts):
            scene.add(f"{place}/{j} {_folder(part.name)}", scene.solid(part, None, height), color=_BODY)
        scene.move(place, body.translation, body.rotation)
        scene.add_line(f"paths/{i} {_folder(body.name)}", body.translation, 1.1 * height)
    for i, obstacle in enumerate(obstacles):
        polygons = scene.solid(obstacle, window, 0.9 * scene.height)
        scene.add(f"obstacles/{i} {_folder(obstacle.name)}", polygons, color=_OBSTACLE, opacity=0.5)
    for i, (tip, vector) in enumerate(arrows):
        # Seen also within the body that pushes.
        scene.add(f"forces/{i}", _cone(), color=_FORCE, transparent=True, depthTest=False)
        scene.point(f"forces/{i}", tip, vector)
    scene.animate()
    viewer = Path(meshcat.viewer_assets_path(), "dist", "main.min.js").read_text(encoding="utf-8")
    commands = json.dumps([b64encode(command).decode("ascii") for command in scene.commands], indent=0)
    page = _PAGE.format(title=escape(title), viewer=viewer, commands=commands, speed=json.dumps(speed))
    path.write_text(page, encoding="utf-8")


class _Scene:
    """Collects the commands that meshcat would send to its viewer; all coordinates are those of the plan."""

    def __init__(self, time: Array, window: Array) -> None:
        self.time = time
        self.commands: list[bytes] = []
        self.size = float((window[1] - window[0]).max())
        self.height = 0.05 * self.size
        self._clips: dict[Any, Any] = {}
        viewer = meshcat.Visualizer(window=self)
        self._root = viewer["scene"]
        low, high = (_lifted(corner, 0.0) for corner in window)
        scale = _SIZE / self.size
        middle = scale * (low + high) / 2
        transform = np.diag([scale, scale, scale, 1.0])
        transform[:3, 3] = -middle
        self._root.set_transform(transform)
        viewer["/Axes"].set_property("position", (-middle).tolist())
        # The viewer's own grid has 40 cells of one half; here each is 1, 10, 100, ... or 0.1, 0.01, ... long.
        cell = 10.0 ** np.round(np.log10(self.size / 12))
        viewer["/Grid"].set_property("scale", 3 * [2 * scale * float(cell)])
        viewer["/Grid"].set_property("position", [0.0, 0.0, scale * float(low[2] - high[2]) / 2])
        viewer["/Background"].set_property("top_color", [1.0, 1.0, 1.0])
        viewer["/Background"].set_property("bottom_color", [0.88, 0.9, 0.93])
        # From above in the plane, from the side in space. The second axis of a camera points up.
        away = [0.0, 0.7, 0.35] if window.shape[1] == 2 else [0.35, 0.4, 0.65]
        viewer["/Cameras/default/rotated/<object>"].set_property("position", [_SIZE * share for share in away])

    def send(self, command: Any) -> None:
        """What meshcat calls with each command."""
        self.commands.append(umsgpack.packb(command.lower()))

    def solid(self, shape: Any, window: Array | None, height: float) -> list[Array]:
        """Faces of a part within a window, at least as thick as can be seen."""
        least = 0.004 * self.size
        if shape.dimension == 3:
            polygons = faces(shape, window)
            if len(polygons) == 1 and len(polygons[0]) < 3:
                return convex_faces(padded(polygons[0], least))
            return polygons
        corners = outline(shape, window)
        if not len(corners):
            return []
        if len(corners) < 3:
            corners = convex_outline(padded(corners, least))
        return convex_faces(np.concatenate([_lifted(corners, 0.0), _lifted(corners, height)]))

    def add(self, place: str, polygons: Iterable[Array], **material: Any) -> None:
        """One object of plane polygons, whose corners are not shared: that keeps its edges sharp."""
        corners, triangles, count = [], [], 0
        for polygon in polygons:
            corners.append(polygon)
            triangles += [(count, count + i, count + i + 1) for i in range(1, len(polygon) - 1)]
            count += len(polygon)
        if not triangles:  # outside of the window
            return
        mesh = meshcat.geometry.TriangularMeshGeometry(np.concatenate(corners), triangles)
        self._root[place].set_object(mesh, meshcat.geometry.MeshPhongMaterial(**material))

    def add_line(self, place: str, points: Array, height: float) -> None:
        """The path of a reference point; that of planar bodies runs above them."""
        line = meshcat.geometry.PointsGeometry(_lifted(points, height).astype(np.float32).T)
        self._root[place].set_object(meshcat.geometry.Line(line, meshcat.geometry.LineBasicMaterial(color=_PATH)))

    def move(self, place: str, translation: Array, rotation: Array) -> None:
        """Key frames of a body, one at each time of the plan."""
        turned = np.tile(np.eye(3), (len(rotation), 1, 1))
        turned[:, : rotation.shape[1], : rotation.shape[2]] = rotation
        quaternions = scipy.spatial.transform.Rotation.from_matrix(turned).as_quat()
        self._keys(place, position=_lifted(translation, 0.0), quaternion=quaternions)

    def point(self, place: str, tip: Array, vector: Array) -> None:
        """Key frames of an arrow."""
        along = _lifted(vector, 0.0)
        # Without a force there is no arrow, but a scale of zero cannot be inverted.
        length = np.maximum(np.linalg.norm(along, axis=1), 1e-6 * self.size)
        x, y, z = (along / length[:, None]).T
        # Turns the first axis onto the vector.
        quaternions = np.stack([0 * x, -z, y, 1 + x], axis=-1)
        quaternions[x < -1 + 1e-9] = [0.0, 0.0, 1.0, 0.0]
        quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
        scale = np.repeat(length[:, None], 3, axis=1)
        self._keys(place, position=_lifted(tip, 1.1 * self.height), quaternion=quaternions, scale=scale)

    def animate(self) -> None:
        """Send all key frames; the animation starts again at its end, as a GIF does."""
        self._root.set_animation(meshcat.animation.Animation(self._clips), repetitions=float("inf"))

    def _keys(self, place: str, **values: Array) -> None:
        kinds = {"position": "vector3", "scale": "vector3", "quaternion": "quaternion"}
        times = self.time.tolist()
        tracks = {
            name: meshcat.animation.AnimationTrack(name, kinds[name], times, rows.tolist())
            for name, rows in values.items()
        }
        # With one frame per second, the frames are the times.
        self._clips[self._root[place].path] = meshcat.animation.AnimationClip(tracks, fps=1)


def _lifted(points: Array, height: float) -> Array:
    """Points in space as they are, those of the plane at a height."""
    points = np.asarray(points, dtype=float)
    if points.shape[-1] == 3:
        return points
    return np.concatenate([points, np.full((*points.shape[:-1], 1), height)], axis=-1)


def _cone() -> list[Array]:
    """An arrow of length one along the first axis, whose tip is the origin."""
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    base = np.stack([0 * angle - 1, 0.12 * np.cos(angle), 0.12 * np.sin(angle)], axis=-1)
    return convex_faces(np.concatenate([np.zeros((1, 3)), base]))


def _folder(name: str) -> str:
    """A name as one step of a path in the scene."""
    return name.replace("/", " ")
