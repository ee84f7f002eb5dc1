"""All examples: their sizes, what they cost, what came out; the pages of the gallery and of the table.

    python benchmarks/example_table.py [--coarse] [--only NAME ...] [--workers 2] [--docs FOLDER] [--keep FOLDER]

Each script of ``examples/`` runs once, all of its cases, as a user would run it, in a process of its own. Of each case
are shown: free variables, rows, pairs; Ipopt's iterations in all runs together; CPU seconds from building to the last
check; the objective and what is published for it (``published.py``); what `verify` recomputes from the user's
equations: largest violation, largest product of a pair, error of re-integrating the whole horizon; and what is known
about the point.

With ``--docs docs`` the pages ``docs/examples/gallery.md`` and ``table.md`` are written, with the pictures of the
gallery in ``docs/images/examples``, and the larger ones of other pages in ``docs/images``, where an example has one
there. The exit code is 0 only if every case was solved.
"""

from __future__ import annotations

import argparse
import ast
import io
import json
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image
from published import PUBLISHED
from table import Table, cells_of, markdown, show_progress

EXAMPLES = Path(__file__).parents[1] / "examples"
NOT_SCRIPTS = ("run_example", "mechanism_pictures", "cart_pole_closed_loop", "gaussian_process")
# Those that take longest come first, so that no core is left with one of them at the end.
LONGEST = ("belt_drive", "linear_complementarity_control", "rod", "hit_and_catch", "truss_robot", "sphere")
COLUMNS = [
    ("example", "<31"), ("case", "<22"), ("variables", ">9d"), ("rows", ">6d"), ("pairs", ">6d"),
    ("iterations", ">10d"), ("CPU s", ">6.1f"), ("J", ">11.7g"), ("published", ">9.7g"),
    ("violation", ">9.1e"), ("a*b", ">8.1e"), ("re-integration", ">14.1e"), ("verdict", "<30"),
]  # fmt: skip
KEYS = (
    "variables", "rows", "pairs", "iterations", "cpu", "objective", "published", "violation", "product", "horizon",
    "verdict",
)  # fmt: skip
# The columns of the page's two tables: the first two name the case in both.
SIZE, ANSWER = range(2, 7), range(7, len(COLUMNS))
TOPICS = {
    "Contact, impacts and gaits": (
        "bouncing_ball", "hopper", "truss_robot", "pendulum_soft_walls", "cart_pole_soft_walls", "hit_and_catch",
    ),
    "Pushing and assembly": (
        "planar_pushing", "pushing_in_minimum_time", "pushing_among_obstacles", "mode_sequence", "mode_enumeration",
        "belt_drive",
    ),
    "Friction and switches": ("stick_slip", "turbo_car", "linear_complementarity_control"),
    "Around obstacles": (
        "parking", "car_with_trailer", "car_between_obstacles", "crossing", "quadrotor_window", "two_link_arm",
        "robot_arm",
    ),
    "Several robots": ("rod", "sphere"),
    "Learned and estimated models": ("maze", "cart_pole_identification"),
    "Smooth motion": ("pendulum", "cart_pole", "acrobot", "quadrotor"),
}  # fmt: skip
PICTURE_BYTES, PICTURE_WIDTH = 80_000, 800
LARGE_BYTES, LARGE_WIDTH = 160_000, 1400


@dataclass(frozen=True)
class Run:
    """What one script gave.

    Attributes
    ----------
    name : str
        Of the script.
    facts : dict of case to dict
        As `examples/run_example.py` writes them; empty where the script failed.
    picture : bytes
        PNG; empty where there is none.
    output : str
        What it printed, for a message.
    """

    name: str
    facts: dict[str, dict[str, Any]]
    picture: bytes
    output: str

    @property
    def solved(self) -> bool:
        """Whether every case was."""
        return bool(self.facts) and all(fact["solved"] for fact in self.facts.values())

    def rows(self) -> list[tuple[Any, ...]]:
        """One per case, missing numbers as None."""
        return [
            (
                self.name,
                case,
                *(PUBLISHED.get((self.name, case)) if key == "published" else fact.get(key) for key in KEYS),
            )
            for case, fact in self.facts.items()
        ]


def scripts() -> list[str]:
    """Names of all examples, the longest first."""
    found = {path.stem for path in EXAMPLES.glob("*.py")} - set(NOT_SCRIPTS)
    return [name for name in LONGEST if name in found] + sorted(found - set(LONGEST))


def run(name: str, coarse: bool, keep: Path) -> Run:
    """Run all cases of one script, or read what an earlier run of it left."""
    facts, picture = keep / f"{name}.json", keep / f"{name}.png"
    output = ""
    if not facts.exists():
        command = [sys.executable, EXAMPLES / f"{name}.py", "--output", keep, "--facts", facts]
        ended = subprocess.run(
            [*command, *(["--coarse"] if coarse else [])],
            capture_output=True,
            text=True,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
        )
        output = ended.stdout[-2000:] + ended.stderr[-2000:]
    return Run(
        name,
        json.loads(facts.read_text()) if facts.exists() else {},
        picture.read_bytes() if picture.exists() else b"",
        output,
    )


def run_all(names: list[str], coarse: bool, workers: int, keep: Path) -> list[Run]:
    """Run scripts in parallel; print the rows of each as it ends."""
    table = Table(COLUMNS)
    table.header()
    done: list[Run] = []
    with ThreadPoolExecutor(workers) as pool:
        waiting = {pool.submit(run, name, coarse, keep): name for name in names}
        for ended in as_completed(waiting):
            done.append(ended.result())
            show_progress("")
            for row in done[-1].rows():
                table.add(*row)
            if not done[-1].facts:
                print(f"{done[-1].name} FAILED:\n{done[-1].output}")
            left = [name for future, name in waiting.items() if not future.done()]
            show_progress(f"{len(done)} of {len(names)} done; still to come: {', '.join(left)}")
    show_progress("")
    return sorted(done, key=lambda one: one.name)


def table_page(done: list[Run]) -> str:
    """The page of the table."""
    rows = cells_of([row for one in done for row in one.rows()], COLUMNS)
    size, answer = (
        markdown([COLUMNS[i][0] for i in part], [[row[i] for i in part] for row in rows], left=2)
        for part in ([0, 1, *SIZE], [0, 1, *ANSWER])
    )
    spent = sum(fact["cpu"] for one in done for fact in one.facts.values())
    cases = sum(len(one.facts) for one in done)
    return f"""# All examples in numbers

Written by `python benchmarks/example_table.py --docs docs`: {cases} cases, {spent / 60:.1f} minutes of CPU time, each
by `rcp.solve(m)` with defaults from the initial guess that its script states (teams by `team.solve()`).

## Sizes and cost

Variables are the free ones, rows are all constraints, and iterations are summed over all runs of Ipopt.
CPU seconds are from building the model to the last check.

{size}

## Answers

J is the objective; beside it stands the published value, or the value that the authors' package reaches, if it is
known (`benchmarks/published.py`). The columns to the right are recomputed from the user's equations
({{doc}}`../explanation/verification`): the largest violation, the largest product of a pair, and the distance between
the states and a re-integration of the whole horizon under the same controls. This distance is the error of the
discretisation, not a fault. The verdict is the quality of the point; with pairs, whether it is proven B-stationary
({{doc}}`../explanation/certificates`); with obstacles, whether the motion is proven to be clear at all times; for a
team, the physical score of the plan.

{answer}

* The published objective of the car beside one obstacle belongs to a motion on 50 elements that comes closer to the
  obstacle than the task allows: slightly at the points, and by a quarter between them. Here the mesh is refined until
  the motion of the equations keeps clear as well. On these elements the same motion costs more: implicit Euler is
  cheaper on few elements.
* The published objective of the slot belongs to a motion that comes within 4 mm of the squares, where 2 cm are
  required.
"""


def gallery_page(names: list[str]) -> str:
    """The page of the gallery, in the words of the scripts."""
    texts = {
        name: ast.get_docstring(ast.parse((EXAMPLES / f"{name}.py").read_text(encoding="utf-8"))) or ""
        for name in names
    }
    titles = {name: " ".join(text.split("\n\n")[0].split()) for name, text in texts.items()}
    headings = {name: name.replace("_", " ").capitalize() for name in names}
    parts = [
        "# Gallery",
        "Every example is one file that states a problem, solves it with defaults, checks the answer and draws it. "
        "Each takes `--case`, `--coarse` for a quick look, `--animate` and `--help`; sizes and costs of all are in "
        "{doc}`table`. This page is written by `python benchmarks/example_table.py --docs docs`.",
    ]
    for topic, members in TOPICS.items():
        cards = [
            f"```{{grid-item-card}} {headings[name]}\n:img-top: ../images/examples/{name}.png\n"
            f":link: example-{name}\n:link-type: ref\n\n{titles[name]}\n```"
            for name in members
            if name in titles
        ]
        parts += [f"## {topic}", "\n\n".join(["````{grid} 2 2 3 3\n:gutter: 3", *cards, "````"])] if cards else []
    parts.append("## Each example")
    for name, text in sorted(texts.items()):
        rest = " ".join("".join(text.split("\n\n")[1:2]).split())
        parts += [
            f"(example-{name})=\n### {headings[name]}",
            f"**{titles[name]}** {rest}".replace("``", "`"),
            f"```{{image}} ../images/examples/{name}.png\n:alt: {titles[name].removesuffix('.')}\n:width: 640px\n```",
            f"```bash\npython examples/{name}.py\n```",
        ]
    return "\n\n".join(parts) + "\n"


def small(picture: bytes, width: int = PICTURE_WIDTH, size: int = PICTURE_BYTES) -> bytes:
    """A picture in few colours and at most so wide, so that a page loads quickly."""
    image = Image.open(io.BytesIO(picture)).convert("RGB")
    if image.width > width:
        image = image.resize((width, round(image.height * width / image.width)), Image.LANCZOS)
    for colours in (128, 64, 32, 16, 8):
        written = io.BytesIO()
        image.quantize(colours).save(written, "PNG", optimize=True)
        if written.tell() <= size:
            break
    return written.getvalue()


def main() -> None:
    """Run, print, and write the pages."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="two examples on few elements")
    parser.add_argument("--coarse", action="store_true", help="few elements")
    parser.add_argument("--only", nargs="+", choices=scripts(), metavar="NAME", help="some of the examples")
    parser.add_argument("--workers", type=int, default=min(2, os.cpu_count() or 1), help="processes at a time")
    parser.add_argument("--docs", type=Path, help="folder of the documentation, to write pages and pictures there")
    parser.add_argument("--keep", type=Path, help="folder of what was run: what is there already is not run again")
    arguments = parser.parse_args()
    if arguments.docs is not None and arguments.only:
        parser.error("--docs writes pages of all examples: leave out --only")
    names = arguments.only or (["pendulum", "car_between_obstacles"] if arguments.quick else scripts())
    with tempfile.TemporaryDirectory() as folder:
        keep = arguments.keep or Path(folder)
        keep.mkdir(parents=True, exist_ok=True)
        done = run_all(names, arguments.coarse or arguments.quick, arguments.workers, keep)
    if arguments.docs is not None:
        (arguments.docs / "examples").mkdir(parents=True, exist_ok=True)
        (arguments.docs / "images" / "examples").mkdir(parents=True, exist_ok=True)
        for one in done:
            if one.picture:
                images = arguments.docs / "images"
                (images / "examples" / f"{one.name}.png").write_bytes(small(one.picture))
                if (images / f"{one.name}.png").exists():
                    (images / f"{one.name}.png").write_bytes(small(one.picture, LARGE_WIDTH, LARGE_BYTES))
        (arguments.docs / "examples" / "table.md").write_text(table_page(done), encoding="utf-8")
        (arguments.docs / "examples" / "gallery.md").write_text(gallery_page(names), encoding="utf-8")
    raise SystemExit(0 if all(one.solved for one in done) else 1)


if __name__ == "__main__":
    main()
