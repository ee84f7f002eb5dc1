"""A linear program in which one side of each pair is zero: branch and bound over the sides.

No binary variables and no large constants: a node holds sides at zero by their bounds, and the linear program of a node
goes on from the basis of the one before. Its size is counted in nodes, which are the same on every machine.
"""

from __future__ import annotations

import heapq
import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.ipopt.c_output import c_output_muted
from pyrobocop_pyomo.numerics import BoolArray
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray

from .linear_programs import LinearProgram, LinearStatus

# A side this small counts as zero: HiGHS meets bounds no better.
ZERO_SIDE = 1e-7


@dataclass(frozen=True, eq=False)
class OpenSides:
    """One side of each pair that may be zero or positive, as a column: ``side = sign * (x[column] - zero)``."""

    column: NDArray[np.intp]
    sign: FloatArray
    zero: FloatArray

    def values(self, x: FloatArray) -> FloatArray:
        """Values of the sides at a point."""
        return self.sign * (x[self.column] - self.zero)


class BestSides(NamedTuple):
    """What a search found.

    Attributes
    ----------
    x : float array or None
        The best point found; None where there is none below the ceiling.
    cost : float
        Its cost, or the ceiling.
    a_zero : bool array
        Of the point: which pairs have their first side at zero.
    proven : bool
        Whether no other choice of sides is better, up to the gap.
    nodes : int
        Linear programs solved.
    """

    x: FloatArray | None
    cost: float
    a_zero: BoolArray
    proven: bool
    nodes: int


class _Node(NamedTuple):
    bound: float
    number: int
    a_zero: BoolArray
    b_zero: BoolArray


class PairTree:
    """The choices of sides for one linear program.

    Parameters
    ----------
    program : LinearProgram
        Without the condition that one side of each pair is zero; its bounds keep the sides nonnegative.
    a, b : OpenSides
        Of the pairs that may choose.
    nearest : bool array
        Which side is zero where the linear program leaves the choice open: True for a.
    time_limit : float
        Seconds, for everything that is requested of this object.
    """

    def __init__(
        self, program: LinearProgram, a: OpenSides, b: OpenSides, nearest: BoolArray, time_limit: float
    ) -> None:
        self._program, self._a, self._b, self._nearest = program, a, b, nearest
        self._end = time.perf_counter() + time_limit
        self._nodes = 0

    def cost_of(self, a_zero: BoolArray, b_zero: BoolArray) -> float:
        """The least cost with the sides as given; infinite where there is no point."""
        with c_output_muted():
            _, x = self._solved(a_zero, b_zero)
        return np.inf if x is None else float(self._program.cost @ x)

    def search(self, *, ceiling: float = np.inf, node_limit: int, gap: float = 1e-6) -> BestSides:
        """Look for the choice with the least cost below a ceiling.

        Parameters
        ----------
        ceiling : float
            Points of this cost or more are not looked for.
        node_limit : int
            Most linear programs.
        gap : float
            Relative distance from the optimum at which the search may stop.
        """
        # HiGHS now and then prints a line, whatever its options are.
        with c_output_muted():
            return self._search(ceiling, node_limit, gap)

    def _search(self, ceiling: float, node_limit: int, gap: float) -> BestSides:
        best: FloatArray | None = None
        cost, chosen, last = ceiling, self._nearest, self._nodes + node_limit
        none = np.zeros(self._nearest.size, dtype=bool)
        waiting, numbers = [_Node(-np.inf, 0, none, none)], 1
        proven, rounded = True, False
        while waiting:
            node: _Node | None = heapq.heappop(waiting)
            while node is not None and node.bound < cost - gap * abs(cost if np.isfinite(cost) else 0.0):
                if self._nodes >= last:
                    return BestSides(best, cost, chosen, False, self._nodes)
                status, x = self._solved(node.a_zero, node.b_zero)
                if status is LinearStatus.STOPPED:
                    proven = False
                if x is None:
                    break
                here = float(self._program.cost @ x)
                a, b = self._a.values(x), self._b.values(x)
                smaller = np.minimum(a, b)
                if smaller.max(initial=0.0) <= ZERO_SIDE:
                    if here < cost:
                        best, cost, chosen = x, here, self._choice(a, b, node)
                    break
                if not here < cost - gap * abs(cost if np.isfinite(cost) else 0.0):
                    break
                if not rounded and self._nodes < last:
                    # The choice that is nearest to the relaxed point is often good, and then prunes most of the rest.
                    rounded = True
                    a_zero = self._choice(a, b, node)
                    _, point = self._solved(a_zero, ~a_zero)
                    if point is not None and float(self._program.cost @ point) < cost:
                        best, cost, chosen = point, float(self._program.cost @ point), a_zero
                pair = int(smaller.argmax())
                with_a, with_b = node.a_zero.copy(), node.b_zero.copy()
                with_a[pair] = with_b[pair] = True
                first, second = _Node(here, numbers, with_a, node.b_zero), _Node(here, numbers, node.a_zero, with_b)
                if a[pair] > b[pair]:
                    first, second = second, first
                heapq.heappush(waiting, second._replace(number=-numbers))
                numbers += 1
                node = first
        return BestSides(best, cost, chosen, proven, self._nodes)

    def _choice(self, a: FloatArray, b: FloatArray, node: _Node) -> BoolArray:
        """Which first sides are zero at a point: the smaller ones, and where nothing decides, the nearest ones."""
        undecided = np.maximum(a, b) <= ZERO_SIDE
        chosen = np.where(undecided, self._nearest, a <= b)
        return (chosen | node.a_zero) & ~node.b_zero

    def _solved(self, a_zero: BoolArray, b_zero: BoolArray) -> tuple[LinearStatus, FloatArray | None]:
        left = self._end - time.perf_counter()
        if left <= 0.0:
            return LinearStatus.STOPPED, None
        self._nodes += 1
        lower, upper = self._program.lower.copy(), self._program.upper.copy()
        for sides, zero in ((self._a, a_zero), (self._b, b_zero)):
            # One column may be a side of several pairs: zero of the one may be far from zero of the other.
            np.maximum.at(lower, sides.column[zero], sides.zero[zero])
            np.minimum.at(upper, sides.column[zero], sides.zero[zero])
        return self._program.solve(lower, upper, time_limit=left)
