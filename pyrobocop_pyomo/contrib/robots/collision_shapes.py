"""Collision geometry of links as convex shapes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope, Pose
from pyrobocop_pyomo.optional_imports import trimesh

from .decomposition import decompose
from .kinematics import constant_pose

MESHES = ("hull", "box", "parts")


def shapes_of_link(link: Any, sides: int, meshes: str, folders: Mapping[str, Path]) -> list[Polytope]:
    """Shapes in the frame of a link, none where it has no collision geometry.

    Parameters
    ----------
    link : link of yourdfpy
    sides : int
        Of prisms around cylinders.
    meshes : str
        ``"hull"``, ``"box"`` or ``"parts"``.
    folders : mapping of name of a package to its folder
        Under the empty name the folder of the description.

    Raises
    ------
    ObstacleError
        Naming the link, where its geometry is none, or a file of a mesh is not found.
    """
    shapes: list[Polytope] = []
    for collision in link.collisions:
        origin = np.eye(4) if collision.origin is None else np.asarray(collision.origin, dtype=float)
        pose, geometry, name = constant_pose(origin), collision.geometry, link.name
        if geometry.box is not None:
            shapes.append(Polytope.box(*map(float, geometry.box.size), name=name).placed(pose))
        elif geometry.cylinder is not None:
            size = (float(geometry.cylinder.radius), float(geometry.cylinder.length))
            shapes.append(Polytope.cylinder(*size, sides=sides, name=name).placed(pose))
        elif geometry.sphere is not None:
            shapes.append(Polytope.ball(float(geometry.sphere.radius), pose.translation, name=name))
        elif geometry.mesh is not None:
            shapes += _of_mesh(geometry.mesh, pose, name, meshes, folders)
        else:
            raise ObstacleError(f"link '{name}': collision geometry that is no box, cylinder, sphere or mesh.")
    return shapes


def _of_mesh(mesh: Any, pose: Pose, name: str, meshes: str, folders: Mapping[str, Path]) -> list[Polytope]:
    loaded = trimesh.load(_file_of(str(mesh.filename), name, folders), force="mesh", process=True)
    scale = np.broadcast_to(1.0 if mesh.scale is None else np.asarray(mesh.scale, dtype=float), 3)
    loaded.apply_scale(scale)
    corners = np.asarray(loaded.vertices, dtype=float)
    if meshes == "parts":
        return [part.placed(pose) for part in decompose(loaded, name=name)]
    if meshes == "box":
        low, high = corners.min(axis=0), corners.max(axis=0)
        middle = (0.5 * (low + high)).tolist()
        return [Polytope.box(*(high - low).tolist(), center=middle, name=name).placed(pose)]
    return [Polytope.hull(corners, name=name).placed(pose)]


def _file_of(filename: str, link: str, folders: Mapping[str, Path]) -> str:
    path = filename.removeprefix("file://")
    if filename.startswith("package://"):
        package, _, path = filename.removeprefix("package://").partition("/")
        if package not in folders:
            raise ObstacleError(
                f"link '{link}': the mesh '{filename}' is in the package '{package}'. Say where that is: "
                f"packages={{'{package}': folder}}."
            )
        found = folders[package] / path
    else:
        found = folders[""] / path
    if not found.is_file():
        raise ObstacleError(f"link '{link}': there is no file '{found}' for its mesh '{filename}'.")
    return str(found)
