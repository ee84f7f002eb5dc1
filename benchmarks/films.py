"""Films of four plans among obstacles, and the page of the documentation that shows them.

    python benchmarks/films.py [--quick] [--only NAME ...] [--frames N] [--docs FOLDER]

"shelf": an arm of six joints reaches from one compartment of a shelf into another. "trailer": a car backs its trailer
into a bay. "windows": a quadrotor through three windows. "vehicles": ten cars in one yard. Each starts from a straight
line through its obstacles, or from nothing. Shown are CPU seconds of the plan, from the model's first line, and
whether it is proven clear.

With ``--docs docs`` the films are written to ``docs/images/films`` and the page to ``docs/examples/films.md``.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from obstacle_problems import random_shelf
from parking_cases import vehicles_scene
from table import Table, show_progress

import pyrobocop_pyomo as rcp

sys.path.append(str(Path(__file__).resolve().parents[1] / "examples"))

Film = Callable[..., Any]
FILES = {
    "shelf.gif": ("An arm reaches into a shelf", "`random_shelf(502)` of `benchmarks/obstacle_problems`"),
    "trailer.gif": ("A car backs its trailer into a bay", "`examples/car_with_trailer.py --case bay`"),
    "windows.gif": ("A quadrotor flies through three windows", "`examples/quadrotor_window.py --case three`"),
    "vehicles.gif": ("Ten cars cross a yard", "`vehicles_scene(91000)` of `benchmarks/parking_cases.py`"),
}
NAMES = [Path(file).stem for file in FILES]


def of_model(model: Any, phase: str, **options: Any) -> tuple[bool, Film]:
    """Solve, and what animates the plan."""
    safe = bool(rcp.solve(model, progress=False).safe)
    avoid = model.component(phase).avoid
    return safe, lambda path, frames: rcp.scenes.animate_avoidance(avoid, path, frames=frames, title="", **options)


def shelf() -> tuple[bool, Film]:
    """Six joints in the plane, accelerations as controls."""
    return of_model(random_shelf(502), "reach")


def trailer() -> tuple[bool, Film]:
    """The case of the example."""
    return of_model(importlib.import_module("car_with_trailer").build("bay"), "drive", size=(6.0, 4.6))


def windows() -> tuple[bool, Film]:
    """The case of the example; of the walls the part around the flight is shown."""
    model = importlib.import_module("quadrotor_window").build("three", elements=48)
    return of_model(model, "flight", view=[(-4.0, -1.2, -1.0), (4.0, 1.2, 1.0)], size=(8.0, 4.6))


def vehicles(quick: bool = False) -> tuple[bool, Film]:
    """A scene of the benchmark, or two cars that pass each other."""
    case = vehicles_scene(91000)
    if quick:
        case = rcp.scenes.VehiclesCase("yard", [(-8, 0, 0), (8, 4, 3.1416)], [(8, 0, 0), (-8, 4, 3.1416)], {})
    plan = rcp.scenes.plan_vehicles(case)
    return plan.safe, lambda path, frames: plan.animate(path, frames=frames, seconds=8.0, title="", size=(6.0, 6.0))


def main() -> None:
    """Print a row per film, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="two cars, four frames")
    parser.add_argument("--only", nargs="+", choices=NAMES, default=NAMES, metavar="NAME")
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--docs", type=Path, help="folder of the documentation, to write films and page there")
    arguments = parser.parse_args()
    made: dict[str, Callable[[], tuple[bool, Film]]] = {
        "shelf": shelf, "trailer": trailer, "windows": windows, "vehicles": lambda: vehicles(arguments.quick)
    }  # fmt: skip
    table = Table([("film", "<9"), ("CPU s", ">6.1f"), ("safe", "<4"), ("kB", ">6.0f")])
    table.header()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) if arguments.docs is None else arguments.docs / "images" / "films"
        folder.mkdir(parents=True, exist_ok=True)
        for name in ["vehicles"] if arguments.quick else arguments.only:
            show_progress(name)
            began = time.process_time()
            safe, animate = made[name]()
            seconds = time.process_time() - began
            file = animate(folder / f"{name}.gif", 4 if arguments.quick else arguments.frames)
            show_progress("")
            table.add(name, seconds, "yes" if safe else "NO", Path(file).stat().st_size / 1024)
    if arguments.docs is not None:
        (arguments.docs / "examples" / "films.md").write_text(page(), encoding="utf-8")


def page() -> str:
    """The page of the documentation."""
    text = "# Films\n\nPlans among obstacles, made by `python benchmarks/films.py --docs docs`.\n"
    for file, (title, source) in FILES.items():
        text += f"\n## {title}\n\n![{title}](../images/films/{file})\n\n{source}\n"
    return text


if __name__ == "__main__":
    main()
