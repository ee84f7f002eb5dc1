"""All formulations against each other, on one scene and from one guess."""

from __future__ import annotations

import pyomo.environ as pyo
import pytest
from harness.scenes import ARROW, WALL, avoiding, exact, turning_move

import pyrobocop_pyomo as rcp

pytestmark = pytest.mark.executable

EXACT = [(name, norm) for name in ("plane", "dual", "mixed") for norm in ("ball", "sphere")]


def solved(formulation, norm="auto", **options):
    m = turning_move()
    avoid = avoiding(m, formulation=formulation, norm=norm, between=None, **options)
    avoid.initialize()
    result = rcp.solve(m)
    result.raise_for_status()
    return m, avoid, result


@pytest.fixture(scope="module")
def reference():
    return pyo.value(solved("plane")[0].effort)


@pytest.mark.parametrize(("formulation", "norm"), EXACT)
def test_exact_formulations_agree(formulation, norm, reference):
    m, avoid, _ = solved(formulation, norm)
    assert pyo.value(m.effort) == pytest.approx(reference, rel=1e-5)
    closest = min(exact(m.move, ARROW, WALL, m.move.time))
    # The wall is in the way: the clearance is used up, and kept up to the solver's tolerance.
    assert closest == pytest.approx(0.05, abs=1e-6)
    for (_, _, time), proven in avoid.certificate_gaps().items():
        assert 0.05 - 1e-6 <= proven <= exact(m.move, ARROW, WALL, [time])[0] + 1e-9


def test_pushed_out_facets_keep_farther_away(reference):
    m, _, _ = solved("offset")
    closest = min(exact(m.move, ARROW, WALL, m.move.time))
    assert closest >= 0.05 - 1e-6
    assert reference - 1e-6 <= pyo.value(m.effort) <= 1.02 * reference


def test_optimality_conditions_find_a_plan_nearby_at_twenty_times_the_steps(reference):
    m, _, result = solved("optimality")
    # Not the same optimum: the multipliers' homotopy may settle in another one. Pairs hold up to 1e-8 or so, and
    # the nearest points with them up to its square root.
    assert pyo.value(m.effort) == pytest.approx(reference, rel=0.1)
    assert min(exact(m.move, ARROW, WALL, m.move.time)) == pytest.approx(0.05, abs=1e-3)
    assert result.iterations > 5 * solved("plane")[2].iterations


def test_optimality_conditions_reproduce_the_fixed_clearance_of_the_seed():
    m = turning_move()
    avoid = avoiding(m, formulation=rcp.obstacles.Optimality(cold=True), clearance=0.02)
    avoid.initialize()
    assert {each.value for each in avoid.corner_weight.values()} == {0.0}
    index = next(iter(avoid.planes))
    for number, size in enumerate((0.3, 0.01, 0.02)):
        for axis in (0, 1):
            avoid.normal[(*index, axis)].set_value(size if axis == number % 2 else 0.0)
        wanted = (size**2 + 1e-4) ** 0.5 - (5e-4) ** 0.5
        assert pyo.value(avoid.separation[index].body) == pytest.approx(wanted, abs=1e-15)


# In the plane, of 4 corners or sides each: (variables, rows) per certificate.
SIZES = {"plane": (3, 9), "dual": (8, 4), "mixed": (4, 5), "offset": (8, 4), "optimality": (18, 11)}


@pytest.mark.parametrize("formulation", SIZES)
def test_sizes(formulation):
    m = turning_move(elements=2, stages=1)
    avoid = avoiding(m, formulation=formulation, between=None)
    variables = sum(len(each) for each in avoid.component_objects(pyo.Var))
    rows = sum(1 for _ in avoid.component_data_objects(pyo.Constraint))
    assert (variables, rows) == tuple(3 * each for each in SIZES[formulation])


def test_one_plane_per_interval_needs_as_many_rows_of_the_body_as_poses():
    m = turning_move(elements=5, stages=1)
    avoid = avoiding(m)
    assert len(avoid.planes) == 5
    assert len(avoid.first_side) == 5 * 2 * 4
    assert len(avoid.second_side) == 5 * 4
    assert len(avoid.unit) == 5


def test_one_plane_per_interval_is_safe_between_the_nodes_where_nodes_alone_are_not():
    wall = {"wall": rcp.Polytope.box(0.1, 2, center=(2, -0.5))}
    safe = {}
    for between in ("plane", None):
        m = turning_move(elements=3, stages=1, turn=0.0)
        avoid = avoiding(m, between=between, obstacles=wall)
        avoid.initialize()
        rcp.solve(m).raise_for_status()
        safe[between] = avoid.verify().safe
    assert safe == {"plane": True, None: False}
