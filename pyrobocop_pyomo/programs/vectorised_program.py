"""The nonlinear program of a Pyomo model without a file: repeated terms are evaluated all at once.

Ipopt evaluates such a program by itself (`CompiledRun`): C calls C, and no Python runs between two iterations' ends.

The numbers of a model that may change between solves, read again without another walk.
"""

from __future__ import annotations

import ctypes
import importlib.util
import math
from operator import attrgetter, is_not
from typing import Any

import numpy as np
from pyomo.common.errors import InfeasibleConstraintException
from pyomo.common.numeric_types import native_numeric_types
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective
from pyomo.repn.plugins.nl_writer import TOL

from pyrobocop_pyomo.errors import ModelError, SolverNotFoundError
from pyrobocop_pyomo.modeling.pyomo_internals import parts_of
from pyrobocop_pyomo.modeling.rows_by_rule import RowByRule, sum_by_rule

from .asl_program import ASL_REMEDY
from .model_checks import number_in
from .model_terms import ModelTerms
from .nonlinear_program import FloatArray, NonlinearProgram, Scales, finite
from .row_values import BoundArrays
from .summed_terms import SummedTerms, SumsStructure, evaluation_library, place_hessians

# ---------------------------------------------------------------------------------------------- numbers that may change


# Attributes of Pyomo's data objects behind its properties: reading ten thousand properties takes ten milliseconds.
_DOMAIN, _FIXED, _ACTIVE, _EXPRESSION = map(attrgetter, ("_domain", "_fixed", "_active", "_expr"))
_VALUE = attrgetter("value")


def _expression_of(row: Any) -> Any:
    """What tells whether a row was set to another expression: of one that follows a rule, whether it still does."""
    return RowByRule if row.__class__ is RowByRule else _EXPRESSION(row)


class ModelNumbers:
    """Bounds, values of parameters, and whether the model's structure is still the one that was walked over.

    Parameters
    ----------
    terms : ModelTerms
        What the walk found.

    Attributes
    ----------
    x_lower, x_upper, g_lower, g_upper : float arrays
        Bounds of variables and rows, infinite where there is none.
    parameters : float array
        Values of the parameters.
    """

    def __init__(self, terms: ModelTerms) -> None:
        self._terms = terms
        self._variables, self._constraints = terms.variables, terms.constraints
        self._fixed_variables = [known for known in terms.columns.parameters if known.is_variable_type()]
        self._structure = self._read_structure()
        self._bounds = BoundArrays(self._variables)
        self.x_lower, self.x_upper = self._bounds.lower, self._bounds.upper
        self.g_lower, lower = _row_bounds([lower for lower, _ in terms.bounds], -math.inf)
        self.g_upper, upper = _row_bounds([upper for _, upper in terms.bounds], math.inf)
        for undefined in np.flatnonzero(np.isnan(self.g_lower) | np.isnan(self.g_upper)):
            raise ModelError(f"'{self._constraints[undefined].name}': a bound of it is nan; give it a number.")
        self._changing_rows = [(self.g_lower, i, e, -math.inf) for i, e in lower]
        self._changing_rows += [(self.g_upper, i, e, math.inf) for i, e in upper]
        self.parameters = np.empty(len(terms.columns.parameters))
        self._read_numbers()

    def refresh(self) -> None:
        """Read everything again.

        Raises
        ------
        ModelError
            When variables were fixed or unfixed or got other domains, rows or named expressions got other expressions,
            rows were added, deleted, replaced, activated or deactivated, or the objective got another sense.
        InfeasibleConstraintException
            When a row without free variables contradicts itself.
        """
        structure = self._read_structure()
        if len(structure) != len(self._structure) or any(map(is_not, structure, self._structure)):
            raise ModelError(
                f"'{self._terms.model.name}': rows, objectives, named expressions, domains, or what is fixed or active "
                "have changed since it was prepared. Prepare it again."
            )
        self._bounds.read()
        self._read_numbers()

    def values_of_variables(self) -> FloatArray:
        """Current values of the variables, 0 where one has none."""
        numbers = list(map(_VALUE, self._variables))
        if None in numbers:
            numbers = [0.0 if number is None else number for number in numbers]
        return np.array(numbers, dtype=float)

    def index_of_parameter(self, data: Any) -> int | None:
        """Where a fixed variable or a mutable Param stands in `parameters`; None for one that is not read."""
        known = self._terms.columns.parameters
        return next((i for i, parameter in enumerate(known) if parameter is data), None)

    def _read_numbers(self) -> None:
        known: dict[int, float] = {}  # one parameter often bounds many rows
        for bounds, i, expression, unbounded in self._changing_rows:
            bound = known.get(id(expression))
            if bound is None:
                bound = known[id(expression)] = number_in(expression, self._constraints[i].name)
            if math.isnan(bound) or bound == -unbounded:
                raise ModelError(f"'{self._constraints[i].name}': a bound of it is {bound}; give it a number.")
            bounds[i] = bound
        values = list(map(_VALUE, self._terms.columns.parameters))
        if None in values:
            missing = self._terms.columns.parameters[values.index(None)]
            raise ModelError(f"'{missing.name}' is fixed without a value. Give it one.")
        self.parameters[:] = values
        for constraint in self._terms.constant_constraints:
            check_constant(constraint)

    def _read_structure(self) -> list[Any]:
        """Objects that stay the same ones as long as nothing but numbers changes."""
        terms, rows = self._terms, _rows_of(self._terms.model)
        collected = terms.rows, terms.cost
        return [
            *map(_FIXED, [*self._variables, *self._fixed_variables]),
            *map(_DOMAIN, self._variables),
            *map(_expression_of, self._constraints),
            *rows,
            *map(_ACTIVE, rows),
            None if terms.objective is None else terms.objective.is_minimizing(),
            *(_held_by(named) for terms in collected for named in terms.named_expressions.values()),
        ]


def _held_by(named: Any) -> Any:
    """What a named expression holds: what says it, where it follows a rule."""
    return sum_by_rule(named) or named.args[0]


def _row_bounds(bounds: list[Any], unbounded: float) -> tuple[FloatArray, list[tuple[int, Any]]]:
    """Bounds as an array, and those that are expressions with their places."""
    known = {*native_numeric_types, type(None)}
    changing = [(i, bound) for i, bound in enumerate(bounds) if bound.__class__ not in known]
    numbers = [unbounded if bound is None else bound for bound in bounds]
    for i, _ in changing:
        numbers[i] = 0.0
    return np.array(numbers, dtype=float), changing


def _rows_of(model: Any) -> list[Any]:
    """The rows and objectives of all active components."""
    components = model.component_objects((Constraint, Objective), active=True, descend_into=True)
    return [data for component in components for data in parts_of(component).values()]


def check_constant(constraint: Any) -> None:
    """Check a row without free variables.

    Raises
    ------
    InfeasibleConstraintException
        When its numbers contradict it.
    """
    lowest, body, highest = constraint.to_bounded_expression()
    lower = -math.inf if lowest is None else number_in(lowest, constraint.name)
    upper = math.inf if highest is None else number_in(highest, constraint.name)
    number = number_in(body, constraint.name)
    if lower - number > TOL or number - upper > TOL:
        raise InfeasibleConstraintException(
            f"model contains a trivially infeasible constraint '{constraint.name}' (fixed body value {number} "
            f"outside bounds [{lower}, {upper}])."
        )


# --------------------------------------------------------------------------------------------------- vectorised program


# In the order in which Ipopt's C interface takes them, with the structures that come with them.
EVALUATIONS = {
    "objective": None,
    "constraints": None,
    "gradient": None,
    "jacobian": "jacobian_structure",
    "hessian": "hessian_structure",
}


_int, _long, _number, _address = ctypes.c_int32, ctypes.c_int64, ctypes.c_double, ctypes.c_void_p


class _ProgramStructure(ctypes.Structure):
    _fields_ = (
        ("n", _long), ("cost", SumsStructure), ("rows", SumsStructure), ("gradient_columns", _address),
    )  # fmt: skip


class _RunStructure(ctypes.Structure):
    _fields_ = (
        ("program", _address), ("shifts", _address), ("x_scales", _address), ("gradient_scales", _address),
        ("row_scales", _address), ("entry_scales", _address), ("hessian_scales", _address),
        ("objective_scale", _number), ("x", _address),
        ("multipliers", _address), ("undefined_at", _address), ("undefined", _int), ("jacobian_rows", _address),
        ("jacobian_columns", _address), ("hessian_rows", _address), ("hessian_columns", _address),
    )  # fmt: skip


def casadi_available() -> bool:
    """Whether CasADi is installed; it is looked up and not imported, which would cost half a second."""
    return importlib.util.find_spec("casadi") is not None


class VectorisedProgram:
    """The nonlinear program of a Pyomo model, whose repeated terms are functions vectorised by CasADi.

    Parameters
    ----------
    terms : ModelTerms
        From `collect_terms`. Fixed variables and mutable Params are numbers that `refresh` reads again.

    Attributes
    ----------
    numbers : ModelNumbers
    cost, rows : SummedTerms

    Raises
    ------
    SolverNotFoundError
        When CasADi is missing.
    InfeasibleConstraintException
        When a row without free variables contradicts itself.
    """

    derivatives = "CasADi on vectorised expressions"

    def __init__(self, terms: ModelTerms) -> None:
        if not casadi_available():
            raise SolverNotFoundError(
                "there is nothing here to take derivatives with: CasADi is not installed. Run: pip install "
                f"'pyrobocop_pyomo[ipopt]'; or take derivatives='asl'. {ASL_REMEDY}."
            )
        self.numbers = ModelNumbers(terms)
        self.x_lower, self.x_upper = self.numbers.x_lower, self.numbers.x_upper
        self.g_lower, self.g_upper = self.numbers.g_lower, self.numbers.g_upper
        self.n, self.m = len(terms.variables), len(terms.constraints)
        self._library = library = evaluation_library()
        self.cost = SummedTerms(terms.cost, 1, self.n, library)
        self.rows = SummedTerms(terms.rows, self.m, self.n, library)
        self.jacobian_structure = self.rows.structure
        self.hessian_structure = place_hessians([self.cost, self.rows], self.n)
        self._read_point()

    def refresh(self) -> None:
        """Read fixed variables, mutable Params, bounds and the first point again from the model.

        Raises
        ------
        ModelError
            When other variables are free or other rows active than before.
        InfeasibleConstraintException
            When a row without free variables contradicts itself.
        """
        self.numbers.refresh()
        self._read_point()

    def _read_point(self) -> None:
        for sums in (self.cost, self.rows):
            sums.set_parameters(self.numbers.parameters)
        self.x_start = self.numbers.values_of_variables()

    def objective(self, x: FloatArray) -> float:
        """Value of f."""
        return float(finite(self.cost.values(x), "CasADi", "objective")[0])

    def gradient(self, x: FloatArray) -> FloatArray:
        """Gradient of f."""
        gradient = np.zeros(self.n)
        gradient[self.cost.structure[1]] = self.cost.jacobian(x)
        return finite(gradient, "CasADi", "gradient of the objective")

    def constraints(self, x: FloatArray) -> FloatArray:
        """Values of g."""
        return finite(self.rows.values(x), "CasADi", "constraints")

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Values of the Jacobian of g."""
        return finite(self.rows.jacobian(x), "CasADi", "Jacobian of the constraints")

    def hessian(self, x: FloatArray, objective_factor: float, multipliers: FloatArray) -> FloatArray:
        """Values of the Hessian of the Lagrangian."""
        values = np.zeros(self.hessian_structure[0].size)
        self.cost.add_hessian(x, np.array([objective_factor]), values)
        self.rows.add_hessian(x, multipliers, values)
        return finite(values, "CasADi", "Hessian of the Lagrangian")

    def compiled_run(self, scales: Scales | None = None, shifts: FloatArray | None = None) -> CompiledRun | None:
        """The functions for Ipopt without Python, None without the compiled evaluation; see `CompiledRun`."""
        return None if self._library is None else CompiledRun(self, self._library, scales, shifts)


class CompiledRun:
    """The functions of a program, or of the same in other units, for one run of Ipopt.

    Parameters
    ----------
    program : VectorisedProgram
    library : ctypes.CDLL
    scales : Scales, optional
        The units of the point that Ipopt has; see `ScaledProgram`.
    shifts : float array, shape (m,), optional
        By how much rows are moved, read at each evaluation; see `ShiftedRows`.

    Attributes
    ----------
    functions : dict of str to int
        Addresses of the functions by their names in `NonlinearProgram`.
    data : int
        Address of what they get as their last argument.
    """

    def __init__(
        self,
        program: VectorisedProgram,
        library: ctypes.CDLL,
        scales: Scales | None = None,
        shifts: FloatArray | None = None,
    ) -> None:
        jacobian, hessian = program.jacobian_structure, program.hessian_structure
        self._arrays: list[np.ndarray] = []
        self._owners = program.cost, program.rows
        structures = [self._kept(places, np.int32) for places in (*jacobian, *hessian)]
        self._undefined_at = np.empty(program.n)
        self._program = _ProgramStructure(
            program.n, program.cost.sums, program.rows.sums, self._kept(program.cost.structure[1], np.int32)
        )
        units: list[int | None] = [None] * 5
        objective_scale = 1.0
        if scales is not None:
            objective_scale = scales.objective
            factors = (
                scales.x,
                scales.x / scales.objective,
                scales.g,
                scales.x[jacobian[1]] / scales.g[jacobian[0]],
                scales.x[hessian[0]] * scales.x[hessian[1]],
            )
            units = [self._kept(factor) for factor in factors]
        self._run = _RunStructure(
            ctypes.addressof(self._program), None if shifts is None else self._kept(shifts),
            *units, objective_scale, self._kept(np.empty(program.n)),
            self._kept(np.empty(program.m)), self._undefined_at.ctypes.data, 0, *structures,
        )  # fmt: skip
        self.functions = {
            name: ctypes.cast(getattr(library, f"run_{name}"), ctypes.c_void_p).value or 0 for name in EVALUATIONS
        }
        self.data = ctypes.addressof(self._run)

    def _kept(self, values: np.ndarray, kind: Any = np.float64) -> int:
        """Address of an array that lives as long as this object."""
        array = np.ascontiguousarray(values, dtype=kind)
        self._arrays.append(array)
        address: int = array.ctypes.data
        return address

    def begin(self) -> None:
        """Forget the run before."""
        self._run.undefined = 0

    @property
    def undefined_at(self) -> FloatArray | None:
        """The last point, in Ipopt's units, at which a value or a derivative did not exist."""
        return self._undefined_at.copy() if self._run.undefined else None


def compiled_run_of(
    nlp: NonlinearProgram, scales: Scales | None = None, shifts: FloatArray | None = None
) -> CompiledRun | None:
    """The functions of a program for Ipopt without Python; None where Python has to evaluate any of them.

    A program offers them by a method ``compiled_run(scales, shifts)``. That of a base class does not count: a subclass
    has to say itself what is compiled of it.
    """
    is_own = "compiled_run" in vars(type(nlp))
    return nlp.compiled_run(scales, shifts) if is_own else None  # type: ignore[attr-defined]
