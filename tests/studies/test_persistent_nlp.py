"""A model that is kept prepared solves as one that is built from scratch, only sooner."""

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.expression_zoo import cart_pole, parameters_everywhere
from harness.small_problems import corner
from hypothesis import given, settings
from hypothesis import strategies as st

from pyrobocop_pyomo.errors import ComplementarityError, ModelError
from pyrobocop_pyomo.programs.wrapped_programs import QuadraticCost
from pyrobocop_pyomo.relaxations import FollowBarrier
from pyrobocop_pyomo.studies import PersistentNLP

pytestmark = pytest.mark.casadi


def at_start(model: pyo.ConcreteModel, q: float, omega: float) -> pyo.ConcreteModel:
    model.swing.q[0].fix(q)
    model.swing.omega[0].fix(omega)
    return model


def test_a_changed_initial_state_solves_as_a_model_built_anew():
    kept = PersistentNLP(cart_pole(10))
    assert kept.solve().status.solved
    for q, omega in ((0.1, 0.0), (0.2, -0.1), (0.0, 0.05)):
        at_start(kept.model, q, omega)
        kept.model.length = 0.5 + q / 10
        warm = kept.solve()
        fresh_model = at_start(cart_pole(10), q, omega)
        fresh_model.length = 0.5 + q / 10
        for old, new in zip(
            kept.model.component_data_objects(pyo.Var), fresh_model.component_data_objects(pyo.Var), strict=True
        ):
            if not new.fixed:
                new.set_value(old.value)  # both in the same valley
        fresh = PersistentNLP(fresh_model).solve()
        assert warm.status.solved
        assert fresh.status.solved
        assert warm.objective == pytest.approx(fresh.objective, rel=1e-7)
        assert warm.g_multipliers == pytest.approx(fresh.g_multipliers, rel=1e-4, abs=1e-4)
        assert pyo.value(kept.model.cost) == pytest.approx(warm.objective)
    assert kept.preparations == 1


def test_a_change_of_structure_prepares_the_model_again():
    kept = PersistentNLP(parameters_everywhere())
    kept.solve()
    kept.model.p[1] = 2.5
    kept.solve()
    assert kept.preparations == 1
    kept.model.x[3].fix(0.25)
    assert kept.solve().status.solved
    assert kept.preparations == 2
    assert kept.model.x[3].value == 0.25
    kept.model.extra = pyo.Constraint([1, 2], rule=lambda m, i: m.x[i] <= 1)
    kept.model.extra[1].deactivate()
    kept.solve()
    assert kept.preparations == 3
    kept.model.extra[1].activate()  # this is what nobody notices
    kept.prepare()
    assert kept.preparations == 4
    assert kept.solve().g.size == kept.outcome.g_multipliers.size


def test_options_and_time_limits_reach_ipopt():
    kept = PersistentNLP(cart_pole(10), {"max_iter": 2})
    assert kept.solve().iterations == 2
    assert kept.solve({"max_iter": 1}).iterations == 1
    assert kept.solve({"max_iter": 300}, warm=False, time_limit=60.0).status.solved


def test_declared_suffixes_are_filled():
    model = parameters_everywhere()
    model.dual = pyo.Suffix(direction=pyo.Suffix.IMPORT)
    PersistentNLP(model).solve()
    assert model.linear in model.dual


def two_sides() -> pyo.ConcreteModel:
    """A pair on a curve, relaxed: the solution of each barrier problem depends on mu."""
    m = corner((1, 2))
    m.cost.set_value(m.cost.expr + m.x**4)
    pyo.TransformationFactory("pyrobocop.relax_complementarity").apply_to(m, delta=1.0)
    return m


def test_a_solve_goes_on_after_an_iteration_limit():
    whole = PersistentNLP(cart_pole(10))
    iterations = whole.solve().iterations
    parts = PersistentNLP(cart_pole(10), go_on_after_limit=True)
    counts = [parts.solve({"max_iter": 3}).iterations]
    while not parts.outcome.status.solved:
        mu = parts.outcome.mu
        counts.append(parts.solve({"max_iter": 3}, mu=mu).iterations)
        assert len(counts) < iterations
    # Another barrier path, but not from the start each time: that would never end.
    assert sum(counts) <= 3 * iterations
    assert parts.outcome.objective == pytest.approx(whole.outcome.objective, rel=1e-7)


def test_a_state_carries_a_solve_to_a_twin():
    first = PersistentNLP(cart_pole(10), go_on_after_limit=True)
    assert first.state is None
    first.solve({"max_iter": 4})
    twin = PersistentNLP(cart_pole(10), go_on_after_limit=True)
    twin.restore(first.state)
    here, there = first.solve({"max_iter": 3}), twin.solve({"max_iter": 3})
    assert np.array_equal(here.x, there.x)
    assert np.array_equal(here.g_multipliers, there.g_multipliers)
    assert np.array_equal(here.lower_multipliers, there.lower_multipliers)
    assert twin.preparations == 1


def test_a_state_of_another_model_is_refused():
    first, other = PersistentNLP(cart_pole(10)), PersistentNLP(cart_pole(8))
    first.solve()
    with pytest.raises(ValueError, match="built in the same way"):
        other.restore(first.state)


@pytest.mark.parametrize("mu", [1e-1, 1e-2, 1e-3])
def test_a_barrier_problem_is_solved_at_a_fixed_mu_with_its_delta(mu: float):
    kept = PersistentNLP(two_sides(), {"bound_relax_factor": 0.0}, barrier=FollowBarrier(factor=2.0))
    outcome = kept.solve({"tol": 1e-10}, mu_target=mu)
    assert outcome.status.solved
    assert {record.mu for record in outcome.records} == {mu}
    x, y = kept.model.x.value, kept.model.y.value
    # The optimality conditions of: minimise f - mu log x - mu log y - mu log(2 mu - x y).
    slack = 2 * mu - x * y
    assert slack > 0
    assert 2 * (x - 1) + 4 * x**3 - mu / x + mu * y / slack == pytest.approx(0, abs=1e-6)
    assert 2 * (y - 2) - mu / y + mu * x / slack == pytest.approx(0, abs=1e-6)


def test_delta_follows_no_barrier_without_rows_that_it_shifts():
    with pytest.raises(ComplementarityError, match="relax_complementarity"):
        PersistentNLP(cart_pole(10), barrier=FollowBarrier())


@given(seed=st.integers(0, 2**31), dense=st.booleans())
@settings(max_examples=10)
def test_an_added_quadratic_cost_is_what_the_model_could_state(seed: int, dense: bool):
    random = np.random.default_rng(seed)
    model = parameters_everywhere()
    variables = list(model.x.values())
    n = len(variables)
    linear, diagonal = random.normal(size=n), random.uniform(0.5, 2.0, n)
    root = random.normal(size=(n, n)) / 3
    several = n - 1 if dense else 0
    matrix = np.zeros((n, n))
    matrix[:several, :several] = (root @ root.T)[:several, :several]
    cost = QuadraticCost(variables, dense=several)
    kept = PersistentNLP(model, quadratic=cost)
    cost.linear[:], cost.diagonal[:] = linear, diagonal
    cost.dense[:] = matrix[:several, :several]
    numeric = kept.solve({"tol": 1e-10})
    stated = parameters_everywhere()
    whole = matrix + np.diag(diagonal)
    x = list(stated.x.values())
    stated.cost.set_value(
        stated.cost.expr
        + sum(linear[i] * x[i] for i in range(n))
        + sum(whole[i, j] * x[i] * x[j] for i in range(n) for j in range(n)) / 2
    )
    symbolic = PersistentNLP(stated).solve({"tol": 1e-10})
    assert numeric.status.solved
    assert symbolic.status.solved
    assert numeric.objective == pytest.approx(symbolic.objective, rel=1e-7, abs=1e-7)
    assert [v.value for v in variables] == pytest.approx([v.value for v in x], abs=1e-5)


def test_a_variable_that_only_the_added_cost_would_use_is_refused():
    model = cart_pole(10)
    model.lonely = pyo.Var(initialize=0.0)
    with pytest.raises(ModelError, match="lonely"):
        PersistentNLP(model, quadratic=QuadraticCost([model.lonely]))


def test_a_state_goes_on_elsewhere_also_after_a_solve_that_failed():
    here, elsewhere = PersistentNLP(cart_pole(10)), PersistentNLP(cart_pole(10))
    assert here.solve().status.solved
    good = here.compiled.current_point()
    at_start(here.model, 1e3, 0.0)
    assert not here.solve({"max_iter": 3000}).status.solved
    assert abs(here.compiled.current_point() - good).max() > 1.0
    elsewhere.restore(here.state)
    assert elsewhere.compiled.current_point().tolist() == good.tolist()
    at_start(here.model, 0.1, 0.0)
    at_start(elsewhere.model, 0.1, 0.0)
    one, other = here.solve(), elsewhere.solve()
    assert one.status.solved
    assert one.x.tolist() == other.x.tolist()
    assert one.iterations == other.iterations
