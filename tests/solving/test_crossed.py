"""What a grouping crosses is held to the end: by the branch that is solved, by its certificate, in the multipliers."""

import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.complementarity import Crossed

pytestmark = pytest.mark.casadi


def two_stages() -> pyo.ConcreteModel:
    """At one stage the first side would be positive, at the other the second; pair by pair both may."""
    m = pyo.ConcreteModel(name="two stages")
    m.a = pyo.Var([1, 2], bounds=(0, None), initialize=0.5)
    m.b = pyo.Var([1, 2], bounds=(0, None), initialize=0.5)
    m.cc = rcp.Complementarity([1, 2], rule=lambda m, k: rcp.complements(m.a[k], m.b[k]), group=0)
    m.cost = pyo.Objective(expr=(m.a[1] - 1) ** 2 + (m.b[2] - 2) ** 2 + m.a[2] ** 2 + m.b[1] ** 2)
    return m


def test_the_polish_keeps_what_is_crossed() -> None:
    assert rcp.solve(two_stages(), progress=False).objective == pytest.approx(0.0, abs=1e-7)
    m = two_stages()
    result = rcp.solve(m, strategies=rcp.Strategy(grouping="crossed"), progress=False)
    result.raise_for_status()
    assert result.objective == pytest.approx(1.0, abs=1e-7)  # a_1 has to be zero beside b_2 = 2
    assert m.a[1].value == pytest.approx(0.0, abs=1e-9)
    assert result.certificate.name == "PROVEN"
    # The multiplier of a side is all that holds it: d(a_1 - 1)^2 at zero.
    assert result.pairs[0].first_multiplier == pytest.approx(-2.0, abs=1e-5)


def test_crossed_pairs_are_couples_of_different_pairs_of_an_element() -> None:
    relax = pyo.TransformationFactory("pyrobocop.relax_complementarity")
    for grouping, expected in (("pair", []), ("element", []), ("crossed", [(1, 2), (2, 1)])):
        m = two_stages()
        relax.apply_to(m, grouping=grouping, lift=True)
        found = [(a.source.index(), b.source.index()) for a, b in relax.crossed_pairs_of(m)]
        assert found == expected


def sliding(elements: int) -> pyo.ConcreteModel:
    """x' = u - sign(x), y' = 1 + sign(x) / 2 from (1, 0) to (0, 4) in minimal time, which is 2.8; pairs in a list."""
    m = pyo.ConcreteModel(name="sliding")
    m.phase = b = rcp.PhaseBlock(
        duration=rcp.Duration(bounds=(0.5, 10), initial_guess=3),
        elements=elements,
        stages=2,
        free_element_widths=(0.2, 3.0),
    )
    b.x = rcp.State(initial=1, final=0, initial_guess=lambda t: 1 - t)
    b.y = rcp.State(initial=0, final=4, initial_guess=lambda t: 4 * t)
    b.u = rcp.Control(bounds=(-0.5, 0.5), parametrization="piecewise_constant")
    b.right = rcp.Algebraic(bounds=(0, 1), initial_guess=0.5)
    b.above, b.below = rcp.Algebraic(bounds=(0, None)), rcp.Algebraic(bounds=(0, None))

    @b.ode
    def switched(b, t):
        sign = 2 * b.right[t] - 1
        return {b.x: b.u[t] - sign, b.y: 1 + 0.5 * sign}

    b.residual(lambda b, t: b.x[t] == b.above[t] - b.below[t], name="parts")

    @b.complementarity
    def switch(b, t):
        return [
            rcp.complements(b.above[t] >= 0, 1 - b.right[t] >= 0),
            rcp.complements(b.below[t] >= 0, b.right[t] >= 0),
        ]

    m.time = pyo.Objective(expr=b.duration)
    return m


@pytest.mark.parametrize("left_end", [None, "first"])
def test_a_list_of_pairs_is_crossed_statement_by_statement(left_end: str | None) -> None:
    m = sliding(20)
    grouping = Crossed(left_end=left_end)
    result = rcp.solve(
        m, strategies=rcp.Strategy(schedule=rcp.relaxations.Geometric(first=1.0), grouping=grouping), progress=False
    )
    assert result.quality is rcp.Quality.OPTIMAL
    assert result.objective == pytest.approx(2.8, rel=1e-7)
    b, ends = m.phase, {}
    for t in b.points:
        ends.setdefault(b.grid.element_of[t], []).append(t)
    for times in ends.values():
        for side, other in ((b.above, lambda t: 1 - b.right[t].value), (b.below, lambda t: b.right[t].value)):
            assert max(min(side[t].value, other(s)) for t in times for s in times) < 1e-7
