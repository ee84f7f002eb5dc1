"""The example with the rod, on a coarse mesh: a team whose agents solve real problems."""

import sys
from dataclasses import replace
from pathlib import Path

import pyrobocop_pyomo as rcp

EXAMPLES = str(Path(__file__).parents[2] / "examples")
if EXAMPLES not in sys.path:  # workers are given the path of this process
    sys.path.insert(0, EXAMPLES)

from rod import task, team  # noqa: E402


def pushing_team(robots: int = 2, steps: int = 10, seed: int = 0) -> rcp.Team:
    """Two discs and a rod, without physics: all rounds are carried out, whatever the plan is worth."""
    return replace(team(task(seed, robots, steps)), physics=None)
