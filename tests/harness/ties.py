"""Ways to say that one phase goes on where another ends."""

from typing import Any

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

TIES = ("links", "link and constraint", "constraints", "constraints of the phase", "variables in between")


def tie(m: Any, how: str) -> None:
    """Let phase ``two`` of a model start with the ``x`` and ``y`` with which ``one`` ends: by a link, or otherwise."""
    ends, starts = (
        {n: b.component(n)[t] for n in "xy"} for b, t in ((m.one, m.one.final_time), (m.two, m.two.initial_time))
    )
    if how == "link":
        m.link = rcp.Link(m.one, m.two)
    elif how == "links":
        m.later = rcp.Link(m.one, m.two, states=["y"])
        m.first = rcp.Link(m.one, m.two, states=["x"])
    elif how == "link and constraint":
        m.link = rcp.Link(m.one, m.two, states=["x"])
        m.tie = pyo.Constraint(expr=starts["y"] == ends["y"])
    elif how == "constraints":
        m.tie_x = pyo.Constraint(expr=starts["x"] == ends["x"])
        m.tie_y = pyo.Constraint(expr=starts["y"] - ends["y"] == 0.0)
    elif how == "constraints of the phase":
        m.two.tie_x = pyo.Constraint(expr=2.0 * starts["x"] == 2.0 * ends["x"])
        m.two.tie_y = pyo.Constraint(expr=ends["y"] == starts["y"])
    elif how == "variables in between":
        m.between = pyo.Var(["x", "y"], initialize=lambda m, name: ends[name].value)
        m.before = pyo.Constraint(["x", "y"], rule=lambda m, name: m.between[name] == ends[name])
        m.after = pyo.Constraint(["x", "y"], rule=lambda m, name: starts[name] == m.between[name])
    elif how == "band":
        m.band = pyo.Constraint(["x", "y"], rule=lambda m, name: (-1e-5, starts[name] - ends[name], 1e-5))
