"""`sweep`: solve a model for many data, warm, in several processes, and so that it can go on after a stop.

`OutcomeFile`: outcomes of a sweep, each appended at once to a file of JSON lines, so that a sweep can go on.
"""

from __future__ import annotations

import json
import os
import time
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

from pyomo.core.base.block import BlockData

from pyrobocop_pyomo.errors import ModelError, TeamError
from pyrobocop_pyomo.execution.engine import Engine
from pyrobocop_pyomo.execution.tasks import GIVEN_UP, Make, Task, fingerprint, run_tasks, study_engine
from pyrobocop_pyomo.execution.worker_host import packed
from pyrobocop_pyomo.ipopt.backends import best_backend
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.modeling.rule_slips import takes_arguments
from pyrobocop_pyomo.modeling.variable_values import Values
from pyrobocop_pyomo.presentation.progress import Progress
from pyrobocop_pyomo.solving import Quality, StopReason
from pyrobocop_pyomo.solving.iterates import Standing

from .case_solver import CaseSolver, Put, Read
from .outcomes import Outcome, StudyResult
from .sweep_cases import SweepCase, doubts_on_cases, read_cases, starting_cases

# --------------------------------------------------------------------------------------------------- outcomes in a file


_HEAD = {"kind": "outcomes of a sweep", "format": 4}


class OutcomeFile:
    """A file of outcomes.

    A program that is killed leaves whole lines, and at most one broken one at the end, which is cut off when the sweep
    goes on. Each line has a checksum: what was damaged is told, not believed. Nothing in it is unpickled.

    Parameters
    ----------
    path : str or Path
        Made where it does not exist, together with its folder.
    sweep : mapping
        What a sweep that goes on has to share with the one that made the file: facts that fit into JSON.

    Attributes
    ----------
    records : dict of key to mapping
        What was in the file, by the key of the case.

    Raises
    ------
    TeamError
        When the file is something else, or of another sweep.
    """

    def __init__(self, path: str | Path, sweep: Mapping[str, Any]) -> None:
        self._path = Path(path)
        self.records: dict[str, Mapping[str, Any]] = {}
        head = {**_HEAD, **sweep}
        if self._path.exists() and self._path.stat().st_size:
            self._read(head)
        else:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._append(head)

    def _read(self, head: dict[str, Any]) -> None:
        content = self._path.read_bytes()
        whole = content.rfind(b"\n") + 1
        try:
            found, *lines = map(_facts_of, content[:whole].splitlines())
            self.records = {line.pop("key"): line for line in lines}
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise TeamError(
                f"{self._path}: no outcomes of a sweep can be read from it ({error}). Name another file, or remove it."
            ) from error
        different = [name for name in {**found, **head} if found.get(name) != head.get(name)]
        if different:
            raise TeamError(
                f"{self._path}: is of another sweep: {different[0]!r} is {found.get(different[0])!r} there and "
                f"{head.get(different[0])!r} here. Remove the file, or name another one."
            )
        if whole < len(content):
            with self._path.open("rb+") as file:
                file.truncate(whole)

    def append(self, key: str, record: Mapping[str, Any]) -> None:
        """Write the outcome of a case."""
        self._append({"key": key, **record})

    def _append(self, facts: Mapping[str, Any]) -> None:
        checksum = zlib.crc32(json.dumps(facts).encode())
        with self._path.open("ab") as file:
            file.write((json.dumps({**facts, "crc32": checksum}) + "\n").encode())
            file.flush()
            os.fsync(file.fileno())


def _facts_of(line: bytes) -> dict[str, Any]:
    """What a line holds.

    Raises
    ------
    ValueError
        When it is not what was written.
    """
    facts: dict[str, Any] = json.loads(line)
    if facts.pop("crc32", None) != zlib.crc32(json.dumps(facts).encode()):
        raise ValueError("a line is not what its checksum says")
    return facts


def outcome_to_json(outcome: Outcome) -> dict[str, Any]:
    """What a file keeps of an outcome: its numbers and words."""
    kept = {each.name: getattr(outcome, each.name) for each in fields(outcome) if each.name not in ("case", "result")}
    return {**kept, "standing": outcome.standing and asdict(outcome.standing)}


def outcome_from_json(case: SweepCase, facts: Mapping[str, Any]) -> Outcome:
    """The outcome of a case again, without its result."""
    return Outcome(case=case, **{**facts, "standing": facts["standing"] and Standing(**facts["standing"])})


# ---------------------------------------------------------------------------------------------------------------- sweep


def sweep(
    model: Any,
    cases: Iterable[Any] | Mapping[str, Any],
    *,
    put: Put | None = None,
    read: Read | None = None,
    start_from: str | Callable[[int], int | None] | None = "nearest",
    workers: int | str = 1,
    engine: str | Engine | None = None,
    file: str | Path | None = None,
    time_limit: float | None = None,
    time_limit_per_case: float | None = None,
    progress: bool | None = None,
    **options: Any,
) -> StudyResult:
    """Solve a model for many data.

    Each case begins with the model as it was given, so that no case leaves anything behind. It starts from the solution
    of a neighbour that is certified, on whose branch it goes on; where that does not end in a certified point, or where
    there is no such neighbour, it is solved from the initial guess as `solve` does it. A case that fails stays alone:
    those that would have started from it start from the neighbour before.

    Parameters
    ----------
    model : Block or callable
        A model; or a function that makes the model of a case, ``model(data)``; or, together with `put`, one without
        arguments that makes the model for all of them. A function may also return an object with an attribute
        ``model``, which `put` and `read` then get.
    cases : iterable, or mapping of name to case
        For a model: mappings such as ``{"mass": 2.0}`` (or pairs ``[(m.mass, 2.0)]``) of mutable Params and Vars, which
        are fixed; values are numbers, arrays in the order of the members, or mappings by index. For `put` and for
        builders: anything.
    put : callable, optional
        ``put(model, data)`` puts a case on the model: Params, values of fixed variables, bounds, fixings.
    read : callable, optional
        ``read(model, result)`` returns a mapping of names to numbers or arrays that are kept of the case.
    start_from : "nearest", callable or None
        From whose solution a case starts: by default that of the nearest case, along the shortest tree over the
        numbers of the cases; every eighth one in a row starts from the initial guess. Or a function from the number of
        a case to that of an earlier one, or to None. With None, all cases start from the initial guess.
    workers : int or "all"
        Number of processes, or one on each core; with 1 all is done in this one. More need a model that can be pickled,
        or a builder that stands at the top level of a module (or a `functools.partial` of such), the same for `put` and
        `read`, and a script whose work stands under ``if __name__ == "__main__":``. Where cloudpickle is not installed,
        functions of a notebook have to be imported from a file.
    engine : str or Engine, optional
        Where the cases are solved instead: ``"process"``, ``"dask"``, ``"mpi"`` or an object of `rcp.teams`, as for
        teams.
    file : str or Path, optional
        Where outcomes are written as they come. A sweep that finds its file goes on behind what is in it, also after a
        crash, and gives the same table.
    time_limit, time_limit_per_case : float, optional
        Seconds.
    progress : bool, optional
        Show how far it is; by default only on a terminal.
    **options
        Passed to `solve`. With others than ``options`` and tolerances no case starts from a neighbour's branch.

    Returns
    -------
    StudyResult
        Errors of single cases are in it, as their reason. The model is as it was.

    Raises
    ------
    ModelError
        When the arguments make no sense; nothing was solved then.
    TeamError
        When the file is of another sweep.
    EngineError
        When the engine is not installed, or none of its workers starts.
    SolverNotFoundError
        When there is no Ipopt.
    """
    running = study_engine(workers, engine)
    listed = read_cases(cases)
    if not isinstance(model, BlockData) and not callable(model):
        raise ModelError(f"expected a model or a function that builds one, not {type(model).__name__}.")
    if put is None and callable(model) and not isinstance(model, BlockData) and not takes_arguments(model, 1):
        raise ModelError(
            f"{getattr(model, '__name__', 'the builder')} cannot be called with the data of a case. Without put= it "
            "makes the model of each case, model(data): give it an argument, or give put=, which puts data on its one "
            "model."
        )
    parents = starting_cases(listed, start_from)
    best_backend()  # raises with the remedies where there is none, once and not for every case
    study = _Sweep(listed, parents, Deadline.after(time_limit), time_limit_per_case, Progress(progress))
    if file is not None:
        study.go_on_behind(file, options)
    local = CaseSolver(model, put, read, options) if running is None or isinstance(model, BlockData) else None
    try:
        if local is not None and put is None and isinstance(model, BlockData):
            for case in listed:
                local.put(case.data)  # refuses what does not fit before anything is solved
            local.close()
            study.doubts = doubts_on_cases(model, [case.data for case in listed])
        if running is not None:
            for label, sent in {"the model": model, "put": put, "read": read, "the options": options}.items():
                packed(label, sent, "workers=1")
        elsewhere: Make = partial(_solving, model, put, read, options)
        make = elsewhere if local is None or running is not None else lambda: local.solve
        run_tasks(
            study.tasks(), study.take, make=make, engine=running, most=len(listed), deadline=study.deadline,
        )  # fmt: skip
    finally:
        if local is not None:
            local.close()
    shared = local if local is not None and local.state is not None else None
    name = model.name if isinstance(model, BlockData) else getattr(model, "__name__", "sweep")
    return study.result(name, shared)


@dataclass
class _Sweep:
    """The state of one sweep, in the process that was asked for it."""

    cases: list[SweepCase]
    parents: list[int | None]
    deadline: Deadline
    limit: float | None
    progress: Progress
    doubts: tuple[str, ...] = ()
    done: dict[int, Outcome] = field(default_factory=dict)
    _file: OutcomeFile | None = None
    _keys: list[str] = field(default_factory=list)
    _begun: set[int] = field(default_factory=set)
    _started: float = field(default_factory=time.perf_counter)

    def go_on_behind(self, file: str | Path, options: Mapping[str, Any]) -> None:
        """Take what is in a file, and write there what comes."""
        seen: Counter[str] = Counter()  # equal cases are told apart; another case before them changes no key
        for case in self.cases:
            key = fingerprint([case.data])
            self._keys.append(f"{key}.{seen[key]}")
            seen[key] += 1
        self._file = OutcomeFile(file, {"options": fingerprint([{**options}])})
        for case, key in zip(self.cases, self._keys, strict=True):
            if key in self._file.records:
                self.done[case.number] = outcome_from_json(case, self._file.records[key])
        self._begun = set(self.done)
        if self.done:
            self.progress.line(f"{len(self.done)} of {len(self.cases)} cases are in {file}")

    # ---------------------------------------------------------------- the order of work

    def _near(self, number: int) -> tuple[int, Values] | None:
        """The solution to start from: that of the neighbour, or where it failed, of the neighbour's."""
        parent = self.parents[number]
        while parent is not None:
            outcome = self.done.get(parent)
            if outcome is not None and outcome.verdict == Quality.OPTIMAL.name.lower():
                return parent, outcome.values
            parent = self.parents[parent]
        return None

    def tasks(self) -> list[Task]:
        """Cases that are not begun, and whose neighbour is done."""
        ready = [
            number
            for number, parent in enumerate(self.parents)
            if number not in self._begun and (parent is None or parent in self.done)
        ]
        self._begun.update(ready)
        return [Task(number, (self.cases[number], self._near(number), self.limit)) for number in ready]

    def take(self, number: int, outcome: Outcome | None) -> list[Task] | None:
        """Keep an outcome."""
        outcome = outcome or Outcome.of(self.cases[number], None, GIVEN_UP)
        self.done[outcome.case.number] = outcome
        interrupted = outcome.result is not None and outcome.result.stop_reason is StopReason.INTERRUPTED
        # What Ctrl-C or the end of the time cut short is solved again by a sweep that goes on.
        if self._file is not None and not (interrupted or (outcome.cut_short and self.deadline.has_passed)):
            self._file.append(self._keys[outcome.case.number], outcome_to_json(outcome))
        done, count = len(self.done), len(self.cases)
        if outcome.error or not outcome.feasible:
            self.progress.line(f"{outcome.name}: {outcome.verdict}, {outcome.reason}")
        elapsed = time.perf_counter() - self._started
        failures = sum(not each.solved for each in self.done.values())
        left = elapsed / done * (count - done)
        self.progress.live(f"{done}/{count} cases, {failures} not solved, {elapsed:.0f} s, about {left:.0f} s left")
        return None if interrupted else self.tasks()

    def result(self, name: str, solver: CaseSolver | None) -> StudyResult:
        """What was found."""
        self.progress.live("")
        return StudyResult(
            name=name,
            outcomes=tuple(self.done[number] for number in sorted(self.done)),
            remaining=tuple(case.name for case in self.cases if case.number not in self.done),
            seconds=time.perf_counter() - self._started,
            _solver=solver,
            doubts=self.doubts,
        )


def _solving(*of_case_solver: Any) -> Callable[..., Outcome]:
    """What solves cases on a worker. It sends less back: rounds of safe planning are not worth their way."""
    solver = CaseSolver(*of_case_solver)

    def solve(*arguments: Any, deadline: Deadline) -> Outcome:
        outcome = solver.solve(*arguments, deadline=deadline)
        return outcome if outcome.result is None else replace(outcome, result=replace(outcome.result, rounds=()))

    return solve
