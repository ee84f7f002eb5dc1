"""How far estimates are off because of the mesh: the motion on a finer one, in standard errors."""

from __future__ import annotations

import logging

import numpy as np

from pyrobocop_pyomo.errors import PyRobocopError
from pyrobocop_pyomo.numerics.remeshing import halves_of
from pyrobocop_pyomo.phases import phases_of

from .fit_statistics import FitStatistics
from .problem import EstimationProblem

logger = logging.getLogger(__name__)

# In standard errors: an interval that is off by less still has nearly its level.
LARGE_SHIFT = 0.5
# A motion that is unstable runs away from its data without the feedback that it was measured with: what is shifted by
# more says nothing about the fit.
MOST_SHIFT = 100.0


def remark_on_mesh(problem: EstimationProblem, statistics: FitStatistics) -> str:
    """Which estimate the mesh shifts most; empty where none by much, or where that cannot be found out.

    Parameters
    ----------
    problem : EstimationProblem
        At its fit; it keeps its values.
    statistics : FitStatistics
        Of the fit.
    """
    errors = statistics.standard_errors
    free = np.isfinite(errors) & (errors > 0.0)
    if not free.any() or any(experiment.phase is None for experiment in problem.experiments.values()):
        return ""
    fitted, before = problem.values(), problem.predictions()
    try:
        _put_finer_motions(problem)
        change = problem.predictions() - before
    except PyRobocopError as error:
        logger.info("the error of the mesh is not known: %s", error)
        return ""
    finally:
        fitted.restore()
    present = np.isfinite(statistics.residuals) & np.isfinite(change)
    roots = np.sqrt(problem.weights[present])
    # As in the fit to first order, with the change of the predictions in place of the residuals.
    scaled = roots[:, None] * statistics.matrix[present][:, free] * errors[free]
    shifts = np.abs(np.linalg.lstsq(scaled, roots * change[present], rcond=None)[0])
    worst = int(shifts.argmax())
    if not LARGE_SHIFT < shifts[worst] < MOST_SHIFT:
        return ""
    return (
        f"the mesh is coarse: a finer one would shift '{np.array(statistics.names)[free][worst]}' by about "
        f"{shifts[worst]:.2g} of its standard errors; take more elements"
    )


def _put_finer_motions(problem: EstimationProblem) -> None:
    """Simulate each experiment on half the widths, and put the values on the model."""
    copy = problem.model.clone()
    copy.del_component(copy.squares)  # it reads variables that another mesh does not have
    for experiment in problem.experiments.values():
        for phase in phases_of(experiment.model):
            finer = copy.find_component(phase)
            finer.remesh(halves_of(phase.grid.mesh))
            phase.initialize(finer.simulate())
