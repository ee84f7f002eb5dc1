"""Studies give the same results wherever their solves are done, and survive the death of a worker there."""

import json
import os
import signal
import sys
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from harness.mpi import needs_mpiexec, on_three_ranks, told
from test_sweep import PULLS, numbers, spring

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.execution.engines import dask_engine
from pyrobocop_pyomo.execution.tasks import GIVEN_UP

posix = pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL on Windows")


def put_and_die(folder: str | None, times: int, m: Any, pull: float) -> None:
    """Put a case on the model; the second case takes its worker down, so many times."""
    m.pull = pull
    if folder is not None and pull == PULLS[1]:
        died = len(list(Path(folder).iterdir()))
        if died < times:
            (Path(folder) / str(died)).touch()
            os.kill(os.getpid(), signal.SIGKILL)


def swept(engine: Any, folder: str | None = None, deaths: int = 0) -> list[Any]:
    put = partial(put_and_die, folder, deaths)
    return rows(rcp.sweep(spring, PULLS, put=put, read=numbers, engine=engine, progress=False))


def rows(found: Any) -> list[Any]:
    return [
        [o.name, o.verdict, o.objective, o.numbers, o.values, o.iterations, o.started_from, o.reason] for o in found
    ]


def started(engine: Any) -> list[Any]:
    m = spring()
    found = rcp.studies.multistart(m, 3, seed=2, engine=engine, strategies="tight", progress=False)
    assert m.x.value == found.best.values[0]
    assert found.remaining == ()
    return [[o.case.number, o.verdict, o.objective, o.values, o.iterations] for o in found]


@pytest.fixture(scope="module")
def serial() -> list[Any]:
    return [swept("serial"), started("serial")]


def engine_of(name: str) -> rcp.teams.Engine:
    if name == "dask":
        pytest.importorskip("distributed")
        return dask_engine(workers=2)
    return rcp.teams.ProcessEngine(workers=2)


@pytest.mark.casadi
@pytest.mark.slow
@pytest.mark.parametrize("name", ["process", "dask"])
def test_results_are_those_of_one_process(serial: list[Any], name: str) -> None:
    engine = engine_of(name)  # which starts anew for each study
    assert [swept(engine), started(engine)] == serial


@posix
@pytest.mark.casadi
@pytest.mark.slow
@pytest.mark.parametrize("name", ["process", "dask"])
def test_the_death_of_a_worker_changes_nothing_and_deaths_without_end_one_case(
    serial: list[Any], name: str, tmp_path: Path
) -> None:
    assert swept(engine_of(name), str(tmp_path), deaths=1) == serial[0]
    (tmp_path / "second").mkdir()
    lost = swept(engine_of(name), str(tmp_path / "second"), deaths=1000)
    assert lost[1][-1] == GIVEN_UP
    assert len(list((tmp_path / "second").iterdir())) == 3
    assert [verdict for _, verdict, *_ in lost] == ["optimal", "error", "optimal", "optimal"]
    assert [row[:4] for row in lost[:1]] == [row[:4] for row in serial[0][:1]]


@pytest.mark.casadi
@pytest.mark.slow
@needs_mpiexec
def test_workers_of_mpi_have_the_results_of_one_process(serial: list[Any], tmp_path: Path) -> None:
    pytest.importorskip("mpi4py")
    assert on_three_ranks(Path(__file__).with_name("mpi_studies.py"), tmp_path) == 0
    assert told(tmp_path) == json.loads(json.dumps([*serial, serial[0]]))
    assert len((tmp_path / "outcomes.jsonl").read_text().splitlines()) == 1 + len(PULLS)


def test_an_engine_and_a_number_of_workers_are_one_too_many() -> None:
    with pytest.raises(ModelError, match="workers = 3 and an engine: give one of them"):
        rcp.studies.multistart(spring(), 2, workers=3, engine="process")
