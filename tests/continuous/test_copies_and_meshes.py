"""Clones, pickles, create_using, and a second mesh."""

from __future__ import annotations

import pickle
from math import exp

import pyomo.environ as pyo
import pytest
from catalogue.dae_models import CASES, HEATING, reactor
from harness.dae import solved
from pyomo.dae import ContinuousSet, DerivativeVar, Integral

import pyrobocop_pyomo as rcp

COLLOCATION = pyo.TransformationFactory("pyrobocop.collocation")


# -------------------------------------------------------------------- copies


def decaying():
    m = pyo.ConcreteModel(name="decay")
    m.t = ContinuousSet(bounds=(0, 1))
    m.x = pyo.Var(m.t, initialize=1)
    m.dx = DerivativeVar(m.x)
    m.ode = pyo.Constraint(m.t, rule=_decay)
    m.x[0].fix(1)
    m.area = Integral(m.t, rule=_x)
    m.cost = pyo.Objective(expr=m.area)
    return m


def _decay(m, t):
    return m.dx[t] == -m.x[t]


def _x(m, t):
    return m.x[t]


@pytest.mark.casadi
@pytest.mark.parametrize("derivatives", ["substitute", "keep"])
@pytest.mark.parametrize("copied", [lambda m: m.clone(), lambda m: pickle.loads(pickle.dumps(m))])
def test_clones_and_pickles_are_models_of_their_own(derivatives, copied):
    m = decaying()
    COLLOCATION.apply_to(m, nfe=4, derivatives=derivatives)
    n = copied(m)
    n.x[0].fix(2)
    solved(n)
    assert m.x[1].value == 1
    assert n.x[1].value == pytest.approx(2 * exp(-1), abs=1e-6)
    assert rcp.dae_trajectory(n, n.t).rates["x"][-1] == pytest.approx(-2 * exp(-1), abs=1e-4)
    COLLOCATION.apply_to(n, nfe=8)
    assert pyo.value(solved(n).area) == pytest.approx(2 - 2 * exp(-1), abs=1e-8)
    assert len(m.t) == 13
    assert m.x._derivative[("t",)]() in (m.dx, m.find_component("t_collocation.replaced.dx"))


@pytest.mark.casadi
def test_create_using_leaves_the_model_alone():
    m = reactor()
    n = COLLOCATION.create_using(m, wrt=m.t, nfe=4)
    assert list(m.t) == [0, HEATING]
    assert m.dtotal.ctype is DerivativeVar
    assert m.product.ctype is Integral
    assert CASES["reactor, index 1"].errors(solved(n))[0] < 1e-4


# -------------------------------------------------------------------- again


@pytest.mark.casadi
@pytest.mark.parametrize("derivatives", ["substitute", "keep"])
@pytest.mark.parametrize("name", CASES)
def test_again_on_another_mesh_from_the_last_solution(name, derivatives):
    case = CASES[name]
    m, n = case.build(), case.build()
    COLLOCATION.apply_to(m, nfe=6, derivatives=derivatives)
    coarse = case.errors(solved(m))
    COLLOCATION.apply_to(m, nfe=12, scheme="gauss", derivatives=derivatives)
    guess = case.errors(m)
    COLLOCATION.apply_to(n, nfe=12, scheme="gauss", derivatives=derivatives)
    assert {c.name: len(c) for c in m.component_objects()} == {c.name: len(c) for c in n.component_objects()}
    assert guess[0] <= coarse[0] + 1e-2
    assert case.errors(solved(m)) == pytest.approx(case.errors(solved(n)), abs=1e-8)
