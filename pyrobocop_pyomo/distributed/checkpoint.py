"""`Checkpoint`: all that a team needs to go on later, in a file of arrays and JSON. Nothing in it is unpickled."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import CheckpointError, TrajectoryError
from pyrobocop_pyomo.trajectories.exchange import read_archive, write_archive

_FORMAT = 1
_KIND = "checkpoint of a team"


@dataclass(frozen=True)
class Checkpoint:
    """A team between two rounds.

    Attributes
    ----------
    round : int
        How many rounds were done.
    fingerprint : str
        Of what the team was made of: `fingerprint` of its specs.
    states : mapping of agent's name to (mapping of name to array)
        As `Engine.states` gives them.
    coordinator : mapping of name to array
        What the coordinator has to know.
    facts : mapping
        Of the coordinator as well, what fits into JSON: numbers, texts, lists, dicts.
    """

    round: int
    fingerprint: str
    states: Mapping[str, Mapping[str, np.ndarray]]
    coordinator: Mapping[str, np.ndarray] = field(default_factory=dict)
    facts: Mapping[str, Any] = field(default_factory=dict)

    def save(self, path: str | Path) -> Path:
        """Write it, at once or not at all: whoever reads meanwhile finds the file before or this one.

        Parameters
        ----------
        path : str or Path
            The suffix ``.npz`` is added where it is missing.

        Returns
        -------
        Path
            The file written.

        Raises
        ------
        CheckpointError
            When something in it is neither an array of numbers or texts nor JSON.
        """
        groups = {f"agent{i}": dict(state) for i, state in enumerate(self.states.values())}
        groups["coordinator"] = dict(self.coordinator)
        for where, group in zip([*self.states, "coordinator"], groups.values(), strict=True):
            for name, values in group.items():
                if np.asarray(values).dtype.hasobject:
                    raise CheckpointError(f"{path}: '{name}' of '{where}' is no array of numbers; it cannot be saved.")
        facts = {
            "kind": _KIND,
            "format": _FORMAT,
            "round": int(self.round),
            "fingerprint": self.fingerprint,
            "agents": list(self.states),
            "facts": dict(self.facts),
        }
        try:
            json.dumps(facts)
        except (TypeError, ValueError) as error:
            raise CheckpointError(f"{path}: the facts of the coordinator cannot be saved: {error}.") from error
        return write_archive(path, facts, groups)

    @classmethod
    def load(cls, path: str | Path, fingerprint: str | None = None) -> Checkpoint:
        """Read it.

        Parameters
        ----------
        path : str or Path
        fingerprint : str, optional
            Of the team that is to go on.

        Returns
        -------
        Checkpoint

        Raises
        ------
        CheckpointError
            When the file is not there, is damaged or holds something else, or belongs to another team.
        """
        try:
            facts, groups = read_archive(path)
        except TrajectoryError as error:
            raise CheckpointError(f"{path}: no checkpoint can be read from it ({error.__cause__ or error}).") from error
        if facts.get("kind") != _KIND:
            raise CheckpointError(f"{path}: no checkpoint of a team, but another file of this package.")
        if facts.get("format") != _FORMAT:
            raise CheckpointError(
                f"{path}: written in format {facts.get('format')}; this version reads format {_FORMAT}."
            )
        try:
            states = {name: groups[f"agent{i}"] for i, name in enumerate(facts["agents"])}
            found = cls(int(facts["round"]), str(facts["fingerprint"]), states, groups["coordinator"], facts["facts"])
        except (KeyError, TypeError, ValueError) as error:
            raise CheckpointError(f"{path}: no checkpoint can be read from it ({error!r}).") from error
        if fingerprint is not None and found.fingerprint != fingerprint:
            raise CheckpointError(
                f"{path}: written by another team (fingerprint {found.fingerprint[:12]}, this one has "
                f"{fingerprint[:12]}; its agents are {', '.join(found.states)}). Builders, data, shared quantities "
                "and options have to be the same. To start anew, take another file or delete this one."
            )
        return found


def fingerprint(specs: Iterable[Any]) -> str:
    """A number of what specs hold, the same in every process and on every machine.

    Parameters
    ----------
    specs : iterable
        Dataclasses of numbers, texts, arrays, tuples, mappings, functions (by their names) and other dataclasses.

    Returns
    -------
    str
        64 hexadecimal digits (SHA-256).

    Raises
    ------
    CheckpointError
        When something has no such number, such as an open file.
    """
    digest = hashlib.sha256()
    for spec in specs:
        for part in _parts(spec):
            digest.update(f"{len(part)}:".encode())
            digest.update(part)
    return digest.hexdigest()


def _parts(value: Any) -> Iterable[bytes]:
    """A value as a sequence of bytes, each kind with a mark of its own."""
    if isinstance(value, (bool, int, float, complex, str, bytes, type(None))):
        yield f"{type(value).__name__} {value!r}".encode()
    elif isinstance(value, (np.ndarray, np.generic)) and not value.dtype.hasobject:
        yield f"array {value.dtype.str} {value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif isinstance(value, Mapping):
        yield f"mapping {len(value)}".encode()
        for key, item in value.items():
            yield from _parts(key)
            yield from _parts(item)
    elif isinstance(value, (tuple, list)):
        yield f"sequence {len(value)}".encode()
        for item in value:
            yield from _parts(item)
    elif isinstance(value, (set, frozenset)):
        yield f"set {sorted(map(repr, value))}".encode()
    elif is_dataclass(value) and not isinstance(value, type):
        yield f"dataclass {type(value).__qualname__}".encode()
        for item in fields(value):
            yield item.name.encode()
            yield from _parts(getattr(value, item.name))
    elif hasattr(value, "__qualname__"):  # a function or a class
        yield f"name {value.__module__}.{value.__qualname__}".encode()
    elif hasattr(value, "func") and hasattr(value, "keywords"):  # a partial
        yield from _parts((value.func, value.args, value.keywords))
    elif hasattr(value, "__dict__"):
        yield f"object {type(value).__qualname__}".encode()
        yield from _parts(vars(value))
    else:
        raise CheckpointError(f"a {type(value).__name__} has no fingerprint. Give agents plain data.")
