"""Pages with meshcat's viewer: what is in them, and where it is at each time of the plan."""

from __future__ import annotations

import json
import re
from base64 import b64decode
from pathlib import Path

import numpy as np
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import GeometryError
from pyrobocop_pyomo.optional_imports import meshcat_available, scipy, umsgpack

needs_meshcat = pytest.mark.skipif(not meshcat_available, reason="meshcat is not installed")

TIME = np.linspace(1, 3, 21)
CAR = (rcp.Polytope.box(2, 1), rcp.Polytope.capsule((0, 0), (2, 0), 0.1))
WALL = rcp.Polytope.from_halfspaces([[0, -1]], [-3], bounded=False, name="a / wall")
POST = rcp.Polytope.from_vertices([(4, -2)], name="post", allow_flat=True)
TURNS = scipy.spatial.transform.Rotation.from_rotvec(np.outer(TIME, [0.4, -1.0, 2.0])).as_matrix()
PLACES = np.stack([TIME, TIME**2, -TIME], axis=-1)
BOX = rcp.Polytope.box(0.6, 0.6, 0.2)


def car(**options) -> rcp.scenes.BodyPath:
    body = rcp.scenes.BodyPath.planar(CAR, TIME, TIME**2, 3 * TIME, name="/car")
    return rcp.scenes.BodyPath(CAR, body.rotation, body.translation, body.name, **options)


def page(path: Path, body: rcp.scenes.BodyPath, obstacles=(), **options) -> list[dict]:
    """The commands of a page."""
    written = rcp.scenes.animate_scene(TIME, [body], obstacles, path / "plan.html", **options)
    assert written == path / "plan.html"
    commands = re.search(r"for \(const command of (\[.*?\])\)", written.read_text(encoding="utf-8"), re.DOTALL)
    assert commands is not None
    return [umsgpack.unpackb(b64decode(command)) for command in json.loads(commands[1])]


def meshes(commands: list[dict], folder: str) -> list[str]:
    objects = [command for command in commands if command["type"] == "set_object"]
    found = [each["path"] for each in objects if each["object"]["object"]["type"] == "Mesh"]
    return [path for path in found if path.startswith(f"/meshcat/scene/{folder}/")]


def keys(commands: list[dict], folder: str) -> dict[str, np.ndarray]:
    """Values of the only animation in a folder, which is checked to have the times of the plan."""
    (command,) = (command for command in commands if command["type"] == "set_animation")
    (clip,) = (each["clip"] for each in command["animations"] if each["path"].startswith(f"/meshcat/scene/{folder}/"))
    for track in clip["tracks"]:
        assert [key["time"] / clip["fps"] for key in track["keys"]] == pytest.approx(TIME - TIME[0])
    return {track["name"]: np.array([key["value"] for key in track["keys"]]) for track in clip["tracks"]}


@needs_meshcat
def test_a_page_needs_nothing_but_a_browser(tmp_path: Path) -> None:
    page(tmp_path, car(), [WALL], title="to <b> & back")
    text = (tmp_path / "plan.html").read_text(encoding="utf-8")
    assert "<title>to &lt;b&gt; &amp; back</title>" in text
    assert len(text) > 100_000  # the viewer itself
    assert not re.search(r"<(script|link|img|iframe)[^>]*\s(src|href)=", text)
    # Names of XML dialects are no addresses that a browser opens.
    assert set(re.findall(r"https?://[\w.]+", text)) <= {"http://www.w3.org"}
    assert list(tmp_path.iterdir()) == [tmp_path / "plan.html"]


@needs_meshcat
def test_there_is_one_object_for_each_part_obstacle_and_force(tmp_path: Path) -> None:
    outside = rcp.Polytope.from_halfspaces([[0, -1]], [-300], bounded=False)
    forces = np.ones((21, 2))
    commands = page(tmp_path, car(force=forces, contact=forces), [WALL, POST, outside])
    assert meshes(commands, "bodies") == [f"/meshcat/scene/bodies/0  car/{part}" for part in ("0 box", "1 capsule")]
    assert len(meshes(commands, "obstacles")) == 2
    assert len(meshes(commands, "forces")) == 1
    flat = rcp.Polytope.from_vertices([(0, 0, 0), (1, 0, 0)], allow_flat=True)
    body = rcp.scenes.BodyPath([BOX, flat], TURNS, PLACES)
    floor = rcp.Polytope.from_halfspaces([[0, 0, 1]], [-4], bounded=False)
    commands = page(tmp_path, body, [floor, rcp.Polytope.ball(1, (0, 0, 0))])
    assert (len(meshes(commands, "bodies")), len(meshes(commands, "obstacles"))) == (2, 2)


@needs_meshcat
def test_key_frames_put_a_body_where_its_path_says(tmp_path: Path) -> None:
    found = keys(page(tmp_path, rcp.scenes.BodyPath(BOX, TURNS, PLACES)), "bodies")
    assert found[".position"] == pytest.approx(PLACES)
    turned = scipy.spatial.transform.Rotation.from_quat(found[".quaternion"]).as_matrix()
    assert turned == pytest.approx(TURNS)
    found = keys(page(tmp_path, car()), "bodies")
    assert found[".position"] == pytest.approx(np.column_stack([TIME, TIME**2, 0 * TIME]))
    turned = scipy.spatial.transform.Rotation.from_quat(found[".quaternion"]).as_matrix()
    assert turned[:, :2, :2] == pytest.approx(car().rotation)


@needs_meshcat
@pytest.mark.parametrize("dimension", [2, 3])
def test_forces_point_from_outside_to_where_they_act(dimension: int, tmp_path: Path) -> None:
    angle = np.linspace(0, np.pi, 21)
    force = np.stack([np.cos(angle), np.sin(angle), np.sin(3 * angle)], axis=-1)[:, :dimension]
    force[3], force[-1, 1:] = 0, 0  # none, and one turned around exactly
    contact = PLACES[:, :dimension] + 1
    if dimension == 2:
        body = car(force=force, contact=contact)
    else:
        body = rcp.scenes.BodyPath(BOX, TURNS, PLACES, force=force, contact=contact)
    found = keys(page(tmp_path, body), "forces")
    assert found[".position"][:, :dimension] == pytest.approx(contact)
    along = scipy.spatial.transform.Rotation.from_quat(found[".quaternion"]).apply([1.0, 0.0, 0.0])
    drawn = (along * found[".scale"])[:, :dimension]
    assert drawn / drawn[0, 0] == pytest.approx(force, abs=1e-5)
    with pytest.raises(GeometryError, match=r"'/car': force of shape \(2,\)"):
        car(force=np.ones(2))


@needs_meshcat
def test_a_page_plays_in_a_notebook_and_stays_a_page(tmp_path: Path) -> None:
    written = rcp.scenes.animate_scene(TIME, [car()], [], tmp_path / "plan.html", seconds=1)
    text = written.read_text(encoding="utf-8")
    assert "timeScale = 2.0;" in text
    assert written._repr_html_().startswith('<iframe srcdoc="&lt;!DOCTYPE html')
    assert written.save(tmp_path / "kept.html").read_text(encoding="utf-8") == text
    with pytest.raises(GeometryError, match="cannot become.*Write the animation again"):
        written.save(tmp_path / "kept.gif")


@needs_meshcat
def test_a_page_without_a_body_is_refused(tmp_path: Path) -> None:
    with pytest.raises(GeometryError, match="a scene without a body"):
        rcp.scenes.animate_scene(TIME, [], [WALL], tmp_path / "plan.html")
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(meshcat_available, reason="meshcat is installed")
def test_without_meshcat_the_extra_is_named(tmp_path: Path) -> None:
    with pytest.raises(ImportError, match=r"pyrobocop_pyomo\[view\]"):
        rcp.scenes.animate_scene(TIME, [car()], [], tmp_path / "plan.html")
    assert not list(tmp_path.iterdir())
