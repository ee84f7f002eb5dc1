"""Twenty parking cases in the format of competitions: from a file to a safe plan, each with its time.

The cases are made here: slots across, along and aslant of a lane, garages, dead ends, clutter with up to 53 obstacles,
polygons that are not convex, coordinates of 1e9 metres, headings beyond a turn, rings of either orientation.

    python benchmarks/parking_cases.py            all of them
    python benchmarks/parking_cases.py 3 17       some
    python benchmarks/parking_cases.py --quick    the one that takes least
    python benchmarks/parking_cases.py --random 60 --first 1000    fresh ones, each made from a seed
    python benchmarks/parking_cases.py --random 10 --first 1000 --vehicles    many cars at once
    python benchmarks/parking_cases.py --write DIRECTORY    as files
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Sequence
from decimal import Decimal
from pathlib import Path

import numpy as np
import shapely

import pyrobocop_pyomo as rcp

Points = list[tuple[float, float]]
Pose = tuple[float, float, float]
CAR = rcp.scenes.ParkingCar()
LENGTH, WIDTH = CAR.wheelbase + CAR.front_overhang + CAR.rear_overhang, CAR.width


def rectangle(x: float, y: float, length: float, width: float, heading: float = 0.0) -> Points:
    """About its middle."""
    c, s = math.cos(heading), math.sin(heading)
    corners = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
    return [(x + c * a * length - s * b * width, y + s * a * length + c * b * width) for a, b in corners]


def parked(x: float, y: float, heading: float) -> Points:
    """Another car whose rear axle is there."""
    ahead = 0.5 * LENGTH - CAR.rear_overhang
    return rectangle(x + ahead * math.cos(heading), y + ahead * math.sin(heading), LENGTH, WIDTH, heading)


def slots_across(
    lane: float, gap: float, neighbours: int, aslant: float = 0.5 * math.pi
) -> tuple[Pose, Pose, list[Points]]:
    """One free slot in a row, across or aslant of a lane of a given width; the car drives in forwards or backwards."""
    pitch = (WIDTH + gap) / math.sin(aslant)
    places = [k * pitch for k in range(-neighbours, neighbours + 1) if k != 0]
    back = -LENGTH * math.sin(aslant) + CAR.rear_overhang * math.sin(aslant)
    obstacles = [parked(x + back / math.tan(aslant), back, aslant) for x in places]
    top = WIDTH + lane
    obstacles += [rectangle(0.0, top + 0.5, 40.0, 1.0), rectangle(0.0, back - 2.5, 40.0, 1.0)]
    return (-9.0, 0.5 * lane + 0.5, 0.0), (back / math.tan(aslant), back, aslant), obstacles


def slot_along(lane: float, room: float) -> tuple[Pose, Pose, list[Points]]:
    """A slot that leaves some room in all, between two cars along the kerb."""
    apart = 0.5 * (LENGTH + room) + 0.5 * LENGTH
    middle = 0.5 * LENGTH - CAR.rear_overhang
    obstacles = [parked(-apart - middle, 0.0, 0.0), parked(apart - middle, 0.0, 0.0)]
    obstacles += [rectangle(0.0, -0.5 * WIDTH - 0.7, 40.0, 0.8), rectangle(0.0, 0.5 * WIDTH + lane + 0.5, 40.0, 1.0)]
    return (-12.0, 0.5 * WIDTH + 0.5 * lane, 0.0), (-middle, 0.0, 0.0), obstacles


def clutter(seed: int, number: int, *, size: float = 30.0, concave: bool = False) -> tuple[Pose, Pose, list[Points]]:
    """Polygons at random places that leave start and goal free."""
    rng = np.random.default_rng(seed)
    start, goal = (-0.4 * size, -0.3 * size, 0.4), (0.4 * size, 0.3 * size, float(rng.uniform(-3, 3)))
    keep = [parked(*start), parked(*goal)]
    obstacles: list[Points] = []
    while len(obstacles) < number:
        x, y = rng.uniform(-0.55 * size, 0.55 * size, 2)
        radius = float(rng.uniform(0.3, 1.1))
        angles = np.sort(rng.uniform(0, 2 * math.pi, int(rng.integers(3, 7))))
        if np.max(np.diff([*angles, angles[0] + 2 * math.pi])) > 2.5:
            continue
        shape = [(x + radius * math.cos(a), y + radius * math.sin(a)) for a in angles]
        if concave and len(obstacles) % 3 == 0:
            shape = bracket(float(x), float(y), 1.6, float(rng.uniform(0, 6)))
        hull = rcp.Polytope.hull(shape)
        if all(rcp.scenes.signed_distance(hull, rcp.Polytope.hull(other)).distance > 1.5 for other in keep):
            obstacles.append(shape)
    return start, goal, obstacles


def bracket(x: float, y: float, size: float, heading: float) -> Points:
    """A U, open along its heading."""
    corners = [(-1, -1), (1, -1), (1, -0.7), (-0.7, -0.7), (-0.7, 0.7), (1, 0.7), (1, 1), (-1, 1)]
    c, s = math.cos(heading), math.sin(heading)
    return [(x + 0.5 * size * (c * a - s * b), y + 0.5 * size * (s * a + c * b)) for a, b in corners]


def garage(width: float, lane: float) -> tuple[Pose, Pose, list[Points]]:
    """Three walls in one concave polygon, the open side to the lane."""
    half, deep, wall = 0.5 * width, LENGTH + 0.8, 0.3
    ring = [
        (-half - wall, 0), (-half - wall, -deep - wall), (half + wall, -deep - wall), (half + wall, 0),
        (half, 0), (half, -deep), (-half, -deep), (-half, 0),
    ]  # fmt: skip
    goal = (0.0, -deep + 0.4 + CAR.rear_overhang, 0.5 * math.pi)
    return (-8.0, 0.5 * lane, 0.0), goal, [ring, rectangle(0, lane + 0.5, 40, 1.0)]


def slot_to_slot(width: float, lane: float, aside: float) -> tuple[Pose, Pose, list[Points]]:
    """From one garage across a lane to another; in forwards, so that the car has to turn round in the lane."""
    _, (x, y, heading), (ring, _) = garage(width, lane)
    other = [(aside - a, lane - b) for a, b in ring]
    start = (aside, lane - y + CAR.wheelbase, 0.5 * math.pi)
    return start, (x, y, heading), [ring, other, rectangle(-9, 0.5 * lane, 1, lane), rectangle(9, 0.5 * lane, 1, lane)]


def dead_end(width: float, depth: float) -> tuple[Pose, Pose, list[Points]]:
    """A cul-de-sac: in forwards, and to face the way out."""
    half = 0.5 * width
    ring = [
        (-20, -half - 1), (depth + 1, -half - 1), (depth + 1, half + 1), (-20, half + 1), (-20, half), (depth, half),
        (depth, -half), (-20, -half),
    ]  # fmt: skip
    return (-8.0, -0.2, 0.0), (-4.0, 0.2, math.pi), [ring]


def turned(case: tuple[Pose, Pose, list[Points]], angle: float) -> tuple[Pose, Pose, list[Points]]:
    """The same in another direction."""
    c, s = math.cos(angle), math.sin(angle)

    def place(x: float, y: float) -> tuple[float, float]:
        return c * x - s * y, s * x + c * y

    start, goal, obstacles = case
    return (
        (*place(*start[:2]), start[2] + angle),
        (*place(*goal[:2]), goal[2] + angle),
        [[place(*point) for point in ring] for ring in obstacles],
    )


def row(
    case: tuple[Pose, Pose, list[Points]], shift: tuple[str, str] = ("0", "0"), turns: tuple[int, int] = (0, 0)
) -> list[str]:
    """The numbers of a case's file, moved in decimals; headings by whole turns."""
    start, goal, obstacles = case
    dx, dy = Decimal(shift[0]), Decimal(shift[1])

    def moved(point: Sequence[float]) -> list[str]:
        return [str(Decimal(f"{point[0]:.6f}") + dx), str(Decimal(f"{point[1]:.6f}") + dy)]

    numbers = [*moved(start), f"{start[2] + 2 * math.pi * turns[0]:.9f}"]
    numbers += [*moved(goal), f"{goal[2] + 2 * math.pi * turns[1]:.9f}"]
    numbers += [str(len(obstacles)), *(str(len(ring)) for ring in obstacles)]
    return numbers + [word for ring in obstacles for point in ring for word in moved(point)]


def odd_rings(case: tuple[Pose, Pose, list[Points]]) -> tuple[Pose, Pose, list[Points]]:
    """Clockwise, closed, repeated and nearly collinear points in turn."""
    start, goal, obstacles = case
    changed = []
    for k, ring in enumerate(obstacles):
        if k % 4 == 0:
            ring = ring[::-1]
        elif k % 4 == 1:
            ring = [*ring, ring[0]]
        elif k % 4 == 2:
            (a, b), (c, d) = ring[0], ring[1]
            ring = [ring[0], (0.5 * (a + c) + 1e-6, 0.5 * (b + d)), *ring[1:]]
        else:
            ring = [ring[0], ring[0], *ring[1:]]
        changed.append(ring)
    return start, goal, changed


def far_walls(case: tuple[Pose, Pose, list[Points]]) -> tuple[Pose, Pose, list[Points]]:
    """Walls that are a million kilometres long, and something far away."""
    start, goal, obstacles = case
    low = min(y for ring in obstacles for _, y in ring)
    wall = [(-1e9, low - 1.0), (1e9, low - 1.0), (1e9, low), (-1e9, low)]
    return start, goal, [*obstacles, wall, rectangle(1e9, -1e9, 5.0, 5.0)]


def around_a_drive(
    rng: np.random.Generator, number: int, space: float, corners: tuple[int, int] = (4, 11)
) -> tuple[Pose, Pose, list[Points]]:
    """Polygons around arcs that a car drives at random, also backwards: there is a way by construction."""
    pose, driven, direction = (0.0, 0.0, float(rng.uniform(-3, 3))), [], 1.0
    start = pose
    for k in range(int(rng.integers(5, 9))):
        direction = -direction if k in (3, 6) else direction
        curvature = float(rng.uniform(-1, 1)) * math.tan(0.9 * CAR.steering) / CAR.wheelbase
        for _ in range(int(rng.integers(6, 20))):
            x, y, heading = pose
            step = 0.25 * direction
            middle = heading + 0.5 * step * curvature
            pose = (x + step * math.cos(middle), y + step * math.sin(middle), heading + step * curvature)
            driven.append(shapely.Polygon(parked(*pose)))
    taken = shapely.union_all([shapely.Polygon(parked(*start)), *driven]).buffer(space)
    left, bottom, right, top = taken.bounds
    obstacles: list[Points] = []
    while len(obstacles) < number:
        x, y = rng.uniform(left - 3, right + 3), rng.uniform(bottom - 3, top + 3)
        size = float(rng.uniform(0.4, 2.0))
        angles = np.sort(rng.uniform(0, 2 * math.pi, int(rng.integers(*corners))))
        radii = size * rng.uniform(0.6, 1.0, len(angles))
        shape = np.column_stack([x + radii * np.cos(angles), y + radii * np.sin(angles)])
        polygon = shapely.Polygon(shape)
        if polygon.is_valid and polygon.area > 0.05 and not polygon.intersects(taken):
            obstacles.append([(float(a), float(b)) for a, b in shape])
    return start, pose, obstacles


def fresh_case(seed: int) -> tuple[str, list[str]]:
    """A case of a kind that competitions have, with sizes from a seed, turned by anything; its name and its numbers."""
    rng = np.random.default_rng(seed)

    def between(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    kinds: list[tuple[str, Callable[[], tuple[Pose, Pose, list[Points]]]]] = [
        ("along, tight", lambda: slot_along(between(3.2, 4.5), between(0.7, 1.2))),
        ("50 obstacles", lambda: around_a_drive(rng, int(rng.integers(45, 54)), 0.25)),
        ("across, tight", lambda: slots_across(between(3.0, 4.5), between(0.2, 0.7), 3)),
        ("dead end", lambda: dead_end(between(5.3, 6.5), between(7.0, 10.0))),
        ("garage, tight", lambda: garage(between(2.15, 2.5), between(4.9, 6.0))),
        ("narrow drive", lambda: around_a_drive(rng, 30, 0.12)),
        ("aslant", lambda: slots_across(between(3.5, 5.0), between(0.5, 0.8), 3, between(0.9, 2.2))),
        ("along", lambda: far_walls(slot_along(between(3.5, 5.0), between(1.2, 2.0)))),
        ("from slot to slot", lambda: slot_to_slot(between(2.15, 2.5), between(4.9, 6.0), between(-4, 4))),
    ]
    name, make = kinds[seed % len(kinds)]
    case = odd_rings(turned(make(), between(-3, 3)))
    far = seed % 3 == 0
    return f"{name}{', at 1e9 m' if far else ''}", row(case, BILLION if far else ("0", "0"))


def vehicles_scene(seed: int) -> rcp.scenes.VehiclesCase:
    """Ten to sixteen cars between random places of a yard, eight convex obstacles in it."""
    rng = np.random.default_rng(seed)
    number = 10 + seed % 7
    half = 20.0 + 0.5 * (number - 10)

    def free_poses(taken: list[shapely.Polygon], count: int, apart: float) -> list[Pose]:
        found: list[Pose] = []
        while len(found) < count:
            x, y = (float(of) for of in rng.uniform(-half, half, 2))
            pose = (x, y, float(rng.uniform(-math.pi, math.pi)))
            place = shapely.Polygon(parked(*pose)).buffer(apart)
            if not any(place.intersects(other) for other in taken):
                found.append(pose)
                taken.append(place)
        return found

    obstacles = {}
    shapes = []
    for k in range(8):
        x, y = rng.uniform(-0.8 * half, 0.8 * half, 2)
        size = rng.uniform(1.0, 2.5)
        corners = [(x + size * math.cos(a), y + size * math.sin(a)) for a in np.sort(rng.uniform(0, 2 * math.pi, 5))]
        shapes.append(shapely.Polygon(corners))
        obstacles[f"obstacle {k + 1}"] = [rcp.Polytope.hull(corners, name=f"obstacle {k + 1}")]
    starts = free_poses(list(shapes), number, 0.4)
    goals = free_poses(list(shapes), number, 0.4)
    return rcp.scenes.VehiclesCase(f"yard {seed}", np.array(starts), np.array(goals), obstacles)


def plan_scenes(seeds: Sequence[int]) -> None:
    """A line for each scene of several vehicles."""
    safe, seconds = 0, []
    for seed in seeds:
        case = vehicles_scene(seed)
        began = time.process_time()
        try:
            plan = rcp.scenes.plan_vehicles(case)
        except rcp.errors.PyRobocopError as error:
            print(f"{seed:>4} {len(case):>3} vehicles: {error}")
            seconds.append(time.process_time() - began)
            continue
        seconds.append(time.process_time() - began)
        safe += plan.safe
        last = max(move.departure for move in plan.moves)
        print(
            f"{seed:>4} {len(case):>3} vehicles {seconds[-1]:>6.1f} CPU s  {'safe' if plan.safe else 'NOT SAFE'} "
            f"all there after {plan.duration:.1f} s, {len(plan.moves)} moves, the last after {last:.1f}; closest "
            f"{plan.safety.worst.proven:.4f}",
            flush=True,
        )
    print(f"{safe} of {len(seconds)} safe; CPU seconds: median {np.median(seconds):.1f}, longest {max(seconds):.1f}")


QUICK = 7  # the number of the case of a quick run
BILLION = ("1000000000", "-1000000000")
CASES: dict[str, Callable[[], list[str]]] = {
    "across, wide lane": lambda: row(slots_across(6.0, 0.9, 2)),
    "across, narrow lane": lambda: row(slots_across(5.0, 0.9, 3)),
    "across, odd rings": lambda: row(odd_rings(slots_across(6.0, 0.8, 4))),
    "across, at 1e9 m": lambda: row(slots_across(6.0, 0.9, 2), BILLION),
    "aslant, forwards": lambda: row(slots_across(5.5, 0.8, 3, math.pi / 3)),
    "aslant, backwards": lambda: row(turned(slots_across(6.0, 0.8, 3, 2 * math.pi / 3), 0.7)),
    "along, roomy": lambda: row(slot_along(4.5, 2.0)),
    "along, tight": lambda: row(slot_along(4.5, 1.3)),
    "along, walls of 1e9 m": lambda: row(far_walls(slot_along(4.5, 1.6))),
    "along, at 1e9 m, turned": lambda: row(turned(slot_along(4.5, 1.6), 2.3), BILLION),
    "along, heading 7.5 rad": lambda: row(turned(slot_along(5.0, 1.8), 7.5 - 2 * math.pi), turns=(1, 1)),
    "garage": lambda: row(garage(2.9, 6.0)),
    "garage, heading -11 rad": lambda: row(turned(garage(2.9, 6.0), -11.0 + 4 * math.pi), turns=(-2, 0)),
    "dead end": lambda: row(dead_end(6.5, 8.0)),
    "clutter of 10": lambda: row(clutter(1, 10)),
    "clutter of 20, concave": lambda: row(clutter(2, 20, concave=True)),
    "clutter of 30": lambda: row(clutter(3, 30, size=34.0)),
    "clutter of 40, at 1e9 m": lambda: row(clutter(4, 40, size=38.0, concave=True), BILLION),
    "clutter of 53": lambda: row(clutter(5, 53, size=40.0)),
    "clutter of 53, concave": lambda: row(odd_rings(clutter(6, 53, size=44.0, concave=True)), turns=(1, -2)),
}  # fmt: skip


def main() -> None:
    """Solve, and print a line each."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("numbers", type=int, nargs="*", help="which cases; all by default")
    parser.add_argument("--write", type=Path, help="write files of all cases to a directory, and do nothing else")
    parser.add_argument("--quick", action="store_true", help="one case")
    parser.add_argument("--random", type=int, default=0, help="so many fresh cases instead")
    parser.add_argument("--first", type=int, default=0, help="seed of the first of them")
    parser.add_argument("--vehicles", action="store_true", help="with --random: scenes of ten to sixteen cars")
    chosen = parser.parse_args()
    numbers = [QUICK] if chosen.quick else chosen.numbers
    seeds = range(chosen.first, chosen.first + chosen.random)
    if chosen.vehicles:
        plan_scenes(seeds)
        return
    cases = {number: (name, make()) for number, (name, make) in enumerate(CASES.items(), start=1)}
    if chosen.random:
        cases = {seed: fresh_case(seed) for seed in seeds}
    if chosen.write is not None:
        for number, (_, row_of_case) in cases.items():
            (chosen.write / f"case_{number}.csv").write_text(",".join(row_of_case) + "\n")
        return
    safe, seconds = 0, []
    print(
        f"{'case':<30} {'corners':>7} {'parts':>5} {'path':>6} {'solve':>6}  {'safe':<5} "
        f"{'duration':>8} {'cusps':>5} {'proven':>8}"
    )
    for number, (name, row_of_case) in cases.items():
        if numbers and number not in numbers:
            continue
        began = time.process_time()
        case = rcp.scenes.ParkingCase.from_numbers(row_of_case, name=name)
        m = rcp.scenes.parking_model(case)
        built = time.process_time() - began
        guess = [m.drive.v[t].value for t in m.drive.time]
        result = rcp.solve(m)
        seconds.append(time.process_time() - began)
        speeds = [m.drive.v[t].value for t in m.drive.time]
        worst = result.safety.worst
        is_safe = bool(result.safe) and worst.clearance >= 0.05
        safe += is_safe
        corners = sum(len(part.vertices) for part in case.parts.values())
        print(
            f"{number:>4} {name:<25} {corners:>7} {len(case.parts):>5} {built:>6.1f} "
            f"{seconds[-1] - built:>6.1f}  {'yes' if is_safe else 'NO':<5} {m.drive.duration.value:>8.1f} "
            f"{changes(guess):>2}/{changes(speeds):<2} {worst.proven:>8.4f}  {len(result.rounds)} rounds",
            flush=True,
        )
    print(f"{safe} of {len(seconds)} safe; CPU seconds: mean {np.mean(seconds):.1f}, longest {max(seconds):.1f}")


def changes(speeds: Sequence[float]) -> int:
    """Changes of direction, of what counts as driving."""
    signs = np.sign([speed for speed in speeds if abs(speed) > 0.02])
    return int(np.count_nonzero(np.diff(signs)))


if __name__ == "__main__":
    main()
