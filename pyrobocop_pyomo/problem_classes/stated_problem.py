"""`StatedProblem`: the methods of a problem class as rules of a phase."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from pyomo.common.numeric_types import native_numeric_types
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.base.var import Var
from pyomo.core.expr import Expr_if

from pyrobocop_pyomo.complementarity import complements
from pyrobocop_pyomo.errors import ExpressionArrayError, ProblemClassError
from pyrobocop_pyomo.modeling.expression_arrays import ArrayEntry, plain_entry, plain_scalar
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.rules.rule_template import Reading, TimeTemplate, asked_for_all_times

from .branching_time import BranchingTime, BranchInTime
from .explicit_rates import AffineRow, Membership, rates_of, rates_of_matrix, solvable_groups, solve_rows
from .methods import ARGUMENTS, WITH_PARAMETERS, Methods, finite_or_none
from .problem_arrays import ArrayToFill, ColumnArray, LazyEntry, RateEntry, Rates, column_array
from .problem_data import ProblemData, Side

# What stands for the time while a rule gives its formulas for all times.
_ALL_TIMES = (TimeTemplate, Reading)


@dataclass(frozen=True)
class _RowsAtPoint:
    """The rows of ``constraint`` at one point, and the derivatives that they give."""

    block: Any
    time: Any
    rows: list[AffineRow]
    explicit: dict[int, Any]
    used: frozenset[int]


class StatedProblem:
    """A problem class, asked at points of a phase that has its variables ``x0, x1, ..., y0, ..., u0, ..., p0, ...``.

    Attributes
    ----------
    problem : object
        The user's, unchanged.
    data : ProblemData
        Its sizes, bounds, guesses and pairs.
    solve_options : dict
        What `solve` is given for the treatment of pairs that was asked for; empty for this package's own.
    starts_on_a_stage : bool
        Whether equations hold where an element starts.
    """

    def __init__(
        self,
        problem: Any,
        methods: Methods,
        data: ProblemData,
        solve_options: Mapping[str, Any],
        *,
        starts_on_a_stage: bool = False,
    ) -> None:
        self.problem = problem
        self.starts_on_a_stage = starts_on_a_stage
        self.data = data
        self.solve_options = dict(solve_options)
        self._methods = methods
        # Derivatives in a row that is not affine in them are found by these.
        self._scratch = ConcreteModel()
        self._scratch.xdot = Var(range(data.sizes.states), initialize=1.0)
        self._explicit: tuple[int, ...] = ()
        self._solvable: tuple[Membership, ...] = ()
        self._last: _RowsAtPoint | None = None
        self._branch = BranchInTime(0.0, 0.0)

    def __deepcopy__(self, memo: dict[int, Any]) -> StatedProblem:
        return self  # nothing of a model is in it but what was asked last, which is evaluated anew

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_last": None}

    # ---------------------------------------------------------------- variables at a point

    def names(self, kind: str) -> list[str]:
        """Names of the phase's variables of a kind: ``x``, ``y``, ``u`` or ``p``."""
        sizes = self.data.sizes
        counts = {"x": sizes.states, "y": sizes.algebraics, "u": sizes.controls, "p": sizes.parameters}
        return [f"{kind}{j}" for j in range(counts[kind])]

    def variables(self, block: Any, kind: str, t: Any) -> ColumnArray:
        """Variables of a kind at a point, or parameters."""
        found = [getattr(block, name) for name in self.names(kind)]
        return column_array([ArrayEntry(one if kind == "p" else one[t]) for one in found])

    def _arguments(self, block: Any, t: Any, xdot: Any) -> list[Any]:
        x, y, u, p = (self.variables(block, kind, t) for kind in "xyup")
        return [x, column_array(xdot), y, u, p]

    def _call(self, name: str, *arguments: Any, shown: str) -> Any:
        """Ask a method, with the parameters if it takes them: they are the last of the arguments."""
        if name in WITH_PARAMETERS and self._methods.count(name) < ARGUMENTS[name]:
            arguments = arguments[:-1]
        return self._methods.call(name, *arguments, shown=shown)

    def _given(self, time: Any) -> Any:
        """The time as the class gets it."""
        return BranchingTime(time, self._branch) if isinstance(time, _ALL_TIMES) else time

    def _in_all_branches(self, ask: Callable[[], list[Any]], answers: tuple[bool, ...] = ()) -> list[Any]:
        """What a class gives for all times; where it compares the time, what it gives either way."""
        times = self.data.sizes.times
        branch = self._branch = BranchInTime(float(times[0]), float(times[-1]), answers)
        result = ask()
        for i in reversed(range(len(answers), len(branch.made))):
            condition, _ = branch.made[i]
            otherwise = self._in_all_branches(ask, (*(answer for _, answer in branch.made[:i]), False))
            result = [_chosen(condition, *pair) for pair in zip(result, otherwise, strict=True)]
        return result

    @staticmethod
    def _shown(time: Any) -> str:
        return "all t" if isinstance(time, _ALL_TIMES) else f"t = {time:g}"

    # ---------------------------------------------------------------- equations

    def find_explicit_states(self, block: Any) -> tuple[int, ...]:
        """States whose derivative the rows give at every point of the grid; remembered."""
        explicit = set(range(self.data.sizes.states))
        solvable: set[Membership] | None = None
        points = list(block.grid.points)
        for t in points[:1] if self._is_alike_at_all_times(block) else points:
            rows = self._rows(block, t)
            groups = solve_rows(rows)
            explicit &= {j for group in groups for j in group.states}
            found = solvable_groups(rows, groups)
            solvable = found if solvable is None else solvable & found
        self._solvable = tuple(sorted(solvable or ()))
        self._explicit = tuple(sorted(explicit.union(*(states for states, _ in self._solvable))))
        self._last = None
        return self._explicit

    def _is_alike_at_all_times(self, block: Any) -> bool:
        """Whether the class gives rows for all times at once, and the time is not in front of a derivative."""
        time = TimeTemplate()
        try:
            with asked_for_all_times():
                rows = self._rows(block, time)
        except Exception:  # a class that has to know the time may raise anything
            return False
        held = [a for row in rows for a in row.coefficients.values() if hasattr(a, "is_expression_type")]
        return all(row.is_affine for row in rows) and not any(
            isinstance(leaf, _ALL_TIMES) for a in held for leaf in variables_in(a)
        )

    @property
    def implicit(self) -> list[int]:
        """States whose derivatives stand in residual equations."""
        return [j for j in range(self.data.sizes.states) if j not in self._explicit]

    def _rows(self, block: Any, t: Any) -> list[AffineRow]:
        if isinstance(t, TimeTemplate):
            return self._in_all_branches(lambda: self._rows_of_branch(block, t))
        return self._rows_of_branch(block, t)

    def _rows_of_branch(self, block: Any, t: Any) -> list[AffineRow]:
        time = block.time_at(t)
        rates = Rates(list(self._scratch.xdot.values()))
        filled = self._filled(block, t, time, rates.entries())
        rows = []
        for entry in filled:
            if isinstance(entry, RateEntry):
                coefficients = {j: a for j, a in entry.coefficients.items() if not _is_zero(a)}
                rows.append(AffineRow(entry.constant, coefficients))
            else:
                rows.append(AffineRow(plain_entry(entry), {}))
        if not rates.not_affine:
            return rows
        own = {id(variable) for variable in self._scratch.xdot.values()}
        return [row if not _reads(row, own) else AffineRow(row.constant, row.coefficients, False) for row in rows]

    def _filled(self, block: Any, t: Any, time: float, xdot: Any) -> list[Any]:
        """The rows that ``constraint`` makes, as entries."""
        count, shown = self.data.sizes.rows, f"c, {self._shown(time)}, ..."
        c = ArrayToFill.zeros((count, 1))
        returned = self._call("constraint", c, self._given(time), *self._arguments(block, t, xdot), shown=shown)
        given = c if returned is None else np.asarray(returned, dtype=object)
        what = f"{self._methods.class_name}.constraint({shown})"
        if given.size != count:
            raise ProblemClassError(
                f"{what} returned {given.size} rows; n_d + n_a - n_cc = {count} are expected, filled into c."
            )
        entries = list(np.asarray(given).ravel())
        for i, entry in enumerate(entries):
            if not isinstance(entry, ArrayEntry):
                raise ProblemClassError(
                    f"{what}: row {i} of {count} (counted from 0) is the number {entry}, no equation in the variables. "
                    "Fill every row of c, or correct the counts of get_info."
                )
        return entries

    def _at(self, block: Any, t: Any) -> _RowsAtPoint:
        """Rows at a point; those asked last are kept, because several rules need them."""
        time = block.time_at(t)
        last = self._last
        if last is not None and last.block is block and _same_time(last.time, (t, time)):
            return last
        rows = self._rows(block, t)
        explicit: dict[int, Any] = {}
        used: set[int] = set()
        for group in solve_rows(rows):
            if any(j in self._explicit for j in group.states):
                explicit |= rates_of(group, rows)
                used |= set(group.rows)
        known = dict(explicit)
        for states, members in self._solvable:
            if not used & set(members) and all(set(rows[i].coefficients) & set(states) for i in members):
                explicit |= rates_of_matrix((states, members), rows, known)
                used |= set(members)
        missing = [j for j in self._explicit if j not in explicit]
        if missing:
            raise ProblemClassError(
                f"{self._methods.class_name}.constraint at {self._shown(time)}: the rows do not give xdot{missing}, as "
                "they do at all points of the grid. The form of the equations may change with t at element boundaries "
                "only."
            )
        self._last = _RowsAtPoint(block, (t, time), rows, explicit, frozenset(used))
        return self._last

    def equations_of_motion(self, block: Any, t: Any) -> dict[Any, Any]:
        """Derivatives that the rows give."""
        rates = self._at(block, t).explicit
        return {getattr(block, f"x{j}"): rates[j] for j in self._explicit}

    def equations(self, block: Any, t: Any) -> list[Any]:
        """The other rows."""
        return self._other_rows(block, t)

    def _other_rows(self, block: Any, t: Any) -> list[Any]:
        at = self._at(block, t)
        derivative = {j: self._rate(block, t, j) for j in range(self.data.sizes.states)}
        exact: list[Any] | None = None
        found = []
        for i, row in enumerate(at.rows):
            if i in at.used:
                continue
            if not row.is_affine and exact is None:
                # Its derivatives are inside of functions: asked once more, with these themselves.
                exact = self._filled(
                    block, t, block.time_at(t), [ArrayEntry(derivative[j]) for j in sorted(derivative)]
                )
            if row.is_affine:
                left = row.constant + sum(a * derivative[j] for j, a in row.coefficients.items())
            else:
                assert exact is not None
                left = plain_entry(exact[i])
            found.append(left == 0)
        # A group that is explicit here may hold states that elsewhere are implicit.
        found += [derivative[j] - rate == 0 for j, rate in at.explicit.items() if j not in self._explicit]
        return found

    def _rate(self, block: Any, t: Any, j: int) -> Any:
        """A derivative: the right-hand side where there is one, otherwise a variable."""
        if j in self._explicit:
            return self._at(block, t).explicit[j]
        return block.derivative(f"x{j}")[t]

    def rates(self, block: Any, t: Any) -> list[LazyEntry]:
        """All derivatives, computed where they are read."""
        return [LazyEntry(partial(self._rate, block, t, j)) for j in range(self.data.sizes.states)]

    # ---------------------------------------------------------------- costs

    def running_cost(self, block: Any, t: Any) -> Any:
        """What ``objective`` returns at a point."""
        if self._is_template(t):
            return self._in_all_branches(lambda: [self._cost_of_branch(block, t)])[0]
        return self._cost_of_branch(block, t)

    @staticmethod
    def _is_template(t: Any) -> bool:
        return isinstance(t, TimeTemplate)

    def _cost_of_branch(self, block: Any, t: Any) -> Any:
        time = block.time_at(t)
        shown = f"{self._shown(time)}, ..."
        cost = self._call("objective", self._given(time), *self._arguments(block, t, self.rates(block, t)), shown=shown)
        return self._scalar(cost, f"{self._methods.class_name}.objective({shown})")

    def final_cost(self, block: Any) -> Any:
        """What ``objective_mayer`` returns; 0 where there is none."""
        if not self._methods.has("objective_mayer"):
            return 0.0
        grid = block.grid
        columns = [[ArrayEntry(block.component(name)[t]) for name in self.names("x")] for t in grid.node_times[0]]
        first = column_array(columns[0], columns)
        last = self.variables(block, "x", grid.times[-1])
        cost = self._call("objective_mayer", first, last, self.variables(block, "p", None), shown="x0, xf, p")
        return self._scalar(cost, f"{self._methods.class_name}.objective_mayer(x0, xf, p)")

    @staticmethod
    def _scalar(cost: Any, label: str) -> Any:
        if cost is None:
            raise ProblemClassError(f"{label} returned None. Is the return statement missing?")
        if isinstance(cost, (list, tuple)):
            cost = np.array(cost, dtype=object)
        try:
            return plain_scalar(cost, label)
        except ExpressionArrayError as error:
            raise ProblemClassError(str(error)) from None

    # ---------------------------------------------------------------- pairs and bounds on rates

    def pairs(self, block: Any, t: Any) -> list[Any]:
        """The complementarity pairs at a point."""
        return [
            complements(self._side(block, t, first), self._side(block, t, second)) for first, second in self.data.pairs
        ]

    def _side(self, block: Any, t: Any, side: Side) -> Any:
        variable = getattr(block, f"y{side.algebraic}")[t]
        table = self.data.bounds["y"][:, :-1, side.algebraic]
        i = 0 if (table == table[:, :1]).all() else self.element_at(block, t)
        lower, upper = table[:, i].tolist()
        return variable >= lower if side.bound == "lower" else variable <= upper

    def rate_bounds(self, block: Any, t: Any) -> list[Any]:
        """Bounds on derivatives that change from element to element."""
        i = self.element_at(block, t)
        found = []
        for j in self.states_with_varying_rate_bounds:
            lower, upper = map(finite_or_none, self.data.bounds["xdot"][:, i, j].tolist())
            rate = self._rate(block, t, j)
            found += [] if lower is None else [rate >= lower]
            found += [] if upper is None else [rate <= upper]
        return found

    @property
    def states_with_varying_rate_bounds(self) -> list[int]:
        """States whose bounds on the derivative are not the same in every element."""
        table = self.data.bounds["xdot"][:, :-1]
        return [j for j in range(self.data.sizes.states) if (table[:, :, j] != table[:, :1, j]).any()]

    def element_at(self, block: Any, t: Any) -> int:
        """Index of the element that a time belongs to: to the one that ends there, at a boundary."""
        return self.element_at_time(block.time_at(t))

    def element_at_time(self, time: float) -> int:
        """The same for a time."""
        times = self.data.sizes.times
        side: Any = "right" if self.starts_on_a_stage else "left"
        return int(np.clip(np.searchsorted(times, time, side=side) - 1, 0, self.data.sizes.elements - 1))


def _chosen(condition: Any, then: Any, otherwise: Any) -> Any:
    """What two ways of a branch make of one row or of one cost."""
    if isinstance(then, AffineRow):
        rates = {*then.coefficients, *otherwise.coefficients}
        both = {j: (then.coefficients.get(j, 0.0), otherwise.coefficients.get(j, 0.0)) for j in rates}
        return AffineRow(
            _chosen(condition, then.constant, otherwise.constant),
            {j: _chosen(condition, *pair) for j, pair in both.items()},
            then.is_affine and otherwise.is_affine,
        )
    alike = all(part.__class__ in native_numeric_types for part in (then, otherwise)) and then == otherwise
    return then if alike else Expr_if(condition, then, otherwise)


def _same_time(first: tuple[Any, Any], second: tuple[Any, Any]) -> bool:
    if isinstance(first[0], TimeTemplate) or isinstance(second[0], TimeTemplate):
        return first[0] is second[0]
    return first == second


def _is_zero(coefficient: Any) -> bool:
    return isinstance(coefficient, (int, float)) and coefficient == 0


def _reads(row: AffineRow, own: set[int]) -> bool:
    parts = [part for part in (row.constant, *row.coefficients.values()) if hasattr(part, "is_expression_type")]
    return any(id(variable) in own for part in parts for variable in variables_in(part))
