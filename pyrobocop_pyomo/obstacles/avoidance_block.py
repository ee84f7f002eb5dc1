"""`ObstacleAvoidanceBlock`: bodies that keep clear of obstacles and of each other, as an ordinary Pyomo block."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pyomo.core.base.component import ModelComponentFactory

from pyrobocop_pyomo.modeling.blocks import BuiltBlock, Rule

from .avoidance_data import ObstacleAvoidanceBlockData
from .building import sort_arguments


@ModelComponentFactory.register("Bodies that keep clear of obstacles and of each other.")
class ObstacleAvoidanceBlock(BuiltBlock, data=ObstacleAvoidanceBlockData):
    """Bodies that keep clear of obstacles and of each other, over a set of times.

    Parameters
    ----------
    points : Set, ContinuousSet or sequence of numbers
        When: ``phase.time`` or ``phase.points`` of a `PhaseBlock`, a discretised ContinuousSet, ordered numbers; any
        other set with ``between=None``. With `rule`, index sets take its place.
    bodies : mapping of name to Body
        What moves by the plan.
    obstacles : mapping of name to Polytope, list of Polytope or Body; or a sequence of such
        What does not. A list of polytopes is one obstacle, their union; a `Body` moves by itself.
    clearance : float or mapping of pair to float
        Distance to be kept, > 0.
    body, pose : Polytope and callable, optional
        Short for ``bodies={"body": Body(body, pose=pose)}``.
    pairs : networkx.Graph or iterable of (str, str), optional
        Who keeps clear of whom; by default every body of every obstacle and of every other body.
    exclude : iterable of (str, str)
        Pairs to leave out, such as adjacent links of an arm.
    formulation : str or Formulation
        ``"plane"`` (default), ``"dual"``, ``"mixed"``, ``"offset"`` or ``"optimality"``.
    norm : str
        Length of the normals: ``"sphere"`` fixes it, ``"ball"`` bounds it; ``"auto"`` takes the sphere where the guess
        is clear of obstacles, the ball where it is not.
    between : str or None
        ``"plane"`` asks for one plane per interval, which separates the shapes at all poses of it; None looks at each
        point by itself. By default ``"plane"`` where the formulation can.
    broad_phase : float, optional
        Pairs that are farther apart than this at the guess are left out, interval by interval. `verify` looks at all.
    rule : callable, optional
        ``rule(block, *index)`` calls ``block.build(points, bodies=..., ...)``; for indexed blocks.

    Raises
    ------
    ObstacleError
        When the scene contradicts itself, naming the body; the block is then not added to the model.

    Notes
    -----
    For each pair and piece of motion the rows hold a proof that the shapes are apart: a direction ``n`` and a number
    ``c`` with ``n.q <= c`` for all points q of the second shape and ``n.p >= c + clearance`` for all p of the first,
    ``|n| <= 1``. Whatever a solver returns, such a proof errs on the safe side only.

    References
    ----------
    Zhang, Liniger & Borrelli, Optimization-Based Collision Avoidance, arXiv:1711.03449

    Examples
    --------
    >>> import pyomo.environ as pyo
    >>> import pyrobocop_pyomo as rcp
    >>> m = pyo.ConcreteModel()
    >>> m.move = rcp.PhaseBlock(duration=1.0, elements=10)
    >>> m.move.x, m.move.y = rcp.State(initial=0, final=4), rcp.State(initial=0, final=0)
    >>> m.move.avoid = rcp.ObstacleAvoidanceBlock(
    ...     m.move.time,
    ...     body=rcp.Polytope.box(0.5, 0.5),
    ...     pose=lambda b, t: rcp.planar_pose(b.x[t], b.y[t]),
    ...     obstacles={"wall": rcp.Polytope.box(1, 2, center=(2, 0))},
    ...     clearance=0.05,
    ... )
    >>> m.move.guess_straight_lines()  # through the wall: a guess may
    >>> m.move.avoid.initialize()
    >>> len(m.move.avoid.planes)  # one per interval
    10
    """

    def __init__(
        self,
        *points: Any,
        bodies: Any = None,
        obstacles: Any = None,
        clearance: Any = None,
        body: Any = None,
        pose: Rule | None = None,
        pairs: Any = None,
        exclude: Any = (),
        formulation: Any = "plane",
        norm: str = "auto",
        between: str | None = "auto",
        broad_phase: float | None = None,
        rule: Rule | None = None,
        **block_options: Any,
    ) -> None:
        options = {
            "bodies": bodies,
            "obstacles": obstacles,
            "clearance": clearance,
            "body": body,
            "pose": pose,
            "pairs": pairs,
            "exclude": exclude,
            "formulation": formulation,
            "norm": norm,
            "between": between,
            "broad_phase": broad_phase,
        }
        indexes, built_from = sort_arguments("an ObstacleAvoidanceBlock", points, options, rule)
        super().__init__(*indexes, **built_from, **block_options)

    @classmethod
    def _is_scalar(cls, args: tuple[Any, ...], keywords: Mapping[str, Any]) -> bool:
        return keywords.get("rule") is None or not args
