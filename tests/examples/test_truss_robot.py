"""The truss robot rolls over on a tube of one length, and motors can follow its shapes."""

import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest
import truss_robot as truss

import pyrobocop_pyomo as rcp

Figure = pytest.importorskip("matplotlib.figure").Figure


def lengths_of(nodes: np.ndarray) -> np.ndarray:
    return np.stack(
        [
            np.linalg.norm(nodes[:, truss.NODES.index(i)] - nodes[:, truss.NODES.index(j)], axis=1)
            for i, j in truss.EDGES
        ],
        axis=1,
    )


def test_nodes_that_roll_have_the_lengths_that_they_were_given_and_do_not_slip():
    # An equilateral triangle that turns over its front foot, with edges that differ a little from the planned ones.
    foot = np.array([truss.SIDE, 0.0])
    corners = np.array([[0.0, 0.0], foot, [truss.SIDE / 2, truss.HEIGHT]]) - foot
    angles = np.linspace(0.0, -2 * np.pi / 3, 13)
    turns = np.array([[[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]] for a in angles])
    planned = corners @ turns + foot
    presses = np.tile([0.0, 47.0, 1.0], (13, 1))
    lengths = lengths_of(planned) + np.random.default_rng(1).uniform(-0.03, 0.03, (13, 3))
    nodes = truss.rolled(lengths, planned, presses)
    assert lengths_of(nodes) == pytest.approx(lengths, abs=1e-12)
    assert nodes[:, 1] == pytest.approx(np.tile(foot, (13, 1)), abs=1e-12)
    exact = truss.rolled(lengths_of(planned), planned, presses)
    assert exact == pytest.approx(planned, abs=1e-9)


@pytest.mark.ipopt
@pytest.mark.slow
def test_the_truss_walks_and_motors_follow(tmp_path):
    m, result = truss.search(steps=30, backend=None, tee=False)
    assert result.quality is rcp.Quality.OPTIMAL
    plan = m.truss.trajectory()
    assert plan.verify().largest_violation < 1e-5
    nodes, lengths, _, presses = truss.plan_of(m)
    assert lengths.sum(axis=1) == pytest.approx(truss.TUBE, abs=1e-6)
    assert lengths_of(nodes) == pytest.approx(lengths, abs=1e-6)
    assert nodes[-1, :, 0].mean() - nodes[0, :, 0].mean() == pytest.approx(1.0, abs=1e-6)
    assert nodes[..., 1].min() > -1e-6
    # It rolls over: other nodes carry it in the end.
    assert {k for k in range(3) if presses[0, k] > 1.0} == {0, 1}
    assert {k for k in range(3) if presses[-1, k] > 1.0} != {0, 1}
    tracking = truss.track(m)
    assert tracking.error < 0.05
    assert tracking.reached.sum(axis=1) == pytest.approx(truss.TUBE, abs=1e-9)
    assert all(np.abs(after - before).max() <= 2 * 0.04 + 1e-9 for before, after in pairwise(tracking.reached))
    assert tracking.progress > 0.8
    figure = Figure(layout="constrained")
    truss.draw(figure, m)
    figure.savefig(tmp_path / "truss.png")
    assert (tmp_path / "truss.png").stat().st_size > 10_000
    assert truss.animate(m, tmp_path / "truss.gif").stat().st_size > 10_000


@pytest.mark.casadi
def test_nodes_walk_as_a_team():
    """What the team agrees on holds by the equations of motion and Coulomb's law, recomputed."""
    m, result = truss.search(together=True, steps=30, backend=None, tee=False)
    score = result.score
    assert result.success
    assert score.strict
    assert score.distance < 1e-6
    _, lengths, _, presses = truss.plan_of(m)
    assert lengths.sum(axis=1) == pytest.approx(truss.TUBE, abs=1e-4)
    assert {k for k in range(3) if presses[0, k] > 1.0} == {0, 1}
    spoilt = {name: values.copy() for name, values in m.plans.items()}
    spoilt["ground['a'].press"][3] += 5.0
    found = truss.WalkPhysics(truss.Walk(30))({"robot": spoilt})
    assert (found.practical, found.force) == (False, pytest.approx(5.0, abs=0.1))


def test_the_script_reads_its_command_line():
    asked = [sys.executable, "-W", "error", truss.__file__, "--help"]
    ended = subprocess.run(asked, capture_output=True, text=True, timeout=900)
    assert ended.returncode == 0, ended.stderr
    assert "--coarse" in ended.stdout
