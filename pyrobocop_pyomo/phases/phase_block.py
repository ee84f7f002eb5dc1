"""`PhaseBlock`: one horizon with its states, controls and equations, as an ordinary Pyomo block."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import contextmanager
from numbers import Real
from types import MappingProxyType
from typing import Any

from pyomo.common.gc_manager import PauseGC
from pyomo.core.base.block import Block, BlockData
from pyomo.core.base.component import ModelComponentFactory
from pyomo.core.base.global_set import UnindexedComponent_index, UnindexedComponent_set
from pyomo.core.base.set import Set

from pyrobocop_pyomo.errors import DeclarationError, MeshError, ModelError, TranscriptionError
from pyrobocop_pyomo.numerics import Grid, Mesh, Scheme, find_scheme
from pyrobocop_pyomo.trajectories import Trajectory
from pyrobocop_pyomo.transcription import quadrature

from .consistency import check_phase
from .controls import control_rate
from .declarations import Bounds, Control, Declaration, Duration, Start, check_bounds
from .equations import (
    add_complementarity,
    add_constraint,
    add_constraint_at_boundaries,
    add_derivative,
    add_ode,
    add_residual,
    rule_name,
)
from .extraction import extract_trajectory
from .horizon import add_horizon, quadrature_weights, real_time
from .phase_actions import PhaseActions
from .pickling import picklable_or_none
from .record import PhaseRecord, Statement
from .variables import add_variables
from .verification import Verification, verify

Rule = Callable[..., Any]


class PhaseBlockData(PhaseActions, BlockData):
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

    def __init__(self, component: Any) -> None:
        super().__init__(component)
        self._record: PhaseRecord | None = None

    # ---------------------------------------------------------------- declarations

    def __setattr__(self, name: str, value: Any) -> None:
        if isinstance(value, Declaration):
            self.declare(name, value)
        elif isinstance(value, type) and issubclass(value, Declaration):
            raise DeclarationError(f"{self._what}: '{name}' was given the class; write {value.__name__}().")
        else:
            super().__setattr__(name, value)

    def declare(self, name: str, declaration: Declaration) -> None:
        """Add the variables of a declaration; ``phase.name = declaration`` does the same.

        Raises
        ------
        DeclarationError
            When the name is taken or the declaration contradicts itself.
        GuessError
            When the guess has the wrong length or is not finite.
        """
        if isinstance(declaration, Duration):
            raise DeclarationError(f"{self._what}: a Duration is given to PhaseBlock(duration=...), not to '{name}'.")
        if hasattr(self, name):
            raise DeclarationError(
                f"{self._what}: the name '{name}' (declared at {declaration.declared_at}) is taken. Choose another."
            )
        with self._all_or_nothing(), PauseGC():
            add_variables(self, self.record, name, declaration)
            self.record.declarations[name] = declaration

    # ---------------------------------------------------------------- statements

    def ode(self, rule: Rule) -> Rule:
        """State explicit differential equations: ``rule(phase, t)`` returns ``{state: right-hand side}``.

        Usable as a decorator. Several rules may share the states among them. The right-hand side is substituted
        into the collocation rows, unless the state's derivative is kept as a variable.

        Parameters
        ----------
        rule : callable
            Called at each collocation point ``t``; keys of its answer are states (or their names).

        Raises
        ------
        TranscriptionError
            When a key is no state, or a state gets a second equation.
        """
        return self._state("ode", rule, add_ode)

    def residual(self, rule: Rule) -> Rule:
        """State implicit or algebraic equations: ``rule(phase, t)`` returns one or several equalities.

        Usable as a decorator. A bare expression means ``expression == 0``; a list, tuple or dict
        states several equations. ``phase.derivative(phase.x)[t]`` is the derivative of a state.

        Raises
        ------
        TranscriptionError
            When an answer is no equality.
        """
        return self._state("residual", rule, add_residual)

    def constraint(self, rule: Rule) -> Rule:
        """State path constraints: ``rule(phase, t)`` returns one or several relations.

        Usable as a decorator. They hold at each collocation point. Unlike residuals they do not
        count as equations that determine states and algebraics. A tuple ``(lower, body, upper)`` is one
        relation, as everywhere in Pyomo.

        Raises
        ------
        TranscriptionError
            When an answer is no relation.
        """
        return self._state("constraint", rule, add_constraint)

    def constraint_at_boundaries(self, rule: Rule) -> Rule:
        """State path constraints on the states at every element boundary, start and end included.

        As `constraint`, for what has to hold there too: the stages of a Gauss scheme lie inside the elements, and no
        scheme but those that start on a stage asks anything at the start of the phase.

        Raises
        ------
        TranscriptionError
            When an answer is no relation, or the rule reads what has no value at a boundary, such as a control.
        """
        return self._state("constraint at boundaries", rule, add_constraint_at_boundaries)

    def complementarity(self, rule: Rule) -> Rule:
        """State complementarity: ``rule(phase, t)`` returns ``complements(a >= 0, b >= 0)``, or a list of such.

        Usable as a decorator. The component carries the element of each pair, so that
        relaxations can be grouped per element.
        """
        return self._state("complementarity", rule, add_complementarity)

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
        TranscriptionError
            When it is no state of this phase.
        """
        name = self.state_name(state)
        if name in self.record.rates:
            return MappingProxyType(self.record.rates[name])
        if name in self.record.kept_derivatives:
            return self.component(f"{name}_derivative")
        with self._all_or_nothing():
            return add_derivative(self, self.record, name)

    def integral(self, integrand: Rule) -> Any:
        """Integral of ``integrand(phase, t)`` over the phase, by the quadrature of the scheme.

        Returns
        -------
        expression
            For an objective or a constraint; over real time also when the duration is a variable.
        """
        with PauseGC():
            scale, weights = quadrature_weights(self, self.record)
            total = quadrature(lambda time: integrand(self, time), weights)
            plain = isinstance(scale, float) and scale == 1.0
            return total if plain else scale * total

    def clock(self, t: float) -> Any:
        """The time that the index ``t`` stands for: ``t`` itself, or an expression in what is to be found."""
        return real_time(self, self.record, t)

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
        TranscriptionError
            When it is no control of this phase.
        """
        name = control if isinstance(control, str) else getattr(control, "local_name", repr(control))
        if name not in self.record.names(Control):
            known = ", ".join(self.record.names(Control)) or "none"
            raise TranscriptionError(f"{self._what}: '{name}' is no control; its controls are {known}.")
        return MappingProxyType(control_rate(self, self.record, name))

    # ---------------------------------------------------------------- facts and answers

    @property
    def record(self) -> PhaseRecord:
        """Grid, declarations and rules behind this phase."""
        if self._record is None:
            raise TranscriptionError(f"{self._what} is not constructed yet: add it to a ConcreteModel first.")
        return self._record

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
        TranscriptionError
            When it is no state of this phase.
        """
        name = state if isinstance(state, str) else getattr(state, "local_name", repr(state))
        declared = self.record.names_of_states
        known = name in declared and (isinstance(state, str) or self.component(name) is state)
        if not known:
            raise TranscriptionError(
                f"{self._what}: '{name}' is no state; its states are {', '.join(declared) or 'none'}."
            )
        return name

    def check(self) -> None:
        """Check that the equations fit the declared variables.

        Raises
        ------
        TranscriptionError
            Naming the state without equation, the counts that do not match, the variable that appears nowhere, or
            the equations that determine no derivative and no algebraic.
        """
        check_phase(self, self.record)

    def trajectory(self) -> Trajectory:
        """The current values, as a trajectory that can be read, plotted, verified and saved."""
        return extract_trajectory(self, self.record)

    def verify(self, trajectory: Trajectory) -> Verification:
        """Judge a trajectory by this phase's equations, recomputed; see `Verification`."""
        return verify(self, self.record, trajectory)

    # ---------------------------------------------------------------- construction

    @property
    def _what(self) -> str:
        return f"phase '{self.name}'"

    def _state(self, kind: str, rule: Rule, add: Callable[..., None]) -> Rule:
        with self._all_or_nothing(), PauseGC():
            add(self, self.record, rule)
            self.record.statements.append(Statement(kind, rule_name(rule), rule))
        return rule

    @contextmanager
    def _all_or_nothing(self) -> Iterator[None]:
        """On any error, remove what was added since: nothing half-built stays on the user's model."""
        components = set(self.component_map())
        record = self.record.snapshot()
        try:
            yield
        except BaseException:
            for name in [name for name in self.component_map() if name not in components]:
                self.del_component(name)
            self._record = record
            raise

    def _build(
        self,
        *,
        duration: float | Duration,
        elements: int | None,
        mesh: Any,
        scheme: str | Scheme,
        stages: int | None,
        start: Any,
        moving: Bounds | None,
        allow_higher_index: bool,
        time_units: Any,
    ) -> None:
        """Set up grid, index sets and horizon; every argument is checked before anything is added."""
        if isinstance(start, PhaseBlockData):
            start = start.clock(start.final_time)
        _check_horizon(self._what, start, duration)
        normalised = isinstance(duration, Duration) or not isinstance(start, Real) or moving is not None
        first, last = (0.0, 1.0) if normalised else (float(start), float(start + duration))
        try:
            grid = Grid(find_scheme(scheme, stages), _make_mesh(first, last, elements, mesh))
        except ModelError as error:
            raise type(error)(f"{self._what}: {error}") from None
        self._record = PhaseRecord(
            grid,
            duration,
            normalised,
            moving=moving is not None,
            allow_higher_index=bool(allow_higher_index),
            time_units=time_units,
        )
        self.time = Set(initialize=list(grid.times), ordered=True, doc="element boundaries and collocation points")
        self.points = Set(initialize=list(grid.points), ordered=True, doc="collocation points")
        add_horizon(self, self._record, float(start) if isinstance(start, Real) else start, moving)


def _check_horizon(what: str, start: Any, duration: Any) -> None:
    if (
        isinstance(start, bool)
        or (isinstance(start, Real) and not math.isfinite(start))
        or not (isinstance(start, (Real, Start)) or getattr(start, "is_numeric_type", bool)())
    ):
        raise DeclarationError(
            f"{what}: start = {start!r}; expected a finite number, Start(...), an expression, or the phase before."
        )
    if isinstance(duration, Duration):
        lower, _ = check_bounds(duration.bounds, what, "duration bounds")
        if lower is None or lower <= 0:
            raise DeclarationError(
                f"{what}: the lower bound of the duration is {lower}; it must be positive. "
                "Give Duration(bounds=(0.1, 10), guess=1)."
            )
    elif isinstance(duration, bool) or not isinstance(duration, Real) or not 0 < float(duration) < math.inf:
        raise DeclarationError(f"{what}: duration = {duration!r}; expected a positive number, or Duration(bounds=...).")


def _make_mesh(first: float, last: float, elements: int | None, mesh: Any) -> Mesh:
    if mesh is None:
        return Mesh.uniform(first, last, 10 if elements is None else elements)
    try:
        made = mesh if isinstance(mesh, Mesh) else Mesh.given(mesh)
    except MeshError:
        raise
    except (TypeError, ValueError) as error:
        raise MeshError(f"mesh = {mesh!r} is no sequence of element boundaries ({error}).") from None
    if elements not in (None, made.elements):
        raise DeclarationError(f"elements = {elements}, but the given mesh has {made.elements}. Leave 'elements' out.")
    # Both ends may come out of sums: 0.1 + 0.2 is not 0.3. The mesh, as given, is what counts.
    close = 1e-12 * max(abs(first), abs(last))
    if abs(made.boundaries[0] - first) > close or abs(made.boundaries[-1] - last) > close:
        raise DeclarationError(
            f"the mesh runs from {made.boundaries[0]:g} to {made.boundaries[-1]:g}, the phase from {first:g} to "
            f"{last:g}. A phase with a free start or duration, or with moving elements, takes a mesh from 0 to 1."
        )
    return made


class _BuildPhase:
    """The block rule: our build first, then the user's own rule. A class, because it must survive pickling."""

    def __init__(self, options: dict[str, Any], rule: Rule | None) -> None:
        self.options = options
        self.rule = rule

    def __call__(self, block: PhaseBlockData, *index: Hashable) -> None:
        block._build(**self.options)
        if self.rule is not None:
            # Pyomo passes the index None to a rule of a scalar block that takes any number of arguments.
            self.rule(block, *(index if block.parent_component().is_indexed() else ()))

    def __getstate__(self) -> dict[str, Any]:
        return {"options": self.options, "rule": picklable_or_none(self.rule)}


@ModelComponentFactory.register("A phase of motion: states, controls and equations over one horizon.")
class PhaseBlock(Block):
    """One horizon with its states, algebraics, controls, parameters and equations, transcribed by collocation.

    Parameters
    ----------
    *indexes
        Index sets, as for any Pyomo block.
    duration : float or Duration
        How long the phase lasts. With `Duration` it is a variable, and time indices run from 0 to 1; so they do
        whenever something about the horizon is to be found.
    elements : int, optional
        Number of elements of a uniform mesh; 10 by default.
    mesh : sequence of float or Mesh, optional
        Element boundaries, from start to end, kept exactly as given. In normalised time with a free duration.
    scheme : str or Scheme
        ``"radau"`` (default), ``"gauss"``, ``"implicit_euler"``, ``"implicit_midpoint"``, or a scheme object.
    stages : int, optional
        Collocation points per element; 3 by default.
    start : float, Start, expression or PhaseBlock
        Time at which the phase starts: a number, a variable, an expression, or the phase after whose end it starts.
    moving : (smallest, largest), optional
        Lets the element boundaries move: factors between which each element's width may change, so that a switch
        or a contact can fall on an element end.
    allow_higher_index : bool
        Let equations through that determine derivatives and algebraics only after differentiation. They are
        transcribed as they stand; `check` refuses them otherwise.
    time_units : Pyomo unit, optional
        Units of time, such as ``pyo.units.s``. With them, and with `units` in the declarations, Pyomo's
        ``assert_units_consistent`` judges the transcribed rows.
    rule : callable, optional
        ``rule(phase, *index)`` declares and states everything; needed for indexed phases and abstract models.

    Raises
    ------
    DeclarationError, MeshError, SchemeError
        When the arguments make no grid; the block is then not added to the model.

    Notes
    -----
    The equations hold at the collocation points ``t_{i,k} = t_i + c_k h_i``. States live at element boundaries
    and collocation points, everything else at collocation points only, so that no value is left undetermined.

    References
    ----------
    Raghunathan, Jha & Romeres, PYROBOCOP: Python-based Robotic Control & Optimization Package for Manipulation,
    ICRA 2022, sec. III, doi:10.1109/ICRA46639.2022.9812069

    Examples
    --------
    >>> import pyomo.environ as pyo
    >>> import pyrobocop_pyomo as rcp
    >>> m = pyo.ConcreteModel()
    >>> m.cart = rcp.PhaseBlock(duration=1.0, elements=20)
    >>> m.cart.position = rcp.State(initial=0, final=1)
    >>> m.cart.velocity = rcp.State(initial=0, final=0)
    >>> m.cart.force = rcp.Control(bounds=(-10, 10))
    >>> @m.cart.ode
    ... def newton(b, t):
    ...     return {b.position: b.velocity[t], b.velocity: b.force[t]}
    >>> m.effort = pyo.Objective(expr=m.cart.integral(lambda b, t: b.force[t] ** 2))
    """

    _ComponentDataClass = PhaseBlockData

    def __new__(cls, *args: Any, **kwds: Any) -> PhaseBlock:
        """Choose the scalar or the indexed class."""
        if cls is not PhaseBlock:
            return super().__new__(cls)
        scalar = not args or (args[0] is UnindexedComponent_set and len(args) == 1)
        made: type[PhaseBlock] = ScalarPhaseBlock if scalar else IndexedPhaseBlock
        return Block.__new__(made)

    def __init__(
        self,
        *indexes: Any,
        duration: float | Duration = 1.0,
        elements: int | None = None,
        mesh: Any = None,
        scheme: str | Scheme = "radau",
        stages: int | None = None,
        start: Any = 0.0,
        moving: Bounds | None = None,
        allow_higher_index: bool = False,
        time_units: Any = None,
        rule: Rule | None = None,
        **kwds: Any,
    ) -> None:
        options = {
            "duration": duration,
            "elements": elements,
            "mesh": mesh,
            "scheme": scheme,
            "stages": stages,
            "start": start,
            "moving": moving,
            "allow_higher_index": allow_higher_index,
            "time_units": time_units,
        }
        super().__init__(*indexes, rule=_BuildPhase(options, rule), **kwds)

    def construct(self, data: Any = None) -> None:
        """Build the phase; on any error, the user's own included, take it off the model again."""
        try:
            super().construct(data)
        except BaseException:
            parent = self.parent_block()
            if parent is not None and parent.component(self.local_name) is self:
                parent.del_component(self)
            raise


class ScalarPhaseBlock(PhaseBlockData, PhaseBlock):
    """A single phase."""

    def __init__(self, *args: Any, **kwds: Any) -> None:
        PhaseBlockData.__init__(self, component=self)
        PhaseBlock.__init__(self, *args, **kwds)
        self._data[None] = self
        self._index = UnindexedComponent_index

    display = Block.display


class IndexedPhaseBlock(PhaseBlock):
    """Phases over an index set."""

    def __setattr__(self, name: str, value: Any) -> None:
        if isinstance(value, Declaration):
            raise DeclarationError(
                f"phases '{self.name}': '{name}' (declared at {value.declared_at}) is declared on one phase at a time. "
                "Pass rule=..., or assign it to each of the phases."
            )
        super().__setattr__(name, value)
