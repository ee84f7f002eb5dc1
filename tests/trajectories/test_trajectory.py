"""Trajectories: read by name, interpolate, leave and come back."""

from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import oscillators, with_phase
from hypothesis import given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError, TrajectoryError

SCHEMES = [rcp.schemes.radau(1), rcp.schemes.radau(3), rcp.schemes.gauss_legendre(1), rcp.schemes.gauss_legendre(4)]
each_scheme = pytest.mark.parametrize("scheme", SCHEMES, ids=str)


def polynomials(scheme: Any, *, free: bool = False) -> rcp.Trajectory:
    """A state of the scheme's degree, a control of one less, a held control, a parameter, a pair."""
    s = scheme.stages
    m = pyo.ConcreteModel()
    duration = rcp.Duration(bounds=(1, 3)) if free else 2.0
    m.p = b = rcp.PhaseBlock(duration=duration, start=1, elements=3, scheme=scheme)
    if free:
        b.duration.fix(2.0)
    b.x = rcp.State(initial_guess=lambda t: state(b, t, s))
    b.u = rcp.Control(initial_guess=lambda t: control(b, t, s), bounds=(0, None))
    b.held = rcp.Control(parametrization="piecewise_constant", initial_guess=[3, 1, 2])
    b.k = rcp.Parameter(initial_guess=0.1)

    def pair(b, t):
        return [rcp.complements(b.u[t] >= 0, b.x[t] + 1 >= 0)] if t != b.points.last() else []

    b.complementarity(pair)
    return b.trajectory()


def real(b: Any, t: float) -> float:
    return 1 + 2 * t if b.has_free_duration else t


def state(b: Any, t: float, s: int) -> float:
    return (real(b, t) / 2) ** s - real(b, t)


def control(b: Any, t: float, s: int) -> float:
    return 1 + (real(b, t) / 3) ** (s - 1)


@each_scheme
@pytest.mark.parametrize("free", [False, True])
def test_interpolation_reproduces_the_polynomials_of_the_scheme(scheme: Any, free: bool) -> None:
    trajectory, s = polynomials(scheme, free=free), scheme.stages
    times = np.linspace(1, 3, 101)
    values = trajectory(times)
    np.testing.assert_allclose(values["x"], (times / 2) ** s - times, atol=1e-12)
    np.testing.assert_allclose(values["u"], 1 + (times / 3) ** (s - 1), atol=1e-12)
    at_nodes = trajectory(trajectory.time)
    np.testing.assert_allclose(at_nodes["x"], trajectory.x, atol=1e-14)
    np.testing.assert_allclose(trajectory(trajectory.points)["u"], trajectory.u, atol=1e-14)
    # An element owns its end, and the first its start too.
    np.testing.assert_allclose(
        trajectory([1, 1.2, trajectory.grid.mesh.boundaries[1], 1.7, 2.9, 3])["held"], [3, 3, 3, 1, 2, 2], atol=1e-12
    )


def test_values_are_read_by_name() -> None:
    trajectory = polynomials(rcp.schemes.radau(2))
    assert trajectory.names == ["x", "u", "held"]
    assert trajectory.x is trajectory.states["x"]
    assert trajectory.u is trajectory.signals["u"]
    assert trajectory.k == 0.1
    assert trajectory.piecewise_constant == {"held"}
    assert (trajectory.time[0], trajectory.time[-1], trajectory.duration) == (1, 3, 2)
    assert isinstance(trajectory(1.5)["x"], float)
    assert trajectory([1.5])["x"].shape == (1,)
    (name,) = trajectory.pairs
    assert name == "pair[0]"
    np.testing.assert_array_equal(trajectory.pairs[name][0, :-1], trajectory.u[:-1])
    np.testing.assert_allclose(trajectory.pairs[name][1, :-1], trajectory(trajectory.points)["x"][:-1] + 1)
    assert np.isnan(trajectory.pairs[name][:, -1]).all()
    with pytest.raises(AttributeError, match="trajectory 'p' has no 'z'"):
        _ = trajectory.z


def with_expressions(scheme: Any, **values: Any) -> Any:
    """Expressions over the times and over the points, of degrees that the polynomials of the scheme have."""
    _, b = with_phase("p", duration=2.0, elements=3, scheme=scheme)
    b.x, b.u = rcp.State(initial_guess=lambda t: 1 + t), rcp.Control(initial_guess=3)
    b.l = rcp.Control(initial_guess=lambda t: t, parametrization="piecewise_linear")
    b.twice = pyo.Expression(b.time, rule=lambda b, t: 2 * b.x[t])
    b.power = pyo.Expression(b.points, rule=lambda b, t: b.u[t] ** 2)
    b.unknown = pyo.Expression(b.points)
    b.ends = pyo.Expression([0.0, 2.0], rule=lambda b, t: b.x[t])
    b.ode(lambda b, t: {b.x: b.u[t] - 2})
    b.initialize(**values)
    return b


@each_scheme
def test_expressions_over_time_are_read_as_states_and_controls_are(scheme: Any, tmp_path: Path) -> None:
    b = with_expressions(scheme)
    trajectory = b.trajectory()
    assert trajectory.names == ["x", "twice", "u", "l", "power", "unknown"]
    np.testing.assert_allclose(trajectory.twice, 2 * trajectory.x)
    np.testing.assert_allclose(trajectory["power"], np.full(trajectory.points.shape, 9.0))
    assert np.isnan(trajectory.unknown).all()
    assert (trajectory(0.7)["twice"], trajectory(0.7)["power"]) == pytest.approx((3.4, 9.0))
    assert trajectory.verify().largest_violation < 1e-12
    loaded = rcp.Trajectory.load(trajectory.save(tmp_path / "run"))
    assert (loaded.names, loaded.twice.tolist()) == (trajectory.names, trajectory.twice.tolist())
    assert "power" in repr(trajectory)
    assert b.simulate({"u": 4.0}).power == pytest.approx(np.full(trajectory.points.shape, 16.0))
    assert pyo.value(b.power[b.points.first()]) == 9.0


def test_expressions_are_in_tables_and_plots_and_not_in_what_is_set() -> None:
    pytest.importorskip("pandas")
    pytest.importorskip("matplotlib")
    b = with_expressions("radau")
    b.del_component("unknown")
    trajectory = b.trajectory()
    frame = trajectory.to_pandas()
    np.testing.assert_allclose(frame["twice"], 2 * frame["x"])
    axes = [axis for axis in trajectory.plot(["twice", "power"]).axes if axis.get_visible()]
    assert [axis.get_ylabel() for axis in axes] == ["twice", "power"]
    fresh = with_expressions("gauss", x=0, u=0)
    fresh.initialize(trajectory)
    assert [pyo.value(fresh.power[t]) for t in fresh.points] == pytest.approx([9.0] * len(fresh.points))
    with pytest.raises(ModelError, match=r"twice' is indexed by the times"):
        b.remesh(5)


@pytest.mark.parametrize("times", [0.9, 3.1, [1.5, -2], float("nan"), [1.5, float("inf")]])
def test_times_outside_are_refused(times: Any) -> None:
    wrong = next(t for t in np.atleast_1d(times) if not 1 <= t <= 3)
    with pytest.raises(TrajectoryError, match=rf"runs from 1 to 3; asked was t = {wrong:g}\."):
        polynomials(rcp.schemes.radau(2))(times)


def test_rounding_at_the_ends_is_forgiven_and_a_table_of_times_is_not() -> None:
    trajectory = polynomials(rcp.schemes.radau(2))
    assert trajectory(3 + 1e-12)["x"] == trajectory(3.0)["x"]
    with pytest.raises(TrajectoryError, match=r"times of shape \(1, 2\)"):
        trajectory([[1.0, 2.0]])


def test_a_value_that_is_missing_is_named() -> None:
    m = oscillators(elements=2)
    m.swing.x[1.5].value = None
    with pytest.raises(TrajectoryError, match=r"'swing.x\[1.5\]' has no value. Solve the model first"):
        m.swing.trajectory()


@each_scheme
def test_save_and_load_keep_every_bit(scheme: Any, tmp_path: Path) -> None:
    before = polynomials(scheme, free=True)
    path = before.save(tmp_path / "run.v1")
    assert path == tmp_path / "run.v1.npz"
    assert before.save(path) == path
    after = rcp.Trajectory.load(path)
    assert after.grid.times == before.grid.times
    assert after.grid.scheme.name == scheme.name
    for group in ("states", "signals", "pairs"):
        assert list(getattr(after, group)) == list(getattr(before, group))
        for name, values in getattr(before, group).items():
            assert getattr(after, group)[name].tobytes() == values.tobytes()
    assert (after.name, after.parameters, after.piecewise_constant) == (
        before.name,
        before.parameters,
        before.piecewise_constant,
    )
    assert after(1.234) == before(1.234)


def test_a_file_holds_no_pickle(tmp_path: Path) -> None:
    path = polynomials(rcp.schemes.radau(2)).save(tmp_path / "run")
    with ZipFile(path) as archive:
        for member in archive.namelist():
            array = np.load(archive.open(member), allow_pickle=False)
            assert array.dtype != object


def test_what_was_loaded_is_verified_by_a_phase_that_is_named(tmp_path: Path) -> None:
    phase = oscillators(elements=2).swing
    loaded = rcp.Trajectory.load(phase.trajectory().save(tmp_path / "run"))
    with pytest.raises(TrajectoryError, match=r"loaded from a file.* verify\(phase=\.\.\.\)"):
        loaded.verify()
    assert loaded.verify(phase=phase) == phase.trajectory().verify()


def write_archive(path: Path, header: str) -> None:
    with path.open("wb") as file:
        np.savez(file, header=np.array(header))


FOREIGN = {
    "not there": (lambda path: None, "No such file"),
    "empty": (lambda path: path.write_bytes(b""), "No data left"),
    "text": (lambda path: path.write_text("time,x\n0,1\n"), "no trajectory can be read"),
    "broken archive": (lambda path: path.write_bytes(b"PK\x03\x04 and nothing else"), "not a zip file"),
    "one array": (lambda path: np.save(path.open("wb"), np.zeros(3)), "no trajectory can be read"),
    "objects": (lambda path: np.save(path.open("wb"), np.array([{}])), "no trajectory can be read"),
    "other arrays": (lambda path: np.savez(path.open("wb"), x=np.zeros(3)), "header"),
    "no dict": (lambda path: write_archive(path, "[1]"), "no trajectory can be read"),
    "another format": (lambda path: write_archive(path, '{"format": 9}'), "format 9; this version reads format 1"),
    "no grid": (lambda path: write_archive(path, '{"format": 1, "facts": {}, "names": {}}'), "holds no trajectory"),
}


@pytest.mark.parametrize("case", FOREIGN)
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_a_foreign_file_is_refused(case: str, tmp_path: Path) -> None:
    make, message = FOREIGN[case]
    path = tmp_path / "foreign.npz"
    make(path)
    with pytest.raises(TrajectoryError, match=message) as caught:
        rcp.Trajectory.load(path)
    assert str(path) in str(caught.value)


@each_scheme
def test_a_data_frame_has_a_row_per_time(scheme: Any) -> None:
    pytest.importorskip("pandas")
    trajectory = polynomials(scheme)
    frame = trajectory.to_pandas()
    assert list(frame.columns) == ["x", "u", "held"]
    assert frame.index.name == "time"
    np.testing.assert_array_equal(frame.index, trajectory.time)
    np.testing.assert_allclose(frame["x"], trajectory.x, atol=1e-14)
    np.testing.assert_allclose(frame["u"], 1 + (trajectory.time / 3) ** (scheme.stages - 1), atol=1e-12)


@given(t=st.floats(1, 3))
def test_one_time_is_the_same_as_many(t: float) -> None:
    trajectory = HYPOTHESIS_TRAJECTORY
    assert {name: values[0] for name, values in trajectory([t, 2.0]).items()} == pytest.approx(trajectory(t), abs=1e-14)


HYPOTHESIS_TRAJECTORY = polynomials(rcp.schemes.radau(3))
