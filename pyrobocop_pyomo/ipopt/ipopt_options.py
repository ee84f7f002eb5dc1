"""Passing options to Ipopt, whose C interface wants to know the type of each one."""

from __future__ import annotations

import difflib
import numbers
from collections.abc import Mapping
from typing import Any

from pyrobocop_pyomo.errors import ModelError

from .c_output import c_output_captured
from .ipopt_library import IpoptLibrary

# Names that are requested often, for "Did you mean".
FREQUENT_OPTIONS = (
    "acceptable_iter", "acceptable_tol", "bound_push", "bound_relax_factor", "compl_inf_tol", "constr_viol_tol",
    "dual_inf_tol", "file_print_level", "hessian_approximation", "linear_solver", "max_cpu_time", "max_iter",
    "max_wall_time", "mu_init", "mu_strategy", "mu_target", "nlp_scaling_method", "output_file", "print_level",
    "print_timing_statistics", "tol", "warm_start_init_point",
)  # fmt: skip
# What a library has accepted once, and as what: it need not be watched again for what it prints.
_ACCEPTED: dict[tuple[str, str, type, Any], str | int | float] = {}


def set_options(library: IpoptLibrary, problem: int, options: Mapping[str, Any], *, silent: bool) -> None:
    """Hand options to Ipopt's problem.

    Parameters
    ----------
    library : IpoptLibrary
        The library that `problem` belongs to.
    problem : int
        Address of Ipopt's problem.
    options : mapping of str to str, int, float or bool
        Each value is tried as what it is and then as what it can stand for: ``1`` as a number, ``"100"`` and
        ``100.0`` as integers, as the ``ipopt`` executable takes them.
    silent : bool
        Print nothing, whatever ``print_level`` says.

    Raises
    ------
    ModelError
        When Ipopt refuses one.
    """
    settings = dict(options)
    if silent:
        settings |= {"print_level": 0, "sb": "yes"}
    known = [(library.path, name, value.__class__, value) for name, value in settings.items()]
    if all(isinstance(one[-1], str | int | float) and one in _ACCEPTED for one in known):
        for one in known:
            _add(library, problem, one[1], _ACCEPTED[one])
        return
    refused = None
    # Ipopt prints an explanation of each refused attempt, also of those that merely guessed the wrong type.
    with c_output_captured() as explanations:
        for name, value in settings.items():
            if not _set(library, problem, name, value):
                refused = name
                break
    if refused is not None:
        told = "".join(explanations)
        raise ModelError(
            f"Ipopt option '{refused}': the value {settings[refused]!r} is refused by {library}. "
            f"{_last_explanation(told)}{_nearest(refused, told)} "
            "See https://coin-or.github.io/Ipopt/OPTIONS.html for names and values."
        )


def _nearest(name: str, explanation: str) -> str:
    """Which option may be meant, where Ipopt knows none of this name."""
    near = difflib.get_close_matches(name, FREQUENT_OPTIONS, n=1) if "not a valid option" in explanation else []
    return f" Did you mean '{near[0]}'?" if near else ""


def _last_explanation(text: str) -> str:
    """The sentence about the last attempt, and the allowed range, out of all that Ipopt printed."""
    lines = [line.strip() for line in text.splitlines()]
    sentences = [line for line in lines if line.startswith(("Tried to set", "Setting:"))]
    ranges = [line for line in lines if "<" in line and "(" in line]
    told = sentences[-1] if sentences else "Ipopt gives no reason."
    return f"{told} Allowed, with the default in brackets: {ranges[-1]}." if ranges else told


def _set(library: IpoptLibrary, problem: int, name: str, value: Any) -> bool:
    for attempt in readings(name, value):
        if _add(library, problem, name, attempt):
            if isinstance(value, str | int | float):
                _ACCEPTED[library.path, name, value.__class__, value] = attempt
            return True
    return False


def _add(library: IpoptLibrary, problem: int, name: str, attempt: str | int | float) -> bool:
    functions, key = library.functions, name.encode()
    if isinstance(attempt, str):
        return bool(functions.AddIpoptStrOption(problem, key, attempt.encode()))
    if isinstance(attempt, int):
        return bool(functions.AddIpoptIntOption(problem, key, attempt))
    return bool(functions.AddIpoptNumOption(problem, key, attempt))


def readings(name: str, value: Any) -> list[str | int | float]:
    """What the value of an option can mean to Ipopt, most literal first.

    Raises
    ------
    ModelError
        When it is neither text nor a number.
    """
    if isinstance(value, bool):
        return ["yes" if value else "no"]
    if isinstance(value, str):
        return [value, *_numeric_readings(value)]
    if isinstance(value, numbers.Integral):
        # ctypes would wrap an integer beyond 32 bits silently.
        return [int(value), float(value)] if abs(int(value)) < 2**31 else [float(value)]
    if isinstance(value, numbers.Real):
        number = float(value)
        return [number, int(number)] if number.is_integer() and abs(number) < 2**31 else [number]
    raise ModelError(f"Ipopt option '{name}': the value {value!r} is neither text nor a number.")


def _numeric_readings(text: str) -> list[int | float]:
    try:
        number = float(text)
    except ValueError:
        return []
    return [int(number), number] if number.is_integer() and abs(number) < 2**31 else [number]
