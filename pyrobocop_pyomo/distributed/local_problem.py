"""The problem of one agent, where it is solved: built once, solved every round, never sent anywhere."""

from __future__ import annotations

import time
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.param import Param
from pyomo.core.base.var import Var, VarData
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.complementarity import FollowBarrier, active_sources, relax
from pyrobocop_pyomo.errors import EvaluationError, TeamError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.phases import Control, phases_of
from pyrobocop_pyomo.programs.nonlinear_program import PrimalDualPoint
from pyrobocop_pyomo.programs.wrapped_programs import QuadraticCost
from pyrobocop_pyomo.studies.persistent_nlp import PersistentNLP

from .agents import Agent, KeepApart, Shared
from .merging import merge_agents, variable_numbers, variables_behind
from .rounds import Order, ProblemFacts, QuantityFacts, Report

FAR_AWAY = 1e3  # metres: where a neighbour stands that a robot does not have
DELTA = FollowBarrier(floor=1e-9, factor=2.0)
# No loosened bounds: the two sides of a pair could both become slightly negative. The first point is feasible with
# respect to bounds, and small multipliers suit pairs better than ones.
# Damping keeps what only its barrier bounds from wandering off: the slip speed of a robot without contact.
IPOPT_OPTIONS = {"bound_relax_factor": 0.0, "kappa_d": 1e-5, "print_level": 0}


@dataclass(frozen=True)
class ProblemSpec:
    """How a problem is built, in a form that can be sent to where it is solved.

    Attributes
    ----------
    name : str
    agents : tuple of Agent
        Whose models are merged into one; one agent in the simplest case.
    shared : tuple of (number, Shared, names)
        What it shares: the number of each `Shared` in the team, and the names of the components in this model.
    keep_apart : KeepApart or None
    neighbours : int
        How many others it keeps away from.
    plan : tuple of str
        Names of the components that its plan has.
    """

    name: str
    agents: tuple[Agent, ...]
    shared: tuple[tuple[int, Shared, tuple[str, ...]], ...]
    keep_apart: KeepApart | None = None
    neighbours: int = 0
    plan: tuple[str, ...] = ()

    def build(self) -> LocalProblem:
        """Build the model, here."""
        return LocalProblem(self)


class LocalProblem:
    """A model with a quadratic cost in its shared variables, solved warm in every round.

    Parameters
    ----------
    spec : ProblemSpec

    Attributes
    ----------
    model : ConcreteModel

    Raises
    ------
    TeamError
        When the model lacks a named variable.
    """

    def __init__(self, spec: ProblemSpec) -> None:
        self.spec = spec
        self._merged = merge_agents(spec.agents, [name for _, _, names in spec.shared for name in names])
        self.model = self._merged.model
        self._quantities: list[QuantityFacts] = []
        self._variables: list[Any] = []
        for group, shared, names in spec.shared:
            self._share(group, shared, [variable for name in names for variable in self._variables_of(name)])
        self.cost = QuadraticCost(self._variables)
        rule = spec.keep_apart
        self._coordinates = [] if rule is None else [self._coordinate(name) for name in rule.components]
        if rule is not None and spec.neighbours:
            self._keep_apart(rule, spec.neighbours)
        self.plan()  # refuses names of nothing
        self._later: tuple[list[Any], list[int]] | None = None
        self._has_pairs = bool(active_sources(self.model))
        if self._has_pairs:
            relax(self.model, delta=1.0)
        barrier = DELTA if self._has_pairs else None
        self.nlp = PersistentNLP(
            self.model, IPOPT_OPTIONS, barrier=barrier, quadratic=self.cost, go_on_after_limit=True
        )

    # ---------------------------------------------------------------- building

    def _coordinate(self, name: str) -> Any:
        component = self._merged.find(name)
        if component.ctype is not Var or not component.is_indexed():
            raise TeamError(
                f"agent '{self.spec.name}': KeepApart has '{name}', a {type(component).__name__}. Name variables over "
                "time, such as 'me.x'."
            )
        return component

    def _variables_of(self, name: str) -> list[Any]:
        component = self._merged.find(name)
        variables = variables_behind(component)
        if not variables:
            raise TeamError(
                f"agent '{self.spec.name}': '{name}' is no variable and no block with variables, but "
                f"{type(component).__name__}. Share variables."
            )
        return variables

    def _share(self, group: int, shared: Shared, variables: list[Any]) -> None:
        given = np.asarray(shared.penalty)
        if given.ndim and given.size != len(variables):
            raise TeamError(
                f"agent '{self.spec.name}': Shared({', '.join(map(repr, shared.components))}) stands for "
                f"{len(variables)} variables, its penalty is for {given.size}. Give one number, or one for each "
                "variable."
            )
        for variable, penalty in zip(variables, np.broadcast_to(given, len(variables)).tolist(), strict=True):
            name, data = self._merged.own_name(variable), list(variable.values())
            if any(known.name == name for known in self._quantities):
                raise TeamError(f"agent '{self.spec.name}': '{name}' is shared twice. Name it once.")
            units = next((str(v.get_units()) for v in data if v.get_units() is not None), "")
            self._quantities.append(QuantityFacts(name, tuple(variable.keys()), units, group, penalty))
            self._variables += data

    def _keep_apart(self, rule: KeepApart, neighbours: int) -> None:
        """Rows that keep the robot away from points that are numbers."""
        coordinates = self._coordinates
        keys, times = (
            [key for key in coordinates[0] if any(not c[key].fixed for c in coordinates)],
            list(coordinates[0]),
        )
        block = self.model.keep_apart = Block(concrete=True)
        block.others = Param(range(neighbours), range(len(coordinates)), times, initialize=FAR_AWAY, mutable=True)
        self._others = list(block.others.values())
        block.rows = Constraint(
            range(neighbours),
            keys,
            rule=lambda b, i, key: (
                sum((c[key] - b.others[i, k, key]) ** 2 for k, c in enumerate(coordinates)) >= rule.distance**2
            ),
        )

    # ---------------------------------------------------------------- what an engine asks for

    def facts(self) -> ProblemFacts:
        """What the coordinator has to know of this problem."""
        return ProblemFacts(
            tuple(self._quantities),
            self._has_pairs,
            variable_numbers(self._variables),
            np.array([variable.fixed for variable in self._variables], dtype=bool),
            self.plan(),
            {name: tuple(self._own_controls(part)) for name, part in self._merged.parts.items()},
        )

    def _own_controls(self, part: Any) -> Iterator[str]:
        shared = {quantity.name for quantity in self._quantities}
        for phase in phases_of(part):
            for control in phase.record.names(Control):
                component = phase.component(control)
                name = self._merged.own_name(component)
                if name not in shared and not all(variable.fixed for variable in component.values()):
                    yield name

    def solve(self, order: Order) -> Report:
        """Solve as ordered, from the last point.

        A deterministic function of the state and the order.
        """
        if order.values is not None:
            for variable, number in zip(self._variables, order.values.tolist(), strict=True):
                if not variable.fixed:
                    variable.set_value(number, skip_validation=True)
        if order.others is not None:
            for parameter, number in zip(self._others, order.others.ravel().tolist(), strict=True):
                parameter.set_value(number)
        self.cost.linear[:] = order.linear
        self.cost.diagonal[:] = order.diagonal
        if order.delta is not None:  # the same for every mu below 1
            self.nlp.barrier = FollowBarrier(floor=order.delta, factor=order.delta)
        options: dict[str, Any] = {"tol": order.tolerance, "max_iter": order.iterations}
        started = time.process_time()
        outcome = self.nlp.solve(options, warm=order.delta is None, mu=order.mu or 1e-4, mu_target=order.mu)
        usable = self.nlp.goes_on_from_last_point
        return Report(
            variable_numbers(self._variables),
            outcome.status.name,
            usable,
            outcome.iterations,
            time.process_time() - started,
            self._own_objective(),
            self.plan(),
        )

    def state(self) -> dict[str, Array]:
        """The state that a later solve depends on, as arrays."""
        state = self.nlp.state
        start = np.array(list(self.start_states().values()))  # a plan that was moved ahead starts elsewhere
        if state is None:
            return {"start": start, "x": self.nlp.compiled.current_point()}
        rows, lower, upper = state.complete(self.nlp.program)
        return {"start": start, "x": state.x, "rows": rows, "lower": lower, "upper": upper}

    def restore(self, state: Mapping[str, Array]) -> None:
        """Go on from a state of this problem, or of one built alike elsewhere."""
        self._start_at(dict(zip(self.start_states(), state["start"].tolist(), strict=True)))
        self.nlp.restore(PrimalDualPoint(state["x"], *map(state.get, ("rows", "lower", "upper"))))

    # ---------------------------------------------------------------- for receding horizons

    def start_states(self, element: int = 0) -> dict[str, float]:
        """Values of the states whose initial values are fixed, by name of component.

        Parameters
        ----------
        element : int
            How many elements after the start: 0 gives where it starts, 1 where the plan is an element later.
        """
        return {name: float(paths[0][element].value) for name, paths in self._paths_of_states().items()}

    def plan(self) -> dict[str, Array]:
        """What the coordinator reads of it."""
        return self.read(self.spec.plan)

    def read(self, names: Iterable[str]) -> dict[str, Array]:
        """Values of components over their index, by name."""
        return self._merged.values_of(names)

    def all_values(self) -> dict[str, dict[str, Array]]:
        """Values of all variables over their index, by agent and by name in its own model."""
        return self._merged.all_values()

    def put_on(self, values: Mapping[str, Mapping[str, Array]]) -> None:
        """Start from values that `all_values` gave, of this problem or of one that shares agents with it."""
        self._merged.put_on(values)
        self.nlp.restore(PrimalDualPoint(self.nlp.compiled.current_point()))

    def advance(
        self, start: Mapping[str, float], elements: int = 1, multipliers: Array | None = None
    ) -> tuple[Array, dict[str, Array], Array | None]:
        """Move the plan ahead in time, and multipliers with it; what comes after its end stays as the last element.

        Parameters
        ----------
        start : mapping of component name to float
            Where the states are now, as `start_states` names them; states of other agents are left out.
        elements : int
        multipliers : float array, shape (n,), optional
            Of the agreement on the shared values.

        Returns
        -------
        tuple
            Shared values and the plan, as in `Report`, and the multipliers, moved as the values are.

        Raises
        ------
        TeamError
            When the phases have no fixed, equal elements.
        """
        if self._later is None:
            place = {id(variable): i for i, variable in enumerate(self._variables)}
            shared = [place.get(id(v), i) for i, v in enumerate(later_variables(self.model, self._variables))]
            self._later = later_variables(self.model, self.nlp.compiled.variables), shared
        (later, shared), state = self._later, self.nlp.state
        if state is not None:
            self.nlp.restore(state)  # what a solve that failed has left on the model is of no use
        for _ in range(elements):
            multipliers = None if multipliers is None else multipliers[shared]
            x = variable_numbers(later)
            self.nlp.restore(PrimalDualPoint(x) if state is None else replace(state, x=x))
        if start:
            self._start_at(start)
        return variable_numbers(self._variables), self.plan(), multipliers

    def _paths_of_states(self) -> dict[str, list[list[Any]]]:
        """Variables over time of the states that start where they are told, by name: one list in each agent's model."""
        paths: dict[str, list[list[Any]]] = {}
        for phase in phases_of(self.model):
            for state in phase.record.names_of_states:
                component = phase.component(state)
                path = [component[t] for t in phase.time]
                if path[0].fixed:
                    paths.setdefault(self._merged.own_name(component), []).append(path)
        return paths

    def _start_at(self, start: Mapping[str, float]) -> None:
        for name, paths in self._paths_of_states().items():
            if name in start:
                for path in paths:
                    path[0].set_value(float(start[name]), skip_validation=True)

    def _own_objective(self) -> float:
        objective = self.nlp.compiled.objective
        try:
            return 0.0 if objective is None else float(value(objective))
        except (ArithmeticError, EvaluationError, ValueError):
            return float("nan")


def later_times(model: Any) -> dict[float, float]:
    """Each time of a model's phases, and the one that takes its place an element later.

    Parameters
    ----------
    model : Block
        All of its phases have the same times, with fixed start, fixed duration, equal elements and one point in each.

    Returns
    -------
    dict of float to float
        Without the last time.

    Raises
    ------
    TeamError
        When there are no phases, or not such ones.
    """
    grids = {phase.name: list(phase.time) for phase in phases_of(model) if not phase.has_normalised_time}
    if len(grids) < len(phases_of(model)) or not grids:
        raise TeamError(f"'{model.name}': to move a plan ahead its phases need a fixed start and a fixed duration.")
    (first, times), *others = grids.items()
    for name, grid in others:
        if grid != times:
            raise TeamError(f"'{model.name}': phases '{first}' and '{name}' have different times. Give them one mesh.")
    steps = np.diff(times)
    if np.ptp(steps) > NEGLIGIBLE * (times[-1] - times[0]):
        raise TeamError(
            f"'{model.name}': the times of phase '{first}' are {steps.min():g} to {steps.max():g} apart. A plan is "
            "moved ahead by elements of equal length with one point each, such as those of 'implicit_euler'."
        )
    return dict(pairwise(times))


def _later_index(index: Hashable, later: Mapping[float, float]) -> Hashable | None:
    """The index an element later; None where it holds no time, or the last one."""
    entries = index if isinstance(index, tuple) else (index,)
    moved = tuple(later.get(entry, entry) if isinstance(entry, float) else entry for entry in entries)
    if moved == entries:
        return None
    return moved if isinstance(index, tuple) else moved[0]


def later_variables(model: Any, variables: Sequence[VarData]) -> list[VarData]:
    """What an element later is what each variable is now: its component there; the variable itself where nothing is.

    Parameters
    ----------
    model : Block
    variables : sequence of VarData
    """
    later, members = later_times(model), []
    for variable in variables:
        component, index = variable.parent_component(), _later_index(variable.index(), later)
        members.append(component[index] if index is not None and index in component else variable)
    return members
