"""Every way to Ipopt gives the same answer, in value and in sign."""

import pyomo.environ as pyo
import pytest
from harness.small_problems import PROBLEMS, every_backend, every_derivative, every_kind_of_row, solver

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.programs.compiled_model import CompiledModel

SUFFIXES = ("dual", "ipopt_zL_out", "ipopt_zU_out")


@every_backend
@pytest.mark.parametrize("build", PROBLEMS, ids=lambda build: build.__name__)
def test_the_known_optimum_is_found(build, backend):
    model, optimum = build()
    result = solver(backend).solve(model)
    assert result.solver.termination_condition == pyo.TerminationCondition.optimal
    objectives = list(model.component_data_objects(pyo.Objective, active=True))
    reached = pyo.value(objectives[0]) if objectives else 0.0
    assert reached == pytest.approx(optimum, rel=1e-6, abs=1e-6)
    for row in model.component_data_objects(pyo.Constraint, active=True):
        assert row.slack() > -1e-6, row.name


@pytest.mark.executable
@every_derivative
@pytest.mark.parametrize("sense", [pyo.minimize, pyo.maximize], ids=str)
def test_multipliers_are_those_of_the_executable(sense, derivatives):
    executable, in_process = every_kind_of_row(sense), every_kind_of_row(sense)
    solver("ipopt").solve(executable)
    solver(derivatives).solve(in_process)
    for suffix in SUFFIXES:
        expected = {key.name: value for key, value in executable.component(suffix).items()}
        found = {key.name: value for key, value in in_process.component(suffix).items()}
        assert any(abs(value) > 0.1 for value in expected.values()), f"{suffix}: nothing is compared"
        for name in expected.keys() | found.keys():  # a .sol file leaves zeros out
            assert found.get(name, 0.0) == pytest.approx(expected.get(name, 0.0), rel=1e-5, abs=1e-6), (
                suffix,
                name,
            )


@pytest.mark.executable
@pytest.mark.asl
@pytest.mark.parametrize("sense", [pyo.minimize, pyo.maximize], ids=str)
def test_reduced_costs_are_those_of_ipopt_v2(sense):
    executable, in_process = every_kind_of_row(sense), every_kind_of_row(sense)
    solver("ipopt_v2").solve(executable)
    solver("asl").solve(in_process)
    for index, variable in in_process.x.items():
        expected = executable.rc.get(executable.x[index], 0.0)
        assert in_process.rc[variable] == pytest.approx(expected, rel=1e-5, abs=1e-6)


@every_backend
def test_a_dual_is_the_price_of_the_right_hand_side(backend):
    """The sign by its meaning: d(objective) / d(right-hand side), minimising and maximising."""
    for sense, direction in ((pyo.minimize, 1), (pyo.maximize, -1)):
        model = pyo.ConcreteModel()
        model.x = pyo.Var(initialize=0.5)
        model.cost = pyo.Objective(expr=direction * model.x**2, sense=sense)
        model.row = pyo.Constraint(expr=model.x >= 3)
        model.dual = pyo.Suffix(direction=pyo.Suffix.IMPORT)
        solver(backend).solve(model)
        assert model.dual[model.row] == pytest.approx(direction * 6, rel=1e-5)


@every_backend
def test_a_warm_start_with_multipliers_saves_iterations(backend):
    model, _ = PROBLEMS[0]()
    model.dual = pyo.Suffix(direction=pyo.Suffix.IMPORT_EXPORT)
    for name in ("ipopt_zL_out", "ipopt_zU_out"):
        model.add_component(name, pyo.Suffix(direction=pyo.Suffix.IMPORT))
    for name in ("ipopt_zL_in", "ipopt_zU_in"):
        model.add_component(name, pyo.Suffix(direction=pyo.Suffix.EXPORT))
    solver(backend).solve(model)
    model.ipopt_zL_in.update(model.ipopt_zL_out)
    model.ipopt_zU_in.update(model.ipopt_zU_out)
    warm = {
        "warm_start_init_point": "yes", "warm_start_bound_push": 1e-9, "warm_start_bound_frac": 1e-9,
        "warm_start_slack_bound_frac": 1e-9, "warm_start_slack_bound_push": 1e-9,
        "warm_start_mult_bound_push": 1e-9, "mu_init": 1e-9, "max_iter": 3,
    }  # fmt: skip
    if backend == "ipopt":  # the older interface knows these only through an option file
        warm = {name if name in ("max_iter", "mu_init") else f"OF_{name}": value for name, value in warm.items()}
    result = solver(backend).solve(model, options=warm)
    assert result.solver.termination_condition == pyo.TerminationCondition.optimal


@every_derivative
def test_the_first_iteration_is_at_the_first_point(derivatives):
    model, _ = PROBLEMS[0]()
    first = pyo.value(model.cost)
    records = []
    new = pyo.SolverFactory("pyrobocop.ipopt")
    new.config.derivatives = derivatives
    new.config.on_iteration = records.append
    new.solve(model, options={"bound_push": 1e-12, "bound_frac": 1e-12, "nlp_scaling_method": "none"})
    assert records[0].iteration == 0
    assert records[0].objective == pytest.approx(first, rel=1e-6)


@every_derivative
def test_a_model_without_free_variables_is_refused(derivatives):
    model, _ = PROBLEMS[0]()
    model.x.fix()
    model.product.deactivate()
    model.sphere.deactivate()
    with pytest.raises(ModelError, match="no free variable"):
        solver(derivatives).solve(model)


@every_derivative
def test_export_suffixes_of_other_solvers_do_no_harm(derivatives):
    model, optimum = PROBLEMS[0]()
    model.priority = pyo.Suffix(direction=pyo.Suffix.EXPORT)
    model.priority[model.x[1]] = 3
    model.priority[model.product] = 1.5
    solver(derivatives).solve(model)
    assert pyo.value(model.cost) == pytest.approx(optimum, rel=1e-6)


@every_backend
def test_scaling_factors_are_used_when_asked_for(backend):
    """Without the factors a cost of 1e-9 is flat to Ipopt: it stops where it starts."""
    model = pyo.ConcreteModel()
    model.x = pyo.Var([1, 2], initialize=0.0)
    model.cost = pyo.Objective(expr=1e-9 * (model.x[1] - 3) ** 2 + 1e-9 * (model.x[2] - 5) ** 2)
    model.row = pyo.Constraint(expr=model.x[1] - model.x[2] ** 2 <= 100)
    model.scaling_factor = pyo.Suffix(direction=pyo.Suffix.EXPORT)
    model.scaling_factor[model.cost] = 1e9
    model.scaling_factor[model.x] = 0.5
    model.scaling_factor[model.row] = 0.1
    option = "OF_nlp_scaling_method" if backend == "ipopt" else "nlp_scaling_method"
    solver(backend).solve(model)
    assert abs(model.x[1].value - 3) > 0.1
    solver(backend).solve(model, options={option: "user-scaling"})
    assert (model.x[1].value, model.x[2].value) == pytest.approx((3, 5), abs=1e-4)


@pytest.mark.casadi
def test_casadi_is_preferred_to_asl():
    assert CompiledModel(PROBLEMS[0]()[0]).nlp.derivatives == "CasADi on vectorised expressions"
