"""MPI: the same reports as in one process alone; a death ends the job, which goes on from its file."""

import json
from pathlib import Path

import pytest
from harness.mpi import needs_mpiexec, on_three_ranks, told
from tiny_agents import undisturbed

pytest.importorskip("mpi4py")
pytestmark = [
    pytest.mark.slow,
    needs_mpiexec,
]


SCRIPT = Path(__file__).with_name("mpi_script.py")


def test_a_killed_job_goes_on_from_its_file_to_the_same_reports(tmp_path: Path) -> None:
    expected, _ = undisturbed(8)
    assert on_three_ranks(SCRIPT, tmp_path, 5) != 0
    assert [path.name for path in tmp_path.iterdir()] == ["team.npz"]
    assert on_three_ranks(SCRIPT, tmp_path, -1) == 0
    first, workers, history, failed, shifted = told(tmp_path)
    assert (first, workers, failed) == (4, 2, "ArithmeticError: log(-1)")
    assert history == json.loads(json.dumps(expected[4:]))
    assert shifted == expected[-1]["b"][0][-1]
