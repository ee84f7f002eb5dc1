"""What a user of Pyomo may expect of pairs, one sentence after another.

Kept elsewhere: that importing registers everything, prints nothing and costs little (architecture/test_shop_window),
that nothing but solving needs an Ipopt (solving/test_solve), that wrong statements are named (test_bad_input), and that
what is applied is reverted (test_transformation, test_forms, test_disjunctions).
"""

import itertools
import math
from collections.abc import Callable
from typing import Any

import pyomo.environ as pyo
import pyomo.mpec as mpec
import pytest
from mpcc_catalogue.branches import enumerate_branches

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.complementarity import canonical_form, side_values

with_ipopt = pytest.mark.asl


def existing_model() -> Any:
    """A user's model of pyomo.mpec: min sum (gap - 1)^2 + (force - 3)^2 with 0 <= gap ⟂ force - least >= 0."""
    m = pyo.ConcreteModel(name="existing")
    m.I = pyo.Set(initialize=[1, 2])
    m.gap, m.force = pyo.Var(m.I, bounds=(0, None), initialize=1), pyo.Var(m.I, initialize=2)
    m.least = pyo.Param(initialize=1, mutable=True)
    m.cc = mpec.Complementarity(m.I, rule=lambda m, i: mpec.complements(m.gap[i] >= 0, m.force[i] - m.least >= 0))
    m.cost = pyo.Objective(expr=sum((m.gap[i] - 1) ** 2 + (m.force[i] - 3) ** 2 for i in m.I))
    return m


# ---- 11: every form against its branches


def plane() -> Any:
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(-9, 9), initialize=0.5), pyo.Var(bounds=(-9, 9), initialize=0.5)
    m.box = pyo.Var(bounds=(-1, 2), initialize=0.5)
    m.lo, m.up = pyo.Param(initialize=-1, mutable=True), pyo.Param(initialize=2, mutable=True)
    m.tied = pyo.Constraint(expr=m.box == m.x)
    m.e = pyo.Expression(expr=m.x)
    m.aim = pyo.Param([1, 2], mutable=True, initialize=0)
    m.cost = pyo.Objective(expr=(m.x - m.aim[1]) ** 2 + (m.y - m.aim[2]) ** 2)
    return m


between = pyo.inequality
FORMS: dict[str, Callable[[Any], Any]] = {
    "single": lambda m: (m.x >= 0, m.y >= 0),
    "variables on both sides": lambda m: (m.x >= m.y, m.y >= 0),
    "one-sided upper": lambda m: (m.x <= m.up, m.y <= 1),
    "range": lambda m: (between(-1, m.x, 2), m.y + 0 * m.x),
    "range, mutable": lambda m: (between(m.lo, m.e, m.up), m.y + 0 * m.x),
    "range, nonlinear": lambda m: (between(-1, m.x**3, 2), m.y + 0 * m.x),
    "range, positive": lambda m: (between(-1, m.x, 2), m.y >= 0),
    "range, negative": lambda m: (m.y <= 0, between(-1, m.x, 2)),
    "plain variable": lambda m: (m.box, m.y + 0 * m.x),
    "equality": lambda m: (m.x + m.y == 1, m.x - m.y),
}


@pytest.mark.parametrize("form", FORMS)
def test_pyomo_mpec_and_this_package_mean_the_same(form):
    statement, m = FORMS[form], plane()
    m.ours = rcp.Complementarity(expr=statement(m))
    m.theirs = mpec.Complementarity(expr=statement(m))
    for x, y in itertools.product((-1.5, 0.5, 2.5), (-2.0, 0.0, 2.0)):
        m.x.set_value(x)
        m.box.set_value(x)
        m.y.set_value(y)
        ours, theirs = (canonical_form(pair) for pair in (m.ours, m.theirs))
        assert [side_values(pair) for pair in ours.pairs] == [side_values(pair) for pair in theirs.pairs]
        assert [str(row) for row in ours.rows] == [str(row) for row in theirs.rows]


@with_ipopt
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("aim", [(-2.5, -1.5), (0.5, 1.5), (3.5, -1.5)])
def test_every_form_reaches_the_best_of_its_branches(form, aim):
    def stated(start: tuple[float, float]) -> Any:
        m = plane()
        m.aim.store_values(dict(enumerate(aim, start=1)))
        m.x, m.y = start
        m.cc = rcp.Complementarity(expr=FORMS[form](m))
        return m

    best = math.inf
    # A local solver may end in a worse branch than the best: it has three starts.
    for start in (aim, (0.5, 0.5), (1.9, -0.5)):
        m = stated(start)
        result = rcp.solve(m)
        result.raise_for_status()
        assert max((abs(residual.natural) for residual in result.residuals), default=0) <= 1e-4
        assert all(pyo.value(row.args[0] - row.args[1]) == pytest.approx(0, abs=1e-6) for row in equalities(m.cc))
        best = min(best, result.objective)
    # From a point inside: a solver that starts where a cube is flat does not get anywhere.
    assert best == pytest.approx(enumerate_branches(stated((1.0, 0.5)), starts=1)[0], abs=2e-4)


def equalities(source: Any) -> list[Any]:
    return [row for row in canonical_form(source).rows if len(row.args) == 2 and not canonical_form(source).pairs]


# ---- 14: the report


@with_ipopt
def test_after_the_homotopy_every_pair_and_every_step_is_reported():
    m = existing_model()
    result = rcp.solve(
        m, strategies=rcp.Strategy(schedule=rcp.relaxations.Geometric(first=1e-1, factor=0.1, last=1e-8))
    )
    assert [residual.name for residual in result.residuals] == ["cc[1]", "cc[2]"]
    natural = [residual.natural for residual in result.residuals]
    by_hand = [min(m.gap[i].value, m.force[i].value - 1) for i in m.I]
    assert natural == pytest.approx(by_hand, abs=1e-12)
    assert 0 <= max(natural) <= sum(natural) <= 1e-3
    deltas = [step.delta for step in result.steps if step.delta is not None]
    assert deltas == sorted(deltas, reverse=True)
    assert deltas[0] == pytest.approx(1e-1)
    assert all(step.status.solved for step in result.steps if step.status is not None)
