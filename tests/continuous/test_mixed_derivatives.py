"""Derivatives along two sets together, by this package along both or by pyomo.dae along one."""

from __future__ import annotations

from math import cos, exp, sin

import pyomo.environ as pyo
import pytest
from harness.dae import solved
from pyomo.contrib.incidence_analysis import IncidenceGraphInterface
from pyomo.dae import ContinuousSet, DerivativeVar

from pyrobocop_pyomo.errors import TranscriptionError

OURS = pyo.TransformationFactory("pyrobocop.collocation")
SKIP = pyo.Constraint.Skip


def goursat(declared=None):
    """``u_xt = -u`` with ``exp(x - t)`` on two edges, which is the solution everywhere."""
    m = pyo.ConcreteModel(name="goursat")
    m.x, m.t = ContinuousSet(bounds=(0, 1)), ContinuousSet(bounds=(0, 1))
    m.u = pyo.Var(m.x, m.t, initialize=1)
    m.uxt = DerivativeVar(m.u, wrt=(m.x, m.t))
    if declared is not None:
        m.slope = DerivativeVar(m.u, wrt=m.component(declared))
    m.balance = pyo.Constraint(m.x, m.t, rule=lambda m, x, t: SKIP if x == 0 or t == 0 else m.uxt[x, t] == -m.u[x, t])
    m.left = pyo.Constraint(m.t, rule=lambda m, t: m.u[0, t] == exp(-t))
    m.start = pyo.Constraint(m.x, rule=lambda m, x: SKIP if x == 0 else m.u[x, 0] == exp(x))
    m.cost = pyo.Objective(expr=0)
    return m


def long_waves():
    """``u_t + u_x - u_xxt = 5 cos(x + 2 t)``, whose solution is ``sin(x + 2 t)``."""
    m = pyo.ConcreteModel(name="long waves")
    m.x, m.t = ContinuousSet(bounds=(0, 1)), ContinuousSet(bounds=(0, 1))
    m.u = pyo.Var(m.x, m.t, initialize=0)
    m.ut, m.ux = DerivativeVar(m.u, wrt=m.t), DerivativeVar(m.u, wrt=m.x)
    m.uxxt = DerivativeVar(m.u, wrt=(m.x, m.x, m.t))

    def balance(m, x, t):
        if x in (0, 1) or t == 0:
            return SKIP
        return m.ut[x, t] + m.ux[x, t] - m.uxxt[x, t] == 5 * cos(x + 2 * t)

    m.balance = pyo.Constraint(m.x, m.t, rule=balance)
    m.start = pyo.Constraint(m.x, rule=lambda m, x: m.u[x, 0] == sin(x))
    m.ends = pyo.Constraint(m.t, [0, 1], rule=lambda m, t, x: SKIP if t == 0 else m.u[x, t] == sin(x + 2 * t))
    m.cost = pyo.Objective(expr=0)
    return m


def discretise(m, *steps):
    for name, scheme, elements in steps:
        domain = m.component(name)
        if scheme in ("BACKWARD", "CENTRAL"):
            pyo.TransformationFactory("dae.finite_difference").apply_to(m, wrt=domain, nfe=elements, scheme=scheme)
        elif scheme == "dae":
            pyo.TransformationFactory("dae.collocation").apply_to(m, wrt=domain, nfe=elements, ncp=3)
        else:
            name, _, stages = scheme.partition(" ")
            OURS.apply_to(m, wrt=domain, nfe=elements, ncp=int(stages or 2), scheme=name)
    return m


def is_square(m):
    graph = IncidenceGraphInterface(m, include_inequality=False)
    return len(graph.variables) == len(graph.constraints) == len(graph.maximum_matching())


def error(m, exact):
    return max(abs(u.value - exact(x, t)) for (x, t), u in m.u.items())


@pytest.mark.casadi
@pytest.mark.parametrize("declared", [None, "x", "t"])
@pytest.mark.parametrize(("along_x", "along_t"), [("radau", "radau"), ("gauss", "radau"), ("gauss", "gauss")])
def test_both_orders_are_square_and_close_to_the_solution(along_x, along_t, declared):
    for steps in (
        [("x", along_x, 2), ("t", along_t, 2)],
        [("t", along_t, 2), ("x", along_x, 2)],
    ):
        m = discretise(goursat(declared), *steps)
        assert is_square(m)
        assert error(solved(m), lambda x, t: exp(x - t)) < 2e-2


@pytest.mark.casadi
def test_order_of_convergence():
    """Both schemes have order 3 at element ends."""
    errors = []
    for elements in (2, 4):
        m = solved(discretise(goursat(), ("x", "radau", elements), ("t", "radau", elements)))
        errors.append(abs(m.u[1, 1].value - 1))
    assert errors[1] < errors[0] / 6


@pytest.mark.casadi
@pytest.mark.parametrize("model", [goursat, long_waves])
def test_pyomo_dae_along_space_before_or_after(model):
    """The answer is that of pyomo.dae along both sets."""
    space = ("x", "BACKWARD" if model is goursat else "CENTRAL", 4)
    found = []
    for steps in (
        [space, ("t", "dae", 2)],
        [space, ("t", "radau 3", 2)],
        [("t", "radau 3", 2), space],
    ):
        m = solved(discretise(model(), *steps))
        found.append([m.u[index].value for index in sorted(m.u)])
    assert found[1] == pytest.approx(found[0], abs=1e-6)
    assert found[2] == pytest.approx(found[0], abs=1e-6)


@pytest.mark.casadi
@pytest.mark.parametrize("scheme", ["radau", "gauss"])
def test_second_derivative_along_space_in_one_call(scheme):
    """The sets are taken in the order that works, on copies as well."""
    m = OURS.create_using(long_waves(), nfe=2, ncp=3, scheme=scheme).clone()
    assert is_square(m)
    assert error(solved(m), lambda x, t: sin(x + 2 * t)) < 3e-3
    with pytest.raises(TranscriptionError, match="'uxxt': is a derivative along 't' and 'x' together"):
        OURS.apply_to(m, wrt=m.t, nfe=4)
    assert is_square(m)
