"""The numbered formulas of the explanation pages, evaluated against the code."""

import math
import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.diagnosis import Severity
from pyrobocop_pyomo.motion.given_motions import motion_along_paths
from pyrobocop_pyomo.motion.sampled_paths import read_path
from pyrobocop_pyomo.numerics import maximum_matching, remesh
from pyrobocop_pyomo.phases.structure import PointStructure, middle_point

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


# --------------------------------------------------------------------
# Formulas of the documentation render without a network, and by commands that MathJax takes where they stand.


DOCS = Path(__file__).parents[2] / "docs"


def test_no_page_numbers_a_formula_by_hand():
    # Sphinx puts a formula of several lines into an environment that takes no \tag: it would be shown as source.
    tagged = [page for page in DOCS.rglob("*.md") if r"\tag{" in page.read_text(encoding="utf-8")]
    assert not tagged


def test_mathjax_is_copied_from_a_package():
    pytest.importorskip("sphinx-mathjax-offline", reason="the extra docs is not installed")
    settings: dict[str, object] = {}
    exec((DOCS / "conf.py").read_text(encoding="utf-8"), settings)
    (script,) = (Path(path) for path in settings["html_static_path"] if Path(path).name == settings["mathjax_path"])
    assert re.search(rb"MathJax", script.read_bytes())
    assert "http" not in settings["mathjax_path"]


# --------------------------------------------------------------------
# The page's formulas for shapes that stand for others are those of the code.


@pytest.mark.parametrize("sides", [3, 8, 16, 40])
def test_excess_of_polygons(sides: int) -> None:
    expected = 0.7 * (1 / np.cos(np.pi / sides) - 1)
    assert rcp.Polytope.cylinder(0.7, 2.0, sides=sides).excess == pytest.approx(expected)
    assert rcp.Polytope.cone(0.7, 2.0, sides=sides).excess == pytest.approx(expected)
    assert rcp.Polytope.ellipsoid((0.2, 0.7), sides=sides).excess == pytest.approx(expected)


def test_excess_of_ellipsoids() -> None:
    ball = rcp.Polytope.ellipsoid((1.0, 1.0, 1.0))
    distances = ball.halfspaces[1]
    assert distances.min() == pytest.approx(1.0)
    assert np.linalg.norm(ball.vertices, axis=1).max() - 1.0 == pytest.approx(ball.excess)
    assert rcp.Polytope.ellipsoid((1.0, 3.0, 2.0)).excess == pytest.approx(3.0 * ball.excess)


def test_excess_of_grids() -> None:
    stairs = np.eye(4, dtype=bool)
    (part,) = rcp.scenes.cover_occupancy_grid(stairs, 0.5, tolerance=0.5)
    assert part.excess == pytest.approx(0.5)
    assert len(rcp.scenes.cover_occupancy_grid(stairs, 0.5, tolerance=0.49)) == 4


def test_rotation_at_constant_rate() -> None:
    random = np.random.default_rng(3)
    turns = Rotation.from_rotvec(random.normal(size=(3, 3)))
    times = np.array([0.0, 1.0, 3.0])
    poses = np.column_stack([random.normal(size=(3, 3)), turns.as_quat()])
    path = read_path(poses, times, 3, "body", quaternion_order="xyzw")
    motion, rules = motion_along_paths(times, {"body": path})
    for interval in range(2):
        step = (turns[interval].inv() * turns[interval + 1]).as_rotvec()
        for s in (0.0, 0.3, 1.0):
            rotation, translation = motion.pose_at(rules["body"], interval, s).numbers()
            expected = (turns[interval] * Rotation.from_rotvec(s * step)).as_matrix()
            assert rotation == pytest.approx(expected, abs=1e-12)
            assert translation == pytest.approx((1 - s) * poses[interval, :3] + s * poses[interval + 1, :3])


# --------------------------------------------------------------------
# The numbered formulas of the page on the structural index, evaluated against the code.


shapes = st.tuples(st.integers(1, 4), st.integers(1, 4), st.integers(0, 10_000), st.floats(0.2, 1.0))


def sparse(random: np.random.Generator, rows: int, columns: int, density: float) -> np.ndarray:
    return random.standard_normal((rows, columns)) * (random.uniform(size=(rows, columns)) < density)


@given(shapes)
def test_eliminating_given_derivatives_keeps_the_rank(shape: tuple[int, int, int, float]) -> None:
    """eq-substituted: rank of [[I, -f_y], [r_xdot, r_y]] is n_x + rank(r_y + r_xdot f_y)."""
    states, algebraics, seed, density = shape
    random = np.random.default_rng(seed)
    f_y = sparse(random, states, algebraics, density)
    r_rate, r_y = sparse(random, algebraics, states, density), sparse(random, algebraics, algebraics, density)
    whole = np.block([[np.eye(states), -f_y], [r_rate, r_y]])
    reduced = r_y + r_rate @ f_y
    assert np.linalg.matrix_rank(whole, tol=1e-9) == states + np.linalg.matrix_rank(reduced, tol=1e-9)


@given(shapes)
def test_the_rank_is_at_most_the_size_of_a_maximum_matching(shape: tuple[int, int, int, float]) -> None:
    """eq-structural-rank, with equality for almost all numbers."""
    rows, columns, seed, density = shape
    matrix = sparse(np.random.default_rng(seed), rows, columns, density)
    matching = maximum_matching([np.flatnonzero(row).tolist() for row in matrix], columns)
    size = rows - len(matching.unmatched_rows)
    assert np.linalg.matrix_rank(matrix) == size
    cancelled = np.ones_like(matrix) * (matrix != 0)
    assert np.linalg.matrix_rank(cancelled) <= size


def forces(second: Any) -> Any:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(elements=3)
    b.x = rcp.State(initial=1)
    b.y, b.z = rcp.Algebraic(), rcp.Algebraic()
    b.ode(lambda b, t: {b.x: b.y[t] + 3 * b.z[t]})

    def balance(b: Any, t: float) -> Any:
        return [b.y[t] + b.z[t] == b.x[t], second(b, t)]

    b.residual(balance)
    return m


@pytest.mark.parametrize(("factor", "regular"), [(2.0, False), (2.5, True)])
def test_equations_that_cancel_are_missed_by_structure_and_found_by_numbers(factor: float, regular: bool) -> None:
    """eq-instant, eq-index-one: the example of the page, and a neighbour that is regular."""
    m = forces(lambda b, t: 2 * b.y[t] + factor * b.z[t] == 2 * b.x[t])
    m.p.check()
    structure = PointStructure(m.p, middle_point(m.p.record))
    assert structure.of_rows.unmatched_rows == []
    found = [finding for finding in rcp.diagnose(m).findings if "follows from the others" in finding.message]
    assert bool(found) is not regular
    if regular:
        return
    assert np.linalg.matrix_rank(np.array([[1, 1], [2, factor]])) == 1


@pytest.mark.parametrize(("final", "severity"), [(1.0, Severity.WARNING), (2.0, Severity.ERROR)])
def test_dependent_rows_over_the_horizon_contradict_each_other_where_residuals_do(
    final: float, severity: Severity
) -> None:
    """eq-left-null: x' = y' = u from 0 to 1 and to `final`; with equal ends one row too many, else a wrong one."""
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(elements=4)
    b.x, b.y, b.u = rcp.State(initial=0, final=1), rcp.State(initial=0, final=final), rcp.Control()
    b.ode(lambda b, t: {b.x: b.u[t], b.y: b.u[t]})
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    (finding,) = rcp.diagnose(m).findings
    assert finding.severity is severity
    assert ("contradict each other" if severity is Severity.ERROR else "follows from the others") in finding.message
