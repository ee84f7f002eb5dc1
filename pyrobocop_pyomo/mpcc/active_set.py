"""From a nearly complementary point to a B-stationary one, in finitely many branches.

The nonlinear program of the nearest branch is solved first, which makes the pairs exactly complementary. Then the
linear program with complementarity constraints says whether another branch through the point descends; if so, that
branch is solved, and so on. Every step is guarded: a point is replaced only by one that is no worse.
"""

from __future__ import annotations

import enum
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptOutcome, IpoptStatus
from pyrobocop_pyomo.modeling.deadline import NO_DEADLINE, Deadline
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, NonlinearProgram, PrimalDualPoint

from .lpec import Descent, steepest_branch
from .multipliers import opposing_multipliers
from .problem import Branch, ComplementarityProgram, Linearisation, nearest_branch, restricted, violation

# A linear program goes on from the basis of the last one: so many take about as long as one iteration of Ipopt.
NODES_PER_ITERATION = 10


class Certificate(enum.Enum):
    """Knowledge about descent at a point; the value is a sentence for points with pairs."""

    PROVEN = "B-stationary: no branch through the point has a direction of descent."
    DESCENT = "Not B-stationary: another branch through the point descends, but no better point was reached along it."
    UNKNOWN = "Not examined, or the search for a branch that descends ended at a limit of time or of linear programs."


@dataclass(frozen=True, eq=False)
class BranchPoint:
    """A point of a complementarity program, and the branch whose nonlinear program it solves.

    Attributes
    ----------
    point : PrimalDualPoint
        With multipliers of the rows and bounds of the program.
    objective : float
        Of the minimised problem.
    violation : float
        Largest violation of a row or bound.
    natural_residual : float
        Largest ``|min(a, b)|``.
    branch : Branch or None
    """

    point: PrimalDualPoint
    objective: float
    violation: float
    natural_residual: float
    branch: Branch | None = None

    @property
    def x(self) -> FloatArray:
        """Values of the variables."""
        return self.point.x

    @classmethod
    def at(cls, program: ComplementarityProgram, point: PrimalDualPoint, branch: Branch | None = None) -> BranchPoint:
        """Check a point by the program's own functions."""
        nlp, x = program.nlp, point.x
        return cls(point, nlp.objective(x), violation(nlp, x), program.natural_residual(x), branch)


class NlpSolver(Protocol):
    """Solves a nonlinear program from a point with multipliers."""

    def __call__(self, nlp: NonlinearProgram, start: PrimalDualPoint, iterations: int) -> IpoptOutcome:
        """Return how it ended, with the last point in any case; with at most so many iterations."""


@dataclass(frozen=True)
class Limits:
    """When a point is good enough and when to stop looking for a better one.

    Attributes
    ----------
    feasibility : float
        Largest violation of a row or a bound.
    descent : float
        Largest decrease per unit of length that still counts as none, relative to the objective's gradient.
    objective : float
        Smallest relative improvement that counts.
    radius : float
        First trust radius of the linear program.
    smallest_radius : float
        Where looking for descent ends.
    rounds : int
        Most branches solved.
    exchanges : int
        Most branches solved by `ActiveSetSearch.exchange`.
    lpec_seconds : float
        For one linear program with complementarity constraints.
    exploring_radii, polishing_radii : tuple of float
        Trust radii for the search beyond a B-stationary point, and for a branch at a point that was made exact.
    descent_gap : float
        Relative distance from its optimum at which a program may stop that says whether any branch descends: a
        direction nearly as good leads on too.
    descent_nodes : int
        Of the search tree for that question, and for a branch at a point that was made exact; without an answer the
        certificate is unknown.
    exploring_iterations : int
        For one branch of that search.
    polishing_iterations : int
        For any other branch.
    """

    feasibility: float = 1e-6
    descent: float = 1e-5
    objective: float = 1e-8
    radius: float = 1e-3
    smallest_radius: float = 1e-6
    rounds: int = 20
    exchanges: int = 40
    lpec_seconds: float = 5.0
    exploring_radii: tuple[float, ...] = (1.0, 3e1, 1e3)
    polishing_radii: tuple[float, ...] = (1e-4, 1e-3, 1e-2, 1e-1)
    descent_gap: float = 0.3
    descent_nodes: int = 500
    exploring_iterations: int = 200
    polishing_iterations: int = 300


@dataclass(eq=False)
class ExploredBranches:
    """Keys of branches that an exploration need not look at again.

    Attributes
    ----------
    tried : set
        Those that were solved.
    exhausted : set
        Those from whose solution nothing better was found.
    """

    tried: set[bytes] = field(default_factory=set)
    exhausted: set[bytes] = field(default_factory=set)


@dataclass(eq=False)
class ActiveSetSearch:
    """The finite search from branch to branch.

    Parameters
    ----------
    program : ComplementarityProgram
    solve : NlpSolver
    limits : Limits
    on_solve : callable, optional
        Told of each branch solved: what for, the outcome, the point, and whether it was kept.
    deadline : Deadline

    Attributes
    ----------
    certificate : Certificate
        Of the last point.
    certified : BranchPoint or None
        The last point from which no branch was found to descend.
    interrupted : bool
        Whether Ctrl-C ended the search; it returned the best point until then.
    linear_seconds : float
        Elapsed in linear programs since this was last set to zero.
    undecided : int
        Number of pairs that could choose a side where the last search for descent ended at a limit; 0 where it ended
        by itself.
    work_left : float
        Iterations of Ipopt that an exploration may still take, with linear programs counted as parts of one: the same
        on every machine.
    """

    program: ComplementarityProgram
    solve: NlpSolver
    limits: Limits = field(default_factory=Limits)
    on_solve: Callable[[str, IpoptOutcome, BranchPoint, bool], object] | None = None
    deadline: Deadline = NO_DEADLINE
    certificate: Certificate = Certificate.UNKNOWN
    certified: BranchPoint | None = None
    interrupted: bool = False
    linear_seconds: float = 0.0
    work_left: float = np.inf
    undecided: int = 0
    _last: IpoptOutcome | None = None
    _refused: list[BranchPoint] = field(default_factory=list)
    _tried_from: tuple[BranchPoint | None, set[bytes]] = (None, set())

    def polish(self, start: BranchPoint, *, only_nearest: bool = False) -> BranchPoint:
        """Solve the branch nearest to a point, or else, unless only that is wanted, one that a relaxed point is led to.

        The answer is kept if it is no worse.

        Where neither is, the better one is kept all the same: the start, whose pairs are met only loosely, is no point
        of the problem at all.
        """
        self._refused.clear()
        branch = nearest_branch(self.program, start.x)
        polished = self._go("polish", branch, start, start.x)
        relaxed = max(start.violation, start.natural_residual) > self.limits.feasibility
        if polished is None and relaxed and not only_nearest and not self._late():
            polished = self._polish_restored(start)
        return polished or min(self._refused, key=lambda refused: refused.objective, default=start)

    def _polish_restored(self, start: BranchPoint) -> BranchPoint | None:
        """Lead the point to where rows and pairs hold, and solve the branches that look best from there.

        Where none of them can be solved, as degenerate ones may not, that point is left: all is met exactly there.
        """
        x = self._restored(start)
        if x is None:
            return None
        point = Linearisation.at(self.program.nlp, x)
        for radius in self.limits.polishing_radii:
            nearby = self._steepest(point, radius)
            if nearby is not None and not self._late():
                found = self._go("polish", nearby.branch, start, x + nearby.step)
                if found is not None:
                    return found
        exact = BranchPoint.at(self.program, replace(start.point, x=x))
        if not self._no_worse(exact, start):
            return None
        if self.on_solve is not None and self._last is not None:
            self.on_solve("restored", replace(self._last, x=x, iterations=0, seconds=0.0), exact, True)
        return exact

    def _restored(self, start: BranchPoint) -> FloatArray | None:
        """The nearest point at which rows and pairs hold: each linear program looks less far than the one before.

        So what is left of the rows falls with its square, and the sides of pairs are chosen anew where that leads to
        rows that hold. None where some are left.
        """
        x, radius = start.x, max(1e-2, 10.0 * start.natural_residual)
        while radius >= self.limits.feasibility:
            point = Linearisation.at(self.program.nlp, x)
            nearby = self._steepest(point, radius, elastic=1e3 * point.slope)
            if nearby is None:
                return None
            x, radius = np.clip(x + nearby.step, self.program.nlp.x_lower, self.program.nlp.x_upper), 1e-2 * radius
        return x if violation(self.program.nlp, x) <= self.limits.feasibility else None

    def explore(
        self, start: BranchPoint, explored: ExploredBranches, deadline: Deadline, work: float = np.inf
    ) -> BranchPoint:
        """Try the branches that look best from a B-stationary point when the trust region reaches far.

        Linear programs that hold more and more sides name these branches; each improvement starts the search anew.

        Parameters
        ----------
        start : BranchPoint
        explored : ExploredBranches
            What need not be tried again; grows.
        deadline : Deadline
            Of the exploration.
        work : float
            Most iterations of Ipopt, and parts of one for linear programs; `work_left` says how many were left in the
            end.
        """
        within, self.deadline, self.work_left = self.deadline, deadline, work
        try:
            best: BranchPoint | None = start
            while best is not None and best.branch is not None and best.branch.key() not in explored.exhausted:
                start, key = best, best.branch.key()
                explored.tried.add(key)
                best = self._explored_from(start, explored.tried)
                if best is None and not self._late():
                    explored.exhausted.add(key)
            return start if best is None else best
        finally:
            self.deadline = within

    def _explored_from(self, best: BranchPoint, tried: set[bytes]) -> BranchPoint | None:
        """A better point that solves another branch, or None."""
        point = Linearisation.at(self.program.nlp, best.x)
        for radius in self.limits.exploring_radii:
            if self._late():
                return None
            nearby = self._steepest(point, radius, node_limit=0)  # a direction is wanted, no proof
            if nearby is None or nearby.branch.key() in tried or self._late():
                continue
            tried.add(nearby.branch.key())
            better = self._go("explore", nearby.branch, best, best.x + nearby.step)
            if better is not None and self._improves(better, best, point):
                return self.descend(better)
        return None

    def _steepest(self, point: Linearisation, radius: float, **choices: Any) -> Descent | None:
        """The linear program with complementarity constraints, in the time that is left."""
        if self.deadline.has_passed:
            return None
        started = time.perf_counter()
        try:
            deadline = self.deadline.within(self.limits.lpec_seconds)
            choices = {"node_limit": self.limits.descent_nodes, **choices}
            return steepest_branch(
                self.program, point, radius, deadline=deadline, on_nodes=self._count_nodes, **choices
            )
        except KeyboardInterrupt:
            self.interrupted = True
            return None
        finally:
            self.linear_seconds += time.perf_counter() - started

    def exchange(self, best: BranchPoint, reach: float) -> BranchPoint:
        """Change the branch of biactive pairs whose multipliers ask for it, as long as that is no worse.

        Where the gradients of what is active are independent, this needs no linear program: each multiplier says by
        itself whether its side should be released. It promises nothing; the multipliers at its end do.

        Parameters
        ----------
        best : BranchPoint
            The solution of its branch.
        reach : float
            A pair is biactive if its other side is at most this large.
        """
        tried: set[bytes] = set()
        for _ in range(self.limits.exchanges):
            if best.branch is None or self._late():
                break
            tried.add(best.branch.key())
            point = Linearisation.at(self.program.nlp, best.x)
            against = opposing_multipliers(self.program, point, best.branch, best.point, reach)
            asking = against > self.limits.feasibility * point.slope
            better = None
            for chosen in (asking, asking & (against == against.max(initial=0.0))):
                branch = Branch(best.branch.a_zero ^ chosen, best.branch.b_zero ^ chosen)
                if chosen.any() and branch.key() not in tried:
                    tried.add(branch.key())
                    better = self._go("exchange", branch, best, best.x)
                    if better is not None:
                        break
            if better is None:
                break
            best = better
        return best

    def descend(self, start: BranchPoint) -> BranchPoint:
        """Follow descending branches from a point that solves its own, until there is none; sets `certificate`."""
        self.certificate, self.undecided = Certificate.UNKNOWN, 0
        best, radius = start, self.limits.radius
        if best.branch is None or best.violation > self.limits.feasibility:
            return best
        point = Linearisation.at(self.program.nlp, best.x)
        # Exploration may have begun this search and run out of its time: what it tried leads nowhere again.
        tried = self._tried_from[1] if self._tried_from[0] is best else {best.branch.key()}
        for _ in range(self.limits.rounds):
            if self._late():
                return best
            # An interior-point solution is a little away from its bounds, and the linear program would gain that
            # distance in any branch: what counts is what another branch gains beyond this one.
            descent = self._steepest(
                point,
                radius,
                stay=best.branch,
                least_gain=self.limits.descent * point.slope,
                gap=self.limits.descent_gap,
            )
            if descent is None:
                return best
            if descent.gain <= self.limits.descent * point.slope:
                self.certificate = Certificate.PROVEN if descent.proven else Certificate.UNKNOWN
                self.undecided = 0 if descent.proven else descent.open_pairs
                self.certified = best if descent.proven else self.certified
                return best
            self.certificate = Certificate.DESCENT
            better = None
            if descent.branch.key() not in tried:
                better = self._go("descend", descent.branch, best, best.x + descent.step)
                if self._late() and better is None:
                    return best
                tried.add(descent.branch.key())
                self._tried_from = best, tried
            if better is not None and self._improves(better, best, point):
                best, radius = better, self.limits.radius
                point = Linearisation.at(self.program.nlp, best.x)
            else:
                radius *= 0.1
                if radius < self.limits.smallest_radius:
                    return best
        return best

    def _go(self, purpose: str, branch: Branch, start: BranchPoint, x: FloatArray) -> BranchPoint | None:
        """Solve a branch; None where its answer may not replace the start."""
        nlp = restricted(self.program, branch)
        limits = self.limits
        iterations = limits.exploring_iterations if purpose == "explore" else limits.polishing_iterations
        iterations = int(min(iterations, self.work_left))
        outcome = self.solve(nlp, replace(start.point, x=np.clip(x, nlp.x_lower, nlp.x_upper)), iterations)
        self._last = outcome
        self._count_work(outcome.iterations)
        self.interrupted |= outcome.status is IpoptStatus.INTERRUPTED
        if not np.isfinite(outcome.x).all():
            return None
        end = BranchPoint.at(self.program, outcome.point, branch)
        # Whatever else Ipopt says of it: a branch may be too degenerate to be called solved, and the point be good.
        cut = outcome.status in (IpoptStatus.TIME_LIMIT, IpoptStatus.INTERRUPTED, IpoptStatus.STOPPED)
        # A point on the way to infinity solves nothing, however low its objective is.
        diverged = outcome.status is IpoptStatus.DIVERGING
        kept = not diverged and self._no_worse(end, start) and not (cut and start.branch is not None)
        more_exact = start.branch is None and end.natural_residual < start.natural_residual
        if outcome.status.converged and not kept and more_exact and end.violation <= self.limits.feasibility:
            self._refused.append(end)
        if self.on_solve is not None:
            self.on_solve(purpose, outcome, end, kept)
        return end if kept else None

    def _no_worse(self, end: BranchPoint, start: BranchPoint) -> bool:
        """Feasible, or at least more so; and then complementary where the start was not, or of no larger objective."""
        if not end.violation <= max(self.limits.feasibility, start.violation):
            return False
        if start.violation > self.limits.feasibility >= end.violation:
            return True
        # A relaxed point is below what is possible, by its products times the multipliers of its pairs.
        allowance = 1e-7
        if end.natural_residual < start.natural_residual:
            allowance = 1e-2 if start.natural_residual > self.limits.feasibility else 1e-3
        return end.objective <= start.objective + allowance * max(1.0, abs(start.objective))

    def _improves(self, found: BranchPoint, best: BranchPoint, point: Linearisation) -> bool:
        return found.objective < best.objective - self.limits.objective * max(point.slope, abs(best.objective))

    def _count_work(self, iterations: float) -> None:
        self.work_left -= iterations

    def _count_nodes(self, nodes: int) -> None:
        self._count_work(nodes / NODES_PER_ITERATION)

    def _late(self) -> bool:
        return self.interrupted or self.deadline.has_passed or self.work_left < 1.0
