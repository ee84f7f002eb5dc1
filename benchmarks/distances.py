"""How long signed distances take: one pair at a time, and many at once.

python benchmarks/distances.py [--quick]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from pyrobocop_pyomo import Polytope, planar_pose, spatial_pose
from pyrobocop_pyomo.geometry import PointSets, distances_of_points, signed_distance


def median_microseconds(run: Callable[[], object], repetitions: int) -> float:
    """Median time of a call."""
    times = []
    for _ in range(repetitions):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return 1e6 * float(np.median(times))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="ten repetitions, ten and a hundred pairs at once")
    quick = parser.parse_args().quick
    repetitions = 10 if quick else 300
    car, crate = Polytope.box(4.7, 2.0), Polytope.box(2.0, 2.0)
    drone, block = Polytope.box(1.0, 2.0, 0.5), Polytope.box(1.0, 1.0, 1.0)
    wall = Polytope.from_halfspaces([[0, -1]], [-11], bounded=False)
    tilt = (0.3, 0.2, 0.1)
    scenes = [
        ("plane, apart", car, crate, planar_pose(5, 3, 0.3)),
        ("plane, parallel sides", car, crate, planar_pose(5, 0.2, 0.0)),
        ("plane, overlapping", car, crate, planar_pose(2, 1, 0.3)),
        ("plane, wall without end, apart", car, wall, planar_pose(5, 3, 0.3)),
        ("plane, wall without end, overlapping", car, wall, planar_pose(5, 11, 0.3)),
        ("space, apart", drone, block, spatial_pose((2, 1, 2), euler=tilt)),
        ("space, parallel faces", drone, block, spatial_pose((2, 0.1, 0.1))),
        ("space, overlapping", drone, block, spatial_pose((0.5, 0.5, 0.5), euler=tilt)),
    ]
    print(f"{'signed_distance':45s} us per pair")
    for name, first, second, pose in scenes:
        each = median_microseconds(lambda a=first, b=second, c=pose: signed_distance(a, b, c), repetitions)
        print(f"{name:45s} {each:8.1f}")
    print(f"\n{'distances_of_points, apart':45s} us per pair")
    random = np.random.default_rng(0)
    for name, first, second in (("plane", car, crate), ("space", drone, block)):
        for count in (10, 100) if quick else (10, 100, 1000):
            shifts = random.normal(size=(count, 1, first.dimension))
            shifts *= 10.0 / np.linalg.norm(shifts, axis=2, keepdims=True)
            p = PointSets.of([first] * count).moved(shifts[:, 0])
            q = PointSets.of([second] * count)
            per_pair = median_microseconds(lambda p=p, q=q: distances_of_points(p, q), repetitions // 10) / count
            print(f"{f'{name}, {count} at once':45s} {per_pair:8.1f}")


if __name__ == "__main__":
    main()
