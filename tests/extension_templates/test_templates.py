"""Each template does its work: it is taken where a word is, and keeps the contract of its kind."""

import math
import sys
from itertools import pairwise

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.small_problems import corners
from hypothesis import assume, given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.complementarity import BarrierSchedule, Grouping, Relaxation, Schedule, shifted_rows_of, sources_of
from tests.distributed.tiny_agents import SPECS, TinyOrder, play, undisturbed

from .barrier_schedule import PowerOfBarrier
from .collocation_scheme import chebyshev
from .engine import CommandEngine
from .grouping import PerComponent
from .relaxation import FischerBurmeister
from .schedule import Superlinear

amounts = st.floats(1e-3, 1e3)
TWO = {1: (2, 1), 2: (2, 1)}  # at a distance of 1 from their corners


# -------------------------------------------------------------------- scheme


@pytest.mark.parametrize("stages", [1, 2, 3, 4])
def test_scheme_has_at_least_the_order_of_its_stages(stages):
    scheme = chebyshev(stages)
    assert scheme.order >= stages
    assert scheme.b.sum() == pytest.approx(1.0)


@pytest.mark.casadi
def test_scheme_serves_a_phase():
    m = pyo.ConcreteModel(name="decay")
    m.phase = b = rcp.PhaseBlock(duration=1.0, elements=8, scheme=chebyshev(3))
    b.x = rcp.State(initial=1)
    b.rate = rcp.Parameter(bounds=(1, 1))
    b.ode(lambda b, t: {b.x: -b.rate * b.x[t]})
    m.cost = pyo.Objective(expr=b.x[b.final_time] ** 2)
    rcp.solve(m, backend="casadi").raise_for_status()
    assert b.trajectory().x[-1] == pytest.approx(math.exp(-1), abs=1e-6)


# -------------------------------------------------------------------- relaxation


@given(a=amounts, b=amounts, delta=amounts)
def test_relaxation_accepts_the_same_points_as_the_product(a, b, delta):
    assume(abs(a * b - delta) > 1e-6 * (a + b) ** 2 + 1e-6 * delta)  # stay off the rounding edge
    assert (FischerBurmeister().residual(a, b, delta) <= 0) == (rcp.relaxations.Scholtes().residual(a, b, delta) <= 0)


@pytest.mark.casadi
def test_relaxation_solves():
    assert isinstance(FischerBurmeister(), Relaxation)
    m = corners(TWO)
    result = rcp.solve(
        m,
        strategies=rcp.Strategy(schedule=rcp.relaxations.Geometric(), relaxation=FischerBurmeister()),
        backend="casadi",
    )
    assert result.largest_product < 1e-7
    assert result.objective == pytest.approx(2.0, abs=1e-5)


# -------------------------------------------------------------------- schedule


def test_schedule_never_increases_and_meets_its_last_value():
    assert isinstance(Superlinear(), Schedule)
    steps = list(Superlinear(first=0.5, last=1e-9).steps())
    assert (steps[0], steps[-1]) == (0.5, 1e-9)
    assert all(later < earlier for earlier, later in pairwise(steps))


@pytest.mark.casadi
def test_schedule_solves():
    result = rcp.solve(corners(TWO), strategies=rcp.Strategy(schedule=Superlinear(), polish=False), backend="casadi")
    result.raise_for_status()
    # After the schedule the nearest branch is solved, which has no delta.
    relaxed = [step.delta for step in result.steps if step.delta is not None]
    assert len(relaxed) > 1
    assert relaxed == list(Superlinear().steps())[: len(relaxed)]


def test_a_schedule_says_by_its_methods_whether_it_follows_the_barrier_parameter():
    assert isinstance(PowerOfBarrier(), BarrierSchedule)
    assert isinstance(PowerOfBarrier(), Schedule)
    assert isinstance(rcp.relaxations.FollowBarrier(), BarrierSchedule)
    assert not isinstance(Superlinear(), BarrierSchedule)


@pytest.mark.parametrize(
    "backend", [pytest.param(name, marks=getattr(pytest.mark, name)) for name in ("casadi", "executable")]
)
def test_a_schedule_that_follows_the_barrier_parameter_solves(backend):
    schedule = PowerOfBarrier(last=1e-9)
    result = rcp.solve(corners(TWO), strategies=rcp.Strategy(schedule=schedule, polish=False), backend=backend)
    result.raise_for_status()
    assert result.objective == pytest.approx(2.0, abs=1e-4)
    assert result.steps[-1].delta == pytest.approx(1e-9)
    if backend == "casadi":  # delta moves inside one run, and lags mu by one iteration
        path = result.steps[0].path
        mus, deltas = [mu for mu, _ in path[:-1]], [delta for _, delta in path[1:]]
    else:  # from outside there is one run for each mu; the last one says no mu
        mus, deltas = zip(*((step.mu, step.delta) for step in result.steps if step.mu is not None), strict=True)
    assert len(mus) > 3
    assert list(deltas) == pytest.approx([schedule.delta_for(mu) for mu in mus])


# -------------------------------------------------------------------- grouping


def test_grouping_keeps_every_pair_once():
    assert isinstance(PerComponent(), Grouping)
    m = corners(TWO)
    m.single = rcp.Complementarity(expr=rcp.complements(m.a[1] >= 0, m.b[2] >= 0))
    relax = pyo.TransformationFactory("pyrobocop.relax_complementarity")
    relax.apply_to(m, grouping=PerComponent(), delta=0.1)
    rows = shifted_rows_of(m)
    sources = [source.name for row in rows for source in sources_of(row)]
    assert len(rows) == 2
    assert sorted(sources) == ["pair[1]", "pair[2]", "single"]


@pytest.mark.casadi
def test_grouping_solves():
    result = rcp.solve(corners(TWO), strategies=rcp.Strategy(grouping=PerComponent()), backend="casadi")
    result.raise_for_status()
    assert result.objective == pytest.approx(2.0, abs=1e-5)


# -------------------------------------------------------------------- engine


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL on Windows")
def test_engine_gives_the_reports_of_the_serial_one_also_after_deaths():
    expected, _ = undisturbed(6)
    with CommandEngine([[sys.executable, "-m", "tests.extension_templates.engine"]] * 2, deaths_allowed=1) as engine:
        engine.start(SPECS)
        assert play(engine, 3) == expected[:3]
        engine._workers[1].kill()
        assert play(engine, 6, first=3) == expected[3:]
        assert engine.deaths == {"a": 1}
        report = engine.solve({"c": TinyOrder(np.ones(5), "die")})["c"]
        assert "its worker died 2 times; " in report.reason
        assert report.reason.endswith("ended with exit code -9")
