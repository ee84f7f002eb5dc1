"""`SignalLaw`: a law that gives one signal, such as a force or an absolute value, by equations and pairs.

``phase.wall = SoftWall(...)`` makes ``phase.wall[t]`` a variable like any other, the force, and states what determines
it. Whatever else the law needs is named after it: ``phase.wall_pairs``, ``phase.floor_forward``.

Functions with a kink or a jump, as complementarity: exact at every solution, without smoothing.

Each is assigned to a name of a phase: ``b.size = AbsoluteValue(lambda b, t: b.x[t])`` makes ``b.size[t]`` a variable
that equals ``|x|``. The first side of each pair is the one that is continuous in time.

Walls that keep a distance from becoming negative, and dry friction along a line.
"""

from __future__ import annotations

import copy
import math
from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from math import copysign
from numbers import Real
from typing import Any, ClassVar, NamedTuple, Union

from pyomo.core.base.units_container import _PyomoUnit
from pyomo.core.base.units_container import units as pyomo_units
from pyomo.core.expr.numvalue import native_numeric_types, native_types, value
from pyomo.core.expr.visitor import identify_mutable_parameters

from pyrobocop_pyomo.complementarity import complements
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.expression_arrays import plain_entry
from pyrobocop_pyomo.phases import Algebraic, Law
from pyrobocop_pyomo.phases.declarations import UNBOUNDED, Bounds
from pyrobocop_pyomo.phases.equations import add_statement
from pyrobocop_pyomo.phases.nodes import InitialGuess
from pyrobocop_pyomo.phases.record import Statement
from pyrobocop_pyomo.templates.template import Template

Rule = Callable[[Any, float], Any]
Quantity = Union[float, Rule]  # noqa: UP007
NONNEGATIVE: Bounds = (0.0, None)


class Unknown(NamedTuple):
    """A variable that a law needs.

    Attributes
    ----------
    bounds : (lower, upper)
    like : callable
        ``like(at)`` is an expression at a `Moment`, in the units of the variable.
    """

    bounds: Bounds
    like: Callable[[Moment], Any]


@dataclass(frozen=True, kw_only=True)
class SignalLaw(Law):
    """Base of the laws that give one signal.

    A law of one's own says what it needs and what holds. Its fields are numbers or rules ``(phase, t) -> expression``;
    ``at.ask("field")`` has their value at a point, ``at.signal`` the signal, ``at["part"]`` another unknown.

    Attributes
    ----------
    positive, nonnegative : tuple of str
        Names of the fields that must be so wherever they are numbers.
    initial_guess : number, array, function of the time index, or None
        Of the signal; by default, what the law makes of the values that the phase has when the law is stated.
    units : Pyomo unit or None
        Of the signal; by default those that follow from the rules, where declarations of the phase have units.
    """

    positive: ClassVar[tuple[str, ...]] = ()
    nonnegative: ClassVar[tuple[str, ...]] = ()

    initial_guess: InitialGuess = None
    units: Any = None

    @abstractmethod
    def unknowns(self) -> Mapping[str, Unknown]:
        """The variables, by what is added to the name of the law; the signal itself, where it is one, is ``""``."""

    @abstractmethod
    def pairs(self, at: Moment) -> Any:
        """The complementarity at a point: what a complementarity rule of a phase returns."""

    def equations(self, at: Moment) -> Any:
        """The equations at a point, what a residual rule of a phase returns; None where the law has none."""
        return None

    def start(self, asked: Callable[[str], float]) -> Mapping[str, float]:
        """Values of the unknowns where the fields have known values: ``asked("field")`` is a number."""
        return {}

    def __post_init__(self) -> None:
        for name in self._asked_fields():
            self._check_field(name)

    # ---------------------------------------------------------------- statement

    def state(self, phase: Any, name: str) -> None:
        """Declare the unknowns and state equations and pairs; see `Law.state`.

        Raises
        ------
        ModelError
            When a name is taken, or a rule gives no number and no expression.
        """
        law = self._with_rules(phase)
        first = Moment(law, name, phase, phase.points.first())
        unknowns = law.unknowns()
        for field in law._asked_fields():
            first.ask(field)
        guesses = law._guesses(name, phase)
        with_units = phase.record.time_units is not None or any(
            declaration.units is not None for declaration in phase.record.declarations.values()
        )
        for suffix, unknown in unknowns.items():
            own = self.units if suffix == "" else None
            phase.declare(
                part_name(name, suffix),
                Algebraic(
                    bounds=unknown.bounds,
                    initial_guess=guesses[suffix],
                    units=pyomo_units.get_units(unknown.like(first)) if with_units and own is None else own,
                    declared_at=self.declared_at,
                ),
            )
        if law.equations(first) is not None:
            phase.residual(LawRule(law, name, "equations"))
        phase.complementarity(LawRule(law, name, "pairs"))

    def _asked_fields(self) -> list[str]:
        """Fields that hold numbers or rules."""
        own = {entry.name for entry in fields(SignalLaw)}
        return [entry.name for entry in fields(self) if entry.name not in own and getattr(self, entry.name) is not None]

    def _check_field(self, name: str) -> None:
        given = getattr(self, name)
        if isinstance(given, Real) and not isinstance(given, bool) and math.isfinite(given):
            self._refuse_sign(name, float(given), f"{self._what}: {name} = {given!r}")
        elif not (callable(given) or _is_of_model(given)):
            raise ModelError(
                f"{self._what}: {name} = {given!r}; expected a finite number, a rule (phase, t) -> expression, or a "
                "component of the model."
            )

    def _refuse_sign(self, name: str, number: float, label: str) -> None:
        if name in self.positive and not number > 0:
            raise ModelError(f"{label}; expected a positive number.")
        if name in self.nonnegative and not number >= 0:
            raise ModelError(f"{label}; expected zero or a positive number.")

    @property
    def _what(self) -> str:
        return f"{type(self).__name__} (declared at {self.declared_at})"

    def _with_rules(self, phase: Any) -> SignalLaw:
        """This law with rules in place of components: a clone of the model, and a verification, read their own."""
        law = copy.copy(self)
        for name in self._asked_fields():
            object.__setattr__(law, name, _as_rule(getattr(self, name), phase, f"{self._what}: {name}"))
        return law

    def _guesses(self, name: str, phase: Any) -> dict[str, Any]:
        """Initial guesses of the unknowns over the points."""
        rows: list[Mapping[str, float]] = []
        for time in phase.points:
            at = Moment(self, name, phase, time)
            try:
                rows.append(self.start(at.number))
            except (ArithmeticError, ValueError):  # no value there, or none at all yet
                rows.append({})
        guesses: dict[str, Any] = {s: [float(row.get(s, 0.0)) for row in rows] for s in self.unknowns()}
        if self.initial_guess is not None:
            if "" not in guesses:
                raise ModelError(
                    f"{self._what}: '{name}' is an expression in {', '.join(part_name(name, s) for s in guesses)}, and "
                    "has no initial guess of its own. Use phase.initialize for these."
                )
            guesses[""] = self.initial_guess
        return guesses


class Moment:
    """A law at one collocation point of a phase.

    Parameters
    ----------
    law : SignalLaw
    name : str
        Under which the law is stated.
    phase : PhaseBlock, or its proxy
    time : float
    """

    def __init__(self, law: SignalLaw, name: str, phase: Any, time: float) -> None:
        self._law, self._name, self._phase, self._time = law, name, phase, time

    @property
    def signal(self) -> Any:
        """The signal of the law."""
        return self[""]

    def __getitem__(self, part: str) -> Any:
        """Another unknown of the law."""
        return getattr(self._phase, part_name(self._name, part))[self._time]

    def ask(self, field: str) -> Any:
        """What a field is here: a number or an expression.

        Raises
        ------
        ModelError
            When a rule returns something else.
        """
        given = getattr(self._law, field)
        if _is_of_model(given) or not callable(given):
            return given
        result = plain_entry(given(self._phase, self._time))
        if result.__class__ in native_numeric_types:
            self._law._refuse_sign(field, result, f"{self._where(field)} gives {result!r}")
            return result
        numeric = (
            getattr(result, "is_numeric_type", lambda: False)() and not getattr(result, "is_indexed", lambda: False)()
        )
        if not numeric:
            raise ModelError(
                f"{self._where(field)} gives {result!r}; expected a number or an expression. Is the return statement, "
                "or an index [t], missing?"
            )
        return result

    def number(self, field: str) -> float:
        """What a field is at the values of the variables.

        Raises
        ------
        ValueError
            When it has no value, or none that is finite.
        """
        number = value(self.ask(field), exception=False)
        if number is None or not math.isfinite(number):
            raise ValueError(f"{field} has no value at t = {self._time:g}")
        return float(number)

    def _where(self, field: str) -> str:
        return f"phase '{self._phase.name}': '{self._name}', {self._law._what}: {field} at t = {self._time:g}"


@dataclass(frozen=True)
class LawRule:
    """A rule of a phase that asks a law; a pickle holds it wherever it holds the law's own rules.

    Attributes
    ----------
    law : SignalLaw
    name : str
    method : {"equations", "pairs"}
    """

    law: SignalLaw
    name: str
    method: str

    @property
    def __name__(self) -> str:
        return f"{self.name}_{self.method}"

    def __call__(self, phase: Any, time: float) -> Any:
        """The rows at a point."""
        return getattr(self.law, self.method)(Moment(self.law, self.name, phase, time))


def _is_of_model(given: Any) -> bool:
    return hasattr(given, "ctype") or hasattr(given, "is_expression_type")


def _as_rule(given: Any, phase: Any, label: str) -> Any:
    """A number or rule as it is, a component as a rule that reads it."""
    if given.__class__ in native_types or not _is_of_model(given):
        return given
    if not hasattr(given, "ctype") or given is not given.parent_component():
        mutable = [each for each in identify_mutable_parameters(given) if not isinstance(each, _PyomoUnit)]
        if not given.is_potentially_variable() and not mutable:
            return given  # a number with units
        raise ModelError(
            f"{label} = {given}, which belongs to this model alone, and to one point of it. Write it as a rule: "
            "lambda phase, t: ..."
        )
    if given.model() is not phase.model():
        raise ModelError(f"{label} = {given}, which is not on the model of phase '{phase.name}'. Add it first.")
    if not given.is_indexed():
        return lambda phase, time: given
    if phase.points.first() not in given:
        raise ModelError(
            f"{label} = {given}, which is not indexed by the times of phase '{phase.name}'. Write it as a rule: "
            "lambda phase, t: ..."
        )
    return lambda phase, time: given[time]


def part_name(name: str, part: str) -> str:
    """Name of an unknown of a law."""
    return f"{name}_{part}" if part else name


# -------------------------------------------------------------------------------------- functions with a kink or a jump


@dataclass(frozen=True)
class AbsoluteValue(SignalLaw):
    """``|s|``: the v with ``0 <= v - s _|_ v + s >= 0``.

    With it, ``max(a, b)`` is ``(a + b + |a - b|) / 2``, ``min(a, b)`` is ``(a + b - |a - b|) / 2``, and s cut off at l
    and u is ``(l + u + |s - l| - |s - u|) / 2``.

    Attributes
    ----------
    of : rule
        ``s``.

    Examples
    --------
    >>> import pyomo.environ as pyo
    >>> import pyrobocop_pyomo as rcp
    >>> m = pyo.ConcreteModel()
    >>> m.phase = b = rcp.PhaseBlock(duration=1.0, elements=2)
    >>> b.x = rcp.Control(initial_guess=-3)
    >>> b.size = rcp.mechanics.AbsoluteValue(lambda b, t: b.x[t])
    >>> b.size[1.0].value
    3.0
    """

    of: Quantity

    def unknowns(self) -> Mapping[str, Unknown]:
        """The value."""
        return {"": Unknown(NONNEGATIVE, lambda at: at.ask("of"))}

    def pairs(self, at: Moment) -> Any:
        """The value is one of the two."""
        return complements(at.signal - at.ask("of") >= 0, at.signal + at.ask("of") >= 0)

    def start(self, asked: Callable[[str], float]) -> Mapping[str, float]:
        """The absolute value."""
        return {"": abs(asked("of"))}


@dataclass(frozen=True)
class Step(SignalLaw):
    """The Heaviside step: 1 where s is positive, 0 where it is negative, anything between where it is zero.

    With ``s = above - below``, ``0 <= above _|_ 1 - v >= 0`` and ``0 <= below _|_ v >= 0``. At zero the motion decides,
    by Filippov's convention: a motion that is driven onto the surface from both sides slides along it. The sign of s
    is ``2 v - 1``.

    Attributes
    ----------
    of : rule
        ``s``.

    References
    ----------
    Nurkanović, Frey, Pozharskiy & Diehl, Finite Elements with Switch Detection for Direct Optimal Control of Nonsmooth
    Systems with Set-Valued Step Functions (2023), doi:10.48550/arXiv.2303.18066
    """

    of: Quantity

    def unknowns(self) -> Mapping[str, Unknown]:
        """The value, and the parts of the quantity: ``<name>_above``, ``<name>_below``."""
        part = Unknown(NONNEGATIVE, lambda at: at.ask("of"))
        return {"": Unknown((0.0, 1.0), lambda at: 1.0), "above": part, "below": part}

    def equations(self, at: Moment) -> Any:
        """The parts make up the quantity."""
        return at.ask("of") == at["above"] - at["below"]

    def pairs(self, at: Moment) -> Any:
        """At one end wherever the quantity is not zero."""
        return {
            "on": complements(at["above"] >= 0, 1 - at.signal >= 0),
            "off": complements(at["below"] >= 0, at.signal >= 0),
        }

    def start(self, asked: Callable[[str], float]) -> Mapping[str, float]:
        """One end, or the middle at zero."""
        s = asked("of")
        value = 1.0 if s > 0 else 0.0 if s < 0 else 0.5
        return {"": value, "above": max(s, 0.0), "below": max(-s, 0.0)}


# ------------------------------------------------------------------------------------------------------ laws of contact


@dataclass(frozen=True)
class HardWall(SignalLaw):
    """A wall that does not give way: ``0 <= force _|_ gap >= 0``.

    With implicit Euler an impact is inelastic: the force of the element in which the gap closes takes the speed away.

    Attributes
    ----------
    gap : rule
        Distance from the wall, positive where free, metres.

    References
    ----------
    Stewart, Rigid-Body Dynamics with Friction and Impact, SIAM Review 42 (2000), doi:10.1137/S0036144599360110
    """

    gap: Rule

    def unknowns(self) -> Mapping[str, Unknown]:
        """The force, newtons."""
        return {"": Unknown(NONNEGATIVE, lambda at: 1.0)}

    def pairs(self, at: Moment) -> Any:
        """Force only where the gap is closed."""
        return complements(at.ask("gap") >= 0, at.signal >= 0)


@dataclass(frozen=True)
class SoftWall(SignalLaw):
    """A wall that gives way like a spring: ``0 <= force _|_ gap + force / stiffness >= 0``.

    So the force is ``max(0, -stiffness gap)``: none at a distance, and proportional to the penetration. A damper beside
    the spring acts like the gap ``gap + damping / stiffness rate``: give that rule, and the force is
    ``max(0, -stiffness gap - damping rate)``, which resists the way in, and never pulls on the way out.

    Attributes
    ----------
    gap : rule
        Distance from the undeformed wall, negative where it is pressed in, metres.
    stiffness : number, rule, or parameter of the phase
        Newtons per metre.

    Raises
    ------
    ModelError
        When the stiffness is not positive.

    References
    ----------
    Aydinoglu, Preciado & Posa, Contact-Aware Controller Design for Complementarity Systems, ICRA 2020,
    doi:10.1109/ICRA40945.2020.9197568
    """

    positive: ClassVar = ("stiffness",)

    gap: Rule
    stiffness: Quantity

    def unknowns(self) -> Mapping[str, Unknown]:
        """The force, newtons."""
        return {"": Unknown(NONNEGATIVE, lambda at: at.ask("stiffness") * at.ask("gap"))}

    def pairs(self, at: Moment) -> Any:
        """Force only as far as the wall is pressed in."""
        return complements(at.ask("gap") + at.signal / at.ask("stiffness") >= 0, at.signal >= 0)

    def start(self, asked: Callable[[str], float]) -> Mapping[str, float]:
        """The force of the spring."""
        return {"": max(0.0, -asked("stiffness") * asked("gap"))}


@dataclass(frozen=True)
class CoulombFriction(SignalLaw):
    """Friction that holds what it can, and opposes slip with all it has: ``F = -coefficient normal sign(slip)``.

    With ``slip = forward - backward`` and the strength ``L = coefficient normal``::

        0 <= forward   _|_  L + F >= 0
        0 <= backward  _|_  L - F >= 0

    While it sticks, F is whatever keeps the slip at zero, within ``-L <= F <= L``.

    Attributes
    ----------
    slip : rule
        Speed of what the force acts on relative to what it rubs on, metres per second.
    normal : number or rule
        Normal force, newtons; it must not be negative.
    coefficient : number, rule, or parameter of the phase
        Coulomb's coefficient.

    Examples
    --------
    >>> import pyomo.environ as pyo
    >>> import pyrobocop_pyomo as rcp
    >>> m = pyo.ConcreteModel()
    >>> m.slide = b = rcp.PhaseBlock(duration=1.0, elements=10, scheme="implicit_euler")
    >>> b.v = rcp.State(initial=2.0)
    >>> b.floor = rcp.mechanics.CoulombFriction(lambda b, t: b.v[t], normal=9.81, coefficient=0.5)
    >>> @b.ode
    ... def newton(b, t):
    ...     return {b.v: b.floor[t]}

    References
    ----------
    Stewart, Rigid-Body Dynamics with Friction and Impact, SIAM Review 42 (2000), doi:10.1137/S0036144599360110
    """

    positive: ClassVar = ("coefficient",)
    nonnegative: ClassVar = ("normal",)

    slip: Quantity
    normal: Quantity
    coefficient: Quantity

    def unknowns(self) -> Mapping[str, Unknown]:
        """The force, and the parts of the slip: ``<name>_forward``, ``<name>_backward``."""
        part = Unknown(NONNEGATIVE, lambda at: at.ask("slip"))
        return {"": Unknown(UNBOUNDED, _strength), "forward": part, "backward": part}

    def equations(self, at: Moment) -> Any:
        """The parts make up the slip."""
        return at.ask("slip") == at["forward"] - at["backward"]

    def pairs(self, at: Moment) -> Any:
        """Slip only at full strength, and against the force."""
        return {
            "forward": complements(at["forward"] >= 0, _strength(at) + at.signal >= 0),
            "backward": complements(at["backward"] >= 0, _strength(at) - at.signal >= 0),
        }

    def start(self, asked: Callable[[str], float]) -> Mapping[str, float]:
        """Full strength against the slip."""
        slip = asked("slip")
        force = -copysign(asked("coefficient") * asked("normal"), slip) if slip else 0.0
        return {"": force, "forward": max(slip, 0.0), "backward": max(-slip, 0.0)}


@dataclass(frozen=True)
class CoulombSlip(SignalLaw):
    """Coulomb's law read the other way: the force is chosen, and slip follows where it is at the edge of its cone.

    The signal is the speed of slip, the expression ``<name>_forward - <name>_backward``::

        0 <= forward   _|_  coefficient normal - tangential >= 0
        0 <= backward  _|_  coefficient normal + tangential >= 0

    A finger that pushes with ``(normal, tangential)`` slips, relative to what it pushes, in the direction of its own
    tangential force, and only at the edge of the cone. Both distances from the edges are nonnegative: the force stays
    within its cone.

    Attributes
    ----------
    normal, tangential : rule
        Force that the sliding body exerts on the surface, newtons: the normal part, which must not be negative, and the
        part in the direction of positive slip.
    coefficient : number, rule, or parameter of the phase
        Coulomb's coefficient.
    fastest : float or None
        Largest speed of slip, in the units of the slip; None where there is no bound.

    References
    ----------
    Raghunathan, Jha & Romeres, PYROBOCOP: Python-based Robotic Control & Optimization Package for Manipulation,
    ICRA 2022, sec. V-C, doi:10.1109/ICRA46639.2022.9812069
    """

    positive: ClassVar = ("coefficient", "fastest")
    nonnegative: ClassVar = ("normal",)

    normal: Quantity
    tangential: Quantity
    coefficient: Quantity
    fastest: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.fastest is not None and not isinstance(self.fastest, (int, float)):
            raise ModelError(f"{self._what}: fastest = {self.fastest!r}; it is a bound, and has to be a number.")

    def unknowns(self) -> Mapping[str, Unknown]:
        """The parts of the slip: ``<name>_forward``, ``<name>_backward``."""
        part = Unknown((0.0, self.fastest), lambda at: 1.0 if self.units is None else self.units)
        return {"forward": part, "backward": part}

    def state(self, phase: Any, name: str) -> None:
        """State the law, and the slip as an expression: a variable of its own would only be a row more."""
        super().state(phase, name)
        forward, backward = part_name(name, "forward"), part_name(name, "backward")
        slip = Template(lambda phase, time: getattr(phase, forward)[time] - getattr(phase, backward)[time])
        add_statement(phase, Statement("expression", name, slip))

    def pairs(self, at: Moment) -> Any:
        """Slip only at the edge of the cone."""
        tangential = at.ask("tangential")
        return {
            "forward": complements(_strength(at) - tangential >= 0, at["forward"] >= 0),
            "backward": complements(_strength(at) + tangential >= 0, at["backward"] >= 0),
        }


def _strength(at: Moment) -> Any:
    return at.ask("coefficient") * at.ask("normal")
