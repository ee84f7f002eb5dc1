"""`MpiEngine`: every rank runs the same script and solves its own agents; no rank is master."""

from __future__ import annotations

from collections.abc import Collection
from concurrent.futures import Future
from typing import Any

from pyrobocop_pyomo.errors import EngineError
from pyrobocop_pyomo.optional_imports import mpi, mpi_available

from .serial_engine import SerialEngine
from .worker_host import Answer, Request


class MpiEngine(SerialEngine):
    """Every rank of an MPI job runs the same script, solves its own agents, and hears the reports of all others.

    Start the script with ``mpiexec -n 4 python -m mpi4py script.py``: then an exception on one rank ends the job, and
    does not leave the others waiting. Each rank has the same coordinator, and reports travel from peer to peer, so none
    is master and orders are not sent at all. The death of a rank ends the whole job; it goes on from its last
    checkpoint. Take no more ranks than processors: a rank that waits uses one.

    Parameters
    ----------
    communicator : mpi4py.MPI.Comm, optional
        By default all ranks of the job; agents are dealt out to them in turn.

    Raises
    ------
    EngineError
        When mpi4py or an MPI library is not installed.
    """

    name = "mpi"

    def __init__(self, communicator: Any = None) -> None:
        super().__init__()
        if not mpi_available:
            raise EngineError(
                "engine 'mpi': mpi4py or the MPI library that it needs is not installed. Run: "
                "pip install 'pyrobocop_pyomo[mpi]' and an MPI, for example pip install mpich."
            )
        self.communicator = mpi.COMM_WORLD if communicator is None else communicator

    @property
    def writes_files(self) -> bool:  # type: ignore[override]
        """Whether this rank is the one that writes files and tells the user."""
        return bool(self.communicator.rank == 0)

    def open(self, places: int) -> None:
        """Begin with no agents, and nothing asked."""
        super().open(places)
        self._submitted: list[tuple[Request, Future[Answer]]] = []

    def places(self, most: int) -> int:
        """How many tasks are done side by side: one on each rank."""
        return min(most, int(self.communicator.size))

    def places_of_agents(self, agents: int) -> int:
        """One for each agent: a rank answers all its requests at once."""
        return agents

    def agreed(self, decision: bool) -> bool:
        """What rank 0 decides."""
        return bool(self.communicator.bcast(decision))

    def submit(self, request: Request) -> Future[Answer]:
        """Let a request wait until all are known."""
        self._submitted.append((request, Future()))
        return self._submitted[-1][-1]

    def wait(self, futures: Collection[Future[Answer]], timeout: float | None = None) -> None:
        """Have all requests answered, those of this rank's agents here. Ranks never differ in what they have heard."""
        submitted, self._submitted = self._submitted, []
        rank, size = self.communicator.rank, self.communicator.size
        asked = [(request.agent, request.method) for request, _ in submitted]
        own = [self._host.answer(request) for request, _ in submitted if request.place % size == rank]
        gathered: list[tuple[list[tuple[str, str]], list[Answer]]] = self.communicator.allgather((asked, own))
        for other, (theirs, _) in enumerate(gathered):
            if theirs != gathered[0][0]:
                raise EngineError(
                    f"engine 'mpi': rank 0 asks for {gathered[0][0]}, rank {other} for {theirs}. All ranks have to "
                    "run the same script with the same data, and nothing in it may depend on time or chance."
                )
        for request, future in submitted:
            future.set_result(gathered[request.place % size][1].pop(0))
