"""Run by `mpiexec`: eight rounds with a checkpoint every second one, and the death of a worker where it is wanted."""

import sys
from pathlib import Path

import numpy as np
from harness.mpi import tell
from tiny_agents import SPECS, TinyOrder, play

from pyrobocop_pyomo.distributed.checkpoint import Checkpoint
from pyrobocop_pyomo.execution.engines import find_engine
from pyrobocop_pyomo.execution.fingerprints import fingerprint


def main(folder: Path, death: int) -> None:
    """Go on from the file, if there is one."""
    path = folder / "team.npz"
    with find_engine("mpi") as engine:
        engine.start(SPECS)
        first = 0
        if path.exists():
            checkpoint = Checkpoint.load(path, fingerprint(SPECS))
            engine.restore(checkpoint.states)
            first = checkpoint.round

        def before(number: int) -> None:
            if number % 2 == 0 and number > first:
                Checkpoint(number, fingerprint(SPECS), engine.states()).save(path)
            if number == death:
                engine.solve({"a": TinyOrder(np.ones(5), "die")})

        history = play(engine, 8, before, first)
        failed = engine.solve({"a": TinyOrder(np.ones(5), "raise")})["a"].reason
        tell(folder, [first, engine.workers, history, failed, engine.call_all("shift", {"b": (1,)})["b"]])


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
