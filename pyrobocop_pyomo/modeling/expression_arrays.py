"""NumPy on Pyomo's variables: arrays whose entries are expressions, and the entries themselves.

NumPy asks an object for a method ``sin`` when it is given to ``np.sin`` of it, and Pyomo's variables have none. An
`ArrayEntry` is a thin wrapper around an expression that has these methods, and `ExpressionArray` is an array of such
entries and of numbers. What leaves for Pyomo is unwrapped first: by `plain_expressions` where this package asks a rule,
by the operators where a relation is made.

NumPy's functions, by name, as functions of Pyomo's expressions.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pyomo.core.expr as pyomo_functions
from pyomo.common.errors import PyomoException
from pyomo.common.numeric_types import native_numeric_types
from pyomo.core.base.indexed_component import IndexedComponent
from pyomo.core.base.indexed_component_slice import IndexedComponent_slice
from pyomo.core.expr import numeric_expr
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import ModelError

from .expression_nodes import NUMPY_NAMES

# ---------------------------------------------------------------------------------------------------- functions by name


_JUMPING = {"ceil", "floor", "abs"}
PYOMO_TO_NUMPY = {name: numpy_name for name, numpy_name in NUMPY_NAMES.items() if name not in _JUMPING}


def _arctan2(y: Any, x: Any) -> Any:
    # The half-angle formula: one smooth branch, with a seam where arctan2 itself jumps.
    return 2.0 * pyomo_functions.atan(y / (pyomo_functions.sqrt(x**2 + y**2) + x))


FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{numpy_name: getattr(pyomo_functions, name) for name, numpy_name in PYOMO_TO_NUMPY.items()},
    "exp2": lambda x: 2.0**x,
    "expm1": lambda x: pyomo_functions.exp(x) - 1.0,
    "log1p": lambda x: pyomo_functions.log(1.0 + x),
    "log2": lambda x: pyomo_functions.log(x) / math.log(2.0),
    "deg2rad": lambda x: x * (math.pi / 180.0),
    "radians": lambda x: x * (math.pi / 180.0),
    "rad2deg": lambda x: x * (180.0 / math.pi),
    "degrees": lambda x: x * (180.0 / math.pi),
    "reciprocal": lambda x: 1.0 / x,
    "square": lambda x: x**2,
    "absolute": abs,
    "fabs": abs,
    "hypot": lambda x, y: pyomo_functions.sqrt(x**2 + y**2),
    "arctan2": _arctan2,
}

# Functions that do the right thing by the operators of the entries.
KEEP_THEIR_MEANING = {
    "add", "subtract", "multiply", "divide", "power", "negative", "positive", "conjugate", "matmul", "vecdot",
    "matvec", "vecmat",
}  # fmt: skip

# What a choice between variables is called here, at the end of a sentence.
LAWS = (
    "|x| is b.name = rcp.mechanics.AbsoluteValue(lambda b, t: b.x[t]), read as b.name[t], and max(x, 0) is "
    "(b.x[t] + b.name[t]) / 2; likewise min and clip, and Step for an 'if x > 0'"
)

_CHOICES = {"maximum", "minimum", "fmax", "fmin", "clip", "where", "sort", "argsort", "argmax", "argmin"}
_JUMPS = {"sign", "heaviside", "floor", "ceil", "trunc", "rint", "remainder", "fmod", "floor_divide", "divmod", "mod"}


def remedy_for(name: str) -> str:
    """What to do instead of a function of NumPy that expressions do not have."""
    if name in _CHOICES:
        return (
            f"It has a kink, where derivatives end: state it by complementarity on a phase, where {LAWS}; as two "
            "inequalities where only one side can pay; or smoothed: (a + b + np.sqrt((a - b)**2 + 1e-6)) / 2."
        )
    if name in _JUMPS:
        return f"It jumps: state its pieces as phases of their own, or by complementarity on a phase, where {LAWS}."
    return "It has no formula in Pyomo's functions; write it with np.sin, np.exp, np.sqrt, np.power and the like."


# ---------------------------------------------------------------------------------------------------- expression arrays


_RELATIONS = {"equal", "less", "less_equal", "greater", "greater_equal"}


class ArrayEntry:
    """A Pyomo expression that NumPy's functions and Python's operators can be applied to; results are entries again.

    Relations, by contrast, are Pyomo's own: ``np.sin(x[0]) <= 0.5`` can be given to a `Constraint`. A rule of an
    `Expression` or `Objective` returns ``entry.expression``; rules of this package take entries as they are.

    Attributes
    ----------
    expression : number, variable, parameter or expression
        What is wrapped.
    """

    __slots__ = ("expression",)

    def __init__(self, expression: Any) -> None:
        self.expression = expression

    # ---------------------------------------------------------------- what Pyomo asks

    def is_numeric_type(self) -> bool:
        """False: an entry is no node of an expression."""
        return False

    def _op(self, function: Callable[..., Any], *_: Any) -> Any:
        # pyo.sin(entry) comes here, with math.sin.
        return getattr(self, PYOMO_TO_NUMPY[function.__name__])()

    def __call__(self, *block_and_index: Any, exception: Any = True) -> Any:
        """Return the value, as Pyomo asks for it; given a block, what is wrapped.

        Pyomo takes everything that can be called for a rule, an entry as well: ``pyo.Objective(expr=entry)``.
        """
        return self.expression if block_and_index else value(self.expression, exception=exception)

    def __str__(self) -> str:
        return str(self.expression)

    def __repr__(self) -> str:
        return str(self.expression)

    # ---------------------------------------------------------------- what NumPy and Python ask

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        return _apply(ufunc, method, inputs, options)

    def __float__(self) -> float:
        if self.expression.__class__ in native_numeric_types:
            return float(self.expression)
        raise ModelError(
            f"a number was asked for where '{_shortened(self)}' stands, which is an expression. Write np.sin and the "
            "like instead of math.sin, and make arrays that expressions are assigned to with dtype=object, or by "
            "pyrobocop_pyomo.array."
        )

    def __bool__(self) -> bool:
        if self.expression.__class__ in native_numeric_types:
            return bool(self.expression)
        raise ModelError(
            f"'{_shortened(self)}' is an expression, so that it is neither true nor false while a model is built. A "
            "rule cannot branch on variables: state both cases by complementarity (mechanics), or as phases."
        )

    def conjugate(self) -> ArrayEntry:
        """Itself: expressions are real."""
        return self

    def __abs__(self) -> ArrayEntry:
        return ArrayEntry(abs(self.expression))

    def __neg__(self) -> ArrayEntry:
        return ArrayEntry(-self.expression)

    def __pos__(self) -> ArrayEntry:
        return self

    def __hash__(self) -> int:
        return id(self)


def _binary(function: Callable[[Any, Any], Any], wrap: Callable[[Any], Any], *, swapped: bool = False) -> Any:
    def apply(self: ArrayEntry, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented  # NumPy's turn: entry by entry
        other = plain_entry(other)
        first, last = (other, self.expression) if swapped else (self.expression, other)
        if function is operator.mul and (_is_zero(first) or _is_zero(last)):
            return ArrayEntry(0.0)  # matrices are full of zeros, and a row depends on what stands in it
        return wrap(function(first, last))

    return apply


def _method(name: str, function: Callable[..., Any]) -> Any:
    def apply(self: ArrayEntry, *others: Any) -> ArrayEntry:
        return ArrayEntry(function(self.expression, *map(plain_entry, others)))

    apply.__name__, apply.__doc__ = name, f"``numpy.{name}`` of it."
    return apply


for _name in ("add", "sub", "mul", "truediv", "pow"):
    setattr(ArrayEntry, f"__{_name}__", _binary(getattr(operator, _name), ArrayEntry))
    setattr(ArrayEntry, f"__r{_name}__", _binary(getattr(operator, _name), ArrayEntry, swapped=True))
    setattr(ArrayEntry, f"__i{_name}__", getattr(ArrayEntry, f"__{_name}__"))
for _name in ("eq", "le", "lt", "ge", "gt"):
    setattr(ArrayEntry, f"__{_name}__", _binary(getattr(operator, _name), lambda relation: relation))
for _name, _function in FUNCTIONS.items():
    setattr(ArrayEntry, _name, _method(_name, _function))

# Pyomo's operators leave the result to those of this class: variable + entry is an entry.
numeric_expr.register_arg_type(ArrayEntry, numeric_expr.ARG_TYPE.INVALID)


class ExpressionArray(np.ndarray):
    """An array of Pyomo expressions and numbers, made by `array`.

    It is a NumPy array with ``dtype=object``, so that slices, broadcasting, ``@``, sums, norms, products, stacking and
    assignment are NumPy's. Its entries that are no numbers are `ArrayEntry`.
    """

    __array_priority__ = 10.0  # what np.dot and np.concatenate make of it and plain arrays is of this class

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        return _apply(ufunc, method, inputs, options)

    def __array_function__(self, func: Callable[..., Any], types: Any, args: Any, kwargs: Any) -> Any:
        if func in _LINEAR_ALGEBRA:
            return _LINEAR_ALGEBRA[func](*args, **kwargs)
        try:
            result = super().__array_function__(func, types, args, kwargs)
        except (PyomoException, TypeError) as error:
            raise ModelError(
                f"np.{func.__name__} cannot be applied to expressions ({f'{error}'.splitlines()[0]}). "
                f"{remedy_for(func.__name__)}"
            ) from error
        return result.view(ExpressionArray) if isinstance(result, np.ndarray) and result.dtype == object else result

    def __getattr__(self, name: str) -> Any:
        # What a number in brackets means is a time: b.x[1].at_end is no component of a vector, but all of it at t = 1.
        if name in ("at", "at_start", "at_end", "delayed"):
            raise AttributeError(
                f"'{name}' is read from values at one time, which [t] gives. Ask the vector, as in b.x.at_end, or a "
                "component by its own name, as in b.x_1.at_end."
            )
        raise AttributeError(f"'{type(self).__name__}' object has no attribute '{name}'")

    def __setitem__(self, key: Any, entry: Any) -> None:
        given = array(entry)
        # An array without dimension would be stored as such.
        super().__setitem__(key, given if given.ndim else given.item())


def array(values: Any) -> ExpressionArray:
    """An array of variables and expressions that NumPy's functions work on.

    Parameters
    ----------
    values : array-like
        Variables, expressions, parameters and numbers, in nested lists, tuples or arrays; an indexed component or a
        slice of one (``m.x[:, t]``) stands for the list of its members.

    Returns
    -------
    ExpressionArray
        ``dtype=object``; numbers stay numbers. ``np.sin``, ``np.sqrt``, ``np.arctan2``, ``np.hypot`` and the like,
        ``@``, ``np.dot``, ``np.sum``, ``np.mean``, ``np.cross``, ``np.linalg.norm`` and ``solve`` give
        expressions or arrays of expressions.

    Raises
    ------
    ModelError
        When rows have different lengths; later, when a function is applied that has no meaning for expressions, or that
        would break derivatives (``np.maximum``, ``np.sign``, a comparison in an ``if``). The message names the remedy.

    Notes
    -----
    Pyomo has no arctan2. It is built as ``2 arctan(y / (sqrt(x^2 + y^2) + x))``, which equals it wherever
    it is smooth: everywhere but on the line ``y = 0, x <= 0``, where this formula has no value.

    Examples
    --------
    >>> import numpy as np, pyomo.environ as pyo
    >>> m = pyo.ConcreteModel()
    >>> m.x = pyo.Var([0, 1], initialize={0: 3.0, 1: 4.0})
    >>> x = array([m.x[0], m.x[1]])  # rcp.array
    >>> m.circle = pyo.Constraint(expr=np.linalg.norm(x) <= 5)
    >>> [pyo.value(entry) for entry in np.array([[1, 2], [0, 1]]) @ x]
    [11.0, 4.0]
    """
    if isinstance(values, ExpressionArray):
        return values
    if hasattr(type(values), "as_expression_array"):
        return values.as_expression_array()  # a vector of parameters
    if isinstance(values, np.ndarray) and values.dtype.kind in "fiub":
        return values.astype(object).view(ExpressionArray)  # numbers only
    found = np.array(_nested(values), dtype=object)
    if any(isinstance(entry, list) for entry in found.flat):
        raise ModelError("an array of expressions: its rows have different shapes, which have to be alike.")
    return found.view(ExpressionArray)


def plain_expressions(result: Any) -> Any:
    """What a rule returned, in Pyomo's own expressions.

    Arrays become lists of their entries, row by row; an array without dimension becomes its entry. Lists are flattened
    where arrays stand in them. Mappings and tuples keep their form; an array with one entry is that entry there.
    Everything else is itself.
    """
    if isinstance(result, ArrayEntry):
        return result.expression
    if isinstance(result, np.ndarray):
        return [plain_entry(entry) for entry in result.ravel().tolist()] if result.ndim else plain_entry(result.item())
    if isinstance(result, list):
        rows: list[Any] = []
        for entry in result:
            plain = plain_expressions(entry)
            rows.extend(plain) if isinstance(entry, np.ndarray) and entry.ndim else rows.append(plain)
        return rows
    if result.__class__ is tuple:
        return tuple(plain_expressions(entry) for entry in result)
    if isinstance(result, Mapping):
        return {key: plain_expressions(_single(entry)) for key, entry in result.items()}
    return result


def _single(result: Any) -> Any:
    return result.reshape(()) if isinstance(result, np.ndarray) and result.size == 1 else result


def plain_entry(entry: Any) -> Any:
    """One entry of an array, as Pyomo knows it."""
    if isinstance(entry, ArrayEntry):
        return entry.expression
    return entry.item() if isinstance(entry, np.generic) else entry


def plain_scalar(result: Any, label: str) -> Any:
    """One plain expression, where a rule may have returned an array with one entry.

    Raises
    ------
    ModelError
        When the array has several entries; the message begins with `label`.
    """
    if isinstance(result, np.ndarray):
        if result.size != 1:
            raise ModelError(
                f"{label} is an array of shape {result.shape}, where one expression is expected. Sum it by np.sum or @."
            )
        result = result.reshape(-1)[0]
    return plain_entry(result)


# -------------------------------------------------------------------- entries


def _is_zero(entry: Any) -> bool:
    return entry.__class__ in native_numeric_types and entry == 0


def _wrapped(entry: Any) -> Any:
    if isinstance(entry, ArrayEntry):
        return entry
    if isinstance(entry, np.generic):
        entry = entry.item()
    return entry if entry.__class__ in native_numeric_types or not _is_expression(entry) else ArrayEntry(entry)


def _is_expression(entry: Any) -> bool:
    """True for what Pyomo takes for a number; False for relations, which arrays may hold too."""
    return getattr(entry, "is_numeric_type", lambda: False)() is True


def _shortened(entry: Any, length: int = 60) -> str:
    text = str(entry)
    return text if len(text) <= length else f"{text[: length - 3]}..."


def _nested(values: Any) -> Any:
    """Lists of entries within lists, or the entry that stands for itself."""
    if isinstance(values, np.ndarray):
        values = values.tolist()
    if isinstance(values, IndexedComponent) and values.is_indexed():
        values = values.values()
    elif not isinstance(values, (list, tuple, range, IndexedComponent_slice)):
        return _wrapped(values)
    return [_nested(member) for member in values]


# -------------------------------------------------------------------- NumPy's functions


def _apply(ufunc: np.ufunc, method: str, inputs: tuple[Any, ...], options: dict[str, Any]) -> Any:
    """One of NumPy's functions, applied to arrays of entries and numbers."""
    name = ufunc.__name__
    arrays = [np.asarray(array(given)) for given in inputs]
    for target in options.get("out", ()):
        if target is not None and target.dtype != object:
            raise ModelError(
                f"np.{name}: an expression cannot be stored in an array of {target.dtype}. Make the array with "
                "dtype=object, or write a = a + b instead of a += b."
            )
    if "out" in options:
        options["out"] = tuple(None if target is None else np.asarray(target) for target in options["out"])
    if name in FUNCTIONS:
        ufunc = np.frompyfunc(_entrywise(name), ufunc.nin, 1)
    elif name in _RELATIONS:
        options["dtype"] = object  # NumPy would ask whether each relation is true
    elif name not in KEEP_THEIR_MEANING:
        raise ModelError(f"np.{name} is not defined for expressions. {remedy_for(name)}")
    result = getattr(ufunc, method)(*arrays, **options)
    return result.view(ExpressionArray) if isinstance(result, np.ndarray) else result


def _entrywise(name: str) -> Callable[..., Any]:
    function, on_numbers = FUNCTIONS[name], getattr(np, name)

    def apply(*entries: Any) -> Any:
        if any(isinstance(entry, ArrayEntry) for entry in entries):
            return ArrayEntry(function(*map(plain_entry, entries)))
        return float(on_numbers(*map(float, entries)))

    return apply


# -------------------------------------------------------------------- small systems of equations

_LARGEST_SYSTEM = 4


def _determinant(matrix: Any) -> Any:
    return _expanded(_square(matrix, "det"))


def _expanded(entries: ExpressionArray) -> Any:
    """A determinant by expansion: without pivots, which would depend on values."""
    if not len(entries):
        return 1.0
    return sum((-1.0) ** j * entries[0, j] * _expanded(_minor(entries, 0, j)) for j in range(len(entries)))


def _minor(entries: ExpressionArray, row: int, column: int) -> ExpressionArray:
    kept = np.delete(np.delete(np.asarray(entries), row, axis=0), column, axis=1)
    return kept.view(ExpressionArray)


def _inverse(matrix: Any) -> Any:
    entries = _square(matrix, "inv")
    places = range(len(entries))
    cofactors = [[(-1.0) ** (i + j) * _expanded(_minor(entries, j, i)) for j in places] for i in places]
    return array(cofactors) / _expanded(entries)


def _solve(matrix: Any, right_hand_side: Any) -> Any:
    return _inverse(matrix) @ array(right_hand_side)


def _square(matrix: Any, name: str) -> ExpressionArray:
    entries = array(matrix)
    if entries.ndim != 2 or entries.shape[0] != entries.shape[1] or not 0 < len(entries) <= _LARGEST_SYSTEM:
        raise ModelError(
            f"np.linalg.{name} of expressions: the matrix has shape {entries.shape}; formulas are made for square "
            f"ones up to {_LARGEST_SYSTEM} x {_LARGEST_SYSTEM}. State larger systems as residuals: A @ x - b with "
            "algebraics x."
        )
    return entries


_LINEAR_ALGEBRA: dict[Any, Callable[..., Any]] = {
    np.linalg.det: _determinant,
    np.linalg.inv: _inverse,
    np.linalg.solve: _solve,
}
