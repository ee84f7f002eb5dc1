"""What users of Pyomo do with any model works with phases: slices, labels, sizes, suffixes, scaling."""

import math
import pickle
from pathlib import Path
from typing import Any

import pyomo.environ as pyo
import pytest
from harness.phases import contents, exact_x, one_phase, oscillate, rows, solve
from pyomo.core.expr.visitor import identify_variables

import pyrobocop_pyomo as rcp

ELEMENTS, STAGES = 3, 2
POINTS = ELEMENTS * STAGES


def leg(b: Any, *index: Any) -> None:
    """One of each: state, algebraic, held and linear control, parameter, pair."""
    b.x = rcp.State(initial=0, final=1, bounds=(-5, 5))
    b.v = rcp.State(initial=0)
    b.z = rcp.Algebraic(bounds=(0, None))
    b.u = rcp.Control(bounds=(-20, 20), parametrization="piecewise_constant")
    b.w = rcp.Control(bounds=(-20, 20), parametrization="piecewise_linear")
    b.k = rcp.Parameter(bounds=(1, 2), initial_guess=1)
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] + b.w[t] - b.k * b.z[t]})
    b.complementarity(lambda b, t: rcp.complements(b.z[t] >= 0, 2 - b.x[t] >= 0), name="stop")


def effort(b: Any, t: float) -> Any:
    return b.u[t] ** 2 + b.w[t] ** 2


def robot() -> pyo.ConcreteModel:
    m = pyo.ConcreteModel("robot")
    m.phase = rcp.PhaseBlock(rule=leg, elements=ELEMENTS, stages=STAGES)
    m.legs = rcp.PhaseBlock(["a", "b"], rule=leg, elements=ELEMENTS, stages=STAGES)
    m.cost = pyo.Objective(expr=sum(phase.integral(effort) for phase in (m.phase, *m.legs.values())))
    return m


def relaxed() -> pyo.ConcreteModel:
    m = robot()
    pyo.TransformationFactory("pyrobocop.relax_complementarity").apply_to(m)
    return m


SCALE = pyo.TransformationFactory("core.scale_model")


def scaled_by(m: pyo.ConcreteModel, factors: list[tuple[Any, float]], **options: Any) -> pyo.ConcreteModel:
    m.scaling_factor = pyo.Suffix(direction=pyo.Suffix.EXPORT)
    m.scaling_factor.update(factors)
    return SCALE.create_using(m, **options)


def test_slices_reach_through_phases() -> None:
    m = robot()
    assert len(list(m.phase.x[:])) == POINTS + 1
    assert len(list(m.legs[:].x[:])) == 2 * (POINTS + 1)
    assert len(list(m.legs[:].u[:])) == len(list(m.legs[:].w[:])) == 2 * POINTS
    assert len({id(v) for v in m.legs[:].u[:]}) == 2 * ELEMENTS
    assert str(pyo.ComponentUID(m.phase.x[:])) == "phase.x[*]"
    assert len(pyo.Reference(m.legs[:].z[:])) == 2 * POINTS
    m.legs[:].x[:].setub(3)
    assert all(v.ub == 3 for phase in m.legs.values() for v in phase.x.values())


def test_symbolic_labels_are_readable(tmp_path: Path) -> None:
    relaxed().write(str(tmp_path / "robot.nl"), io_options={"symbolic_solver_labels": True})
    rows, columns = ((tmp_path / f"robot.{end}").read_text().splitlines() for end in ("row", "col"))
    assert {"phase.x_collocation[1.0]", "legs[a].v_collocation[1.0]", "cost"} <= set(rows)
    assert {"phase.v[1.0]", "legs[b].z[1.0]", "phase.u_per_element[0]", "phase.w_at_knots[1]"} <= set(columns)


@pytest.mark.casadi
@pytest.mark.parametrize("rename", [True, False])
def test_a_scaled_model_can_be_given_to_solve_and_its_values_back_to_the_model(rename: bool) -> None:
    m = relaxed()
    scaled = scaled_by(m, [(m.phase.x, 0.1)], rename=rename)
    result = rcp.solve(scaled)
    result.raise_for_status()
    assert "COARSE MESH" not in result.report()  # its rules are stated in other units than its values
    with pytest.raises(rcp.errors.TrajectoryError, match="propagate_solution"):
        scaled.phase.trajectory()
    SCALE.propagate_solution(scaled, m)
    assert m.phase.trajectory().x[-1] == pytest.approx(1.0)


@pytest.mark.casadi
def test_pairs_that_a_scaling_has_passed_over_are_refused() -> None:
    m = robot()
    scaled = scaled_by(m, [(m.phase.x, 0.1)], rename=False)
    assert "'phase.stop' holds" in str(rcp.diagnose(scaled))
    with pytest.raises(rcp.errors.ModelError, match="'phase.stop' holds .*multiplied by 0.1"):
        rcp.solve(scaled)
    m.scaling_factor.clear()
    assert rcp.solve(SCALE.create_using(m)).solved


@pytest.mark.casadi
def test_a_deactivated_phase_is_neither_solved_nor_counted() -> None:
    m = robot()
    m.legs.deactivate()
    m.cost.set_value(m.phase.integral(effort))
    before = [v.value for phase in m.legs.values() for v in phase.x.values()]
    phase, whole = (counts.split(" ") for counts in rcp.diagnose(m).counts)
    assert (phase[0], whole[0]) == ("phase:", "robot:")
    assert phase[1:3] == whole[1:3]
    assert f"{POINTS} pairs:" in " ".join(whole)
    rcp.solve(m).raise_for_status()
    assert [v.value for phase in m.legs.values() for v in phase.x.values()] == before


# --------------------------------------------------------------------
# A phase wherever Pyomo lets a block live: indexed, nested, cloned, pickled, deactivated, abstract.


def state_oscillators(b: Any, *index: Any) -> None:
    b.x = rcp.State(initial=1, initial_guess=ramp, bounds=(-100, 100))
    b.y = rcp.State(initial=1, initial_guess=1)
    b.push = rcp.Control(parametrization="piecewise_constant")
    b.push_per_element.fix(0)
    b.ode(pushed)


def ramp(t: float) -> float:
    return 1 + t


def pushed(b: Any, t: float) -> Any:
    rates = oscillate(b, t)
    return {b.x: rates[b.x] + b.push[t], b.y: rates[b.y]}


def end(b: Any) -> float:
    return b.x[b.final_time].value


def solved(m: pyo.ConcreteModel) -> pyo.ConcreteModel:
    m.nothing = pyo.Objective(expr=0)
    solve(m)
    return m


@pytest.mark.casadi
def test_one_rule_builds_scalar_indexed_and_nested_phases() -> None:
    def nested(b, i):
        b.phase = rcp.PhaseBlock(rule=state_oscillators)

    m = pyo.ConcreteModel()
    m.I = pyo.Set(initialize=["left", 2])
    m.scalar = rcp.PhaseBlock(rule=state_oscillators)
    m.many = rcp.PhaseBlock(m.I, rule=state_oscillators)
    m.grid = rcp.PhaseBlock(m.I, [1, 2], rule=state_oscillators)
    m.house = pyo.Block()
    m.house.phase = rcp.PhaseBlock(rule=state_oscillators)
    m.arms = pyo.Block(m.I, rule=nested)
    phases = [m.scalar, *m.many.values(), *m.grid.values(), m.house.phase, *(arm.phase for arm in m.arms.values())]
    assert len(phases) == 1 + 2 + 4 + 1 + 2
    solved(m)
    for phase in phases:
        phase.check()
        assert phase.ctype is pyo.Block
        assert end(phase) == pytest.approx(exact_x(1.0), abs=1e-6)
        assert phase.trajectory().name == phase.name
    assert m.arms[2].phase.name == "arms[2].phase"


@pytest.mark.casadi
def test_a_clone_lives_its_own_life() -> None:
    m, _ = one_phase(rule=state_oscillators, duration=rcp.Duration(bounds=(1, 2)))
    m.p.duration.fix(1)
    before = {id(v): v.value for v in m.component_data_objects(pyo.Var)}
    clone = m.clone()
    assert contents(clone) == contents(m)
    solved(clone)
    assert end(clone.p) == pytest.approx(exact_x(1.0), abs=1e-6)
    assert {id(v): v.value for v in m.component_data_objects(pyo.Var)} == before
    first = clone.p.points.first()
    assert all(v.model() is clone for row in rows(clone) for v in identify_variables(row.body))
    assert all(v.model() is clone for v in identify_variables(clone.p.derivative(clone.p.x)[first]))
    assert clone.p.push[first] is clone.p.push_per_element[0]
    assert clone.p.trajectory().verify().defect < 1e-10
    assert clone.p.trajectory().phase is clone.p
    assert m.p.trajectory().verify().defect > 0.1
    clone.p.late = rcp.State(initial=0)
    assert "late" not in m.p.record.declarations
    assert m.p.component("late") is None


def state_by_lambdas(b: Any) -> None:
    b.x = rcp.State(initial=1, initial_guess=lambda t: 1 + t)
    b.y = rcp.State(initial=1, initial_guess=1)
    b.ode(lambda b, t: oscillate(b, t))


@pytest.mark.casadi
@pytest.mark.parametrize("rule", [state_oscillators, state_by_lambdas])
def test_a_pickle_comes_back_whole(rule: Any) -> None:
    m, _ = one_phase(rule=rule)
    back = pickle.loads(pickle.dumps(m))
    assert contents(back) == contents(m)
    solved(back)
    assert end(back.p) == pytest.approx(exact_x(1.0), abs=1e-6)
    assert end(m.p) == 2.0
    verdict = back.p.trajectory().verify()
    assert verdict.largest_violation < 1e-10
    assert verdict.horizon_error is not None
    if rule is state_oscillators:
        assert back.p.push[back.p.points.first()] is back.p.push_per_element[0]
    assert end(solved(m).p) == pytest.approx(exact_x(1.0), abs=1e-6)


@pytest.mark.parametrize("bounds", [lambda t: (-t, 5), lambda t: (-math.floor(2 * t) / 2, 5)])
def test_a_pickle_has_what_a_function_for_bounds_has_said(bounds: Any) -> None:
    m, _ = one_phase(elements=2, x=rcp.State(initial=1, bounds=bounds))
    m.p.ode(still)
    back = pickle.loads(pickle.dumps(m))
    for phase in (m.p, back.p):
        phase.x[1.0].set_value(-2.0, skip_validation=True)
    assert back.p.trajectory().verify().equations == m.p.trajectory().verify().equations == 1.0


def still(b: Any, t: float) -> Any:
    return {b.x: 0.0}
