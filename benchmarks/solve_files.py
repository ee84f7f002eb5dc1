"""Solve problems in .nl and .json files, each point judged from the statement of its file.

    python benchmarks/solve_files.py PATH ... [--workers N] [--time-limit SECONDS] [--results FILE]

Paths are files, and folders in which such files are looked for. ``checked``, ``violation`` and ``natural`` come from
the file's expressions at the point: the objective, the largest violation of a row or a bound, and the largest distance
from complementarity. A file with a result is not solved again unless it has changed. The exit code is 0 if every file
was solved.
"""

from __future__ import annotations

import argparse
import os
import sys
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from problem_files import SUFFIXES, read_file

from pyrobocop_pyomo.errors import ModelError, PyRobocopError
from pyrobocop_pyomo.execution.engine import Engine
from pyrobocop_pyomo.solving import SolveResult
from pyrobocop_pyomo.studies.outcomes import StudyResult
from pyrobocop_pyomo.studies.sweep import sweep


def solve_files(
    paths: str | Path | Iterable[str | Path],
    *,
    workers: int | str = 1,
    engine: str | Engine | None = None,
    file: str | Path | None = None,
    time_limit: float | None = None,
    time_limit_per_file: float | None = None,
    progress: bool | None = None,
    **options: Any,
) -> StudyResult:
    """Solve problems in files.

    Parameters
    ----------
    paths : str, Path or iterable
        Files that `read_file` reads, and folders, in which such files are looked for.
    workers, engine, time_limit, progress
        As of `sweep`.
    file : str or Path, optional
        Where results are written as they come. A file that is in it is not solved again, unless it or the options have
        changed since.
    time_limit_per_file : float, optional
        Seconds.
    **options
        Passed to `solve`.

    Returns
    -------
    StudyResult
        With an outcome per file: what `solve` says, and as its ``numbers`` what the statement of the file says of the
        point (``checked`` for its objective, ``violation``, ``natural``, see `FilePoint`) and the seconds of processors
        (``cpu``), reading included.

    Raises
    ------
    ModelError
        When there are no files, or a path leads nowhere.
    TeamError
        When the results are of other options.
    EngineError, SolverNotFoundError
        As of `sweep`.
    """
    given = [paths] if isinstance(paths, (str, Path)) else list(paths)
    found = {name: path for start in given for name, path in _files_in(Path(start)).items()}
    if not found:
        raise ModelError(f"no {' or '.join(SUFFIXES)} files in {', '.join(map(str, given)) or 'nothing'}.")
    cases = {name: (str(path.resolve()), zlib.crc32(path.read_bytes())) for name, path in found.items()}
    return sweep(
        _OpenedFile, cases, read=_checked, start_from=None, workers=workers, engine=engine, file=file,
        time_limit=time_limit, time_limit_per_case=time_limit_per_file, progress=progress, **options,
    )  # fmt: skip


def _files_in(path: Path) -> dict[str, Path]:
    """The files by their names; in a folder these say where in it they are."""
    if path.is_file():
        return {str(path): path}
    if not path.is_dir():
        raise ModelError(f"there is no file or folder '{path}'. Look at the name, and at where it starts from.")
    inside = sorted(each for each in path.rglob("*") if each.suffix in SUFFIXES and each.is_file())
    return {str(each.relative_to(path)): each for each in inside}


class _OpenedFile:
    """A problem, its model, and how long this process had worked before."""

    def __init__(self, case: tuple[str, int]) -> None:
        self.before = _processor_seconds()
        self.problem = read_file(case[0])
        self.model = self.problem.model()


def _checked(opened: _OpenedFile, result: SolveResult) -> dict[str, float]:
    point = opened.problem.check([variable.value for variable in opened.model.x.values()])
    return {
        "checked": point.objective, "violation": point.violation, "natural": point.natural,
        "cpu": _processor_seconds() - opened.before,
    }  # fmt: skip


def _processor_seconds() -> float:
    """Of this process and of those that it has started and that have ended, such as an executable of Ipopt."""
    return sum(os.times()[:4])


def main(arguments: list[str] | None = None) -> int:
    """Solve what the command line names, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("paths", nargs="+", metavar="PATH")
    parser.add_argument("--workers", default="1", help="number of processes, or 'all' cores (%(default)s)")
    parser.add_argument("--time-limit", type=float, metavar="SECONDS", help="for each file")
    parser.add_argument(
        "--results", default="results.jsonl", metavar="FILE", help="where results are kept as they come"
    )
    options = parser.parse_args(arguments)
    workers = int(options.workers) if options.workers.isdecimal() else options.workers
    try:
        result = solve_files(
            options.paths, workers=workers, time_limit_per_file=options.time_limit, file=options.results,
        )  # fmt: skip
    except PyRobocopError as error:
        sys.stderr.write(f"solve_files: {error}\n")
        return 1
    print(result)
    return 0 if result.reached else 1


if __name__ == "__main__":
    sys.exit(main())
