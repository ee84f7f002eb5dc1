"""Paths of hybrid A*: CPU seconds, lengths and cusps for parking from many places.

    python benchmarks/car_paths.py [--quick] [places per slot]

The car and the slots are those of the example; starts are random, half of them heading along the street.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from pathlib import Path

import numpy as np

import pyrobocop_pyomo as rcp

sys.path.append(str(Path(__file__).parent.parent / "examples"))
from parking import BOX, CAR, CASES, STEERING, WHEELBASE  # isort: skip

CLEARANCE = 0.1


def starts(case: str, count: int) -> list[tuple[float, float, float]]:
    """Places in the street that are clear of everything."""
    rng = np.random.default_rng(7)
    found: list[tuple[float, float, float]] = []
    while len(found) < count:
        turn = 0.25 if len(found) % 2 else math.pi
        pose = (float(rng.uniform(-10, 10)), float(rng.uniform(6.5, 9.5)), float(rng.uniform(-turn, turn)))
        shapes = CASES[case]["obstacles"].values()
        distances = [rcp.scenes.signed_distance(CAR, shape, rcp.planar_pose(*pose)).distance for shape in shapes]
        if min(distances) >= CLEARANCE:
            found.append(pose)
    return found


def main() -> None:
    """A line for each path."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one place per slot")
    parser.add_argument("places", type=int, nargs="?", default=10, help="per slot")
    arguments = parser.parse_args()
    count = 1 if arguments.quick else arguments.places
    seconds, cusps = [], []
    for case, scene in CASES.items():
        for start in starts(case, count):
            began = time.process_time()
            path = rcp.scenes.hybrid_a_star(
                start, scene["goal"], body=CAR, obstacles=scene["obstacles"], wheelbase=WHEELBASE,
                steering_limit=STEERING, bounds=BOX, clearance=CLEARANCE, time_limit=600.0,
            )  # fmt: skip
            seconds.append(time.process_time() - began)
            cusps.append(path.cusps)
            place = ", ".join(f"{number:6.2f}" for number in start)
            print(f"{case:<9} ({place})  {seconds[-1]:6.2f} s  {path.length:6.2f} m  {path.cusps} cusps", flush=True)
    print(f"mean {np.mean(seconds):.2f} s, median {np.median(seconds):.2f} s, longest {max(seconds):.2f} s; "
          f"{np.mean(cusps):.1f} cusps")  # fmt: skip


if __name__ == "__main__":
    main()
