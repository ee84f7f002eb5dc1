"""Forward simulation: what a phase does from its initial values under given controls.

Explicit differential equations are integrated by SciPy, element by element. With implicit and algebraic equations, step
maps, or pairs that determine algebraics or forces, each element is one step of the scheme, in which all of it is solved
together (`implicit_steps`). Bounds and path constraints are ignored.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from typing import Any

import numpy as np
from pyomo.core.base.var import Var

from pyrobocop_pyomo.errors import InitialGuessError, SimulationFailed, TrajectoryError
from pyrobocop_pyomo.modeling.shared_nodes import variables_read
from pyrobocop_pyomo.modeling.variable_values import put_values, values_restored
from pyrobocop_pyomo.numerics import Array, Grid, Mesh
from pyrobocop_pyomo.trajectories import Trajectory
from pyrobocop_pyomo.transcription import can_step

from .coupled_phases import coupled_phases_of
from .declarations import Algebraic, Control
from .delays import MotionSoFar
from .families import guesses_by_component, names_by_component
from .horizon import real_grid
from .impacts import Impacts
from .implicit_steps import RowStep, StepSystem
from .instant_equations import known_equations
from .nodes import InitialGuess, initial_number
from .phase_values import PhaseValues, read_values
from .record import PhaseRecord
from .right_hand_sides import RightHandSides, TooManyEvaluations
from .rule_formulas import RuleFormulas
from .stated_numbers import moving_end
from .step_equations import StepEquations, by_points, pairs_on_model

LOGGER = logging.getLogger(__name__)

# Of a step: how far states are moved on to see how fast gaps change.
_LITTLE = 1e-6

_WHAT_IS_MISSING = "has no value to simulate with. Give it in the call, or an initial guess."

METHODS = ("RK45", "RK23", "DOP853", "Radau", "BDF", "LSODA", "scheme")


@dataclass(frozen=True)
class SimulationOptions:
    """How to integrate.

    Attributes
    ----------
    method : str
        One of `scipy.integrate.solve_ivp`, or ``"scheme"``: the rows of the scheme.
    rtol, atol : float
        Tolerances of `solve_ivp`.
    unknown : sequence of str, optional
        Algebraics and controls that are to be found.
    restitution : mapping of name of a pair to number
        Coefficients of Newton's law of impact.
    most_evaluations : int, optional
        Of the right-hand sides, in all; the simulation stops beyond.
    """

    method: str = "DOP853"
    rtol: float = 1e-9
    atol: float = 1e-10
    unknown: Sequence[str] | None = None
    restitution: Mapping[str, float] = field(default_factory=dict)
    most_evaluations: int | None = None


def simulate(
    block: Any, controls: Mapping[str, InitialGuess], initial: Mapping[str, float], options: SimulationOptions
) -> Trajectory:
    """See `PhaseBlockData.simulate`."""
    record: PhaseRecord = block.record
    what = f"phase '{block.name}'"
    if options.method not in METHODS:
        raise InitialGuessError(f"{what}: method {options.method!r} is unknown; choose one of {', '.join(METHODS)}.")
    controls, initial = (guesses_by_component(record, given, what) for given in (controls, initial))
    if options.unknown is not None:
        options = replace(options, unknown=names_by_component(record, options.unknown))
    run = _Run(block, controls, initial, options)
    with run.on_model():
        for i in range(record.grid.mesh.elements):
            failure = run.through(i)
            if failure:
                kept = f"the {i} elements before" if i else "nothing before"
                raise SimulationFailed(
                    f"{what}: the simulation stopped at t = {run.reached:g}: {failure}. Kept in error.trajectory: "
                    f"{kept}. Give other controls or initial values, or another method.",
                    run.reached,
                    run.trajectory(i) if i else None,
                )
        return run.trajectory(record.grid.mesh.elements)


class _Run:
    """The values so far, on the model.

    Parameters
    ----------
    block, controls, initial, options
        As for `simulate`.

    Attributes
    ----------
    grid : Grid
        In real time.
    contact : bool
        Whether pairs determine some of it.
    reached : float
        The time at which equations were evaluated last.
    """

    def __init__(
        self, block: Any, controls: Mapping[str, InitialGuess], initial: Mapping[str, float], options: SimulationOptions
    ) -> None:
        record: PhaseRecord = block.record
        self._block, self._record, self._options = block, record, options
        self.grid, names = real_grid(block), record.names_of_states
        self._unknown, self.contact = find_unknowns(block, controls, options.unknown)
        self._given = given_values(block, controls, self._unknown)
        self._start = initial_states(block, initial)
        if options.restitution and not can_step(record.grid.scheme):
            raise InitialGuessError(
                f"phase '{block.name}': restitution needs one step per element; {record.grid.scheme.name} has "
                f"{record.grid.scheme.stages} stages. Use scheme='implicit_euler'."
            )
        if options.restitution and not self.contact:
            raise InitialGuessError(
                f"phase '{block.name}': restitution is given, but no pair determines anything in this simulation. "
                "Leave out of controls={...} what pairs are to find, or name it in unknown=[...]."
            )
        implicit = set(names) - record.equation_of.keys()
        self._is_stepped = options.method == "scheme" or bool(self._unknown or implicit or record.discrete_states)
        self._values = PhaseValues(block)
        self._variables = self._values.variables
        for name in self._unknown:
            if len(self._variables[name]) != len(record.grid.points):
                raise InitialGuessError(
                    f"phase '{block.name}': '{name}' has {len(self._variables[name])} values, and a simulation finds "
                    f"one at each of {len(record.grid.points)} points. Give it in controls={{...}}."
                )
        self._ends = np.searchsorted(record.grid.times, record.grid.mesh.boundaries)
        # What unknowns were last, where the search for them starts.
        self._last = {
            name: next((v.value for v in self._variables[name] if v.value is not None), 0.0) for name in self._unknown
        }
        self.reached = self.grid.mesh.boundaries[0]
        self._rates: RightHandSides | None = None  # where SciPy integrates
        self._rows: list[StepEquations] = []  # of steps

    @contextmanager
    def on_model(self) -> Iterator[None]:
        """Context in which the phase has what the simulation knows: what is given, the start, and then each element.

        Rules may read other times than their own. What has not been simulated yet has no value meanwhile.
        """
        block, record = self._block, self._record
        with values_restored(block.component_data_objects(Var)):
            for variable in chain.from_iterable(self._variables.values()):
                variable.set_value(None, skip_validation=True)
            for name, values in self._given.items():
                put_values(self._variables[name], values.tolist())
            for name, number in zip(record.names_of_states, self._start.tolist(), strict=True):
                self._variables[name][0].set_value(number, skip_validation=True)
            self._state_equations()
            yield

    def _state_equations(self) -> None:
        """Take the formulas of the rules; of steps the rows at the points."""
        block, record = self._block, self._record
        if not self._is_stepped:
            given = replace(self._values.trajectory(self._known(), evaluate=False), states={}, rates={})
            formulas = RuleFormulas(block, self.grid, coupled_phases_of(block, self.grid))
            self._rates = rates = RightHandSides(formulas, given, known_equations(formulas, all_given=True))
            self._so_far = MotionSoFar(record.names_of_states, rates.past, self.reached, self._start)
            rates.past, rates.most_evaluations = self._so_far, self._options.most_evaluations or np.inf
            return
        self._rows = by_points(block, self._unknown, self.contact)
        states = {id(variable) for name in record.names_of_states for variable in self._variables[name]}
        for point, of in zip(record.grid.points, self._rows, strict=True):
            if len(of.rows) + len(of.pairs) != len(of.unknowns):
                raise InitialGuessError(
                    f"phase '{block.name}': at t = {point:g} there are {len(of.rows)} equations and {len(of.pairs)} "
                    f"pairs for {len(of.unknowns)} unknowns beside the states ({', '.join(of.unknowns) or 'none'}). A "
                    "simulation needs as many. Say what is to be found by unknown=[...], and give the rest in "
                    "controls={...}."
                )
        self._impacts = Impacts(self._rows[0].pairs, self._options.restitution, states, f"phase '{block.name}'")
        for of in self._rows:
            of.pairs[:] = self._impacts.gaps_first(of.pairs)

    def through(self, i: int) -> str:
        """Find one element; returns what has failed, in words, or nothing."""
        self.reached = self.grid.mesh.boundaries[i]
        try:
            with np.errstate(all="ignore"):
                return self._step(i) if self._is_stepped else self._integrate(i)
        except TrajectoryError:
            raise  # a rule that cannot be evaluated says nothing about the motion
        except TooManyEvaluations:
            why = f"it took more than {self._options.most_evaluations} evaluations"
        except (ArithmeticError, ValueError) as error:  # of a logarithm of a negative number, a division by zero
            said = str(error).splitlines()[0] if str(error) else type(error).__name__
            why = f"the equations have no value ({(self._rates and self._rates.undefined()) or said})"
        if self._rates is not None:
            self.reached = float(self._rates.reached)
        return why

    def _integrate(self, i: int) -> str:
        """Integrate one element with SciPy."""
        scheme, options, rates = self._record.grid.scheme, self._options, self._rates
        assert rates is not None
        places, why = np.union1d(scheme.state_nodes, [0.0, 1.0]), ""
        if len(self._start):
            settings: dict[str, Any] = {"method": options.method, "rtol": options.rtol, "atol": options.atol}
            so_far = self._so_far if rates.are_delayed else None
            start, ends = self._start[:, None, None], np.array([0.0, 1.0])
            found, why = rates.through(slice(i, i + 1), start, ends, places, so_far, **settings)
            states = found[:, 0, 0].T
        else:
            states = np.zeros((len(places), 0))
        if why:
            self.reached = float(rates.reached)
            return f"SciPy's {options.method} gave up ({why})"
        nodes = states[np.searchsorted(places, scheme.state_nodes)]
        nodes[0] = self._start  # which is known without rounding
        first = 0 if scheme.starts_on_a_stage else 1
        at_stages = nodes[first : first + scheme.stages].T[:, None, None]
        slopes = rates.values(rates.equations.rates, scheme.c, at_stages, slice(i, i + 1))[:, 0, 0] / rates.widths[i]
        self._take(i, nodes, states[-1], slopes, np.zeros((0, scheme.stages)))
        return ""

    def _step(self, i: int) -> str:
        """Solve one element as a step of the scheme."""
        grid, names = self._record.grid, self._record.names_of_states
        system = self._system(i, 1.0)
        guess = system.point_from(self._start, [self._last.get(name, 0.0) for name in self._rows[0].unknowns])
        system.values(guess)  # which raises what a rule lacks
        shortest = 1.0 if self._record.discrete_states else _LITTLE
        solution = self._impacts.solved(system, guess, partial(self._system, i), shortest)
        if not solution.solved:
            of = self._rows[0]
            places = [f"the equation of '{name}'" for _ in grid.scheme.D for name in names]
            stated = [*(f"the row '{name}'" for name in of.names_of_rows), *(f"the pair '{p.name}'" for p in of.pairs)]
            places += [place for place in stated for _ in range(system.stages_solved)]
            where = places[solution.worst]
            return f"the rows of element {i} were not solved (residual {solution.residual:.1e} in {where})"
        nodes, unknowns = system.parts(solution.point)
        self._last = dict(zip(self._rows[0].unknowns, unknowns[:, -1].tolist(), strict=True))
        ends, found = grid.scheme.end_weights @ nodes, unknowns[len(unknowns) - len(self._unknown) :]
        self._take(i, nodes, ends, system.rates(solution.point), found)
        return ""

    def _system(self, i: int, share: float) -> StepSystem:
        """The equations of a share of an element, from its start on."""
        grid, names = self._record.grid, self._record.names_of_states
        stages = grid.stage_positions[i]
        shared = stages[: int(grid.elements_share_points and i > 0)]
        unknowns = [[of.value for of in self._rows[k].unknowns.values()] for k in shared]
        known = np.array(unknowns).reshape(len(shared), len(self._rows[0].unknowns)).T
        maps = np.array([share > 0.0 and name in self._record.discrete_states for name in names], dtype=bool)
        nodes = [self._variables[name][k] for k in grid.node_positions[i, 1:] for name in names]
        length, rows = share * float(self.grid.mesh.widths[i]), [self._rows[k] for k in stages]
        return RowStep(rows, nodes, length, self._start, grid.scheme, known=known, maps=maps)

    def _take(self, i: int, nodes: Array, end: Array, rates: Array, unknowns: Array) -> None:
        """Keep an element: states (nodes, n) and (n,), derivatives (n, s) and unknowns (m, s) at the stages."""
        record, grid = self._record, self._record.grid
        stages = grid.stage_positions[i]
        for j, name in enumerate(record.names_of_states):
            self._put(name, np.append(grid.node_positions[i], self._ends[i + 1]), np.append(nodes[:, j], end[j]))
            self._put(f"{name}_derivative", stages, rates[j])
        for name, numbers in zip(self._unknown, unknowns, strict=True):
            self._put(name, stages, numbers)
        self._start = end

    def _put(self, name: str, positions: Any, numbers: Array) -> None:
        if name in self._variables:
            put_values([self._variables[name][k] for k in positions.tolist()], numbers.tolist())

    def _known(self) -> dict[str, Array]:
        """The values so far; NaN for what has none yet."""
        return {name: np.array([of.value for of in each], dtype=float) for name, each in self._variables.items()}

    def trajectory(self, elements: int) -> Trajectory:
        """The first elements as a trajectory."""
        whole = self._values.trajectory(self._known())
        if elements == whole.grid.mesh.elements:
            return whole
        grid = Grid(whole.grid.scheme, Mesh(whole.grid.mesh.boundaries[: elements + 1]))
        lengths = {len(whole.time): len(grid.times), len(whole.points): len(grid.points)}

        def begun(values: Mapping[str, Array]) -> dict[str, Array]:
            return {name: of[..., : lengths[of.shape[-1]]] for name, of in values.items()}

        groups = ("states", "signals", "rates", "pairs", "expressions")
        begins: dict[str, Any] = {group: begun(getattr(whole, group)) for group in groups}
        return replace(whole, grid=grid, piecewise_linear={}, **begins)


def find_unknowns(
    block: Any, given: Mapping[str, InitialGuess], asked: Sequence[str] | None = None
) -> tuple[tuple[str, ...], bool]:
    """What is to be found beside the states, and whether pairs determine some of it.

    Parameters
    ----------
    block : PhaseBlock
    given : mapping of name to values
        Only the names count.
    asked : sequence of str, optional
        Algebraics and controls that are to be found; by default what equations and pairs suffice for: the algebraics
        that are not given and, where pairs then outnumber the unknowns, the controls that stand in pairs as well.

    Raises
    ------
    InitialGuessError
        When a name is unknown, or equations and unknowns do not match.
    """
    record: PhaseRecord = block.record
    algebraics, controls = record.names(Algebraic), record.names(Control)
    for name in (*given, *(asked or ())):
        if name not in algebraics + controls:
            raise InitialGuessError(
                f"phase '{block.name}': '{name}' is given to a simulation, but it is neither control nor algebraic; "
                f"these are {', '.join(controls + algebraics) or 'none'}."
            )
    on_model = pairs_on_model(block)
    pairs = max(Counter(index[0] if isinstance(index, tuple) else index for index, _ in on_model).values(), default=0)
    if asked is not None:
        twice = [name for name in asked if name in given]
        if twice:
            raise InitialGuessError(f"phase '{block.name}': '{twice[0]}' is both given and to be found.")
        return tuple(asked), pairs > 0 and bool(asked)
    implicit = tuple(name for name in record.names_of_states if name not in record.equation_of)
    equations = record.residuals_per_point - len(implicit)
    free = tuple(name for name in algebraics if name not in given)
    sides = {id(variable) for _, data in on_model for side in data.args for variable in variables_read(side)}
    of_pairs = [name for name in controls if any(id(v) in sides for v in record.nodes(name).variables(block))]
    for found in (free, (*free, *(name for name in of_pairs if name not in given))):
        if pairs and equations + pairs == len(found):
            return found, True
    if equations in (0, len(free)):  # without any, pairs alone would have to determine them: they keep their guess
        if pairs:
            LOGGER.info("phase '%s': the simulation looks at no pairs; they determine nothing in it.", block.name)
        return free if equations else (), False
    raise InitialGuessError(
        f"phase '{block.name}': a simulation has {record.residuals_per_point} residual equations and {pairs} pairs per "
        f"point for {len(implicit) + len(free)} unknowns: {', '.join((*implicit, *free)) or 'none'}. Give in "
        "controls={...} what neither determines, or say by unknown=[...] what is to be found."
    )


def given_values(block: Any, given: Mapping[str, InitialGuess], unknown: Sequence[str]) -> dict[str, Array]:
    """Values over its nodes of everything that is not to be found: as given, or as the phase has them.

    Raises
    ------
    InitialGuessError
        When a value has the wrong length, is missing or is not finite.
    """
    nodes = {name: block.record.nodes(name) for name in block.record.names_of_signals if name not in unknown}
    return {
        name: of.from_guess(given[name], f"phase '{block.name}': '{name}'")
        if name in given
        else read_values(of.variables(block), InitialGuessError, _WHAT_IS_MISSING)
        for name, of in nodes.items()
    }


def initial_states(block: Any, given: Mapping[str, float]) -> Array:
    """Where the states start: as given, or as the phase holds them.

    Raises
    ------
    InitialGuessError
        When a name is no state or a value no finite number.
    """
    record: PhaseRecord = block.record
    names = record.names_of_states
    unknown = [name for name in given if name not in names]
    if unknown:
        raise InitialGuessError(
            f"phase '{block.name}': an initial value is given for '{unknown[0]}'; its states are "
            f"{', '.join(names) or 'none'}."
        )
    found = {name: initial_number(of, f"phase '{block.name}': initial value of '{name}'") for name, of in given.items()}
    for name in (name for name in names if name not in found):
        followed, first = moving_end(block, name, record.declarations[name], "initial"), record.grid.times[0]
        if followed is None:
            followed = read_values([block.component(name)[first]], InitialGuessError, _WHAT_IS_MISSING)[0]
        found[name] = followed
    return np.array([found[name] for name in names], dtype=float)


def rough_motion(block: Any) -> dict[str, Array] | None:
    """The motion under controls as a phase has them, by Runge-Kutta steps from node to node, as starts need it.

    `simulate` takes five times as long, and starts from it lead to no better optima.

    Parameters
    ----------
    block : PhaseBlock
        Every free variable has a value.

    Returns
    -------
    dict of str to array, or None
        Each state at the nodes; None where more is to be found than states that have explicit equations, or these read
        earlier times.
    """
    record, grid = block.record, block.record.grid
    is_explicit = set(record.equation_of) - record.discrete_states >= set(record.names_of_states)
    if not is_explicit or record.names(Algebraic) or record.delayed_names:
        return None
    planned = PhaseValues(block).trajectory(evaluate=False)
    formulas = RuleFormulas(block, planned.grid, coupled_phases_of(block, planned.grid))
    rates = RightHandSides(formulas, planned, known_equations(formulas, all_given=True))
    nodes = grid.scheme.state_nodes
    places = np.union1d(nodes, [0.0, 1.0])
    with np.errstate(all="ignore"):
        along = rates.roughly(initial_states(block, {}), places)
    found = np.empty((len(record.names_of_states), len(grid.times)))
    found[:, np.searchsorted(grid.times, grid.mesh.boundaries[1:])] = along[:, -1].T
    found[:, grid.node_positions] = along[:, np.searchsorted(places, nodes)].transpose(2, 0, 1)
    return dict(zip(record.names_of_states, found, strict=True))
