"""Run by `mpiexec`: the studies of `test_studies_on_engines.py` on two ranks, with a file of outcomes."""

import json
import sys
from functools import partial
from pathlib import Path

import pyrobocop_pyomo as rcp
from tests.studies.test_studies_on_engines import PULLS, numbers, put_and_die, spring, started, swept


def main(folder: Path) -> None:
    """Write what each rank knows."""
    engine = rcp.teams.MpiEngine()
    told = [swept(engine), started(engine)]
    file = folder / "outcomes.jsonl"
    put = partial(put_and_die, None, 0)
    found = rcp.sweep(spring, PULLS, put=put, read=numbers, engine=engine, file=file, time_limit=100.0)
    told.append(
        [[o.name, o.verdict, o.objective, o.numbers, o.values, o.iterations, o.started_from, o.reason] for o in found]
    )
    (folder / f"rank{engine.communicator.rank}.json").write_text(json.dumps(told))


main(Path(sys.argv[1]))
