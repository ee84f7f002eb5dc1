"""Planning again and again through contact: every plan has exact pairs, and none is lost."""

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from mpcc_catalogue.point_check import PointCheck

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ComplementarityError

pytestmark = pytest.mark.ipopt


def cart(**how: Any) -> tuple[pyo.ConcreteModel, PointCheck]:
    """A cart near a soft wall that only pushes, relaxed; and an independent check of what was stated."""
    m = pyo.ConcreteModel(name="cart")
    m.ahead = b = rcp.PhaseBlock(duration=1.0, elements=20, scheme="implicit_euler")
    b.x, b.v = rcp.State(initial=0.0, bounds=(None, 2.0)), rcp.State(initial=0.0)
    b.u, b.wall = rcp.Control(bounds=(-2, 2)), rcp.Control(bounds=(0, None))
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] - b.wall[t]})
    b.complementarity(lambda b, t: rcp.complements(b.wall[t] >= 0, 1 - b.x[t] + b.wall[t] / 200 >= 0), name="touch")
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: (b.x[t] - 0.9) ** 2 + 0.01 * b.u[t] ** 2))
    check = PointCheck(m)
    pyo.TransformationFactory("pyrobocop.relax_complementarity").apply_to(m, **{"delta": 1e-3, "lift": True, **how})
    return m, check


def test_each_plan_is_exact_and_costs_what_a_fresh_solve_finds() -> None:
    m, check = cart()
    controller = rcp.studies.RecedingHorizon(m, m.ahead, exact_pairs=True)
    random = np.random.default_rng(1)
    state, touched = {"x": 0.7, "v": 3.0}, 0
    for k in range(40):
        if k == 20:
            state["v"] += 3.0
        step = controller.step(state, advance=0.05 if k else 0.0, mu=1e-5)
        assert step.solved
        assert step.natural_residual == pytest.approx(0.0, abs=1e-9)
        point = check.point()  # what stands on the model is the plan
        assert point.violation <= 1e-6
        assert point.natural <= 1e-6
        touched += float(np.max(step.plan.wall)) > 1e-3
        if k % 10 == 0:
            fresh, _ = cart()
            for name, number in state.items():
                fresh.ahead.component(name)[0.0].set_value(number)
            assert point.objective <= 1.01 * rcp.solve(fresh, progress=False).objective + 1e-6
        state = {name: float(step.plan(0.05)[name]) + random.normal(0, 0.02) for name in state}
    assert touched >= 4  # the wall is in the plans
    assert m.relaxed_complementarity.delta.value == 1e-3


def test_a_delta_that_shows_no_branch_becomes_smaller_and_is_put_back() -> None:
    """Where forces may act across any gap, the smaller side of each pair says nothing."""
    m, check = cart(delta=1e3)
    controller = rcp.studies.RecedingHorizon(m, m.ahead, exact_pairs=True)
    for x, v in ((0.7, 12.0), (0.99, 15.0), (0.5, 18.0)):
        assert controller.step({"x": x, "v": v}).solved
        assert check.point().violation <= 1e-6
        assert check.point().natural <= 1e-6
        assert m.relaxed_complementarity.delta.value == 1e3


def test_a_step_that_fails_or_has_no_time_leaves_the_rest_of_the_plan_and_the_next_one_goes_on() -> None:
    m, check = cart()
    controller = rcp.studies.RecedingHorizon(m, m.ahead, exact_pairs=True)
    good = controller.step({"x": 0.5, "v": 1.0})
    bad = controller.step({"x": 1.9, "v": 1e5}, advance=0.05)  # over the bound, whatever is done
    assert good.solved
    assert not bad.solved
    assert bad.natural_residual is None
    times = 0.05 * np.arange(2, 18) + 0.025  # within elements: controls jump between them
    np.testing.assert_allclose(bad.plan(times)["u"], good.plan(times + 0.05)["u"], atol=1e-6)
    good = controller.step({"x": 0.5, "v": 1.0})
    assert good.solved
    assert check.point().natural <= 1e-6
    # A step without time gives the plan before, too.
    late = controller.step({"x": 0.55, "v": 1.0}, advance=0.05, time_limit=1e-9)
    assert not late.solved
    assert late.plan(0.125)["u"] == pytest.approx(good.plan(0.175)["u"], abs=1e-6)
    assert controller.step({"x": 0.55, "v": 1.0}, advance=0.05).solved


@pytest.mark.parametrize("how", [{"lift": False}, {"relaxation": "penalty"}], ids=["not lifted", "penalty"])
def test_pairs_that_cannot_be_made_exact_are_refused(how: dict[str, Any]) -> None:
    m, _ = cart(**how)
    with pytest.raises(ComplementarityError, match="'cart': pairs can be made exact where rows relax them"):
        rcp.studies.RecedingHorizon(m, m.ahead, exact_pairs=True)
