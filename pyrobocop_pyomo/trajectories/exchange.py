"""Files of named arrays."""

from __future__ import annotations

import json
import os
import shutil
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.numerics import Array

# What JSON, NumPy and the archive raise for bytes that are damaged or mean something else.
_DAMAGED = (
    *(ArithmeticError, EOFError, LookupError, MemoryError, OSError, RuntimeError, SyntaxError, TypeError, ValueError),
    *(struct.error, tokenize.TokenError, zipfile.BadZipFile, zlib.error),
)


_FORMAT = 1


def write_archive(path: str | Path, facts: Mapping[str, Any], groups: Mapping[str, Mapping[str, Array]]) -> Path:
    """Write groups of named arrays, at once or not at all: whoever reads meanwhile finds the file before or this one.

    Parameters
    ----------
    path : str or Path
        The suffix ``.npz`` is added where it is missing.
    facts : mapping
        What fits into JSON.
    groups : mapping of str to (mapping of str to array)

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    OSError
        When it cannot be written, as on a full disk; the file before is as it was.
    """
    path = Path(path)
    path = path if path.suffix == ".npz" else path.with_name(path.name + ".npz")
    # Names travel in the facts: a pair's name holds characters that an archive member should not.
    header = {"format": _FORMAT, "facts": dict(facts), "names": {group: list(named) for group, named in groups.items()}}
    arrays = {f"{group}_{i}": values for group, named in groups.items() for i, values in enumerate(named.values())}
    members: dict[str, Any] = {"header": np.array(json.dumps(header)), **arrays}
    # In the same folder: a rename there is atomic. Threads and processes may write to the same path.
    temporary = path.with_name(f".{path.stem}-{uuid4().hex}.npz")
    try:
        with temporary.open("xb") as file:
            np.savez_compressed(file, **members)
            file.flush()
            os.fsync(file.fileno())
        if path.exists():
            shutil.copymode(path, temporary)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
    return path


def read_archive(path: str | Path) -> tuple[dict[str, Any], dict[str, dict[str, Array]]]:
    """Read what `write_archive` wrote: the facts and the groups.

    Raises
    ------
    TrajectoryError
        When the file is not there, is damaged or holds something else.
    """
    try:
        # Opened here, because NumPy does not close the file of a damaged archive.
        with Path(path).open("rb") as file, np.load(file, allow_pickle=False) as archive:
            header = json.loads(str(archive["header"]))
            written_in = header["format"]
            if written_in == _FORMAT:
                groups = {
                    group: {name: archive[f"{group}_{i}"] for i, name in enumerate(names)}
                    for group, names in header["names"].items()
                }
                return header["facts"], groups
    except _DAMAGED as error:
        raise TrajectoryError(
            f"{path}: no trajectory can be read from it ({type(error).__name__}: {error})."
        ) from error
    raise TrajectoryError(f"{path}: written in format {written_in}; this version reads format {_FORMAT}.")
