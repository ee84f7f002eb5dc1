"""`Checkpoint`: all that a team needs to go on later, in a file of arrays and JSON. Nothing in it is unpickled."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from types import CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import CheckpointError, TrajectoryError
from pyrobocop_pyomo.trajectories.exchange import read_archive, write_archive

_FORMAT = 1
_KIND = "checkpoint of a team"
_DATA = (bool, int, float, complex, str, bytes, np.ndarray, np.generic, Mapping, tuple, list, set, frozenset)


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
    """

    round: int
    fingerprint: str
    states: Mapping[str, Mapping[str, np.ndarray]]
    coordinator: Mapping[str, np.ndarray] = field(default_factory=dict)

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
            When something in it is no array of numbers or texts.
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
        }
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
            found = cls(int(facts["round"]), str(facts["fingerprint"]), states, groups["coordinator"])
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
    """A number of what specs hold, the same in every process and on every machine with the same version of Python.

    Parameters
    ----------
    specs : iterable
        Dataclasses of numbers, texts, arrays, tuples, mappings, functions, classes and other dataclasses. A function
        counts with its instructions and with the numbers, texts, arrays and further functions that it reads from its
        module, as far as these come from the same package; others count with their names.

    Returns
    -------
    str
        64 hexadecimal digits (SHA-256).

    Raises
    ------
    CheckpointError
        When something has no such number, such as an open file.
    """
    digest, reader = hashlib.sha256(), _SpecReader()
    for spec in specs:
        for part in reader.parts(spec):
            digest.update(f"{len(part)}:".encode())
            digest.update(part)
    return digest.hexdigest()


class _SpecReader:
    """Values as sequences of bytes, each kind with a mark of its own."""

    def __init__(self) -> None:
        self._packages: set[str] = set()  # of the functions that the specs hold
        self._done: set[int] = set()
        self._in_code = False

    def parts(self, value: Any) -> Iterator[bytes]:
        if isinstance(value, (bool, int, float, complex, str, bytes, type(None))):
            yield f"{type(value).__name__} {value!r}".encode()
        elif isinstance(value, (np.ndarray, np.generic)) and not value.dtype.hasobject:
            yield f"array {value.dtype.str} {value.shape}".encode()
            yield np.ascontiguousarray(value).tobytes()
        elif isinstance(value, Mapping):
            yield f"mapping {len(value)}".encode()
            yield from self._all(item for pair in value.items() for item in pair)
        elif isinstance(value, (tuple, list)):
            yield f"sequence {len(value)}".encode()
            yield from self._all(value)
        elif isinstance(value, (set, frozenset)):
            yield f"set {sorted(map(repr, value))}".encode()
        elif is_dataclass(value) and not isinstance(value, type):
            yield f"dataclass {type(value).__qualname__}".encode()
            yield from self._code(type(value))
            for item in fields(value):
                yield item.name.encode()
                yield from self.parts(getattr(value, item.name))
        elif isinstance(value, MethodType):
            yield from self._all((value.__func__, value.__self__))
        elif hasattr(value, "__qualname__"):  # a function or a class
            if not self._in_code and callable(value):
                self._packages.add(_package(value))
            yield from self._code(value)
        elif hasattr(value, "func") and hasattr(value, "keywords"):  # a partial
            yield from self._all((value.func, value.args, value.keywords))
        elif self._in_code:
            yield f"a {type(value).__qualname__}".encode()  # a lock, a logger: not the same in every process
        elif hasattr(value, "__dict__"):
            yield f"object {type(value).__qualname__}".encode()
            yield from self._code(type(value))
            yield from self.parts(vars(value))
        else:
            raise CheckpointError(f"a {type(value).__name__} has no fingerprint. Give agents plain data.")

    def _all(self, values: Iterable[Any]) -> Iterator[bytes]:
        for value in values:
            yield from self.parts(value)

    def _code(self, value: Any) -> Iterator[bytes]:
        """The name of a function or a class; and, once, what it does and reads, where its package is read."""
        yield f"name {value.__module__}.{value.__qualname__}".encode()
        if id(value) in self._done or _package(value) not in self._packages:
            return
        self._done.add(id(value))
        function, outside = getattr(value, "__wrapped__", value), self._in_code
        self._in_code = True
        if isinstance(value, type):
            yield from self._all(_members(value))
        elif isinstance(function, FunctionType):
            codes = list(_codes(function.__code__))
            yield from (code.co_code for code in codes)
            yield from self._all(c for code in codes for c in code.co_consts if not isinstance(c, CodeType))
            yield from self._all((function.__defaults__, function.__kwdefaults__, *_closed_over(function)))
            yield from self._all(self._globals(function, {name for code in codes for name in code.co_names}))
        self._in_code = outside

    def _globals(self, function: FunctionType, names: set[str]) -> Iterator[tuple[str, Any]]:
        """What a function reads from its module by name, and data and own functions that it reads from others."""
        found = {name: function.__globals__[name] for name in sorted(names) if name in function.__globals__}
        for name, value in found.items():
            if not isinstance(value, ModuleType):
                yield name, value
                continue
            for member in sorted(names & set(vars(value))):
                read = vars(value)[member]
                # What else a module has may depend on what was imported before.
                if isinstance(read, _DATA) or (callable(read) and _package(read) in self._packages):
                    yield f"{name}.{member}", read


def _package(value: Any) -> str:
    return str(getattr(value, "__module__", "")).partition(".")[0]


def _codes(code: CodeType) -> Iterator[CodeType]:
    """Of a function and of the functions that are defined in it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _closed_over(function: FunctionType) -> Iterator[Any]:
    for cell in function.__closure__ or ():
        with contextlib.suppress(ValueError):  # a name without a value yet
            yield cell.cell_contents


def _members(kind: type) -> Iterator[tuple[str, Any]]:
    """Functions and constants of a class; those that Python adds may differ from process to process."""
    for name, member in vars(kind).items():
        for one in (member, *(getattr(member, way, None) for way in ("fget", "fset", "__func__", "func"))):
            if isinstance(one, FunctionType) or (isinstance(one, _DATA) and not name.startswith("__")):
                yield name, one
