"""`PersistentNLP`: one model solved again and again, as a receding horizon does it.

A plan moved ahead in time on its own grid, by weights that are found once for each distance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyomo.core.base.block import BlockData

from pyrobocop_pyomo.complementarity import BarrierSchedule, delta_of, shifted_rows_of
from pyrobocop_pyomo.errors import ComplementarityError
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptOutcome, IpoptStatus
from pyrobocop_pyomo.ipopt.ipopt_run import KeptProblem, run_ipopt
from pyrobocop_pyomo.ipopt.suffixes import InProcessSolutionLoader
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.numerics import Array, Grid
from pyrobocop_pyomo.phases.nodes import IntervalNodes, KnotNodes, Nodes, StateNodes
from pyrobocop_pyomo.phases.phase_values import PhaseValues, read_values, sample_times
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, NonlinearProgram, PrimalDualPoint
from pyrobocop_pyomo.programs.wrapped_programs import AddedQuadraticCost, QuadraticCost, ShiftedRows
from pyrobocop_pyomo.solving.ipopt_options import warm_start
from pyrobocop_pyomo.solving.session import DeltaFollowsBarrier


class PersistentNLP:
    """A model that is prepared once and solved many times, each time from the last solution.

    A solve that fails leaves its last point on the model, but does not spoil the next one: that starts from the last
    solution again, unless the values on the model were changed in between. With `go_on_after_limit` a solve that
    reached its iteration limit has not failed: the next one goes on where it stopped.

    Between two solves, change what is a number: values of fixed variables, mutable Params, bounds, values of
    variables. What changes the structure (fixing, unfixing, adding, replacing, activating, deactivating, another
    sense of the objective) makes the next solve prepare the model again and start it cold.

    Parameters
    ----------
    model : Block
        Continuous, with at most one active objective. Complementarity has to be relaxed before.
    options : mapping, optional
        Ipopt's options for every solve.
    barrier : schedule with ``delta_for``, optional
        How delta follows the barrier parameter, as `FollowBarrier` says it. The model has to be relaxed by rows that a
        delta shifts; the delta of the model is then not read.
    quadratic : QuadraticCost, optional
        Added to the objective; its numbers may change between two solves.
    go_on_after_limit : bool
        Whether the next solve goes on, warm, from where an iteration limit stopped the last one.

    Attributes
    ----------
    model : Block
    compiled : CompiledModel
        The model as numbers, with its variables, constraints and objective in the order of the program.
    program : NonlinearProgram
        What Ipopt is given.
    outcome : IpoptOutcome or None
        The last one, with multipliers in Ipopt's signs.
    barrier : schedule or None
        As given; another one may take its place between two solves.
    preparations : int
        How often the model was prepared: 1 as long as only numbers changed.

    Raises
    ------
    ModelError
        When the model is not continuous, has several objectives or no free variables.
    ComplementarityError
        When delta is to follow the barrier parameter, and there are no rows that it shifts.
    SolverNotFoundError
        When CasADi or an Ipopt library is missing.

    Examples
    --------
    >>> import pyomo.environ as pyo
    >>> from pyrobocop_pyomo.studies import PersistentNLP
    >>> m = pyo.ConcreteModel()
    >>> m.start, m.x = pyo.Param(initialize=1.0, mutable=True), pyo.Var(initialize=0.0)
    >>> m.cost = pyo.Objective(expr=(m.x - m.start) ** 2)
    >>> nlp = PersistentNLP(m)
    >>> for start in (1.0, 2.0):
    ...     m.start = start
    ...     print(nlp.solve().status.solved, round(m.x.value, 6))
    True 1.0
    True 2.0
    """

    def __init__(
        self,
        model: BlockData,
        options: Mapping[str, Any] | None = None,
        *,
        barrier: BarrierSchedule | None = None,
        quadratic: QuadraticCost | None = None,
        go_on_after_limit: bool = False,
    ) -> None:
        self.model = model
        self._go_on_after_limit = go_on_after_limit
        self.preparations = 0
        self._options = dict(options or {})
        self.barrier, self._quadratic = barrier, quadratic
        self._kept = KeptProblem()
        self.prepare()

    def prepare(self) -> None:
        """Walk over the model again, whatever has changed on it; the next solve starts without multipliers."""
        self.compiled = CompiledModel(self.model, "vectorised")
        self._forget()

    def update(self) -> None:
        """Read the numbers on the model again, as each solve does; a model of another structure is prepared anew."""
        before = self.compiled.nlp
        self.compiled.update()
        if self.compiled.nlp is not before:
            self._forget()
        if self._added is not None:
            self._added.read_fixed()

    def _forget(self) -> None:
        """A model of another structure has another program: multipliers of the old one mean nothing there."""
        self.outcome: IpoptOutcome | None = None
        self._goes_on_from: PrimalDualPoint | None = None
        self.preparations += 1
        self.program: NonlinearProgram = self.compiled.nlp
        self._added: AddedQuadraticCost | None = None
        if self._quadratic is not None:
            self.program = self._added = AddedQuadraticCost(self.program, self.compiled.variables, self._quadratic)
        self._shifted: ShiftedRows | None = None
        if self.barrier is not None:
            rows = self.compiled.numbers_of(shifted_rows_of(self.model))
            if not rows.size:
                raise ComplementarityError(
                    f"'{self.model.name}': delta cannot follow the barrier parameter: no row of the model is shifted "
                    "by delta. Apply pyrobocop.relax_complementarity with a relaxation such as 'scholtes' first."
                )
            self.program = self._shifted = ShiftedRows(self.program, rows, base=delta_of(self.model).value)

    @property
    def state(self) -> PrimalDualPoint | None:
        """Where a warm solve goes on: copies of the point, of the rows' and of the bounds' multipliers.

        None before the first solve that ended with a usable point. `restore` takes it in, also in another process whose
        model was built in the same way.
        """
        point = self._goes_on_from
        if point is None:
            return None
        return PrimalDualPoint(
            self._warm_values(point, self.compiled.current_point()), *map(np.copy, point.complete(self.program))
        )

    def _warm_values(self, good: PrimalDualPoint, here: FloatArray) -> FloatArray:
        """The values on the model; those of the last solution where a solve failed and nobody changed them since."""
        last = self.outcome
        failed = last is not None and last.x is not good.x
        return np.copy(good.x) if failed and last is not None and np.array_equal(here, last.x) else here

    @property
    def goes_on_from_last_point(self) -> bool:
        """Whether the last solve ended with a point that the next one can go on from."""
        last = self.outcome
        return last is not None and self._goes_on_from is not None and last.x is self._goes_on_from.x

    def restore(self, state: PrimalDualPoint) -> None:
        """Go on from a state that `state` gave out: its point is put on the model, its multipliers start the next
        solve.

        Parameters
        ----------
        state : PrimalDualPoint
            Without multipliers for a cold start from its point.

        Raises
        ------
        ValueError
            When the state is one of a model with other numbers of variables or rows.
        """
        self.outcome = None
        self._goes_on_from = None
        rows = np.shape(state.complete(self.program)[0])
        if np.shape(state.x) != (self.program.n,) or rows != (self.program.m,):
            raise ValueError(
                f"'{self.model.name}': the state has {np.size(state.x)} variables and {rows[0]} rows; the model has "
                f"{self.program.n} and {self.program.m}. Restore states of models that were built in the same way."
            )
        self.compiled.load_point(state.x)
        if state.g_multipliers is not None:
            self._goes_on_from = PrimalDualPoint(np.copy(state.x), *map(np.copy, state.complete(self.program)))

    def options_of_run(self, purpose: Mapping[str, Any], options: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Ipopt's options of a run for a purpose, such as a warm start, with further ones of the user's."""
        return {**purpose, **self._options, **(options or {})}

    def solve(
        self,
        options: Mapping[str, Any] | None = None,
        *,
        warm: bool = True,
        mu: float = 1e-4,
        mu_target: float | None = None,
        time_limit: float | None = None,
        start: FloatArray | None = None,
    ) -> IpoptOutcome:
        """Solve with the numbers that stand on the model now, and put the last point on it.

        Parameters
        ----------
        options : mapping, optional
            Ipopt's options for this solve; they win over those of the model and of the warm start.
        warm : bool
            Start with the multipliers of the last solve that succeeded, from the point
            on the model; where that is still the last point of a solve that failed, from the last solution.
        mu : float
            Ipopt's first barrier parameter in a warm start: the smaller, the closer to the last solution.
        mu_target : float, optional
            Solve the barrier problem of this parameter, from the first iteration on, instead of the problem itself.
            With `barrier`, delta is what belongs to this parameter.
        time_limit : float, optional
            Seconds.
        start : float array, optional
            Values to start from instead, in the order of the program, after an `update`: numbers are not read again.

        Returns
        -------
        IpoptOutcome
            Whatever stopped Ipopt; ask ``outcome.status.solved``.

        Raises
        ------
        ModelError
            When the model makes no sense any more.
        InfeasibleConstraintException
            When a row without free variables contradicts itself.
        """
        if start is None:
            self.update()  # also before the first solve: numbers may have changed since the model was prepared
        good, here = self._goes_on_from if warm else None, self.compiled.nlp.x_start
        purpose: dict[str, Any] = {}
        if good is None:
            point = PrimalDualPoint(here if start is None else start)
        else:
            point = replace(good, x=self._warm_values(good, here) if start is None else start)
            purpose = warm_start(mu)
        if mu_target is not None:
            # Without damping: it would move the solution by 1e-5 mu, and Ipopt would end in steps that are too small.
            barrier_problem = {"mu_strategy": "monotone", "mu_init": mu_target, "mu_target": mu_target, "kappa_d": 0.0}
            purpose = {**purpose, **barrier_problem}
        resolved = self.options_of_run(purpose, options)
        follow = None
        if self._shifted is not None and self.barrier is not None:
            follow = DeltaFollowsBarrier(self._shifted, self.barrier, resolved, None)
        deadline = Deadline.after(time_limit)
        self.outcome = run_ipopt(self.program, resolved, point, deadline=deadline, on_iteration=follow, kept=self._kept)
        stopped = self._go_on_after_limit and self.outcome.status is IpoptStatus.ITERATION_LIMIT
        usable = self.outcome.status.solved or stopped
        if usable and all(np.isfinite(values).all() for values in self.outcome.point.complete(self.program)):
            self._goes_on_from = self.outcome.point
        InProcessSolutionLoader(self.compiled, self.outcome).load_solution()
        return self.outcome


# -------------------------------------------------------------------------------------------------- shifted warm starts


Move = Callable[[Array], Array]


class ShiftedPlan:
    """Values of a phase read later: what `PhaseValues.sampled` gives for its own trajectory, at other times.

    Parameters
    ----------
    phase : PhaseBlock
        With fixed times.
    values : PhaseValues
        Of the phase.
    """

    def __init__(self, phase: Any, values: PhaseValues) -> None:
        self._phase, self._values = phase, values
        # A controller has one distance, or a few that its clock gives.
        self._moves_for = lru_cache(maxsize=8)(self.moves)

    def ahead(self, values: Mapping[str, Array], advance: float) -> dict[str, Array]:
        """The values that stand `advance` later in a plan; beyond its end the last ones.

        Parameters
        ----------
        values : mapping of name to array
            As `PhaseValues.read` gives them.
        advance : float
            In the time of the phase.
        """
        moves = self._moves_for(advance)
        return {name: moves[name](found) for name, found in values.items()}

    def moves(self, advance: float) -> dict[str, Move]:
        """What `ahead` does with the values of each name: a linear function of them."""
        alike: dict[tuple[type, tuple[float, ...]], Move] = {}
        moves = {}
        for name, nodes in self._values.nodes.items():
            key = type(nodes), nodes.times
            if key not in alike:
                alike[key] = _move(self._phase.grid, nodes, advance)
            moves[name] = alike[key]
        return moves


def _move(grid: Grid, nodes: Nodes, advance: float) -> Move:
    times = sample_times(grid, nodes, lambda t: t + advance)
    if isinstance(nodes, KnotNodes):
        return lambda values: np.interp(times, nodes.times, values)
    boundaries = np.array(grid.mesh.boundaries)
    element = np.clip(np.searchsorted(boundaries, times, side="left") - 1, 0, grid.mesh.elements - 1)
    if isinstance(nodes, IntervalNodes):
        interval = nodes.of_elements[element]
        return lambda values: nodes.from_samples(values[interval])
    local = np.clip((times - boundaries[element]) / grid.mesh.widths[element], 0.0, 1.0)
    if isinstance(nodes, StateNodes):
        weights, positions = grid.scheme.state_at(local), grid.node_positions[element]
    else:
        weights, positions = grid.scheme.stage_polynomial_at(local), grid.stage_positions[element]
    return lambda values: np.einsum("tk,tk->t", weights, values[positions])


class PlaceInProgram:
    """Where the values of a phase stand among the variables of a program.

    Parameters
    ----------
    values : PhaseValues
    variables : sequence of VarData
        Of the program.

    Attributes
    ----------
    columns : dict of str to int array
        Of each name of the phase; -1 for what is no variable of the program.
    """

    def __init__(self, values: PhaseValues, variables: Sequence[Any]) -> None:
        self.variables = variables
        column_of = {id(variable): column for column, variable in enumerate(variables)}
        self.columns: dict[str, NDArray[np.intp]] = {}
        self._others: dict[str, list[Any]] = {}
        for name, own in values.variables.items():
            self.columns[name] = np.array([column_of.get(id(variable), -1) for variable in own], dtype=np.intp)
            self._others[name] = [variable for variable in own if id(variable) not in column_of]

    def read(self, x: FloatArray) -> dict[str, Array]:
        """The values of the phase at a point of the program; what is no variable of it is read from the model.

        Raises
        ------
        TrajectoryError
            When that has no value.
        """
        found = {}
        for name, columns in self.columns.items():
            numbers = x[columns]
            if others := self._others[name]:
                numbers[columns < 0] = read_values(others)
            found[name] = numbers
        return found

    def put(self, values: Mapping[str, Array], x: FloatArray) -> None:
        """Put values of the phase into a point; what is no variable of the program, and not fixed, into the model."""
        for name, numbers in values.items():
            columns = self.columns[name]
            is_free = columns >= 0
            x[columns[is_free]] = numbers[is_free]
            for variable, number in zip(self._others[name], numbers[~is_free].tolist(), strict=True):
                if not variable.fixed:
                    variable.set_value(number, skip_validation=True)
