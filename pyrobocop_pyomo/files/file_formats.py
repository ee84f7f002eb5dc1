"""`read_file` and `write_file`: problems with complementarity in files that other programs read and write."""

from __future__ import annotations

import tempfile
from pathlib import Path

from pyomo.core.base.block import BlockData

from pyrobocop_pyomo.errors import ModelError

from .casadi_json import read_json, write_json
from .file_problem import FileProblem
from .nl_reading import read_nl
from .nl_writing import WRITERS, write_nl

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


def write_file(model: BlockData, path: str | Path, *, writer: str = "nl_v2") -> Path:
    """Write a model with its pairs.

    A pair is a row of type 5 in a ``.nl`` file, which is complementary to bounds of a variable. Where neither side of a
    pair is a variable with this bound alone, there is a new variable for one side. What a side of any sign
    (`either_zero`) states is written by its positive and its negative part.

    Parameters
    ----------
    model : Block
        It is not changed.
    path : str or Path
        ``.nl``, and names go to ``.row`` and ``.col`` beside it; or ``.json`` as NOSBENCH has it.
    writer : {"nl_v2", "nl_v1"}
        Which of Pyomo's writers of ``.nl`` files is used.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ModelError
        When the model calls functions that a file cannot hold, or has pairs in disjuncts.
    ComplementarityError
        When a pair has no canonical form.
    EvaluationError
        When a number in an expression does not exist.
    """
    path = Path(path)
    if writer not in WRITERS:
        raise ModelError(f"writer = {writer!r}; expected {' or '.join(map(repr, WRITERS))}.")
    if path.suffix == ".nl":
        write_nl(model, path, writer)
    elif path.suffix == ".json":
        with tempfile.TemporaryDirectory(prefix="pyrobocop_") as folder:
            between = Path(folder) / "model.nl"
            write_nl(model, between, writer)
            write_json(read_nl(between), path)
    else:
        raise ModelError(f"{path}: is neither a .nl nor a .json file.")
    return path
