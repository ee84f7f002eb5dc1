"""Laws of the linear solver: inertia, residuals, repetition, threads, memory, and what cannot be factored."""

import concurrent.futures
import os
import resource
import subprocess
import sys
import textwrap

import numpy as np
import pytest
from harness.dense_inertia import check
from harness.random_matrices import Matrix, kkt_matrix, trajectory_matrix
from hypothesis import given, settings
from hypothesis import strategies as st

from pyrobocop_pyomo.errors import EvaluationError, SolverNotFoundError
from pyrobocop_pyomo.linear_solver import SymmetricFactorisation, find_linear_solver


def solved(matrix: Matrix, library: str) -> bytes:
    """By a solver of its own."""
    solver = SymmetricFactorisation(*matrix[:3], library)
    solver.factor(matrix.values)
    return solver.solve(np.ones(matrix.n)).tobytes()


def test_inertia_of_a_thousand_random_matrices(library):
    rng = np.random.default_rng(0)
    kinds = []
    for number in range(1000):
        matrix = kkt_matrix(rng, scale=2.0 if number % 3 == 0 else 0.0)
        if matrix.values.size:
            kinds.append(check(matrix, SymmetricFactorisation(*matrix[:3], library), rng))
    assert kinds.count("regular") > 600
    assert kinds.count("singular") > 50


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=50)
def test_other_values_in_the_same_structure(library, seed):
    """The order of the first values serves for all, whatever is zero later."""
    rng = np.random.default_rng(seed)
    matrix = trajectory_matrix(rng, int(rng.integers(2, 12)))
    solver = SymmetricFactorisation(*matrix[:3], library)
    for _ in range(4):
        other = matrix.values * rng.normal(size=matrix.values.size) * (rng.random(matrix.values.size) > 0.1)
        check(matrix._replace(values=other), solver, rng)


def test_a_second_factorisation_gives_the_same_bits(library):
    rng = np.random.default_rng(1)
    matrix = trajectory_matrix(rng, 200)
    b = rng.normal(size=matrix.n)
    solver = SymmetricFactorisation(*matrix[:3], library)
    answers = []
    for _ in range(3):
        solver.factor(matrix.values)
        answers.append(solver.solve(b))
    assert all(np.array_equal(answers[0], answer) for answer in answers)


def test_four_threads_do_not_disturb_each_other(library):
    matrices = [trajectory_matrix(np.random.default_rng(seed), 100 + 30 * seed) for seed in range(4)]

    def solutions(matrix: Matrix) -> list[bytes]:
        solver = SymmetricFactorisation(*matrix[:3], library)
        found = []
        for _ in range(10):
            solver.factor(matrix.values)
            found.append(solver.solve(np.ones(matrix.n)).tobytes())
        return found

    alone = [solutions(matrix)[0] for matrix in matrices]
    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        for number, found in enumerate(pool.map(solutions, matrices)):
            assert set(found) == {alone[number]}


@pytest.mark.skipif(sys.platform == "win32", reason="the module resource is of POSIX")
def test_a_thousand_solvers_leave_no_memory_behind(library):
    matrix = trajectory_matrix(np.random.default_rng(2), 30)

    def use(times: int) -> None:
        for _ in range(times):
            solved(matrix, library)

    use(100)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    use(1000)
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert grown < 4096 * (1024 if sys.platform == "darwin" else 1)  # a solver of this size holds 300 kB


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite_are_refused(library, value):
    matrix = trajectory_matrix(np.random.default_rng(3), 20)
    solver = SymmetricFactorisation(*matrix[:3], library)
    broken = matrix.values.copy()
    broken[17] = value
    with pytest.raises(EvaluationError, match="not finite"):
        solver.factor(broken)
    with pytest.raises(RuntimeError, match="no factor"):
        solver.solve(np.ones(matrix.n))
    solver.factor(matrix.values)
    assert np.isfinite(solver.solve(np.ones(matrix.n))).all()


def test_overflow_is_no_answer(library):
    """All entries are finite, what follows from them is not."""
    full = np.array([[1e-200, 1e200, 0.0], [1e200, 1e200, 1e200], [0.0, 1e200, 1e-300]])
    i, j = np.triu_indices(3)
    solver = SymmetricFactorisation(3, i, j, library)
    try:
        solver.factor(full[i, j])
    except EvaluationError:
        return
    assert np.isfinite(solver.solve(np.ones(3))).all()


@pytest.mark.parametrize("n", [1, 2, 5])
def test_zero_matrices_are_singular(library, n):
    with pytest.raises(EvaluationError):
        SymmetricFactorisation(n, [], [], library).factor([])
    with pytest.raises(EvaluationError):
        SymmetricFactorisation(n, range(n), range(n), library).factor(np.zeros(n))


def test_rows_that_depend_on_each_other_structurally(library):
    """Three rows over two variables: no values make that regular."""
    rows, columns = [2, 2, 3, 3, 4, 4, 0, 1], [0, 1, 0, 1, 0, 1, 0, 1]
    solver = SymmetricFactorisation(5, rows, columns, library)
    for seed in range(20):
        values = np.random.default_rng(seed).integers(1, 9, size=8).astype(float)
        values[6:] = 0.0
        with pytest.raises(EvaluationError):
            solver.factor(values)


def test_a_zero_diagonal_throughout(library):
    """Pairs of two rows are all that there is."""
    n = 300
    i = np.arange(n - 1)
    solver = SymmetricFactorisation(n, i, i + 1, library)
    found = solver.factor(np.ones(n - 1))
    assert (found.negative, found.blocks) == (n // 2, n // 2)


def test_a_row_that_meets_all_others_comes_last(library):
    """As the length of a motion does: its fill would be everyone's otherwise."""
    n = 3000
    i = np.arange(n)
    rows, columns = np.r_[i, i[:-1], i[:-1]], np.r_[i, i[:-1] + 1, np.full(n - 1, n - 1)]
    values = np.r_[np.full(n, 4.0), np.ones(2 * (n - 1))]
    found = SymmetricFactorisation(n, rows, columns, library).factor(values)
    assert found.entries < 10 * n


@pytest.mark.heavy
def test_a_million_rows_in_linear_memory(library):
    n = 1_000_000
    i = np.arange(n)
    solver = SymmetricFactorisation(n, np.r_[i, i[1:]], np.r_[i, i[:-1]], library)
    values = np.r_[np.full(n, -2.0), np.ones(n - 1)]
    found = solver.factor(values)
    assert found.negative == n
    assert found.entries < 12 * n
    x = np.random.default_rng(0).normal(size=n)
    b = -2 * x + np.r_[x[1:], 0] + np.r_[0, x[:-1]]
    assert np.abs(-2 * (y := solver.solve(b)) + np.r_[y[1:], 0] + np.r_[0, y[:-1]] - b).max() < 1e-3


def test_dense_fronts_with_many_blocks_of_pivots(library):
    """More columns than are eliminated at once, with delays from block to block."""
    rng = np.random.default_rng(5)
    n = 170
    full = rng.normal(size=(n, n)) * 10 ** rng.uniform(-6, 0, size=(n, n))
    full = np.triu(full, 1)
    i, j = np.triu_indices(n)
    matrix = Matrix(n, i, j, full[i, j])
    solver = SymmetricFactorisation(n, i, j, library)
    assert check(matrix, solver, rng) == "regular"


def test_the_predicted_size_is_that_of_the_factor(library):
    rng = np.random.default_rng(6)
    matrix = trajectory_matrix(rng, 300)
    solver = SymmetricFactorisation(*matrix[:3], library)
    size = solver.size_of_factor(matrix.values)
    found = solver.factor(matrix.values)
    assert found.entries <= size.entries <= 3 * found.entries
    assert size.largest_front >= 4


def test_what_is_no_matrix_is_refused(library):
    with pytest.raises(ValueError, match="from 0 to 2"):
        SymmetricFactorisation(3, [0, 3], [0, 1], library)
    with pytest.raises(ValueError, match="2 rows are given for 1 columns"):
        SymmetricFactorisation(3, [0, 2], [0], library)
    with pytest.raises(ValueError, match="0 rows"):
        SymmetricFactorisation(0, [], [], library)
    solver = SymmetricFactorisation(2, [0, 1], [0, 1], library)
    with pytest.raises(ValueError, match=r"shape \(3,\); this matrix needs \(2,\)"):
        solver.factor(np.ones(3))


def test_where_the_solver_is_looked_for(library, monkeypatch, tmp_path):
    for variable in ("PYROBOCOP_LINEAR_SOLVER", "PYROBOCOP_NATIVE"):
        monkeypatch.delenv(variable, raising=False)
    assert find_linear_solver() == library
    monkeypatch.setenv("PYROBOCOP_NATIVE", "off")
    assert find_linear_solver() is None
    with pytest.raises(SolverNotFoundError, match="C compiler"):
        SymmetricFactorisation(1, [0], [0])
    monkeypatch.delenv("PYROBOCOP_NATIVE")
    monkeypatch.setenv("PYROBOCOP_LINEAR_SOLVER", "none")
    assert find_linear_solver() is None
    monkeypatch.setenv("PYROBOCOP_LINEAR_SOLVER", library)
    assert find_linear_solver() == library
    monkeypatch.setenv("PYROBOCOP_LINEAR_SOLVER", str(tmp_path / "gone"))
    with pytest.raises(SolverNotFoundError, match="no such file"):
        find_linear_solver()


def test_a_plan_that_is_kept_changes_nothing(library):
    """Structures come and go; whether the plan was made or found, the answer has the same bits."""
    rng = np.random.default_rng(7)
    matrices = [trajectory_matrix(rng, 20 + 3 * number) for number in range(12)]  # more than are kept

    def answers() -> list[bytes]:
        return [solved(matrix, library) for matrix in matrices]

    first = answers()
    assert answers() == first
    assert answers()[::-1] == first[::-1]
    assert solved(matrices[-1], library) == first[-1]  # is kept now


@pytest.mark.parametrize("part", [1e-16, 1e-15])
def test_what_rounding_leaves_is_no_eigenvalue(library, part):
    """Two rows that are the same but for rounding, beside large terms that cancel."""
    full = np.array([[1.0, 0.0, 1.0, 1.0], [0.0, 1.0, 3.0, 3.0 + part], [1.0, 3.0, 0, 0], [1.0, 3.0 + part, 0, 0]])
    i, j = np.triu_indices(4)
    with pytest.raises(EvaluationError):
        SymmetricFactorisation(4, i, j, library).factor(full[i, j])


def test_rows_that_are_combinations_of_others_are_found(library):
    """As rows of a program depend on each other, with few exceptions: what is left of a pivot hangs on rounding."""
    rng = np.random.default_rng(8)
    found = 0
    for _ in range(200):
        variables, rows = int(rng.integers(3, 12)), int(rng.integers(1, 4))
        jacobian = np.linalg.qr(rng.normal(size=(variables, rows)))[0].T
        jacobian = np.vstack([jacobian, rng.uniform(0.5, 1.0, size=rows) @ jacobian])
        n = variables + rows + 1
        full = np.zeros((n, n))
        full[:variables, :variables] = np.diag(rng.uniform(1.0, 2.0, size=variables))
        full[:variables, variables:] = jacobian.T
        i, j = np.triu_indices(n)
        try:
            SymmetricFactorisation(n, i, j, library).factor(full[i, j])
        except EvaluationError:
            found += 1
    assert found >= 190


# --------------------------------------------------------------------
# What pip installs is enough: no compiler, no ASL, no executable.


PROGRAM = """
    import logging
    import pyomo.environ as pyo
    import pyrobocop_pyomo as rcp
    from pyrobocop_pyomo.linear_solver import find_linear_solver

    assert find_linear_solver() is None

    motion = pyo.ConcreteModel()
    motion.move = b = rcp.PhaseBlock(duration=1.0, elements=6, stages=3)
    b.x, b.v = rcp.State(initial=0.0, final=1.0), rcp.State(initial=0.0, final=0.0)
    b.u = rcp.Control()
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t]})
    motion.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    assert abs(rcp.solve(motion, progress=False).objective - 12.0) < 1e-6

    pairs = pyo.ConcreteModel()
    pairs.x, pairs.y = pyo.Var(bounds=(0, None), initialize=1.0), pyo.Var(bounds=(0, None), initialize=1.0)
    pairs.pair = rcp.Complementarity(rule=rcp.complements(pairs.x >= 0, pairs.y >= 0))
    pairs.cost = pyo.Objective(expr=(pairs.x - 1) ** 2 + (pairs.y - 2) ** 2)
    assert rcp.solve(pairs, progress=False).solved
"""


@pytest.mark.ipopt
@pytest.mark.casadi
def test_models_are_solved_without_compiler_and_asl(tmp_path):
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYROBOCOP_")}
    environment |= {
        "PYROBOCOP_NATIVE": "off",
        "PYOMO_CONFIG_DIR": str(tmp_path),
        "PATH": "",
        "CC": str(tmp_path / "none"),
    }
    ended = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(PROGRAM)], capture_output=True, text=True, timeout=900, env=environment
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
