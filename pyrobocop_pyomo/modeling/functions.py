"""Functions written in Python, for many points at once: `Function`, and the nodes of expressions that call it."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray
from pyomo.core.expr.numeric_expr import ExternalFunctionExpression, NPV_ExternalFunctionExpression
from pyomo.core.expr.numvalue import native_numeric_types, value

from pyrobocop_pyomo.errors import EvaluationError, FunctionError

from .expression_arrays import ArrayEntry, plain_entry
from .expressions import is_indexed_component
from .pyomo_internals import function_of_call

logger = logging.getLogger(__name__)

FloatArray = NDArray[np.float64]

# The third root of the rounding error: where truncation and rounding of a central difference are alike.
_STEP = 6.0e-6
_TOLERANCE = 1e-4
# Points of a model at which derivatives are compared with differences, once for each function.
CHECKED_POINTS = 4


class Function:
    """A function in Python, evaluated at many points at once: a learned model, a table, another library.

    Called with variables or expressions it gives expressions, which are legal wherever Pyomo's are; called with
    numbers it gives numbers. What calls it is solved in this process: in each iteration of Ipopt `value` and the
    derivatives are called once for all points of the model.

    Parameters
    ----------
    value : callable
        From points, shape (points, inputs), to values of shape (points, outputs); for one output without a name
        (``outputs=None``) also of shape (points,). Each point by itself: no value may depend on another point.
    jacobian : callable
        From points to first derivatives, shape (points, outputs, inputs); (points, inputs) for one output.
    hessian : callable, optional
        From points to second derivatives, shape (points, outputs, inputs, inputs); (points, inputs, inputs) for one
        output. Without it they are central differences of `jacobian`, with a relative error of about 1e-10.
    inputs : int or sequence of str, optional
        How many, or their names. By default any number, as the calls have it.
    outputs : int or sequence of str, optional
        How many, or their names; a call then returns a list. By default one, which a call returns by itself.
    name : str, optional
        For expressions that are printed and for messages; by default that of `value`.
    check_derivatives : bool
        Whether derivatives are compared with differences once, when a model is first solved.

    Attributes
    ----------
    name : str
    output_count : int

    Raises
    ------
    FunctionError
        When an argument makes no sense; later, when arrays have the wrong shape or derivatives are wrong.
    EvaluationError
        When a value or a derivative is not finite.

    Notes
    -----
    A function does not change: clones of a model share it. It is pickled with `value`, `jacobian` and `hessian`; give
    functions from the top level of a module, or methods of objects that can be pickled, where a model travels between
    processes.

    Examples
    --------
    >>> import numpy as np
    >>> import pyomo.environ as pyo
    >>> import pyrobocop_pyomo as rcp
    >>> drag = rcp.Function(lambda X: X[:, 0] * abs(X[:, 0]), lambda X: 2 * abs(X), name="drag")
    >>> m = pyo.ConcreteModel()
    >>> m.v = pyo.Var(initialize=-3.0)
    >>> print(drag(m.v) + 1, pyo.value(drag(m.v)), drag(2.0))
    drag(v) + 1 -9.0 4.0
    """

    def __init__(
        self,
        value: Callable[[FloatArray], Any],
        jacobian: Callable[[FloatArray], Any],
        hessian: Callable[[FloatArray], Any] | None = None,
        *,
        inputs: int | Sequence[str] | None = None,
        outputs: int | Sequence[str] | None = None,
        name: str | None = None,
        check_derivatives: bool = True,
    ) -> None:
        own_name = getattr(value, "__name__", type(value).__name__)
        self.name = name if name is not None else "function" if own_name == "<lambda>" else own_name
        for word, given in (("value", value), ("jacobian", jacobian), ("hessian", hessian)):
            if not callable(given) and not (word == "hessian" and given is None):
                raise FunctionError(f"'{self.name}': {word} is {given!r}; it must be a function of the points.")
        self._value, self._jacobian, self._hessian = value, jacobian, hessian
        self._input_count, self._input_names = _count_and_names(inputs, self.name, "inputs")
        count, self._output_names = _count_and_names(outputs, self.name, "outputs")
        self.output_count = 1 if count is None else count
        self._single = outputs is None
        self._outputs = [FunctionOutput(self, i) for i in range(self.output_count)]
        self._unchecked = check_derivatives
        self._last: tuple[tuple[float, ...], FloatArray] | None = None

    @property
    def has_hessian(self) -> bool:
        """Whether second derivatives are given; otherwise they are differences."""
        return self._hessian is not None

    def __repr__(self) -> str:
        inputs = "any" if self._input_count is None else self._input_count
        return f"Function('{self.name}', inputs={inputs}, outputs={self.output_count})"

    def __deepcopy__(self, memo: dict[int, Any]) -> Function:
        # Clones of a model share the function as they share sin: it may hold thousands of centres.
        return self

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_last": None}

    def __call__(self, *arguments: Any) -> Any:
        """The function of these arguments, as an expression for each output; numbers where all arguments are.

        Parameters
        ----------
        *arguments : variables, expressions, parameters and numbers, or lists and arrays of these
            The inputs, in order. Called with entries of an `array`, a function gives such entries.

        Raises
        ------
        FunctionError
            When their count is wrong, or one of them is no number of Pyomo's.
        """
        wrapped: list[Any] = []
        flat = tuple(self._flattened(arguments, wrapped))
        if self._input_count is not None and len(flat) != self._input_count:
            names = f" ({', '.join(self._input_names)})" if self._input_names else ""
            raise FunctionError(
                f"'{self.name}' takes {self._input_count} inputs{names}, and was called with {len(flat)}."
            )
        if not flat:
            raise FunctionError(f"'{self.name}' was called without inputs.")
        if all(argument.__class__ in native_numeric_types for argument in flat):
            results: list[Any] = self.values_at(flat).tolist()
        else:
            variable = any(a.__class__ not in native_numeric_types and a.is_potentially_variable() for a in flat)
            node = ExternalFunctionExpression if variable else NPV_ExternalFunctionExpression
            results = [node(flat, output) for output in self._outputs]
        if wrapped:
            results = list(map(ArrayEntry, results))
        return results[0] if self._single else results

    def _flattened(self, arguments: Iterable[Any], wrapped: list[Any]) -> Iterable[Any]:
        for argument in arguments:
            if isinstance(argument, np.ndarray) and argument.ndim == 0:
                argument = argument.item()
            if isinstance(argument, ArrayEntry):
                wrapped.append(argument)
            argument = plain_entry(argument)
            if argument.__class__ in native_numeric_types:
                yield argument
            elif is_indexed_component(argument):
                raise FunctionError(
                    f"'{self.name}': the input '{argument.name}' is indexed. Give one of its items: is [t] missing?"
                )
            elif hasattr(argument, "is_numeric_type") and argument.is_numeric_type() is True:
                yield argument
            elif isinstance(argument, str) or not isinstance(argument, Iterable):
                raise FunctionError(
                    f"'{self.name}': the input {argument!r} is no variable, expression, parameter or number."
                )
            else:
                yield from self._flattened(argument, wrapped)

    # ---------------------------------------------------------------- values

    def values_at(self, point: Sequence[float]) -> FloatArray:
        """All outputs at one point, shape (outputs,); those of the last point are remembered."""
        key = tuple(float(number) for number in point)
        if self._last is None or self._last[0] != key:
            self._last = key, self.values(np.array([key]))[0]
        return self._last[1]

    def values(self, points: FloatArray) -> FloatArray:
        """Values at many points, shape (points, outputs)."""
        return self._finite(self._asked(self._value, "value", points, (self.output_count,)), "value", points)

    def jacobians(self, points: FloatArray) -> FloatArray:
        """First derivatives at many points, shape (points, outputs, inputs)."""
        shape = (self.output_count, points.shape[1])
        return self._finite(self._asked(self._jacobian, "jacobian", points, shape), "first derivative", points)

    def hessians(self, points: FloatArray) -> FloatArray:
        """Second derivatives at many points, shape (points, outputs, inputs, inputs)."""
        inputs = points.shape[1]
        if self._hessian is None:
            differences = central_differences(self.jacobians, points)
            return (differences + differences.swapaxes(2, 3)) / 2
        shape = (self.output_count, inputs, inputs)
        return self._finite(self._asked(self._hessian, "hessian", points, shape), "second derivative", points)

    def _asked(
        self, function: Callable[[FloatArray], Any], label: str, points: FloatArray, shape: tuple[int, ...]
    ) -> FloatArray:
        """A copy of what the user's function returns, in the full shape."""
        points = np.array(points, dtype=float)
        full = (points.shape[0], *shape)
        try:
            with np.errstate(all="ignore"):  # what is not finite is named below
                found = function(points.copy())
        except EvaluationError:
            raise
        except ArithmeticError as error:
            raise EvaluationError(f"'{self.name}': {label} raised {type(error).__name__}: {error}.") from error
        except Exception as error:
            raise FunctionError(
                f"'{self.name}': {label}(X) raised {type(error).__name__}: {error}. X had shape {points.shape}, with "
                f"numbers from {points.min():g} to {points.max():g}. Where a point is outside its domain, return nan "
                "or raise rcp.errors.EvaluationError: Ipopt then tries a shorter step."
            ) from error
        try:
            array = np.array(found, dtype=float)
        except (TypeError, ValueError) as error:
            raise FunctionError(f"'{self.name}': {label}(X) returned a {type(found).__name__}: {error}.") from None
        if array.shape != full:
            without_output = (full[0], *full[2:])
            if not (self._single and array.shape == without_output):
                either = f" or {without_output}" if self._single else ""
                raise FunctionError(
                    f"'{self.name}': {label}(X) for X of shape {points.shape} returned the shape {array.shape}; it "
                    f"must be {full}{either}: points first" + (", then outputs, then inputs." if shape[1:] else ".")
                )
        return array.reshape(full)

    def _finite(self, array: FloatArray, label: str, points: FloatArray) -> FloatArray:
        if np.isfinite(array).all():
            return array
        point, output, *inputs = np.argwhere(~np.isfinite(array))[0]
        by = "" if not inputs else " by " + " and ".join(self.input_name(i) for i in inputs)
        raise EvaluationError(
            f"'{self._outputs[output].name}': its {label}{by} is {array[(point, output, *inputs)]} at "
            f"{self.described(points[point])}."
        )

    # ---------------------------------------------------------------- words

    def input_name(self, i: int) -> str:
        """Name of an input, or ``input 2``; the first is ``input 0``."""
        return f"'{self._input_names[i]}'" if self._input_names else f"input {i}"

    def output_name(self, i: int) -> str:
        """Name of an output: that of the function where it has one only."""
        if self._single:
            return self.name
        return f"{self.name}.{self._output_names[i]}" if self._output_names else f"{self.name}[{i}]"

    def described(self, point: FloatArray) -> str:
        """A point as ``(q = 1.5, v = 0)``."""
        names = self._input_names or [f"input {i}" for i in range(point.size)]
        return "(" + ", ".join(f"{name} = {number:.6g}" for name, number in zip(names, point, strict=False)) + ")"

    # ---------------------------------------------------------------- the check

    def check_derivatives(self, points: FloatArray) -> None:
        """Compare the derivatives with differences at some points, and each point by itself with all at once.

        Where the function has a kink, a derivative from either side is right.

        Parameters
        ----------
        points : float array, shape (points, inputs)

        Raises
        ------
        FunctionError
            Naming output, input, point and both numbers.
        """
        points = np.atleast_2d(np.asarray(points, dtype=float))
        values = self.values(points)
        by_itself = np.concatenate([self.values(point[None]) for point in points])
        if not np.allclose(values, by_itself, rtol=1e-6, atol=1e-9 * (1.0 + np.abs(values).max())):
            point, output = np.argwhere(~np.isclose(values, by_itself, rtol=1e-6))[0]
            raise FunctionError(
                f"'{self._outputs[output].name}': value(X) gives {values[point, output]:.6g} at "
                f"{self.described(points[point])} among {len(points)} points, and {by_itself[point, output]:.6g} for "
                "that point alone. Each row of X is a point by itself: use X[:, 0] for the first input of all points."
            )
        check_against_differences(self, self.values, self.jacobians, points, "jacobian")
        if self._hessian is not None:
            check_against_differences(self, self.jacobians, self.hessians, points, "hessian")

    def check_derivatives_once(self, points: FloatArray) -> None:
        """Check at a few of these points, unless the function was checked before."""
        if not self._unchecked:
            return
        chosen = np.unique(points, axis=0)
        chosen = chosen[np.unique(np.linspace(0, len(chosen) - 1, CHECKED_POINTS).astype(int))]
        self.check_derivatives(chosen)
        self._unchecked = False


def _count_and_names(
    given: int | Sequence[str] | None, name: str, label: str
) -> tuple[int | None, tuple[str, ...] | None]:
    if given is None:
        return None, None
    if isinstance(given, (str, bool)) or (isinstance(given, int) and given < 1):
        raise FunctionError(f"'{name}': {label} is {given!r}; it must be a count of at least 1, or a list of names.")
    if isinstance(given, int):
        return given, None
    names = tuple(given)
    if not names or len(set(names)) < len(names) or not all(isinstance(word, str) for word in names):
        raise FunctionError(f"'{name}': {label} is {given!r}; it must be a list of different names.")
    return len(names), names


class FunctionOutput:
    """One output of a `Function`, as Pyomo's nodes want to see a function.

    Pyomo's own class of nodes for external functions calls it, so that Pyomo's walks know what to do: evaluation,
    clones, replacement of variables, units, standard forms.

    Parameters
    ----------
    function : Function
    index : int
    """

    __slots__ = ("function", "index")

    def __init__(self, function: Function, index: int) -> None:
        self.function, self.index = function, index

    def __deepcopy__(self, memo: dict[int, Any]) -> FunctionOutput:
        return self

    @property
    def name(self) -> str:
        """Name of the function with that of the output."""
        return self.function.output_name(self.index)

    def getname(self, *arguments: Any, **options: Any) -> str:
        """`name`, as Pyomo asks for it."""
        return self.name

    def get_units(self) -> None:
        """Units of the output: numbers have none."""

    get_arg_units = get_units

    def evaluate(self, arguments: Iterable[Any]) -> float:
        """Value at one point."""
        return float(self.function.values_at([value(argument) for argument in arguments])[self.index])

    def evaluate_arrays(self, arguments: Iterable[Any]) -> FloatArray:
        """Values at all points of arrays that are broadcast to one shape."""
        arrays = np.broadcast_arrays(*(np.asarray(argument, dtype=float) for argument in arguments))
        points = np.stack([array.ravel() for array in arrays], axis=1)
        return np.asarray(self.function.values(points)[:, self.index].reshape(arrays[0].shape))

    def evaluate_fgh(
        self, args: Iterable[Any], fixed: Sequence[bool] | None = None, fgh: int = 2
    ) -> tuple[float, list[float] | None, list[float] | None]:
        """Value, gradient and the Hessian's upper triangle by columns, as Pyomo's external functions give them."""
        point = np.array([[value(argument) for argument in args]], dtype=float)
        free = np.ones(point.shape[1]) if fixed is None else 1.0 - np.asarray(fixed, dtype=float)
        gradient = hessian = None
        if fgh >= 1:
            gradient = (self.function.jacobians(point)[0, self.index] * free).tolist()
        if fgh >= 2:
            full = self.function.hessians(point)[0, self.index] * np.outer(free, free)
            hessian = full.T[np.tril_indices(free.size)].tolist()
        return self.evaluate(point[0].tolist()), gradient, hessian

    @property
    def _function(self) -> str:
        # Writers of .nl files ask for this name first, and for the library when it comes to writing it down.
        return f"python function {id(self.function)} {self.index}"

    @property
    def _library(self) -> NoReturn:
        raise FunctionError(python_function_refused(f"the Python function '{self.name}'"))


def python_function_refused(label: str) -> str:
    """Why a model cannot be written to a file, and what to do."""
    return (
        f"{label} is called, which a program from a file cannot. Solve in this process with derivatives by CasADi, "
        "which is the default: rcp.solve(m), or SolverFactory('pyrobocop.ipopt')."
    )


def is_function_call(node: Any) -> bool:
    """Whether a node calls an output of a `Function`."""
    return isinstance(node, ExternalFunctionExpression) and isinstance(function_of_call(node), FunctionOutput)


def function_called(node: Any) -> Any:
    """The `Function` of which a node calls an output; None for other nodes."""
    return function_of_call(node).function if is_function_call(node) else None


def central_differences(function: Callable[[FloatArray], FloatArray], points: FloatArray) -> FloatArray:
    """Derivatives of an array-valued function, the last axis by inputs; all points and inputs in one call.

    Parameters
    ----------
    function : callable
        From points, shape (points, inputs), to an array of shape (points, ...).
    points : float array, shape (points, inputs)
    """
    count, inputs = points.shape
    steps = _STEP * np.maximum(1.0, np.abs(points))
    # What is added is rounded: the difference is taken over what really stands between the points.
    moved = np.repeat(points[None], 2 * inputs, axis=0)
    for i in range(inputs):
        moved[i, :, i] += steps[:, i]
        moved[inputs + i, :, i] -= steps[:, i]
    found = function(moved.reshape(-1, inputs))
    found = found.reshape(2 * inputs, count, *found.shape[1:])
    widths = np.stack([moved[i, :, i] - moved[inputs + i, :, i] for i in range(inputs)])
    quotients = (found[:inputs] - found[inputs:]) / widths.reshape(inputs, count, *[1] * (found.ndim - 2))
    return np.moveaxis(quotients, 0, -1)


def check_against_differences(
    owner: Any,
    function: Callable[[FloatArray], FloatArray],
    derivative: Callable[[FloatArray], FloatArray],
    points: FloatArray,
    label: str,
) -> None:
    """Compare what is given as a derivative with differences, input by input.

    Parameters
    ----------
    owner : Function
        Knows the words for a message.
    function, derivative : callable
        From points to arrays of shapes (points, outputs, ...) and (points, outputs, ..., inputs).
    points : float array, shape (points, inputs)
    label : str
        Name of the derivative, for a message.

    Raises
    ------
    FunctionError
        Naming output, inputs, point and both numbers.
    """
    here, given = function(points), derivative(points)
    steps = _STEP * np.maximum(1.0, np.abs(points))
    for i in range(points.shape[1]):
        try:
            forward, backward = (_quotient(function, here, points, i, sign * steps[:, i]) for sign in (1.0, -1.0))
            nearer = sum(_quotient(function, here, points, i, sign * steps[:, i] / 2) / 2 for sign in (1.0, -1.0))
        except (EvaluationError, FunctionError):
            continue  # beyond the edge of the domain there is nothing to compare with
        central = (forward + backward) / 2
        of_floats = np.finfo(float)
        # Products of the smallest numbers are zero.
        rounding = 1e4 * of_floats.eps * np.abs(here).max(initial=0.0) / steps[:, i].min() + of_floats.tiny
        sizes = np.maximum(np.abs(given[..., i]), np.abs(central))
        # Where both sides differ there is a kink, and where half the step makes a difference one of a derivative.
        allowed = _TOLERANCE * sizes + np.abs(forward - backward) + 10 * np.abs(central - nearer) + rounding
        wrong = np.abs(given[..., i] - central) > allowed
        if wrong.any():
            point, output, *inner = np.argwhere(wrong)[0]
            inputs = " and ".join(owner.input_name(k) for k in (*inner, i))
            raise FunctionError(
                f"'{owner.output_name(output)}': {label} gives {given[(point, output, *inner, i)]:.8g} as the "
                f"derivative by {inputs} at {owner.described(points[point])}; differences give "
                f"{central[(point, output, *inner)]:.8g}. Correct {label}; check_derivatives=False trusts it as it is."
            )


def _quotient(
    function: Callable[[FloatArray], FloatArray], here: FloatArray, points: FloatArray, i: int, step: FloatArray
) -> FloatArray:
    moved = points.copy()
    moved[:, i] += step
    width = moved[:, i] - points[:, i]
    return np.asarray((function(moved) - here) / width.reshape(-1, *[1] * (here.ndim - 1)))
