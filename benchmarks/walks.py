"""Which files and folders a value passes through, from the user's statement to the answer.

    python benchmarks/walks.py [--quick]

Eight things are followed: a right-hand side and a pair, with the expressions that their rules give and what makes rows
of them; a relaxation's delta, a schedule, the bounds of a State, the vertices of an obstacle, a pose rule and an option
of Ipopt. Each is given to a small model as an object of its own, and every call of a function of the package is watched
while the model is built, solved and verified. A file "receives" the thing if one of its functions gets that very
object: as an argument, within a list, tuple or dictionary, or as an attribute of ``self``; a decorator that takes any
arguments and hands them on does not count. A file "names" the thing if an identifier in it contains its word; bounds
and options are words for other things too, and are not counted. Numbers that are computed from the thing, and copies of
it in arrays or in Pyomo's components, are not followed.
"""

from __future__ import annotations

import argparse
import ast
import inspect
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

import pyomo.environ as pyo
from table import Table, show_progress

import pyrobocop_pyomo as rcp

ROOT = Path(rcp.__file__).parent
LONGEST = 20  # of lists and dictionaries that are looked into


def main() -> None:
    """Print the table, and the files under it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="the schedule and the option only")
    quick = parser.parse_args().quick

    table = Table(
        [
            ("what", "<20"), ("folders that receive it", ">23d"), ("files", ">5d"),
            ("folders that name it", ">20d"), ("files", ">5d"),
        ]
    )  # fmt: skip
    table.header()
    details = []
    for name, (walk, word) in WALKS.items():
        if quick and name not in ("schedule", "option of Ipopt"):
            continue
        show_progress(name)
        received = set(walk())
        named = set(files_that_name(word)) if word else None
        show_progress("")
        table.add(
            name,
            len(folders(received)),
            len(received),
            *((None, None) if named is None else (len(folders(named)), len(named))),
        )
        details.append(f"{name}: {', '.join(sorted(received))}")
    print("\nreceived by\n" + "\n".join(details))


def folders(files: set[str]) -> set[str]:
    """The folders of some files; a file beside the package's root counts as one of its own."""
    return {file.split("/")[0] for file in files}


# ------------------------------------------------------------------------------------------------ what receives it


@contextmanager
def watched(*things: Any) -> Iterator[set[str]]:
    """The files of the package whose functions receive one of some objects while the context is open.

    A list of objects may grow meanwhile.
    """
    files: set[str] = set()

    def trace(frame: FrameType, event: str, _: Any) -> None:
        if (
            event == "call"
            and frame.f_code.co_filename.startswith(f"{ROOT}/")
            and any(receives(frame, thing) for thing in flat(things))
        ):
            files.add(Path(frame.f_code.co_filename).relative_to(ROOT).as_posix())

    sys.setprofile(trace)
    try:
        yield files
    finally:
        sys.setprofile(None)


def flat(things: Iterable[Any]) -> list[Any]:
    """The objects, those in lists too."""
    return [each for thing in things for each in (thing if type(thing) is list else [thing])]


def receives(frame: FrameType, thing: Any) -> bool:
    """Whether an argument of a call is the object, or holds it."""
    code = frame.f_code
    if not code.co_argcount + code.co_kwonlyargcount and code.co_flags & inspect.CO_VARKEYWORDS:
        return False
    starred = bool(code.co_flags & inspect.CO_VARARGS) + bool(code.co_flags & inspect.CO_VARKEYWORDS)
    for name in code.co_varnames[: code.co_argcount + code.co_kwonlyargcount + starred]:
        value = frame.f_locals.get(name)
        attributes = getattr(value, "__dict__", {}).values() if name == "self" else ()
        if holds(value, thing) or any(holds(attribute, thing) for attribute in list(attributes)):
            return True
    return False


def holds(value: Any, thing: Any, depth: int = 0) -> bool:
    """Whether a value is the object, or a small container with it."""
    if value is thing:
        return True
    if depth == 2 or type(value) not in (tuple, list, dict) or len(value) > LONGEST:
        return False
    inside = value.values() if type(value) is dict else value
    return any(holds(part, thing, depth + 1) for part in list(inside))


# --------------------------------------------------------------------------------------------------- what names it


def files_that_name(word: str) -> Iterator[str]:
    """The files with an identifier that contains a word."""
    pattern = re.compile(rf"(^|_)({word})(_|$)")
    for path in sorted(ROOT.rglob("*.py")):
        if path.parent != ROOT and any(
            pattern.search(name) for name in identifiers(ast.parse(path.read_text("utf-8")))
        ):
            yield path.relative_to(ROOT).as_posix()


def identifiers(tree: ast.Module) -> Iterator[str]:
    """Names that are bound or read, attributes, parameters and keywords."""
    for node in ast.walk(tree):
        for attribute in ("id", "attr", "arg", "name"):
            name = getattr(node, attribute, None)
            if isinstance(name, str):
                yield name.lower()


# ---------------------------------------------------------------------------------------------------------- models


def fall(b: Any, t: Any) -> dict[Any, Any]:
    """The right-hand side of a body under its thrust and the force of the floor."""
    return {b.height: b.speed[t], b.speed: b.thrust[t] + b.floor_force[t] - 9.81}


def contact(b: Any, t: Any) -> Any:
    """The floor pushes where the body touches it."""
    return rcp.complements(b.height[t] >= 0, b.floor_force[t] >= 0)


def lift(
    bounds: tuple[float, float | None] = (0.0, None),
    ode: Callable[..., Any] = fall,
    floor: Callable[..., Any] = contact,
) -> pyo.ConcreteModel:
    """A body that rests on a floor until its thrust lifts it."""
    m = pyo.ConcreteModel(name="lift")
    m.lift = b = rcp.PhaseBlock(duration=2.0, elements=5, scheme="implicit_euler")
    b.height = rcp.State(initial=0, final=0.5, bounds=bounds)
    b.speed = rcp.State(initial=0, final=0)
    b.floor_force = rcp.Algebraic(bounds=(0, None))
    b.thrust = rcp.Control(bounds=(0, 15))
    b.ode(ode)
    b.complementarity(floor, name="floor")
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.thrust[t] ** 2))
    return m


def planar_cart(b: Any, t: Any) -> Any:
    """The pose of the cart."""
    return rcp.planar_pose(b.x[t], b.y[t], 0.0)


def cart(pose: Callable[..., Any], wall: Any) -> pyo.ConcreteModel:
    """A cart that drives around a wall."""
    m = pyo.ConcreteModel(name="cart")
    m.move = b = rcp.PhaseBlock(duration=2.0, elements=6)
    b.x, b.y = rcp.State(initial=0, final=4), rcp.State(initial=0, final=0)
    b.vx, b.vy = rcp.Control(), rcp.Control()
    b.ode(lambda b, t: {b.x: b.vx[t], b.y: b.vy[t]})
    body = rcp.Body(rcp.Polytope.box(0.9, 0.4), pose=pose)
    b.avoid = rcp.ObstacleAvoidanceBlock(b.time, bodies={"cart": body}, obstacles={"wall": wall}, clearance=0.05)
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.vx[t] ** 2 + b.vy[t] ** 2))
    return m


# ----------------------------------------------------------------------------------------------------------- walks


def walk_of_right_hand_side() -> set[str]:
    """A rule, its expressions, its template, and what makes rows of it, also when the trajectory is verified."""
    given: list[Any] = []

    def ode(b: Any, t: Any) -> dict[Any, Any]:
        rates = fall(b, t)
        given.append(rates[b.speed])
        return rates

    with watched(ode, given) as files:
        m = lift(ode=ode)
        (statement,), of_one = m.lift.record.statements_of("ode"), m.lift.record.rates["speed"]
        given += [statement.rule, statement.rule.formulas(m.lift), *vars(of_one).values()]
        given += [each.rule_of_rows for each in m.lift.component_objects(pyo.Constraint) if "speed" in each.name]
        rcp.solve(m, progress=False)
        m.lift.trajectory().verify()
    return files


def walk_of_pair() -> set[str]:
    """A rule and the pairs that it gives, also when the trajectory is verified."""
    given: list[Any] = []

    def floor(b: Any, t: Any) -> Any:
        given.append(contact(b, t))
        return given[-1]

    with watched(floor, given) as files:
        m = lift(floor=floor)
        rcp.solve(m, progress=False)
        m.lift.trajectory().verify()
    return files


def walk_of_delta() -> set[str]:
    """The number of `Fixed`."""
    delta = float("1.2345e-7")  # an object that nothing else is
    with watched(delta) as files:
        rcp.solve(lift(), strategies=rcp.Strategy(schedule=rcp.relaxations.Fixed(delta)), progress=False)
    return files


def walk_of_schedule() -> set[str]:
    """A `Fixed`."""
    schedule = rcp.relaxations.Fixed(1e-7)
    with watched(schedule) as files:
        rcp.solve(lift(), strategies=rcp.Strategy(schedule=schedule), progress=False)
    return files


def walk_of_bounds() -> set[str]:
    """The upper bound of a State, also when its trajectory is verified."""
    upper = float("7.125")
    with watched(upper) as files:
        m = lift((0.0, upper))
        rcp.solve(m, progress=False)
        m.lift.trajectory().verify()
    return files


def walk_of_vertices() -> set[str]:
    """The corners of a wall, as the array that its shape holds."""
    wall = rcp.Polytope.from_vertices([(1.6, -1.5), (2.4, -1.5), (2.4, 0.5), (1.6, 0.5)])
    with watched(wall.vertices) as files:
        rcp.solve(cart(planar_cart, wall), progress=False)
    return files


def walk_of_pose() -> set[str]:
    """A rule of a pose."""

    def pose(b, t):
        return planar_cart(b, t)

    with watched(pose) as files:
        rcp.solve(cart(pose, rcp.Polytope.box(0.8, 2, center=(2, -0.5))), progress=False)
    return files


def walk_of_option() -> set[str]:
    """A tolerance."""
    tolerance = float("1.5e-9")
    with watched(tolerance) as files:
        rcp.solve(lift(), options={"tol": tolerance}, progress=False)
    return files


WALKS = {
    "right-hand side": (walk_of_right_hand_side, None),
    "pair": (walk_of_pair, "pairs?"),
    "delta of a relaxation": (walk_of_delta, "deltas?"),
    "schedule": (walk_of_schedule, "schedules?"),
    "bounds of a State": (walk_of_bounds, None),
    "vertices of a shape": (walk_of_vertices, "vertex|vertices|corners?"),
    "pose rule": (walk_of_pose, "poses?"),
    "option of Ipopt": (walk_of_option, None),
}


if __name__ == "__main__":
    main()
