"""The ladder: each strategy alone, the best of all, what is certified, and nothing left behind."""

import pyomo.environ as pyo
import pytest
from harness.checked import solution
from harness.routes import every_backend
from harness.small_problems import corner
from hypothesis import given
from hypothesis import strategies as st
from known_mpccs import mpcc_problem, mpcc_problems

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.complementarity import crossed_pairs_of
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.mpcc.multipliers import Stationarity
from pyrobocop_pyomo.solving import executable_session
from pyrobocop_pyomo.solving.iterates import Iterate, Tolerances
from pyrobocop_pyomo.solving.strategies import STRATEGIES as TABLE

STRATEGIES = [strategy.name for strategy in TABLE[:4]]

pytestmark = pytest.mark.casadi

RELAX = pyo.TransformationFactory("pyrobocop.relax_complementarity")
# Small, with one optimum that every strategy has to find: linear, biactive, badly scaled, bilevel, contact, no plain
# pair.
KNOWN = ("kth2", "ralph1", "scholtes4", "scale3", "jr1", "only the corner", "nonlinear sides", "bard1", "gripper",
         "sliding step", "projection on a box", "stated twice")  # fmt: skip
INFEASIBLE = [problem for problem in mpcc_problems() if not problem.feasible]


def trap() -> pyo.ConcreteModel:
    """The origin, where it starts, is M-stationary, and y descends from it to (0, 1)."""
    return corner((0, 1), (0, 0))


def bent() -> pyo.ConcreteModel:
    """min (x - 2)^2 + (y - 1)^2 over 0 <= x y + x ⟂ y + y^2 >= 0 and a row: the optimum is (1.5, 0) with value 1.25."""
    m = pyo.ConcreteModel(name="bent")
    m.x, m.y = pyo.Var(bounds=(0, None), initialize=1), pyo.Var(bounds=(0, None), initialize=1)
    m.pair = rcp.Complementarity(expr=rcp.complements(m.x * m.y + m.x >= 0, m.y + m.y**2 >= 0))
    m.limit = pyo.Constraint(expr=m.x <= 1.5)
    m.cost = pyo.Objective(expr=(m.x - 2) ** 2 + (m.y - 1) ** 2)
    return m


def everything(m: pyo.ConcreteModel) -> dict:
    """All of a model but the values of its variables and what is in its suffixes."""
    data = list(m.component_data_objects())
    return {
        "components": [(c.name, type(c), c.active) for c in m.component_objects()],
        "data": [(id(c), c.name, getattr(c, "active", None)) for c in data],
        "variables": [(v._lb, v._ub, v.domain, v.fixed) for v in m.component_data_objects(pyo.Var)],
        "rows": [str(c.expr) for c in m.component_data_objects((pyo.Constraint, pyo.Objective))],
        "suffixes": [(s.name, s.direction, s.active) for s in m.component_objects(pyo.Suffix)],
    }


# ------------------------------------------------------------------------------------------------- strategies


@pytest.mark.parametrize("strategy", STRATEGIES)
@pytest.mark.parametrize("name", KNOWN)
def test_each_strategy_alone_reaches_the_known_answer(name: str, strategy: str) -> None:
    problem = mpcc_problem(name)
    result = solution(problem.build(), strategies=strategy)
    assert result.strategy == strategy
    assert result.objective == pytest.approx(problem.best, rel=1e-6, abs=1e-6)
    assert result.largest_natural_residual <= 1e-6


@pytest.mark.casadi
def test_each_of_several_strategies_has_its_own_relaxation() -> None:
    result = rcp.solve(mpcc_problem("ralph2").build(), strategies=["barrier", "continuation", "elastic"])
    assert (result.solved, result.strategy) == (True, "barrier")


def test_an_unknown_strategy_is_refused() -> None:
    with pytest.raises(ValueError, match="unknown strategy 'stairs'. Known: 'barrier', 'continuation'"):
        rcp.solve(trap(), strategies=["barrier", "stairs"])
    with pytest.raises(ValueError, match="unknown strategy 'stairs'"):
        rcp.solve(trap(), strategies=rcp.Strategy("stairs"))
    with pytest.raises(ValueError, match="no strategy was chosen"):
        rcp.solve(trap(), strategies=[])


def iterate(objective: float, natural: float, proven: bool, converged: bool) -> Iterate:
    certificate = Certificate.PROVEN if proven else Certificate.UNKNOWN
    reason = rcp.StopReason.FINISHED if converged else rcp.StopReason.FAILED
    return Iterate(
        "fixed delta", 1e-8, None, IpoptStatus.SOLVED, 1, 0.0, objective, 0.0, 0.0, natural, stop_reason=reason,
        certificate=certificate,
    )  # fmt: skip


iterates = st.builds(
    iterate, st.sampled_from([0.0, 1.0, 2.0]), st.sampled_from([0.0, 1e-4]), st.booleans(), st.booleans()
)


@given(one=iterates, other=iterates, sign=st.sampled_from([1.0, -1.0]))
def test_of_two_iterates_at_most_one_is_better(one: Iterate, other: Iterate, sign: float) -> None:
    mine, theirs = (each.standing(Tolerances(), sign) for each in (one, other))
    assert not (mine.is_better_than(theirs) and theirs.is_better_than(mine))
    assert not mine.is_better_than(mine)
    if one.largest_natural_residual == other.largest_natural_residual:
        if sign * one.objective < sign * other.objective:
            assert mine.is_better_than(theirs)
        elif one.objective == other.objective and one.converged == other.converged:
            assert mine.is_better_than(theirs) is (
                one.certificate is Certificate.PROVEN and other.certificate is not Certificate.PROVEN
            )


def test_an_exact_point_is_better_than_a_loose_one_that_costs_less_and_looks_optimal() -> None:
    exact, loose = iterate(2.0, 0.0, False, False), iterate(1.0, 1e-4, False, True)
    mine, theirs = (each.standing(Tolerances(), 1.0) for each in (exact, loose))
    assert mine.is_better_than(theirs)
    assert not theirs.is_better_than(mine)


@every_backend
@pytest.mark.parametrize("problem", INFEASIBLE, ids=lambda problem: problem.name)
def test_what_is_infeasible_is_never_called_solved(problem, backend: str) -> None:
    result = rcp.solve(problem.build(), backend=backend)
    assert not result.solved
    assert result.quality is rcp.Quality.INFEASIBLE
    assert result.certificate is not Certificate.PROVEN
    with pytest.raises(rcp.errors.SolveFailed):
        result.raise_for_status()


# ------------------------------------------------------------------------------------------------- certificates


@every_backend
@pytest.mark.parametrize("name", ["ralph1", "scholtes4"])
def test_b_stationary_without_strong_multipliers_is_proven(name: str, backend: str) -> None:
    result = solution(mpcc_problem(name).build(), backend=backend)
    assert result.certificate is Certificate.PROVEN
    assert result.objective == pytest.approx(0.0, abs=1e-7)
    assert result.multipliers is not None
    assert result.multipliers.kind is Stationarity.M
    assert [each.name for each in result.biactive] == [each.name for each in result.residuals]


@every_backend
@pytest.mark.parametrize("strategies", [None, "tight", "elastic"])
def test_a_trap_that_is_no_local_optimum_is_left(backend: str, strategies: str | None) -> None:
    m = trap()
    result = rcp.solve(m, backend=backend, strategies=strategies)
    assert result.certificate is Certificate.PROVEN
    assert (m.x.value, m.y.value) == pytest.approx((0.0, 1.0), abs=1e-6)


@every_backend
def test_without_polish_the_relaxed_point_stays_and_is_judged_by_its_multipliers(backend: str) -> None:
    rough, polished, rest = bent(), bent(), rcp.Strategy("tight", polish=False)
    result = rcp.solve(rough, backend=backend, strategies=rest)
    less = {"stationarity": result.stationarity / 2}
    strict = rcp.solve(bent(), backend=backend, strategies=rest, tolerances=less)
    assert (result.quality, strict.quality) == (rcp.Quality.OPTIMAL, rcp.Quality.FEASIBLE)
    exact = rcp.solve(polished, backend=backend, strategies="tight")
    assert [step.label for step in result.steps] == ["fixed delta"]
    assert result.certificate is Certificate.UNKNOWN
    assert result.multipliers is None
    assert 1e-10 < result.largest_product <= 1.1e-8  # the bound is active: the cost pulls at it
    assert exact.largest_product < 1e-12
    assert rough.y.value > polished.y.value


@pytest.mark.executable
def test_without_derivatives_it_is_not_known_whether_a_point_is_stationary(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executable_session, "_compiled_or_none", lambda model: None)
    result = solution(bent(), backend="executable")
    assert result.stationarity is None
    assert "DOUBTFUL: Whether the point is stationary is not known" in str(result)


# ------------------------------------------------------------------------------------------------- the model afterwards


@every_backend
@pytest.mark.parametrize("lift", [False, True], ids=["unlifted", "lifted"])
def test_a_relaxation_of_the_users_own_is_used_and_kept(backend: str, lift: bool) -> None:
    m = bent()
    token = RELAX.apply_to(m, delta=1e-3, lift=lift)
    before = everything(m)
    result = solution(m, backend=backend)
    assert (m.x.value, m.y.value) == pytest.approx((1.5, 0.0), abs=1e-6)
    assert everything(m) == before
    assert token.block.delta.value == 1e-3
    assert not m.pair.active
    assert [each.name for each in result.residuals] == ["pair"]
    # Without variables for the sides there are no branches to solve, and nothing to certify by.
    assert (result.certificate is Certificate.PROVEN) is lift
    RELAX.revert(m, token)
    assert m.pair.active


@every_backend
@pytest.mark.parametrize("strategies", [None, *STRATEGIES], ids=str)
def test_nothing_but_values_differs_afterwards(backend: str, strategies: str | None) -> None:
    m = bent()
    m.dual = pyo.Suffix(direction=pyo.Suffix.IMPORT)
    m.scaling_factor = pyo.Suffix(direction=pyo.Suffix.EXPORT)
    m.scaling_factor[m.cost] = 2.0
    m.asleep = pyo.Suffix(direction=pyo.Suffix.IMPORT)
    m.asleep.deactivate()
    m.idle = pyo.Constraint(expr=m.x >= 5)
    m.idle.deactivate()
    before = everything(m)
    rcp.solve(m, backend=backend, strategies=strategies)
    assert everything(m) == before
    assert [(each.name, factor) for each, factor in m.scaling_factor.items()] == [("cost", 2.0)]
    assert [each.name for each in m.dual] == ["limit"]
    assert m.dual[m.limit] == pytest.approx(-1.0, abs=1e-5)  # one more of x is worth 2 (2 - 1.5)


@every_backend
def test_hardly_any_time_gives_the_model_back(backend: str) -> None:
    m = mpcc_problem("membrane 6x6").build()
    before = everything(m)
    result = rcp.solve(m, backend=backend, time_limit=1e-6)
    assert result.stop_reason is rcp.StopReason.TIME_LIMIT
    assert len(result.steps) == 1
    assert everything(m) == before
    assert all(v.value is not None for v in m.component_data_objects(pyo.Var))


# --------------------------------------------------------------------
# What a grouping crosses is held to the end: by the branch that is solved, by its certificate, in the multipliers.


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
        found = [(a.source.index(), b.source.index()) for a, b in crossed_pairs_of(m)]
        assert found == expected
