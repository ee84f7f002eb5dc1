"""Scenes: which times and what of the surroundings is drawn, in the plane, in space and in motion."""

import os
import pickle
import subprocess
import sys
from base64 import b64decode
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ObstacleError

pytest.importorskip("matplotlib")

TIME = np.linspace(0, 4, 41)
CAR = rcp.Polytope.from_vertices([(-1, -1), (3.7, -1), (3.7, 1), (-1, 1)], name="car")
WALL = rcp.Polytope.from_halfspaces([[0, -1]], [-3], bounded=False, name="wall")
POST = rcp.Polytope.ball(0.3, (4, -2))


def car(**named: str) -> rcp.scenes.BodyPath:
    return rcp.scenes.BodyPath.planar(CAR, TIME, 0 * TIME, 0.2 * TIME, **named)


def quadrotor() -> rcp.scenes.BodyPath:
    box = rcp.Polytope.box(0.6, 0.6, 0.2)
    return rcp.scenes.BodyPath(box, np.tile(np.eye(3), (41, 1, 1)), np.stack([TIME - 2, 0 * TIME, 0 * TIME], axis=-1))


def test_snapshots_are_where_the_body_is_at_these_times() -> None:
    axis = rcp.scenes.draw_scene(TIME, [car()], [WALL, POST], snapshots=5).axes[0]
    outlines = [patch.get_xy()[:-1] for patch in axis.patches[2:]]
    assert len(outlines) == 5
    for corners, i in ((outlines[0], 0), (outlines[-1], -1)):
        c, s = np.cos(0.2 * TIME[i]), np.sin(0.2 * TIME[i])
        expected = CAR.vertices @ np.array([[c, -s], [s, c]]).T + [TIME[i], 0]
        assert {tuple(row) for row in np.round(corners, 9)} == {tuple(row) for row in np.round(expected, 9)}


def test_bodies_at_one_time_share_a_colour_and_later_is_darker() -> None:
    away = rcp.scenes.BodyPath.planar(CAR, TIME, 5 + 0 * TIME, 0 * TIME, name="other")
    axis = rcp.scenes.draw_scene(TIME, [car(name="car"), away], snapshots=4).axes[0]
    first, second = axis.patches[:4], axis.patches[4:]
    assert [patch.get_edgecolor() for patch in first] == [patch.get_edgecolor() for patch in second]
    brightness = [sum(patch.get_edgecolor()[:3]) for patch in first]
    assert brightness == sorted(brightness, reverse=True)
    assert {text.get_text().strip() for text in axis.texts} == {"car", "other"}


def test_all_motion_is_in_the_picture_and_endless_walls_do_not_shrink_it() -> None:
    figure = rcp.scenes.draw_scene(TIME, [car()], [WALL, rcp.Polytope.box(1e4, 1, center=(0, -3))])
    figure.draw_without_rendering()  # fits the limits to the shape of the axes
    axis = figure.axes[0]
    places = car().places().reshape(-1, 2)
    for (low, high), values in ((axis.get_xlim(), places[:, 0]), (axis.get_ylim(), places[:, 1])):
        assert low < values.min()
        assert values.max() < high
        assert high - low < 3 * np.ptp(places, axis=0).max()
    assert axis.get_ylim()[1] > 3  # the wall is seen


def test_a_given_view_is_kept() -> None:
    axis = rcp.scenes.draw_scene(TIME, [car()], [WALL], view=[(-3, -2), (9, 6)]).axes[0]
    assert (*axis.get_xlim(), *axis.get_ylim()) == (-3, 9, -2, 6)


def test_a_scene_in_space_has_all_faces_and_equal_scales() -> None:
    figure = rcp.scenes.draw_scene(TIME, [quadrotor()], [rcp.Polytope.box(0.1, 2, 1)], snapshots=3, title="flight")
    axis = figure.axes[0]
    assert len(axis.collections) == 6 * (3 + 1)
    figure.canvas.draw()
    # A metre is as long in each direction: a turned box must not look like a sheared one.
    lengths = np.array([high - low for low, high in (axis.get_xlim(), axis.get_ylim(), axis.get_zlim())])
    assert np.ptp(lengths / axis._box_aspect) == pytest.approx(0, abs=1e-9 * lengths.max())
    assert axis.get_title() == "flight"


@pytest.mark.heavy
@pytest.mark.parametrize("body", [car(), quadrotor()], ids=["plane", "space"])
def test_an_animation_has_its_frames_and_shows_motion(body: rcp.scenes.BodyPath, tmp_path: Path) -> None:
    pil = pytest.importorskip("PIL.Image")
    written = rcp.scenes.animate_scene(TIME, [body], [], tmp_path / "a.png", frames=4, seconds=1)
    assert written == tmp_path / "a.gif"
    with pil.open(written) as picture:
        frames = []
        for i in range(picture.n_frames):
            picture.seek(i)
            frames.append((np.asarray(picture.convert("RGB"), dtype=int), picture.info["duration"]))
    assert len(frames) == 4
    assert all(np.abs(a - b).sum() > 0 for (a, _), (b, _) in pairwise(frames))
    assert frames[0][1] == 250
    assert frames[-1][1] == 250 + 1000  # the end stays for a second


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([],), "a scene without a body"),
        (([car(), quadrotor()],), "has dimension 3"),
        (([car()], [rcp.Polytope.box(1, 1, 1, name="cube")]), "'cube' has dimension 3"),
        (
            ([rcp.scenes.BodyPath.planar(CAR, [0, 1], [0, 0], [0, 0], name="short")],),
            "'short' has 2 poses at 41 times",
        ),
    ],
)
def test_what_does_not_fit_together_is_refused(arguments: tuple, message: str, tmp_path: Path) -> None:
    with pytest.raises(ObstacleError, match=message):
        rcp.scenes.draw_scene(TIME, *arguments)
    with pytest.raises(ObstacleError, match=message):
        rcp.scenes.animate_scene(TIME, *arguments, *([()] if len(arguments) == 1 else []), tmp_path / "a.gif")
    assert not list(tmp_path.iterdir())


def test_poses_of_the_wrong_shape_and_empty_animations_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ObstacleError, match=r"body 'car': .* rotations of shape \(41, 3, 3\)"):
        rcp.scenes.BodyPath(CAR, np.tile(np.eye(3), (41, 1, 1)), np.zeros((41, 2)), "car")
    with pytest.raises(ObstacleError, match="an animation of 1 frames in 2 s"):
        rcp.scenes.animate_scene(TIME, [car()], [], tmp_path / "a.gif", frames=1, seconds=2)


def test_an_animation_plays_where_a_notebook_shows_it(tmp_path: Path) -> None:
    film = rcp.scenes.animate_scene(TIME, [car()], [], tmp_path / "a.gif", frames=2, seconds=1)
    start, _, rest = film._repr_html_().partition("base64,")
    assert "image/gif" in start
    assert b64decode(rest.partition('"')[0]) == film.read_bytes()
    assert Path(film) == tmp_path / "a.gif"
    assert pickle.loads(pickle.dumps(film)) == film
    film.unlink()
    assert film._repr_html_() is None


def test_without_a_name_an_animation_is_there_as_long_as_its_object(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    film = rcp.scenes.animate_scene(TIME, [car()], [], frames=2, seconds=1)
    content = film.read_bytes()
    assert len(content) > 1000
    kept = film.save(tmp_path / "kept.png")
    assert kept == tmp_path / "kept.gif"
    assert kept.save(kept) == kept
    del film
    assert list(tmp_path.iterdir()) == [kept]
    assert kept.read_bytes() == content
    kept.unlink()
    with pytest.raises(FileNotFoundError):
        kept.save(tmp_path / "again.gif")


def test_a_temporary_animation_is_removed_when_python_ends(tmp_path: Path) -> None:
    code = "from pyrobocop_pyomo.plotting import scenes; f = scenes.animation_file(None); f.write_bytes(b'.'); print(f)"
    environment = {**os.environ, "TMPDIR": str(tmp_path), "TEMP": str(tmp_path), "TMP": str(tmp_path)}
    command = [sys.executable, "-c", code]
    ended = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert str(tmp_path) in ended.stdout
    assert not list(tmp_path.iterdir())


def test_a_film_needs_ffmpeg_and_says_so_before_drawing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("matplotlib.animation.FFMpegWriter.isAvailable", lambda: False)
    with pytest.raises(ObstacleError, match=r"ffmpeg.*\.gif"):
        rcp.scenes.animate_scene(TIME, [car()], [], tmp_path / "a.mp4")
    assert not list(tmp_path.iterdir())
    gif = rcp.scenes.animate_scene(TIME, [car()], [], tmp_path / "a.gif", frames=2, seconds=1)
    assert gif.save(tmp_path / "b.mp4") == tmp_path / "b.gif"


def test_figures_show_themselves_without_pyplot_and_survive_a_pickle() -> None:
    figure = rcp.scenes.draw_scene(TIME, [car()], [])
    for one in (figure, pickle.loads(pickle.dumps(figure))):
        assert one._repr_png_().startswith(b"\x89PNG")
