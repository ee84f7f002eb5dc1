"""The first task of the example `belt_drive`: a belt is stretched or slack, its lower end lies on its pulley or not."""

from __future__ import annotations

import runpy
from pathlib import Path

import pyomo.environ as pyo

_EXAMPLE = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "belt_drive.py"))


def belt_drive(elements: int = 200, duration: float = 6.0) -> pyo.ConcreteModel:
    """Two point masses, joined by a spring and damper; the upper one is pulled, the lower one meets the pulley."""
    return _EXAMPLE["build"]("first", elements=(elements, 1), durations=(duration, 1.0))
