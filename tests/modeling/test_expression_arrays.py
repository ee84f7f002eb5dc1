"""NumPy's functions on variables are those functions on the variables' values."""

import copy
import math
import pickle

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import one_phase
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.expression_arrays import FUNCTIONS, ArrayEntry, ExpressionArray, plain_expressions

ABOVE_ONE = {"arccosh"}
POSITIVE = {"log", "log2", "log10", "log1p", "sqrt", "reciprocal", "hypot", "arctan2"}


def variables(numbers):
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(len(numbers)), initialize=dict(enumerate(map(float, numbers))))
    return m, rcp.array(m.x)


def numbers_of(result):
    """The values of an array of expressions."""
    if isinstance(result, np.ndarray):
        return np.array([pyo.value(entry) for entry in result.ravel()], dtype=float).reshape(result.shape)
    return pyo.value(result)


vectors = st.lists(st.floats(0.05, 0.95), min_size=3, max_size=3)


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_a_function_is_that_of_the_values(name):
    magnitudes = np.linspace(0.05, 0.95, 7) + (1.0 if name in ABOVE_ONE else 0.0)
    numbers = magnitudes if name in ABOVE_ONE | POSITIVE else np.hstack([magnitudes, -magnitudes])
    _m, x = variables(numbers)
    function = getattr(np, name)
    more = (0.7,) * (function.nin - 1)
    expected = function(numbers, *more)
    assert numbers_of(function(x, *more)) == pytest.approx(expected, rel=1e-12)
    # One entry, and a plain array of entries, give the same.
    assert pyo.value(function(x[-1], *more)) == pytest.approx(expected[-1], rel=1e-12)
    assert numbers_of(function(np.array([x[0], x[1]]), *more)) == pytest.approx(expected[:2], rel=1e-12)
    # Numbers among the entries stay numbers.
    mixed = function(rcp.array([x[0], float(numbers[2])]), *more)
    assert mixed[1] == pytest.approx(expected[2], rel=1e-12)
    assert isinstance(mixed[1], float)


@settings(max_examples=20)
@given(st.floats(-math.pi + 0.01, math.pi - 0.01), st.floats(0.1, 10))
def test_arctan2_gives_the_angle_in_every_quadrant(angle, radius):
    _m, x = variables([radius * math.sin(angle), radius * math.cos(angle)])
    assert pyo.value(np.arctan2(x[0], x[1])) == pytest.approx(angle, abs=1e-9)
    assert numbers_of(np.arctan2(x[:1], x[1]))[0] == pytest.approx(angle, abs=1e-9)


COMPUTATIONS = {
    "sum": lambda x, a: np.sum(x) + x.sum(),
    "mean of columns": lambda x, a: np.mean(np.vstack([x, 2 * x]), axis=0),
    "dot of both": lambda x, a: np.dot(x, x) + x.dot(x),
    "matrix product": lambda x, a: a @ x,
    "from the left": lambda x, a: x @ a @ x,
    "cross": lambda x, a: np.cross(x, a[0]),
    "norms of rows": lambda x, a: np.linalg.norm(x - a, axis=1),
    "radial functions": lambda x, a: np.exp(-0.5 * np.sum((x - a) ** 2, axis=1)) @ a[2],
    "broadcasting": lambda x, a: x[:, None] * a / (1 + x),
    "power": lambda x, a: np.power(x, 3) + x**0.5 + 2.0**x + np.power(2.0, x),
    "cumulated": lambda x, a: np.cumsum(x) + np.prod(x) - np.diff(x).sum(),
    "determinant": lambda x, a: np.linalg.det(a + np.outer(x, x)),
    "inverse": lambda x, a: np.linalg.inv(np.diag(x) + 0.1 * np.outer(x, x)),
    "system": lambda x, a: np.linalg.solve(np.diag(x) + 0.1 * np.outer(x, x), a[0]),
    "signs": lambda x, a: abs(-x) + (+x) - np.negative(x),
    "NumPy's scalars": lambda x, a: np.float64(2.0) * x[0] + x[1] * np.float64(3.0) - a[0, 0] / x[2],
}


@pytest.mark.parametrize("computation", COMPUTATIONS.values(), ids=COMPUTATIONS)
@settings(max_examples=5)
@given(vectors, st.lists(st.floats(-2, 2), min_size=9, max_size=9))
def test_a_computation_is_that_of_the_values(computation, numbers, matrix):
    matrix = np.array(matrix).reshape(3, 3)
    _m, x = variables(numbers)
    expected = computation(np.array(numbers), matrix)
    found = numbers_of(computation(x, matrix))
    assert np.shape(found) == np.shape(expected)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_arrays_are_made_of_all_that_a_model_has():
    m, x = variables([1, 2, 3])
    m.s = pyo.Var(initialize=4)
    m.p = pyo.Param(initialize=5, mutable=True)
    m.y = pyo.Var([0, 1], [0, 1], initialize=lambda m, i, j: i + 2 * j)
    mixed = rcp.array([m.s, m.p, m.x[0] ** 2, x[1], 6, np.float64(7)])
    assert isinstance(mixed, ExpressionArray)
    assert numbers_of(mixed).tolist() == [4, 5, 1, 2, 6, 7]
    assert numbers_of(rcp.array(m.y[:, 1])).tolist() == [2, 3]
    assert rcp.array([[m.s, 0], x[:2]]).shape == (2, 2)
    assert rcp.array(m.s).shape == ()
    assert rcp.array(x) is x
    with pytest.raises(ModelError, match="different shapes"):
        rcp.array([m.s, [1, 2]])


def test_entries_and_variables_mix():
    m, x = variables([1, 2, 3])
    assert isinstance(m.x[0] * x[1], ArrayEntry)
    assert pyo.value(np.sqrt(m.x[0] + x[2])) == 2
    assert numbers_of(m.x[1] * x).tolist() == [2, 4, 6]
    assert pyo.value(pyo.sin(x[0])) == math.sin(1)
    assert pyo.value(sum(x)) == 6
    x = rcp.array(x.tolist())
    x[0] = m.x[2] * 2
    assert pyo.value(np.sin(x[0])) == pytest.approx(math.sin(6))


def test_what_reaches_a_model_is_plain():
    m, x = variables([3, 4])
    m.row = pyo.Constraint(expr=np.linalg.norm(x) <= 5)
    m.other = pyo.Constraint(expr=m.x[0] == x[1])
    m.cost = pyo.Objective(expr=np.sum(x**2))
    m.named = pyo.Expression([0, 1], rule=lambda m, i: np.sin(x[i]).expression)
    rows = list((x <= rcp.array([m.x[1], 9])).ravel())
    assert [pyo.value(row) for row in rows] == [True, True]
    assert "ArrayEntry" not in "".join(map(repr, map(type, (m.cost.expr, m.row.body, m.other.body, m.named[0].expr))))
    del m.named  # its rule is a lambda, which no pickle holds
    again = pickle.loads(pickle.dumps(copy.deepcopy(x)))
    assert numbers_of(again).tolist() == [3, 4]


def test_products_with_zero_hold_no_variable():
    _m, x = variables([1, 2])
    rotated = np.array([[0.0, 1.0], [-1.0, 0.0]]) @ x
    assert [str(entry) for entry in rotated] == ["x[1]", "- x[0]"]


def test_results_of_rules_become_plain_rows():
    m, x = variables([1, 2])
    assert plain_expressions(x[0]) is m.x[0]
    assert plain_expressions(x) == [m.x[0], m.x[1]]
    assert [str(row) for row in plain_expressions([x, x[0] == 1])] == ["x[0]", "x[1]", "x[0]  ==  1"]
    assert plain_expressions({"a": x[:1], "b": 2.0}) == {"a": m.x[0], "b": 2.0}
    assert plain_expressions((0, x[1], 1)) == (0, m.x[1], 1)
    assert plain_expressions("text") == "text"


REFUSED = {
    "a maximum": (lambda x: np.maximum(x, 0), "complementarity"),
    "a choice": (lambda x: np.where(x > 0, x, 0), "complementarity"),
    "a sign": (lambda x: np.sign(x[0]), "phases of their own"),
    "a lookup": (lambda x: np.interp(x[0], [0, 1], [0, 1]), "np.sin"),
    "a branch": (lambda x: 1 if x[0] else 2, "neither true nor false"),
    "math": (lambda x: math.sin(x[0]), "np.sin and the like instead of math.sin"),
    "numbers of an array": (lambda x: np.zeros(2).__setitem__(0, x[0]), "dtype=object"),
    "numbers added to": (lambda x: np.zeros(2).__iadd__(x), "dtype=object"),
    "a special function": (lambda x: np.linalg.eigvals(np.outer(x, x)), "np.eigvals cannot be applied"),
    "a large system": (lambda x: np.linalg.inv(np.outer(x, x)[:, :1]), r"\(2, 1\)"),
}


@pytest.mark.parametrize(("computation", "remedy"), REFUSED.values(), ids=REFUSED)
def test_what_has_no_formula_is_refused_with_a_remedy(computation, remedy):
    _m, x = variables([1, 2])
    with pytest.raises(ModelError, match=remedy):
        computation(x)


# -------------------------------------------------------------------- rules

PULL = np.array([[0.0, 1.0], [-2.0, -0.3]])


def swinging(of_array: bool):
    """A driven pendulum, with NumPy or with Pyomo's functions."""
    m, b = one_phase("swing", duration=1.0, elements=4, stages=2, angle=rcp.State(initial=1), rate=rcp.State(initial=0))
    b.energy = rcp.Algebraic(bounds=(0, None))
    b.torque = rcp.Control(bounds=(-1, 1), initial_guess=0.3)

    if of_array:

        @b.ode
        def motion(b, t):
            x = rcp.array([b.angle[t], b.rate[t]])
            return dict(zip((b.angle, b.rate), PULL @ np.sin(x) + np.array([0, 1]) * b.torque[t], strict=True))

        b.residual(lambda b, t: rcp.array([b.energy[t]]) - np.exp(rcp.array([b.angle[t]])), name="heights")

        b.constraint(lambda b, t: np.linalg.norm(rcp.array([b.angle[t], b.rate[t]])) <= 5, name="slow")

        m.cost = pyo.Objective(expr=b.integral(lambda b, t: rcp.array([b.angle[t], b.torque[t]]) ** 2 @ [1, 0.1]))
    else:

        @b.ode
        def motion(b, t):
            angle, rate = pyo.sin(b.angle[t]), pyo.sin(b.rate[t])
            return {b.angle: rate, b.rate: -2 * angle - 0.3 * rate + b.torque[t]}

        b.residual(lambda b, t: b.energy[t] - pyo.exp(b.angle[t]), name="heights")

        b.constraint(lambda b, t: pyo.sqrt(b.angle[t] ** 2 + b.rate[t] ** 2) <= 5, name="slow")

        m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.angle[t] ** 2 + 0.1 * b.torque[t] ** 2))
    return m


@pytest.mark.ipopt
def test_rules_with_arrays_are_rules():
    results = []
    for of_array in (True, False):
        m = swinging(of_array)
        m.swing.check()
        m.swing.initialize(m.swing.simulate())
        solution = rcp.solve(m)
        trajectory = m.swing.trajectory()
        checked = trajectory.verify()
        results.append([solution.objective, *trajectory.torque, *m.swing.simulate(initial={"angle": 0.5}).rate])
        assert checked.largest_violation < 1e-6
    assert results[0] == pytest.approx(results[1], rel=1e-6, abs=1e-7)


def test_rules_that_return_arrays_where_one_row_is_meant_are_refused():
    _, b = one_phase("b", duration=1, elements=2, x=rcp.State(initial=0))
    pair = lambda b, t: rcp.array([b.x[t], 1.0])  # noqa: E731
    with pytest.raises(ModelError, match=r"phase 'b': integrand.*shape \(2,\).*Sum it"):
        b.integral(pair)
    with pytest.raises(ModelError, match="derivative of 'x' at t = 0.07"):
        b.ode(lambda b, t: {b.x: pair(b, t)})


def test_poses_are_made_of_entries():
    _m, x = variables([1, 2, math.pi / 2])
    flat = rcp.planar_pose(*x)
    assert not any(isinstance(entry, ArrayEntry) for entry in flat.entries)
    assert np.hstack([part.ravel() for part in flat.numbers()]) == pytest.approx([0, -1, 1, 0, 1, 2], abs=1e-12)
    solid = rcp.spatial_pose(x, euler=x * 0.1)
    assert not any(isinstance(entry, ArrayEntry) for entry in solid.entries)
    turn = np.array([[np.cos(x[2]), -np.sin(x[2])], [np.sin(x[2]), np.cos(x[2])]])
    by_hand = rcp.scenes.Pose(turn, x[:2])
    assert np.hstack([part.ravel() for part in by_hand.numbers()]) == pytest.approx([0, -1, 1, 0, 1, 2], abs=1e-12)
