"""No spoilt problem has a wrong answer with a clean report; and the judge that says so sees what is wrong."""

import numpy as np
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp

from .judge import Judge
from .models import PROBLEMS, objective_of
from .statements import STATEMENTS, complaint
from .trial import KINDS, Verdict, executable_found, tried

ROUNDS = 6
pytestmark = [pytest.mark.ipopt, pytest.mark.executable]


@pytest.fixture(autouse=True)
def _executable() -> None:
    executable_found()


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_no_wrong_answer_comes_with_a_clean_report(kind: str) -> None:
    trials = [tried(KINDS.index(kind) + turn * len(KINDS)) for turn in range(ROUNDS)]
    assert not [str(trial) for trial in trials if trial.verdict is Verdict.FAULT]


@pytest.mark.parametrize(("seed", "spoiler"), [(20334, "scaled_sides"), (31132, "other_units")])
def test_sides_below_the_tolerance_are_not_called_complementary(seed: int, spoiler: str) -> None:
    """Friction in units in which it is 7e-7, or 2e-8, has sides that a tolerance of 1e-6 cannot tell from zero."""
    assert tried(seed, spoiler).verdict in (Verdict.NAMED, Verdict.NOT_SOLVED)


def test_linked_phases_that_pyomo_has_scaled_and_renamed_have_the_same_answer() -> None:
    """Their durations have another name, and nobody has to ask for them where nothing moves."""
    assert tried(30191, "scaled_by_pyomo").verdict is Verdict.AGREED


@pytest.mark.parametrize("name", ["regulator", "lift", "dae_cart", "quadratic_program"])
def test_the_judge_takes_answers_and_refuses_others(name: str) -> None:
    def solved() -> pyo.ConcreteModel:
        m = PROBLEMS[name].build()
        rcp.solve(m, progress=False).raise_for_status()
        return m

    size = abs(PROBLEMS[name].answer.objective)
    assert Judge(solved()).complaint(size, seed=0) is None
    m = solved()
    v = max((v for v in m.component_data_objects(pyo.Var) if not v.fixed and v.value), key=lambda v: abs(v.value))
    v.set_value(1.1 * v.value, skip_validation=True)
    assert "violated" in str(Judge(m).complaint(size, seed=0))
    m = solved()
    objective_of(m).set_value(-objective_of(m).expr)
    assert "better" in str(Judge(m).complaint(size, seed=0))


def test_the_comparison_with_mathematics_takes_answers_and_refuses_others() -> None:
    statement = STATEMENTS["waypoint_between_points"](np.random.default_rng(5))
    result, m = statement.solve(statement.model)
    assert complaint(result, m, statement) is None
    for u in m.p.u.values():
        u.set_value(1.01 * u.value)
    assert "objective off by" in str(complaint(result, m, statement))


@pytest.mark.parametrize("seed", range(3))
def test_a_seed_stands_for_one_trial(seed: int) -> None:
    once, again = tried(seed), tried(seed)
    assert (once.spoiler, once.problem, once.verdict) == (again.spoiler, again.problem, again.verdict)
