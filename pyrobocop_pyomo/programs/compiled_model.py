"""A Pyomo model with its nonlinear program, made by a walk over its expressions or from a ``.nl`` file.

Parts of components that belong together: all values over time of one quantity.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyomo.common.collections import ComponentMap
from pyomo.common.gc_manager import PauseGC
from pyomo.core.base.block import BlockData
from pyomo.core.base.constraint import ConstraintData
from pyomo.core.base.objective import ObjectiveData
from pyomo.core.base.var import VarData
from pyomo.core.staleflag import StaleFlagManager

from pyrobocop_pyomo.complementarity.preconditions import only_objective
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.variable_values import put_values

from .asl_program import asl_available, program_of_file
from .function_rows import ProgramWithFunctions, vectorised_program
from .model_checks import refuse_foreign, refuse_unseen_components
from .model_terms import collect_terms
from .nonlinear_program import FloatArray, NonlinearProgram
from .vectorised_program import VectorisedProgram, casadi_available

# ----------------------------------------------------------------------------------------------------------- components


class ComponentGroups:
    """Variables or constraints by what they are values of.

    Parts of an indexed component are one group where their indices differ only in times: in places at which the
    component has an index that is no whole number and no word.

    Parameters
    ----------
    parts : iterable of component data
        All parts of their components are looked at, also those that are not among them.

    Attributes
    ----------
    numbers : int array, shape (parts,)
        The group of each part.
    names : list of str
        A component's name, with what is left of the index: ``"arm.q[2]"``.
    members : list of list of component data
        All parts of each group.
    components : list of component
        The component of each group.
    """

    def __init__(self, parts: Iterable[Any]) -> None:
        self.names: list[str] = []
        self.members: list[list[Any]] = []
        self.components: list[Any] = []
        self._group_of: dict[int, int] = {}
        self._groups_of_component: dict[int, list[int]] = {}
        numbers = []
        for part in parts:
            if id(part) not in self._group_of:
                self._add(part.parent_component())
            numbers.append(self._group_of[id(part)])
        self.numbers: NDArray[np.intp] = np.array(numbers, dtype=np.intp)

    def groups_of(self, component: Any) -> list[int]:
        """The groups of a component's parts; none where none of them was given."""
        return self._groups_of_component.get(id(component), [])

    def _add(self, component: Any) -> None:
        first = len(self.names)
        keys = {key: key if isinstance(key, tuple) else (key,) for key in component}
        times = {place for key in keys.values() for place, entry in enumerate(key) if isinstance(entry, float)}
        group_of_key: dict[tuple[Any, ...], int] = {}
        for key, entries in keys.items():
            kept = tuple(entry for place, entry in enumerate(entries) if place not in times and entry is not None)
            if kept not in group_of_key:
                group_of_key[kept] = len(self.names)
                self._begin(component, kept)
            data = component[key]
            self._group_of[id(data)] = group_of_key[kept]
            self.members[group_of_key[kept]].append(data)
        self._groups_of_component[id(component)] = list(range(first, len(self.names)))

    def _begin(self, component: Any, kept: tuple[Any, ...]) -> None:
        self.names.append(component.name + (f"[{', '.join(map(str, kept))}]" if kept else ""))
        self.members.append([])
        self.components.append(component)


# ------------------------------------------------------------------------------------------------------- compiled model


logger = logging.getLogger(__name__)


class CompiledModel:
    """A Pyomo model with its nonlinear program, which can be solved many times without being compiled again.

    What was fixed or active, and the values of mutable Params, stay as they were when the model was compiled until
    `update`.
    Values of variables are free to change; `current_point` reads them.

    Parameters
    ----------
    model : Block
        The model, with at most one active objective; without any, the objective is zero.
    derivatives : {"vectorised", "asl"}, optional
        Where derivatives come from: CasADi on vectorised expressions, also called ``"casadi"``, or ASL, which reads a
        ``.nl`` file. By default CasADi where it is installed, else ASL.
    is_view : bool
        Whether rows are meant to hold variables of another model beside their own, as those that a study makes are.

    Attributes
    ----------
    model : Block
        The model as given.
    nlp : NonlinearProgram
        The program; a maximised objective appears negated.
    variables : list of VarData
        In the order of the program's variables. Fixed variables and those that nothing uses are absent; outputs and
        arguments of Python functions have variables that are no part of the model.
    constraints : list of ConstraintData
        In the order of the program's rows; a range constraint is one row. Constraints without free variables are
        absent; calls of Python functions have constraints that are no part of the model.
    objective : ObjectiveData or None
        The active objective.
    sign : float
        1 for a minimised objective, -1 for a maximised one.

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

    def __init__(self, model: BlockData, derivatives: str | None = None, *, is_view: bool = False) -> None:
        if derivatives not in (None, "asl", "casadi", "vectorised"):
            raise ValueError(
                f"derivatives is {derivatives!r}; it must be 'asl', 'vectorised' (or its other name, 'casadi') or None "
                "(the best present)."
            )
        self._is_view, self.model = is_view, model
        self._is_file = derivatives == "asl" or (derivatives is None and not casadi_available() and asl_available())
        self._prepare()

    def _prepare(self) -> None:
        refuse_unseen_components(self.model)
        self.objective = only_objective(self.model)
        self.sign = -1.0 if self.objective is not None and self.objective.is_minimizing() is False else 1.0
        for known in ("row_of", "groups"):
            self.__dict__.pop(known, None)
        if self._is_file:
            self.nlp, self.variables, self.constraints = program_of_file(self.model, self.objective is not None)
        else:
            with PauseGC():  # many small objects, all of which live on
                terms = collect_terms(self.model)
                self.nlp, self.constraints = vectorised_program(terms)
                self.variables = terms.variables
        if not self._is_view:
            refuse_foreign(self.model, self.variables)
        logger.debug(
            "'%s': %d variables, %d rows, derivatives by %s", self.model.name, self.nlp.n, self.nlp.m,
            self.nlp.derivatives,
        )  # fmt: skip

    @cached_property
    def row_of(self) -> ComponentMap:
        """From constraint to its row."""
        return ComponentMap((constraint, row) for row, constraint in enumerate(self.constraints))

    def numbers_of(self, constraints: Iterable[ConstraintData]) -> NDArray[np.intp]:
        """The rows of constraints; those without free variables are not in the program."""
        rows = [self.row_of[constraint] for constraint in constraints if constraint in self.row_of]
        return np.array(rows, dtype=np.intp)

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
        if isinstance(self.nlp, (VectorisedProgram, ProgramWithFunctions)):
            try:
                self.nlp.refresh()
                return True
            except ModelError as error:
                logger.info("%s", error)
        return False

    def current_point(self) -> FloatArray:
        """Values of the model's variables in the program's order; 0 where a variable has none, NaN for infinity."""
        values = [variable.value for variable in self.variables]
        x = np.array([0.0 if value is None else value for value in values], dtype=float)
        x = np.where(np.isinf(x), np.nan, x)
        return self.nlp.completed(x) if isinstance(self.nlp, ProgramWithFunctions) else x

    def of_model(self, parts: Sequence[Any], numbers: NDArray[Any]) -> tuple[Sequence[Any], NDArray[Any]]:
        """Those of its variables or constraints that are parts of the model, and their numbers: calls add others."""
        if not isinstance(self.nlp, ProgramWithFunctions):
            return parts, numbers
        own = [place for place, part in enumerate(parts) if part.parent_block() is not None]
        return [parts[place] for place in own], numbers[own]

    def load_point(self, x: FloatArray) -> None:
        """Put a point into the model's variables; all others become stale, as after any solve."""
        StaleFlagManager.mark_all_as_stale()
        # A point of an interior method may violate a bound by its tolerance: no reason to refuse it.
        put_values(self.variables, np.asarray(x, dtype=float).tolist())
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
