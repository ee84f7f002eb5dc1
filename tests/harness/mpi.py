"""Scripts that two workers of MPI serve, and which tell what they know in a file."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

MPIEXEC = Path(sys.executable).with_name("mpiexec")
needs_mpiexec = pytest.mark.skipif(not MPIEXEC.exists(), reason="needs the mpiexec of the wheel of MPICH")


def on_three_ranks(script: Path, *arguments: object) -> int:
    """The code with which the job ends; what lies beside the script, and all tests, can be imported."""
    command = [str(MPIEXEC), "-n", "3", sys.executable, "-m", "mpi4py.futures", str(script), *map(str, arguments)]
    path = os.pathsep.join([*map(str, script.parents[:3]), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"}
    return subprocess.run(command, env=environment, timeout=900, check=False).returncode


def tell(folder: Path, what: Any) -> None:
    """Write what is known at the end."""
    (folder / "told.json").write_text(json.dumps(what))


def told(folder: Path) -> Any:
    """What the script has written."""
    return json.loads((folder / "told.json").read_text())
