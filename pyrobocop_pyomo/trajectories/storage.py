"""One ``.npz`` file of named arrays and JSON facts, never a pickle."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.errors import TrajectoryError

Array = NDArray[np.float64]

_FORMAT = 1


def write_archive(path: str | Path, facts: Mapping[str, Any], groups: Mapping[str, Mapping[str, Array]]) -> Path:
    """Write groups of named arrays; the suffix ``.npz`` is added where it is missing.

    Returns
    -------
    Path
        The file written.
    """
    path = Path(path)
    path = path if path.suffix == ".npz" else path.with_name(path.name + ".npz")
    # Names travel in the facts: a pair's name holds characters that an archive member should not.
    header = {"format": _FORMAT, "facts": dict(facts), "names": {group: list(named) for group, named in groups.items()}}
    arrays = {f"{group}_{i}": values for group, named in groups.items() for i, values in enumerate(named.values())}
    members: dict[str, Any] = {"header": np.array(json.dumps(header)), **arrays}
    np.savez_compressed(path, **members)
    return path


def read_archive(path: str | Path) -> tuple[dict[str, Any], dict[str, dict[str, Array]]]:
    """Read what `write_archive` wrote: the facts and the groups.

    Raises
    ------
    TrajectoryError
        When the file is not there or holds something else.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            header = json.loads(str(archive["header"]))
            written_in = header["format"]
            if written_in == _FORMAT:
                groups = {
                    group: {name: archive[f"{group}_{i}"] for i, name in enumerate(names)}
                    for group, names in header["names"].items()
                }
                return header["facts"], groups
    # An array file is no context manager (in Python 3.10 an AttributeError), a list no dict. An empty file: EOFError.
    except (AttributeError, OSError, EOFError, KeyError, TypeError, ValueError, BadZipFile) as error:
        raise TrajectoryError(f"{path}: no trajectory can be read from it ({error}).") from error
    raise TrajectoryError(f"{path}: written in format {written_in}; this version reads format {_FORMAT}.")
