"""Run by `mpiexec`: a team with a checkpoint after every round, and the death of a worker where it is wanted."""

import os
import sys
from pathlib import Path

from harness.mpi import tell
from mpi4py.futures import MPIPoolExecutor
from pushing_team import pushing_team

import pyrobocop_pyomo as rcp


def main(folder: Path, death: int) -> None:
    """Plan, or go on from the file."""
    executor = MPIPoolExecutor()

    def die(record: rcp.teams.Round) -> None:
        if record.number == death:
            executor.submit(os.abort).result()

    result = pushing_team().solve(
        rcp.teams.Hub(rounds=8), engine=rcp.teams.ExecutorEngine(executor, workers=2),
        checkpoint=folder / "team.npz", on_round=die, progress=False,
    )  # fmt: skip
    tell(folder, [len(result.rounds), {name: values.tolist() for name, values in result.values.items()}])


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
