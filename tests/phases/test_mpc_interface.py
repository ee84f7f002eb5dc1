"""A phase for `pyomo.contrib.mpc`: series leave and come back, also to another mesh."""

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import each_scheme, one_phase
from pyomo.contrib.mpc import DynamicModelInterface, TimeSeriesData

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import InitialGuessError, TrajectoryError

MODELS: list[pyo.ConcreteModel] = []  # a block does not keep its model


def cart(elements: int = 4, duration: Any = 2.0, scheme: Any = "radau", held: bool = False) -> Any:
    m, b = one_phase("cart", duration=duration, elements=elements, scheme=scheme)
    b.x = rcp.State(initial_guess=lambda t: 1 + t)
    b.u = rcp.Control(initial_guess=lambda t: 2 * t, parametrization="piecewise_constant" if held else "collocated")
    b.k = rcp.Parameter(initial_guess=3)
    MODELS.append(m)
    return b


@each_scheme
def test_a_series_over_the_points_leaves_and_comes_back(scheme: Any) -> None:
    b = cart(scheme=scheme)
    series = b.interface().get_data_at_time()
    assert isinstance(series, TimeSeriesData)
    assert {str(key) for key in series.get_data()} == {"cart.x[*]", "cart.u[*]"}
    assert series.get_data_from_key(b.u[:]) == pytest.approx([2 * t for t in b.points])
    assert {str(key): each for key, each in b.interface().get_scalar_variable_data().items()} == {"cart.k": 3.0}
    fresh = cart(scheme=scheme)
    fresh.initialize(x=0, u=0)
    fresh.interface().load_data(b.trajectory().to_time_series())
    assert [v.value for v in fresh.x.values()] == pytest.approx([1 + t for t in fresh.time])
    assert [v.value for v in fresh.u.values()] == pytest.approx([2 * t for t in fresh.points])


def test_pyomos_own_interface_sees_the_states_and_that_of_the_phase_everything() -> None:
    b = cart()
    own = DynamicModelInterface(b.model(), b.time)
    assert {str(key) for key in own.get_data_at_time().get_data()} == {"cart.x[*]"}
    own.load_data(cart().trajectory().to_time_series().extract_variables([b.x[:]]))
    assert {str(key) for key in b.interface().get_data_at_time().get_data()} == {"cart.x[*]", "cart.u[*]"}


def test_a_series_is_interpolated_onto_another_mesh() -> None:
    b = cart(7)
    b.initialize(x=0, u=0)
    b.interface().load_data(cart(3).trajectory().to_time_series())
    assert [v.value for v in b.x.values()] == pytest.approx([1 + t for t in b.time])
    assert [v.value for v in b.u.values()] == pytest.approx([2 * t for t in b.points])
    held = cart(2, held=True)
    held.interface().load_data(cart(3).trajectory().to_time_series())
    assert [v.value for v in held.u_per_element.values()] == pytest.approx([1, 3])


def test_the_rest_of_the_interface_is_pyomos() -> None:
    b = cart()
    interface = b.interface()
    at = interface.get_data_at_time(b.points.last())
    assert at.get_data_from_key("cart.u[*]") == pytest.approx(4.0)
    interface.load_data(at, time_points=[b.points.first()])
    assert b.u[b.points.first()].value == pytest.approx(4.0)
    interface.copy_values_at_time(b.points.last(), b.points.first())
    assert b.x[b.points.first()].value == pytest.approx(3.0)
    interface.shift_values_by_time(0.5)
    assert b.u[b.points.at(4)].value == pytest.approx(2 * b.points.at(7))
    indices, penalty = interface.get_penalty_from_target({b.x[:]: 1.0})
    b.add_component("indices", indices)
    b.add_component("penalty", penalty)
    assert set(penalty.index_set()) == {(0, t) for t in b.points}
    free = cart(duration=rcp.Duration(bounds=(1, 3))).interface()
    assert {str(key) for key in free.get_scalar_variable_data()} == {"cart.k", "cart.duration"}


def test_what_does_not_fit_is_refused() -> None:
    b = cart()
    with pytest.raises(
        InitialGuessError, match=r"has the key 'cart.z\[\*\]'; the phase has cart.x\[\*\], cart.u\[\*\]"
    ):
        b.interface().load_data(TimeSeriesData({"cart.z[*]": [0, 1]}, [0, 2]))
    with pytest.raises(InitialGuessError, match=r"the series runs from 0 to 1; 'x' needs 0 to 2\. Shift"):
        b.interface().load_data(TimeSeriesData({"cart.x[*]": [0, 1]}, [0, 1]))


@each_scheme
@pytest.mark.parametrize("duration", [2.0, rcp.Duration(bounds=(1, 3), initial_guess=1.7)], ids=["fixed", "free"])
def test_a_trajectory_becomes_a_series_and_a_trajectory_again(scheme: Any, duration: Any) -> None:
    before = cart(duration=duration, scheme=scheme).trajectory()
    after = rcp.Trajectory.from_time_series(before.to_time_series(), like=before)
    assert (after.name, after.parameters, after.piecewise_constant) == ("cart", {"k": 3.0}, frozenset())
    np.testing.assert_allclose(after.x, before.x, atol=1e-14)
    np.testing.assert_allclose(after.u, before.u, atol=1e-14)


def test_a_series_of_unknown_origin_is_joined_by_lines_and_makes_a_guess() -> None:
    series = TimeSeriesData({"cart.x[*]": [0, 1, 0], "cart.u[*]": [4, 2, 0]}, [0, 1, 3])
    trajectory = rcp.Trajectory.from_time_series(series)
    assert trajectory([0.5, 2])["x"] == pytest.approx([0.5, 0.5])
    b = cart(duration=6.0)
    b.initialize(trajectory)
    assert [v.value for v in b.u.values()] == pytest.approx([np.interp(t / 2, [0, 1, 3], [4, 2, 0]) for t in b.points])


@pytest.mark.parametrize(
    ("series", "message"),
    [
        (3.0, "a float is no time series"),
        (TimeSeriesData({"cart.x[*]": [0]}, [0]), r"with the times \[0.0\]; two or more"),
        (TimeSeriesData({"cart.x[*]": [0, None]}, [0, 1]), r"no finite value of 'cart.x\[\*\]' at every time"),
        (TimeSeriesData({"a.x[*]": [0, 1], "b.x[*]": [0, 1]}, [0, 1]), "keys of 'a', 'b'; one trajectory"),
    ],
)
def test_a_series_that_is_no_trajectory_is_refused(series: Any, message: str) -> None:
    with pytest.raises(TrajectoryError, match=message):
        rcp.Trajectory.from_time_series(series)


def test_a_series_must_be_like_the_other_trajectory() -> None:
    before = cart().trajectory()
    with pytest.raises(TrajectoryError, match=r"has x at 13 times, trajectory 'cart' has x, u at 13; they must agree"):
        rcp.Trajectory.from_time_series(TimeSeriesData({"cart.x[*]": [0] * 13}, before.time.tolist()), like=before)


def test_a_data_set_of_xarray() -> None:
    pytest.importorskip("xarray")
    trajectory = cart().trajectory()
    data = trajectory.to_xarray()
    assert data.attrs == {"k": 3.0, "scheme": "radau(3)"}
    np.testing.assert_array_equal(data["time"], trajectory.time)
    np.testing.assert_array_equal(data["x"], trajectory.x)
    assert float(data["u"].interp(time=1.0)) == pytest.approx(2.0)
