"""A vectorised program as C definitions for ``term_evaluation.c``, some of whose parameters are set at run time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from pyrobocop_pyomo.programs.compiled_terms import CompiledFunction, CompiledTerm
from pyrobocop_pyomo.programs.summed_terms import SummedTerms
from pyrobocop_pyomo.programs.vectorised_program import VectorisedProgram


class CSource:
    """C definitions, in the order in which they are added.

    Attributes
    ----------
    lines : list of str
    """

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._names: dict[int, str] = {}
        self._arrays: list[np.ndarray] = []  # while they live, no other array has their identity

    def array(self, values: np.ndarray, name: str | None = None, *, constant: bool = True) -> str:
        """Define an array of numbers, once; returns its name."""
        if name is None and id(values) in self._names:
            return self._names[id(values)]
        name = name or f"numbers_{len(self._names)}"
        self._names[id(values)] = name
        self._arrays.append(values)
        kind = "double" if values.dtype.kind == "f" else f"int{8 * values.dtype.itemsize}_t"
        self.structures(kind, name, map(number, values.ravel().tolist()), constant=constant)
        return name

    def structures(self, kind: str, name: str, values: Iterable[str], *, constant: bool = True) -> int:
        """Define an array of anything; returns how many there are. An empty one has an element nobody reads."""
        found = list(values)
        lines = ",\n".join(", ".join(found[k : k + 8]) for k in range(0, len(found), 8)) or "0"
        self.lines.append(f"static {'const ' if constant else ''}{kind} {name}[] = {{\n{lines}\n}};")
        return len(found)


def number(value: float) -> str:
    """A number that a C compiler reads as the same."""
    if isinstance(value, int):
        return repr(value)
    if not math.isfinite(value):
        return "NAN" if math.isnan(value) else "INFINITY" if value > 0 else "-INFINITY"
    return repr(float(value))  # NumPy's own numbers are printed with their type


def program_source(program: VectorisedProgram, states: Sequence[Any], source: CSource) -> dict[str, int]:
    """Define ``program`` and what states change in it.

    Parameters
    ----------
    program : VectorisedProgram
        With compiled terms.
    states : sequence of VarData
        Fixed variables whose values are known at run time. Those that the program does not read change nothing.
    source : CSource

    Returns
    -------
    dict of str to int
        Counts, by the names that the definitions have for them.
    """
    parameters = program.numbers.parameters
    state_of = {program.numbers.index_of_parameter(data): k for k, data in enumerate(states)}
    state_of.pop(None, None)
    places: list[str] = []
    counts = {"VARIABLES": program.n, "ROWS": program.m}
    sums = {}
    for name, rows in (("cost", program.cost), ("row", program.rows)):
        sums[name] = _sums(name, rows, source)
        source.array(rows.constants, f"{name}_constants")
        counts[f"{name.upper()}_GIVEN"] = source.structures(
            "Given", f"{name}_given", _given(rows, parameters, state_of)
        )
        places += _places(rows, state_of, source)
    counts["PLACES"] = source.structures("Place", "places", places)
    gradient_columns = source.array(program.cost.structure[1].astype(np.int32))
    entries = program.hessian_structure[0].size
    source.lines.append(
        f"static const Program program = {{{program.n}, {entries}, {sums['cost']}, {sums['row']}, {gradient_columns}}};"
    )
    for name, structure in (("jacobian", program.jacobian_structure), ("hessian", program.hessian_structure)):
        counts[f"{name.upper()}_ENTRIES"] = structure[0].size
        for part, indices in zip(("rows", "columns"), structure, strict=True):
            source.array(indices.astype(np.int32), f"{name}_{part}")
    for name in ("x_lower", "x_upper", "g_lower", "g_upper"):
        source.array(getattr(program, name), name)
    return counts


def _sums(name: str, rows: SummedTerms, source: CSource) -> str:
    compiled = rows.compiled
    offsets = source.array(compiled.offsets, f"{name}_offsets", constant=False)
    source.structures("Term", f"{name}_terms", [_term(term, source) for term in compiled.terms])
    linear = ", ".join(map(source.array, compiled.linear))
    entries = source.array(compiled.constant_entries)
    return (
        f"{{{rows.rows}, {compiled.constant_entries.size}, {len(compiled.terms)}, {name}_terms, {offsets}, {linear}, "
        f"{entries}}}"
    )


def _term(term: CompiledTerm, source: CSource) -> str:
    numbers = source.array(term.numbers, constant=False)
    arrays = [source.array(term.columns), numbers, source.array(term.rows), source.array(term.scales)]
    functions = [_function(function, source) for function in term.functions]
    return f"{{{term.instances}, {', '.join(arrays)}, {', '.join(functions)}}}"


def _function(function: CompiledFunction, source: CSource) -> str:
    steps = source.array(function.steps)  # four numbers each, as a Step has them
    constants, places = source.array(function.constants), source.array(function.places)
    scales = "NULL" if function.scales is None else source.array(function.scales)
    return f"{{{len(function.steps)}, (const Step *){steps}, {constants}, {function.work}, {places}, {scales}}}"


def _given(rows: SummedTerms, parameters: np.ndarray, state_of: Mapping[Any, int]) -> list[str]:
    """In the order in which they are added, so that the sums are the same to the last digit."""
    given = zip(*(part.tolist() for part in rows.given), strict=True)
    return [
        f"{{{row}, {state_of.get(k, -1)}, {number(factor if k in state_of else factor * float(parameters[k]))}}}"
        for row, k, factor in given
    ]


def _places(rows: SummedTerms, state_of: Mapping[Any, int], source: CSource) -> list[str]:
    return [
        f"{{{source.array(function.compiled.numbers)} + {place}, {state_of[k]}}}"
        for function in rows.functions
        for place, k in zip(function.places_of_parameters.tolist(), function.parameters.tolist(), strict=True)
        if k in state_of
    ]
