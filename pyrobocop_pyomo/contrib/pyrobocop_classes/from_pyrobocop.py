"""`from_pyrobocop`: an object with PyRoboCOP's methods becomes a model.

Objects given by their corners, as shapes and poses.

``get_object_vertices`` says where the corners of an object are, as functions of the states. It is evaluated at a few
random states: the products of edges tell whether the object is rigid, and its corners there are its shape. The formulas
of some corners make its pose.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import partial
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from pyomo.common.numeric_types import native_numeric_types
from pyomo.core.base.objective import Objective
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.base.var import ScalarVar
from pyomo.repn import generate_standard_repn
from scipy.linalg import qr

from pyrobocop_pyomo.complementarity import complements
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.geometry import Polytope, Pose
from pyrobocop_pyomo.modeling.expression_arrays import ArrayEntry, array, plain_entry, plain_scalar
from pyrobocop_pyomo.modeling.shared_nodes import NodeReplacement
from pyrobocop_pyomo.motion import Body
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.obstacles import ObstacleAvoidanceBlock
from pyrobocop_pyomo.phases import Algebraic, Control, Parameter, PhaseBlock, State

from .problem_class import ArrayToFill, ColumnArray, ProblemClass, column_array

# ------------------------------------------------------------------------------------------------------- moving objects


# PyRoboCOP's rows mean sqrt(d'd + tol) >= sqrt(5 tol) with tol = 1e-4 for the distance vector d.
CLEARANCE = 2.0 * math.sqrt(1e-4)

_SAMPLES = 7
_ROUNDING = 1e-7  # relative to the size of the object


def add_objects(b: Any, methods: ProblemClass) -> None:
    """Add ``avoid`` to a phase: every pair of objects of which one is dynamic keeps its distance.

    Raises
    ------
    ModelError
        When the information contradicts itself, or an object is not rigid or moves with more than the states.
    """
    count, dynamic, of_corners = methods.call("get_objects_info")
    flags, counts = np.ravel(dynamic).astype(bool), np.ravel(of_corners).astype(int)
    if not int(np.asarray(count).item()) == len(flags) == len(counts):
        raise ModelError(
            f"{methods.name}.get_objects_info(): {count} objects, {len(flags)} flags, {len(counts)} numbers of corners."
        )
    objects = [Corners(methods, index, int(corners)) for index, corners in enumerate(counts)]
    dimension = 2 if all(np.ptp(each.samples[:, 2]) == 0.0 for each in objects) else 3
    bodies = {f"object{k}": each.body(dimension) for k, each in enumerate(objects)}
    moves = [each.moves for each in bodies.values()]
    stated = [(i, j) for i, j in combinations(range(len(objects)), 2) if flags[i] or flags[j]]
    pairs = [(f"object{i}", f"object{j}") for i, j in stated if moves[i] or moves[j]]
    if pairs:
        b.avoid = ObstacleAvoidanceBlock(
            b.time,
            bodies={name: body for name, body in bodies.items() if body.moves},
            obstacles={name: body.shape for name, body in bodies.items() if not body.moves},
            body_pairs=pairs,
            clearance=CLEARANCE,
        )


class Corners:
    """The corners of one object.

    Parameters
    ----------
    methods : ProblemClass
    index, count : int
        Which object, and how many corners it has.

    Raises
    ------
    ModelError
        When the corners depend on anything but the states.
    """

    def __init__(self, methods: ProblemClass, index: int, count: int) -> None:
        self._methods, self._index, self._count = methods, index, count
        # Small states, so that angles do not wind up.
        states = np.random.default_rng(index).uniform(-0.4, 0.4, (_SAMPLES, methods.counts["x"]))
        corners = [self._at(x) for x in states.tolist()]
        self.samples = np.array([[[float(entry) for entry in row] for row in each] for each in corners])
        if not np.isfinite(self.samples).all():
            raise self._error(
                "has corners that are no numbers. An object moves with states, which are continuous; declare what it "
                "moves with as a state"
            )

    def _error(self, text: str) -> ModelError:
        return ModelError(f"{self._methods.name}.get_object_vertices: object {self._index} {text}.")

    def _at(self, x: list[Any]) -> Any:
        """The corners at states, shape ``(3, count)``."""
        corners = ArrayToFill.zeros(3, self._count)
        others = [column_array([math.nan] * self._methods.counts[kind]) for kind in ("xdot", "y", "u")]
        returned = self._methods.call("get_object_vertices", corners, self._index, column_array(x), *others)
        return np.asarray(corners if returned is None else array(returned)).reshape(3, self._count)

    def body(self, dimension: int) -> Body:
        """Shape, and pose where it moves.

        Raises
        ------
        ModelError
            When the object changes its shape, or its turn is left open.
        """
        corners, name = self.samples[:, :dimension], f"object{self._index}"
        if (np.abs(corners - corners[0]) < 1e-12).all():
            return Body(Polytope.hull(corners[0].T, name=name, allow_flat=True))
        edges = corners - corners[:, :, :1]
        products = edges.transpose(0, 2, 1) @ edges
        if np.abs(products - products[0]).max() > _ROUNDING * products[0].max():
            raise self._error(
                "has corners whose distances change with the states. Only rigid objects are supported: give "
                "each rigid part as an object of its own"
            )
        frame, chosen, inverse = edges[0], [], np.eye(dimension)
        if not (np.abs(edges - frame) < 1e-12).all():
            _, triangle, order = qr(frame, pivoting=True)
            spans, chosen = np.abs(np.diag(triangle))[: dimension - 1], order[: dimension - 1].tolist()
            if spans.min() <= _ROUNDING * spans.max():
                raise self._error("has its corners on a line, which leaves the turn about it open. Give it a width")
            axes, upper = np.linalg.qr(_with_perpendicular(frame[:, chosen]))
            frame = (axes * np.sign(np.diag(upper))).T @ frame  # the first edge along the first axis
            inverse = np.linalg.inv(_with_perpendicular(frame[:, chosen]))
            inverse[np.abs(inverse) < _ROUNDING * np.abs(inverse).max()] = 0.0
        hull = Polytope.hull(frame.T, name=name, allow_flat=True)
        return Body(hull, pose=partial(self._pose, chosen, inverse))

    def _pose(self, chosen: list[int], inverse: Array, block: Any, t: Any) -> Pose:
        """The pose at a point: of the edges `chosen`, from the first corner; of none where the object does not turn."""
        dimension = len(inverse)
        corners = array(self._at([getattr(block, name)[t] for name in self._methods.names("x")]))[:dimension]
        position = corners[:, 0]
        rotation = _with_perpendicular((corners - corners[:, :1])[:, chosen]) @ inverse if chosen else inverse
        return Pose(tuple(map(tuple, rotation)), tuple(position))


def _with_perpendicular(edges: Any) -> Any:
    """One edge in the plane or two in space, as columns, and the directions perpendicular to them."""
    last = np.array([-edges[1, 0], edges[0, 0]]) if len(edges) == 2 else np.cross(edges[:, 0], edges[:, 1])
    return np.column_stack([edges, last])


# ---------------------------------------------------------------------------------------------------- pyrobocop classes


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
    """Bounds of a state, of which the first value has its own; at the end the bounds of the last index hold as well."""
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
