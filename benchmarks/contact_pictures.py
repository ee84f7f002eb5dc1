"""Pictures of the tasks that ``contact_from_nothing.py`` plans: where bodies are at a few times of a plan.

    python benchmarks/contact_pictures.py [--quick] [--case N] [--folder FOLDER]

Writes one picture, ``contact_from_nothing.png``, of the plans that `rcp.solve` finds from zero. Darker is later; red is
what touches or drives.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from contact_from_nothing import ALL_TASKS
from matplotlib.colors import to_rgba
from table import show_progress

import pyrobocop_pyomo as rcp

SHOWN = 7
Corners = Sequence[tuple[float, float]]


def placed(corners: Corners, x: float = 0.0, y: float = 0.0, angle: float = 0.0) -> np.ndarray:
    """Corners, shape (n, 2), turned and moved."""
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(corners) @ np.array([[c, s], [-s, c]]) + [x, y]


def box(a: float, b: float) -> Corners:
    """A rectangle with these half lengths."""
    return [(-a, -b), (a, -b), (a, b), (-a, b)]


def t_shape() -> Corners:
    """The T, with its centre of mass at the origin."""
    unit, centre = 0.05, 2.6429
    x, y = np.array([-0.5, 0.5, 0.5, 2, 2, -2, -2, -0.5]), np.array([0, 0, 3, 3, 4, 4, 3, 3])
    return list(zip(unit * x, unit * (y - centre), strict=True))


def pushed(corners: Corners) -> Callable:
    """A body on a table and the point that pushes it."""

    def draw(plan: Any, k: int) -> list[tuple[str, np.ndarray]]:
        at, j = (plan.x[k], plan.y[k], plan.q[k]), max(k - 1, 0)  # what moves the body there has acted before
        return [("body", placed(corners, *at)), ("red dot", placed([(plan.cx[j], plan.cy[j])], *at))]

    return draw


def transported(plan: Any, k: int) -> list[tuple[str, np.ndarray]]:
    """The times run downwards: the motion is along one line."""
    y = -0.8 * k / len(plan.x1) * 5
    return [("body", placed(box(1.0, 0.08), plan.x2[k], y)), ("red body", placed(box(0.25, 0.12), plan.x1[k], y + 0.2))]


def served(plan: Any, k: int) -> list[tuple[str, np.ndarray]]:
    """A plate over the edge of a table, which ends at zero, under the pusher; the times run downwards."""
    y = -5.0 * k / len(plan.x1)
    return [("body", placed(box(7.0, 0.12), plan.x1[k], y)), ("red dot", placed([(plan.x2[k], y + 0.3)]))]


def balanced(plan: Any, k: int) -> list[tuple[str, np.ndarray]]:
    """A cart, its pole, and the walls."""
    x, q = plan.x[k], plan.q[k]
    tip = x + 0.8 * np.sin(q), 0.8 * np.cos(q)
    walls = [("red line", np.array([(side, 0.5), (side, 0.9)])) for side in (-1, 1)]
    return [("body", placed(box(0.12, 0.06), x)), ("line", np.array([(x, 0.0), tip])), *walls]


def leapt(plan: Any, k: int) -> list[tuple[str, np.ndarray]]:
    """A body, its leg, the ground."""
    body, foot = (plan.px[k], plan.py[k]), (plan.qx[k], plan.qy[k])
    return [("body", placed(box(0.12, 0.12), *body)), ("line", np.array([body, foot])), ("red dot", np.array([foot]))]


def gripped(plan: Any, k: int) -> list[tuple[str, np.ndarray]]:
    """A block and two fingertips."""
    fingers = np.array([(plan.x1[k], plan.z1[k]), (plan.x2[k], plan.z2[k])])
    return [("body", placed(box(0.05, 0.05), plan.x[k], plan.z[k])), ("red dot", fingers)]


def turned(plan: Any, k: int) -> list[tuple[str, np.ndarray]]:
    """A knob with its mark, and a fingertip above it; knobs of later times stand further right."""
    right, around = 0.35 * k / len(plan.q) * SHOWN, np.linspace(0, 2 * np.pi, 40)
    high, mark = 0.1 + plan.r[k], np.pi / 2 - plan.q[k]
    finger = high * np.sin(plan.p[k]) + right, high * np.cos(plan.p[k])
    return [
        ("body", placed(np.column_stack([0.1 * np.cos(around), 0.1 * np.sin(around)]), right)),
        ("line", np.array([(right, 0.0), (right + 0.1 * np.cos(mark), 0.1 * np.sin(mark))])),
        ("red dot", np.array([finger])),
    ]


DRAWN: dict[str, Callable] = {
    "push box": pushed(box(0.5, 0.25)),
    "transport": transported,
    "waiter": served,
    "cart-pole": balanced,
    "hopper": leapt,
    "push T": pushed(t_shape()),
    "gripper": gripped,
    "knob": turned,
}


def draw(axes: Any, name: str, plan: Any) -> None:
    """What stands in `DRAWN`, at times that are evenly spread."""
    times = np.linspace(0, len(plan.time) - 1, SHOWN).astype(int)
    for shade, k in zip(np.linspace(0.25, 1.0, SHOWN), times.tolist(), strict=True):
        for what, points in DRAWN[name](plan, k):
            colour = to_rgba("tab:red" if "red" in what else "tab:blue", shade)
            if "body" in what:
                axes.fill(*points.T, facecolor=(*colour[:3], 0.15 * shade), edgecolor=colour, linewidth=1)
            else:
                axes.plot(*points.T, "o" if "dot" in what else "-", color=colour, markersize=3, linewidth=1)
    axes.set_title(name, fontsize=9)
    axes.set_aspect("equal" if name not in ("transport", "waiter") else "auto")
    axes.tick_params(labelsize=6)


def main() -> None:
    """Solve and draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one task, and no file")
    parser.add_argument("--case", type=int, default=2)
    parser.add_argument("--folder", type=Path, default=Path())
    given = parser.parse_args()
    figure, axes = plt.subplots(2, 4, figsize=(11, 5.5), layout="constrained")
    for task, place in zip(ALL_TASKS[-1:] if given.quick else ALL_TASKS, axes.flat, strict=False):
        show_progress(task.name)
        m = task.build(given.case)
        result = rcp.solve(m, progress=False)
        draw(place, task.name, m.b.trajectory())
        show_progress("")
        print(f"{task.name}: {result.quality.name.lower()}, distance from the goal {task.error(m):.2g}")
    if not given.quick:
        figure.savefig(given.folder / "contact_from_nothing.png", dpi=90)


if __name__ == "__main__":
    main()
