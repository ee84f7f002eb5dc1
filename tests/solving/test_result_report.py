"""What a result says about its pairs and its runs, as data and as text."""

import math

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.checked import solution
from harness.small_problems import corners
from hypothesis import given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo import optional_imports
from pyrobocop_pyomo.complementarity import PairResidual
from pyrobocop_pyomo.mpcc.multipliers import Multipliers, Stationarity
from pyrobocop_pyomo.solving.result_text import PairReport, pair_reports, pair_table, split_name

# The first side zero, the second one, and both.
THREE_KINDS = {1: (-1, 2), 2: (3, 0.5), 3: (-1, -2)}
sizes = st.floats(0.0, 10.0).filter(lambda size: size == 0.0 or size > 1e-5)


@pytest.fixture(scope="module")
def result() -> rcp.SolveResult:
    return solution(corners(THREE_KINDS))


@pytest.mark.casadi
def test_every_pair_has_its_sides_and_multipliers_in_order(result):
    assert [each.name for each in result.pairs] == [each.name for each in result.residuals]
    assert [each.active.value for each in result.pairs] == ["first", "second", "biactive"]
    assert [each.index for each in result.pairs] == ["1", "2", "3"]
    first, second, both = result.pairs
    assert (first.second, second.first) == pytest.approx((2, 3), abs=1e-5)
    # Twice the distance of the zero side from its goal: how fast the objective grows away from zero.
    assert (first.first_multiplier, first.second_multiplier) == pytest.approx((2, 0), abs=1e-5)
    assert (second.first_multiplier, second.second_multiplier) == pytest.approx((0, -1), abs=1e-5)
    assert (both.first_multiplier, both.second_multiplier) == pytest.approx((2, 4), abs=1e-5)
    assert result.biactive == [both]


@pytest.mark.casadi
def test_the_report_counts_and_names(result):
    text = result.report(worst=2)
    counts = next(line for line in text.splitlines() if line.startswith("pair  ") and " 3 " in line)
    assert counts.split()[:6] == ["pair", "3", "1", "1", "1", "0"]
    assert "All pairs are met exactly." in text
    assert "Biactive pairs" in text
    assert "pair[3]" in text.split("Biactive pairs")[1]
    assert "pair[2]" in text.split("would gain most")[1]
    assert result.certificate.value in text
    assert result.multipliers is not None
    assert result.multipliers.kind.value in text
    assert len(str(result).splitlines()) == 2  # a second one of its pairs
    assert result.steps_table() in text


@pytest.mark.casadi
def test_tables_hold_what_the_reports_hold(result):
    pandas = pytest.importorskip("pandas")
    pairs, steps = result.to_pandas(), result.steps_to_pandas()
    assert isinstance(pairs, pandas.DataFrame)
    assert list(pairs.index) == [each.name for each in result.pairs]
    assert list(pairs["active"]) == ["first", "second", "biactive"]
    assert list(pairs["first_multiplier"]) == [each.first_multiplier for each in result.pairs]
    assert list(steps["iterations"]) == [step.iterations for step in result.steps]
    assert list(steps.index) == list(range(1, len(result.steps) + 1))
    assert len(result.table().splitlines()) == 4
    assert len(result.steps_table().splitlines()) == 1 + len(result.steps)


@pytest.mark.casadi
def test_without_a_certificate_there_are_no_multipliers():
    found = rcp.solve(corners(THREE_KINDS), strategies=rcp.Strategy(polish=False))
    assert {(each.first_multiplier, each.second_multiplier) for each in found.pairs} == {(None, None)}
    assert " - " in found.table()
    worst = max(found.pairs, key=lambda each: abs(each.natural))
    assert worst.name in found.report(worst=1).split("Worst pairs")[1]
    assert "not examined" in found.report()


@pytest.mark.casadi
def test_a_model_without_pairs_has_a_report_as_well():
    m = pyo.ConcreteModel(name="plain")
    m.x = pyo.Var(initialize=0)
    m.cost = pyo.Objective(expr=(m.x - 1) ** 2)
    found = rcp.solve(m)
    assert (found.pairs, found.biactive) == ([], [])
    assert str(found).startswith("plain: solved. objective 0, ")
    assert "stationarity" in found.report()
    if optional_imports.pandas_available:
        assert len(found.to_pandas()) == 0


@given(a=sizes, b=sizes)
def test_the_zero_side_is_the_one_that_is_zero(a, b):
    pair = PairReport("p", a, b)
    expected = {(True, False): "first", (False, True): "second", (True, True): "biactive", (False, False): "neither"}
    assert pair.active.value == expected[a == 0, b == 0]
    assert (pair.natural, pair.product) == (min(a, b), a * b)


@pytest.mark.parametrize(
    ("name", "component", "index"),
    [
        ("pair", "pair", ""),
        ("m.wall[0.1]", "m.wall", "0.1"),
        ("b[2].pair[1,a]", "b[2].pair", "1,a"),
        ("b[2].pair", "b[2].pair", ""),
        ("b[2].range[3] (lower)", "b[2].range (lower)", "3"),
        ("range (upper)", "range (upper)", ""),
    ],
)
def test_names_are_split_at_their_own_index(name, component, index):
    assert split_name(name) == (component, index)


def test_a_long_table_says_what_it_leaves_out():
    pairs = [PairReport(f"p[{i}]", 0.0, math.pi) for i in range(9)]
    assert pair_table(pairs, 4).splitlines()[-1] == "... and 5 more"
    assert len(pair_table(pairs).splitlines()) == 10


@pytest.mark.parametrize("kind", list(Stationarity))
def test_multipliers_of_a_point_that_is_not_stationary_are_not_shown(kind):
    found = Multipliers(kind, np.array([2.0]), np.array([0.5]), np.empty(0), 0.0)
    (pair,) = pair_reports([PairResidual("p", 0.0, 0.0)], found)
    expected = (None, None) if kind is Stationarity.NONE else (2.0, 0.5)
    assert (pair.first_multiplier, pair.second_multiplier) == expected
