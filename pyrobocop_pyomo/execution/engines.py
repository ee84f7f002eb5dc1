"""Engines by their names."""

from __future__ import annotations

from collections.abc import Callable

from pyrobocop_pyomo.errors import EngineError

from .engine import Engine
from .executor_engine import DaskEngine
from .mpi_engine import MpiEngine
from .process_engine import ProcessEngine
from .serial_engine import SerialEngine

ENGINES: dict[str, Callable[[], Engine]] = {
    "serial": SerialEngine,
    "process": ProcessEngine,
    "dask": DaskEngine,
    "mpi": MpiEngine,
}


def find_engine(engine: str | Engine) -> Engine:
    """Look an engine up.

    Parameters
    ----------
    engine : str or Engine
        ``"serial"``, ``"process"``, ``"dask"`` or ``"mpi"``; an engine is given back as it is.

    Returns
    -------
    Engine
        Not started.

    Raises
    ------
    EngineError
        When there is no such engine, or its package is not installed; the message says what to install.
    """
    if isinstance(engine, Engine):
        return engine
    if engine not in ENGINES:
        raise EngineError(f"engine = {engine!r}; expected {', '.join(map(repr, ENGINES))}, or an Engine.")
    return ENGINES[engine]()
