"""NumPy's functions, by name, as functions of Pyomo's expressions."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pyomo.core.expr as pyomo_functions

from .expression_nodes import NUMPY_NAMES

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
