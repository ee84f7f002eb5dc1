"""`solve_files`: a sweep over problem files, each point judged from the statement of its file."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.execution.engine import Engine
from pyrobocop_pyomo.files.file_formats import SUFFIXES, read_file
from pyrobocop_pyomo.solving import SolveResult

from .outcome_file import discard_outcomes
from .sweep import SweepResult, sweep


def solve_files(
    paths: str | Path | Iterable[str | Path],
    *,
    workers: int | str = 1,
    engine: str | Engine | None = None,
    file: str | Path | None = None,
    again: bool = False,
    time_limit: float | None = None,
    time_limit_per_file: float | None = None,
    progress: bool | None = None,
    **options: Any,
) -> SweepResult:
    """Solve problems in files.

    The command line does the same: ``python -m pyrobocop_pyomo solve FOLDER``.

    Parameters
    ----------
    paths : str, Path or iterable
        Files that `rcp.files.read_file` reads, and folders, in which such files are looked for.
    workers, engine, time_limit, progress
        As of `sweep`.
    file : str or Path, optional
        Where results are written as they come. A file that is in it is not solved again, unless it or the options have
        changed since.
    again : bool
        Whether such results are thrown away first.
    time_limit_per_file : float, optional
        Seconds.
    **options
        Passed to `solve`.

    Returns
    -------
    SweepResult
        With an outcome per file: what `solve` says, and as its ``numbers`` what the statement of the file says of the
        point (``checked`` for its objective, ``violation``, ``natural``, see `FilePoint`) and the seconds of processors
        (``cpu``), reading included.

    Raises
    ------
    ModelError
        When there are no files.
    CheckpointError
        When the results are of other options.
    EngineError, SolverNotFoundError
        As of `sweep`.
    """
    given = [paths] if isinstance(paths, (str, Path)) else list(paths)
    found = {name: path for start in given for name, path in _files_in(Path(start)).items()}
    if not found:
        raise ModelError(f"no {' or '.join(SUFFIXES)} files in {', '.join(map(str, given)) or 'nothing'}.")
    if again and file is not None:
        discard_outcomes(file)
    cases = {name: (str(path.resolve()), zlib.crc32(path.read_bytes())) for name, path in found.items()}
    return sweep(
        _OpenedFile, cases, read=_checked, start_from=None, workers=workers, engine=engine, file=file,
        time_limit=time_limit, time_limit_per_case=time_limit_per_file, progress=progress, **options,
    )  # fmt: skip


def _files_in(path: Path) -> dict[str, Path]:
    """The files by their names; in a folder these say where in it they are."""
    if not path.is_dir():
        return {str(path): path}
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
