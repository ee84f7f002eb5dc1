"""Problems as JSON with functions that CasADi has serialised, as the collection NOSBENCH stores them.

A problem is ``min f(w, p)`` where ``lbw <= w <= ubw``, ``lbg <= g(w, p) <= ubg`` and ``0 <= G(w, p) ⟂ H(w, p) >= 0``.
Two layouts are read:

* as the collection describes itself, which is also how it is written: ``w``, ``p`` (serialised symbols), ``lbw``,
  ``ubw``, ``w0``, ``p0``, ``lbg``, ``ubg``, and serialised functions ``g_fun``, ``G_fun``, ``H_fun``,
  ``augmented_objective_fun``;
* as its newer files are: ``w``, ``g``, ``p``, ``G``, ``H`` are objects with ``sym`` (symbols, or a serialised function
  of w and p) and ``numerical_vectors`` with ``lb``, ``ub``, ``init``, ``val``. ``f`` is a serialised function.

References
----------
Nurkanović, Pozharskiy and Diehl (2024), Solving mathematical programs with complementarity constraints arising in
nonsmooth optimal control, Vietnam J. Math., doi:10.1007/s10013-024-00704-z
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.optional_imports import casadi

from .arithmetic import NUMBERS, Arithmetic
from .file_problem import FilePair, FileProblem, FileRow, FileStatement

# CasADi's operators by their names there, with ours.
_OPERATORS = {
    "ADD": "+", "SUB": "-", "MUL": "*", "DIV": "/", "POW": "**", "CONSTPOW": "**", "NEG": "neg", "SQ": "square",
    "FABS": "abs", "NOT": "not", "FMIN": "min", "FMAX": "max", "LT": "<", "LE": "<=", "EQ": "==",
    **{name.upper(): name for name in (
        "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh", "exp", "log",
        "sqrt", "ceil", "floor",
    )},
}  # fmt: skip

_DERIVED: dict[str, Callable[..., Any]] = {
    "ASSIGN": lambda f, a: a,
    "TWICE": lambda f, a: 2.0 * a,
    "INV": lambda f, a: 1.0 / a,
    "IF_ELSE_ZERO": lambda f, condition, a: f["choose"](condition, a, 0.0),
    "SIGN": lambda f, a: f["choose"](a > 0, 1.0, f["choose"](a < 0, -1.0, 0.0)),
    "LOG1P": lambda f, a: f["log"](1.0 + a),
    "EXPM1": lambda f, a: f["exp"](a) - 1.0,
    "HYPOT": lambda f, a, b: f["sqrt"](a**2 + b**2),
}


def read_json(path: Path) -> FileProblem:
    """Read a file; the parameters and errors are those of `read_file`."""
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
        stated = _newer(facts) if isinstance(facts["w"], dict) else _described(facts)
        problem = _problem(path.stem, **stated)
    except KeyError as error:
        raise ModelError(f"{path}: has no entry {error}; how such a file is laid out is said in the manual.") from None
    except (ValueError, TypeError, AttributeError, RuntimeError) as error:
        reason = str(error).strip().splitlines()[-1] if str(error).strip() else type(error).__name__
        raise ModelError(f"{path}: no problem with functions of CasADi can be read from it ({reason}).") from error
    return problem


def _described(facts: dict[str, Any]) -> dict[str, Any]:
    """The entries of a problem as the collection describes itself."""
    return {
        "symbols": facts["w"], "lower": facts["lbw"], "upper": facts["ubw"], "start": facts["w0"],
        "parameters": facts["p0"], "row_lower": facts["lbg"], "row_upper": facts["ubg"],
        "functions": [facts[name] for name in ("augmented_objective_fun", "g_fun", "G_fun", "H_fun")],
    }  # fmt: skip


def _newer(facts: dict[str, Any]) -> dict[str, Any]:
    """The same of a newer file."""
    w, g = (facts[name]["numerical_vectors"] for name in ("w", "g"))
    return {
        "symbols": facts["w"]["sym"], "lower": w["lb"], "upper": w["ub"], "start": w["init"],
        "parameters": facts["p"]["numerical_vectors"]["val"], "row_lower": g["lb"], "row_upper": g["ub"],
        "functions": [facts["f"], *(facts[name]["sym"] for name in "gGH")],
    }  # fmt: skip


def _vector(numbers: Any, missing: float) -> list[float]:
    """A list of numbers; MATLAB writes a vector of one as a number, and infinite numbers as null."""
    listed = numbers if isinstance(numbers, list) else [numbers]
    return [missing if number is None else float(number) for number in listed]


def _problem(
    name: str, symbols: str, lower: Any, upper: Any, start: Any, parameters: Any, row_lower: Any, row_upper: Any,
    functions: Sequence[str],
) -> FileProblem:  # fmt: skip
    low, high, initial = _vector(lower, -math.inf), _vector(upper, math.inf), _vector(start, 0.0)
    if not len(low) == len(high) == len(initial):
        raise ValueError(f"{len(low)} lower bounds, {len(high)} upper bounds, {len(initial)} start values")
    w, p = casadi.SX.sym("w", len(low)), casadi.DM(_vector(parameters, 0.0))
    parts = []
    for serialised in functions:
        function = casadi.Function.deserialize(serialised).expand()
        parts.append(casadi.vec(casadi.densify(function(w, p) if function.n_in() > 1 else function(w))))
    together = casadi.Function("problem", [w], [casadi.vertcat(*parts)])
    rows, pairs, others = parts[1].numel(), parts[2].numel(), parts[3].numel()
    ends = _vector(row_lower, -math.inf), _vector(row_upper, math.inf)
    if not (rows == len(ends[0]) == len(ends[1]) and pairs == others):
        raise ValueError(
            f"{rows} rows with {len(ends[0])} lower and {len(ends[1])} upper bounds; {pairs} and {others} sides"
        )
    program = _Instructions(together)

    def evaluate(variables: Sequence[Any], arithmetic: Arithmetic) -> FileStatement:
        if arithmetic is NUMBERS:
            values = np.array(together(casadi.DM(list(variables)))).ravel().tolist()
        else:
            values = program.evaluate(variables, arithmetic)
        bodies, firsts, seconds = values[1 : 1 + rows], values[1 + rows : 1 + rows + pairs], values[1 + rows + pairs :]
        return FileStatement(
            values[0],
            [FileRow(f"g[{i}]", *each) for i, each in enumerate(zip(ends[0], bodies, ends[1], strict=True))],
            [FilePair(f"pair[{i}]", 0.0, a, math.inf, b) for i, (a, b) in enumerate(zip(firsts, seconds, strict=True))],
        )

    return FileProblem(name, _names(symbols, len(low)), low, high, list(initial), False, evaluate)


def _names(symbols: str, count: int) -> tuple[str, ...]:
    """Names of the symbols, numbers where they have none of their own."""
    try:
        names = [element.name() for element in casadi.vertsplit(casadi.SX.deserialize(symbols))]
    except RuntimeError:  # a matrix symbol, whose elements have no names
        names = []
    return tuple(names) if len(set(names)) == count else tuple(map(str, range(count)))


class _Instructions:
    """The instructions of a function of CasADi, each value once.

    Parameters
    ----------
    function : casadi.Function
        Of scalar operations, with one vector in and one out.
    """

    def __init__(self, function: Any) -> None:
        known = {getattr(casadi, f"OP_{name}"): name for name in (*_OPERATORS, *_DERIVED)}
        self._values: list[tuple[str, list[Any]]] = []
        self._outputs: list[int] = [0] * function.numel_out(0)
        registers: dict[int, int] = {}
        for k in range(function.n_instructions()):
            kind, into, of = (getattr(function, f"instruction_{what}")(k) for what in ("id", "output", "input"))
            if kind == casadi.OP_OUTPUT:
                self._outputs[into[1]] = registers[of[0]]
                continue
            if kind == casadi.OP_CONST:
                value: tuple[str, list[Any]] = ("constant", [float(function.instruction_constant(k))])
            elif kind == casadi.OP_INPUT:
                value = ("input", [of[1]])
            elif kind in known:
                value = (known[kind], [registers[register] for register in of])
            else:
                raise ValueError(f"CasADi's operator {kind} is not known here")
            registers[into[0]] = len(self._values)
            self._values.append(value)
        self._uses = Counter(self._outputs)
        for name, arguments in self._values:
            if name not in ("constant", "input"):
                self._uses.update(arguments)

    def evaluate(self, variables: Sequence[Any], arithmetic: Arithmetic) -> list[Any]:
        """Its outputs, given its inputs."""
        values: list[Any] = []
        for place, (name, arguments) in enumerate(self._values):
            if name in ("constant", "input"):
                values.append(arguments[0] if name == "constant" else variables[arguments[0]])
                continue
            operands = [values[argument] for argument in arguments]
            if name in _OPERATORS:
                value = arithmetic.functions[_OPERATORS[name]](*operands)
            else:
                value = _DERIVED[name](arithmetic.functions, *operands)
            values.append(arithmetic.share(value) if self._uses[place] > 1 else value)
        return [values[place] for place in self._outputs]
