"""`PhaseBlockData`: what one phase holds and what can be said to it; `PhaseBlock` makes them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from difflib import get_close_matches
from inspect import isroutine
from numbers import Real
from types import MappingProxyType
from typing import Any, ClassVar

from pyomo.common.gc_manager import PauseGC
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.indexed_component import IndexedComponent
from pyomo.core.base.set import Set
from pyomo.core.expr.numvalue import NumericValue

from pyrobocop_pyomo.errors import InitialGuessError, ModelError, TrajectoryError
from pyrobocop_pyomo.modeling.blocks import BuiltBlockData, Rule, blocks_of_kind
from pyrobocop_pyomo.modeling.variable_families import VariableFamily
from pyrobocop_pyomo.numerics import Grid, Scheme, find_scheme
from pyrobocop_pyomo.templates.slots import Clock, Derivative, RateOf
from pyrobocop_pyomo.templates.template import OverTime, Reading, Template, TimeTemplate, is_asked_for_all_times
from pyrobocop_pyomo.trajectories import Trajectory

from .declarations import (
    UNBOUNDED,
    Bounds,
    BoundsOverTime,
    Control,
    Declaration,
    Duration,
    FunctionOfTime,
    Law,
    Parameter,
)
from .equations import RUN_AGAIN, add_derivative, add_statement, name_of_rows, named_integral
from .families import OneOf, component_declarations, family_names, name_of
from .horizon import add_horizon, checked_duration, make_mesh, real_time
from .initial_guesses import set_guesses, set_straight_lines, set_trajectory
from .nodes import InitialGuess
from .phase_values import PhaseValues
from .record import AT_BOUNDARIES, PhaseRecord, Statement, note_stated
from .reintegration import Reintegration, reintegrate
from .remeshing import remesh_phases
from .simulation import SimulationOptions, simulate
from .stated_numbers import in_numbers
from .structure import check_phase
from .variables import add_variables, control_rate
from .verification import Verification, verify

# What other packages call a part of a phase -> what it is called here.
_OTHER_WORDS = {
    **dict.fromkeys(("T", "tf", "horizon", "length"), "duration"),
    **dict.fromkeys(("final", "end", "t_f", "tN"), "final_time"),
    **dict.fromkeys(("initial", "t0", "t_0", "start_time"), "initial_time"),
    **dict.fromkeys(("plot", "results", "solution", "values"), "trajectory"),
    **dict.fromkeys(("initialise", "set_initial_guess", "set_initial", "guess", "initial_guess"), "initialize"),
    **dict.fromkeys(("dynamics", "equation", "equations", "set_der", "rhs", "odes"), "ode"),
    **dict.fromkeys(("subject_to", "constraints", "path_constraint"), "constraint"),
    **dict.fromkeys(("cost", "objective", "running_cost", "minimize", "integrate"), "integral"),
    **dict.fromkeys(("algebraic", "alg", "dae"), "residual"),
    **dict.fromkeys(("complements", "complement", "pair"), "complementarity"),
}
_OFFERED = ("duration", "integral", "points", "time", "initialize", "trajectory", "constraint", "complementarity")


class PhaseBlockData(BuiltBlockData):
    """One phase; see `PhaseBlock` for how to make one.

    Attributes
    ----------
    time : Set
        Times at which the states live: element boundaries and collocation points.
    points : Set
        Collocation points: where equations hold and where algebraics and controls live.
    duration : float or Var
        How long the phase lasts.
    """

    _kind = "phase"
    _error = ModelError
    _other_words: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(("nfe", "n", "N", "intervals", "steps", "num_elements"), "elements"),
        **dict.fromkeys(("tf", "T", "t_final", "final_time", "horizon", "end"), "duration"),
        **dict.fromkeys(("ncp", "degree", "order", "num_stages", "points"), "stages"),
        **dict.fromkeys(("method", "collocation", "integrator"), "scheme"),
        **dict.fromkeys(("t0", "initial_time", "start_time"), "start"),
    }

    # ---------------------------------------------------------------- declarations

    def __setattr__(self, name: str, value: Any) -> None:
        if isinstance(value, (Declaration, Law)):
            self.declare(name, value)
        elif isinstance(value, type) and issubclass(value, (Declaration, Law)):
            raise ModelError(f"{self._what}: '{name}' was given the class; write {value.__name__}().")
        elif getattr(value, "__name__", "") == "<lambda>":
            raise ModelError(
                f"{self._what}: a function was assigned to '{name}', which states nothing. Say what it is: "
                f"constraint(rule, name='{name}'), residual(...), ode(...), or an Expression with a rule."
            )
        else:
            super().__setattr__(name, value)

    def declare(self, name: str, declaration: Declaration | Law) -> None:
        """Add the variables of a declaration, or all that a law states; ``phase.name = declaration`` does the same.

        Raises
        ------
        ModelError
            When the name is taken or the declaration contradicts itself.
        InitialGuessError
            When the initial guess has the wrong length or is not finite.
        """
        if isinstance(declaration, Duration):
            raise ModelError(f"{self._what}: a Duration is given to PhaseBlock(duration=...), not to '{name}'.")
        if isinstance(declaration, Control) and declaration.one_of and declaration.index is None:
            raise ModelError(
                f"{self._what}: '{name}' (declared at {declaration.declared_at}) is one_of, but no vector: say how "
                "many components it has by index=3."
            )
        with self._all_or_nothing(), PauseGC():
            self._declare(name, declaration)

    def _declare(self, name: str, declaration: Declaration | Law) -> None:
        record, what = self.record, f"{self._what}: {type(declaration).__name__.lower()} '{name}'"
        if hasattr(self, name):
            again = f" {RUN_AGAIN}" if name in record.declarations or name in record.families else ""
            raise ModelError(
                f"{self._what}: the name '{name}' (declared at {declaration.declared_at}) is taken. Choose "
                f"another.{again}"
            )
        if isinstance(declaration, Law):
            declaration.state(self, name)
        elif declaration.index is None:
            self._declare_one(name, in_numbers(declaration, what, record.time_units), what)
        else:
            names = family_names(name, declaration, what)
            for member, of_component in component_declarations(names, declaration, what):
                self._declare(member, of_component)
            record.families[name] = names
            if isinstance(declaration, Control) and declaration.one_of:
                self.constraint(OneOf(name), name=f"{name}_one_of")

    def _declare_one(self, name: str, declaration: Declaration, what: str) -> None:
        limits, history = declaration.bounds, getattr(declaration, "history", None)
        if callable(history):
            declaration = replace(declaration, history=FunctionOfTime(history))  # type: ignore[call-arg]
        if callable(limits) and not isinstance(declaration, Parameter):
            for time in () if self.record.normalised else self.points:
                declaration.bounds_at(time, what)
            declaration = replace(declaration, bounds=UNBOUNDED)
        add_variables(self, name, declaration)
        self.record.declarations[name] = declaration
        if callable(limits) and not isinstance(declaration, Parameter):
            self.constraint(BoundsOverTime(name, limits), name=f"{name}_bounds")

    def __getattr__(self, name: str) -> Any:
        record = self.__dict__.get("_record")
        if record is not None and name in record.families:
            return VariableFamily(self, record.families[name])
        try:
            return super().__getattr__(name)
        except AttributeError:
            if record is None or name.startswith("_"):
                raise
        declared = [*record.declarations, *record.families]
        meant = _OTHER_WORDS.get(name)
        near = [meant] if meant else get_close_matches(name, [*declared, *_OFFERED], n=2)
        hint = f"Did you mean {' or '.join(map(repr, near))}? " if near else ""
        raise AttributeError(
            f"{self._what} has no '{name}'. {hint}Declared on it: {', '.join(map(repr, declared)) or 'nothing yet'}."
        )

    def __dir__(self) -> list[str]:
        record = self.__dict__.get("_record")
        return sorted({*super().__dir__(), *(() if record is None else record.families)})

    def _summary(self) -> str:
        if not self.is_built:
            return super()._summary()
        kinds = Counter(type(declaration).__name__.lower() for declaration in self.record.declarations.values())
        counts = [f"{count} {kind}{'s' if count != 1 else ''}" for kind, count in kinds.items()]
        facts = ", ".join([*counts, f"{self.grid.mesh.elements} elements"])
        return f"{super()._summary()}: {facts} of {self.grid.scheme.name}"

    # ---------------------------------------------------------------- statements

    def ode(self, rule: Rule, name: str | None = None) -> Rule:
        """State explicit differential equations: ``rule(phase, t)`` returns ``{state: right-hand side}``.

        Usable as a decorator. Several rules may share the states among them. The right-hand side is substituted
        into the collocation rows, unless the state's derivative is kept as a variable.

        Parameters
        ----------
        rule : callable
            Called at each collocation point ``t``; keys of its result are states (or their names), values of vectors
            and matrices are arrays.

        Raises
        ------
        ModelError
            When a key is no state, a state gets a second equation, or an array has another length than the state.
        """
        return self._state("ode", rule, name)

    def step_map(self, rule: Rule, name: str | None = None) -> Rule:
        """State a map from element to element: ``rule(phase, t, previous)`` returns ``{state: value at the end}``.

        Usable as a decorator, for states that no differential equation describes well: a rotation matrix that turns by
        the exponential map, a counter, a discrete-time model. ``previous.x`` is the value of a state where the
        element starts; at the collocation point ``t`` everything may be read. Such a state has no derivative. Between
        element boundaries a trajectory joins its values by lines.

        Parameters
        ----------
        rule : callable
            Called for each element; keys of its result are states (or their names).

        Raises
        ------
        ModelError
            When the scheme has more than one stage, or one inside the element; when a key is no state, a state gets a
            second equation, or its derivative is in use.
        """
        return self._state("step map", rule, name)

    def residual(self, rule: Rule, name: str | None = None) -> Rule:
        """State implicit or algebraic equations: ``rule(phase, t)`` returns one or several equalities.

        Usable as a decorator. A bare expression means ``expression == 0``; a list, tuple or dict
        states several equations. ``phase.derivative(phase.x)[t]`` is the derivative of a state.

        Raises
        ------
        ModelError
            When a result is no equality.
        """
        return self._state("residual", rule, name)

    def constraint(self, rule: Rule, name: str | None = None) -> Rule:
        """State path constraints: ``rule(phase, t)`` returns one or several relations.

        Usable as a decorator. The rows are named after the function, or by `name`; those of a lambda are numbered,
        ``constraint_1``. They hold at each collocation point. Unlike residuals they do not
        count as equations that determine states and algebraics. A tuple ``(lower, body, upper)`` is one
        relation, as everywhere in Pyomo.

        Raises
        ------
        ModelError
            When a result is no relation.
        """
        return self._state("constraint", rule, name)

    def constraint_at_boundaries(self, rule: Rule, name: str | None = None) -> Rule:
        """State path constraints on the states at every element boundary, start and end included.

        As `constraint`, for what has to hold there too: the stages of a Gauss scheme lie inside the elements, and no
        scheme but those that start on a stage asks anything at the start of the phase.

        Raises
        ------
        ModelError
            When a result is no relation, or the rule reads what has no value at a boundary, such as a control.
        """
        return self._state(AT_BOUNDARIES, rule, name)

    def complementarity(self, rule: Rule, name: str | None = None) -> Rule:
        """State complementarity: ``rule(phase, t)`` returns ``complements(a >= 0, b >= 0)``, or a list of such.

        Usable as a decorator. The component carries the element of each pair, so that
        relaxations can be grouped per element.
        """
        return self._state("complementarity", rule, name)

    def derivative(self, state: Any) -> Mapping[float, Any]:
        """The time derivative of a state at each collocation point.

        Parameters
        ----------
        state : Var or str
            A state of this phase.

        Returns
        -------
        mapping of collocation point to expression or variable
            The substituted right-hand side once an `ode` gave it; otherwise a variable of its own,
            named ``<state>_derivative``, which is made when first asked for.

        Raises
        ------
        ModelError
            When it is no state of this phase, or one that a step map leads.
        """
        if (family := self._family(state)) is not None:
            return family.of_each(self.derivative)  # type: ignore[return-value]
        name = self.state_name(state)
        if is_asked_for_all_times():
            return OverTime(Derivative(self.component(name)))  # type: ignore[return-value]
        if name in self.record.discrete_states:
            raise ModelError(
                f"{self._what}: '{name}' has no derivative; the step map '{self.record.equation_of[name]}' leads it "
                "from element to element."
            )
        if name in self.record.rates:
            return self.record.rates[name]
        if name in self.record.kept_derivatives:
            return self.component(f"{name}_derivative")
        with self._all_or_nothing():
            return add_derivative(self, name)

    def integral(self, integrand: Rule) -> Any:
        """Integral of ``integrand(phase, t)`` over the phase, by the quadrature of the scheme.

        Returns
        -------
        expression
            For an objective or a constraint; over real time also when the duration is a variable. It follows the mesh
            of the phase.

        Raises
        ------
        ModelError
            When it is given a variable, or the integrand has no value at some point.
        """
        if is_asked_for_all_times():
            raise ModelError(f"{self._what}: a rule that takes an integral is called at each point.")
        if isinstance(integrand, IndexedComponent):
            name = integrand.local_name
            raise ModelError(
                f"{self._what}: integral was given the variable '{name}'; it takes a rule. Write "
                f"integral(lambda b, t: b.{name}[t])."
            )
        with PauseGC():
            return named_integral(self, integrand)

    def time_at(self, t: float) -> Any:
        """The time that the index ``t`` stands for: ``t`` itself, or an expression in what is to be found."""
        if isinstance(t, TimeTemplate):
            return Reading(Clock(self))
        return real_time(self, t)

    def rate_of(self, control: Any) -> Mapping[float, Any]:
        """Rate of change of a control in real time, as seen at each collocation point.

        The slope of a piecewise linear control; for the others the difference to the value before, over the distance
        of their times. Meant for costs: ``phase.integral(lambda b, t: b.rate_of(b.u)[t] ** 2)``.

        Parameters
        ----------
        control : Var, Expression or str
            A control of this phase.

        Raises
        ------
        ModelError
            When it is no control of this phase.
        """
        if (family := self._family(control)) is not None:
            return family.of_each(self.rate_of)  # type: ignore[return-value]
        name = name_of(control)
        if name not in self.record.names(Control):
            known = ", ".join(self.record.names(Control)) or "none"
            raise ModelError(f"{self._what}: '{name}' is no control; its controls are {known}.")
        if is_asked_for_all_times():
            return OverTime(RateOf(self, (name,)))  # type: ignore[return-value]
        return MappingProxyType(control_rate(self, name))

    # ---------------------------------------------------------------- facts and results

    @property
    def record(self) -> PhaseRecord:
        """Grid, declarations and rules behind this phase."""
        return self._record_if_built(ModelError)

    @property
    def grid(self) -> Grid:
        """Scheme, mesh and the times they give."""
        return self.record.grid

    @property
    def initial_time(self) -> float:
        """First index of ``time``."""
        return self.grid.mesh.boundaries[0]

    @property
    def final_time(self) -> float:
        """Last index of ``time``."""
        return self.grid.mesh.boundaries[-1]

    @property
    def has_free_duration(self) -> bool:
        """True when the duration is a variable."""
        return isinstance(self.record.duration, Duration)

    @property
    def has_normalised_time(self) -> bool:
        """True when time indices run from 0 to 1: start, duration or element boundaries are to be found."""
        return self.record.normalised

    def state_name(self, state: Any) -> str:
        """Name of a state given by its variable or its name.

        Raises
        ------
        ModelError
            When it is no state of this phase.
        """
        name = name_of(state)
        declared = self.record.names_of_states
        known = name in declared and (isinstance(state, str) or self.component(name) is state)
        if not known:
            raise ModelError(f"{self._what}: '{name}' is no state; its states are {', '.join(declared) or 'none'}.")
        return name

    def _family(self, given: Any) -> VariableFamily | None:
        """A vector or a matrix of this phase, given itself or by its name."""
        if isinstance(given, str) and given in self.record.families:
            return VariableFamily(self, self.record.families[given])
        return given if isinstance(given, VariableFamily) else None

    def check(self) -> None:
        """Check that the equations fit the declared variables.

        Raises
        ------
        ModelError
            Naming the state without equation, the counts that do not match, the variable that appears nowhere, or
            the equations that determine no derivative and no algebraic.
            When the duration is fixed at no positive value.
        """
        check_phase(self)

    def trajectory(self) -> Trajectory:
        """The current values, as a trajectory that can be read, plotted, verified and saved."""
        return PhaseValues(self).trajectory()

    def verify(self, trajectory: Trajectory) -> Verification:
        """Check a trajectory against this phase's equations, recomputed; see `Verification`."""
        return verify(self, trajectory)

    # ---------------------------------------------------------------- beyond stating and solving

    def initialize(
        self, guess: Trajectory | Mapping[Any, InitialGuess] | None = None, /, **by_name: InitialGuess
    ) -> None:
        """Set where the solver starts, any time after the declarations.

        Variables that are fixed keep their values, bounds are left alone, and a value outside of its bounds is moved
        onto the nearest. Derivatives that are variables follow their states.

        Parameters
        ----------
        guess : Trajectory or dict
            A trajectory of any mesh, scheme and duration is evaluated by its own polynomials, its horizon stretched
            onto that of the phase, and a free duration gets its; names in common are set. A dict has names or variables
            as keys; each initial guess is a number, a function of the time index, or an array as in a declaration.
            ``"duration"``, parameters and ``"<state>_derivative"`` are names as well.
        **by_name : number, array or function
            The same, as in ``initialize(theta=0.5)``; these win.

        Raises
        ------
        InitialGuessError
            Naming what is unknown, of the wrong length or not finite; nothing is set then.
        """
        if isinstance(guess, Trajectory):
            set_trajectory(self, guess)
        elif isinstance(guess, Mapping):
            by_name = {**guess, **by_name}
        elif guess is not None:
            raise InitialGuessError(
                f"phase '{self.name}': an initial guess is a trajectory or a mapping of names to initial guesses, "
                f"not a {type(guess).__name__}."
            )
        set_guesses(self, by_name)

    def initialize_straight_lines(self) -> None:
        """Lead every state from its initial to its final value on a straight line.

        A range counts with the value nearest to the other end. A state with one stated end stays there; one with
        none keeps its initial guess. Controls and algebraics keep theirs.
        """
        set_straight_lines(self)

    def simulate(
        self,
        controls: Mapping[str, InitialGuess] | None = None,
        *,
        initial: Mapping[str, float] | None = None,
        method: str = "DOP853",
        rtol: float = 1e-9,
        atol: float = 1e-10,
        unknown: Sequence[str] | None = None,
        restitution: Mapping[str, float] | None = None,
    ) -> Trajectory:
        """What the equations do from the initial values on, as a trajectory on the phase's own grid.

        Explicit differential equations are integrated by `scipy.integrate.solve_ivp`, element by element with the
        polynomials of controls. With residual equations, step maps, or ``method="scheme"``, the rows of the scheme
        are solved element by element. Where pairs determine what is left, such as the forces of contacts, the rows
        and pairs of an element are solved together, as a mixed complementarity problem. Nothing on the model changes:
        use ``phase.initialize(trajectory)`` to start from the result.

        Parameters
        ----------
        controls : dict of str to number, array or function
            Controls, and algebraics that are to be taken as given; the others are as the phase holds them. A function
            is called with the time index.
        initial : dict of str to number
            Where states start; as the phase holds them by default.
        method : str
            A method of `solve_ivp` (``"Radau"`` for stiff equations), or ``"scheme"``.
        rtol, atol : float
            Tolerances of `solve_ivp`.
        unknown : sequence of str, optional
            Algebraics and controls that are to be found, in the place of the default: the algebraics that are not given
            and, where there are more pairs than these, the controls that stand in pairs.
        restitution : dict of str to number, optional
            Newton's coefficients of impact, from 0 to 1, by the name of a pair, or of a rule or a contact law for all
            of its pairs of a gap and a force. Without one an impact is inelastic. It takes implicit Euler steps.

        Raises
        ------
        InitialGuessError
            When names, lengths or the number of equations do not fit.
        SimulationFailed
            With the time at which it stopped; the elements before are its attribute ``trajectory``.

        Notes
        -----
        Parameters and the duration are as the phase holds them. Bounds and path constraints are ignored. Algebraics
        are found where residual equations, or these and the pairs, determine all of them, and keep the phase's values
        where there are no such equations. Where several motions meet the pairs, the one that is found first from the
        values of the step before is taken. Time stepping: Stewart and Trinkle, An implicit time-stepping scheme for
        rigid body dynamics with inelastic collisions and Coulomb friction (1996),
        doi:10.1002/(SICI)1097-0207(19960815)39:15<2673::AID-NME972>3.0.CO;2-I
        """
        if isinstance(controls, Trajectory):
            raise InitialGuessError(
                f"phase '{self.name}': simulate was given a trajectory; expected a dict of controls, or nothing for "
                "those that the phase holds. Write phase.initialize(trajectory), then phase.simulate()."
            )
        options = SimulationOptions(
            method=method, rtol=rtol, atol=atol, unknown=unknown, restitution=dict(restitution or {})
        )
        return simulate(self, controls or {}, initial or {}, options)

    def remesh(self, mesh: Any) -> None:
        """Give the phase another mesh, in place; see `remesh_phases`, which takes several at once.

        Components, and variables at times that stay, are the objects that they were. New variables have the values of
        the trajectory that stands on the model.

        Parameters
        ----------
        mesh : int, sequence of float or Mesh
            A number of elements, or element boundaries in the phase's time indices.

        Raises
        ------
        ModelError
            Naming what on the model cannot follow; nothing has changed then.
        ModelError
            When the mesh is none, or does not fit the phase.
        """
        remesh_phases({self: mesh})

    def reintegrate(
        self, trajectory: Trajectory | None = None, *, initial: Mapping[str, float] | None = None
    ) -> Reintegration:
        """The motion that the equations make of a plan under its controls, inside the elements too.

        All elements are integrated at once, by a Radau scheme of order fifteen on parts that are halved until the
        equations hold between its points too; implicit derivatives, algebraics and controls that equations determine
        are found at each instant. Where pairs decide something that the motion depends on, contact is simulated, in
        steps of a Radau scheme that are halved where it opens or closes. All other controls are taken as the
        trajectory's polynomials.

        Parameters
        ----------
        trajectory : Trajectory, optional
            The phase's current values by default.
        initial : dict of state name to number, optional
            Where the open loop starts, such as where the phase before has ended; as the plan does by default.

        Raises
        ------
        TrajectoryError
            When there are no states, or a step map leads them, or equations and pairs do not determine all that the
            motion depends on.
        """
        checked = self.trajectory() if trajectory is None else trajectory
        return reintegrate(self, checked, initial=initial)

    # ---------------------------------------------------------------- construction

    @contextmanager
    def _all_or_nothing(self) -> Iterator[None]:
        """As of every block, and what was stated is noted."""
        before = set() if self._record is None else set(self._record.made)
        with super()._all_or_nothing():
            yield
            note_stated(self, self.record.made.keys() - before)

    def _state(self, kind: str, rule: Rule, name: str | None) -> Rule:
        statement = Statement(kind, name_of_rows(self, kind, rule, name), Template(rule))
        with self._all_or_nothing(), PauseGC():
            add_statement(self, statement)
        return rule

    def _build(
        self,
        *,
        duration: float | Duration | NumericValue,
        elements: int | None,
        mesh: Any,
        scheme: str | Scheme,
        stages: int | None,
        start: Any,
        free_element_widths: Bounds | None,
        allow_higher_index: bool,
        time_units: Any,
    ) -> None:
        """Set up grid, index sets and horizon; every argument is checked before anything is added."""
        if isroutine(start):
            index = self.index()
            start = start(self.parent_block(), *(index if isinstance(index, tuple) else (index,)))
        if isinstance(start, PhaseBlockData):
            start = start.time_at(start.final_time)
        stated, duration = duration, checked_duration(self._what, start, duration)
        normalised = isinstance(duration, Duration) or not isinstance(start, Real) or free_element_widths is not None
        first, last = (0.0, 1.0) if normalised else (float(start), float(start + duration))
        try:
            grid = Grid(find_scheme(scheme, stages), make_mesh(first, last, elements, mesh))
        except ModelError as error:
            raise type(error)(f"{self._what}: {error}") from None
        self._record = PhaseRecord(
            grid,
            duration,
            normalised,
            width_factors=free_element_widths,
            allow_higher_index=bool(allow_higher_index),
            time_units=time_units,
            chosen_times=frozenset() if mesh is None else frozenset(grid.mesh.boundaries),
        )
        self.time = Set(initialize=list(grid.times), ordered=True, doc="element boundaries and collocation points")
        self.points = Set(initialize=list(grid.points), ordered=True, doc="collocation points")
        add_horizon(self, float(start) if isinstance(start, Real) else start)
        if duration is not stated:
            self.duration_as_stated = Constraint(expr=self.duration == stated)


def note_outcome(model: Any, words: str) -> None:
    """Keep with each phase how the solve ended that has left its values: trajectories tell it.

    Parameters
    ----------
    model : Block
    words : str
    """
    for phase in phases_of(model):
        # Where a value is missing, or in units of their own, there is no trajectory to tell it.
        with suppress(TrajectoryError):
            PhaseValues(phase).note_outcome(words)


def phases_of(model: Any) -> list[PhaseBlockData]:
    """The active phases of a model, in the order of their declaration, wherever they are.

    Parameters
    ----------
    model : Block
        A model, a block of it, or a phase itself.
    """
    return blocks_of_kind(model, PhaseBlockData)
