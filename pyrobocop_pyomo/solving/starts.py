"""Other starts for a model: inside the domain of its functions, by its phases, or by its bounds."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

import numpy as np
from pyomo.core.base.var import Var

from pyrobocop_pyomo.diagnosis.diagnose import is_renamed
from pyrobocop_pyomo.diagnosis.values import named_undefined_rows
from pyrobocop_pyomo.errors import ModelError, PyRobocopError
from pyrobocop_pyomo.modeling.variable_values import VariableValues, within_bounds
from pyrobocop_pyomo.phases import Control, PhaseBlockData, State, phases_of
from pyrobocop_pyomo.phases.phase_values import PhaseValues
from pyrobocop_pyomo.phases.remeshing import put_on_meshes, why_not_remeshed
from pyrobocop_pyomo.phases.simulation import SimulationOptions, rough_motion, simulate
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray

from .strategies import StartingPoint, Strategy

logger = logging.getLogger(__name__)

# A start need not be exact, and a stiff motion must not take long (LSODA would not stop where an exception is raised).
SIMULATED_BY = SimulationOptions("RK45", rtol=1e-5, atol=1e-7, most_evaluations=5000)
# A copy has so many times fewer elements, and no fewer than this.
COARSER = 4
# Optima of a coarser mesh may be none of the problem.
EXPLORED_ELEMENTS = 20


WAVES = 4  # cosines in a curve over time: enough to change its shape, few enough to stay near the dynamics


class RandomStarts:
    """Draws values for the free variables of a model.

    Parameters
    ----------
    model : Block
        Its values are the initial guess.
    seed : int
    spreads : mapping from int or None to float
        How far from the initial guess, as a multiple of the distance to the bounds or of its own size: by the
        identity of a component, None for all others.

    Raises
    ------
    ModelError
        If no free variable is left to vary.
    """

    def __init__(self, model: Any, seed: int, spreads: Mapping[int | None, float]) -> None:
        self._seed = seed
        self._groups: list[tuple[list[Any], FloatArray, FloatArray, FloatArray, bool]] = []
        for component in model.component_objects(Var, active=True):
            factor = spreads.get(id(component), spreads.get(None, 0.0))
            members = [member for member in component.values() if not member.fixed]
            if factor <= 0.0 or not members:
                continue
            guess = np.array([_initial_guess(member) for member in members])
            reach = np.maximum(1.0, np.abs(guess))
            lower = np.array([-np.inf if member.lb is None else member.lb for member in members])
            upper = np.array([np.inf if member.ub is None else member.ub for member in members])
            bounded = np.isfinite(lower) & np.isfinite(upper)
            down = np.where(bounded, guess - lower, np.minimum(reach, guess - lower))
            up = np.where(bounded, upper - guess, np.minimum(reach, upper - guess))
            over_time = component.is_indexed() and isinstance(component.parent_block(), PhaseBlockData)
            self._groups.append((members, guess, factor * down, factor * up, over_time))
        if not self._groups:
            raise ModelError(
                f"'{model.name}': no free variable is left to vary. Give a positive spread to one of them, or starts=1."
            )

    def put(self, number: int) -> None:
        """Put start `number` on the model; the same number gives the same point, however many are drawn."""
        generator = np.random.default_rng([self._seed, number])
        for members, guess, down, up, over_time in self._groups:
            draw = _curve(generator, len(members)) if over_time else generator.uniform(-1.0, 1.0, len(members))
            values = guess + np.where(draw < 0.0, draw * down, draw * up)
            for variable, number_of in zip(members, values.tolist(), strict=True):
                variable.set_value(number_of, skip_validation=True)


def _curve(generator: np.random.Generator, size: int) -> FloatArray:
    """A smooth curve within -1 and 1."""
    place = np.linspace(0.0, np.pi, size)
    waves = np.cos(np.outer(np.arange(WAVES), place))
    weights = generator.uniform(-1.0, 1.0, WAVES) / np.arange(1, WAVES + 1)
    # Uniform in its size as well: without the division the curves would crowd around the initial guess.
    curve = weights @ waves
    return np.asarray(curve / max(np.abs(curve).max(), 1e-12) * generator.uniform())


def _initial_guess(variable: Any) -> float:
    """The value, moved within the bounds; without a finite value, the number nearest to zero within them."""
    known = variable.value is not None and np.isfinite(variable.value)
    return within_bounds(float(variable.value) if known else 0.0, variable)


def defined_start(model: Any) -> str:
    """Where an expression has no value at the values on the model, put others there at which all have one.

    States for which no initial guess was given go on straight lines between their ends; then values are drawn, farther
    from the guess each time.

    Parameters
    ----------
    model : Block

    Returns
    -------
    str
        What was done and why; empty where nothing was, or nothing helped. Values are as before then.
    """
    undefined = named_undefined_rows(model)
    if not undefined:
        return ""
    before = VariableValues.of_free(model)
    _give_values(model)
    _put_on_straight_lines(model, keep_guesses=True)
    on_lines = VariableValues.of_free(model)
    for draw, spread in enumerate((0.0, 1e-3, 1e-2, 0.1, 0.3, 1.0)):
        on_lines.restore()
        if spread:
            RandomStarts(model, 0, {None: spread}).put(draw)
        if not named_undefined_rows(model):
            drawn = f", and random values within {spread:.3g} of their sizes or bounds around these" if draw else ""
            start = f"states without an initial guess on straight lines between their ends{drawn}"
            return f"The initial guess could not be evaluated: {undefined}. Started instead with {start}."
    before.restore()
    return ""


def put_start(model: Any, strategy: Strategy) -> bool:
    """Put the start of a strategy on the model, which holds the user's initial guess.

    Returns
    -------
    bool
        False where there is no such start, or it is the initial guess.
    """
    start = strategy.start
    if start in (StartingPoint.INITIAL_GUESS, StartingPoint.BEST):
        return True
    if start is StartingPoint.RANDOM_START:
        RandomStarts(model, 0, {None: 1.0}).put(strategy.draw)  # the same starts where a solve is repeated
        return True
    if is_renamed(model):
        return False
    if start is StartingPoint.SIMULATED:
        return put_motion(model)
    if start is StartingPoint.MIRRORED:
        return _mirror_controls(model)
    is_moved = start is not StartingPoint.RANDOM_MOTION and _put_on_straight_lines(model, keep_guesses=False)
    if start is StartingPoint.STRAIGHT_LINES:
        return is_moved
    return _put_random_controls(model, strategy.draw) and (start is StartingPoint.RANDOM_CONTROLS or any(_moved(model)))


def put_motion(model: Any) -> bool:
    """Let phases move under the controls of the initial guess; returns whether any phase could."""
    before = VariableValues.of_free(model)
    _put_on_straight_lines(model, keep_guesses=True)
    is_moved = any(_moved(model))
    if not is_moved:
        before.restore()
    return is_moved


def coarser_copy(model: Any, least: int = COARSER) -> Any | None:
    """A copy with a quarter of the elements in each long phase; None where there is none or it cannot be made.

    Parameters
    ----------
    model : Block
    least : int
        Elements that a phase with fewer has, at least.
    """
    elements = elements_of_copy(model, least)
    if not elements or model.model() is not model or any(why_not_remeshed(phase) is not None for phase in elements):
        return None
    try:
        copy = model.clone()
        put_on_meshes({copy.find_component(phase): number for phase, number in elements.items()})
    except PyRobocopError as error:
        logger.info("'%s': no copy with fewer elements: %s", model.name, error)
        return None
    return copy


def elements_of(model: Any) -> int:
    """Of all phases together."""
    return sum(phase.grid.mesh.elements for phase in phases_of(model))


def elements_of_copy(model: Any, least: int) -> dict[Any, int]:
    """Of the phases that have fewer in a coarser copy."""
    elements = {phase: phase.grid.mesh.elements for phase in phases_of(model)}
    return {phase: n // COARSER for phase, n in elements.items() if n >= COARSER * least}


def take_values_of_copy(model: Any, copy: Any) -> None:
    """Values of a copy: phases with another mesh by their trajectories, all others one by one."""
    for component in model.component_objects(Var, active=True):
        twins = copy.find_component(component)
        for index in component if twins is not None else ():
            variable = component[index]
            if index in twins and twins[index].value is not None and not variable.fixed:
                variable.set_value(twins[index].value, skip_validation=True)
    for phase in phases_of(model):
        twin = copy.find_component(phase)
        if twin.grid.mesh != phase.grid.mesh:
            phase.initialize(twin.trajectory())


def _put_on_straight_lines(model: Any, *, keep_guesses: bool) -> bool:
    """Lead states from one end to the other, or only those without an initial guess; whether any value changed."""
    before = VariableValues.of_free(model)
    for phase in phases_of(model):
        kept = VariableValues(
            variable
            for name in phase.record.names(State)
            if keep_guesses and _has_guess(phase, name)
            for variable in phase.component(name).values()
        )
        phase.initialize_straight_lines()
        kept.restore()
    return before.read() != before.taken


def _has_guess(phase: Any, name: str) -> bool:
    """Whether the values of a state are any but those that it gets by default."""
    component, times = phase.component(name), phase.record.grid.times
    ends = [component[time].value for time in (times[0], times[-1]) if component[time].fixed]
    default = next(iter(ends), None) or 0.0
    return phase.record.declarations[name].initial_guess is not None or any(
        not variable.fixed and variable.value is not None and variable.value != within_bounds(default, variable)
        for variable in component.values()
    )


def _put_random_controls(model: Any, draw: int) -> bool:
    """Draw controls within their bounds; returns whether there are any."""
    free: dict[int | None, float] = {
        id(control): 1.0 for control in _controls(model) if any(not member.is_fixed() for member in control.values())
    }
    if free:
        RandomStarts(model, 0, free).put(draw)
    return bool(free)


def _mirror_controls(model: Any) -> bool:
    """Turn controls to the other side, and let phases move under them where they can; whether there are any."""
    members = (member for control in _controls(model) for member in control.values())
    moved = [each for each in members if each.is_variable_type() and not each.fixed and each.value is not None]
    for variable in moved:
        lower, upper = variable.bounds
        middle = 0.0 if lower is None or upper is None else 0.5 * (lower + upper)
        variable.set_value(within_bounds(2.0 * middle - variable.value, variable), skip_validation=True)
    if moved:
        _moved(model)
    return bool(moved)


def _controls(model: Any) -> list[Any]:
    return [phase.component(name) for phase in phases_of(model) for name in phase.record.names(Control)]


def _moved(model: Any) -> list[bool]:
    """Let states follow the controls; returns for each phase whether they can."""
    _give_values(model)
    return [_move(phase) for phase in phases_of(model)]


def _move(phase: Any) -> bool:
    """Let a phase follow its controls; returns whether that is a moderate motion."""
    try:
        rough = rough_motion(phase)
        trajectory = simulate(phase, {}, {}, SIMULATED_BY) if rough is None else None
    except (PyRobocopError, ArithmeticError, ValueError) as error:  # a rule may raise these at such values
        logger.info("phase '%s' cannot be simulated as a start: %s", phase.name, error)
        return False
    states = (rough or {}) if trajectory is None else trajectory.states
    if not all(np.abs(of).max() < 1e6 for of in states.values()):
        return False
    if trajectory is None:
        PhaseValues(phase).set(states)
    else:
        phase.initialize(trajectory)
    return True


def _give_values(model: Any) -> None:
    """Give free variables without a value the number nearest to zero within their bounds."""
    for variable in model.component_data_objects(Var, active=True):
        if variable.value is None and not variable.fixed:
            variable.set_value(within_bounds(0.0, variable), skip_validation=True)
