"""A receding horizon as C source, for robots that have Ipopt but no Python."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.ipopt.ipopt_run import possible_values
from pyrobocop_pyomo.ipopt.linear_solvers import with_linear_solver
from pyrobocop_pyomo.linear_solver.factorisation import LINEAR_SOLVER_NAME
from pyrobocop_pyomo.native.shared_library import library_sources
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.phases import Control
from pyrobocop_pyomo.phases.phase_values import PhaseValues
from pyrobocop_pyomo.programs.nonlinear_program import PrimalDualPoint
from pyrobocop_pyomo.programs.summed_terms import SOURCE as TERM_EVALUATION
from pyrobocop_pyomo.programs.summed_terms import CompiledFunction, SummedTerms, TermFunction
from pyrobocop_pyomo.programs.vectorised_program import VectorisedProgram
from pyrobocop_pyomo.solving.ipopt_options import warm_start
from pyrobocop_pyomo.studies.persistent_nlp import Move, PlaceInProgram, ShiftedPlan
from pyrobocop_pyomo.studies.receding_horizon import RecedingHorizon

TEMPLATE, HEADER = Path(__file__).with_name("controller.c"), Path(__file__).with_name("controller.h")


def export_controller(horizon: RecedingHorizon, folder: str | Path, advance: float, *, mu: float = 1e-4) -> Path:
    """Write a receding horizon as C source, for a robot that has Ipopt but no Python.

    ``controller_step(state, control)`` does what `RecedingHorizon.step` does with this `advance` and this `mu`. Its
    first plan is the plan of the next `step`: warm where a plan has been made, else from the values on the model. Fixed
    values, Params and bounds stay as they are now. Safety is not verified, and where the linear solver of this package
    fails, no other has a try.

    Parameters
    ----------
    horizon : RecedingHorizon
    folder : path
        For ``controller.c``, ``controller.h`` and the sources of the linear solver; made where it is missing.
    advance : float
        From one step to the next, in the time of the phase.
    mu : float
        First barrier parameter of a warm start; see `RecedingHorizon.step`.

    Returns
    -------
    Path
        Of ``controller.c``. ``controller.h`` has the command that compiles all files to a library.

    Raises
    ------
    ModelError
        When pairs are made exact, or the phase keeps derivatives as variables; when `advance` is no time of the phase;
        when the program has Python functions, or no compiled terms; when a control is fixed at first.
        When an option of Ipopt is neither text nor a number.
    """
    phase, program = horizon.phase, horizon.program
    label, record = f"phase '{phase.name}'", phase.record
    if horizon.exact is not None or record.kept_derivatives:
        raise ModelError(f"{label}: a controller with exact_pairs=True or kept derivatives cannot be exported.")
    if not 0 < advance <= phase.duration:
        raise ModelError(f"{label}: advance = {advance!r}; expected a time from 0 to {phase.duration:g}.")
    program.update()
    of_phase, nlp = PhaseValues(phase), program.compiled.nlp
    place, moves = PlaceInProgram(of_phase, program.compiled.variables), ShiftedPlan(phase, of_phase).moves(advance)
    starts = {name: phase.component(name)[phase.initial_time] for name in sorted(record.names_of_states)}
    states = {name: variable for name, variable in starts.items() if variable.fixed}
    controls = record.names(Control)
    if not isinstance(nlp, VectorisedProgram) or nlp.compiled_run() is None:
        raise ModelError(
            f"'{program.model.name}': an exported controller has compiled terms only. Leave Python functions out, and "
            "see by 'python -m pyrobocop_pyomo doctor' whether terms are compiled here."
        )
    first = np.array([place.columns[control][0] for control in controls], dtype=np.int32)
    for k in np.flatnonzero(first < 0).tolist():
        raise ModelError(f"'{program.model.name}': the first value of '{controls[k]}' is fixed; it is no control then.")
    source = CSource()
    counts = {"STATES": len(states), "CONTROLS": len(controls)}
    counts |= program_source(nlp, list(states.values()), source)
    counts["MOVES"] = source.structures("Move", "moves", _moves(place, moves, states, nlp.n))
    for start, purpose in (("cold", {}), ("warm", warm_start(mu))):
        options, own_solver = with_linear_solver(program.options_of_run(purpose), nlp)
        listed = _options({**options, "print_level": 0, "sb": "yes"}, own_solver)
        counts[f"{start.upper()}_OPTIONS"] = source.structures("Option", f"{start}_options", listed)
    point = program.state or PrimalDualPoint(program.compiled.current_point())
    for array, values in zip(
        ("plan", "row_multipliers", "lower_multipliers", "upper_multipliers"),
        (point.x, *point.complete(nlp)),
        strict=True,
    ):
        # One more, since C has no empty arrays.
        source.array(values if array == "plan" else np.append(values, 0.0), array, constant=False)
    measured = np.array([float(value(state)) for state in states.values()])
    source.array(measured, "measured", constant=False)
    source.array(first, "first_controls")
    source.lines.append(f"static int planned = {int(program.state is not None)};")
    for kind, names in (("state", list(states)), ("control", list(controls))):
        quoted = ", ".join(map(json.dumps, names)) or "0"
        source.lines.append(f"const char *const controller_{kind}_names[] = {{{quoted}}};")
    enumeration = ", ".join(f"{name} = {count}" for name, count in counts.items())
    problem = "\n".join([f"enum {{ {enumeration} }};", *source.lines])
    text = TEMPLATE.read_text(encoding="utf-8")
    text = text.replace('#include "term_evaluation.c"\n', TERM_EVALUATION.read_text(encoding="utf-8"))
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    for file in (HEADER, *library_sources(LINEAR_SOLVER_NAME)):
        shutil.copy(file, target)
    written = target / TEMPLATE.name
    written.write_text(text.replace('#include "problem.c"\n', problem + "\n"), encoding="utf-8")
    return written


def _moves(
    place: PlaceInProgram, moves: Mapping[str, Move], states: Mapping[str, Any], variables: int
) -> Iterator[str]:
    measured = {name: variables + k for k, name in enumerate(states)}
    values_of_plan = place.read(np.zeros(variables))
    for name, move in moves.items():
        columns = place.columns[name]
        given = values_of_plan[name]
        weights: Array = np.array([move(unit) for unit in np.eye(columns.size)]).T
        for row in np.flatnonzero(columns >= 0):
            for k in np.flatnonzero(weights[row]).tolist():
                weight, source = float(weights[row, k]), int(columns[k])
                if source < 0 and k == 0 and name in measured:
                    source = measured[name]
                elif source < 0:
                    weight *= float(given[k])
                yield f"{{{columns[row]}, {source}, {number(weight)}}}"


def _options(options: Mapping[str, Any], own_solver: bool) -> Iterator[str]:
    for name, setting in options.items():
        if own_solver and name == "hsllib":
            yield f'{{"{name}", THIS_LIBRARY, 0, 0}}'
            continue
        literal = possible_values(name, setting)[0]
        if isinstance(literal, str):
            yield f'{{"{name}", TEXT, {json.dumps(literal)}, 0}}'
        else:
            yield f'{{"{name}", {"INTEGER" if isinstance(literal, int) else "REAL"}, 0, {number(literal)}}}'


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
    source.lines.append(
        f"static const Program program = {{{program.n}, {sums['cost']}, {sums['row']}, {gradient_columns}}};"
    )
    for name, structure in (("jacobian", program.jacobian_structure), ("hessian", program.hessian_structure)):
        counts[f"{name.upper()}_ENTRIES"] = structure[0].size
        for part, indices in zip(("rows", "columns"), structure, strict=True):
            source.array(indices.astype(np.int32), f"{name}_{part}")
    for name in ("x_lower", "x_upper", "g_lower", "g_upper"):
        source.array(getattr(program, name), name)
    return counts


def _sums(name: str, rows: SummedTerms, source: CSource) -> str:
    offsets = source.array(rows.offsets, f"{name}_offsets", constant=False)
    source.structures("Term", f"{name}_terms", [_term(term, source) for term in rows.functions])
    linear = ", ".join(map(source.array, rows.linear))
    entries = source.array(rows.constant_entries)
    return (
        f"{{{rows.rows}, {rows.constant_entries.size}, {len(rows.functions)}, {name}_terms, {offsets}, {linear}, "
        f"{entries}, {rows.work}}}"
    )


def _term(term: TermFunction, source: CSource) -> str:
    numbers = source.array(term.numbers, constant=False)
    arrays = [source.array(term.columns), numbers, source.array(term.rows), source.array(term.scales)]
    functions = map(_function, term.functions, term.places, term.output_scales, repeat(source))
    return f"{{{term.instances}, {', '.join(arrays)}, {{{', '.join(functions)}}}}}"


def _function(function: CompiledFunction, places: np.ndarray, scales: np.ndarray | None, source: CSource) -> str:
    steps = source.array(function.steps)  # four numbers each, as a Step has them
    arrays = [source.array(function.constants), str(function.work), source.array(places)]
    arrays.append("NULL" if scales is None else source.array(scales))
    return f"{{{len(function.steps)}, (const Step *){steps}, {', '.join(arrays)}}}"


def _given(rows: SummedTerms, parameters: np.ndarray, state_of: Mapping[Any, int]) -> list[str]:
    """In the order in which they are added, so that the sums are the same to the last digit."""
    given = zip(*(part.tolist() for part in rows.given), strict=True)
    return [
        f"{{{row}, {state_of.get(k, -1)}, {number(factor if k in state_of else factor * float(parameters[k]))}}}"
        for row, k, factor in given
    ]


def _places(rows: SummedTerms, state_of: Mapping[Any, int], source: CSource) -> list[str]:
    return [
        f"{{{source.array(function.numbers)} + {place}, {state_of[k]}}}"
        for function in rows.functions
        for place, k in zip(function.places_of_parameters.tolist(), function.parameters.tolist(), strict=True)
        if k in state_of
    ]
