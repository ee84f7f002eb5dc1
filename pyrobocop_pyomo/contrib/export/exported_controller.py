"""A receding horizon as C source, for robots that have Ipopt but no Python."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.ipopt.ipopt_run import readings
from pyrobocop_pyomo.ipopt.linear_solvers import with_linear_solver
from pyrobocop_pyomo.linear_solver.library import LINEAR_SOLVER_NAME
from pyrobocop_pyomo.native.shared_library import library_sources
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.programs.compiled_terms import SOURCE as TERM_EVALUATION
from pyrobocop_pyomo.programs.nonlinear_program import PrimalDualPoint
from pyrobocop_pyomo.programs.vectorised_program import VectorisedProgram
from pyrobocop_pyomo.solving.ipopt_options import warm_start
from pyrobocop_pyomo.studies.receding_horizon import RecedingHorizon
from pyrobocop_pyomo.studies.shifted_warm_start import Move, PlaceInProgram

from .program_source import CSource, number, program_source

TEMPLATE, HEADER = Path(__file__).with_name("controller.c"), Path(__file__).with_name("controller.h")


def export_controller(horizon: RecedingHorizon, folder: str | Path, advance: float, *, mu: float = 1e-4) -> Path:
    """Write a receding horizon as C source, for a robot that has Ipopt but no Python.

    ``controller_step(state, control)`` does what `RecedingHorizon.step` does with this `advance` and this `mu`. Its
    first plan is that of the next `step`: warm where a plan has been made, else from the values on the model. Fixed
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
    parts = horizon.parts_of_a_step(advance)
    program, place, states, controls = parts.program, parts.place, parts.states, parts.controls
    nlp = program.program
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
    counts["MOVES"] = source.structures("Move", "moves", _moves(place, parts.moves, states, nlp.n))
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
        literal = readings(name, setting)[0]
        if isinstance(literal, str):
            yield f'{{"{name}", TEXT, {json.dumps(literal)}, 0}}'
        else:
            yield f'{{"{name}", {"INTEGER" if isinstance(literal, int) else "REAL"}, 0, {number(literal)}}}'
