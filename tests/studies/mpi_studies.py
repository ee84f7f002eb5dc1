"""Run by `mpiexec`: the studies of `test_studies_on_engines.py` with two workers, and with a file of outcomes."""

import sys
from functools import partial
from pathlib import Path

import pyrobocop_pyomo as rcp
from tests.harness.mpi import tell
from tests.studies.test_studies_on_engines import PULLS, numbers, put_and_die, rows, spring, started, swept


def main(folder: Path) -> None:
    """Write what is found."""
    put = partial(put_and_die, None, 0)
    file = folder / "outcomes.jsonl"
    found = rcp.sweep(spring, PULLS, put=put, read=numbers, engine="mpi", file=file, time_limit=100.0)
    tell(folder, [swept("mpi"), started("mpi"), rows(found)])


if __name__ == "__main__":
    main(Path(sys.argv[1]))
