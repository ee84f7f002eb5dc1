"""The collector of garbage is as the user has it after a solve, whatever other threads do meanwhile."""

import contextlib
import gc
import threading
from collections.abc import Iterator

import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.modeling.rare_collections import SELDOM, rare_collections


@pytest.fixture(autouse=True)
def usual() -> Iterator[None]:
    before = gc.get_threshold()
    yield
    gc.set_threshold(*before)


@pytest.mark.parametrize(("before", "inside"), [(0, 0), (700, SELDOM), (2 * SELDOM, 2 * SELDOM)])
def test_the_threshold_is_raised_and_put_back(before: int, inside: int) -> None:
    """Zero is "never"."""
    gc.set_threshold(before, 7, 5)
    with rare_collections():
        assert gc.get_threshold()[0] == inside
        with contextlib.suppress(KeyError), rare_collections():
            assert gc.get_threshold()[0] == inside
            raise KeyError
        assert gc.get_threshold()[0] == inside
    assert gc.get_threshold()[:2] == (before, 7)


def test_it_is_put_back_whoever_leaves_first() -> None:
    gc.set_threshold(700, 7)
    entered, may_leave = threading.Event(), threading.Event()

    def stay() -> None:
        with rare_collections():
            entered.set()
            may_leave.wait(10.0)

    with rare_collections():
        other = threading.Thread(target=stay)
        other.start()
        assert entered.wait(10.0)
    may_leave.set()
    other.join()
    assert gc.get_threshold()[:2] == (700, 7)


@pytest.mark.casadi
@pytest.mark.parametrize("solve", [rcp.solve, lambda m: pyo.SolverFactory("pyrobocop.ipopt").solve(m)])
def test_each_door_raises_it_only_while_it_solves(solve) -> None:
    gc.set_threshold(700, 7)
    m = pyo.ConcreteModel()
    m.x = pyo.Var(initialize=1.0)
    m.cost = pyo.Objective(expr=(m.x - 2.0) ** 2)
    solve(m)
    assert gc.get_threshold()[:2] == (700, 7)
    assert m.x.value == pytest.approx(2.0)
