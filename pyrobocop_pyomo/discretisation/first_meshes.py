"""First meshes: boundaries where statements name a time, jump at one, or read what was a while before.

Inside an element a jump is seen by polynomials only, whatever their degree: the mesh that errors ask for would come
near to it by halves. What changes without a jump is left to these errors.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import PyRobocopError
from pyrobocop_pyomo.modeling.expression_nodes import ARRAY_FUNCTIONS, RELATION
from pyrobocop_pyomo.modeling.expression_steps import ExpressionSteps
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.mesh import mesh_of_delays, mesh_with
from pyrobocop_pyomo.numerics.rounding import ROUNDING
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.phases.bounds_between_points import changing_places, stated_formulas
from pyrobocop_pyomo.phases.horizon import real_grid
from pyrobocop_pyomo.phases.remeshing import remesh_phases, why_its_mesh_is_stated
from pyrobocop_pyomo.phases.rule_formulas import RuleFormulas

logger = logging.getLogger(__name__)

# Elements of a first mesh: so many times the user's, and at most so many in a model.
MOST_TIMES, MOST_ELEMENTS = 8, 1000
# Instants at which conditions on the time are compared with zero.
_INSTANTS = 4000


def mesh_from_statement(phases: Sequence[Any]) -> list[str]:
    """Give phases meshes, in place, with boundaries at what is stated at single times.

    Phases with step maps, pairs or variable element boundaries keep their meshes, and so do those whose controls are
    constant or linear over the elements that the user has chosen.

    Parameters
    ----------
    phases : sequence of PhaseBlock
        Of one model, with their initial guesses.

    Returns
    -------
    list of str
        What was changed, and why.
    """
    remarks = []
    for phase in phases:
        record, mesh = phase.record, phase.grid.mesh
        others = sum(other.grid.mesh.elements for other in phases) - mesh.elements
        most = min(MOST_TIMES * mesh.elements, MOST_ELEMENTS - others)
        fixed = record.discrete_states or record.free_widths or record.statements_of("complementarity")
        if fixed or why_its_mesh_is_stated(phase) is not None:
            continue
        try:
            jumps, delays = _times_stated(phase)
            wanted = mesh_with(mesh_of_delays(mesh, delays, most), [*record.named_times, *jumps])
            if wanted == mesh or wanted.elements > most:
                continue
            remesh_phases({phase: wanted})
        except (PyRobocopError, ArithmeticError, ValueError, TypeError, LookupError) as error:
            logger.info("phase '%s': its first mesh is as declared (%s)", phase.name, error)
            continue
        remarks.append(
            f"The mesh of '{phase.name}' has {wanted.elements} elements in place of {mesh.elements}, with boundaries "
            "at times that statements name, at which they jump, or at which delayed values are points again."
        )
    return remarks


def _times_stated(phase: Any) -> tuple[list[float], list[float]]:
    """Time indices beside which statements jump, on the side that the scheme's points need, and all their delays."""
    record, indices = phase.record, phase.record.grid.mesh.boundaries
    grid, scheme = real_grid(phase), phase.grid.scheme
    formulas = RuleFormulas(phase, grid)
    index, clock = formulas.index, formulas.clock
    times = np.linspace(indices[0], indices[-1], _INSTANTS)
    jumps: set[float] = set()

    stated = [of for rule in record.rules for of in stated_formulas(formulas, rule)]
    steps, of_time = ExpressionSteps(stated), {id(index), id(clock)}
    reads_others = steps.depends_on(lambda leaf: leaf.node.is_variable_type() and id(leaf.node) not in of_time)
    for place in changing_places(steps, of_time):
        for before, after in pairwise(steps.steps[place].arguments):
            if steps.steps[place].kind != RELATION or reads_others[place]:
                continue
            sides = steps.part([before, after])

            def difference(when: Any, sides: ExpressionSteps = sides) -> Any:
                leaves = {id(index): when, id(clock): np.interp(when, indices, grid.mesh.boundaries)}
                first, second = sides.evaluate_at(leaves, ARRAY_FUNCTIONS)
                return second - first

            jumps.update(_sign_changes(difference, times))
    # The element that ends at a jump has a point there, which belongs to the values before it; or one that starts.
    side = 1.0 if scheme.starts_on_a_stage and not scheme.stiffly_accurate else -1.0
    beside = side * ROUNDING * (indices[-1] - indices[0])
    per_index = grid.mesh.boundaries[-1] - grid.mesh.boundaries[0] if record.normalised else 1.0
    delays = {delay / per_index for _, delay in formulas.delays}
    return [jump + beside for jump in sorted(jumps)], sorted(delay for delay in delays if delay > 0.0)


def _sign_changes(difference: Any, times: Array) -> Iterator[float]:
    """Times at which a function is zero, and of different signs on both sides of it."""
    values = np.zeros(len(times)) + difference(times)
    for i in np.flatnonzero(np.sign(values[1:]) != np.sign(values[:-1])).tolist():
        if values[i] == 0.0 or values[i + 1] == 0.0:
            yield float(times[i] if values[i] == 0.0 else times[i + 1])
        else:
            yield float(scipy.optimize.brentq(difference, times[i], times[i + 1], xtol=1e-14))
