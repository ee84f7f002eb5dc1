"""What users of Pyomo do with any model works with phases: slices, labels, reports, suffixes, scaling, explanations."""

import io
import logging
import math
import pickle
from pathlib import Path
from typing import Any

import pyomo.environ as pyo
import pytest
from harness.checked import timing_report
from harness.phases import contents, exact_x, integrator, one_phase, oscillate, rows, solve
from pyomo.contrib.iis.mis import compute_infeasibility_explanation
from pyomo.contrib.solver.common.factory import SolverFactory as NewSolverFactory
from pyomo.core.expr.visitor import identify_variables
from pyomo.util.infeasible import log_infeasible_bounds, log_infeasible_constraints
from pyomo.util.model_size import build_model_size_report

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


def test_timing_names_our_components_and_our_transformation() -> None:
    text = timing_report(relaxed)
    for line in (
        f"construct Var phase.x; {POINTS + 1} indices",
        f"construct Constraint legs[b].x_collocation; {POINTS} indices",
        f"construct Complementarity phase.stop; {POINTS} indices",
        "construct Block phase; 1 index",
        "construct Block legs; 2 indices",
        "apply Transformation RelaxComplementarity (in-place)",
    ):
        assert line in text


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


@pytest.mark.parametrize("suffix", ["nl", "gms", "bar"])
def test_symbolic_labels_are_readable(suffix: str, tmp_path: Path) -> None:
    m = relaxed()
    m.write(str(tmp_path / f"robot.{suffix}"), io_options={"symbolic_solver_labels": True})
    if suffix == "nl":
        rows, columns = ((tmp_path / f"robot.{end}").read_text().splitlines() for end in ("row", "col"))
        assert {"phase.x_collocation[1.0]", "legs[a].v_collocation[1.0]", "cost"} <= set(rows)
        assert {"phase.v[1.0]", "legs[b].z[1.0]", "phase.u_per_element[0]", "phase.w_at_knots[1]"} <= set(columns)
    elif suffix == "gms":
        text = (tmp_path / "robot.gms").read_text()
        assert "phase_x_collocation_1_0_" in text
        assert "legs_b__z_1_0_" in text
    else:
        assert "legs_b__z_1_0_" in (tmp_path / "robot.bar").read_text()


@pytest.mark.casadi
@pytest.mark.parametrize("factory", [pyo.SolverFactory, NewSolverFactory], ids=["legacy", "new"])
@pytest.mark.parametrize(
    "solver", ["pyrobocop.ipopt", pytest.param("ipopt", marks=pytest.mark.executable)]
)  # fmt: skip
def test_both_interfaces_solve_with_symbolic_labels(factory: Any, solver: str) -> None:
    m = relaxed()
    factory(solver).solve(m, symbolic_solver_labels=True)
    assert pyo.value(m.phase.x[1.0]) == 1
    assert m.phase.trajectory().verify().equations < 1e-6
    assert m.phase.trajectory().verify().defect < 1e-6


def test_model_size_counts_every_variable_once() -> None:
    per_phase = 2 * (POINTS + 1) + POINTS + ELEMENTS + (ELEMENTS + 1) + 1
    report = build_model_size_report(robot())
    assert report.activated.constraints == 3 * 2 * POINTS
    assert report.overall.variables == 3 * per_phase
    # Fixed ends are no variables there; one seen at many points is one.
    assert report.activated.continuous_variables == 3 * (per_phase - 3)


def test_infeasible_rows_and_bounds_are_logged_by_name() -> None:
    text = io.StringIO()
    logger = logging.Logger("infeasible", level=logging.DEBUG)
    logger.addHandler(logging.StreamHandler(text))
    m = robot()
    m.phase.z[1.0].set_value(-1)
    log_infeasible_constraints(m, logger=logger, log_expression=True, log_variables=True)
    log_infeasible_bounds(m, logger=logger)
    assert "CONSTR phase.x_collocation[1.0]" in text.getvalue()
    assert "VAR phase.x[1.0]: 1.0" in text.getvalue()
    assert "VAR phase.z[1.0]: -1" in text.getvalue()


def test_pprint_and_display_show_everything() -> None:
    m = robot()
    for part in (m, m.phase, m.legs, m.legs["a"]):
        printed, displayed = io.StringIO(), io.StringIO()
        part.pprint(ostream=printed)
        part.display(ostream=displayed)
        for text in (printed.getvalue(), displayed.getvalue()):
            assert "x_collocation" in text
            assert "u_per_element" in text
        assert "stop" in printed.getvalue()


@pytest.mark.executable
def test_suffixes_on_a_phase_and_on_the_model_reach_its_rows() -> None:
    m = relaxed()
    m.dual = pyo.Suffix(direction=pyo.Suffix.IMPORT)
    m.phase.ipopt_zL_out = pyo.Suffix(direction=pyo.Suffix.IMPORT)
    pyo.SolverFactory("ipopt").solve(m)
    rows = list(m.phase.x_collocation.values())
    assert all(row in m.dual for row in rows)
    assert max(abs(m.dual[row]) for row in rows) > 0.1


@pytest.mark.casadi
@pytest.mark.parametrize("rename", [True, False])
def test_a_scaled_model_has_the_same_solution(rename: bool) -> None:
    expected, m = relaxed(), relaxed()
    solver = pyo.SolverFactory("pyrobocop.ipopt")
    solver.solve(expected, options={"tol": 1e-10})
    b, z = m.phase, m.legs["a"].z
    factors = [(b.x, 0.1), (b.u_per_element, 0.01), (b.x_collocation, 10), (z, 5), (m.cost, 0.01)]
    scaled = scaled_by(m, factors, rename=rename)
    solver.solve(scaled, options={"tol": 1e-10})
    SCALE.propagate_solution(scaled, m)
    assert pyo.value(m.cost) == pytest.approx(pyo.value(expected.cost), rel=1e-5)
    assert m.phase.trajectory().x == pytest.approx(expected.phase.trajectory().x, abs=1e-4)
    assert m.phase.trajectory().verify().defect < 1e-6


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
def test_a_scaled_and_renamed_phase_may_have_a_free_duration() -> None:
    duration = rcp.Duration(bounds=(0.1, 10), initial_guess=1)
    m, b = integrator(x={"initial": 0, "final": 1}, u={"bounds": (-1, 1)}, duration=duration, elements=4)
    m.time_taken = pyo.Objective(expr=b.duration)
    assert rcp.solve(scaled_by(m, [(b.x, 100)])).objective == pytest.approx(1.0)


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


@pytest.mark.casadi
def test_pyomo_explains_an_infeasible_phase_by_name() -> None:
    m, _ = integrator(x={"initial": 0, "final": 5}, u={"bounds": (0, 1)}, stages=1)
    m.nothing = pyo.Objective(expr=0)
    text = io.StringIO()
    logger = logging.Logger("explanation", level=logging.INFO)
    logger.addHandler(logging.StreamHandler(text))
    compute_infeasibility_explanation(m, solver=pyo.SolverFactory("pyrobocop.ipopt"), logger=logger)
    minimal = text.getvalue().partition("Constraints / bounds in MIS:")[2]
    assert "ub of var p.u[1.0]" in minimal
    assert "constraint: p.x_collocation[1.0]" in minimal


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


def test_a_rule_gets_its_index() -> None:
    def build(b, i, j):
        b.x = rcp.State(initial=10 * i + j)

    m = pyo.ConcreteModel()
    m.p = rcp.PhaseBlock([1, 2], [3, 4], rule=build)
    assert [b.x[0].value for b in m.p.values()] == [13, 14, 23, 24]


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
