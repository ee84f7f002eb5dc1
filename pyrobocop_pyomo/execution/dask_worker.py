"""What every worker of a Dask cluster on this machine does when it starts: Dask imports this module there."""

from __future__ import annotations

import signal
from typing import Any


def dask_setup(worker: Any) -> None:
    """Ignore Ctrl-C, which reaches the whole group of processes: the coordinator ends its workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
