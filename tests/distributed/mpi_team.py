"""Run by `mpiexec`: a team with a checkpoint after every round, and a death where it is asked for."""

import json
import os
import signal
import sys
from pathlib import Path

from pushing_team import pushing_team

import pyrobocop_pyomo as rcp


def main(folder: Path, death: int) -> None:
    """Plan, or go on from the file."""
    engine = rcp.teams.MpiEngine()

    def die(record: rcp.teams.Round) -> None:
        if record.number == death and engine.communicator.rank == 1:
            os.kill(os.getpid(), signal.SIGKILL)

    result = pushing_team().solve(
        rcp.teams.Hub(rounds=8), engine=engine, checkpoint=folder / "team.npz", on_round=die, progress=False
    )
    told = {name: values.tolist() for name, values in result.values.items()}
    (folder / f"rank{engine.communicator.rank}.json").write_text(json.dumps([len(result.rounds), told]))


main(Path(sys.argv[1]), int(sys.argv[2]))
