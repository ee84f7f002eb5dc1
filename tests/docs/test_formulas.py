"""The numbered formulas of the explanation pages, evaluated against the code."""

from __future__ import annotations

import math
from itertools import islice, pairwise

import numpy as np
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.numerics import remesh

SCHEMES = [
    rcp.schemes.radau(1),
    rcp.schemes.radau(3),
    rcp.schemes.radau(5),
    rcp.schemes.gauss_legendre(1),
    rcp.schemes.gauss_legendre(2),
    rcp.schemes.gauss_legendre(4),
]


# -------------------------------------------------------------------- collocation


def test_moving_elements_keep_their_factors():
    m = pyo.ConcreteModel()
    m.phase = b = rcp.PhaseBlock(mesh=[0.0, 0.3, 1.0], free_element_widths=(0.5, 1.25))
    assert (b.boundary[0].value, b.boundary[2].value) == (0, 1)
    assert [(row.lb, row.ub) for row in b.boundary_width.values()] == [
        pytest.approx((0.5 * width, 1.25 * width)) for width in (0.3, 0.7)
    ]


@pytest.mark.parametrize("duration", [2.0, rcp.Duration(bounds=(0.5, 4), initial_guess=2.0)], ids=["fixed", "free"])
def test_integral_is_the_weighted_sum_also_with_a_free_duration(duration):
    m = pyo.ConcreteModel()
    m.phase = b = rcp.PhaseBlock(duration=duration, elements=3, scheme="radau", stages=2)
    expected = sum(
        2.0 / 3 * sum(w * math.exp(2.0 / 3 * (i + c)) for w, c in zip(b.grid.scheme.b, b.grid.scheme.c, strict=True))
        for i in range(3)
    )
    assert pyo.value(b.integral(lambda b, t: pyo.exp(b.time_at(t)))) == pytest.approx(expected, rel=1e-12)


# -------------------------------------------------------------------- complementarity


def test_weights_of_a_phase_are_those_of_the_quadrature():
    m = pyo.ConcreteModel()
    m.phase = b = rcp.PhaseBlock(mesh=[0.0, 0.3, 1.0], stages=2)
    b.gap, b.force = rcp.Algebraic(bounds=(0, None)), rcp.Algebraic(bounds=(0, None))

    @b.complementarity
    def contact(b, t):
        return rcp.complements(b.gap[t], b.force[t])

    weights = [pair.weight for pair in rcp.active_pairs(m)]
    assert weights == pytest.approx([h * w for h in (0.3, 0.7) for w in b.grid.scheme.b])


@pytest.mark.casadi
def test_delta_lags_mu_by_one_iteration():
    m = pyo.ConcreteModel()
    m.a, m.b = pyo.Var(bounds=(0, None), initialize=1), pyo.Var(bounds=(0, None), initialize=1)
    m.pair = rcp.Complementarity(expr=rcp.complements(m.a, m.b))
    m.cost = pyo.Objective(expr=(m.a - 2) ** 2 + (m.b - 1) ** 2)
    schedule = rcp.relaxations.FollowBarrier(floor=1e-8, factor=3.0)
    result = rcp.solve(m, strategies=rcp.Strategy(schedule=schedule), backend="casadi")
    path = result.steps[0].path
    assert len(path) > 5
    for (mu, _), (_, delta) in pairwise(path):
        assert delta == schedule.delta_for(mu)


@pytest.mark.executable
def test_path_through_the_executable():
    m = pyo.ConcreteModel()
    m.a, m.b = pyo.Var(bounds=(0, None), initialize=1), pyo.Var(bounds=(0, None), initialize=1)
    m.pair = rcp.Complementarity(expr=rcp.complements(m.a, m.b))
    m.cost = pyo.Objective(expr=(m.a - 2) ** 2 + (m.b - 1) ** 2)
    steps = rcp.solve(
        m, strategies=rcp.Strategy(schedule=rcp.relaxations.FollowBarrier(factor=2.0)), backend="executable"
    ).steps

    def path(mu=0.1, tolerance=1e-8):
        while True:
            yield max(1e-8, 2 * mu)
            mu = max(tolerance / 10, min(0.2 * mu, mu**1.5))

    walked = [step.delta for step in steps if step.label.startswith("delta = mu")]
    assert len(walked) > 5
    assert walked == pytest.approx(list(islice(path(), len(walked))))


# -------------------------------------------------------------------- verification


@pytest.mark.casadi
def test_defect_is_the_difference_of_slopes():
    m = pyo.ConcreteModel()
    m.phase = b = rcp.PhaseBlock(duration=1.0, elements=2, scheme="implicit_euler")
    b.x = rcp.State(initial_guess=lambda t: t**2)
    b.ode(lambda b, t: {b.x: b.x[t]})
    # Slopes of t^2 over the two elements are 0.5 and 1.5; the right-hand sides at their ends are 0.25 and 1.
    assert b.trajectory().verify().defect == pytest.approx(0.5)


# -------------------------------------------------------------------- mesh refinement


def decaying(elements, scheme):
    m = pyo.ConcreteModel()
    m.phase = b = rcp.PhaseBlock(duration=1.0, elements=elements, scheme=scheme)
    b.x = rcp.State(initial=1)
    b.ode(lambda b, t: {b.x: -3 * b.x[t] + t})
    return b


@pytest.mark.parametrize("scheme", SCHEMES[:2] + SCHEMES[3:5], ids=str)
def test_error_of_an_element_is_the_distance_from_its_own_motion_and_falls_with_the_order(scheme):
    largest = []
    for elements in (8, 16):
        b = decaying(elements, scheme)
        trajectory = b.simulate(method="scheme")
        errors = b.element_errors(trajectory)
        starts = trajectory.x[np.isin(trajectory.time, trajectory.grid.mesh.boundaries)]
        for i, (start, end) in enumerate(pairwise(trajectory.grid.mesh.boundaries)):
            # z' = -3 z + t from the element's start, by hand
            reached = (starts[i] - start / 3 + 1 / 9) * math.exp(-3 * (end - start)) + end / 3 - 1 / 9
            assert errors[i] == pytest.approx(abs(reached - starts[i + 1]), rel=1e-4, abs=1e-11)
        largest.append(errors.max())
    if largest[1] > 1e-9:  # below, what SciPy's tolerances leave
        assert math.log2(largest[0] / largest[1]) == pytest.approx(scheme.order + 1, abs=0.4)


def test_parts_and_joins_of_the_next_mesh():
    mesh, tolerance, order = rcp.schemes.Mesh.given([0.0, 1.0, 3.0, 4.0]), 1e-6, 3
    assert math.ceil((2e-5 / (tolerance / 2)) ** (1 / (order + 1))) == 3
    assert remesh(mesh, [2e-5, 1.01e-6, 1.0], tolerance, order).boundaries == pytest.approx(
        (0, 1 / 3, 2 / 3, 1, 2, 3, 3.25, 3.5, 3.75, 4)
    )
    largest = tolerance / 20 / (3 / 1) ** (order + 1)  # of an element of width 1 beside one of width 2
    assert remesh(mesh, [0.99 * largest, largest, tolerance], tolerance, order, keep=()).elements == 2
    assert remesh(mesh, [1.01 * largest, largest, tolerance], tolerance, order, keep=()).elements == 3


# -------------------------------------------------------------------- pushing together


def test_smooth_gap_and_limit():
    shape, r, z = rcp.mechanics.planar.Capsule(radius=0.05, half_length=0.45), 0.1, np.array([0.47, -0.3])
    eps, a = 0.01, 0.45
    along = 0.5 * (math.sqrt((z[0] + a) ** 2 + eps**2) - math.sqrt((z[0] - a) ** 2 + eps**2))
    sigma = np.array([along, 0.0])
    d = math.sqrt(np.sum((z - sigma) ** 2) + 1e-6)
    n = (z - sigma) / d
    p = sigma + 0.05 * n
    at = shape.gap_to_disc(r, *z)
    assert (at.gap, *at.normal, *at.point) == pytest.approx((d - 0.05 - r, *n, *p))


def test_smoothed_ground_friction():
    mu, m, g, lever, s, v, omega = 0.3, 1.7, 9.81, 0.2, 0.04, np.array([0.3, -0.1]), 0.8
    friction = rcp.mechanics.planar.GroundFriction(coefficient=mu, lever=lever, slip_speed=s)
    force = -mu * m * g * v / math.sqrt(v @ v + s**2)
    moment = -mu * m * g * lever**2 * omega / math.sqrt((lever * omega) ** 2 + s**2)
    assert friction.wrench(m, *v, omega) == pytest.approx((*force, moment))
