"""The numbered formulas of the explanation pages, evaluated against the code."""

import math
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import with_phase
from harness.scenes import avoiding, placed, set_poses, turning_move

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.diagnosis import Severity
from pyrobocop_pyomo.numerics import remesh
from pyrobocop_pyomo.obstacles.tightening import tighten

from .code_blocks import ROOT

# -------------------------------------------------------------------- collocation


def test_moving_elements_keep_their_factors():
    _, b = with_phase("phase", mesh=[0.0, 0.3, 1.0], free_element_widths=(0.5, 1.25))
    assert (b.boundary[0].value, b.boundary[2].value) == (0, 1)
    assert [(row.lb, row.ub) for row in b.boundary_width.values()] == [
        pytest.approx((0.5 * width, 1.25 * width)) for width in (0.3, 0.7)
    ]


# -------------------------------------------------------------------- complementarity


def test_weights_of_a_phase_are_those_of_the_quadrature():
    m, b = with_phase("phase", mesh=[0.0, 0.3, 1.0], stages=2)
    b.gap, b.force = rcp.Algebraic(bounds=(0, None)), rcp.Algebraic(bounds=(0, None))

    @b.complementarity
    def contact(b, t):
        return rcp.complements(b.gap[t], b.force[t])

    weights = [pair.weight for pair in rcp.active_pairs(m)]
    assert weights == pytest.approx([h * w for h in (0.3, 0.7) for w in b.grid.scheme.b])


# -------------------------------------------------------------------- mesh refinement


def decaying(elements, scheme):
    _, b = with_phase("phase", duration=1.0, elements=elements, scheme=scheme)
    b.x = rcp.State(initial=1)
    b.ode(lambda b, t: {b.x: -3 * b.x[t] + t})
    return b


@pytest.mark.parametrize(
    "scheme", [build(s) for build in (rcp.schemes.radau, rcp.schemes.gauss_legendre) for s in (1, 2)], ids=str
)
def test_error_of_an_element_is_the_distance_from_its_own_motion_and_falls_with_the_order(scheme):
    largest = []
    for elements in (8, 16):
        b = decaying(elements, scheme)
        trajectory = b.simulate(method="scheme")
        errors = trajectory.verify().element_errors
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
# The numbered formulas of the page on the structural index, evaluated against the code.


@pytest.mark.parametrize(("final", "severity"), [(1.0, Severity.WARNING), (2.0, Severity.ERROR)])
def test_dependent_rows_over_the_horizon_contradict_each_other_where_residuals_do(
    final: float, severity: Severity
) -> None:
    """eq-left-null: x' = y' = u from 0 to 1 and to `final`; with equal ends one row too many, else a wrong one."""
    m, b = with_phase("p", elements=4)
    b.x, b.y, b.u = rcp.State(initial=0, final=1), rcp.State(initial=0, final=final), rcp.Control()
    b.ode(lambda b, t: {b.x: b.u[t], b.y: b.u[t]})
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    (finding,) = rcp.diagnose(m).findings
    assert finding.severity is severity
    assert ("contradict each other" if severity is Severity.ERROR else "follows from the others") in finding.message


# --------------------------------------------------------------------
# The numbered formulas on separations and on planning in rounds, evaluated against the code.


PAGE = ROOT / "docs" / "explanation" / "obstacle-avoidance.md"


@pytest.mark.parametrize("where", ["plane", "space"])
def test_the_table_of_sizes(where: str) -> None:
    m = turning_move(elements=2, stages=1)
    box = rcp.Polytope.box(1, 1) if where == "plane" else rcp.Polytope.box(1, 1, 1)
    pose = (
        placed if where == "plane" else (lambda b, t: rcp.spatial_pose((b.x[t], b.y[t], 3), euler=(0, 0, b.theta[t])))
    )
    avoid = avoiding(m, between=None, bodies={"body": rcp.Body(box, pose)}, obstacles=[box])
    unknowns = sum(len(variable) for variable in avoid.component_objects(pyo.Var))
    rows = sum(1 for _ in avoid.component_data_objects(pyo.Constraint))
    counts = re.search(r"^\| \$d \+ 1\$ \|.*\| (\d+), (\d+) \| (\d+), (\d+) \|$", PAGE.read_text("utf-8"), re.MULTILINE)
    assert counts is not None
    of_page = [int(count) for count in counts.groups()]
    assert [unknowns / 3, rows / 3] == (of_page[:2] if where == "plane" else of_page[2:])


@pytest.mark.parametrize("split", [False, True])
@pytest.mark.parametrize("equations", [False, True])
def test_margins_grow_by_what_was_missing(equations: bool, split: bool) -> None:
    """eq-margin, for a body that turns beside the wall at constant rates."""
    m = turning_move(elements=2, stages=1)
    avoid = avoiding(m)
    set_poses(m.move, np.array([(0.92, -0.5, -0.6), (0.92, -0.5, 0.8), (0.75, -0.5, -0.6)]))
    for state in (m.move.x, m.move.y, m.move.theta):
        state.unfix()
    avoid.initialize()
    report = avoid.verify(equations=equations)
    (pair,) = report.body_pairs
    before = {index: 0.001 * number for number, index in enumerate(avoid.separations, start=1)}
    for index, margin in before.items():
        avoid.set_margin(*index, margin)
    tighten(avoid, report, split=split)
    assert set(pair.unproven) == ({0, 1} if equations else {0})
    led_away = np.nan_to_num(pair.interval_deviation)  # nothing where only the plan is looked at
    for interval, (index, margin) in enumerate(before.items()):
        missing = pair.clearance + led_away[interval] - pair.interval_distance[interval]
        wanted = margin + (1.25 if split else 1) * missing if interval in pair.unproven else margin
        halves = [key for key in avoid.separations if index[2] <= key[2] < index[2] + 0.5]
        is_split = split and interval in pair.unproven and interval not in pair.plan_only
        assert len(halves) == (2 if is_split else 1)
        assert [avoid.margin[key].value for key in halves] == pytest.approx(
            [wanted / (4 if is_split else 1)] * len(halves)
        )
