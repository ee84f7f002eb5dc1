"""`read_file`: problems with complementarity in files that other programs write."""

from __future__ import annotations

from pathlib import Path

from pyrobocop_pyomo.errors import ModelError

from .casadi_json import read_json
from .file_problem import FileProblem
from .nl_reading import read_nl

SUFFIXES = (".nl", ".json")


def read_file(path: str | Path) -> FileProblem:
    """Read a problem.

    Parameters
    ----------
    path : str or Path
        ``.nl`` as text or binary, with names from a ``.row`` and a ``.col`` file beside it where these exist; or
        ``.json`` with functions that CasADi has written, as NOSBENCH has them.

    Returns
    -------
    FileProblem
        ``.model()`` makes a model of it.

    Raises
    ------
    ModelError
        When there is no such file, when it cannot be read, or holds what models here do not have: discrete variables,
        logical constraints, functions in other libraries.
    ModuleNotFoundError
        For ``.json`` where CasADi is missing.
    """
    path = Path(path)
    read = {".nl": read_nl, ".json": read_json}.get(path.suffix)
    if read is None:
        raise ModelError(f"{path}: is neither a .nl nor a .json file.")
    if not path.is_file():
        raise ModelError(f"{path}: there is no such file.")
    return read(path)
