"""Where a name that a package does not have may be found."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from types import ModuleType
from typing import Any

# What other packages call components is a method of a phase here.
_METHODS_OF_PHASES = {
    "BoundaryConstraint": "phase.constraint(rule), or an ordinary Constraint on b.x.at_end",
    "Derivative": "phase.ode(rule)",
    "DerivativeVar": "phase.ode(rule)",
    "Integral": "phase.integral(rule)",
    "PathConstraint": "phase.constraint(lambda b, t: ...)",
    "integral": "phase.integral(rule)",
    "ode": "phase.ode(rule)",
}


def where_it_is(name: str, package: Any, public: Sequence[str]) -> str:
    """The end of a message about a name that a package does not have: where it is, or the nearest name.

    Parameters
    ----------
    name : str
    package : module
    public : sequence of str
        Its public names, namespaces among them.

    Returns
    -------
    str
        Starts with ". " where something was found; else empty.
    """
    if name.startswith("_"):
        return ""
    if name in _METHODS_OF_PHASES:
        return f". Write {_METHODS_OF_PHASES[name]}"
    places: dict[str, str] = {}
    for known in public:
        found = getattr(package, known)
        places.setdefault(known, known)
        if isinstance(found, ModuleType):
            for member in getattr(found, "__all__", ()):
                places.setdefault(member, f"{known}.{member}")
    if name in places:
        return f". It is rcp.{places[name]}"
    same = [known for known in places if known.lower() == name.lower()]
    near = same or difflib.get_close_matches(name, places, n=1)
    return f". Did you mean rcp.{places[near[0]]}?" if near else ""
