"""Sums over a set are refused, boundary values and sums over chosen points are not."""

from __future__ import annotations

from itertools import pairwise

import pyomo.environ as pyo
import pytest
from catalogue.dae_models import estimation
from harness.dae import picture, tank

from pyrobocop_pyomo.errors import ModelError

COLLOCATION = pyo.TransformationFactory("pyrobocop.collocation")


def add_sum(m):
    m.cost = pyo.Objective(expr=sum(m.x[t] ** 2 for t in m.t))


def add_sum_in_an_expression(m):
    m.mean = pyo.Expression(expr=sum(m.x[t] for t in m.t) / 2)


def add_sum_of_expressions(m):
    m.square = pyo.Expression(m.t, rule=lambda m, t: m.x[t] ** 2)
    m.cost = pyo.Objective(expr=sum(m.square[t] for t in m.t))


def add_trapezoids(m):
    times = list(m.t)
    pairs = pairwise(times)
    m.cost = pyo.Objective(expr=sum(0.5 * (b - a) * (m.x[a] ** 2 + m.x[b] ** 2) for a, b in pairs))


def add_running_sum(m):
    m.used = pyo.Constraint(m.t, rule=lambda m, t: sum(m.x[s] for s in m.t if s <= t) <= 10)


@pytest.mark.parametrize(
    "add", [add_sum, add_sum_in_an_expression, add_sum_of_expressions, add_trapezoids, add_running_sum]
)
def test_sums_over_the_set(add):
    m = tank()
    add(m)
    before = picture(m)
    with pytest.raises(ModelError, match=r"is a sum over the points that 't' had .* write an Integral"):
        COLLOCATION.apply_to(m, wrt=m.t, nfe=4)
    assert picture(m) == before


def add_gain(m):
    m.cost = pyo.Objective(expr=m.x[2] - m.x[0])


def add_period(m):
    m.period = pyo.Constraint(expr=m.x[0] == m.x[2])


def add_final_penalty(m):
    m.cost = pyo.Objective(expr=(m.x[2] - 3) ** 2 + m.u[2] ** 2)


def add_initial_conditions(m):
    m.start = pyo.ConstraintList(rule=lambda m: iter([m.x[0] >= 0, m.x[2] >= 0]))


@pytest.mark.parametrize("add", [add_gain, add_period, add_final_penalty, add_initial_conditions])
def test_boundary_values_are_no_sums(add):
    m = tank()
    add(m)
    COLLOCATION.apply_to(m, nfe=4)


def test_measurements_by_rule_are_taken_and_without_rule_refused():
    m = estimation()
    COLLOCATION.apply_to(m, nfe=7)
    m = estimation()
    m.del_component(m.misfit)
    m.misfit = pyo.Objective(expr=sum((m.x[t] - m.data[t]) ** 2 for t in m.measured))
    with pytest.raises(ModelError, match=r"'misfit': is a sum over the points .* give it a function, rule="):
        COLLOCATION.apply_to(m, nfe=7)
    m.del_component(m.misfit)
    m.misfit = pyo.Objective(expr=sum((m.x[t] - m.data[t]) ** 2 for t in (0.9, 1.7)))
    COLLOCATION.apply_to(m, nfe=7)
