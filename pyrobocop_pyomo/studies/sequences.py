"""Sequences of modes: `mode_sequences` lists those that are allowed, `solve_sequences` solves and ranks them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

from pyrobocop_pyomo.errors import ModelError, SolveFailed, SolverNotFoundError
from pyrobocop_pyomo.execution.engine import Engine
from pyrobocop_pyomo.execution.sending import check_picklable
from pyrobocop_pyomo.execution.tasks import GIVEN_UP, Task, run_tasks, study_engine
from pyrobocop_pyomo.ipopt.backends import best_backend
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.phases import note_outcome
from pyrobocop_pyomo.solving import StopReason
from pyrobocop_pyomo.solving.iterate_log import ModelCheck
from pyrobocop_pyomo.solving.progress import Progress

from .outcomes import Column, Outcome, StudyResult, ranked, seconds_left, solve_as_given

ModeSequence = tuple[str, ...]
Allowed = Callable[[str, str], bool] | Mapping[str, Iterable[str]]


def mode_sequences(
    modes: Iterable[str], length: int | Iterable[int], *, allowed: Allowed | None = None
) -> list[ModeSequence]:
    """All sequences of modes of a length, or of several lengths, whose successions are allowed.

    Parameters
    ----------
    modes : iterable of str
        Their names; of a dictionary, its keys.
    length : int or iterable of int
        Number of modes in a sequence, such as ``3`` or ``range(1, 4)``.
    allowed : callable or mapping, optional
        ``allowed(before, after)`` says whether one mode may follow another; or {mode: the modes that may follow it}.
        By default every mode may follow every mode, itself included.

    Returns
    -------
    list of tuple of str
        The shortest first, otherwise in the order of ``modes``; an ordinary list, to be filtered further.

    Raises
    ------
    ModelError
        When a mode is named twice or is unknown, a length is not positive, or nothing is left.

    Examples
    --------
    >>> mode_sequences(["stick", "slip"], 2, allowed=lambda before, after: before != after)
    [('stick', 'slip'), ('slip', 'stick')]
    """
    names = list(modes)
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise ModelError(f"mode '{twice}' is named twice; each mode needs a name of its own.")
    lengths = [length] if isinstance(length, int) else sorted(set(length))
    for count in lengths:
        if not isinstance(count, int) or count < 1:
            raise ModelError(f"length = {count!r}; a sequence has at least one mode.")
    followers = {name: _followers(name, names, allowed) for name in names}
    sequences: list[ModeSequence] = []
    grown: list[ModeSequence] = [(name,) for name in names]
    # Grown one by one, and not filtered out of the product, whose size may explode where few successions are allowed.
    for count in range(1, max(lengths, default=0) + 1):
        if count > 1:
            grown = [(*sequence, name) for sequence in grown for name in followers[sequence[-1]]]
        if count in lengths:
            sequences += grown
    if not sequences:
        raise ModelError(f"no sequence of {', '.join(map(repr, names)) or 'no modes'} has the length {length!r}.")
    return sequences


def _followers(name: str, names: list[str], allowed: Allowed | None) -> list[str]:
    if allowed is None:
        return names
    if not isinstance(allowed, Mapping):
        return [other for other in names if allowed(name, other)]
    given = set(allowed.get(name, ()))
    unknown = sorted({*given, *allowed} - set(names))
    if unknown:
        raise ModelError(f"allowed= names the mode {unknown[0]!r}; the modes are {', '.join(map(repr, names))}.")
    return [other for other in names if other in given]


@dataclass(frozen=True, eq=False)
class SequenceOutcome(Outcome):
    """What became of one sequence.

    Attributes
    ----------
    sequence : tuple of str
    number : int
        Its place in the list that was given, from 0; it decides between equal objectives.
    """

    sequence: ModeSequence
    number: int

    @property
    def name(self) -> str:
        """The modes in one text."""
        return " - ".join(self.sequence)


@dataclass(frozen=True, eq=False, kw_only=True)
class SequenceRanking(StudyResult[SequenceOutcome]):
    """Outcomes, the best first: feasible ones by objective, then infeasible ones by violation, then errors.

    Where there are obstacles, plans that are proven safe come before all others that are feasible. Sequences that a
    time limit or Ctrl-C left undone are in `remaining`. No model is kept: `best_model` and `model` build it again.

    Attributes
    ----------
    build : callable
        What makes the model of a sequence.
    """

    build: Callable[..., Any] = field(repr=False)

    item = "sequence"

    @property
    def columns(self) -> tuple[Column, ...]:
        """The columns of all studies, behind the sequence in its width."""
        width = max([len("sequence"), *(len(outcome.name) for outcome in self.outcomes)])
        return (Column("sequence", width, lambda outcome: outcome.name), *super().columns)

    def outcome(self, sequence: Sequence[str]) -> SequenceOutcome:
        """The outcome of a sequence.

        Raises
        ------
        KeyError
            When it was not solved.
        """
        for outcome in self.outcomes:
            if outcome.sequence == tuple(sequence):
                return outcome
        raise KeyError(tuple(sequence))

    @cached_property
    def best_model(self) -> Any:
        """The model of the best sequence, with its solution.

        Raises
        ------
        SolveFailed
            When no sequence has a feasible point.
        """
        if not self.outcomes or not self.outcomes[0].feasible:
            raise SolveFailed(f"no sequence has a feasible point.\n{self}", self)
        return self.model(self.outcomes[0].sequence)

    def model(self, sequence: Sequence[str]) -> Any:
        """The model of a sequence, built again and given the values that were found, feasible or not.

        Raises
        ------
        KeyError
            When it was not solved.
        SolveFailed
            When an error left no values.
        ModelError
            When ``build`` makes another model than the one that was solved.
        """
        found = self.outcome(sequence)
        if found.result is None:
            raise SolveFailed(f"{found.name}: there is no solution. {found.error}", self)
        model = self.build(found.sequence)
        VariableValues.of_all(model).write(found.values)
        note_outcome(model, found.result.outcome)
        objective = ModelCheck(model).objective()
        if abs(objective - found.result.objective) > 1e-9 * max(1.0, abs(objective)):
            raise ModelError(
                f"{found.name}: the model built again has the objective {objective:.9g} where "
                f"{found.result.objective:.9g} was found. The function that builds it must give the same each time."
            )
        return model

    def __str__(self) -> str:
        undone = "; ".join(" - ".join(sequence) for sequence in self.remaining)
        return self.table() + (f"\ninterrupted; not solved: {undone}" if undone else "")


Build = Callable[[ModeSequence], Any]


def solve_sequences(
    build: Build,
    sequences: Iterable[Iterable[str]],
    *,
    workers: int | str = 1,
    engine: str | Engine | None = None,
    time_limit: float | None = None,
    time_limit_per_sequence: float | None = None,
    progress: bool | None = None,
    **options: Any,
) -> SequenceRanking:
    """Build and solve the model of each sequence, and rank them.

    A time limit or Ctrl-C stops the work; what was finished is ranked and returned.

    Parameters
    ----------
    build : callable
        ``build(sequence)`` returns the model of a sequence, the same each time.
    sequences : iterable of tuples of str
        Such as `mode_sequences` gives.
    workers : int or "all"
        Number of processes, or one on each core; with 1 all is done in this one. More need a ``build`` that stands
        at the top level of a module (or a `functools.partial` of such), and a script whose work stands under
        ``if __name__ == "__main__":``, since each process imports it.
    engine : str or Engine, optional
        Where the sequences are solved instead: ``"process"``, ``"dask"``, ``"mpi"`` or an object of `rcp.teams`, as
        for teams. With ``"mpi"`` every rank calls this function with the same arguments, and all get the same answer.
    time_limit : float, optional
        Seconds, for all sequences together.
    time_limit_per_sequence : float, optional
        Seconds, for the solve of one sequence.
    progress : bool, optional
        Show a line per sequence; by default only on a terminal.
    **options
        Passed to `solve`.

    Returns
    -------
    SequenceRanking
        Errors of single sequences are in it, as their reason.

    Raises
    ------
    ModelError
        When the arguments make no sense.
    EngineError
        When the engine is not installed, or none of its workers starts.
    SolverNotFoundError
        When there is no Ipopt.
    """
    tasks = [(sequence,) if isinstance(sequence, str) else tuple(sequence) for sequence in sequences]
    if not tasks:
        raise ModelError("no sequences to solve; mode_sequences(...) makes them.")
    running = study_engine(workers, engine)
    best_backend()  # raises with the remedies where there is none, once and not for every sequence
    started, deadline = time.perf_counter(), Deadline.after(time_limit)
    bar = Progress(progress if running is None or running.writes_files else False)
    done: dict[int, SequenceOutcome] = {}

    def take(outcome: SequenceOutcome) -> tuple[Task, ...]:
        done[outcome.number] = outcome
        objective = f"objective {outcome.objective:.7g}" if outcome.feasible else outcome.reason
        bar.line(f"{len(done)}/{len(tasks)} {outcome.name}: {outcome.verdict}, {objective}")
        if len(done) < len(tasks):
            bar.live(f"{len(tasks) - len(done)} left")
        return ()

    make = partial(_SequenceSolver, build, options, time_limit_per_sequence)
    solver = make()
    solver.progress = lambda number: bar.within(f"{number} of {len(tasks)} sequences done")
    if running is not None:
        check_picklable({"build": build, "the options": dict(options)})
    run_tasks(
        [Task(number, (number, sequence)) for number, sequence in enumerate(tasks)], take,
        make=make if running is not None else lambda: solver, engine=running, most=len(tasks), deadline=deadline,
        given_up=lambda task: SequenceOutcome(tasks[task.key], task.key, error=GIVEN_UP),
    )  # fmt: skip
    bar.live("")
    return SequenceRanking(
        name="sequences",
        outcomes=ranked(done[number] for number in sorted(done)),
        remaining=tuple(task for number, task in enumerate(tasks) if number not in done),
        seconds=time.perf_counter() - started,
        build=build,
    )


class _SequenceSolver:
    """Builds and solves one sequence after the other."""

    def __init__(self, build: Build, options: Mapping[str, Any], time_limit: float | None) -> None:
        self._build, self._options, self._time_limit = build, options, time_limit
        self.progress: Callable[[int], Progress | bool] = lambda number: False

    def solve(self, number: int, sequence: ModeSequence, *, deadline: Deadline) -> SequenceOutcome | None:
        """The outcome of a sequence; None where Ctrl-C cut it short."""
        started = time.perf_counter()
        try:
            model = self._build(sequence)
            limit = seconds_left(deadline.within(self._time_limit))
            result = solve_as_given(model, **{"progress": self.progress(number), **self._options, "time_limit": limit})
        except SolverNotFoundError:
            raise
        except Exception as error:  # whatever goes wrong with one sequence must not lose the others
            seconds = time.perf_counter() - started
            return SequenceOutcome(sequence, number, error=f"{type(error).__name__}: {error}", seconds=seconds)
        if result.stop_reason is StopReason.INTERRUPTED:
            return None
        return SequenceOutcome(
            sequence, number, result=result, seconds=time.perf_counter() - started,
            values=VariableValues.of_all(model).taken,
        )  # fmt: skip
