"""`from_pyrobocop`: an object with PyRoboCOP's methods becomes a model."""

from __future__ import annotations

from typing import Any

import numpy as np
from pyomo.core.base.objective import Objective
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.expr.numvalue import native_numeric_types

from pyrobocop_pyomo.errors import ProblemClassError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.phases import Algebraic, Control, Parameter, PhaseBlock, State

from .methods import Methods, finite_or_none, notice_derivatives
from .moving_objects import add_objects
from .problem_data import ProblemData, read_problem
from .stated_problem import StatedProblem
from .treatment import scheme_of, solve_options_of

GUESSES = ("published", "straight line")


def from_pyrobocop(
    problem: Any,
    ncolloc: int = 1,
    roots: str = "radau",
    compl: int | None = None,
    compladapt: int | None = None,
    compleps: float | None = None,
    autodiff: int = 1,
    *,
    guess: str = "published",
    name: str | None = None,
) -> ConcreteModel:
    """A model of a problem that is written as a class with PyRoboCOP's methods, which are taken as they are.

    Parameters
    ----------
    problem : object
        With the methods ``get_info``, ``bounds``, ``initialpoint``, ``initialcondition``, ``objective`` and
        ``constraint``; where they apply ``bounds_finaltime``, ``objective_mayer``, ``bounds_params``,
        ``initialpoint_params``, ``get_complementarity_info``, ``get_objects_info`` and ``get_object_vertices``. Methods
        for derivatives are ignored, which is noted in the log.
    ncolloc : int
        Points per element, of any number.
    roots : {"radau", "legendre", "explicit"}
        Scheme; explicit Euler has one point. Points are exact.
    compl, compladapt, compleps : optional
        How pairs were treated: 0, 1 or 2 for each pair, their sum per element, a penalty; 0 or 1 for a fixed delta or
        one that follows the barrier parameter; the fixed delta. ``solve(model)`` uses its own treatment, which is
        exact; ``solve(model, **model.problem.solve_options)`` the one that is requested here.
    autodiff : int
        Ignored: derivatives are always exact.
    guess : {"published", "straight line"}
        Initial guess: that of ``initialpoint``, or straight lines between the ends, where both are stated.
    name : str, optional
        Of the model; the name of the class by default.

    Returns
    -------
    ConcreteModel
        With a `PhaseBlock` ``phase`` of the states ``x0, x1, ...``, algebraics ``y0, ...``, controls ``u0, ...`` and
        parameters ``p0, ...``; its pairs ``phase.pairs``, its separations ``phase.avoid``, the objective ``cost`` and
        the `StatedProblem` ``problem``. `solution_arrays` gives the values in PyRoboCOP's shapes.

    Raises
    ------
    ProblemClassError
        Naming all methods that are missing, take other arguments or contradict ``get_info``, or the method that failed.
    ModelError
        When what is stated so contradicts itself otherwise.

    Notes
    -----
    ``constraint(c, t, x, xdot, y, u, p)`` means that ``c`` vanishes at each point. Where its rows are linear in
    ``xdot`` they are solved for it and substituted; other rows stay implicit. Objects are recovered from their corners
    as shapes and poses, and keep a distance of 0.02 as in PyRoboCOP, between the points too. Where this differs from
    PyRoboCOP, and why, is on the page :ref:`from-pyrobocop`.

    References
    ----------
    Raghunathan, Jha & Romeres, PYROBOCOP: Python-based Robotic Control & Optimization Package for Manipulation, ICRA
    2022, doi:10.1109/ICRA46639.2022.9812069; arXiv:2106.03220
    """
    if guess not in GUESSES:
        raise ProblemClassError(f"guess = {guess!r}; choose {' or '.join(map(repr, GUESSES))}.")
    if autodiff not in (0, 1):
        raise ProblemClassError(f"autodiff = {autodiff!r}; expected 0 or 1.")
    scheme = scheme_of(ncolloc, roots)
    methods = Methods(problem)
    data = read_problem(methods)
    options = solve_options_of(compl, compladapt, compleps, data.sizes.pairs)
    notice_derivatives(methods)
    stated = StatedProblem(problem, methods, data, options, starts_on_a_stage=scheme.starts_on_a_stage)

    m = ConcreteModel(name=methods.class_name if name is None else name)
    m.problem = stated
    times = data.sizes.times
    m.phase = b = PhaseBlock(start=times[0], duration=times[-1] - times[0], mesh=times.tolist(), scheme=scheme)
    _declare(b, stated, data)
    _state(b, stated, data)
    _start(b, data, guess)
    if methods.has("get_objects_info"):
        add_objects(b, stated, methods)
    m.cost = Objective(expr=_cost(b, stated))
    return m


def _declare(b: Any, stated: StatedProblem, data: ProblemData) -> None:
    sizes = data.sizes
    varying = stated.states_with_varying_rate_bounds
    for j, name in enumerate(stated.names("x")):
        rate = None if j in varying else _pair(data.bounds["xdot"][:, 0, j])
        b.declare(
            name,
            State(
                bounds=StateBounds(name, sizes.times, data.bounds["x"][:, :, j], _gauss(b)),
                initial=_value_or_pair(data.initial[:, j]),
                final=None if data.final is None else _value_or_pair(data.final[:, j]),
                derivative_bounds=None if rate == (None, None) else rate,
            ),
        )
    for kind, declaration in (("y", Algebraic), ("u", Control)):
        for j, name in enumerate(stated.names(kind)):
            b.declare(name, declaration(bounds=PointBounds(stated, data.bounds[kind][:, :, j])))
    for j, name in enumerate(stated.names("p")):
        lower, upper = data.parameter_bounds[:, j]
        b.declare(name, Parameter(bounds=_pair((lower, upper)), initial_guess=float(data.parameter_guess[j])))


def _state(b: Any, stated: StatedProblem, data: ProblemData) -> None:
    """State the residuals of a class: those of explicit states as differential equations, the others as residuals."""
    if stated.find_explicit_states(b):
        b.ode(stated.equations_of_motion)
    if data.sizes.rows > data.sizes.states - len(stated.implicit):
        b.residual(stated.equations)
    if data.pairs:
        b.complementarity(stated.pairs)
    if stated.states_with_varying_rate_bounds:
        b.constraint(stated.rate_bounds)


def _start(b: Any, data: ProblemData, guess: str) -> None:
    """Guesses are samples by element: at its start, and of everything else at all of its points."""
    grid = b.grid
    boundaries = {time: i for i, time in enumerate(grid.mesh.boundaries)}
    element = {time: i for i, times in enumerate(grid.node_times) for time in times[1:]} | boundaries
    guesses: dict[str, Any] = {}
    for j in range(data.sizes.states):
        guesses[f"x{j}"] = [data.guesses["x"][element[time], j] for time in grid.times]
    for kind in ("y", "u"):
        for j in range(data.guesses[kind].shape[1]):
            guesses[f"{kind}{j}"] = [data.guesses[kind][grid.element_of[time], j] for time in grid.points]
    b.initialize(guesses)
    if guess == "straight line":
        b.initialize_straight_lines()
        return
    rates = {
        f"x{j}_derivative": [data.guesses["xdot"][grid.element_of[time], j] for time in grid.points]
        for j in range(data.sizes.states)
        if b.component(f"x{j}_derivative") is not None
    }
    b.initialize(rates)


def _cost(b: Any, stated: StatedProblem) -> Any:
    final = stated.final_cost(b)
    costs = (stated.running_cost(b, t) for t in b.grid.points)
    if all(cost.__class__ in native_numeric_types and cost == 0 for cost in costs):
        return final

    return b.integral(stated.running_cost) + final


def _gauss(b: Any) -> bool:
    """True where element boundaries are no collocation points."""
    return not (b.grid.scheme.stiffly_accurate or b.grid.scheme.starts_on_a_stage)


class StateBounds:
    """Bounds of a state as a function of time; the first value is fixed, whatever they are.

    Those of an element hold at its points, and at the boundary where it ends. With Gauss points, which leave boundaries
    out, those of an element hold where it starts. At the end those of the last index hold as well.
    """

    def __init__(self, name: str, times: Array, table: Array, gauss: bool) -> None:
        self._name, self._times, self._table, self._gauss = name, times, table, gauss

    def __call__(self, time: float) -> tuple[float | None, float | None]:
        """Lower and upper bound at a time."""
        times, last = self._times, len(self._times) - 1
        if time <= times[0]:
            return (None, None)
        element = int(np.searchsorted(times, time, side="right" if self._gauss else "left")) - 1
        element = min(max(element, 0), last - 1)
        lower, upper = self._table[:, element]
        if time >= times[last]:
            of_end = self._table[:, last]
            lower, upper = of_end if self._gauss else (max(lower, of_end[0]), min(upper, of_end[1]))
            if lower > upper:
                raise ProblemClassError(
                    f"bounds({last - 1}) and bounds({last}) leave no value of {self._name} at the final time, "
                    f"where both hold: {self._table[:, last - 1]} and {of_end}."
                )
        return _pair((lower, upper))


class PointBounds:
    """Bounds of an algebraic or a control as a function of time: those of the element."""

    def __init__(self, stated: StatedProblem, table: Array) -> None:
        self._stated, self._table = stated, table

    def __call__(self, time: float) -> tuple[float | None, float | None]:
        """Lower and upper bound at a time."""
        return _pair(self._table[:, self._stated.element_at_time(time)])


def _pair(bounds: Any) -> tuple[float | None, float | None]:
    lower, upper = bounds
    return finite_or_none(lower), finite_or_none(upper)


def _value_or_pair(bounds: Any) -> Any:
    lower, upper = bounds
    return float(lower) if lower == upper else _pair(bounds)
