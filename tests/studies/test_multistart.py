"""`multistart`: the same starts for the same seed, the best point left on the model."""

import importlib
import itertools
import re
from dataclasses import replace

import pyomo.environ as pyo
import pytest
from harness.safety_reports import report_of_a_collision
from hypothesis import given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import EvaluationError, ModelError, SolveFailed
from pyrobocop_pyomo.execution import tasks
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.motion import SafetyReport
from pyrobocop_pyomo.solving.starts import RandomStarts
from pyrobocop_pyomo.studies.multistart import spreads

solving_module = importlib.import_module("pyrobocop_pyomo.studies.outcomes")


def two_valleys(sense=pyo.minimize) -> pyo.ConcreteModel:
    """(x - 1)^2 (x - 3)^2 + x / 10 has its better minimum near 1 and a worse one near 3, where the guess is."""
    m = pyo.ConcreteModel(name="two valleys")
    m.x = pyo.Var(bounds=(0, 4), initialize=3.2)
    m.y = pyo.Var(bounds=(0, 4), initialize=0.1)
    m.pair = rcp.Complementarity(expr=rcp.complements(m.x - 0.5 >= 0, m.y >= 0))
    sign = 1 if sense == pyo.minimize else -1
    m.cost = pyo.Objective(expr=sign * ((m.x - 1) ** 2 * (m.x - 3) ** 2 + 0.1 * m.x + m.y), sense=sense)
    return m


QUICK = {"strategies": "tight"}


@pytest.mark.casadi
@pytest.mark.parametrize("sense", [pyo.minimize, pyo.maximize], ids=["minimise", "maximise"])
def test_a_better_valley_than_that_of_the_guess_is_found(sense):
    alone = two_valleys(sense)
    rcp.solve(alone, **QUICK)
    assert alone.x.value > 2
    m = two_valleys(sense)
    found = rcp.studies.multistart(m, 8, seed=1, **QUICK)
    found.raise_for_status()
    assert m.x.value == pytest.approx(1.0, abs=0.05)
    assert pyo.value(m.cost) == pytest.approx(found.result.objective)
    sign = 1 if sense == pyo.minimize else -1
    objectives = [sign * outcome.result.objective for outcome in found if outcome.feasible]
    assert objectives == pytest.approx(sorted(objectives), rel=1e-5)
    assert {outcome.case.number for outcome in found} == set(range(8))
    worst = found.load(len(found) - 1)
    assert pyo.value(m.cost) == pytest.approx(worst.objective)


@pytest.mark.casadi
def test_a_seed_fixes_the_outcome():
    runs = []
    for seed in (3, 3, 4):
        m = two_valleys()
        found = rcp.studies.multistart(m, 4, seed=seed, **QUICK)
        runs.append(([(outcome.case.number, outcome.result.objective) for outcome in found], m.x.value))
    assert runs[0] == runs[1]
    assert runs[0] != runs[2]


@given(seed=st.integers(0, 10**6), number=st.integers(1, 50), spread=st.floats(0.01, 1.0))
def test_starts_lie_within_bounds_and_reach(seed, number, spread):
    m = pyo.ConcreteModel()
    m.both, m.low = pyo.Var(bounds=(-2, 8), initialize=0), pyo.Var(bounds=(5, None), initialize=7)
    m.free, m.fixed = pyo.Var(), pyo.Var(initialize=1.5)
    m.fixed.fix()
    RandomStarts(m, seed, spreads(m, spread)).put(number)
    assert -2 * spread <= m.both.value <= 8 * spread
    assert max(5, 7 - 7 * spread) <= m.low.value <= 7 + 7 * spread
    assert -spread <= m.free.value <= spread
    assert m.fixed.value == 1.5


def test_a_start_does_not_depend_on_what_was_drawn_before():
    m = two_valleys()
    starts = RandomStarts(m, 0, spreads(m, 1.0))
    starts.put(5)
    alone = (m.x.value, m.y.value)
    for number in range(6):
        starts.put(number)
    assert (m.x.value, m.y.value) == alone


def test_a_mapping_varies_only_what_it_names():
    for by_name in (True, False):
        m = two_valleys()
        spread = {"x": 0.5} if by_name else [(m.x, 0.5)]
        RandomStarts(m, 0, spreads(m, spread)).put(1)
        assert m.y.value == 0.1
        assert m.x.value != 3.2


def test_curves_over_time_are_smooth():
    m = pyo.ConcreteModel()
    m.phase = b = rcp.PhaseBlock(duration=1, elements=100, scheme="implicit_euler")
    b.x = rcp.State(bounds=(-1, 1), initial_guess=0)
    b.ode(lambda b, t: {b.x: 0.0})
    for number in range(1, 10):
        RandomStarts(m, 0, spreads(m, 1.0)).put(number)
        values = [b.x[t].value for t in b.points]
        assert max(abs(after - before) for before, after in itertools.pairwise(values)) < 0.2
        assert max(map(abs, values)) <= 1.0
        assert len(set(values)) > 1


@pytest.mark.casadi
def test_errors_and_infeasible_starts_are_ranked_last(monkeypatch):
    pytest.importorskip("pandas")
    outcomes = iter([None, 1, EvaluationError("no value"), 0])
    solved = solving_module.solve

    def flaky(model, **options):
        outcome = next(outcomes)
        if isinstance(outcome, Exception):
            raise outcome
        if outcome == 0:
            return solved(model, **{**options, "options": {"max_iter": 0}, "strategies": rcp.Strategy(polish=False)})
        return solved(model, **options)

    monkeypatch.setattr(solving_module, "solve", flaky)
    m = two_valleys()
    found = rcp.studies.multistart(m, 4, **QUICK)
    assert [outcome.case.number for outcome in found][2:] == [3, 2]
    assert (found[2].feasible, found[3].result, found[3].error) == (False, None, "EvaluationError: no value")
    with pytest.raises(SolveFailed, match="case 2 has no point. EvaluationError"):
        found.load(3)
    frame = found.to_pandas()
    assert list(frame["start"]) == [outcome.case.number for outcome in found]
    assert re.search(r"error .* EvaluationError: no value", str(found))


@pytest.mark.casadi
def test_a_safe_plan_comes_before_a_cheaper_one_that_is_not(monkeypatch):
    solved = solving_module.solve

    def judged(model, **options):
        result = solved(model, **options)
        if model.x.value >= 2:
            return replace(result, safety=SafetyReport(()))
        return replace(result, safety=report_of_a_collision(), standing=replace(result.standing, shortfall=1.0))

    monkeypatch.setattr(solving_module, "solve", judged)
    m = two_valleys()
    found = rcp.studies.multistart(m, 8, seed=1, **QUICK)
    assert found.result.safe
    assert found.result.objective > min(outcome.result.objective for outcome in found)
    assert m.x.value > 2
    safe = [outcome.result.safe for outcome in found]
    assert safe == sorted(safe, reverse=True)
    assert not all(safe)


@pytest.mark.casadi
def test_the_guess_comes_back_where_nothing_could_be_solved(monkeypatch):
    def broken(model, **options):
        model.x.set_value(0.123)
        raise EvaluationError("no value")

    monkeypatch.setattr(solving_module, "solve", broken)
    m = two_valleys()
    found = rcp.studies.multistart(m, 2)
    assert (m.x.value, m.y.value) == (3.2, 0.1)
    with pytest.raises(SolveFailed, match="no case could be solved"):
        found.raise_for_status()


@pytest.mark.casadi
def test_a_time_limit_leaves_starts_undone():
    m = two_valleys()
    found = rcp.studies.multistart(m, 500, time_limit=0.5, **QUICK)
    assert 0 < len(found.remaining) < 500
    assert len(found) + len(found.remaining) == 500
    assert found.result.steps[0].status is not IpoptStatus.TIME_LIMIT
    assert f"{len(found.remaining)} cases were left undone" in str(found)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"starts": 0}, r"starts = 0; expected"),
        ({"spread": -1.0}, r"spread is -1.0; expected a finite number >= 0"),
        ({"spread": {"x": "wide"}}, r"the spread of 'x' is 'wide'"),
        ({"spread": {"pair": 1.0}}, r"the spread of 'pair' is for no Var"),
        ({"spread": {"nothing": 1.0}}, r"has no component 'nothing'"),
        ({"spread": 0.0}, r"no free variable is left to vary"),
    ],
)
def test_arguments_that_make_no_sense(arguments, message):
    m = two_valleys()
    with pytest.raises(ModelError, match=message):
        rcp.studies.multistart(m, **arguments)
    assert m.x.value == 3.2


# ------------------------------------------------------------------------------------------------- processes


def test_all_means_the_cores_that_this_process_may_use(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tasks, "available_cores", lambda: 3)
    assert tasks.study_engine("all", None).workers == 3
    for wrong in (0, -1, True, 1.5, "some", None):
        with pytest.raises(ModelError, match="workers = .*; expected a number of processes of at least 1, or 'all'"):
            tasks.study_engine(wrong, None)
