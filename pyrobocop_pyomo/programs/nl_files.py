"""Models as ``.nl`` files, and the nonlinear programs that are read from them."""

from __future__ import annotations

import contextlib
import io
import logging
import os
import re
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import pyomo.repn.util
from pyomo.common.errors import InvalidValueError
from pyomo.core.base.block import BlockData
from pyomo.core.base.constraint import ConstraintData
from pyomo.core.base.var import VarData
from pyomo.repn.plugins.nl_writer import NLWriter
from pyomo.solvers.amplfunc_merge import amplfunc_merge

from pyrobocop_pyomo.errors import EvaluationError, PyRobocopError, SolverNotFoundError

from .asl_program import ASL_REMEDY, AslProgram, asl_available
from .casadi_program import CasadiProgram, casadi_available
from .model_checks import refuse_external_functions, undefined_row
from .nonlinear_program import NonlinearProgram

ProgramBuilder = Callable[[Path, list[str]], NonlinearProgram]

# How a model is written wherever this package writes one. Named expressions are written out: not every ASL
# differentiates them rightly (docs/developer/evaluation.md). Presolving and scaling in the writer would alter the
# multipliers of a warm start.
WRITER_OPTIONS = {"linear_presolve": False, "scale_model": False, "export_defined_variables": False}

# Suffixes stand between the header and the first expression. CasADi refuses them, and nothing here needs them:
# multipliers are read from the model itself.
_SUFFIX_SEGMENT = re.compile(r"^S\d+ (\d+) .*\n", re.MULTILINE)
_HEADER_LINES = 10


class FileProgram(NamedTuple):
    """A program read from a file, with what its variables and rows are."""

    nlp: NonlinearProgram
    variables: list[VarData]
    constraints: list[ConstraintData]


class ModelFile(NamedTuple):
    """A model as text, with what its variables and rows are."""

    text: str
    variables: list[VarData]
    constraints: list[ConstraintData]
    libraries: list[str]

    def program(self, build: ProgramBuilder, has_objective: bool) -> FileProgram:
        """The program that a source of derivatives reads."""
        # Both readers take everything from the file at once: it can go as soon as the program exists.
        with tempfile.TemporaryDirectory(prefix="pyrobocop_") as folder:
            path = Path(folder) / "model.nl"
            with path.open("w", encoding="utf-8", newline="\n") as file:
                file.write(_plain(self.text, has_objective))
            return FileProgram(build(path, self.libraries), self.variables, self.constraints)


def model_file(model: BlockData, owner: BlockData, *, named: bool = False) -> ModelFile:
    """Write a model.

    Parameters
    ----------
    model : Block
    owner : Block
        The user's model, whose rows messages name: the same, or what the model was made from.
    named : bool
        Whether named expressions are written once each, as defined variables; not for ASL.

    Raises
    ------
    ModelError, EvaluationError
        As `checked_writing`.
    """
    text = io.StringIO()
    with checked_writing(owner):
        info = NLWriter().write(model, text, **WRITER_OPTIONS | {"export_defined_variables": named})
        if "nan" in text.getvalue():  # the only word that a file without names can hold; ASL reads it as a zero
            raise InvalidValueError("nan")
    if info.external_function_libraries:
        refuse_external_functions(owner, everywhere=True)
    return ModelFile(text.getvalue(), info.variables, info.constraints, info.external_function_libraries)


def _is_not_raised_as_well(record: logging.LogRecord) -> bool:
    """Whether a message of Pyomo's writer says more than the error that follows it."""
    return not str(record.msg).startswith("Exception encountered evaluating expression")


@contextlib.contextmanager
def checked_writing(model: BlockData) -> Iterator[None]:
    """Context in which a model is written to a ``.nl`` file.

    Pyomo's writer warns of a term whose number does not exist, leaves it out and goes on; here it stops.

    Raises
    ------
    ModelError
        When the model calls external functions that ASL cannot.
    EvaluationError
        When a number in an expression does not exist.
    """
    refuse_external_functions(model)
    before = pyomo.repn.util.HALT_ON_EVALUATION_ERROR
    pyomo.repn.util.HALT_ON_EVALUATION_ERROR = True
    pyomo.repn.util.logger.addFilter(_is_not_raised_as_well)
    try:
        yield
    except (ArithmeticError, InvalidValueError, ValueError) as error:
        if isinstance(error, PyRobocopError):
            raise
        row = undefined_row(model)
        if row is None and not isinstance(error, (ArithmeticError, InvalidValueError)):
            raise  # the writer objects to something else
        raise EvaluationError(
            f"{row or repr(model.name)}: a number in an expression does not exist: {error}. Give Params and fixed "
            "variables values that it is defined for."
        ) from None
    finally:
        pyomo.repn.util.logger.removeFilter(_is_not_raised_as_well)
        pyomo.repn.util.HALT_ON_EVALUATION_ERROR = before


def _build_asl(path: Path, external_libraries: list[str]) -> NonlinearProgram:
    return AslProgram(path, amplfunc_merge(os.environ, *external_libraries) if external_libraries else "")


def _build_casadi(path: Path, external_libraries: list[str]) -> NonlinearProgram:
    return CasadiProgram(path)


def reads_names(build: ProgramBuilder) -> bool:
    """Whether a source of derivatives reads defined variables rightly."""
    return build is _build_casadi


def program_builder(derivatives: str | None) -> ProgramBuilder:
    """What reads files: ASL or CasADi as asked for, by default the best that is present.

    Raises
    ------
    SolverNotFoundError
        When it is missing.
    """
    if derivatives not in (None, "asl", "casadi"):
        raise ValueError(
            f"derivatives is {derivatives!r}; it must be 'asl', 'casadi', 'vectorised' or None (the best present)."
        )
    if derivatives != "casadi" and asl_available():
        return _build_asl
    if derivatives == "asl":
        raise SolverNotFoundError(
            f"derivatives='asl' was asked for, but PyNumero's library pynumero_ASL is not found. {ASL_REMEDY}."
        )
    if casadi_available():
        return _build_casadi
    raise SolverNotFoundError(
        "there is nothing on this machine to take derivatives of a .nl file: neither CasADi nor PyNumero's library "
        f"pynumero_ASL is found. Run: pip install 'pyrobocop_pyomo[ipopt]' (CasADi). {ASL_REMEDY} (ASL, faster)."
    )


def _plain(text: str, has_objective: bool) -> str:
    """The file without suffix segments, and with the objective zero where there is none (both readers want one)."""
    lines_end = 0
    for _ in range(_HEADER_LINES):
        lines_end = text.index("\n", lines_end) + 1
    header, body = text[:lines_end], text[lines_end:]
    kept, position = [], 0
    while body[position : position + 1] in ("S", "F"):  # F declares an external function, and may come in between
        after = body.index("\n", position) + 1
        segment = _SUFFIX_SEGMENT.match(body, position)
        if segment is None:
            kept.append(body[position:after])
        else:
            for _ in range(int(segment.group(1))):
                after = body.index("\n", after) + 1
        position = after
    if not has_objective:
        lines = header.split("\n")
        counts = lines[1].split()
        counts[2] = "1"
        lines[1] = " " + " ".join(counts)
        header = "\n".join(lines)
        kept.append("O0 0\nn0\n")
    return header + "".join(kept) + body[position:]
