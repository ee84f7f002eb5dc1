"""The example with the rod, on a coarse mesh: a team whose agents solve real problems."""

from __future__ import annotations

import sys
from pathlib import Path

import pyrobocop_pyomo as rcp

EXAMPLES = str(Path(__file__).parents[2] / "examples")
if EXAMPLES not in sys.path:  # workers are given the path of this process
    sys.path.insert(0, EXAMPLES)

from rod import APART, robot, rod, task  # noqa: E402


def pushing_team(robots: int = 2, steps: int = 10, seed: int = 0) -> rcp.Team:
    """Two discs and a rod."""
    now = task(seed, robots, steps)
    return rcp.Team(
        hub=rcp.Agent("rod", rod, now),
        robots=[rcp.Agent(name, robot, now, name) for name in now.robots],
        shared=[
            rcp.Shared("body.qx", "body.qy", "body.qth", penalty=20),
            rcp.Shared("body.ux", "body.uy", "body.uth", penalty=2),
            rcp.Shared("push[{robot}]", penalty=(0.5, 0.5, 2.5)),
        ],
        keep_apart=rcp.KeepApart(("me.x", "me.y"), APART),
    )
