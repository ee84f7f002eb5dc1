"""Several vehicles, planned one after the other: each drives round those that stand, and waits for those that move.

While a vehicle drives, those before it in the order have driven or drive still, and those after it stand at
their starts. Its path keeps clear of the starts of these and of the goals of the others, so that it can drive at
the latest when all before it have arrived. It leaves as soon as its motion keeps clear of theirs. Where no vehicle that
is left finds a way, the last ones of the order are taken back, as few as possible, so that one of those goes first.
Where vehicles are in each other's way so that no order helps, one of them moves aside before all others.

Erdmann and Lozano-Pérez, On multiple moving objects, Algorithmica 2 (1987), doi:10.1007/BF01840371, for the order;
Kant and Zucker, Toward efficient trajectory planning: the path-velocity decomposition, The International Journal of
Robotics Research 5 (1986), doi:10.1177/027836498600500304, for the waiting.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import InitialGuessError, ObstacleError
from pyrobocop_pyomo.geometry import Polytope, planar_pose
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.motion import SafetyReport
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.obstacles import verify_motion
from pyrobocop_pyomo.optional_imports import networkx, scipy
from pyrobocop_pyomo.planning.solve import solve
from pyrobocop_pyomo.plotting import AnimationFile, BodyPath, animate_scene
from pyrobocop_pyomo.presentation import Presented
from pyrobocop_pyomo.trajectories import Trajectory

from .cost_to_go import bounds_around, free_cells_of_disc
from .free_space import FreeSpace, are_free
from .hybrid_a_star import MOST_CELLS
from .motion_primitives import CarSearch
from .parking_case import ParkingCar
from .parking_model import parking_model
from .staged_search import LESS, ROOM
from .vehicles_case import VehiclesCase

logger = logging.getLogger(__name__)

# Seconds from one pose to the next, of those that are compared and proven.
STEP = 0.1
# Expansions for the path of one vehicle, while another one could come first.
FIRST_EXPANSIONS = 300
# The cells in which a way for a disc is looked for: their side in widths of a car.
CELL = 0.15
# Added to the clearance of each alone, since less is proven of several: poses a step apart stand for the motion between
# them. Added in the choice of departures as well; more each time that a proof fails.
SPARE = 0.02
# How far the places to move aside to are apart, in lengths of a car, and how many are tried.
ASIDE_STEP, ASIDE_TRIALS = 0.5, 4
_Planned = tuple[Trajectory, SafetyReport | None]
# A vehicle, those that have arrived, the share of the clearance and the expansions.
_Trial = tuple[int, frozenset[int], float, int]


@dataclass(frozen=True, eq=False)
class VehicleMove:
    """What one vehicle drives without a stop.

    Attributes
    ----------
    vehicle : int
        Counted from 0, as everywhere here.
    trajectory : Trajectory
        ``x``, ``y``, ``theta``, ``v``, ``steering`` and the controls, from the moment it leaves.
    report : SafetyReport or None
        The obstacles, and the other vehicles where they stand; None where there is neither.
    departure : float
        When it leaves, in seconds; it has to have arrived from its move before.
    """

    vehicle: int
    trajectory: Trajectory
    report: SafetyReport | None
    departure: float = 0.0

    @property
    def arrival(self) -> float:
        """When it arrives, in seconds."""
        return self.departure + self.trajectory.duration

    def poses_at(self, times: Any) -> Array:
        """x, y and heading, ``(m, 3)``.

        Parameters
        ----------
        times : (m,) array
            Before its departure it is where it begins, after its arrival where it ends.
        """
        found = self.trajectory(np.clip(np.asarray(times) - self.departure, 0.0, self.trajectory.duration))
        return np.column_stack([found["x"], found["y"], found["theta"]])


@dataclass(frozen=True, eq=False)
class VehiclesPlan(Presented):
    """Motions of several vehicles.

    Attributes
    ----------
    case : VehiclesCase
    car : ParkingCar
        Size and limits of each.
    moves : list of VehicleMove
        In the order in which they were planned. A vehicle that moves aside first has two.
    safety : SafetyReport
        Of the vehicles among each other, moving.
    """

    case: VehiclesCase
    car: ParkingCar
    moves: list[VehicleMove]
    safety: SafetyReport

    @property
    def safe(self) -> bool:
        """Whether all distances are proven at all times."""
        return self.safety.safe is True and all(move.report is None or move.report.safe for move in self.moves)

    @property
    def duration(self) -> float:
        """Until the last vehicle has arrived."""
        return max(move.arrival for move in self.moves)

    def poses_at(self, times: Any) -> Array:
        """x, y and heading of every vehicle, ``(n, m, 3)``.

        Parameters
        ----------
        times : (m,) array
            From 0; before its departure a vehicle is at its start, after its arrival at its goal.
        """
        times = np.asarray(times, dtype=float)
        return np.array([_poses(self.moves, k, times) for k in range(len(self.case))])

    def animate(self, path: str | Path | None = None, **options: Any) -> AnimationFile:
        """Write an animation of all vehicles; in a notebook, what is returned plays.

        Parameters
        ----------
        path : str or Path, optional
            Such as ``"yard.gif"``, or ``"yard.mp4"`` where ffmpeg is there; a temporary GIF by default.
        **options
            ``frames``, ``seconds``, ``view``, ``title`` and ``size``, as of `animate_avoidance`.
        """
        times = np.arange(0.0, self.duration + STEP, STEP)
        vehicles = []
        for number, poses in enumerate(self.poses_at(times), start=1):
            cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
            turned = np.array([[cos, -sin], [sin, cos]]).transpose(2, 0, 1)
            vehicles.append(BodyPath(self.car.shape, turned, poses[:, :2], name=f"vehicle {number}"))
        return animate_scene(times, vehicles, _parts(self.case), path, **{"title": self.case.name, **options})

    def __str__(self) -> str:
        worst = self.safety.worst
        apart = "" if worst is None else f"; the closest two keep {worst.proven:.4g}"
        state = "safe" if self.safe else "not safe"
        return f"{self.case}: {state}, all there after {self.duration:.4g} s{apart}"


def plan_vehicles(
    case: VehiclesCase,
    car: ParkingCar | None = None,
    *,
    clearance: float = 0.05,
    search: CarSearch | None = None,
    time_limit: float | None = None,
) -> VehiclesPlan:
    """Plan several vehicles, one after the other: the earlier ones are obstacles that move.

    Parameters
    ----------
    case : VehiclesCase
    car : ParkingCar, optional
        Size and limits of all of them.
    clearance : float, optional
        Distance to keep from obstacles and from each other. As for `parking_model` less is required where a start or a
        goal has less.
    search : CarSearch, optional
        Its expansions are for one path.
    time_limit : float, optional
        Seconds, for everything together.

    Raises
    ------
    InitialGuessError
        When no vehicle that is left finds a way while the others stand, in any order tried, also where some move
        aside first; or the time is over.
    ObstacleError
        When vehicles overlap at their starts or at their goals.
    """
    car = ParkingCar() if car is None else car
    search, deadline = search or CarSearch(), Deadline.after(time_limit)
    _refuse_overlaps(case, car)
    # Where each begins after those that move aside.
    begun, aside = case, list[VehicleMove]()
    while True:
        moves, stuck = list[VehicleMove](), _in_a_ring(begun, car, clearance)
        if not stuck:
            moves, stuck = _in_turn(begun, car, clearance, search, deadline)
        if not stuck:
            return _timed(case, car, [*aside, *moves], clearance)
        makes_room = _moves_aside(begun, car, stuck, clearance, search, deadline) if len(aside) < len(case) else None
        if makes_room is None:
            raise InitialGuessError(
                f"plan_vehicles: '{case.name}': of the vehicles {[k + 1 for k in stuck]} none finds a way to its goal "
                f"while the others stand and {[move.vehicle + 1 for move in moves]} have arrived. Give more time, less "
                "clearance, or starts and goals that leave a way."
            )
        move, place = makes_room
        logger.info("'%s': vehicle %d moves aside, to %s", case.name, move.vehicle + 1, place)
        aside.append(move)
        starts = begun.starts.copy()
        starts[move.vehicle] = place
        begun = replace(begun, starts=starts)


def _in_turn(
    case: VehiclesCase, car: ParkingCar, clearance: float, search: CarSearch, deadline: Deadline
) -> tuple[list[VehicleMove], list[int]]:
    """One move of each, in an order in which each has a way, and those that have none in any order tried."""
    left = sorted(range(len(case)), key=lambda k: -float(np.hypot(*(case.goals[k] - case.starts[k])[:2])))
    order: list[int] = []
    planned: dict[int, _Planned] = {}
    in_vain: set[_Trial] = set()
    changes = 0
    while left:
        fewest = 0 if changes < len(case) else len(order)
        step = _next(case, car, order, left, fewest, clearance, search, deadline, in_vain)
        if step is None:
            break
        kept, vehicle, planned[vehicle] = step
        if kept < len(order):
            changes += 1
            logger.info("'%s': vehicle %d goes before %s", case.name, vehicle + 1, [k + 1 for k in order[kept:]])
        left = order[kept:] + [k for k in left if k != vehicle]
        order = [*order[:kept], vehicle]
    return [VehicleMove(k, *planned[k]) for k in order], left


def _in_a_ring(case: VehiclesCase, car: ParkingCar, clearance: float) -> list[int]:
    """Vehicles of which each has to leave before the next one arrives; none where there is an order."""
    space = FreeSpace.around(car.shape, [], 0.0, 1.0)
    goal, start = (~np.eye(len(case), dtype=bool)).nonzero()
    taken = space.gaps_between_vehicles(case.goals[goal], case.starts[start]) < LESS * clearance
    leaves_before = networkx.DiGraph(zip(start[taken].tolist(), goal[taken].tolist(), strict=True))
    ring: list[int] = next(networkx.simple_cycles(leaves_before), [])
    return sorted(ring)


def _moves_aside(
    case: VehiclesCase, car: ParkingCar, stuck: Sequence[int], clearance: float, search: CarSearch, deadline: Deadline
) -> tuple[VehicleMove, Array] | None:
    """The move of one of those that are stuck to a place where it is in nobody's way, and that place."""
    scene = float(np.abs([case.starts, case.goals]).max())
    space = FreeSpace.around(car.shape, _parts(case), clearance + SPARE, scene)
    reach = np.arange(-4.0, 4.0 + ASIDE_STEP, ASIDE_STEP) * car.length
    offsets = np.stack(np.meshgrid(reach, reach, 0.25 * math.pi * np.arange(-3, 5)), axis=-1).reshape(-1, 3)
    offsets = offsets[np.hypot(offsets[:, 0], offsets[:, 1]).argsort(kind="stable")]
    for vehicle in stuck:
        others = [k for k in range(len(case)) if k != vehicle]
        taken = np.concatenate([case.starts[others], case.goals])
        places = case.starts[vehicle] + offsets
        gaps = space.gaps_between_vehicles(np.repeat(places, len(taken), 0), np.tile(taken, (len(places), 1)))
        apart = gaps.reshape(len(places), -1).min(axis=1) >= 2.0 * (clearance + SPARE)
        trials = ASIDE_TRIALS
        for place in places[apart & are_free(space, places)]:
            if not trials or deadline.has_passed:
                break
            if not _discs_have_ways(case, car, place[None], others):
                continue
            trials -= 1
            goals = case.goals.copy()
            goals[vehicle] = place
            to_place = replace(case, goals=goals)
            planned = _alone(to_place, car, vehicle, [], range(len(case)), clearance, search, deadline.left)
            if planned is not None:
                move = VehicleMove(vehicle, *planned)
                return move, move.poses_at(np.array([np.inf]))[0]
    return None


def _parts(case: VehiclesCase) -> list[Polytope]:
    return [part for parts in case.obstacles.values() for part in parts]


def _refuse_overlaps(case: VehiclesCase, car: ParkingCar) -> None:
    space = FreeSpace.around(car.shape, [], 0.0, 1.0)
    for which, poses in (("starts", case.starts), ("goals", case.goals)):
        first, second = np.triu_indices(len(case), 1)
        gaps = space.gaps_between_vehicles(poses[first], poses[second])
        if len(gaps) and gaps.min() <= 0.0:
            k = int(gaps.argmin())
            raise ObstacleError(
                f"plan_vehicles: '{case.name}': at their {which} vehicles {first[k] + 1} and {second[k] + 1} overlap "
                f"by {-gaps[k]:.4g}."
            )


def _next(
    case: VehiclesCase, car: ParkingCar, order: list[int], left: Sequence[int], fewest: int, clearance: float,
    search: CarSearch, deadline: Deadline, in_vain: set[_Trial],
) -> tuple[int, int, _Planned] | None:  # fmt: skip
    """How many of the order stay, the vehicle that follows these, and its motion; None where none finds a way."""
    little = min(FIRST_EXPANSIONS, search.max_expansions)
    for share, most in ((1.0, little), (1.0, search.max_expansions), (LESS, search.max_expansions)):
        limited = replace(search, max_expansions=most)
        for kept in range(len(order), fewest - 1, -1):
            waiting = [*order[kept:], *left]
            for vehicle in _with_ways(case, car, order[:kept], waiting, left):
                seconds = deadline.left
                if seconds is not None and seconds <= 0.0:
                    return None
                trial = vehicle, frozenset(order[:kept]), share, most
                if trial in in_vain:
                    continue
                planned = _alone(case, car, vehicle, order[:kept], waiting, share * clearance, limited, seconds)
                if planned is not None:
                    return kept, vehicle, planned
                in_vain.add(trial)
    return None


def _with_ways(
    case: VehiclesCase, car: ParkingCar, arrived: list[int], waiting: Sequence[int], chosen: Sequence[int]
) -> Iterator[int]:
    """The chosen vehicles that may have a way now; first the ones that leave a way for all others where they arrive."""
    shutting_in = []
    for vehicle in chosen:
        others = [k for k in waiting if k != vehicle]
        standing = np.concatenate([case.goals[arrived], case.starts[others]])
        if not _discs_have_ways(case, car, standing, [vehicle]):
            continue
        if _discs_have_ways(case, car, case.goals[[*arrived, vehicle]], others):
            yield vehicle
        else:
            shutting_in.append(vehicle)
    yield from shutting_in


def _discs_have_ways(case: VehiclesCase, car: ParkingCar, standing: Array, vehicles: list[int]) -> bool:
    """Whether a disc inside each vehicle has a way from its start to its goal round the obstacles and what stands.

    Where it has none, no search finds one for the vehicle.
    """
    shapes = [*_parts(case), *(car.shape.placed(planar_pose(*pose)) for pose in standing.tolist())]
    bounds = bounds_around(np.concatenate([case.starts, case.goals])[:, :2], ROOM[-1] * car.length)
    low, high = np.array(bounds).T
    cell = max(CELL * car.width, float((high - low).max()) / MOST_CELLS)
    free = free_cells_of_disc(bounds, cell, car.shape, shapes, 0.0, float(np.abs([low, high]).max()))
    connected = scipy.ndimage.label(free, np.ones((3, 3)))[0]
    first, last = (
        connected[tuple(np.floor((poses[vehicles, :2] - low) / cell).astype(int).T)]
        for poses in (case.starts, case.goals)
    )
    return bool(((first == last) & (first > 0)).all())


def _alone(
    case: VehiclesCase, car: ParkingCar, vehicle: int, arrived: Sequence[int], waiting: Sequence[int],
    clearance: float, search: CarSearch, seconds: float | None,
) -> _Planned | None:  # fmt: skip
    """Its motion round all others, which stand; None where there is none."""
    others = [(k, case.goals[k]) for k in arrived] + [(k, case.starts[k]) for k in waiting if k != vehicle]
    standing = [(f"vehicle {k + 1}", car.shape.placed(planar_pose(*pose.tolist()))) for k, pose in others]
    try:
        model = parking_model(
            case.alone(vehicle, standing), car, clearance=clearance + SPARE, search=search, needs_path=True,
            time_limit=seconds,
        )  # fmt: skip
    except (ObstacleError, InitialGuessError) as error:
        # Its goal is where another one still stands, or these leave no way.
        logger.info("%s", error)
        return None
    result = solve(model, time_limit=seconds)
    logger.info("'%s': vehicle %d: %s", case.name, vehicle + 1, result.quality)
    if not standing and not case.obstacles:
        return model.drive.trajectory(), None
    return (model.drive.trajectory(), result.safety) if result.safe and result.safety is not None else None


def _timed(case: VehiclesCase, car: ParkingCar, moves: list[VehicleMove], clearance: float) -> VehiclesPlan:
    """Departures in the given order, so that all distances are proven."""
    space = FreeSpace.around(car.shape, [], 0.0, 1.0)
    reports = [move.report for move in moves if move.report is not None]
    least = min((pair.clearance for report in reports for pair in report.body_pairs), default=clearance + SPARE)
    required = clearance if least >= clearance + SPARE else 0.6 * least
    off = np.zeros(len(case))
    for move in moves:
        deviates = max((pair.deviation for pair in move.report.body_pairs), default=0.0) if move.report else 0.0
        deviates += _chord_deviation(move.trajectory, space.corner_radius)
        off[move.vehicle] = max(off[move.vehicle], deviates)
    spare = SPARE
    while True:
        plan = VehiclesPlan(
            case, car, _departures(space, moves, required + 2.0 * float(off.max()) + spare), SafetyReport(())
        )
        times = np.arange(0.0, plan.duration + 2.0 * STEP, STEP)
        names = [f"vehicle {k + 1}" for k in range(len(case))]
        rows = dict(zip(names, plan.poses_at(times), strict=True))
        pairs = {
            (names[i], names[k]): required + float(off[i] + off[k])
            for i in range(len(case))
            for k in range(i + 1, len(case))
        }
        if not pairs:
            return plan
        safety = verify_motion(
            times,
            rows,
            bodies=dict.fromkeys(names, car.shape),
            clearance=pairs,
            body_pairs=list(pairs),
        )
        spare *= 2.0
        if safety.safe or spare > car.width:
            return replace(plan, safety=safety)


def _poses(moves: Sequence[VehicleMove], vehicle: int, times: Array) -> Array:
    """Poses of one vehicle, along its last move that has begun."""
    own = [move for move in moves if move.vehicle == vehicle]
    poses = own[0].poses_at(times)
    for move in own[1:]:
        poses = np.where((times < move.departure)[:, None], poses, move.poses_at(times))
    return poses


def _chord_deviation(trajectory: Trajectory, reach: float) -> float:
    """How far a point of the vehicle may be from chords between poses that are a step apart.

    Of polynomials of degree three the second derivative is largest at an end of an element. A step may hold the
    end of an element, where the slope jumps by a little: a kink is at most a quarter of step
    times jump away from its chord.
    """
    widths = np.diff(trajectory.grid.mesh.boundaries)
    values = trajectory.element_polynomials(np.arange(4) / 3.0)
    bounds = {}
    for name in ("x", "y", "theta"):
        powers = values[name] @ np.linalg.inv(np.vander(np.arange(4) / 3.0, 4, increasing=True)).T
        start, end = 2.0 * powers[:, 2], 2.0 * powers[:, 2] + 6.0 * powers[:, 3]
        bend = np.maximum(np.abs(start), np.abs(end)) / widths**2
        slopes = powers[:, 1] / widths, (powers[:, 1] + 2.0 * powers[:, 2] + 3.0 * powers[:, 3]) / widths
        # Before it leaves and after it arrives, the vehicle stands.
        jumps = np.abs(np.append(slopes[0], 0.0) - np.insert(slopes[1], 0, 0.0))
        bounds[name] = STEP**2 / 8.0 * float(bend.max()) + STEP / 4.0 * float(jumps.max())
    return math.hypot(bounds["x"], bounds["y"]) + reach * bounds["theta"]


def _departures(space: FreeSpace, moves: Sequence[VehicleMove], clearance: float) -> list[VehicleMove]:
    """Each leaves at the earliest time that is possible, those before it in the order being settled."""
    settled: list[VehicleMove] = []
    last = 0.0
    for own in moves:
        times = np.arange(0.0, last + own.trajectory.duration + 2.0 * STEP, STEP)
        others = {move.vehicle for move in settled} - {own.vehicle}
        before = np.array([_poses(settled, k, times) for k in others]).reshape(len(others), len(times), 3)
        mine = own.poses_at(np.arange(0.0, own.trajectory.duration + STEP, STEP))
        arrived = max((move.arrival for move in settled if move.vehicle == own.vehicle), default=0.0)
        wait, latest = math.ceil(arrived / STEP), math.ceil(last / STEP)
        while wait < latest and not _keeps_clear(space, mine, wait, before, clearance):
            wait += 2
        settled.append(replace(own, departure=wait * STEP))
        last = max(last, settled[-1].arrival)
    return settled


def _keeps_clear(space: FreeSpace, mine: Array, wait: int, before: Array, clearance: float) -> bool:
    """Whether a motion that begins after so many steps keeps away from those before it, at all steps."""
    at = mine[np.clip(np.arange(before.shape[1]) - wait, 0, len(mine) - 1)]
    near = np.hypot(*np.moveaxis(before[..., :2] - at[:, :2], -1, 0)) < 2.0 * space.corner_radius + clearance
    which, step = np.nonzero(near)
    return bool((space.gaps_between_vehicles(at[step], before[which, step]) >= clearance).all())
