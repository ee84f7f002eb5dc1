"""A team goes on from its file as if it had never stopped, or says why it cannot."""

import contextlib
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from tiny_agents import SPECS, TinySpec, missing_data

from pyrobocop_pyomo.distributed.team_result import Checkpoint
from pyrobocop_pyomo.errors import ModelError, TeamError
from pyrobocop_pyomo.execution.tasks import fingerprint

ARRAYS = hnp.arrays(
    st.sampled_from([np.float64, np.int64, np.bool_]), hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4)
)
GROUPS = st.dictionaries(st.text(max_size=12), ARRAYS, max_size=3)


def same(one: dict, other: dict) -> bool:
    return list(one) == list(other) and all(
        a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
        for a, b in zip(one.values(), other.values(), strict=True)
    )


@given(
    number=st.integers(0, 1000),
    states=st.dictionaries(st.text(max_size=12), GROUPS, max_size=3),
    coordinator=GROUPS,
)
@settings(max_examples=25)
def test_round_trip(tmp_path_factory: pytest.TempPathFactory, number: int, states: dict, coordinator: dict) -> None:
    """Any names, types and shapes."""
    path = tmp_path_factory.getbasetemp() / "round_trip.npz"
    saved = Checkpoint(number, "f" * 64, states, coordinator)
    assert saved.save(path) == path
    read = Checkpoint.load(path, "f" * 64)
    assert (read.round, read.fingerprint) == (number, "f" * 64)
    assert list(read.states) == list(states)
    assert all(same(read.states[name], states[name]) for name in states)
    assert same(read.coordinator, coordinator)


def test_a_file_is_replaced_at_once_or_not_at_all(tmp_path: Path) -> None:
    path = Checkpoint(1, "a", {"x": {"v": np.ones(3)}}).save(tmp_path / "team.npz")
    with pytest.raises(TeamError, match="cannot be saved"):
        Checkpoint(2, "a", {"x": {"v": np.array([{}], dtype=object)}}).save(path)
    assert Checkpoint.load(path).round == 1
    assert [file.name for file in tmp_path.iterdir()] == ["team.npz"]


def test_a_file_of_another_team_is_refused(tmp_path: Path) -> None:
    path = Checkpoint(1, fingerprint(SPECS), {"hub": {}}).save(tmp_path / "team.npz")
    others = (replace(SPECS[0], data=(9, 5)), *SPECS[1:])
    with pytest.raises(TeamError, match="written by another team .* its agents are hub"):
        Checkpoint.load(path, fingerprint(others))


def test_what_is_no_checkpoint(tmp_path: Path) -> None:
    path = tmp_path / "team.npz"
    with pytest.raises(TeamError, match="no checkpoint can be read"):
        Checkpoint.load(path)
    path.write_bytes(b"no archive")
    with pytest.raises(TeamError, match="no checkpoint can be read"):
        Checkpoint.load(path)


@given(st.data())
@settings(max_examples=60)
def test_damaged_files_are_told_or_harmless(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    """Bytes cut off or changed: an error of ours, or a file that reads the same."""
    path = tmp_path_factory.getbasetemp() / "damaged.npz"
    values = np.arange(40.0)
    whole = Checkpoint(3, "f", {"a": {"x": values}}).save(path).read_bytes()
    at = data.draw(st.integers(0, len(whole) - 1))
    cut = whole[:at] if data.draw(st.booleans()) else whole[:at] + bytes([whole[at] ^ 0x55]) + whole[at + 1 :]
    path.write_bytes(cut)
    with contextlib.suppress(TeamError):
        assert np.array_equal(Checkpoint.load(path, "f").states["a"]["x"], values)


def test_nothing_is_unpickled(tmp_path: Path) -> None:
    path = tmp_path / "team.npz"
    np.savez(path, header=np.array([SPECS[0]], dtype=object))
    with pytest.raises(TeamError, match="allow_pickle=False"):
        Checkpoint.load(path)


def closing_over(size: int) -> Callable[[], np.ndarray]:
    return lambda: np.ones(size)


def test_fingerprints_tell_what_differs() -> None:
    data = {"mass": 2.0, "sides": (1, 2), "shape": np.ones((2, 3))}
    variants = [
        data,
        {**data, "mass": 2.0000000000000004},
        {**data, "mass": 2},
        {**data, "sides": (12,)},
        {**data, "shape": np.ones((3, 2))},
        {**data, "shape": np.ones((2, 3), dtype=np.float32)},
        {**data, "more": None},
    ]
    prints = [fingerprint([TinySpec("a", data=(variant,))]) for variant in variants]
    prints += [fingerprint([TinySpec("b", data=(data,))]), fingerprint([TinySpec("a", missing_data, (data,))])]
    prints += [fingerprint([TinySpec("a", partial(missing_data, 1), (data,))]), fingerprint([])]
    prints += [fingerprint([TinySpec("a", lambda size=size: np.ones(size), ())]) for size in (1, 2)]
    prints += [fingerprint([TinySpec("a", closing_over(size), ())]) for size in (1, 2)]
    assert len(set(prints)) == len(prints)
    same = {**data, "mass": np.float64(2.0), "sides": [1, 2], "shape": np.ones((2, 3))}
    assert prints[0] == fingerprint([TinySpec("a", data=(same,))])
    with pytest.raises(ModelError, match="has no fingerprint"):
        fingerprint([TinySpec("a", data=(object(),))])


@pytest.mark.heavy
def test_fingerprints_of_an_example_are_the_same_whatever_the_hashes_of_texts_are() -> None:
    code = (
        f"import sys; sys.path[:0] = [{str(Path(__file__).parent)!r}]\n"
        "from pushing_team import pushing_team\n"
        "from pyrobocop_pyomo.execution.tasks import fingerprint\n"
        "from pyrobocop_pyomo.teams import Hub\n"
        "print(fingerprint([*pushing_team().problem_specs(), Hub()]))"
    )
    found = {
        subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            timeout=900,
            check=True,
        ).stdout
        for seed in ("1", "2")
    }
    assert len(found) == 1
