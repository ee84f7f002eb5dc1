"""What a problem of the table of estimates is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

# Far finer than any mesh of the table.
FINE: dict[str, Any] = {"elements": 64, "scheme": "radau", "stages": 4}
FINER: dict[str, Any] = {"elements": 96, "scheme": "radau", "stages": 4}


@dataclass(frozen=True)
class EstimateProblem:
    """A smooth problem of optimal control.

    Attributes
    ----------
    name : str
    what : str
        What it has beyond states, a control and a cost.
    build : callable
        ``build(**how)`` makes the model; ``how`` are arguments of `PhaseBlock` that say the mesh and the scheme.
    second : dict
        The scheme of the second set of meshes, beside Radau's with three stages.
    meshes : tuple of int
        Numbers of elements of each phase, with Radau's scheme.
    second_meshes : tuple of int
        The same with the second scheme.
    exact : float or None
        The optimal value, where a formula gives it.
    """

    name: str
    what: str
    build: Callable[..., Any]
    second: dict[str, Any]
    meshes: tuple[int, ...] = (3, 6, 12)
    second_meshes: tuple[int, ...] = (5, 10, 20)
    exact: float | None = None
