"""Asking a pose rule, and checking that what it returns is a pose."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pyomo.core.base.block import BlockData
from pyomo.core.expr.numvalue import native_numeric_types

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Pose
from pyrobocop_pyomo.modeling.rule_slips import block_as_number, forgotten_index, slips_explained


def asked_pose(ask: Callable[[], Any], rule: Callable[..., Any], block: Any, name: str) -> Pose:
    """What a pose rule returns, checked; typical mistakes in it are explained.

    Parameters
    ----------
    ask : callable
        Calls the rule.
    rule : callable
        ``rule(block, t)``, as for a `Body`.
    block : Block
        The block that the rule is for.
    name : str
        Name of the body in messages.

    Raises
    ------
    ObstacleError
        Naming the body.
    """
    what = f"the pose of '{name}'"
    with slips_explained(rule, what, block, ("b", "t"), ObstacleError):
        pose = ask()
    if not isinstance(pose, Pose):
        given = repr(pose)
        if isinstance(pose, (tuple, list)):
            given = f"a {type(pose).__name__}, ({', '.join(map(str, pose))})"
        remedy = "Is the return statement missing? " if pose is None else ""
        raise ObstacleError(
            f"the pose rule of '{name}' returned {given}; expected a Pose: {remedy}return planar_pose(x, y, theta) in "
            "the plane, spatial_pose((x, y, z), ...) in space."
        )
    for entry in pose.entries:
        if entry.__class__ in native_numeric_types:
            continue
        if isinstance(entry, BlockData):
            raise ObstacleError(f"{what}: {block_as_number(block, ('b', 't'))}")
        if entry is NotImplemented or not getattr(entry, "is_numeric_type", bool)() or _is_family(entry):
            component = f"b.{entry.local_name}" if hasattr(entry, "local_name") else "b.x"
            raise ObstacleError(f"{what}: {forgotten_index('t', component)}")
    return pose


def _is_family(entry: Any) -> bool:
    return bool(getattr(entry, "is_indexed", bool)())
