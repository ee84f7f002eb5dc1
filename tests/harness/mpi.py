"""Scripts on two ranks of MPI, which tell what they know in files."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

MPIEXEC = Path(sys.executable).with_name("mpiexec")
needs_mpiexec = pytest.mark.skipif(not MPIEXEC.exists(), reason="needs the mpiexec of the wheel of MPICH")


def on_two_ranks(script: Path, *arguments: object) -> int:
    """The code with which the job ends; what lies beside the script, and all tests, can be imported."""
    command = [str(MPIEXEC), "-n", "2", sys.executable, "-m", "mpi4py", str(script), *map(str, arguments)]
    path = os.pathsep.join([*map(str, script.parents[:3]), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"}
    return subprocess.run(command, env=environment, timeout=900, check=False).returncode


def told_by_both(folder: Path) -> Any:
    """What each rank has written, which is the same."""
    told = [(folder / f"rank{rank}.json").read_text() for rank in range(2)]
    assert told[0] == told[1]
    return json.loads(told[0])
