"""The numbered formulas of the explanation pages, evaluated against the code."""

from __future__ import annotations

import math
from itertools import islice, pairwise

import numpy as np
import pyomo.environ as pyo
import pytest
from scipy.integrate import dblquad
from scipy.optimize import minimize
from scipy.special import eval_jacobi, eval_legendre

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.complementarity.residuals import PairResidual
from pyrobocop_pyomo.numerics import remesh
from pyrobocop_pyomo.programs.nonlinear_program import ShiftedRows

SCHEMES = [
    rcp.schemes.radau(1),
    rcp.schemes.radau(3),
    rcp.schemes.radau(5),
    rcp.schemes.gauss_legendre(1),
    rcp.schemes.gauss_legendre(2),
    rcp.schemes.gauss_legendre(4),
]


def lagrange(nodes, j):
    """The Lagrange polynomial of node j by its definition, in monomials: fine for a handful of nodes."""
    others = np.delete(np.asarray(nodes, dtype=float), j)
    polynomial = np.polynomial.Polynomial([1.0])
    for node in others:
        polynomial *= np.polynomial.Polynomial([-node, 1.0]) / (nodes[j] - node)
    return polynomial


def relaxation():
    return pyo.TransformationFactory("pyrobocop.relax_complementarity")


# -------------------------------------------------------------------- collocation


@pytest.mark.parametrize("stages", [1, 2, 3, 6])
def test_points_are_the_stated_roots(stages):
    gauss, radau = rcp.schemes.gauss_legendre(stages).c, rcp.schemes.radau(stages).c
    assert np.abs(eval_legendre(stages, 2 * gauss - 1)).max() < 1e-13
    assert radau[-1] == 1.0
    assert np.abs(eval_jacobi(stages - 1, 1.0, 0.0, 2 * radau[:-1] - 1)).max(initial=0.0) < 1e-12


@pytest.mark.parametrize("scheme", SCHEMES, ids=str)
def test_derivative_matrix_and_tableau_are_those_of_lagrange_polynomials(scheme):
    nodes = [0.0, *scheme.c]
    for j in range(scheme.stages + 1):
        assert scheme.D[:, j] == pytest.approx(lagrange(nodes, j).deriv()(scheme.c), abs=1e-10)
        assert scheme.end_weights[j] == pytest.approx(lagrange(nodes, j)(1.0), abs=1e-11)
    for j in range(scheme.stages):
        integral = lagrange(scheme.c, j).integ()
        assert scheme.A[:, j] == pytest.approx(integral(scheme.c) - integral(0.0), abs=1e-12)
        assert scheme.b[j] == pytest.approx(integral(1.0) - integral(0.0), abs=1e-12)


@pytest.mark.parametrize("scheme", SCHEMES, ids=str)
def test_rows_are_those_of_the_page(scheme):
    """One state with the derivative x^2 + t, at arbitrary values: every row as eq-collocation and eq-continuity say."""
    m = pyo.ConcreteModel()
    m.phase = b = rcp.PhaseBlock(mesh=[0.0, 0.3, 1.0], scheme=scheme)
    b.x = rcp.State(initial_guess=lambda t: math.cos(3 * t))
    b.ode(lambda b, t: {b.x: b.x[t] ** 2 + t})
    grid, x = b.grid, lambda t: math.cos(3 * t)
    for i, h in enumerate(grid.mesh.widths):
        nodes = [grid.mesh.boundaries[i], *(grid.mesh.boundaries[i] + c * h for c in scheme.c)]
        for k, t in enumerate(grid.stage_times[i]):
            expected = sum(scheme.D[k, j] * x(node) for j, node in enumerate(nodes)) - h * (x(t) ** 2 + t)
            row = b.x_collocation[t]
            assert pyo.value(row.body) - pyo.value(row.upper) == pytest.approx(expected, abs=1e-9)
    assert (b.component("x_continuity") is None) == scheme.stiffly_accurate
    if not scheme.stiffly_accurate:
        for i, row in enumerate(b.x_continuity.values()):
            nodes = [grid.mesh.boundaries[i], *grid.stage_times[i]]
            arrival = sum(w * x(node) for w, node in zip(scheme.end_weights, nodes, strict=True))
            expected = arrival - x(grid.mesh.boundaries[i + 1])
            assert pyo.value(row.body) - pyo.value(row.upper) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("scheme", SCHEMES, ids=str)
def test_rows_are_equivalent_to_the_runge_kutta_method(scheme):
    h, start, rates = 0.37, 1.3, np.cos(np.arange(scheme.stages))
    stages = np.linalg.solve(scheme.D[:, 1:], h * rates - scheme.D[:, 0] * start)
    assert stages == pytest.approx(start + h * scheme.A @ rates, abs=1e-10)
    assert scheme.end_weights @ [start, *stages] == pytest.approx(start + h * scheme.b @ rates, abs=1e-10)


OTHER_SCHEMES = [*(rcp.schemes.lobatto(s) for s in (2, 3, 5)), *(rcp.schemes.explicit(s) for s in (1, 2, 3))]


@pytest.mark.parametrize("scheme", [*SCHEMES, *OTHER_SCHEMES], ids=str)
def test_any_scheme_has_the_rows_of_the_page(scheme):
    increments = scheme.A if scheme.c[0] > 0 else scheme.A[1:]
    if scheme.c[0] == 0 and scheme.c[-1] < 1:
        increments = np.vstack([increments, scheme.b])
    square = increments[:, scheme.stages - len(increments) :]
    inverse = np.linalg.inv(square)
    assert pytest.approx(np.column_stack([-inverse.sum(axis=1), inverse]), abs=1e-9) == scheme.D
    assert pytest.approx(inverse @ increments, abs=1e-9) == scheme.F
    # One state with the derivative x^2 + t, at arbitrary values.
    m = pyo.ConcreteModel()
    m.phase = b = rcp.PhaseBlock(mesh=[0.0, 0.3, 1.0], scheme=scheme)
    b.x = rcp.State(initial_guess=lambda t: math.cos(3 * t))
    b.ode(lambda b, t: {b.x: b.x[t] ** 2 + t})
    for i, h in enumerate(b.grid.mesh.widths):
        nodes = np.cos(3 * np.array(b.grid.node_times[i]))
        stages = np.array(b.grid.stage_times[i])
        expected = scheme.D @ nodes - h * scheme.F @ (np.cos(3 * stages) ** 2 + stages)
        rows = [b.x_collocation[b.grid.stage_times[i][k]] for k in scheme.row_stages]
        assert [pyo.value(row.body) - pyo.value(row.upper) for row in rows] == pytest.approx(expected, abs=1e-9)


def test_piecewise_controls_are_seen_as_the_page_says():
    m = pyo.ConcreteModel()
    m.phase = b = rcp.PhaseBlock(mesh=[0.0, 0.3, 1.0, 1.5], duration=1.5)
    knots, values = [0.0, 1.0, 1.5], [2.0, -1.0, 4.0]
    b.held = rcp.Control(parametrization="piecewise_constant", knots=knots, initial_guess=values[:2])
    b.linear = rcp.Control(parametrization="piecewise_linear", knots=knots, initial_guess=values)
    for t in b.points:
        j = 0 if t <= 1.0 else 1
        theta = (t - knots[j]) / (knots[j + 1] - knots[j])
        assert pyo.value(b.held[t]) == values[j]
        assert pyo.value(b.linear[t]) == pytest.approx((1 - theta) * values[j] + theta * values[j + 1])


def test_moving_elements_keep_their_factors():
    m = pyo.ConcreteModel()
    m.phase = b = rcp.PhaseBlock(mesh=[0.0, 0.3, 1.0], free_element_widths=(0.5, 1.25))
    assert (b.boundary[0].value, b.boundary[2].value) == (0, 1)
    assert [(row.lb, row.ub) for row in b.boundary_width.values()] == [
        pytest.approx((0.5 * width, 1.25 * width)) for width in (0.3, 0.7)
    ]


@pytest.mark.parametrize("scheme", SCHEMES, ids=str)
def test_order_is_that_of_the_quadrature(scheme):
    def gap(n):
        return abs(scheme.b @ scheme.c ** (n - 1) - 1 / n)

    assert all(gap(n) < 1e-12 for n in range(1, scheme.order + 1))
    assert gap(scheme.order + 1) > 1e-9
    assert scheme.order == 2 * scheme.stages - (1 if scheme.stiffly_accurate else 0)


@pytest.mark.parametrize("duration", [2.0, rcp.Duration(bounds=(0.5, 4), initial_guess=2.0)], ids=["fixed", "free"])
def test_integral_is_the_weighted_sum_also_with_a_free_duration(duration):
    m = pyo.ConcreteModel()
    m.phase = b = rcp.PhaseBlock(duration=duration, elements=3, scheme="radau", stages=2)
    expected = sum(
        2.0 / 3 * sum(w * math.exp(2.0 / 3 * (i + c)) for w, c in zip(b.grid.scheme.b, b.grid.scheme.c, strict=True))
        for i in range(3)
    )
    assert pyo.value(b.integral(lambda b, t: pyo.exp(b.time_at(t)))) == pytest.approx(expected, rel=1e-12)


def test_free_duration_multiplies_the_widths():
    m = pyo.ConcreteModel()
    m.phase = b = rcp.PhaseBlock(
        duration=rcp.Duration(bounds=(0.5, 4), initial_guess=3.0), elements=2, scheme="implicit_euler"
    )
    b.x = rcp.State(initial_guess=lambda tau: tau**2)
    b.ode(lambda b, t: {b.x: 5.0})
    row = b.x_collocation[1.0]
    assert pyo.value(row.body) == pytest.approx((1.0 - 0.25) - 0.5 * 3.0 * 5.0)


# -------------------------------------------------------------------- complementarity


def three_pairs(grouping, choice="scholtes", delta=1e-2, sense=pyo.minimize):
    m = pyo.ConcreteModel()
    m.i = pyo.RangeSet(3)
    m.a = pyo.Var(m.i, bounds=(0, None), initialize={1: 0.5, 2: 2.0, 3: 1.0})
    m.b = pyo.Var(m.i, bounds=(0, None), initialize={1: 0.3, 2: 0.1, 3: 4.0})
    m.pairs = rcp.Complementarity(
        m.i,
        rule=lambda m, i: rcp.complements(m.a[i] >= 0, m.b[i] >= 0),
        group="all",
        weight={1: 0.1, 2: 0.2, 3: 0.3},
    )
    m.cost = pyo.Objective(expr=m.a[1], sense=sense)
    relaxation().apply_to(m, relaxation=choice, grouping=grouping, delta=delta)
    return m


def test_rows_of_pairs_and_groups():
    products = [0.15, 0.2, 4.0]
    rows = relaxation().shifted_rows_of(three_pairs("pair"))
    assert [pyo.value(row.body) - row.ub for row in rows] == pytest.approx([p - 1e-2 for p in products])
    (row,) = relaxation().shifted_rows_of(three_pairs("element"))
    assert pyo.value(row.body) - row.ub == pytest.approx(sum(products) - 1e-2)  # delta itself, not n or n^2 times


@pytest.mark.parametrize(("sense", "sign"), [(pyo.minimize, 1), (pyo.maximize, -1)])
def test_penalty(sense, sign):
    m = three_pairs("pair", choice="penalty", delta=0.5, sense=sense)
    (objective,) = m.component_data_objects(pyo.Objective, active=True)
    assert pyo.value(objective) == pytest.approx(0.5 + sign / 0.5 * (0.1 * 0.15 + 0.2 * 0.2 + 0.3 * 4.0))


def test_weights_of_a_phase_are_those_of_the_quadrature():
    m = pyo.ConcreteModel()
    m.phase = b = rcp.PhaseBlock(mesh=[0.0, 0.3, 1.0], stages=2)
    b.gap, b.force = rcp.Algebraic(bounds=(0, None)), rcp.Algebraic(bounds=(0, None))

    @b.complementarity
    def contact(b, t):
        return rcp.complements(b.gap[t], b.force[t])

    weights = [pair.weight for pair in rcp.active_pairs(m)]
    assert weights == pytest.approx([h * w for h in (0.3, 0.7) for w in b.grid.scheme.b])


def test_follow():
    schedule = rcp.relaxations.FollowBarrier(floor=1e-8, factor=2.0)
    assert schedule.delta_for(1e-3) == 2e-3
    assert schedule.delta_for(1e-12) == 1e-8


def test_a_shift_moves_one_value_and_nothing_else():
    class Program:
        derivatives, n, m = "none", 2, 2
        x_lower = x_upper = g_lower = g_upper = x_start = g_multipliers_start = None
        jacobian_structure = hessian_structure = None
        objective = gradient = jacobian = hessian = staticmethod(lambda *arguments: None)

        @staticmethod
        def constraints(x):
            return np.array([x[0] * x[1] - 1e-2, x[0] + x[1]])

    program = Program()
    shifted = ShiftedRows(program, [0], base=1e-2)
    shifted.delta = 1e-5
    assert shifted.constraints(np.array([2.0, 3.0])) == pytest.approx([6.0 - 1e-5, 5.0])
    assert shifted.jacobian is program.jacobian
    assert shifted.hessian is program.hessian


@pytest.mark.casadi
def test_delta_lags_mu_by_one_iteration():
    m = pyo.ConcreteModel()
    m.a, m.b = pyo.Var(bounds=(0, None), initialize=1), pyo.Var(bounds=(0, None), initialize=1)
    m.pair = rcp.Complementarity(expr=rcp.complements(m.a, m.b))
    m.cost = pyo.Objective(expr=(m.a - 2) ** 2 + (m.b - 1) ** 2)
    schedule = rcp.relaxations.FollowBarrier(floor=1e-8, factor=3.0)
    result = rcp.solve(m, schedule=schedule, backend="casadi")
    path = result.steps[0].path
    assert len(path) > 5
    for (mu, _), (_, delta) in pairwise(path):
        assert delta == schedule.delta_for(mu)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_centre_of_the_barrier_problem(n):
    """Of -sum log a_l b_l - log(delta - sum a_l b_l): products delta / (n + 1), so delta / 2 for a single pair."""
    delta = 0.7

    def barrier(logarithms):
        products = np.exp(logarithms[:n] + logarithms[n:])
        left = delta - products.sum()
        return np.inf if left <= 0 else -logarithms.sum() - math.log(left)

    start = np.full(2 * n, 0.5 * math.log(0.1 * delta / n)) + 0.1 * np.sin(np.arange(2 * n))
    found = minimize(barrier, start, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-13, "maxiter": 40000})
    assert np.exp(found.x[:n] + found.x[n:]) == pytest.approx(np.full(n, delta / (n + 1)), rel=1e-3)


@pytest.mark.executable
def test_path_through_the_executable():
    m = pyo.ConcreteModel()
    m.a, m.b = pyo.Var(bounds=(0, None), initialize=1), pyo.Var(bounds=(0, None), initialize=1)
    m.pair = rcp.Complementarity(expr=rcp.complements(m.a, m.b))
    m.cost = pyo.Objective(expr=(m.a - 2) ** 2 + (m.b - 1) ** 2)
    steps = rcp.solve(m, schedule=rcp.relaxations.FollowBarrier(factor=2.0), backend="executable").steps

    def path(mu=0.1, tolerance=1e-8):
        while True:
            yield max(1e-8, 2 * mu)
            mu = max(tolerance / 10, min(0.2 * mu, mu**1.5))

    walked = [step.delta for step in steps if step.label.startswith("delta = mu")]
    assert len(walked) > 5
    assert walked == pytest.approx(list(islice(path(), len(walked))))


def test_residuals_of_a_pair():
    residual = PairResidual("pair", a=1e-3, b=2.0)
    assert residual.product == 2e-3
    assert residual.natural == 1e-3


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


# -------------------------------------------------------------------- planar pushing


def test_limit_surface_and_twist():
    slider = rcp.mechanics.SquareSlider(half_side=0.06, mass=0.8, table_friction=0.4)
    c = 1 / (0.4 * 0.8 * 9.81) ** 2
    L = np.diag([c, c, c / slider.mean_distance**2])
    (p_x, p_y), (f_x, f_y) = (-0.06, 0.02), (0.7, -0.2)
    wrench = np.array([f_x, f_y, p_x * f_y - p_y * f_x])
    assert slider.velocity(0.0, (p_x, p_y), (f_x, f_y)) == pytest.approx(tuple(L @ wrench))
    # Pushed through its centre with the greatest friction of the table, the wrench lies on the limit surface.
    on_surface = np.array([0.4 * 0.8 * 9.81, 0.0, 0.0])
    assert on_surface @ L @ on_surface == pytest.approx(1.0)


def test_velocity_turns_with_the_slider():
    slider, theta = rcp.mechanics.SquareSlider(), 0.7
    v_x, v_y, omega = slider.velocity(0.0, (-0.045, 0.01), (0.4, 0.1))
    turned = slider.velocity(theta, (-0.045, 0.01), (0.4, 0.1))
    expected = (math.cos(theta) * v_x - math.sin(theta) * v_y, math.sin(theta) * v_x + math.cos(theta) * v_y, omega)
    assert turned == pytest.approx(expected)


def test_mean_distance_of_a_square():
    slider = rcp.mechanics.SquareSlider(half_side=0.045)
    integral, _ = dblquad(lambda y, x: math.hypot(x, y), -0.045, 0.045, -0.045, 0.045)
    assert slider.mean_distance == pytest.approx(integral / (4 * 0.045**2), rel=1e-6)


# -------------------------------------------------------------------- pushing together


def test_smooth_gap_and_limit():
    shape, r, z = rcp.mechanics.planar.Capsule(radius=0.05, half_length=0.45), 0.1, np.array([0.47, -0.3])
    eps, a = 0.01, 0.45
    along = 0.5 * (math.sqrt((z[0] + a) ** 2 + eps**2) - math.sqrt((z[0] - a) ** 2 + eps**2))
    sigma = np.array([along, 0.0])
    d = math.sqrt(np.sum((z - sigma) ** 2) + 1e-6)
    n = (z - sigma) / d
    p = sigma + 0.05 * n
    assert shape.gap_to_disc(r, *z) == pytest.approx((d - 0.05 - r, *n, *p))


def test_smoothed_ground_friction():
    mu, m, g, lever, s, v, omega = 0.3, 1.7, 9.81, 0.2, 0.04, np.array([0.3, -0.1]), 0.8
    friction = rcp.mechanics.planar.GroundFriction(coefficient=mu, lever=lever, slip_speed=s)
    force = -mu * m * g * v / math.sqrt(v @ v + s**2)
    moment = -mu * m * g * lever**2 * omega / math.sqrt((lever * omega) ** 2 + s**2)
    assert friction.wrench(m, *v, omega) == pytest.approx((*force, moment))


def test_impulse_step_and_planar_contact():
    """The rows of a phase are those of the page, at values that are not a solution."""
    planar, h = rcp.mechanics.planar, 0.1
    body = planar.RigidBody(planar.Disc(0.2), mass=1.5, inertia=0.03, resistance=planar.ViscousDrag(0.4, 0.01))
    robot = planar.DiscRobot(planar.Disc(0.1), mass=0.7, force_limit=9.0, speed_limit=9.0)
    m, grid = pyo.ConcreteModel(), {"duration": h, "elements": 1, "scheme": "implicit_euler"}
    m.push = rcp.PhaseBlock(rule=body.state_wrench, **grid)
    m.body, m.me = rcp.PhaseBlock(**grid), rcp.PhaseBlock(**grid)
    body.state_motion(m.body, [m.push], start=(0.0, 0.0, 0.0))
    robot.state_motion(m.me, m.push, start=(-0.4, 0.1), rest_at_end=False)
    planar.Contact(body.shape, robot.shape, friction=0.6, tolerance=0.02).state(m.me, m.body, m.push, lifted=False)
    end = h
    values = {
        m.body: {"qx": 0.02, "qy": -0.01, "qth": 0.3, "ux": 0.3, "uy": -0.2, "uth": 0.5},
        m.me: {
            "x": -0.3,
            "y": 0.12,
            "vx": 0.7,
            "vy": 0.1,
            "c": 2.0,
            "alpha_plus": 0.3,
            "alpha_minus": 0.1,
            "slip": 0.4,
        },
        m.push: {"fx": 0.8, "fy": -0.5, "mz": 0.1},
    }
    for phase, given in values.items():
        for name, number in given.items():
            phase.component(name)[end].set_value(number)
    q, u = np.array([0.02, -0.01]), np.array([0.3, -0.2])
    M, w, resistance = (
        np.array([1.5, 1.5, 0.03]),
        np.array([0.8, -0.5, 0.1]),
        -np.array([0.4 * 0.3, -0.4 * 0.2, 0.01 * 0.5]),
    )
    momentum = M * np.array([0.3, -0.2, 0.5]) - h * (w + resistance)
    for name, mass, missing in zip(("ux", "uy", "uth"), M, momentum, strict=True):
        row = m.body.component(f"{name}_collocation")[end]
        assert abs(pyo.value(row.body) - pyo.value(row.upper)) == pytest.approx(abs(missing / mass))

    z = np.array([-0.3, 0.12]) - q
    d = math.sqrt(z @ z + 1e-6)
    n, beta = z / d, d - 0.2 - 0.1
    p, t = 0.2 * n, np.array([-n[1], n[0]])
    velocity = np.array([0.7, 0.1]) - (u + 0.5 * np.array([-p[1], p[0]]))
    w_n, w_t = n @ velocity, t @ velocity
    f = 2.0 * n + (0.3 - 0.1) * t
    wrench = np.array([*-f, p[0] * -0.5 - p[1] * 0.8])  # the moment is that of the push's own force
    for i, expected in enumerate(wrench):
        row = m.me.contact_wrench[end, i]
        assert abs(pyo.value(row.body) - pyo.value(row.upper)) == pytest.approx(abs(w[i] - expected))
    row = m.me.no_separation[end]
    assert (pyo.value(row.lower), pyo.value(row.upper)) == (-0.02, 0.02)
    assert pyo.value(row.body) == pytest.approx(2.0 * w_n)
    products = [2.0 * beta, 0.3 * (0.4 + w_t), 0.1 * (0.4 - w_t), 0.4 * (0.6 * 2.0 - 0.3 - 0.1)]
    found = [
        math.prod(abs(pyo.value(side.args[0] - side.args[1])) for side in m.me.contact[end, i].args) for i in range(4)
    ]
    assert found == pytest.approx(np.abs(products))
