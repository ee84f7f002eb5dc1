"""A large problem is solved on a coarse mesh first: a program in some of the variables and rows of the fine one."""

from __future__ import annotations

import itertools
from itertools import pairwise
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from scipy import sparse

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.programs.aggregated_program import AggregatedProgram
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.solving import coarse_mesh, strategy_runs
from pyrobocop_pyomo.solving.coarse_mesh import coarsen

pytestmark = pytest.mark.casadi


def pushed(
    elements: int | None, *, cost_of_state: float = 1.0, free: bool = False, **arguments: Any
) -> pyo.ConcreteModel:
    """A mass that is pushed towards a wall, which pushes back."""
    m = pyo.ConcreteModel(name="pushed")
    duration = rcp.Duration(bounds=(1, 3), initial_guess=2) if free else 2.0
    m.phase = b = rcp.PhaseBlock(duration=duration, elements=elements, **{"scheme": "implicit_euler", **arguments})
    b.x, b.v = rcp.State(initial=1.0, initial_guess=0), rcp.State(initial=-1.0, initial_guess=0)
    b.push = rcp.Control(bounds=(-2, 2))
    b.contact = rcp.Algebraic(bounds=(0, None))

    @b.ode
    def mass(b, t):
        return {b.x: b.v[t], b.v: b.push[t] + b.contact[t] - 0.1 * pyo.sin(b.v[t])}

    @b.complementarity
    def wall(b, t):
        return rcp.complements(b.x[t] + 0.05 * b.v[t] >= 0, b.contact[t] >= 0)

    running = b.integral(lambda b, t: b.push[t] ** 2 + cost_of_state * (b.x[t] - 0.2) ** 2)
    m.cost = pyo.Objective(expr=running + (b.duration if free else 0.0))
    return m


def coarse_program(model: pyo.ConcreteModel, elements: int) -> tuple[CompiledModel, AggregatedProgram]:
    token = pyo.TransformationFactory("pyrobocop.relax_complementarity").apply_to(model, delta=1e-2)
    compiled = CompiledModel(model, "casadi")
    program = coarsen(compiled, token.block, elements)
    assert program is not None
    return compiled, program


def dense(structure: Any, values: Any, shape: tuple[int, int]) -> Any:
    return sparse.coo_matrix((values, structure), shape=shape).toarray()


@pytest.mark.parametrize("free", [False, True])
def test_derivatives_are_those_of_the_composed_functions(free: bool) -> None:
    model = pushed(12, free=free)
    _, program = coarse_program(model, 4)
    generator = np.random.default_rng(3)
    z, multipliers = generator.normal(size=program.n), generator.normal(size=program.m)
    step = 1e-6

    def lagrangian_gradient(at: Any) -> Any:
        jacobian = dense(program.jacobian_structure, program.jacobian(at), (program.m, program.n))
        return 0.7 * program.gradient(at) + jacobian.T @ multipliers

    directions = np.eye(program.n)
    slopes = [(program.constraints(z + step * d) - program.constraints(z - step * d)) / (2 * step) for d in directions]
    jacobian = dense(program.jacobian_structure, program.jacobian(z), (program.m, program.n))
    np.testing.assert_allclose(jacobian, np.transpose(slopes), atol=1e-8)
    gains = [(program.objective(z + step * d) - program.objective(z - step * d)) / (2 * step) for d in directions]
    np.testing.assert_allclose(program.gradient(z), gains, atol=1e-8)
    bends = [(lagrangian_gradient(z + step * d) - lagrangian_gradient(z - step * d)) / (2 * step) for d in directions]
    lower = dense(program.hessian_structure, program.hessian(z, 0.7, multipliers), (program.n, program.n))
    assert (program.hessian_structure[0] >= program.hessian_structure[1]).all()
    np.testing.assert_allclose(lower + np.tril(lower, -1).T, bends, atol=1e-7)


@pytest.mark.parametrize("elements", [12, 13])
def test_the_coarse_program_is_that_of_the_model_with_fewer_elements(elements: int) -> None:
    """At any point the rows are the same numbers, per width of the element; so is the objective, of the controls."""
    fine, program = coarse_program(pushed(elements, cost_of_state=0.0), 4)
    boundaries = fine.model.phase.grid.mesh.boundaries
    wide = [*boundaries[: -1 : -(-elements // 4)], boundaries[-1]]
    native = pushed(None, cost_of_state=0.0, mesh=wide)
    pyo.TransformationFactory("pyrobocop.relax_complementarity").apply_to(native, delta=1e-2)
    coarse = CompiledModel(native, "casadi")
    assert (program.n, program.m) == (coarse.nlp.n, coarse.nlp.m)

    generator = np.random.default_rng(8)
    at = generator.normal(size=coarse.nlp.n)
    value_of = {place(variable): number for variable, number in zip(coarse.variables, at, strict=True)}
    z = np.array([value_of[place(fine.variables[column])] for column in program.kept])
    assert program.objective(z) == pytest.approx(coarse.nlp.objective(at), rel=1e-12)
    wanted = dict(zip(map(place, coarse.constraints), beyond_bounds(coarse.nlp, at), strict=True))
    width = {round(end, 9): end - start for start, end in pairwise(wide)}
    narrow = boundaries[1] - boundaries[0]
    generated = {name: itertools.count() for name in ("rows", "sides")}
    for number, value in zip(program.rows, beyond_bounds(program, z), strict=True):
        name, time = place(fine.constraints[number])
        factor = width[time] / narrow if name in ("x_collocation", "v_collocation") else 1.0
        same = wanted[name, next(generated[name]) if name in generated else time]
        assert factor * value == pytest.approx(same, abs=1e-12)


def beyond_bounds(nlp: Any, at: Any) -> Any:
    """Rows at a point, from the bound that they have: constants may be on either side."""
    return nlp.constraints(at) - np.where(np.isfinite(nlp.g_upper), nlp.g_upper, nlp.g_lower)


def place(component: Any) -> tuple[str, Any]:
    """Name and time of a variable or row; of a generated row its number."""
    index = component.index()
    return component.parent_component().local_name, round(index, 9) if isinstance(index, float) else index


def test_a_default_solve_goes_through_the_coarse_mesh_and_is_as_good(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = rcp.solve(pushed(120), progress=False)
    monkeypatch.setattr(coarse_mesh, "COARSENED_PAIRS", 100)
    monkeypatch.setattr(coarse_mesh, "COARSE_ELEMENTS", 30)
    led = rcp.solve(pushed(120), progress=False)
    assert [step.label for step in led.steps].count("coarse mesh") >= 2
    assert led.solved
    assert led.objective <= plain.objective + 1e-6 * abs(plain.objective)
    assert led.constraint_violation <= 1e-6
    assert led.largest_product <= 1e-7


def test_a_chosen_strategy_is_run_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(coarse_mesh, "COARSENED_PAIRS", 10)
    monkeypatch.setattr(coarse_mesh, "COARSE_ELEMENTS", 10)
    result = rcp.solve(pushed(40), strategies="barrier", progress=False)
    assert "coarse mesh" not in [step.label for step in result.steps]


@pytest.mark.parametrize(
    "arguments",
    [{"scheme": "radau", "stages": 2}, {"scheme": "legendre", "stages": 1}, {"scheme": "explicit_euler"}],
    ids=str,
)
def test_other_schemes_have_no_coarse_program(arguments: dict[str, Any]) -> None:
    model = pushed(12, **arguments)
    token = pyo.TransformationFactory("pyrobocop.relax_complementarity").apply_to(model, delta=1e-2)
    assert coarsen(CompiledModel(model, "casadi"), token.block, 4) is None


def test_a_coarse_mesh_that_leads_nowhere_costs_no_solution(monkeypatch: pytest.MonkeyPatch) -> None:
    """The way from the user's initial guess is gone all the same."""
    plain = rcp.solve(pushed(60), polish=False, progress=False)
    monkeypatch.setattr(coarse_mesh, "COARSENED_PAIRS", 10)
    monkeypatch.setattr(coarse_mesh, "COARSE_ELEMENTS", 15)
    monkeypatch.setattr(strategy_runs, "FROM_COARSE_MESH", {"max_iter": 1})
    led = rcp.solve(pushed(60), polish=False, progress=False)
    assert led.solved
    assert led.objective == pytest.approx(plain.objective, rel=1e-5)
