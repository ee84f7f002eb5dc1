"""A Pyomo model with its nonlinear program, made from a ``.nl`` file or by a walk over its expressions."""

from __future__ import annotations

import logging
import time
from functools import cached_property

import numpy as np
from pyomo.common.collections import ComponentMap
from pyomo.common.gc_manager import PauseGC
from pyomo.core.base.block import BlockData
from pyomo.core.base.constraint import Constraint, ConstraintData
from pyomo.core.base.objective import ObjectiveData
from pyomo.core.base.var import VarData
from pyomo.core.staleflag import StaleFlagManager

from pyrobocop_pyomo.errors import EvaluationError, FunctionError, ModelError, StructureChanged
from pyrobocop_pyomo.modeling.component_groups import ComponentGroups
from pyrobocop_pyomo.modeling.variable_values import put_values

from .composed_program import ComposedProgram
from .compositions import composition_of_files, vectorised_composition
from .function_calls import calls_in
from .model_checks import (
    active_expressions,
    check_variables,
    refuse_foreign,
    refuse_unseen_components,
    single_objective,
)
from .model_terms import collect_terms
from .named_nodes import with_named_nodes
from .nl_files import ModelFile, ProgramBuilder, model_file, program_builder, reads_names
from .nonlinear_program import FloatArray, NonlinearProgram
from .term_files import term_file
from .vectorised_program import VectorisedProgram

logger = logging.getLogger(__name__)

# From so many rows on, patterns of terms are written more quickly than Pyomo writes the rows.
LEAST_ROWS = 1000


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
    is_view : bool
        Whether rows are meant to hold variables of another model beside their own, as those that a study makes are.

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
        For components that no solver sees before they are transformed, such as pairs, disjunctions and derivatives;
        for several active objectives, no continuous variable, or discrete ones; for an external function that the
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

    def __init__(self, model: BlockData, derivatives: str | None = None, *, is_view: bool = False) -> None:
        self._is_view = is_view
        self._build = None if derivatives == "vectorised" else program_builder(derivatives)
        self._calls_python = False
        self.model = model
        self._prepare()

    def _prepare(self) -> None:
        refuse_unseen_components(self.model)
        self.objective = single_objective(self.model)
        self.sign = -1.0 if self.objective is not None and self.objective.is_minimizing() is False else 1.0
        for known in ("row_of", "groups"):
            self.__dict__.pop(known, None)
        if self._build is None:
            with PauseGC():  # many small objects, all of which live on
                self._compile_terms()
        else:
            self._compile_file(self._build)
        if not self._is_view:
            refuse_foreign(self.model, self.variables)
        logger.debug(
            "'%s': %d variables, %d rows, derivatives by %s; %.3f s writing, %.3f s building", self.model.name,
            self.nlp.n, self.nlp.m, self.nlp.derivatives, self.seconds_writing, self.seconds_building,
        )  # fmt: skip

    def _compile_terms(self) -> None:
        started = time.perf_counter()
        terms = collect_terms(self.model)
        self.seconds_writing = time.perf_counter() - started
        started = time.perf_counter()
        self.nlp, self.variables, self.constraints = vectorised_composition(terms)
        self.seconds_building = time.perf_counter() - started

    def _compile_file(self, build: ProgramBuilder) -> None:
        started = time.perf_counter()
        by_calls = not reads_names(build)
        quickly = by_calls and not self._calls_python and self._has_many_rows()
        if quickly and (written := self._file_of_terms()) is not None:
            self._read(written, build, started)
            try:
                self.nlp.objective(self.nlp.x_start)
                self.nlp.constraints(self.nlp.x_start)
                return
            except EvaluationError as error:  # Pyomo's writer says where a number does not exist, if it is one
                logger.debug("'%s' is written by Pyomo: %s", self.model.name, error)
        named = with_named_nodes(self.model, self.objective, by_calls=by_calls)
        model, objective = (self.model, self.objective) if named is None else (named.model, named.objective)
        written = None
        if not (self._calls_python or (named is not None and by_calls)):
            try:
                written = model_file(model, self.model, named=named is not None)
            except FunctionError:
                # Writing it is the quickest way to learn that a model calls a Python function; it is known from now on.
                if not any(map(calls_in, active_expressions(self.model))):
                    raise
                self._calls_python = True
        if written is None:
            self.nlp, self.variables, self.constraints = composition_of_files(model, self.model, objective, build)
            check_variables(self.model, self.variables)
            self.seconds_writing, self.seconds_building = 0.0, time.perf_counter() - started
        else:
            check_variables(self.model, written.variables)
            self._read(written, build, started, has_objective=objective is not None)
        if named is not None:
            self.constraints = [named.row_of[id(row)] for row in self.constraints]

    def _has_many_rows(self) -> bool:
        rows = self.model.component_objects(Constraint, active=True, descend_into=True)
        return sum(map(len, rows)) >= LEAST_ROWS

    def _file_of_terms(self) -> ModelFile | None:
        """The model written by the patterns of its terms; None where Pyomo's writer has to do it, or knows better."""
        try:
            return term_file(collect_terms(self.model))
        except ModelError as error:
            logger.debug("'%s' is not written by its terms: %s", self.model.name, error)
            return None

    def _read(self, written: ModelFile, build: ProgramBuilder, started: float, has_objective: bool = True) -> None:
        self.seconds_writing = time.perf_counter() - started
        started = time.perf_counter()
        self.nlp, self.variables, self.constraints = written.program(build, has_objective)
        self.seconds_building = time.perf_counter() - started

    @cached_property
    def row_of(self) -> ComponentMap:
        """From constraint to its row."""
        return ComponentMap((constraint, row) for row, constraint in enumerate(self.constraints))

    @cached_property
    def groups(self) -> tuple[ComponentGroups, ComponentGroups]:
        """What its variables, and its constraints, are values of."""
        return ComponentGroups(self.variables), ComponentGroups(self.constraints)

    def update(self) -> None:
        """Bring the program up to date with the model: fixed values, Params and bounds.

        With vectorised expressions the numbers are read again, and only a change of structure (see
        `VectorisedProgram.refresh`) needs another walk. A file is written again in any case.
        """
        if not self.has_read_numbers_again():
            self._prepare()

    def has_read_numbers_again(self) -> bool:
        """Whether the program is that of the model as it is now, where that is a matter of numbers, read again here."""
        if self._build is None and isinstance(self.nlp, (VectorisedProgram, ComposedProgram)):
            try:
                self.nlp.refresh()
                return True
            except StructureChanged as error:
                logger.info("%s", error)
        return False

    def current_point(self) -> FloatArray:
        """Values of the model's variables in the program's order; 0 where a variable has none."""
        values = [variable.value for variable in self.variables]
        return np.array([0.0 if value is None else value for value in values], dtype=float)

    def load_point(self, x: FloatArray) -> None:
        """Put a point into the model's variables; all others become stale, as after any solve."""
        StaleFlagManager.mark_all_as_stale()
        # A point of an interior method may violate a bound by its tolerance: no reason to refuse it.
        put_values(self.variables, np.asarray(x, dtype=float).tolist(), flag=StaleFlagManager.get_flag(0))
        StaleFlagManager.mark_all_as_stale(delayed=True)


class KeptProgram:
    """The program of a model that is solved again with other numbers, compiled again where its structure changed.

    A program that was handed out before stays as it is for whoever holds it, apart from its numbers.
    """

    def __init__(self) -> None:
        self._known: tuple[CompiledModel, str | None] | None = None

    def of(self, model: BlockData, derivatives: str | None) -> CompiledModel:
        """The model compiled; see `CompiledModel`."""
        if self._known is not None:
            compiled, by = self._known
            if compiled.model is model and by == derivatives and compiled.has_read_numbers_again():
                return compiled
        compiled = CompiledModel(model, derivatives)
        self._known = compiled, derivatives
        return compiled
