"""MPI: every rank comes to the same reports as one process alone; a death ends the job, which goes on from its file."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from tiny_agents import SPECS, play

from pyrobocop_pyomo.execution.serial_engine import SerialEngine

pytest.importorskip("mpi4py")
MPIEXEC = Path(sys.executable).with_name("mpiexec")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not MPIEXEC.exists(), reason="needs the mpiexec of the wheel of MPICH"),
]


def run(folder: Path, death: int) -> int:
    script = Path(__file__).with_name("mpi_script.py")
    command = [str(MPIEXEC), "-n", "2", sys.executable, "-m", "mpi4py", str(script), str(folder), str(death)]
    path = os.pathsep.join(filter(None, [str(Path(__file__).parent), os.environ.get("PYTHONPATH")]))
    ended = subprocess.run(command, env={**os.environ, "PYTHONPATH": path}, timeout=900, check=False)
    return ended.returncode


def test_a_killed_job_goes_on_from_its_file_to_the_same_reports(tmp_path: Path) -> None:
    serial = SerialEngine()
    serial.start(SPECS)
    expected = play(serial, 8)
    assert run(tmp_path, death=5) != 0
    assert [path.name for path in tmp_path.iterdir()] == ["team.npz"]
    assert run(tmp_path, death=-1) == 0
    told = [(tmp_path / f"rank{rank}.json").read_text() for rank in range(2)]
    assert told[0] == told[1]
    first, ranks, history, failed, shifted = json.loads(told[0])
    assert (first, ranks, failed) == (4, 2, "ArithmeticError: log(-1)")
    expected[4].pop("hub")
    assert history == json.loads(json.dumps(expected[4:]))
    assert shifted == expected[-1]["b"][0][-1]
