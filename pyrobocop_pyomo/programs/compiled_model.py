"""A Pyomo model with its nonlinear program, made from a ``.nl`` file or by a walk over its expressions."""

from __future__ import annotations

import contextlib
import io
import logging
import os
import re
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import cached_property
from pathlib import Path

import numpy as np
import pyomo.repn.util
from pyomo.common.collections import ComponentMap
from pyomo.common.errors import InvalidValueError
from pyomo.core.base.block import BlockData
from pyomo.core.base.constraint import ConstraintData
from pyomo.core.base.objective import ObjectiveData
from pyomo.core.base.var import VarData
from pyomo.core.staleflag import StaleFlagManager
from pyomo.repn.plugins.nl_writer import NLWriter
from pyomo.solvers.amplfunc_merge import amplfunc_merge

from pyrobocop_pyomo.errors import EvaluationError, PyRobocopError, SolverNotFoundError, StructureChanged

from .asl_program import ASL_REMEDY, AslProgram, asl_available
from .casadi_program import CasadiProgram, casadi_available
from .model_checks import refuse_discrete, refuse_external_functions, single_objective, undefined_row
from .model_terms import collect_terms
from .nonlinear_program import FloatArray, NonlinearProgram
from .vectorised_program import VectorisedProgram

logger = logging.getLogger(__name__)

# How a model is written wherever this package writes one. Named expressions are written out: where nested ones are
# shared by rows and objective, ASL's Jacobian comes out wrong (Ipopt's derivative test finds it too). Presolving and
# scaling in the writer would alter the multipliers of a warm start.
WRITER_OPTIONS = {"linear_presolve": False, "scale_model": False, "export_defined_variables": False}

# Suffixes stand between the header and the first expression. CasADi refuses them, and nothing here needs them:
# multipliers are read from the model itself.
_SUFFIX_SEGMENT = re.compile(r"^S\d+ (\d+) .*\n", re.MULTILINE)
_HEADER_LINES = 10


class CompiledModel:
    """A Pyomo model with its nonlinear program, which can be solved many times without being compiled again.

    What was fixed or active, and the values of mutable Params, stay as they were when the model was compiled until
    `update`.
    Values of variables are free to change; `current_point` reads them.

    Parameters
    ----------
    model : Block
        The model, with at most one active objective; without any, the objective is zero.
    derivatives : {"asl", "casadi", "vectorised"}, optional
        Where derivatives come from: a ``.nl`` file read by ASL or by CasADi, or without a file CasADi on vectorised
        expressions. By default ASL where PyNumero's library is found, else CasADi.

    Attributes
    ----------
    model : Block
        The model as given.
    nlp : NonlinearProgram
        The program; a maximised objective appears negated.
    variables : list of VarData
        In the order of the program's variables. Fixed variables and those that nothing uses are absent.
    constraints : list of ConstraintData
        In the order of the program's rows; a range constraint is one row. Constraints without free variables are
        absent.
    objective : ObjectiveData or None
        The active objective.
    sign : float
        1 for a minimised objective, -1 for a maximised one.
    seconds_writing, seconds_building : float
        Time spent in Pyomo's writer or in our own walk, and in preparing derivatives.

    Raises
    ------
    ModelError
        For several active objectives, no continuous variable, or discrete ones; for an external function that the
        source of derivatives cannot call.
    EvaluationError
        When a number in an expression does not exist, as a division by a Param that is zero.
    SolverNotFoundError
        When there is nothing on this machine that gives the derivatives asked for.
    """

    nlp: NonlinearProgram
    variables: list[VarData]
    constraints: list[ConstraintData]
    objective: ObjectiveData | None
    sign: float
    seconds_writing: float
    seconds_building: float

    def __init__(self, model: BlockData, derivatives: str | None = None) -> None:
        self._build = None if derivatives == "vectorised" else _program_builder(derivatives)
        self.model = model
        self._prepare()

    def _prepare(self) -> None:
        self.objective = single_objective(self.model)
        self.sign = -1.0 if self.objective is not None and self.objective.is_minimizing() is False else 1.0
        self.__dict__.pop("row_of", None)
        if self._build is None:
            self._compile_terms()
        else:
            self._compile_file(self._build)
        logger.debug(
            "'%s': %d variables, %d rows, derivatives by %s; %.3f s writing, %.3f s building", self.model.name,
            self.nlp.n, self.nlp.m, self.nlp.derivatives, self.seconds_writing, self.seconds_building,
        )  # fmt: skip

    def _compile_terms(self) -> None:
        started = time.perf_counter()
        terms = collect_terms(self.model)
        self.variables, self.constraints = terms.variables, terms.constraints
        self.seconds_writing = time.perf_counter() - started
        started = time.perf_counter()
        self.nlp = VectorisedProgram(terms)
        self.seconds_building = time.perf_counter() - started

    def _compile_file(self, build: Callable[[Path, list[str]], NonlinearProgram]) -> None:
        started = time.perf_counter()
        text = io.StringIO()
        with checked_writing(self.model):
            info = NLWriter().write(self.model, text, **WRITER_OPTIONS)
        self.variables, self.constraints = info.variables, info.constraints
        refuse_discrete(self.model, self.variables)
        self.seconds_writing = time.perf_counter() - started
        started = time.perf_counter()
        # Both readers take everything from the file at once: it can go as soon as the program exists.
        with tempfile.TemporaryDirectory(prefix="pyrobocop_") as folder:
            path = Path(folder) / "model.nl"
            with path.open("w", encoding="utf-8", newline="\n") as file:
                file.write(_plain(text.getvalue(), has_objective=self.objective is not None))
            self.nlp = build(path, info.external_function_libraries)
        self.seconds_building = time.perf_counter() - started

    @cached_property
    def row_of(self) -> ComponentMap:
        """From constraint to its row."""
        return ComponentMap((constraint, row) for row, constraint in enumerate(self.constraints))

    def update(self) -> None:
        """Bring the program up to date with the model: fixed values, Params and bounds.

        With vectorised expressions the numbers are read again, and only a change of structure (see
        `VectorisedProgram.refresh`) needs another walk. A file is written again in any case.
        """
        if isinstance(self.nlp, VectorisedProgram):
            try:
                self.nlp.refresh()
                return
            except StructureChanged as error:
                logger.info("%s", error)
        self._prepare()

    def current_point(self) -> FloatArray:
        """Values of the model's variables in the program's order; 0 where a variable has none."""
        values = [variable.value for variable in self.variables]
        return np.array([0.0 if value is None else value for value in values], dtype=float)

    def load_point(self, x: FloatArray) -> None:
        """Put a point into the model's variables; all others become stale, as after any solve."""
        StaleFlagManager.mark_all_as_stale()
        for variable, value in zip(self.variables, np.asarray(x, dtype=float).tolist(), strict=True):
            # A point of an interior method may violate a bound by its tolerance: no reason to refuse it.
            variable.set_value(value, skip_validation=True)
        StaleFlagManager.mark_all_as_stale(delayed=True)


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
        pyomo.repn.util.HALT_ON_EVALUATION_ERROR = before


def _build_asl(path: Path, external_libraries: list[str]) -> NonlinearProgram:
    return AslProgram(path, amplfunc_merge(os.environ, *external_libraries) if external_libraries else "")


def _build_casadi(path: Path, external_libraries: list[str]) -> NonlinearProgram:
    return CasadiProgram(path)


def _program_builder(derivatives: str | None) -> Callable[[Path, list[str]], NonlinearProgram]:
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
