"""Engines by their names, and `SerialEngine`, with which all others have to agree."""

from __future__ import annotations

from collections.abc import Callable

from pyrobocop_pyomo.errors import EngineError

from .dask_engine import DaskEngine
from .engine import Engine, EngineWithHost, Exchange
from .mpi_engine import MpiEngine
from .process_engine import ProcessEngine


class SerialEngine(EngineWithHost):
    """All agents in this process, one after the other.

    Needs nothing, starts at once, and any builder will do. Orders and reports are pickled here too, so that no array is
    shared by accident.
    """

    name = "serial"

    def wait(self, timeout: float | None = None) -> Exchange:
        """Answer the first request."""
        request = self._submitted.pop(0)
        return {request.agent: self._host.answer(request)}, {}


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
