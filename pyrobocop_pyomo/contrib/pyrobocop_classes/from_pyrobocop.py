"""`from_pyrobocop`: an object with PyRoboCOP's methods becomes a model."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from pyomo.common.numeric_types import native_numeric_types
from pyomo.core.base.objective import Objective
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.base.var import ScalarVar
from pyomo.repn import generate_standard_repn

from pyrobocop_pyomo.complementarity import complements
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.expression_arrays import ArrayEntry, plain_entry, plain_scalar
from pyrobocop_pyomo.modeling.shared_nodes import NodeReplacement
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.phases import Algebraic, Control, Parameter, PhaseBlock, State

from .moving_objects import add_objects
from .problem_class import ArrayToFill, ColumnArray, ProblemClass, column_array

SCHEMES = {"radau": "radau", "legendre": "gauss", "explicit": "explicit_euler"}


def from_pyrobocop(problem: Any, ncolloc: int = 1, roots: str = "radau") -> ConcreteModel:
    """A model of a problem that is written as a class with PyRoboCOP's methods, which are taken as they are.

    Parameters
    ----------
    problem : object
        With the methods ``get_info``, ``bounds``, ``initialpoint``, ``initialcondition``, ``objective`` and
        ``constraint``; where they apply ``bounds_finaltime``, ``objective_mayer``, ``bounds_params``,
        ``initialpoint_params``, ``get_complementarity_info``, ``get_objects_info`` and ``get_object_vertices``. Methods
        for derivatives are ignored.
    ncolloc : int
        Points per element, of any number.
    roots : {"radau", "legendre", "explicit"}
        Scheme; explicit Euler has one point. Points are exact.

    Returns
    -------
    ConcreteModel
        With a `PhaseBlock` ``phase`` of the states ``x0, x1, ...``, algebraics ``y0, ...``, controls ``u0, ...`` and
        parameters ``p0, ...``; its equations ``phase.equations``, its pairs ``phase.pairs``, its separations
        ``phase.avoid`` and the objective ``cost``. `solution_arrays` gives the values in PyRoboCOP's shapes.

    Raises
    ------
    ModelError
        Naming the method that is missing, contradicts ``get_info`` or states something else than formulas.
        When what is stated so contradicts itself otherwise.

    Notes
    -----
    ``constraint(c, t, x, xdot, y, u, p)`` means that ``c`` vanishes at each point, where it is called with the time as
    a number. Rows that are a number times one derivative plus something without derivatives are its right-hand side;
    others are ``phase.equations``. The phase keeps its mesh, and what happens between its points is not known. Objects
    are recovered from their corners as shapes and poses, and keep a distance of 0.02 as in PyRoboCOP. Where this
    differs from PyRoboCOP, and why, is on the page :ref:`from-pyrobocop`.

    References
    ----------
    Raghunathan, Jha & Romeres, PYROBOCOP: Python-based Robotic Control & Optimization Package for Manipulation, ICRA
    2022, doi:10.1109/ICRA46639.2022.9812069; arXiv:2106.03220
    """
    if roots not in SCHEMES:
        raise ModelError(f"roots = {roots!r}; known are {', '.join(map(repr, SCHEMES))}.")
    methods = ProblemClass(problem)
    times = methods.times
    bounds, guesses = methods.by_kind("bounds", 2), methods.by_kind("initialpoint", 1)
    m = ConcreteModel(name=methods.name)
    m.phase = b = PhaseBlock(
        start=times[0], duration=times[-1] - times[0], mesh=times.tolist(), scheme=SCHEMES[roots], stages=ncolloc
    )
    _declare(b, methods, bounds)
    _bound_rates(b, methods, bounds["xdot"])
    rules = PointRules(methods, bounds["y"])
    rules.state_rows(b)
    if methods.pairs:
        b.complementarity(rules.pairs)
    _start(b, methods, guesses)
    if methods.has("get_objects_info"):
        add_objects(b, methods)
    m.cost = Objective(expr=b.integral(rules.running_cost) + rules.final_cost(b))
    return m


def _declare(b: Any, methods: ProblemClass, bounds: dict[str, Array]) -> None:
    scheme, times = b.grid.scheme, methods.times
    initial = methods.ends("initialcondition")
    # Some classes have the name with this slip.
    final_name = next((name for name in ("bounds_finaltime", "bounds_finaftime") if methods.has(name)), None)
    final = np.full((2, methods.counts["x"]), [[-np.inf], [np.inf]]) if final_name is None else methods.ends(final_name)
    # Where Gauss points leave boundaries out, the bounds of an element hold where it starts, otherwise where it ends.
    of_states = "left" if scheme.stiffly_accurate or scheme.starts_on_a_stage else "right"
    for j, name in enumerate(methods.names("x")):
        of_time = partial(_bounds_of_state, times, bounds["x"][:, :, j], of_states)
        b.declare(name, State(bounds=of_time, initial=_end(initial[:, j]), final=_end(final[:, j])))
    of_signals = "right" if scheme.starts_on_a_stage else "left"
    for kind, declaration in (("y", Algebraic), ("u", Control)):
        for j, name in enumerate(methods.names(kind)):
            b.declare(name, declaration(bounds=partial(_bounds_in_element, times, bounds[kind][:, :, j], of_signals)))
    if count := methods.counts["p"]:
        of_parameters = methods.numbers("lower and upper bounds of p", (2 * count,), "bounds_params").reshape(2, count)
        guess = methods.numbers("values of p", (count,), "initialpoint_params")
        for j, name in enumerate(methods.names("p")):
            b.declare(name, Parameter(bounds=tuple(of_parameters[:, j]), initial_guess=guess[j]))


def _bounds_of_state(times: Array, table: Array, side: Any, time: float) -> tuple[float, float]:
    """Bounds of a state, of which the first value has its own; at the end those of the last index hold as well."""
    if time <= times[0]:
        return -np.inf, np.inf
    lower, upper = _bounds_in_element(times, table, side, time)
    return (max(lower, table[-1, 0]), min(upper, table[-1, 1])) if time >= times[-1] else (lower, upper)


def _bounds_in_element(times: Array, table: Array, side: Any, time: float) -> tuple[float, float]:
    lower, upper = table[int(np.searchsorted(times, float(time), side=side)) - 1]
    return lower, upper


def _end(bounds: Array) -> Any:
    lower, upper = bounds.tolist()
    return lower if lower == upper else (lower, upper)


def _bound_rates(b: Any, methods: ProblemClass, bounds: Array) -> None:
    """Derivatives with bounds are variables; others are where no right-hand side is stated for them."""
    for j, name in enumerate(methods.names("x")):
        if np.isfinite(bounds[:-1, :, j]).any():
            for t, derivative in b.derivative(name).items():
                derivative.bounds = bounds[b.grid.element_of[t], :, j].tolist()


def _start(b: Any, methods: ProblemClass, guesses: dict[str, Array]) -> None:
    """Guesses are samples by element: of states at its start, and of everything at all of its points."""
    grid = b.grid
    at_times = np.searchsorted(methods.times, grid.times, side="right") - 1
    at_points = [grid.element_of[time] for time in grid.points]
    names = {kind: methods.names(kind) for kind in "xyu"}
    names["xdot"] = [f"{name}_derivative" for name in names["x"]]  # after the states, which derivatives follow
    for kind, of_kind in names.items():
        elements = at_times if kind == "x" else at_points
        of_variables = [(j, name) for j, name in enumerate(of_kind) if b.component(name) is not None]
        b.initialize({name: guesses[kind][elements, 0, j] for j, name in of_variables})


class PointRules:
    """The methods of a class as rules of a phase, which are called at each of its points.

    Parameters
    ----------
    methods : ProblemClass
    bounds : array, shape (elements + 1, 2, algebraics)
        Of the algebraics, of which pairs have sides.
    """

    def __init__(self, methods: ProblemClass, bounds: Array) -> None:
        self._methods, self._bounds = methods, bounds
        self._sides = methods.sides(bounds)
        self._rates = {name: ScalarVar() for name in methods.names("x")}  # in rows, until it is known which are given
        for rate in self._rates.values():
            rate.construct()
        self._explicit: list[str] = []
        self._stated: dict[float, Any] = {}

    def _variables(self, block: Any, kind: str, t: Any) -> ColumnArray:
        return column_array(getattr(block, name)[t] for name in self._methods.names(kind))

    def _parameters(self, block: Any) -> ColumnArray:
        return column_array(getattr(block, name) for name in self._methods.names("p"))

    def _arguments(self, block: Any, t: Any, rates: Iterable[Any]) -> list[Any]:
        time = float(t)  # what stands for all times has no number, and no class is called with it
        x, y, u = (self._variables(block, kind, t) for kind in "xyu")
        return [time, x, column_array(rates), y, u, self._parameters(block)]

    def state_rows(self, block: Any) -> None:
        """State the rows of ``constraint``: those that give a derivative at every point as an ode."""
        self._stated = {t: self._rows(block, t) for t in block.grid.points}
        self._explicit = [name for name in self._rates if all(name in given for _, given in self._stated.values())]
        if self._explicit:
            block.ode(self.equations_of_motion)
        if self._methods.rows > len(self._explicit):
            block.residual(self.equations)
        self._stated = {}

    def equations_of_motion(self, block: Any, t: Any) -> dict[str, Any]:
        """The derivatives that rows give."""
        _, given = self._stated.get(float(t)) or self._rows(block, t)
        return {name: given[name][1] for name in self._explicit}

    def equations(self, block: Any, t: Any) -> list[Any]:
        """The other rows."""
        rows, given = self._stated.get(float(t)) or self._rows(block, t)
        replaced = NodeReplacement({id(rate): block.derivative(name)[t] for name, rate in self._rates.items()})
        used = [given[name][0] for name in self._explicit]
        return [replaced.of(row) for i, row in enumerate(rows) if i not in used]

    def _rows(self, block: Any, t: Any) -> tuple[list[Any], dict[str, tuple[int, Any]]]:
        """The rows at a point, and the derivatives that they give."""
        c = ArrayToFill.zeros(self._methods.rows, 1)
        returned = self._methods.formulas(block, "constraint", c, *self._arguments(block, t, self._rates.values()))
        rows = np.ravel(np.asarray(c if returned is None else returned, dtype=object)).tolist()
        formulas = sum(isinstance(row, ArrayEntry) for row in rows)
        if not formulas == len(rows) == self._methods.rows:
            raise ModelError(
                f"{self._methods.name}.constraint gives {formulas} formulas in {len(rows)} rows at t = {float(t):g}; "
                f"n_d + n_a - n_cc = {self._methods.rows} are expected. Fill every row of c, or correct the counts."
            )
        rows = [plain_entry(row) for row in rows]
        return rows, _explicit_rates(self._rates, rows)

    def pairs(self, block: Any, t: Any) -> list[Any]:
        """The complementarity pairs."""
        bounds = self._bounds[block.grid.element_of[float(t)]]

        def distance(algebraic: int, side: int) -> Any:
            variable, bound = getattr(block, f"y{algebraic}")[t], float(bounds[side, algebraic])
            return variable <= bound if side else variable >= bound

        return [complements(distance(*first), distance(*second)) for first, second in self._sides]

    def running_cost(self, block: Any, t: Any) -> Any:
        """What ``objective`` returns."""
        rates = [block.derivative(name)[t] for name in self._methods.names("x")]
        return self._methods.formulas(block, "objective", *self._arguments(block, t, rates))

    def final_cost(self, block: Any) -> Any:
        """What ``objective_mayer`` returns; 0 where there is none."""
        if not self._methods.has("objective_mayer"):
            return 0.0
        columns = [self._variables(block, "x", t) for t in block.grid.node_times[0]]
        first, last = columns[0], self._variables(block, "x", block.grid.times[-1])
        first.columns = np.stack([np.asarray(column) for column in columns], axis=1)
        cost = self._methods.formulas(block, "objective_mayer", first, last, self._parameters(block))
        return plain_scalar(cost, f"{self._methods.name}.objective_mayer")


def _explicit_rates(rates: dict[str, Any], rows: list[Any]) -> dict[str, tuple[int, Any]]:
    """By state: which of the rows gives its derivative, and as what.

    Such a row is a number times the derivative, plus something without derivatives.

    Parameters
    ----------
    rates : dict of str to variable
        The derivative of each state in the rows.
    rows : list of expressions
    """
    names = {id(rate): name for name, rate in rates.items()}
    given: dict[str, tuple[int, Any]] = {}
    for i, row in enumerate(rows):
        found = generate_standard_repn(row, compute_values=False, quadratic=False)
        terms = zip(found.linear_coefs, found.linear_vars, strict=True)
        of_rates = [(factor, rate) for factor, rate in terms if id(rate) in names]
        if len(of_rates) == 1 and names.keys().isdisjoint(map(id, found.nonlinear_vars)):
            factor, rate = of_rates[0]
            if factor.__class__ in native_numeric_types:
                rest = NodeReplacement({id(rate): 0.0}).of(row)
                given.setdefault(names[id(rate)], (i, -rest / factor))
    return given


class SolutionArrays(NamedTuple):
    """Values by element, variable and point; what unpacks into ``x, xdot, y, u, p``.

    Attributes
    ----------
    x : array, shape (N + 1, n_d, K + 1)
        States at the start of each element, then at its K points; at last the final state, in all columns.
    xdot : array, shape (N, n_d, K)
    y : array, shape (N, n_a, K)
    u : array, shape (N, n_u, K)
    p : array, shape (n_p,)
    """

    x: Array
    xdot: Array
    y: Array
    u: Array
    p: Array


def solution_arrays(model: Any) -> SolutionArrays:
    """The values that stand on a model of `from_pyrobocop`.

    Parameters
    ----------
    model : ConcreteModel

    Raises
    ------
    ModelError
        When the model was not made by `from_pyrobocop`.
    """
    phase = model.component("phase")
    if phase is None or phase.component("x0") is None:
        raise ModelError(f"'{model.name}' was not made by from_pyrobocop.")
    trajectory = phase.trajectory()
    names = {kind: phase.record.names(kind) for kind in (State, Algebraic, Control)}
    elements, stages = len(trajectory.grid.node_times), trajectory.grid.scheme.stages

    def stacked(parts: list[Array]) -> Array:
        return np.stack(parts, axis=1) if parts else np.empty((elements, 0, stages))

    states = stacked([trajectory.element_states(name)[:, : stages + 1] for name in names[State]])
    final = np.array([trajectory.states[name][-1] for name in names[State]])
    return SolutionArrays(
        np.concatenate([states, np.repeat(final[None, :, None], stages + 1, axis=2)]),
        stacked([trajectory.element_rates(name) for name in names[State]]),
        stacked([trajectory.element_signals(name) for name in names[Algebraic]]),
        stacked([trajectory.element_signals(name) for name in names[Control]]),
        np.array(list(trajectory.parameters.values())),
    )
