"""Variables over the time of a phase, which can be asked for their values at other times than those of the grid."""

from __future__ import annotations

import math
from typing import Any

from pyomo.core.base.expression import IndexedExpression
from pyomo.core.base.reference import Reference
from pyomo.core.base.var import IndexedVar
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.modeling.time_index import point_of
from pyrobocop_pyomo.numerics.rounding import ROUNDING
from pyrobocop_pyomo.presentation import one_line
from pyrobocop_pyomo.templates.slots import Item
from pyrobocop_pyomo.templates.template import Reading, TimeTemplate

from .delays import delayed_value, value_at_time


class NoSuchTime(KeyError):
    """A variable over time was asked for its value at an index that it has not."""

    def __str__(self) -> str:
        return str(self.args[0])  # and not its repr, as of other keys


class _OverTime:
    """What states, algebraics and controls have beside what Pyomo gives them."""

    def _validate_index(self: Any, idx: Any) -> Any:
        try:
            return super()._validate_index(idx)  # type: ignore[misc]
        except KeyError:
            index = point_of(idx)
            for time in self if isinstance(index, (int, float)) else ():
                # Eight elements of a tenth may end beside 0.8.
                if isinstance(time, float) and math.isclose(time, index, rel_tol=ROUNDING):
                    return time
            raise NoSuchTime(_no_such_time(self, index)) from None

    def __getitem__(self: Any, index: Any) -> Any:
        if index.__class__ is TimeTemplate:
            return Reading(Item(self, (None,)))
        return super().__getitem__(index)  # type: ignore[misc]

    # An array leaves `array * variable` to the operators below.
    __array_ufunc__ = None

    def __getattr__(self: Any, name: str) -> Any:
        if name in _OTHER_WORDS:
            short = self.local_name
            instead = _OTHER_WORDS[name].format(name=f"b.{short}", short=short)
            raise AttributeError(f"'{self.name}', a variable over time, has no '{name}'. Write {instead}.")
        return super().__getattribute__(name)

    def __repr__(self: Any) -> str:
        values = [number for part in self.values() if (number := value(part, exception=False)) is not None]
        found = f"{min(values):.6g} .. {max(values):.6g}" if values else "no values yet"
        return one_line(type(self).__name__, f"'{self.name}' at {len(self)} times, {found}")

    def __setattr__(self: Any, name: str, value: Any) -> None:
        if name in _REFUSED:
            raise AttributeError(
                f"'{self.name}', a variable over time, has no '{name}' to set. Say it where it is declared, as in "
                f"rcp.State(initial=..., final=..., bounds=..., initial_guess=...); at one time, "
                f"b.{self.local_name}[t].set_value(...), .fix(...) or .setlb(...)."
            )
        super().__setattr__(name, value)

    def delayed(self: Any, t: float, delay: Any) -> Any:
        """Its value a while ago: that of the collocation polynomial at ``t - delay``.

        Parameters
        ----------
        t : float
            The time index that a rule is evaluated at.
        delay : number or Param
            In real time, 0 or more; a Param counts with the value that it has when the rule is evaluated.

        Returns
        -------
        variable, expression or number
            Before the phase starts, what the declaration gives as ``history``.

        Raises
        ------
        ModelError
            When it reaches before the start and there is no history; when the duration or the element boundaries are to
            be found, so that the element of ``t - delay`` is not known.

        References
        ----------
        Bellen & Zennaro, Numerical Methods for Delay Differential Equations (2003), ch. 5,
        doi:10.1093/acprof:oso/9780198506546.001.0001
        """
        block = self.parent_block()
        return delayed_value(block, self.local_name, t, delay)

    def at(self: Any, time: float) -> Any:
        """Its value at a fixed time index: that of the collocation polynomial, for constraints and objectives.

        It follows the phase onto another mesh.

        Parameters
        ----------
        time : float
            A time index; at an element boundary the element that ends there answers, at the start the first.

        Raises
        ------
        ModelError
            When the phase does not reach so far.
        """
        block = self.parent_block()
        return value_at_time(block, self.local_name, time)

    @property
    def at_start(self: Any) -> Any:
        """Its value at the start of the phase; extrapolated, where the scheme has no point there."""
        return self.at(self.parent_block().initial_time)

    @property
    def at_end(self: Any) -> Any:
        """Its value at the end of the phase; extrapolated, where the scheme has no point there."""
        return self.at(self.parent_block().final_time)


# What other packages call a part of a variable over time -> what to write instead; "{name}" is the variable.
_OTHER_WORDS = {
    "value": "its values: phase.trajectory().{short} as an array, pyo.value({name}.at(time)) at one time",
    "dot": "its derivative: in an ode, return {{{name}: ...}}; elsewhere phase.derivative({name})[t]",
    "final": "{name}.at_end",
    "initial": "{name}.at_start",
    "lb": "bounds: rcp.State(bounds=(lower, upper)), or {name}[t].setlb(lower) at one point",
    "bounds": "bounds: rcp.State(bounds=(lower, upper)), or {name}[t].setlb(lower) at one point",
    "plot": "a picture: phase.trajectory().plot(['{short}'])",
}
_OTHER_WORDS |= {"val": _OTHER_WORDS["value"], "sol": _OTHER_WORDS["value"], "ub": _OTHER_WORDS["lb"]}
_OTHER_WORDS |= dict.fromkeys(("derivative", "diff", "der", "ddt", "d"), _OTHER_WORDS["dot"])
_OTHER_WORDS |= dict.fromkeys(("end", "last", "tf", "xf"), _OTHER_WORDS["final"])
_OTHER_WORDS |= dict.fromkeys(("start", "first", "t0", "x0"), _OTHER_WORDS["initial"])

_REFUSED = frozenset({"value", "initial", "final", "lb", "ub"})

_OPERATORS = ("add", "sub", "mul", "truediv", "pow", "matmul")


def _refuse_as_number(self: Any, *_: Any) -> Any:
    """Raise for an operator that was given a variable over time as a whole."""
    name = f"b.{self.local_name}"
    raise TypeError(
        f"'{self.name}' is a variable at all times (SignalVar), and was used as one number. In a rule write {name}[t]; "
        f"for a sum over time b.integral(lambda b, t: {name}[t] ** 2); for one time {name}.at(time), {name}.at_start "
        f"or {name}.at_end."
    )


for _operator in _OPERATORS:
    for _name in (f"__{_operator}__", f"__r{_operator}__"):
        setattr(_OverTime, _name, _refuse_as_number)
for _name in ("neg", "abs", "lt", "le", "gt", "ge", "float"):
    setattr(_OverTime, f"__{_name}__", _refuse_as_number)


def _no_such_time(signal: Any, index: Any) -> str:
    """What to do where a variable is read at a time at which it has none of its own."""
    times, name, asked = list(signal), f"b.{signal.local_name}", index
    if isinstance(index, (int, float)):
        asked = f"{index:g}"
        times.sort(key=lambda time: abs(time - index))
    near = ", ".join(f"{time:g}" for time in sorted(times[:2]))
    return (
        f"'{signal.name}' has no value of its own at {index!r}: it lives at {len(times)} times, the nearest are {near}."
        f" Write {name}.at({asked}) for its value there, {name}.delayed(t, delay) for that of a while ago, "
        f"{name}.at_start and {name}.at_end at the ends, and b.integral(lambda b, t: ...) for a sum over time."
    )


class SignalVar(_OverTime, IndexedVar):
    """A state, algebraic or control over time."""


class SignalExpression(_OverTime, IndexedExpression):
    """A control that is linear between knots, as seen at the collocation points."""


def signal_reference(variables: dict[float, Any]) -> Any:
    """A control that has fewer values than there are collocation points, as seen at these."""
    plain = Reference(variables)
    found = SignalVar(plain.index_set())
    found._constructed, found._data, found.referent = True, plain._data, plain.referent
    return found
