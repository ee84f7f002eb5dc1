"""All formulations against each other, on one scene and from one initial guess."""

from __future__ import annotations

import itertools

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.scenes import ARROW, WALL, avoiding, exact, solve_once, turning_move

import pyrobocop_pyomo as rcp

pytestmark = pytest.mark.executable

EXACT = [(name, norm) for name in ("plane", "dual", "mixed") for norm in ("ball", "sphere")]


def solved(formulation, norm="auto", **options):
    m = turning_move()
    avoid = avoiding(m, formulation=formulation, norm=norm, between=None, **options)
    avoid.initialize()
    solve_once(m)
    return m, avoid


@pytest.fixture(scope="module")
def reference():
    return pyo.value(solved("plane")[0].effort)


@pytest.mark.parametrize(("formulation", "norm"), EXACT)
def test_exact_formulations_agree(formulation, norm, reference):
    m, avoid = solved(formulation, norm)
    assert pyo.value(m.effort) == pytest.approx(reference, rel=1e-5)
    closest = min(exact(m.move, ARROW, WALL, m.move.time))
    # The wall is in the way: the clearance is used up, and kept up to the solver's tolerance.
    assert closest == pytest.approx(0.05, abs=1e-6)
    for (_, _, time), proven in avoid.separation_gaps().items():
        assert 0.05 - 1e-6 <= proven <= exact(m.move, ARROW, WALL, [time])[0] + 1e-9


def test_pushed_out_facets_keep_farther_away(reference):
    m, _ = solved("offset")
    closest = min(exact(m.move, ARROW, WALL, m.move.time))
    assert closest >= 0.05 - 1e-6
    assert reference - 1e-6 <= pyo.value(m.effort) <= 1.02 * reference


def test_optimality_conditions_agree_in_the_limit_and_err_on_the_unsafe_side_before(reference):
    m = turning_move()
    avoid = avoiding(m, formulation="optimality", between=None)
    avoid.initialize()
    pyo.TransformationFactory("pyrobocop.relax_complementarity").apply_to(m, relaxation="scholtes")
    delta, errors = m.relaxed_complementarity.delta, []
    for exponent in range(1, 9):
        delta.set_value(10.0**-exponent)
        solve_once(m)
        distances = exact(m.move, ARROW, WALL, [time for _, _, time in avoid.separations])
        shown = [
            np.linalg.norm([pyo.value(avoid.normal[(*index, axis)]) for axis in (0, 1)]) for index in avoid.separations
        ]
        assert min(shown) >= 0.05 - 1e-6
        errors.append(0.05 - min(distances))
    # The plan says 0.05, the truth is less by what the pairs are relaxed by; at 1e-4, a fifth of the clearance is gone.
    assert errors[3] > 0.2 * 0.05
    assert errors[-1] < 1e-5
    assert all(after < 0.2 * before for before, after in itertools.pairwise(errors[3:]))
    assert pyo.value(m.effort) == pytest.approx(reference, rel=1e-4)


def test_optimality_conditions_reproduce_the_fixed_clearance_of_the_seed():
    m = turning_move()
    avoid = avoiding(m, formulation=rcp.scenes.Optimality(cold=True), clearance=0.02)
    avoid.initialize()
    assert {weight.value for weight in avoid.corner_weight.values()} == {0.0}
    index = next(iter(avoid.separations))
    for number, size in enumerate((0.3, 0.01, 0.02)):
        for axis in (0, 1):
            avoid.normal[(*index, axis)].set_value(size if axis == number % 2 else 0.0)
        wanted = (size**2 + 1e-4) ** 0.5 - (5e-4) ** 0.5
        assert pyo.value(avoid.gap[index].body) == pytest.approx(wanted, abs=1e-15)


# In the plane, of 4 corners or sides each: (variables, rows) per separation.
SIZES = {"plane": (3, 9), "dual": (8, 4), "mixed": (4, 5), "offset": (8, 4), "optimality": (18, 11)}


@pytest.mark.parametrize("formulation", SIZES)
def test_sizes(formulation):
    m = turning_move(elements=2, stages=1)
    avoid = avoiding(m, formulation=formulation, between=None)
    variables = sum(len(variable) for variable in avoid.component_objects(pyo.Var))
    rows = sum(1 for _ in avoid.component_data_objects(pyo.Constraint))
    assert (variables, rows) == tuple(3 * size for size in SIZES[formulation])


def test_one_plane_per_interval_needs_as_many_rows_of_the_body_as_poses():
    m = turning_move(elements=5, stages=1)
    avoid = avoiding(m)
    assert len(avoid.separations) == 5
    assert len(avoid.first_shape) == 5 * 2 * 4
    assert len(avoid.second_shape) == 5 * 4
    assert len(avoid.unit) == 5


def test_one_plane_per_interval_is_safe_between_the_nodes_where_nodes_alone_are_not():
    wall = {"wall": rcp.Polytope.box(0.1, 2, center=(2, -0.5))}
    safe = {}
    for between in ("plane", None):
        m = turning_move(elements=3, stages=1, turn=0.0)
        avoid = avoiding(m, between=between, obstacles=wall)
        avoid.initialize()
        solve_once(m)
        safe[between] = avoid.verify().safe
    assert safe == {"plane": True, None: False}
