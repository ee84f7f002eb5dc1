"""Obstacles and regions over the times of a phase that gets another mesh in place."""

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import text, with_phase
from harness.scenes import state_point

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.solving.starts import coarser_copy

COARSE, FINE = (0.0, 0.25, 0.5, 0.75, 1.0), (0.0, 0.125, 0.25, 0.5, 0.6, 0.75, 1.0)
SQUARE, WALL = rcp.Polytope.box(0.5, 0.5), rcp.Polytope.box(1, 2, center=(2, 0.4))


def around_a_wall(mesh: Any, *, on_model: bool = False, **options: Any) -> Any:
    m, b = with_phase("move", duration=1.0, mesh=mesh, stages=2)
    state_point(b)
    b.initialize(x=lambda t: 4 * t, y=lambda t: -4 * t * (1 - t), u=4.0, v=lambda t: 8 * t - 4)
    home = m if on_model else b

    def pose(home: Any, t: Any) -> Any:
        b = home.move if on_model else home
        return rcp.planar_pose(b.x[t], b.y[t], 0.3 * b.y[t])

    home.avoid = rcp.ObstacleAvoidanceBlock(
        b.time, body=SQUARE, pose=pose, obstacles={"wall": WALL}, clearance=0.05, **options
    )
    home.inside = rcp.Containment(b.time, body=SQUARE, pose=pose, region=rcp.Polytope.box(8, 6, center=(2, 0)))
    home.avoid.initialize()
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2 + b.v[t] ** 2))
    return m


def rows_at(m: Any, seed: int) -> dict[str, Any]:
    """Bodies and bounds of all rows, at numbers that depend on the names of the variables alone."""
    generator = np.random.default_rng(seed)
    for variable in sorted(m.component_data_objects(pyo.Var), key=lambda variable: variable.name):
        variable.set_value(generator.uniform(0.1, 0.9), skip_validation=True)
    return {
        row.name: [np.nan if number is None else number for number in (pyo.value(row.body), row.lb, row.ub)]
        for row in m.component_data_objects(pyo.Constraint)
    }


@pytest.mark.parametrize(
    "options",
    [{"on_model": True, "between": None}, {"broad_phase": 1.0}],
    ids=str,
)
def test_rows_are_those_of_a_model_that_is_built_on_the_mesh(options: dict[str, Any]) -> None:
    m, fresh = around_a_wall(COARSE, **options), around_a_wall(FINE, **options)
    m.move.remesh(FINE)
    fresh.move.initialize(m.move.trajectory())
    avoid, wanted = ((each if options.get("on_model") else each.move).avoid for each in (m, fresh))
    wanted.initialize()
    assert set(avoid.separations) == set(wanted.separations)
    assert avoid.separation_gaps() == pytest.approx(wanted.separation_gaps())
    ours, theirs = rows_at(m, 1), rows_at(fresh, 1)
    assert set(ours) == set(theirs)
    for name, row in theirs.items():
        assert ours[name] == pytest.approx(row, rel=1e-9, abs=1e-12, nan_ok=True), name


def test_splits_and_margins_start_again_and_numbers_of_the_user_stay() -> None:
    m = around_a_wall(COARSE)
    avoid = m.move.avoid
    first = next(iter(avoid.separations))
    avoid.set_margin(*first, 0.2)
    avoid.split(*first)
    avoid.clearance["body", "wall"] = 0.08
    m.move.inside.set_margin(1, 0.1)
    m.move.remesh(FINE)
    assert len(avoid.separations) == len(FINE) - 1
    assert {pyo.value(avoid.margin[index]) for index in avoid.separations} == {0.0}
    assert {pyo.value(margin) for margin in m.move.inside.margin.values()} == {0.0}
    assert pyo.value(avoid.clearance["body", "wall"]) == 0.08
    assert m.move.avoid is avoid


def test_nothing_has_changed_where_something_cannot_follow() -> None:
    m = around_a_wall(COARSE)
    avoid = m.move.avoid
    avoid.split(*next(iter(avoid.separations)))
    m.culprit = pyo.Constraint(expr=m.move.u[m.move.points.first()] <= 9)
    before, gaps = text(m), avoid.separation_gaps()
    with pytest.raises(ModelError, match="'culprit' reads"):
        m.move.remesh(FINE)
    assert text(m) == before
    assert avoid.separation_gaps() == gaps
    avoid.split(*list(avoid.separations)[1])
    avoid.initialize()
    del m.culprit
    m.move.remesh(FINE)
    assert len(avoid.separations) == len(FINE) - 1


@pytest.mark.ipopt
def test_a_plan_is_safe_on_the_finer_mesh_and_no_longer_than_one_that_started_there() -> None:
    m, fresh = around_a_wall(COARSE), around_a_wall(FINE)
    rcp.solve(m).raise_for_status()
    m.move.remesh(FINE)
    again, direct = rcp.solve(m), rcp.solve(fresh)
    assert again.safety.safe
    assert again.objective == pytest.approx(direct.objective, rel=1e-4)


def test_a_copy_on_fewer_elements_is_that_of_the_whole_model_and_the_model_stays() -> None:
    m = around_a_wall(FINE)
    before, parts = text(m), [id(part) for part in m.component_data_objects()]
    whole = m.clone()
    whole.move.remesh(1)
    copy = coarser_copy(m, 1)
    assert (text(m), [id(part) for part in m.component_data_objects()]) == (before, parts)
    assert copy.move.avoid.separation_gaps() == whole.move.avoid.separation_gaps()
    assert text(copy) == text(whole)
