"""What holds a point where its rows cannot be met: bounds, fixed values and rows, by component."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from pyrobocop_pyomo.complementarity.pairs import PAIR_TYPES
from pyrobocop_pyomo.diagnosis.places import is_equation_of_a_phase, place_in_words, separation_of, time_of

# So many are named in a sentence.
SHOWN = 5
# What linear programs leave of zero: of violations and their sums, of sides and distances from bounds in their sizes,
# and of multipliers beside the largest possible one.
MET = 1e-6


@dataclass(frozen=True)
class ObstructingData:
    """One bound, fixed value or row.

    Attributes
    ----------
    data : component data
        A variable or a row.
    sign : str
        ``"<="``, ``">="``, or ``"="`` where it is fixed; empty for a row.
    value : float
        The bound, or the fixed value.
    influence : float
        By how much the least violation falls where it gives way by its own size.
    """

    data: Any
    sign: str
    value: float
    influence: float


@dataclass(frozen=True)
class Obstruction:
    """The bounds of one side, fixed values or rows of one component.

    Attributes
    ----------
    name : str
        Of the component, or of its only data.
    words : str
        What it is, with its number and where in time.
    influence : float
        By how much the least violation falls where they give way by their own size, in sum.
    limit : str
        The sign and number of its bound, or its fixed value; empty for rows.
    """

    name: str
    words: str
    influence: float
    limit: str = ""

    @property
    def is_fixed(self) -> bool:
        """Whether it is a fixed value."""
        return self.limit.startswith("fixed")

    def __str__(self) -> str:
        return self.words


@dataclass(frozen=True)
class Relief:
    """How far the bounds or rows of one component have to give way for everything else to be met.

    Attributes
    ----------
    name : str
        Of the obstruction.
    amount : float
        In its units; infinite where it is not enough, however far it gives way.
    """

    name: str
    amount: float


def grouped(data: Iterable[ObstructingData]) -> list[tuple[Obstruction, list[ObstructingData]]]:
    """Obstructions by component and side: bounds, rows, pairs, fixed values, the most influential of each first.

    Equations of phases carry what is required at one time to the next: they are left out wherever there is anything
    else.
    """
    groups: dict[Hashable, list[ObstructingData]] = {}
    for one in data:
        groups.setdefault(_label(one), []).append(one)
    stated = [some for some in groups.values() if some[0].sign or not is_equation_of_a_phase(some[0].data)]
    # A bound is a number that can be widened. Ends are fixed, and contact is stated, in almost every problem.
    ranked = [(_rank(some[0]), _obstruction(some), some) for some in stated or groups.values()]
    return [(one, some) for _, one, some in sorted(ranked, key=lambda each: (each[0], -each[1].influence))]


def _label(one: ObstructingData) -> Hashable:
    if not one.sign and (separation := separation_of(one.data)) is not None:
        return separation[:3]
    return id(one.data.parent_component()), one.sign, one.value if one.sign == "=" else None


def _rank(one: ObstructingData) -> int:
    if one.sign:
        return 3 if one.sign == "=" else 0
    return 2 if one.data.parent_component().ctype in PAIR_TYPES else 1


def _obstruction(some: list[ObstructingData]) -> Obstruction:
    influence, first, component = sum(one.influence for one in some), some[0], some[0].data.parent_component()
    separations = [] if first.sign else [found for one in some if (found := separation_of(one.data)) is not None]
    if separations:
        block, one_shape, other_shape, _ = separations[0]
        span = _span([start for *_, start in separations])
        return Obstruction(
            block, f"the clearance between '{one_shape}' and '{other_shape}' of '{block}' {span}", influence
        )
    if len(some) == 1 and not first.sign:
        return Obstruction(first.data.name, place_in_words(first.data), influence)
    times = [time for time in (time_of(one.data) for one in some) if time is not None]
    name = first.data.name if len(some) == 1 else component.name
    words = f"'{component.name if times else name}'"
    limit = _bound(some) if first.sign else ""
    if limit:
        words += f" {limit}"
    else:
        words = f"{'pairs of' if component.ctype in PAIR_TYPES else 'constraint'} {words}"
    if len(some) > 1:
        words += f" at {len(some)} of {len(component)} {'points,' if times else 'indices'}"
    return Obstruction(name, f"{words} {_span(times)}" if times else words, influence, limit)


def first_try(
    obstructions: Sequence[Obstruction], relief: Relief | None, has_given_time: bool, *, exactly: bool
) -> str:
    """What to relax first, with all bounds of that component, and how far.

    Parameters
    ----------
    obstructions : sequence of Obstruction
        As `grouped` orders them.
    relief : Relief or None
        Of one of them; None where it is not known.
    has_given_time : bool
        Whether more time may help, too.
    exactly : bool
        Whether nothing less than the relief is enough.
    """
    first, far = obstructions[0], ""
    if relief is not None:
        first = next(one for one in obstructions if one.name == relief.name and not one.is_fixed)
        far = _how_far(relief.amount, exactly)
    time = ", or give it more time" if has_given_time else ""
    if not first.limit or first.is_fixed:
        return f"Try first to {'change' if first.limit else 'relax'} {first}{far}{time}."
    limits = [one.limit for one in obstructions if one.name == first.name and one.limit and not one.is_fixed]
    bounds = " and ".join(f"'{first.name}' {limit}" for limit in limits)
    return f"Try first to widen the bound{'s' if len(limits) > 1 else ''} {bounds}{far}{time}."


def _how_far(amount: float, exactly: bool) -> str:
    """A positive amount in words, with three digits that are not too small."""
    if math.isinf(amount):
        return ", which is not enough alone"
    unit = 10.0 ** (math.floor(math.log10(amount)) - 2)
    digits = f"{math.ceil(amount / unit * (1.0 - MET)) * unit:.3g}"
    return f" by {digits} or more" if exactly else f" by about {digits}"


def _span(times: list[float]) -> str:
    first, last = min(times), max(times)
    return f"at t = {first:g}" if first == last else f"t = {first:g} to {last:g}"


def _bound(some: list[ObstructingData]) -> str:
    sign, values = some[0].sign, [one.value for one in some]
    least, most = min(values), max(values)
    return f"{'fixed at' if sign == '=' else sign} {least:.6g}" + ("" if least == most else f" .. {most:.6g}")
