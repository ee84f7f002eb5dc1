"""`Containment`: a body that stays inside a convex region, as an ordinary Pyomo block."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pyomo.core.base.component import ModelComponentFactory

from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.modeling.blocks import BuiltBlock, Rule

from .building import sort_arguments
from .containment_data import ContainmentData


@ModelComponentFactory.register("A body that stays inside a convex region.")
class Containment(BuiltBlock, data=ContainmentData):
    """A body that stays inside a convex region, over a set of times.

    Parameters
    ----------
    points : Set, ContinuousSet or sequence of numbers
        As for `ObstacleAvoidanceBlock`. With `rule`, index sets take its place.
    body : Polytope, list of Polytope or Body
    pose : callable
        ``pose(block, t)``, unless `body` is a `Body`, which has it.
    region : Polytope
        Bounded or not, given by what is inside.
    clearance : float
        Distance kept from the sides; 0 by default.
    rule : callable, optional
        ``rule(block, *index)`` calls ``block.build(points, body=..., ...)``; for indexed blocks.

    Raises
    ------
    ObstacleError
        When body and region do not fit; the block is then not added to the model.

    Notes
    -----
    One row ``C_k.(R V_i + t) <= e_k - clearance - radius`` per time, corner and side; no other variables. Between the
    times, straight motion of the corners stays inside by itself; `verify` judges what is not straight, and `solve` asks
    for margins where that is outside.

    Examples
    --------
    >>> import pyomo.environ as pyo
    >>> import pyrobocop_pyomo as rcp
    >>> m = pyo.ConcreteModel()
    >>> m.move = rcp.PhaseBlock(duration=1.0, elements=10)
    >>> m.move.x, m.move.y = rcp.State(initial=0, final=4), rcp.State(initial=0, final=0)
    >>> m.move.inside = rcp.Containment(
    ...     m.move.time,
    ...     body=rcp.Polytope.box(0.5, 0.5),
    ...     pose=lambda b, t: rcp.planar_pose(b.x[t], b.y[t]),
    ...     region=rcp.Polytope.box(6, 1, center=(2, 0)),
    ... )
    >>> m.move.guess_straight_lines()
    >>> m.move.inside.verify().safe
    True
    """

    def __init__(
        self,
        *points: Any,
        body: Any = None,
        pose: Rule | None = None,
        region: Polytope | None = None,
        clearance: float = 0.0,
        rule: Rule | None = None,
        **block_options: Any,
    ) -> None:
        options = {"body": body, "pose": pose, "region": region, "clearance": clearance}
        indexes, built_from = sort_arguments("a Containment", points, options, rule)
        super().__init__(*indexes, **built_from, **block_options)

    @classmethod
    def _is_scalar(cls, args: tuple[Any, ...], keywords: Mapping[str, Any]) -> bool:
        return keywords.get("rule") is None or not args
