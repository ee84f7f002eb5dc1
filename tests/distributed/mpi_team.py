"""Run by `mpiexec`: a team with a checkpoint after every round, and the death of a worker where it is wanted."""

import os
import sys
from pathlib import Path

from harness.mpi import tell
from pushing_team import pushing_team

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.execution.engines import find_engine


def main(folder: Path, death: int) -> None:
    """Plan, or go on from the file."""
    engine = find_engine("mpi")

    def die(record: rcp.teams.Round) -> None:
        if record.number == death:
            engine._executor.submit(os.abort).result()

    result = pushing_team().solve(
        rcp.teams.Hub(rounds=8), engine=engine, checkpoint=folder / "team.npz", on_round=die, progress=False
    )
    tell(folder, [len(result.rounds), {name: values.tolist() for name, values in result.values.items()}])


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
