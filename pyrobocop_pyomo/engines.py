"""Where the agents of a team live: values of `engine=`, and files to go on from."""

from pyrobocop_pyomo.distributed.checkpoint import Checkpoint, fingerprint
from pyrobocop_pyomo.distributed.dask_engine import DaskEngine
from pyrobocop_pyomo.distributed.engine import AgentFailure, Engine
from pyrobocop_pyomo.distributed.engines import find_engine
from pyrobocop_pyomo.distributed.mpi_engine import MpiEngine
from pyrobocop_pyomo.distributed.process_engine import ProcessEngine
from pyrobocop_pyomo.distributed.serial_engine import SerialEngine
from pyrobocop_pyomo.distributed.worker_host import HostedProblem, HostedSpec

__all__ = [
    "AgentFailure",
    "Checkpoint",
    "DaskEngine",
    "Engine",
    "HostedProblem",
    "HostedSpec",
    "MpiEngine",
    "ProcessEngine",
    "SerialEngine",
    "find_engine",
    "fingerprint",
]
