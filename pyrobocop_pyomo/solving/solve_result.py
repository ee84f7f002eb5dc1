"""What `solve` gives back: why it stopped and how good the point is are two separate answers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from textwrap import shorten
from typing import Any

from pyrobocop_pyomo.complementarity import PairResidual
from pyrobocop_pyomo.diagnosis import Diagnosis, Finding
from pyrobocop_pyomo.discretisation import DiscretisationEstimate, DiscretisationProbe
from pyrobocop_pyomo.errors import SolveFailed
from pyrobocop_pyomo.modeling.variable_values import checksum_of_model
from pyrobocop_pyomo.motion import SafetyReport
from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.mpcc.stationarity import Multipliers
from pyrobocop_pyomo.optional_imports import pandas
from pyrobocop_pyomo.presentation import Presented, disclosed_text, facts_table, table
from pyrobocop_pyomo.trajectories.trajectory import SOLVED

from .automatic_scaling import ScalingRecord
from .iterates import Iterate, Quality, Standing, StopReason, step_header
from .least_violation import LeastViolation
from .pair_report import ActiveSide, PairReport, pair_reports
from .result_findings import ModelReference, findings_of_outcome
from .result_pictures import draw_history, draw_pairs, draw_plan, draw_products
from .result_text import advice_on_motion, long_report, pair_sentence, pair_table
from .short_text import short_text
from .violations import Violation

# So many components that are not met are named in a text.
SHOWN_VIOLATIONS = 5
CHANGED = (
    "Variables or parameters of the model have other values than those of which this was found: whether its motion is "
    "safe is not known. Solve again, or ask verify() of its avoidance blocks."
)
# Why an error of the mesh is not known is said in so many characters; ``result.discretisation`` says all.
REMARK_CHARACTERS = 200


@dataclass(frozen=True, eq=False)
class SolveResult(Presented):
    """The answer of `solve`; the point itself is on the model, also after a failure.

    Attributes
    ----------
    name : str
        Name of the model.
    stop_reason : StopReason
        Why it stopped.
    quality : Quality
        How good the point is.
    best : Iterate
        The point on the model: which run it comes from, its recomputed residuals, its certificate.
    multipliers : Multipliers or None
        Of the pairs, in the order of `residuals`, and the kind of stationarity that they show.
    residuals : list of PairResidual
        Per pair, under its original name.
    steps : list of Iterate
        Every run of Ipopt, and every search by linear programs, in order; without values and multipliers.
    standing : Standing
        What decides between this result and another one.
    decided_pairs : int
        Pairs that bounds and fixed variables had decided before.
    solver : str
        Which Ipopt was used.
    derivatives : str
        Where its derivatives came from.
    checking_seconds : float
        Elapsed in recomputing residuals after each step.
    seconds : float
        Elapsed time in all, writing included.
    violations : tuple of Violation
        What an infeasible point does not meet: the worst of each component, the largest first.
    least_violation : LeastViolation or None
        Of an infeasible point: whether any point near it violates less, and which bounds, fixed values and rows stand
        against that; None for models that are large or have rows without derivatives.
    remarks : tuple of str
        What happened on the way that the user should know, such as an initial guess that could not be evaluated.
    doubts : tuple of Finding
        Why the point may not be what was meant although all residuals are small, such as phases that nothing joins;
        the first lines of the text say so.
    safety : SafetyReport or None
        How clear of obstacles the continuous motion is, and of the sides of regions that it is to stay in; None for
        a model without `ObstacleAvoidanceBlock` and `Containment`.
    rounds : sequence of PlanningRound
        What was done until the motion was safe.
    scenes : sequence of (array, list of BodyPath, list of Polytope)
        Of each avoidance block: times, the bodies' poses at these times, and what stands still; for pictures.
    scaling : ScalingRecord or None
        By what Ipopt saw variables, rows and the objective divided; None where it saw them as they are. All that is
        here is in the units of the model.
    probe : DiscretisationProbe or None
        From which `discretisation` is estimated.
    fingerprint : int or None
        Checksum of the values of the model when a motion was judged: with others `safe` is not known.
    model : ModelReference
        Called, it gives the model, as long as somebody else keeps it; see `diagnose`.
    rounding : IntegerRounding or None
        What became of integer controls: both objectives, and how far their integrals moved.
    """

    name: str
    stop_reason: StopReason
    quality: Quality
    best: Iterate
    multipliers: Multipliers | None = field(repr=False)
    residuals: list[PairResidual] = field(repr=False)
    steps: list[Iterate] = field(repr=False)
    standing: Standing = field(repr=False)
    decided_pairs: int
    solver: str
    derivatives: str
    checking_seconds: float
    seconds: float
    violations: tuple[Violation, ...] = ()
    least_violation: LeastViolation | None = None
    remarks: tuple[str, ...] = ()
    doubts: tuple[Finding, ...] = ()
    safety: SafetyReport | None = None
    rounds: Sequence[Any] = ()
    scenes: Sequence[Any] = field(default=(), repr=False)
    scaling: ScalingRecord | None = field(default=None, repr=False)
    probe: DiscretisationProbe | None = field(default=None, repr=False)
    rounding: Any = None
    fingerprint: int | None = field(default=None, repr=False)
    model: ModelReference = field(default_factory=ModelReference, repr=False)

    @property
    def objective(self) -> float:
        """The user's objective, recomputed."""
        return self.best.objective

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        raise AttributeError(
            f"a result has no '{name}'. Whether it is a solution: result.solved; why it ended: result.stop_reason, "
            "print(result). The values are on the model: phase.trajectory() has them as arrays, pyo.value(...) of a "
            "variable or expression gives one."
        )

    def __getitem__(self, name: Any) -> Any:
        raise TypeError(
            f"a result holds no values by name ({name!r}); they are on the model: phase.trajectory()[{name!r}]."
        )

    def diagnose(self) -> Diagnosis:
        """What `rcp.diagnose` finds in the model at the point of this result, after what the solve has found.

        Returns
        -------
        Diagnosis
            The outcome and each violation are findings about ``Subject.OUTCOME``. Where the model is gone, or after
            unpickling, there is nothing else.
        """
        verdict = f"{self._verdict} {self._why_it_ended}"
        least = () if self.least_violation is None else (str(self.least_violation),)
        remarks = (*least, *self.remarks)
        return findings_of_outcome(self.name, verdict, self.solved, self.violations, remarks, self.model())

    @property
    def discretisation(self) -> DiscretisationEstimate:
        """Errors that the mesh of the phases makes of the objective and of the motion, estimated when asked for."""
        return DiscretisationEstimate(self.objective, {}) if self.probe is None else self.probe.error()

    @property
    def errors_of_answer(self) -> DiscretisationEstimate:
        """The same where there is an answer: empty where rows are violated, and on the way to infinity."""
        judged = self.quality is not Quality.INFEASIBLE and self.stop_reason is not StopReason.DIVERGED
        return self.discretisation if judged else DiscretisationEstimate(self.objective, {})

    @property
    def constraint_violation(self) -> float:
        """Largest violation of a constraint or bound, recomputed from the model's expressions."""
        return self.best.constraint_violation

    @property
    def stationarity(self) -> float | None:
        """What is left of the first-order conditions, relative to what has to balance; None without multipliers."""
        return self.best.stationarity

    @property
    def certificate(self) -> Certificate:
        """Whether another branch through the point descends."""
        return self.best.certificate

    @property
    def strategy(self) -> str:
        """Which strategy found the point."""
        return self.best.strategy

    @property
    def best_step(self) -> int:
        """Place among the steps of the one that gave the point."""
        return self.best.number

    @property
    def safe(self) -> bool | None:
        """Whether all clearances are proven for the whole motion, that of the equations included.

        What is not known is not safe. None for a model without obstacles and regions, and where the model has other
        values of variables or parameters by now than the motion that was proven.
        """
        return None if self._has_changed else self._was_safe

    @property
    def _was_safe(self) -> bool | None:
        return None if self.safety is None else self.safety.safe and self.quality is not Quality.INFEASIBLE

    @property
    def _has_changed(self) -> bool:
        """Whether a motion was proven, and the model has other values by now."""
        model = self.model() if self._was_safe and self.fingerprint is not None else None
        return model is not None and checksum_of_model(model) != self.fingerprint

    @property
    def largest_product(self) -> float:
        """Largest ``|a b|`` over all pairs."""
        return max((abs(pair.product) for pair in self.residuals), default=0.0)

    @property
    def largest_natural_residual(self) -> float:
        """Largest ``|min(a, b)|`` over all pairs."""
        return max((abs(pair.natural) for pair in self.residuals), default=0.0)

    @property
    def iterations(self) -> int:
        """Ipopt's iterations in all steps together."""
        return sum(step.iterations for step in self.steps)

    @property
    def solved(self) -> bool:
        """True when the point is `Quality.OPTIMAL` and, where there are obstacles, the motion is proven to be safe."""
        return self.quality is Quality.OPTIMAL and self._was_safe is not False

    @property
    def outcome(self) -> str:
        """What trajectories say of it: "solved", "feasible", "infeasible", "NOT SAFE" or "DOUBTFUL"."""
        if self.quality is not Quality.OPTIMAL:
            return self.quality.name.lower()
        return "NOT SAFE" if self._was_safe is False else "DOUBTFUL" if self.doubts else SOLVED

    @cached_property
    def pairs(self) -> list[PairReport]:
        """Sides, multipliers and the zero side of every pair, in the order of `residuals`."""
        return pair_reports(self.residuals, self.multipliers)

    @property
    def biactive(self) -> list[PairReport]:
        """The pairs of which both sides are zero."""
        return [pair for pair in self.pairs if pair.active is ActiveSide.BIACTIVE]

    def table(self) -> str:
        """The pairs as a table in text."""
        return pair_table(self.pairs)

    def to_pandas(self) -> Any:
        """The pairs as a data frame, indexed by name."""
        facts = ("component", "index", "first", "second", "product", "natural", "active")
        columns = [*facts, "first_multiplier", "second_multiplier"]
        rows = [{name: getattr(pair, name) for name in columns} | {"active": pair.active.value} for pair in self.pairs]
        index = pandas.Index([pair.name for pair in self.pairs], name="pair", dtype=object)
        return pandas.DataFrame(rows, index=index, columns=columns)

    def steps_table(self) -> str:
        """The runs as a table in text."""
        pairs = bool(self.residuals)
        return "\n".join([step_header(pairs=pairs), *(step.line(pairs=pairs) for step in self.steps)])

    def rounds_table(self) -> str:
        """The rounds of planning around obstacles as a table in text."""
        return "\n".join([*(first.HEADER for first in self.rounds[:1]), *map(str, self.rounds)])

    def steps_to_pandas(self) -> Any:
        """The runs as a data frame, numbered from 1."""
        columns = ("label", "delta", "mu", "status", "iterations", "seconds", "objective")
        residuals = ("constraint_violation", "largest_product", "largest_natural_residual")
        rows = [
            {name: getattr(step, name) for name in (*columns, *residuals)}
            | {"status": "" if step.status is None else step.status.name}
            for step in self.steps
        ]
        return pandas.DataFrame(rows, index=pandas.RangeIndex(1, len(rows) + 1, name="step"))

    def report(self, worst: int = 5) -> str:
        """All that is known: verdict, errors of the mesh, residuals, runs; of pairs, counts, certificate and the worst.

        Parameters
        ----------
        worst : int
            How many pairs to show in each list.
        """
        summary = self._everything()
        return long_report(summary, self.pairs, self.multipliers, self.certificate, self.decided_pairs, worst)

    def plot(self, figure: Any = None) -> Any:
        """Draw what came out, and the way there; returns a figure.

        Where there are obstacles or regions: the scene, then the clearances that are required and proven over time.
        Last, and otherwise alone: objective, delta, mu and residuals over the iterations of all runs.
        """
        if self.safety is None:
            return draw_history(self.name, self.steps, self.best_step, figure)
        return draw_plan(self.name, self.scenes, self.safety, self._was_safe, self.steps, self.best_step, figure)

    def plot_pairs(self, component: str | None = None, *, axis_label: str | None = None, figure: Any = None) -> Any:
        """Draw both sides of the pairs of a component over its index.

        Parameters
        ----------
        component : str, optional
            Its name, such as ``"push.contact"``; not needed where there is only one.
        axis_label : str, optional
            What the index means, such as ``"time [s]"``.
        figure : Figure or SubFigure, optional
            Where to draw; a new figure by default.

        Returns
        -------
        matplotlib.figure.Figure or SubFigure

        Raises
        ------
        ModelError
            When there is no such component.
        """
        return draw_pairs(self.name, self.pairs, component, axis_label, figure)

    def plot_products(self, figure: Any = None) -> Any:
        """Draw largest product and natural residual of each run against its delta; returns a figure.

        Raises
        ------
        ModelError
            When no run had a delta.
        """
        return draw_products(self.name, self.steps, figure)

    def raise_for_status(self) -> None:
        """Do nothing when the point is optimal.

        Raises
        ------
        SolveFailed
            Otherwise, with both answers, the numbers and the remedy; the result is its attribute ``result``.
        """
        if self.solved:
            return
        if self.quality is Quality.OPTIMAL:
            assert self.safety is not None
            raise SolveFailed(
                f"'{self.name}': {self.quality.value} But the motion is not safe. "
                f"{self.advice_on_motion}\n{self.safety}",
                self,
            )
        motion = self.advice_on_motion and f" {self.advice_on_motion}"
        unmet = "".join(f" {violation}." for violation in self.violations[:SHOWN_VIOLATIONS])
        raise SolveFailed(
            f"'{self.name}': {self._why_it_ended} {self._verdict} Best point, kept on the model (step "
            f"{self.best_step + 1} of {len(self.steps)}): {self._residuals}.{unmet and f' Not met:{unmet}'}{motion}"
            + (f" {self.least_violation}" if self.least_violation is not None else "")
            + "".join(f" {remark}" for remark in self.remarks),
            self,
        )

    @property
    def _why_it_ended(self) -> str:
        if self.least_violation is not None and self.least_violation.is_proof:
            return "Ipopt found no point that meets all constraints, and there is none."
        return self.stop_reason.value

    @property
    def _verdict(self) -> str:
        return self.quality.sentence(pairs=bool(self.residuals))

    @property
    def _residuals(self) -> str:
        relative = self.best.relative_violation
        of_scale = "" if relative in (None, self.constraint_violation) else f" ({relative:.1e} of the rows' sizes)"
        pairs = f", max a*b {self.largest_product:.1e}, max min(a, b) {self.largest_natural_residual:.1e}"
        stationarity = "" if self.stationarity is None else f", stationarity {self.stationarity:.1e}"
        return f"constraints {self.constraint_violation:.1e}{of_scale}{pairs if self.residuals else ''}{stationarity}"

    @property
    def changed(self) -> str:
        """What is said where a motion was proven and the model has other values by now; empty otherwise."""
        return CHANGED if self._has_changed else ""

    @property
    def advice_on_motion(self) -> str:
        """What a motion that is not safe lacks, and what may help; empty where it is safe, or there is none."""
        return "" if self.safety is None or self._was_safe else advice_on_motion(self.safety)

    @property
    def _motion(self) -> str:
        """What is known of the motion, in few words; nothing without obstacles and regions."""
        if self._has_changed:
            return "changed since it was safe"
        return "" if self._was_safe is None else "safe" if self._was_safe else "NOT SAFE"

    def one_line(self) -> str:
        """Verdict, objective and violation, in a few words."""
        motion = f", {self._motion}" if self._motion else ""
        doubtful = ", DOUBTFUL" if self.doubts else ""
        # What a run that was cut short has reached says nothing of the problem.
        cut = {StopReason.INTERRUPTED: " when interrupted", StopReason.TIME_LIMIT: " at the time limit"}
        reached = f"{self.quality.name.lower()}{cut.get(self.stop_reason, '')}"
        return (
            f"'{self.name}': {reached}{motion}{doubtful}, objective {self.objective:.8g}, constraints "
            f"{self.constraint_violation:.1e}, {self.iterations} iterations"
        )

    def _summary(self) -> str:
        return self.one_line()

    def _html_parts(self) -> list[str]:
        facts = {
            "verdict": self._verdict,
            "stopped because": self._why_it_ended,
            "objective": f"{self.objective:.8g}",
            "residuals": self._residuals,
            "pairs": pair_sentence(self.pairs, self.multipliers, self.certificate) if self.residuals else None,
            "motion": self._motion or None,
            "doubtful": " ".join(f"{doubt.message} {doubt.remedy}" for doubt in self.doubts) or None,
            "effort": f"{self.iterations} iterations in {self.seconds:.2f} s",
        }
        unmet = [(str(violation),) for violation in self.violations]
        against = [] if self.least_violation is None else [(str(one),) for one in self.least_violation.obstructions]
        return [
            facts_table(facts),
            *([table(("not met, the worst of each component",), unmet)] if unmet else []),
            *([table(("what stands against it",), against)] if against else []),
            disclosed_text("report", self.report()),
        ]

    def __str__(self) -> str:
        return short_text(self)

    def _everything(self) -> str:
        mesh = self.errors_of_answer
        least, changed = self.least_violation, self._has_changed
        unmet = [f"  {violation}" for violation in self.violations[:SHOWN_VIOLATIONS]]
        if len(self.violations) > SHOWN_VIOLATIONS:
            unmet.append(f"  ... and of {len(self.violations) - SHOWN_VIOLATIONS} more components")
        return "\n".join(
            [
                f"{'NOT SAFE: ' if self._was_safe is False else ''}{'CHANGED: ' if changed else ''}"
                f"{'COARSE MESH: ' if mesh.is_large else ''}"
                f"{'DOUBTFUL: ' if self.doubts else ''}{self.name}: {self._verdict}",
                *([CHANGED] if changed else []),
                *(f"{doubt.message} {doubt.remedy}" for doubt in self.doubts),
                *(line for line in (mesh.sentence(), mesh.advice()) if line),
                *(shorten(remark, REMARK_CHARACTERS, placeholder=" ...") for remark in mesh.remarks),
                # A run that never began has neither.
                self._why_it_ended + (f" {self.solver}, derivatives by {self.derivatives}." if self.solver else ""),
                f"objective {self.objective:.8g}, {self._residuals}; "
                f"{self.iterations} iterations in {self.seconds:.2f} s",
                *(["Not met, the worst of each component:", *unmet] if unmet else []),
                *(least.lines() if least is not None else []),
                *([] if self.scaling is None else [str(self.scaling)]),
                *self.remarks,
                *([pair_sentence(self.pairs, self.multipliers, self.certificate)] if self.residuals else []),
                *([f"{self.safety}\n{self.rounds_table()}"] if self.safety is not None else []),
                self.steps_table(),
            ]
        )


def with_steps_of_all(result: SolveResult, results: Sequence[SolveResult]) -> SolveResult:
    """A result with the steps of several, of which it is one, numbered anew."""
    steps: list[Iterate] = []
    best = result.best
    for each in results:
        if each is result:
            best = replace(result.best, number=len(steps) + result.best.number)
        steps += [replace(step, number=len(steps) + k) for k, step in enumerate(each.steps)]
    return replace(result, steps=steps, best=best)
