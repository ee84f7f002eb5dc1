"""Robots from URDF: bodies with pose rules by forward kinematics, and the body pairs that need not be kept apart.

Forward kinematics of a tree of joints, in numbers or in Pyomo expressions alike.
"""

from __future__ import annotations

import io
import itertools
import logging
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from pyomo.core.expr import cos, sin

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope, Pose
from pyrobocop_pyomo.geometry.poses import dot
from pyrobocop_pyomo.motion import Body
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.rounding import ROUNDING
from pyrobocop_pyomo.optional_imports import networkx, trimesh, yourdfpy
from pyrobocop_pyomo.presentation import Presented

from .decomposition import decompose

# ----------------------------------------------------------------------------------------------------------- kinematics


TURNING = ("revolute", "continuous")
WITH_ONE_COORDINATE = (*TURNING, "prismatic")


@dataclass(frozen=True, eq=False)
class Joint:
    """One joint: where it is on its parent link, and how it moves its child.

    Attributes
    ----------
    name, kind, parent : str
    origin : array, shape (4, 4)
    axis : array, shape (3,)
        Unit vector in the frame of the joint.
    limits : (float, float)
        Infinite where there are none.
    mimics : (str, float, float) or None
        Another joint, and the factor and offset of this joint's coordinate from its one.
    """

    name: str
    kind: str
    parent: str
    origin: np.ndarray
    axis: np.ndarray
    limits: tuple[float, float]
    mimics: tuple[str, float, float] | None = None

    @property
    def moves(self) -> bool:
        """Whether its child moves relative to its parent."""
        return self.kind != "fixed"

    @property
    def leader(self) -> str:
        """The joint whose coordinate moves it: another one, where it mimics that."""
        return self.name if self.mimics is None else self.mimics[0]

    def pose(self, coordinate: Any) -> Pose:
        """Pose of the child in the frame of the parent."""
        fixed = constant_pose(self.origin)
        if not self.moves:
            return fixed
        if self.kind == "prismatic":
            return fixed @ Pose(Pose.identity(3).rotation, tuple(dot((float(a),), (coordinate,)) for a in self.axis))
        return fixed @ _turn_about(self.axis, coordinate)


def constant_pose(matrix: np.ndarray) -> Pose:
    """A pose of numbers from a homogeneous matrix."""
    return Pose(_rounded(matrix[:3, :3]).tolist(), np.asarray(matrix[:3, 3], dtype=float).tolist())


def _rounded(factors: Array) -> Array:
    """Numbers of which zeros and ones are exact, as sin(pi) and the like are meant: products with them vanish."""
    rounded = np.array(factors, dtype=float)
    for exact in (-1.0, 0.0, 1.0):
        rounded[np.abs(rounded - exact) <= ROUNDING] = exact
    return rounded


def _turn_about(axis: np.ndarray, angle: Any) -> Pose:
    """Rodrigues' formula ``u u' + (I - u u') cos(angle) + [u] sin(angle)``."""
    along = np.outer(axis, axis)
    crossed = np.cross(axis, np.eye(3), axisb=1).T  # columns: axis x unit vector
    factors = _rounded(np.stack([along, np.eye(3) - along, crossed], axis=2))
    terms = (1.0, cos(angle), sin(angle))
    return Pose(tuple(tuple(dot(entry, terms) for entry in row) for row in factors.tolist()), (0.0, 0.0, 0.0))


@dataclass(frozen=True, eq=False)
class KinematicTree:
    """Links and joints of a robot.

    Attributes
    ----------
    root : str
        The link that no joint moves.
    joints : mapping of name of the child link to Joint
    """

    root: str
    joints: Mapping[str, Joint]

    def chain(self, link: str) -> list[Joint]:
        """Joints from the root to a link."""
        joints: list[Joint] = []
        while link != self.root:
            joints.append(self.joints[link])
            link = joints[-1].parent
        return joints[::-1]

    def pose(self, link: str, coordinate_of: Callable[[str], Any], base: Pose) -> Pose:
        """Pose of a link in the world, from the coordinate (number, expression) by the name of a joint."""
        pose = base
        for joint in self.chain(link):
            coordinate: Any = coordinate_of(joint.leader) if joint.moves else None
            if joint.moves and joint.mimics is not None:
                _, factor, offset = joint.mimics
                coordinate = factor * coordinate + offset
            pose = pose @ joint.pose(coordinate)
        return pose

    def rigid_group(self, link: str) -> str:
        """The link nearest to the root that a link is fixed to: both never move relative to each other."""
        while link != self.root and not self.joints[link].moves:
            link = self.joints[link].parent
        return link


# --------------------------------------------------------------------------------------------------------------- robots


logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class DescribedRobot(Presented):
    """A robot as bodies of a scene; made by `from_urdf`.

    Attributes
    ----------
    name : str
    bodies : dict of name of a link to Body
        Links with collision geometry; those that no joint moves rest.
    exclude : tuple of (str, str)
        Pairs of links that need not be kept apart: fixed to each other, joined by one joint, or disabled by the SRDF.
    limits : dict of name of a joint to (float, float)
        Bounds of the coordinates of joints with one coordinate, mimicking ones left out; infinite where there are none.
    pose_rules : dict of name of a link to callable
        ``rule(block, t) -> Pose`` of every link, also of those without geometry, such as a tool's frame.
    """

    name: str
    bodies: Mapping[str, Body]
    exclude: tuple[tuple[str, str], ...]
    limits: Mapping[str, tuple[float, float]]
    pose_rules: Mapping[str, Callable[[Any, Any], Pose]] = field(repr=False)

    def _summary(self) -> str:
        return f"'{self.name}': {len(self.bodies)} bodies, {len(self.limits)} joints: {', '.join(self.limits)}"


def from_urdf(
    description: str | Path,
    joints: Mapping[str, Any],
    *,
    base: Pose | Callable[[Any, Any], Pose] | None = None,
    srdf: str | Path | None = None,
    meshes: str = "hull",
    sides: int = 16,
    packages: Mapping[str, str | Path] | None = None,
) -> DescribedRobot:
    """Read a robot from a URDF: one body for each link with collision geometry.

    Parameters
    ----------
    description : path, or text that begins with ``<``
    joints : mapping of name of a joint to rule, name or number
        The coordinate of each joint that moves, in radians or metres: ``rule(block, t)``, the name of a state such as
        ``"q1"`` for ``block.q1[t]``, or a number. Mimicking joints follow by themselves.
    base : Pose or callable, optional
        Pose of the root link: constant, or ``rule(block, t)`` for a robot that drives or flies; the world's frame by
        default.
    srdf : path or text, optional
        Whose pairs of ``disable_collisions`` are excluded.
    meshes : str
        ``"hull"``: the convex hull of each mesh, ``"box"``: its box along the link's axes, with eight corners,
        ``"parts"``: exact convex parts of a closed mesh. The first two contain the mesh.
    sides : int
        Of the prism around a cylinder; see `Polytope.cylinder` for its excess.
    packages : mapping of str to path, optional
        Folders for ``package://`` in the names of meshes.

    Returns
    -------
    DescribedRobot

    Raises
    ------
    ObstacleError
        Naming the joint or the link: joints without coordinate, several roots, loops, unknown names.
        Naming the link whose geometry cannot be read.
    ModuleNotFoundError
        If yourdfpy is not installed.
    """
    if meshes not in MESHES:
        raise ObstacleError(f"from_urdf: meshes={meshes!r}; expected one of {', '.join(map(repr, MESHES))}.")
    robot, folder = _read(description)
    tree = _tree_of(robot)
    rules = _coordinate_rules(robot.name, tree, joints)
    base = Pose.identity(3) if base is None else base
    of_base = _rule_of_base(base)
    folders = {"": folder, **{name: Path(path) for name, path in (packages or {}).items()}}
    links = {link.name: link for link in robot.links}
    pose_rules = {name: _pose_rule(tree, name, rules, of_base) for name in links}
    shapes = {name: shapes_of_link(link, sides, meshes, folders) for name, link in links.items()}
    bodies: dict[str, Body] = {}
    for name, link in links.items():
        if not shapes[name]:
            if link.visuals:
                logger.warning(
                    "'%s': link '%s' has no collision geometry, and is not kept clear of anything: pictures of it are "
                    "not read.",
                    robot.name,
                    name,
                )
            continue
        if tree.rigid_group(name) == tree.root and isinstance(base, Pose):
            bodies[name] = Body([shape.placed(pose_rules[name](None, None)) for shape in shapes[name]])
        else:
            bodies[name] = Body(shapes[name], pose_rules[name])
    if not bodies:
        raise ObstacleError(f"robot '{robot.name}': no link has collision geometry.")
    limits = {joint.name: joint.limits for joint in tree.joints.values() if joint.moves and joint.mimics is None}
    exclude = _excluded(tree, list(bodies), _disabled(srdf))
    return DescribedRobot(robot.name, bodies, exclude, limits, pose_rules)


def _read(description: str | Path) -> tuple[Any, Path]:
    text = str(description).lstrip()
    options = {"build_scene_graph": False, "load_meshes": False}
    if text.startswith("<"):
        return yourdfpy.URDF.load(io.BytesIO(text.encode()), **options).robot, Path()
    path = Path(description)
    if not path.is_file():
        raise ObstacleError(f"from_urdf: there is no file '{path}'.")
    return yourdfpy.URDF.load(str(path), **options).robot, path.parent


def _tree_of(robot: Any) -> KinematicTree:
    names = [link.name for link in robot.links]
    joints: dict[str, Joint] = {}
    for given in robot.joints:
        for link in (given.parent, given.child):
            if link not in names:
                raise ObstacleError(f"joint '{given.name}' names the link '{link}', which does not exist.")
        joints[given.child] = _joint(given)
    graph = networkx.MultiDiGraph((joint.parent, joint.child) for joint in robot.joints)
    graph.add_nodes_from(names)
    roots = [link for link, joints_above in graph.in_degree if joints_above == 0]
    if not networkx.is_arborescence(graph):
        several = [link for link, joints_above in graph.in_degree if joints_above > 1]
        raise ObstacleError(
            f"robot '{robot.name}': its joints are no tree with one root; no joint moves {roots}, and several move "
            f"{several}. Loops are not supported: cut them, and state their closing as a constraint."
        )
    return KinematicTree(roots[0], joints)


def _joint(given: Any) -> Joint:
    """A joint of a description; what it leaves out has the default of the format."""
    if given.type not in ("fixed", *WITH_ONE_COORDINATE):
        raise ObstacleError(
            f"joint '{given.name}' is of type '{given.type}'; expected one coordinate: a robot that drives or flies as "
            "a whole has its pose by base=."
        )
    axis = np.array([1.0, 0.0, 0.0]) if given.axis is None else np.asarray(given.axis, dtype=float)
    length = float(np.linalg.norm(axis))
    if given.type != "fixed" and not length > 0.0:
        raise ObstacleError(f"joint '{given.name}' has the axis {axis.tolist()}, which is no direction.")
    limits = (-math.inf, math.inf)
    if given.limit is not None and given.type != "continuous":
        low, high = given.limit.lower, given.limit.upper
        limits = (-math.inf if low is None else float(low), math.inf if high is None else float(high))
    mimics = None
    if given.mimic is not None:
        factor, offset = given.mimic.multiplier, given.mimic.offset
        mimics = (given.mimic.joint, 1.0 if factor is None else float(factor), 0.0 if offset is None else float(offset))
    origin = np.eye(4) if given.origin is None else np.asarray(given.origin, dtype=float)
    return Joint(given.name, given.type, given.parent, origin, axis / (length or 1.0), limits, mimics)


def _coordinate_rules(
    name: str, tree: KinematicTree, joints: Mapping[str, Any]
) -> dict[str, Callable[[Any, Any], Any]]:
    movable = {joint.name: joint for joint in tree.joints.values() if joint.moves and joint.mimics is None}
    for joint in tree.joints.values():
        if joint.leader not in movable and joint.mimics is not None:
            raise ObstacleError(f"joint '{joint.name}' mimics '{joint.leader}', which does not move by itself.")
    unknown = [joint for joint in joints if joint not in movable]
    missing = [joint for joint in movable if joint not in joints]
    if unknown or missing:
        said = f"joints= names {', '.join(map(repr, unknown))}, which do not move by themselves; " if unknown else ""
        said += f"joints= says nothing about {', '.join(map(repr, missing))}; " if missing else ""
        raise ObstacleError(f"robot '{name}': {said}the joints that move are {', '.join(map(repr, movable))}.")
    return {joint: _coordinate_rule(joint, given) for joint, given in joints.items()}


def _coordinate_rule(joint: str, given: Any) -> Callable[[Any, Any], Any]:
    if callable(given):
        return given
    if isinstance(given, str):
        return lambda block, t: getattr(block, given)[t]
    if not isinstance(given, (int, float, np.number)):
        raise ObstacleError(
            f"joint '{joint}' is given {given!r}; expected a rule(block, t), the name of a state, or a number."
        )
    return lambda block, t: given


def _rule_of_base(base: Any) -> Callable[[Any, Any], Pose]:
    if isinstance(base, Pose):
        return lambda block, t: base
    if not callable(base):
        raise ObstacleError(f"from_urdf: base={base!r}; expected a Pose or a rule(block, t) that returns one.")
    return base


def _pose_rule(
    tree: KinematicTree,
    link: str,
    rules: Mapping[str, Callable[[Any, Any], Any]],
    of_base: Callable[[Any, Any], Pose],
) -> Callable[[Any, Any], Pose]:
    def pose(block: Any, t: Any) -> Pose:
        return tree.pose(link, lambda joint: rules[joint](block, t), of_base(block, t))

    return pose


# ------------------------------------------------------------------------------------------------------- excluded pairs


def _disabled(srdf: str | Path | None) -> list[tuple[str, str]]:
    if srdf is None:
        return []
    text = str(srdf).lstrip()
    try:
        root = ElementTree.fromstring(text) if text.startswith("<") else ElementTree.parse(srdf).getroot()
    except (ElementTree.ParseError, OSError) as error:
        raise ObstacleError(f"from_urdf: the SRDF cannot be read: {error}.") from None
    return [(entry.get("link1", ""), entry.get("link2", "")) for entry in root.iter("disable_collisions")]


def _excluded(tree: KinematicTree, links: list[str], disabled: list[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
    """Pairs that are fixed to each other or joined by one joint, links without geometry between them left out."""
    groups = {link: tree.rigid_group(link) for link in links}

    def next_to_root(group: str) -> str | None:
        while group != tree.root:
            group = tree.rigid_group(tree.joints[group].parent)
            if group in groups.values():
                return group
        return None

    near = {link: (group, next_to_root(group)) for link, group in groups.items()}
    left_out = set(map(frozenset, disabled))
    return tuple(
        (first, second)
        for first, second in itertools.combinations(links, 2)
        if groups[first] in near[second] or groups[second] in near[first] or frozenset((first, second)) in left_out
    )


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
        file = folders[package] / path
    else:
        file = folders[""] / path
    if not file.is_file():
        raise ObstacleError(f"link '{link}': there is no file '{file}' for its mesh '{filename}'.")
    return str(file)
