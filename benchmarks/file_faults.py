"""Files of this package under kills, full disks and damaged bytes: the old content, the new one, or one error of ours.

    python benchmarks/file_faults.py [--quick] [--kills 500] [--damages 2000] [--full-disks 200] [--seed 0]

For each kind of file (a trajectory, a checkpoint of a team, the outcomes of a sweep):

killed    a process that saves again and again is killed at a random instant. What is read afterwards is what some save
          wrote, whole.
full      a process may write so many bytes and no more, as on a full disk. The save ends with an OSError, and the file
          is as it was.
damaged   bytes are changed, cut off or inserted at random places. What is read is what was written, or the error of
          that kind is raised, and no other.

The exit code is 0 only if nothing else happened. For systems that can fork.
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from table import Table, show_progress

from pyrobocop_pyomo.distributed.team_result import Checkpoint
from pyrobocop_pyomo.errors import TeamError, TrajectoryError
from pyrobocop_pyomo.numerics import Grid, Mesh, radau
from pyrobocop_pyomo.studies.sweep import OutcomeFile
from pyrobocop_pyomo.trajectories import Trajectory

COLUMNS = [("file", "<12"), ("fault", "<10"), ("tries", ">6d"), ("old or new", ">10d"), ("refused", ">8d"),
           ("WRONG", ">6d")]  # fmt: skip
GRID = Grid(radau(3), Mesh.uniform(0.0, 1.0, 20))
SWEEP = {"options": "none"}


@dataclass(frozen=True)
class Kind:
    """A kind of file: how number n is written to it and read from it."""

    name: str
    write: Callable[[Path, int], object]
    read: Callable[[Path], int]
    error: type[Exception]


def _write_trajectory(path: Path, number: int) -> None:
    states = {"x": np.full(len(GRID.times), float(number))}
    Trajectory("motion", GRID, states, {"u": np.ones(len(GRID.points))}, {"n": float(number)}, {}).save(path)


def _read_trajectory(path: Path) -> int:
    read = Trajectory.load(path)
    if not (read.x == read.n).all() or not (read.u == 1.0).all():
        raise AssertionError("a mixture of two trajectories")
    return int(read.n)


def _write_checkpoint(path: Path, number: int) -> None:
    Checkpoint(number, "f", {"a": {"x": np.full(500, float(number))}}).save(path)


def _read_checkpoint(path: Path) -> int:
    read = Checkpoint.load(path, "f")
    if not (read.states["a"]["x"] == read.round).all():
        raise AssertionError("a mixture of two checkpoints")
    return read.round


def _write_outcome(path: Path, number: int) -> None:
    OutcomeFile(path, SWEEP).append(str(number), {"values": [float(number)] * 200})


def _read_outcomes(path: Path) -> int:
    records = OutcomeFile(path, SWEEP).records
    for number, (key, record) in enumerate(records.items()):
        if key != str(number) or record["values"] != [float(number)] * 200:
            raise AssertionError("an outcome that nobody wrote")
    return len(records) - 1


KINDS = [
    Kind("trajectory", _write_trajectory, _read_trajectory, TrajectoryError),
    Kind("checkpoint", _write_checkpoint, _read_checkpoint, TeamError),
    Kind("outcomes", _write_outcome, _read_outcomes, TeamError),
]


def killed(kind: Kind, folder: Path, chance: random.Random) -> str:
    """Kill a process between two instants of a save."""
    path = folder / "file.npz"
    kind.write(path, 0)
    child = os.fork()
    if child == 0:
        number = 0
        while True:
            number += 1
            kind.write(path, number)
    time.sleep(chance.uniform(0.0, 0.02))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return verdict(kind, path, lambda number: number >= 0)


def full(kind: Kind, folder: Path, chance: random.Random) -> str:
    """Let a process write too few bytes."""
    path = folder / "file.npz"
    kind.write(path, 0)
    room = chance.randrange(0, 600) + (path.stat().st_size if kind.name == "outcomes" else 0)
    child = os.fork()
    if child == 0:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))
        try:
            kind.write(path, 1)
        except OSError:
            os._exit(3)
        os._exit(0)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if code not in (0, 3):
        return "WRONG"
    first = verdict(kind, path, lambda number: number == (1 if code == 0 else 0))
    if first != "old or new":
        return first
    kind.write(path, 2 if kind.name != "outcomes" else kind.read(path) + 1)  # and it can be written again
    return verdict(kind, path, lambda number: number >= 1)


def damaged(kind: Kind, folder: Path, chance: random.Random) -> str:
    """Change, cut off or insert bytes."""
    path = folder / "file.npz"
    for number in range(2):
        kind.write(path, number)
    whole = bytearray(path.read_bytes())
    for _ in range(chance.choice((1, 1, 1, 4))):
        at = chance.randrange(len(whole))
        what = chance.randrange(4)
        if what == 0:
            del whole[at:]
        elif what == 1:
            whole[at:at] = chance.randbytes(chance.randrange(1, 5))
        else:
            whole[at] ^= 1 << chance.randrange(8)
        if not whole:
            break
    path.write_bytes(whole)
    # A line that was cut off at the end of a file of outcomes is an outcome less, as after a kill.
    return verdict(kind, path, lambda number: number == 1 or (kind.name == "outcomes" and number < 1))


def verdict(kind: Kind, path: Path, is_right: Callable[[int], bool]) -> str:
    """What reading gives."""
    try:
        return "old or new" if is_right(kind.read(path)) else "WRONG"
    except kind.error:
        return "refused"
    except Exception as error:  # whatever else a file can do to its reader is what is counted here
        print(f"{kind.name}: {type(error).__name__}: {error}")
        return "WRONG"


def main() -> int:
    """Run all; the exit code tells whether something was wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a few of each")
    parser.add_argument("--kills", type=int, default=500)
    parser.add_argument("--full-disks", type=int, default=200)
    parser.add_argument("--damages", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    faults: list[tuple[str, Any, int]] = [
        ("killed", killed, 15 if arguments.quick else arguments.kills),
        ("full", full, 15 if arguments.quick else arguments.full_disks),
        ("damaged", damaged, 60 if arguments.quick else arguments.damages),
    ]
    table, wrong = Table(COLUMNS), 0
    table.header()
    for kind in KINDS:
        for name, fault, tries in faults:
            counts = dict.fromkeys(("old or new", "refused", "WRONG"), 0)
            for number in range(tries):
                show_progress(f"{kind.name}, {name}: {number} of {tries}")
                folder = Path(tempfile.mkdtemp())
                try:
                    said = fault(kind, folder, random.Random(f"{arguments.seed} {kind.name} {name} {number}"))
                finally:
                    shutil.rmtree(folder)
                # Only damage may be refused: neither a kill nor a full disk costs what was there before.
                counts["WRONG" if said == "refused" and name != "damaged" else said] += 1
            show_progress("")
            table.add(kind.name, name, tries, *counts.values())
            wrong += counts["WRONG"]
    print("nothing was lost" if not wrong else f"{wrong} WRONG")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
