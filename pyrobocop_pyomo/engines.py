"""Where agents of a team live and solves of a study are done: values of `engine=`, and files to go on from."""

from pyrobocop_pyomo.distributed.checkpoint import Checkpoint, fingerprint
from pyrobocop_pyomo.execution.dask_engine import DaskEngine
from pyrobocop_pyomo.execution.engine import AgentFailure, Engine
from pyrobocop_pyomo.execution.engines import find_engine
from pyrobocop_pyomo.execution.mpi_engine import MpiEngine
from pyrobocop_pyomo.execution.process_engine import ProcessEngine
from pyrobocop_pyomo.execution.serial_engine import SerialEngine
from pyrobocop_pyomo.execution.worker_host import HostedProblem, HostedSpec

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
