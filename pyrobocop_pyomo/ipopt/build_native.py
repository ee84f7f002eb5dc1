"""Compile the C parts of this package now, and not when they are first used."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path

from pyrobocop_pyomo.linear_solver.library import LINEAR_SOLVER_NAME, linear_solver_sources
from pyrobocop_pyomo.native.shared_library import build_shared_library
from pyrobocop_pyomo.programs.compiled_terms import SOURCE, TERM_EVALUATION

logger = logging.getLogger(__name__)


def build_native(
    *, force: bool = False, beside: bool = False, report: Callable[[str], None] = logger.info
) -> list[Path]:
    """Compile the linear solver and the evaluation of vectorised functions.

    Parameters
    ----------
    force : bool
        Compile also what is there.
    beside : bool
        Put the libraries beside their sources, from where a wheel takes them, and not into the user's cache.
    report : callable
        Receives one line per library.

    Returns
    -------
    list of Path
        The libraries.

    Raises
    ------
    BuildFailed
        When there is no C compiler, when it fails, or where the libraries cannot be kept.
    """
    built = []
    for name, sources in ((LINEAR_SOLVER_NAME, linear_solver_sources()), (TERM_EVALUATION, [SOURCE])):
        built.append(build_shared_library(name, sources, force=force, beside=beside))
        report(f"{name}: {built[-1]}")
    return built
