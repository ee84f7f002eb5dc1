"""`OutcomeFile`: outcomes of a sweep, each appended at once to a file of JSON lines, so that a sweep can go on."""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from pyrobocop_pyomo.errors import TeamError
from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.solving import Quality, SolveResult, StopReason
from pyrobocop_pyomo.solving.iterates import Iterate, Standing

from .outcomes import Outcome
from .sweep_cases import SweepCase

_HEAD = {"kind": "outcomes of a sweep", "format": 3}


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
            self.records = {line["key"]: line for line in lines}
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


_OF_OUTCOME = ("error", "seconds", "numbers", "started_from", "values")
_WORDS = {"stop_reason": StopReason, "quality": Quality, "certificate": Certificate}


def outcome_to_json(outcome: Outcome) -> dict[str, Any]:
    """What a file keeps of an outcome: of its result numbers and words, without steps, pairs and multipliers."""
    result = outcome.result
    return {
        "name": outcome.name,
        "told": outcome.reason,
        **{name: getattr(outcome, name) for name in _OF_OUTCOME},
        "result": result
        and {
            **_plain(result),
            "iterations": result.iterations,
            "best": _plain(result.best),
            "standing": _plain(result.standing),
        },
    }


def outcome_from_json(case: SweepCase, facts: Mapping[str, Any]) -> Outcome:
    """The outcome of a case again; one step stands for all of its result."""
    kept = {name: facts[name] for name in (*_OF_OUTCOME, "told")}
    if facts["result"] is None:
        return Outcome(case=case, **kept)
    of_result, best = _with_words(facts["result"]), _with_words(facts["result"]["best"])
    standing, iterations = Standing(**of_result.pop("standing")), of_result.pop("iterations")
    steps = [Iterate("all steps", iterations=iterations, seconds=of_result["seconds"])]
    further = {"residuals": [], "steps": steps, "standing": standing, "multipliers": None}
    return Outcome(case=case, result=SolveResult(**{**of_result, **further, "best": Iterate(**best)}), **kept)


def _plain(record: Any) -> dict[str, Any]:
    """The fields of a dataclass that are words and numbers; of an enumeration the name."""
    found = ((each.name, getattr(record, each.name)) for each in fields(record))
    return {
        name: field.name if name in _WORDS else field
        for name, field in found
        if name in _WORDS or isinstance(field, (bool, int, float, str))
    }


def _with_words(facts: Mapping[str, Any]) -> dict[str, Any]:
    """The same fields, with members of enumerations."""
    return {name: _WORDS[name][field] if name in _WORDS else field for name, field in facts.items()}
