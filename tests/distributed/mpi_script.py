"""Run by `mpiexec`: eight rounds with a checkpoint every second one, and a death where it is asked for."""

import json
import os
import signal
import sys
from pathlib import Path

import numpy as np
from tiny_agents import SPECS, TinyOrder, play

from pyrobocop_pyomo.distributed.checkpoint import Checkpoint
from pyrobocop_pyomo.execution.fingerprints import fingerprint
from pyrobocop_pyomo.execution.mpi_engine import MpiEngine


def main(folder: Path, death: int) -> None:
    """Go on from the file, if there is one."""
    path = folder / "team.npz"
    with MpiEngine() as engine:
        engine.start(SPECS)
        first = 0
        if path.exists():
            checkpoint = Checkpoint.load(path, fingerprint(SPECS))
            engine.restore(checkpoint.states)
            first = checkpoint.round

        def before(number: int) -> None:
            if number % 2 == 0 and number > first:
                checkpoint = Checkpoint(number, fingerprint(SPECS), engine.states())
                if engine.writes_files:
                    checkpoint.save(path)
            if number == death and engine.communicator.rank == 1:
                os.kill(os.getpid(), signal.SIGKILL)

        history = play(engine, 8, before, first)
        failed = engine.solve({"a": TinyOrder(np.ones(5), "raise")})["a"].reason
        history[0].pop("hub")  # a rank may do as it likes with what it got
        told = json.dumps(
            [first, engine.communicator.size, history, failed, engine.call_all("shift", {"b": (1,)})["b"]]
        )
        (folder / f"rank{engine.communicator.rank}.json").write_text(told)


main(Path(sys.argv[1]), int(sys.argv[2]))
