"""Laws of tables: points, polynomials, derivatives, edges, and what is refused."""

import pickle

import numpy as np
import pandas as pd
import pyomo.environ as pyo
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import EvaluationError, FunctionError

GRID = np.array([0.0, 0.3, 0.5, 1.1, 1.7, 2.0, 2.6, 3.0])
OTHER = np.array([-1.0, -0.4, 0.1, 0.8, 1.2, 1.9, 2.0, 2.5])  # as many: a transposed product would not be noticed


@pytest.mark.parametrize(("kind", "degree"), [("cubic", 3), ("quintic", 5)])
@given(coefficients=st.lists(st.floats(-2, 2), min_size=6, max_size=6), seed=st.integers(0, 100))
@settings(max_examples=15, deadline=None)
def test_polynomials_and_their_derivatives_come_out_exactly(kind, degree, coefficients, seed):
    first = np.polynomial.Polynomial(coefficients[: degree + 1])
    second = np.polynomial.Polynomial(coefficients[::-1][: degree + 1])
    numbers = np.random.default_rng(seed)
    x, y = numbers.uniform(0, 3, 20), numbers.uniform(-1, 2.5, 20)
    scale = 1 + np.abs(np.outer(first(GRID), second(OTHER))).max()
    table = rcp.Table(GRID, first(GRID), kind=kind)
    assert np.allclose(table(x), first(x), atol=1e-9 * scale)
    assert np.allclose(table.derivative(x), first.deriv()(x), atol=1e-8 * scale)
    product = rcp.Table(GRID, OTHER, np.outer(first(GRID), second(OTHER)), inputs=["x", "y"], kind=kind)
    assert np.allclose(product(x, y), first(x) * second(y), atol=1e-9 * scale)
    assert np.allclose(product.derivative(x, y, by=0), first.deriv()(x) * second(y), atol=1e-8 * scale)
    assert np.allclose(product.derivative(x, y, by="y"), first(x) * second.deriv()(y), atol=1e-8 * scale)


@pytest.mark.parametrize(
    ("kind", "outside"),
    [
        ("cubic", "constant"),
        ("natural", "linear"),
        ("quintic", "error"),
        ("quintic", "linear"),
        ("monotone", "constant"),
    ],
)
def test_points_and_derivatives_which_have_derivatives_themselves(kind, outside):
    numbers = np.random.default_rng(3)
    values = np.sin(GRID) + 0.1 * GRID**2
    reach = 0.0 if outside == "error" else 1.0
    table = rcp.Table(GRID, values, kind=kind, outside=outside)
    assert np.allclose(table(GRID), values, atol=1e-12)
    points = numbers.uniform(-reach, 3 + reach, (25, 1))
    table.check_derivatives(points)
    assert np.allclose(table.derivative(points[:, 0]), table.jacobians(points)[:, 0, 0], atol=1e-12)
    step = 1e-6
    middle = points[(np.abs(points[:, :1] - GRID) > 1e-3).all(axis=1), 0]
    differences = (table(middle + step) - table(middle - step)) / (2 * step)
    assert np.allclose(table.derivative(middle), differences, atol=1e-6)
    m = pyo.ConcreteModel()
    m.x = pyo.Var(initialize=1.0)
    table.derivative(m.x)._fcn.function.check_derivatives(points)
    if kind != "monotone":
        products = np.outer(values, np.cos(OTHER)) + GRID[:, None]
        surface = rcp.Table(GRID, OTHER, products, kind=kind, outside=outside)
        assert np.allclose(surface(GRID[:, None], OTHER), products, atol=1e-12)
        points = numbers.uniform([-reach, -1 - reach], [3 + reach, 2.5 + reach], (25, 2))
        surface.check_derivatives(points)
        for i in range(2):
            assert np.allclose(surface.derivative(*points.T, by=i), surface.jacobians(points)[:, 0, i], atol=1e-12)
            surface.derivative(m.x, m.x, by=i)._fcn.function.check_derivatives(points)


def test_derivatives_by_name_by_number_and_by_neither():
    table = rcp.Table(GRID, OTHER, np.outer(GRID, OTHER), inputs=["mach", "altitude"], name="thrust")
    assert table.derivative(1.0, 2.0, by="altitude") == table.derivative(1.0, 2.0, by=1) == pytest.approx(1.0)
    m = pyo.ConcreteModel()
    m.x = pyo.Var(initialize=1.0)
    assert str(table.derivative(m.x, 2.0, by="mach")) == "thrust.derivative_by_mach(x, 2.0)"
    for by in (None, "height", 2):
        with pytest.raises(FunctionError, match="'thrust': its derivative is requested by .*; give by='mach'"):
            table.derivative(1.0, 2.0, by=by)
    with pytest.raises(EvaluationError, match="mach = 3.5 is outside of the table"):
        table.derivative(3.5, 2.0, by="mach")
    copy = pickle.loads(pickle.dumps(table))
    assert copy.derivative(1.0, 2.0, by="mach") == pytest.approx(2.0)


@given(st.lists(st.floats(0, 5), min_size=len(GRID), max_size=len(GRID)))
@settings(max_examples=25, deadline=None)
def test_monotone_data_make_a_monotone_curve(steps):
    values = np.cumsum(steps)
    curve = rcp.Table(GRID, values, kind="monotone")(np.linspace(0, 3, 301))
    assert (np.diff(curve) >= -1e-12 * (1 + values[-1])).all()


def test_beyond_the_edges():
    table = rcp.Table(GRID, GRID**3, inputs=["mach"], name="thrust")
    with pytest.raises(EvaluationError, match=r"'thrust': mach = 3.5 is outside of the table, from 0 to 3"):
        table(3.5)
    assert table(3.0 + 1e-8) == pytest.approx(27.0, rel=1e-7)  # a solver's tolerance
    assert rcp.Table(GRID, GRID**3, outside="linear")(4.0) == pytest.approx(27.0 + 27.0)
    assert rcp.Table(GRID, GRID**3, outside="constant")(4.0) == pytest.approx(27.0)


@pytest.mark.parametrize(
    ("given", "options", "message"),
    [
        (([0, 2, 1, 3], [0, 1, 2, 3]), {}, "2 at 1 is followed by 1"),
        (([0, 1, np.nan, 3], [0, 1, 2, 3]), {}, "points of input 0, kind=.cubic.: nan"),
        (([0, 1, 2, 3], [0, 1, np.inf, 3]), {}, "values: inf at"),
        (([0, 1, 2, 3], [0, 1, 2]), {}, "the grids ask for"),
        ((GRID, OTHER[:5], np.ones((5, 8))), {}, "Transpose"),
        (([0, 1], [0, 1]), {}, "at least 4"),
        ((GRID, OTHER, np.ones((8, 8))), {"kind": "monotone"}, "one input"),
        (([0, 1, 2, 3], [0, 1, 2, 3]), {"kind": "spline"}, "choose one of"),
        (([0, 1, 2, 3], [0, 1, 2, 3]), {"inputs": ["a", "b"]}, "2 names for 1"),
        ((["a", 1, 2, 3], [0, 1, 2, 3]), {}, "expected numbers"),
        (([0, 1, 2, 3],), {}, "only one array"),
    ],
)
def test_what_is_no_table_is_refused(given, options, message):
    with pytest.raises(FunctionError, match=message):
        rcp.Table(*given, **options)


def test_from_pandas_and_files(tmp_path):
    frame = pd.DataFrame(np.outer(GRID, OTHER), index=GRID, columns=OTHER)
    assert rcp.Table(frame)(1.3, 0.5) == pytest.approx(0.65)
    assert rcp.Table(frame[OTHER[1]])(1.3) == pytest.approx(1.3 * OTHER[1])
    frame.to_csv(tmp_path / "wide.csv")
    assert rcp.Table.from_csv(tmp_path / "wide.csv")(1.3, 0.5) == pytest.approx(0.65)
    (tmp_path / "price.csv").write_text("hour,price\n0,1\n1,2\n2,3\n3,5\n")
    assert rcp.Table.from_csv(tmp_path / "price.csv", kind="monotone")(2.0) == 3.0
    (tmp_path / "price.csv").write_text("hour,price\n0,1\n1,much\n2,3\n3,5\n")
    with pytest.raises(
        FunctionError, match="'price': values: expected numbers: could not convert string to float.*much"
    ):
        rcp.Table.from_csv(tmp_path / "price.csv")


def test_expressions_copies_and_pickles():
    table = rcp.Table(GRID, GRID**3, name="cube")
    m = pyo.ConcreteModel()
    m.x = pyo.Var(initialize=1.5)
    m.row = pyo.Constraint(expr=table(m.x) == 8)
    assert pyo.value(m.row.body) == pytest.approx(1.5**3)
    assert pyo.value(m.clone().row.body) == pytest.approx(1.5**3)
    assert pickle.loads(pickle.dumps(table))(2.0) == pytest.approx(8.0)


@pytest.mark.ipopt
def test_where_the_derivative_of_a_table_is_zero_the_table_has_its_least_value():
    table = rcp.Table(GRID, (GRID - 1.2) ** 2 * (1 + 0.1 * GRID), kind="quintic")
    m = pyo.ConcreteModel()
    m.x = pyo.Var(bounds=(0, 3), initialize=2.5)
    m.row = pyo.Constraint(expr=table.derivative(m.x) == 0)
    m.cost = pyo.Objective(expr=(m.x - 2.0) ** 2)
    assert rcp.solve(m).solved
    assert m.x.value == pytest.approx(1.2, abs=1e-6)
