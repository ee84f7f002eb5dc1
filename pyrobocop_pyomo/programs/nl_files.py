"""Models as ``.nl`` files, and the nonlinear programs that ASL reads from them."""

from __future__ import annotations

import contextlib
import io
import logging
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pyomo.repn.util
from pyomo.common.errors import InvalidValueError
from pyomo.core.base.block import BlockData
from pyomo.core.base.constraint import ConstraintData
from pyomo.core.base.var import VarData
from pyomo.repn.plugins.nl_writer import NLWriter
from pyomo.solvers.amplfunc_merge import amplfunc_merge

from pyrobocop_pyomo.errors import EvaluationError, PyRobocopError

from .asl_program import AslProgram
from .model_checks import check_variables, refuse_external_functions, refuse_function_calls, undefined_row

# How a model is written wherever this package writes one. Named expressions are written out: not every ASL
# differentiates them rightly (docs/developer/evaluation.md). Presolving and scaling in the writer would alter the
# multipliers of a warm start.
WRITER_OPTIONS = {"linear_presolve": False, "scale_model": False, "export_defined_variables": False}

_HEADER_LINES = 10


def program_of_file(model: BlockData, has_objective: bool) -> tuple[AslProgram, list[VarData], list[ConstraintData]]:
    """Write a model, and let ASL read it; returns the program, and what its variables and rows are.

    Raises
    ------
    ModelError, EvaluationError
        As `checked_writing`.
    FunctionError
        For a model that calls functions in Python.
    SolverNotFoundError
        When PyNumero's library is not found.
    """
    text = io.StringIO()
    with checked_writing(model):
        info = NLWriter().write(model, text, **WRITER_OPTIONS)
        for word in ("nan", "inf"):  # no other words are in a file without names; ASL reads these as zeros
            if word in text.getvalue():
                raise InvalidValueError(word)
    check_variables(model, info.variables)
    libraries = info.external_function_libraries
    if libraries:
        refuse_external_functions(model, everywhere=True)
    # ASL takes everything from the file at once: it can go as soon as the program exists.
    with tempfile.TemporaryDirectory(prefix="pyrobocop_") as folder:
        path = Path(folder) / "model.nl"
        content = text.getvalue() if has_objective else _with_objective(text.getvalue())
        path.write_text(content, encoding="utf-8", newline="\n")
        nlp = AslProgram(path, amplfunc_merge(os.environ, *libraries) if libraries else "")
    return nlp, info.variables, info.constraints


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
            refuse_function_calls(model)  # it says where
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


def _with_objective(text: str) -> str:
    """The file with the objective zero: ASL wants one."""
    *header, segments = text.split("\n", _HEADER_LINES)
    counts = header[1].split()
    header[1] = " ".join(["", *counts[:2], "1", *counts[3:]])
    return "\n".join([*header, "O0 0", "n0", segments])
