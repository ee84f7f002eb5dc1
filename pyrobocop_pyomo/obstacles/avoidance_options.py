"""What the user may say to an avoidance block, checked."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from numbers import Real
from typing import Any

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.motion.bodies import Body

from .avoidance_record import AvoidanceRecord
from .formulations import FORMULATIONS, Formulation
from .scene import Scene
from .scene_reading import make_scene


@dataclass(frozen=True, kw_only=True)
class AvoidanceOptions:
    """The arguments of `ObstacleAvoidanceBlock`, beside its points."""

    bodies: Any = None
    obstacles: Any = None
    clearance: Any = None
    body: Any = None
    pose: Callable[..., Any] | None = None
    pairs: Any = None
    exclude: Any = ()
    formulation: str | Formulation = "plane"
    norm: str = "auto"
    between: str | None = "auto"
    broad_phase: float | None = None

    def record(self, what: str, points: Any) -> AvoidanceRecord:
        """The facts that the block starts with.

        Raises
        ------
        ObstacleError
            When the scene or the options contradict themselves.
        """
        if self.clearance is None:
            raise ObstacleError(f"{what}: clearance= is missing: the distance to be kept, a length > 0.")
        scene = make_scene(
            what,
            bodies=self._bodies(what),
            obstacles=self.obstacles,
            clearance=self.clearance,
            pairs=self.pairs,
            exclude=self.exclude,
        )
        formulation = self._formulation(what)
        _check_shapes(what, scene, formulation)
        self._check_norm(what, formulation)
        per_interval = self._per_interval(what, formulation)
        self._check_broad_phase(what, scene)
        return AvoidanceRecord(scene, points, formulation, self.norm, per_interval, self.broad_phase)

    def _bodies(self, what: str) -> Any:
        if self.body is None:
            if self.pose is not None:
                raise ObstacleError(f"{what}: pose= goes with body=; with bodies=, give Body(shape, pose=rule) each.")
            return self.bodies
        if self.bodies is not None:
            raise ObstacleError(f"{what}: give bodies= or body=, not both.")
        if self.pose is None:
            raise ObstacleError(f"{what}: body= needs pose=rule, which says where the body is: rule(block, t) -> Pose.")
        return {"body": Body(self.body, pose=self.pose)}

    def _formulation(self, what: str) -> Formulation:
        if not isinstance(self.formulation, str):
            return self.formulation
        if self.formulation not in FORMULATIONS:
            raise ObstacleError(
                f"{what}: formulation is {self.formulation!r}; there are {', '.join(map(repr, FORMULATIONS))}."
            )
        return FORMULATIONS[self.formulation]

    def _check_norm(self, what: str, formulation: Formulation) -> None:
        if self.norm != "auto" and self.norm not in formulation.norms:
            raise ObstacleError(
                f"{what}: norm is {self.norm!r}; the formulation '{formulation.name}' takes "
                f"{', '.join(map(repr, ('auto', *formulation.norms)))}."
            )

    def _per_interval(self, what: str, formulation: Formulation) -> bool:
        if self.between not in ("auto", "plane", None):
            raise ObstacleError(f'{what}: between is {self.between!r}; it is "plane" or None.')
        if self.between == "plane" and not formulation.covers_intervals:
            raise ObstacleError(
                f"{what}: the formulation '{formulation.name}' looks at one pose at a time and cannot cover an "
                'interval. Use formulation="plane", or between=None.'
            )
        return self.between is not None and formulation.covers_intervals

    def _check_broad_phase(self, what: str, scene: Scene) -> None:
        length = self.broad_phase
        if length is None:
            return
        if not isinstance(length, Real) or not math.isfinite(length):
            raise ObstacleError(f"{what}: broad_phase is {length!r}; it is a length, or None.")
        largest = max(scene.clearances.values())
        if length <= largest:
            raise ObstacleError(
                f"{what}: broad_phase {length:g} leaves out pairs that are nearer than the clearance {largest:g}. "
                "Take several times the clearance."
            )


def _check_shapes(what: str, scene: Scene, formulation: Formulation) -> None:
    """Shapes have what the formulation needs: half-spaces, or an end.

    Raises
    ------
    ObstacleError
        Naming the body.
    """
    for pair in scene.pairs_of_parts():
        for part, halfspaces, rays in zip(pair, formulation.halfspaces, formulation.rays, strict=True):
            if halfspaces and part.shape.is_flat:
                raise ObstacleError(
                    f"{what}: '{part.name}' is flat, and the formulation '{formulation.name}' needs its half-spaces, "
                    'which a flat shape does not have. Use formulation="plane", or give the shape a thickness.'
                )
            if not rays and not part.shape.is_bounded:
                raise ObstacleError(
                    f"{what}: '{part.name}' is unbounded, which the formulation '{formulation.name}' cannot take. "
                    'Use formulation="plane", or cut the shape to what can be reached.'
                )
