"""Phases, links and pairs of an AbstractModel get their data, and their rules read the instance."""

from __future__ import annotations

import copy
from typing import Any

import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp

DATA = {None: {"k": {None: 0.7}, "legs": {None: ["a", "b", "c"]}, "x0": {"a": 1.0, "b": 2.0, "c": 3.0}}}


def abstract() -> Any:
    m = pyo.AbstractModel("legs")
    m.k, m.legs = pyo.Param(mutable=True), pyo.Set(ordered=True)
    m.x0 = pyo.Param(m.legs)
    return m


def check(phase: Any, k: float) -> None:
    """The first stage of implicit Euler from what the guess holds."""
    assert phase.trajectory().verify().defect == pytest.approx(k, abs=1e-12)


def test_rules_read_the_instance_and_the_copy_of_the_instance() -> None:
    m = abstract()

    def leg(b: Any) -> None:
        b.x = rcp.State(initial=1.0, initial_guess=1.0)
        b.ode(lambda b, t: {b.x: -b.model().k * b.x[t]})

    m.p = rcp.PhaseBlock(elements=2, scheme="implicit_euler", rule=leg)
    instance = m.create_instance(DATA)
    twin = copy.deepcopy(instance)
    instance.k = 5.0
    check(instance.p, 5.0)
    check(twin.p, 0.7)
    other = m.create_instance(DATA)
    check(other.p, 0.7)


def test_indexed_phases_and_their_links_come_with_the_data() -> None:
    m = abstract()

    def leg(b: Any, name: str) -> None:
        b.x = rcp.State(initial_guess=b.model().x0[name])
        b.ode(lambda b, t: {b.x: -b.model().k * b.x[t]})

    m.p = rcp.PhaseBlock(m.legs, elements=2, rule=leg)
    m.impacts = rcp.Link(m.p, jump=lambda pre, post: {"x": 0.5 * pre.x})
    m.first = rcp.Link(
        pyo.Set(initialize=["c"]), phases=lambda m, name: (m.p["a"], m.p[name]), jump=lambda pre, post: {"x": pre.x}
    )
    instance = m.create_instance(DATA)
    assert list(instance.impacts) == ["b", "c"]
    assert str(instance.impacts["c"].jump["x"].body) == "0.5*p[b].x[1.0] - p[c].x[0.0]"
    assert instance.first["c"].first is instance.p["a"]
    assert instance.impacts["b"].violation == pytest.approx(1.5)


def test_pairs_and_obstacles_come_with_the_data() -> None:
    m = abstract()
    m.v, m.w = pyo.Var(m.legs, bounds=(0, None), initialize=2), pyo.Var(m.legs, bounds=(0, None), initialize=3)
    m.c = rcp.Complementarity(m.legs, rule=lambda m, j: rcp.complements(m.v[j] >= m.x0[j], m.k * m.w[j] >= 0))

    def leg(b: Any) -> None:
        b.x = rcp.State(initial_guess=lambda t: t)
        b.ode(lambda b, t: {b.x: b.model().k})

    def keep_off(b: Any) -> None:
        b.build(
            b.model().p.time, body=rcp.Polytope.box(0.2, 0.2), clearance=0.01,
            pose=lambda m, t: rcp.planar_pose(m.p.x[t], 0.0),
            obstacles={"post": rcp.Polytope.box(0.2, 0.2).placed(rcp.planar_pose(3.0, 0.0))},
        )  # fmt: skip

    m.p = rcp.PhaseBlock(elements=2, rule=leg)
    m.off = rcp.ObstacleAvoidanceBlock(rule=keep_off)
    instance = m.create_instance(DATA)
    assert [pair.name for pair in rcp.active_pairs(instance)] == ["c[a]", "c[b]", "c[c]"]
    twin = instance.clone()
    for t, x in instance.p.x.items():
        x.set_value(2 * t)
    (near,), (far,) = instance.off.verify().body_pairs, twin.off.verify().body_pairs
    assert near.distance == pytest.approx(3 - 2 - 0.2, abs=1e-6)
    assert far.distance == pytest.approx(3 - 1 - 0.2, abs=1e-6)
