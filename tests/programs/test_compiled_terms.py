"""The compiled evaluation gives the numbers of CasADi, and Ipopt the same run without Python as with it."""

import re
from concurrent.futures import ThreadPoolExecutor

import casadi
import numpy as np
import pyomo.environ as pyo
import pytest

from pyrobocop_pyomo.ipopt.ipopt_run import run_ipopt
from pyrobocop_pyomo.native.shared_library import SWITCH_VARIABLE
from pyrobocop_pyomo.programs import summed_terms
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.model_terms import Terms
from pyrobocop_pyomo.programs.nonlinear_program import Scales
from pyrobocop_pyomo.programs.summed_terms import OPERATIONS, SOURCE, evaluation_library
from pyrobocop_pyomo.programs.term_groups import Columns, TermGroup
from pyrobocop_pyomo.programs.vectorised_program import EVALUATIONS, compiled_run_of
from pyrobocop_pyomo.programs.wrapped_programs import ScaledProgram, ShiftedRows

pytestmark = [
    pytest.mark.casadi,
    pytest.mark.skipif(evaluation_library() is None, reason="there is no C compiler"),
]

NUMBERS = np.array([-2.5, -1.0, -0.3, 0.0, 0.4, 1.0, 1.7, 30.0, np.nan])
A, B = (grid.ravel() for grid in np.meshgrid(NUMBERS, NUMBERS))


@pytest.fixture
def ways(monkeypatch: pytest.MonkeyPatch):
    """Values of a function of the variables by the library and by CasADi, one for each column of the values."""

    def both(function, values: np.ndarray) -> list[np.ndarray]:
        # CasADi has more operations than Pyomo's expressions ask for.
        monkeypatch.setattr(summed_terms, "decoded", lambda code, variables, *_: function(*variables))
        summed_terms._derivatives.cache_clear()
        size, count = values.shape
        terms = Terms(Columns())
        group = terms.groups[()] = TermGroup((), size, 0)
        group.rows, group.scales = list(range(count)), [1.0] * count
        group.columns = np.arange(values.size).reshape(size, count).T.ravel().tolist()
        found = []
        for library in (evaluation_library(), None):
            sums = summed_terms.SummedTerms(terms, count, values.size, library)
            summed_terms.place_hessians([sums], values.size)
            found.append(sums.values(values.ravel()))
        return found

    return both


def test_operations_have_the_numbers_of_the_source() -> None:
    listed = re.search(r"enum Operation \{(.*?)\}", SOURCE.read_text(), re.DOTALL).group(1)
    assert tuple(re.findall(r"\w+", listed)) == OPERATIONS


UNARY = "sqrt exp log log1p expm1 sin cos tan asin acos atan sinh cosh tanh asinh acosh atanh fabs sign floor ceil"
BINARY = "atan2 copysign fmod fmin fmax hypot power"


@pytest.mark.parametrize("name", UNARY.split())
def test_functions_of_one_number_are_those_of_casadi(name: str, ways) -> None:
    ours, theirs = ways(getattr(casadi, name), NUMBERS[None])
    np.testing.assert_allclose(ours, theirs, rtol=1e-15)


@pytest.mark.parametrize("name", BINARY.split())
def test_functions_of_two_numbers_are_those_of_casadi(name: str, ways) -> None:
    ours, theirs = ways(getattr(casadi, name), np.array([A, B]))
    np.testing.assert_allclose(ours, theirs, rtol=1e-15)


OPERATORS = {
    "sum": lambda a, b: a + b,
    "difference": lambda a, b: a - b,
    "product": lambda a, b: a * b,
    "quotient": lambda a, b: a / b,
    "negative": lambda a, b: -(a + b),
    "reciprocal": lambda a, b: 1 / (a + b),
    "square": lambda a, b: (a - b) ** 2,
    "twice": lambda a, b: 2 * (a * b),
    "constant power": lambda a, b: casadi.power(a + b, 3.5),
    "less": lambda a, b: casadi.if_else(a < b, a, b * b),
    "less or equal": lambda a, b: casadi.if_else(a <= b, a, 7.0),
    "equal": lambda a, b: casadi.if_else(a == b, 2.0, b),
    "unequal": lambda a, b: casadi.if_else(a != b, a, 3.0),
    "not": lambda a, b: casadi.logic_not(a),
    "and": lambda a, b: casadi.logic_and(a, b),
    "or": lambda a, b: casadi.logic_or(a, b),
}


@pytest.mark.parametrize("name", OPERATORS)
def test_operators_are_those_of_casadi(name: str, ways) -> None:
    np.testing.assert_array_equal(*ways(OPERATORS[name], np.array([A, B])))


def model(instances: int) -> pyo.ConcreteModel:
    """Rows and costs with shared variables, numbers that vary, a parameter, odd terms and constants."""
    m = pyo.ConcreteModel()
    m.k = pyo.RangeSet(0, instances)
    m.x = pyo.Var(m.k, bounds=(-3.0, 3.0), initialize=lambda m, k: 0.1 + 0.05 * k % 1.0)
    m.rate = pyo.Param(m.k, mutable=True, initialize=lambda m, k: 1.0 + 0.1 * k)

    @m.Constraint(range(instances))
    def step(m, k):
        return m.x[k + 1] - m.x[k] == 0.1 * pyo.sin(m.rate[k] * m.x[k]) - (0.01 + k / 50) * m.x[k] * m.x[k + 1] ** 2

    m.odd = pyo.Constraint(expr=pyo.exp(m.x[0]) * m.x[instances] - 3 * m.x[1] <= 4.0)
    m.cost = pyo.Objective(expr=5.0 + sum((m.x[k] - 1) ** 2 + pyo.exp(-m.x[k]) for k in m.k))
    return m


def called_directly(nlp) -> set[str]:
    run = compiled_run_of(nlp)
    return set() if run is None else set(run.functions)


def program(m: pyo.ConcreteModel, switch: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv(SWITCH_VARIABLE, switch)
    compiled = CompiledModel(m, "vectorised")
    monkeypatch.delenv(SWITCH_VARIABLE)
    assert called_directly(compiled.nlp) == (set() if switch == "off" else set(EVALUATIONS))
    return compiled


def numbers_of(nlp, x: np.ndarray, multipliers: np.ndarray) -> list[np.ndarray]:
    return [
        np.array([nlp.objective(x)]), nlp.gradient(x), nlp.constraints(x), nlp.jacobian(x),
        nlp.hessian(x, 0.7, multipliers),
    ]  # fmt: skip


@pytest.mark.parametrize("instances", [1, 5, 63, 64, 65, 129, 200])
def test_all_functions_of_a_program_are_those_of_casadi(instances: int, monkeypatch: pytest.MonkeyPatch) -> None:
    m = model(instances)
    ours, theirs = (program(m, switch, monkeypatch) for switch in ("on", "off"))
    assert np.array_equal(ours.nlp.jacobian_structure, theirs.nlp.jacobian_structure)
    assert np.array_equal(ours.nlp.hessian_structure, theirs.nlp.hessian_structure)
    random = np.random.default_rng(instances)
    for _ in range(2):
        x, multipliers = random.uniform(-1, 1, ours.nlp.n), random.uniform(-1, 1, ours.nlp.m)
        for mine, other in zip(
            numbers_of(ours.nlp, x, multipliers), numbers_of(theirs.nlp, x, multipliers), strict=True
        ):
            assert mine == pytest.approx(other, rel=1e-13, abs=1e-14)
        for k in m.k:
            m.rate[k] = 2.0 - 0.01 * k
        ours.update(), theirs.update()


def test_ipopt_runs_alike_with_and_without_python(monkeypatch: pytest.MonkeyPatch) -> None:
    m = model(40)
    nlp, slow = (program(m, switch, monkeypatch).nlp for switch in ("on", "off"))
    scales = Scales(np.linspace(0.5, 2.0, nlp.n), np.linspace(3.0, 0.3, nlp.m), 7.0)
    for fast, other in ((nlp, slow), (ScaledProgram(nlp, scales), ScaledProgram(slow, scales))):
        assert called_directly(fast) == set(EVALUATIONS)
        ours, theirs = run_ipopt(fast, {}), run_ipopt(other, {})
        assert ours.status.solved
        assert ours.iterations == theirs.iterations
        assert ours.x == pytest.approx(theirs.x, abs=1e-9)
        assert ours.g == pytest.approx(fast.constraints(ours.x), abs=1e-12)


def test_what_is_put_around_a_program_is_evaluated_by_python() -> None:
    class Around:
        def __init__(self, nlp) -> None:
            self.nlp = nlp

        def __getattr__(self, name: str):
            return getattr(self.nlp, name)

        def gradient(self, x: np.ndarray) -> np.ndarray:
            return 2 * self.nlp.gradient(x)

    def fresh():
        return CompiledModel(model(2), "vectorised").nlp

    class Other(type(fresh())):
        def hessian(self, *given) -> np.ndarray:
            return super().hessian(*given)

    assert called_directly(Around(fresh())) == set()
    assert called_directly(ShiftedRows(fresh(), [0], 0.1)) == set(EVALUATIONS)
    derived = fresh()
    derived.__class__ = Other
    assert called_directly(derived) == called_directly(ShiftedRows(derived, [0], 0.1)) == set()


def test_rows_that_are_moved_during_a_run_are_moved_in_a_compiled_one_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    outcomes = []
    for switch in ("on", "off"):
        compiled = program(model(30), switch, monkeypatch)
        moving = ShiftedRows(compiled.nlp, [compiled.row_of[compiled.model.odd]], 0.0)

        def follow(record, moving=moving) -> None:
            moving.delta = -min(record.mu, 1.0)

        outcomes.append(run_ipopt(moving, {}, on_iteration=follow))
    assert outcomes[0].iterations == outcomes[1].iterations
    assert outcomes[0].x == pytest.approx(outcomes[1].x, abs=1e-9)


def test_several_threads_evaluate_one_program() -> None:
    nlp = CompiledModel(model(150), "vectorised").nlp
    points = np.random.default_rng(0).uniform(-1, 1, (40, nlp.n))
    one_by_one = [nlp.jacobian(x) for x in points]
    with ThreadPoolExecutor(4) as threads:
        assert np.array_equal(list(threads.map(nlp.jacobian, points)), one_by_one)
