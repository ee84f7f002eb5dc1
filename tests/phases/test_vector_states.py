"""A vector of states is its components: whatever is said of the one gives what is said of the others."""

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.checked import unchanged
from harness.phases import contents, one_phase
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import InitialGuessError, ModelError

A = np.array([[0.0, 1.0, 0.0], [-1.0, -0.3, 0.2], [0.0, 0.5, -1.0]])
B = np.array([[0.0], [1.0], [0.0]])


def as_vector() -> Any:
    m, b = one_phase("go", duration=2.0, elements=4)
    b.x = rcp.State(index=3, initial=[1.0, 0.0, -1.0], bounds=([-3, -4, -5], 6), initial_guess=[1.0, 2.0, 3.0])
    b.u = rcp.Control(index=1, bounds=(-2, 2), initial_guess=0.5)
    b.gain = rcp.Parameter(index=["fast", "slow"], bounds=[(0.0, 1.0), (0.0, 2.0)], initial_guess=[0.5, 0.7])
    b.ode(lambda b, t: {b.x: A @ b.x[t] + B @ b.u[t]})
    m.cost = pyo.Objective(
        expr=b.integral(lambda b, t: b.x[t] @ b.x[t] + b.u[0, t] ** 2) + (b.gain - 0.3) @ (b.gain - 0.3)
    )
    return m


def as_scalars() -> Any:
    m, b = one_phase("go", duration=2.0, elements=4)
    for i, first in enumerate([1.0, 0.0, -1.0]):
        b.declare(f"x_{i}", rcp.State(initial=first, bounds=(-3 - i, 6), initial_guess=1.0 + i))
    b.u_0 = rcp.Control(bounds=(-2, 2), initial_guess=0.5)
    b.gain_fast = rcp.Parameter(bounds=(0.0, 1.0), initial_guess=0.5)
    b.gain_slow = rcp.Parameter(bounds=(0.0, 2.0), initial_guess=0.7)

    def equations(b: Any, t: float) -> Any:
        x, u = [b.x_0[t], b.x_1[t], b.x_2[t]], b.u_0[t]
        return {f"x_{i}": sum(A[i, j] * x[j] for j in range(3) if A[i, j]) + (u if i == 1 else 0.0) for i in range(3)}

    b.ode(equations)
    cost = b.integral(lambda b, t: b.x_0[t] ** 2 + b.x_1[t] ** 2 + b.x_2[t] ** 2 + b.u_0[t] ** 2)
    m.cost = pyo.Objective(expr=cost + (b.gain_fast - 0.3) ** 2 + (b.gain_slow - 0.3) ** 2)
    return m


@pytest.mark.parametrize("bounds", [None, lambda t: None], ids=["None", "function"])
def test_none_means_no_bounds_as_in_pyomo(bounds: Any) -> None:
    m, b = one_phase("go", duration=1.0, elements=2)
    b.x, b.u, b.z = rcp.State(bounds=bounds), rcp.Control(bounds=bounds), rcp.Algebraic(bounds=bounds)
    b.c = rcp.Control(bounds=bounds, parametrization="piecewise_constant")
    b.gain = rcp.Parameter(bounds=bounds)
    b.v = rcp.State(index=2, bounds=None)
    assert all(variable.bounds == (None, None) for variable in m.component_data_objects(pyo.Var))
    b.on = rcp.Control(integer=(0, 2), bounds=None)
    b.w = rcp.State(index=2, bounds=[None, (0, 1)])
    assert b.on_per_element[0].bounds == (0, 2)
    assert [b.component(f"w_{i}")[0.0].bounds for i in range(2)] == [(None, None), (0, 1)]


def test_a_vector_has_the_variables_rows_and_values_of_its_components() -> None:
    vector, scalars = as_vector(), as_scalars()
    names = [variable.name for variable in vector.component_data_objects(pyo.Var)]
    assert names == [variable.name for variable in scalars.component_data_objects(pyo.Var)]
    for one, other in zip(vector.component_data_objects(pyo.Var), scalars.component_data_objects(pyo.Var), strict=True):
        assert (one.value, one.bounds, one.fixed) == (other.value, other.bounds, other.fixed)
    rows = [(row.name, pyo.value(row.body)) for row in vector.component_data_objects(pyo.Constraint)]
    others = [(row.name, pyo.value(row.body)) for row in scalars.component_data_objects(pyo.Constraint)]
    assert [name for name, _ in rows] == [name for name, _ in others]
    assert [number for _, number in rows] == pytest.approx([number for _, number in others], abs=1e-12)
    assert pyo.value(vector.cost) == pytest.approx(pyo.value(scalars.cost), rel=1e-12)


@pytest.mark.parametrize("copied", [lambda m: m, lambda m: m.clone(), lambda m: pickle.loads(pickle.dumps(m))])
def test_labels_slices_and_collections_lead_to_the_same_variables(copied: Callable[[Any], Any]) -> None:
    m = as_vector()
    twin = copied(m)
    b, t = twin.go, m.go.points.at(3)
    assert (b.x[2, t] is m.go.x[2, t]) == (twin is m)
    assert b.x[1, t] is b.x_1[t]
    assert [entry.expression for entry in b.x[t]] == [b.x_0[t], b.x_1[t], b.x_2[t]]
    assert [entry.expression for entry in b.x[1:, t]] == [b.x_1[t], b.x_2[t]]
    assert b.gain["slow"] is b.gain_slow
    assert dict(b.x.items())[2, t] is b.x_2[t]
    assert len(b.x) == 3 * len(b.time)
    assert b.x.shape == (3,)


def test_what_is_simulated_is_the_matrix_exponential() -> None:
    m = as_vector()
    start = np.array([0.3, -0.2, 0.9])
    for method in ("DOP853", "scheme"):
        found = m.go.simulate(controls={"u": 0.0}, initial={"x": start}, method=method)
        assert found.x.shape == (3, len(found.time))
        expected = np.array([expm(A * t) @ start for t in found.time]).T
        assert np.abs(found.x - expected).max() < (1e-8 if method == "DOP853" else 1e-4)
        assert found(1.0)["x"] == pytest.approx(expm(A) @ start, abs=1e-3)
        assert found.verify().defect < (1e-2 if method == "DOP853" else 1e-8)


@given(st.lists(st.floats(-2, 2), min_size=12, max_size=12))
def test_a_matrix_keeps_its_rows_and_columns(numbers: list[float]) -> None:
    given_array = np.array(numbers).reshape(3, 4)
    _, b = one_phase("go", duration=1.0, elements=1, scheme="implicit_euler")
    b.X = rcp.State(index=[range(3), range(4)], initial=given_array, initial_guess=given_array)
    assert b.X.shape == (3, 4)
    for i in range(3):
        for j in range(4):
            assert b.X[i, j, 0.0].value == given_array[i, j]
    read = [[pyo.value(entry) for entry in row] for row in b.X[0.0]]
    assert np.array(read) == pytest.approx(given_array)


def test_a_matrix_equation_keeps_its_invariant() -> None:
    # X' = K X with K skew: the rows turn, and X^T X stays.
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    m, b = one_phase("go", duration=1.0, elements=3)
    m.pairs = pyo.Set(initialize=[0, 1]) * pyo.Set(initialize=[0, 1])
    b.X = rcp.State(index=m.pairs, initial=np.eye(2))
    b.ode(lambda b, t: {b.X: turn @ b.X[t]})
    end = b.simulate().X[..., -1]
    assert end == pytest.approx(np.array([[np.cos(1), -np.sin(1)], [np.sin(1), np.cos(1)]]), abs=1e-8)


def test_guesses_of_every_form_reach_the_components() -> None:
    b = as_vector().go
    times = np.array(b.grid.times)
    along = np.array([np.sin(times), np.cos(times), times])
    for guess in (along, along.T, lambda t: np.array([np.sin(t), np.cos(t), t]), dict(enumerate(along))):
        b.initialize(u=0.0, x=0.0)
        b.initialize(x=guess)
        found = np.array([[b.x[i, t].value for t in times] for i in range(3)])
        assert found[:, 1:] == pytest.approx(along[:, 1:])


def test_derivatives_and_step_maps_of_vectors_are_arrays() -> None:
    _, b = one_phase("go", duration=1.0, elements=3, scheme="implicit_euler", x=rcp.State(index=2, initial=[1.0, 2.0]))
    b.w = rcp.State(index=2, initial=0.0)

    b.residual(lambda b, t: b.derivative(b.x)[t] + b.x[t] == 0, name="decay")
    b.step_map(lambda b, t, previous: {b.w: previous.w + b.x[t]})
    found = b.simulate()
    euler = np.array([[1.0], [2.0]]) * (1 + 1 / 3) ** -np.arange(4.0)
    assert found.x == pytest.approx(euler)
    assert found.w[:, -1] == pytest.approx(euler[:, 1:].sum(axis=1))


def test_links_continue_and_jump_by_vectors() -> None:
    m = pyo.ConcreteModel()
    for name in ("first", "second"):
        m.add_component(name, rcp.PhaseBlock(duration=1.0, elements=2))
        b = m.component(name)
        b.x = rcp.State(index=2)
        b.v = rcp.State(index=2)
        b.ode(lambda b, t: {b.x: b.v[t], b.v: [0.0, -9.81]})
    m.bounce = rcp.Link(m.first, m.second, jump=lambda pre, post: {"v": np.diag([1.0, -0.5]) @ pre.v})
    assert [m.bounce.continuity[name].active for name in ("x_0", "x_1")] == [True, True]
    assert len(m.bounce.jump) == 2
    start = m.bounce.start_after(m.first.simulate(initial={"x": [0, 5], "v": [1, 0]}))
    assert [start[name] for name in ("x_0", "x_1", "v_0", "v_1")] == pytest.approx([1, 5 - 9.81 / 2, 1, 9.81 / 2])


def test_archives_keep_what_belongs_together(tmp_path: Path) -> None:
    found = as_vector().go.simulate(controls={"u": 0.0})
    read = rcp.Trajectory.load(found.save(tmp_path / "found.npz"))
    assert read.x == pytest.approx(found.x)
    assert read(0.7)["x"] == pytest.approx(found(0.7)["x"])
    joined = rcp.join_trajectories([found])
    assert joined.x == pytest.approx(found.x)


def test_all_variables_of_a_vector_are_fixed_and_bounded_at_once() -> None:
    b = as_vector().go
    b.u.fix(0.25)
    assert all(variable.fixed and variable.value == 0.25 for variable in b.u_0.values())
    b.u.unfix()
    b.x.setub(2.0)
    assert {variable.ub for variable in b.x.values()} == {2.0}
    assert [pyo.value(entry) for entry in -b.gain] == [-0.5, -0.7]


def state(**options: Any) -> Callable[[Any], None]:
    def declare(b: Any) -> None:
        b.y = rcp.State(**options)

    return declare


@pytest.mark.parametrize(
    ("act", "error", "message"),
    [
        (state(index=3, initial=[1, 2]), ModelError, r"'y' .*initial value: has shape \(2,\).*Give 3 entries"),
        (state(index=2, initial=(0, 1)), ModelError, "an interval for both components, or one number for each"),
        (state(index=3, bounds=[(0, 1), (0, 2)]), ModelError, r"Give 3 pairs"),
        (state(index=["a", "b"], initial={"a": 1, "c": 2}), ModelError, "has the labels a, c"),
        (state(index="ab"), ModelError, "index = 'ab'"),
        (state(index=[]), ModelError, "none, or not all different"),
        (state(index=2, initial=[0, np.nan]), ModelError, "y_1"),
        (lambda b: b.ode(lambda b, t: {b.x: [1, 2]}), ModelError, "gives for 'x': .*3 entries"),
        (lambda b: b.initialize(x=[1, 2]), InitialGuessError, r"given for 'x': has shape \(2,\)"),
        (lambda b: b.x[3, 0.0], ModelError, "labels are 0, 1, 2"),
        (lambda b: A @ b.x, ModelError, r"Is an index \[t\] missing"),
    ],
)
def test_wrong_lengths_are_refused_by_name_and_leave_nothing(
    act: Callable[[Any], Any], error: type[Exception], message: str
) -> None:
    _, b = one_phase("go", duration=1.0, elements=2, x=rcp.State(index=3))
    with unchanged(contents, b), pytest.raises(error, match=message):
        act(b)
    assert not hasattr(b, "y")


def test_a_component_of_a_vector_is_asked_by_its_name_and_a_number_in_brackets_is_a_time() -> None:
    _, b = one_phase("go", duration=2.0, elements=2, x=rcp.State(index=["left", "right"], history=0.0))
    b.y = rcp.State(index=[1, 7], history=0.0)
    assert b.x["left"] is b.x_left
    assert b.x["left"][2.0] is b.x["left", 2.0]
    assert b.x["right"].at_end is b.x.at_end[1].expression
    with pytest.raises(ModelError, match=r"\[7\], which is no time of the phase but a label.*b.y_7.at_end"):
        b.y[7]
    with pytest.raises(AttributeError, match=r"'at_end' is read from values at one time.*b.x_1.at_end"):
        _ = b.y[1].at_end
    assert not hasattr(b.y[1], "delayed")
    with pytest.raises(KeyError):
        b.x[0.123]
