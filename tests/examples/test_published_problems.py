"""Examples of published problems, held to what is known about them without the publication."""

from pathlib import Path

import belt_drive
import linear_complementarity_control
import numpy as np
import pytest
import quadrotor
from mpcc_catalogue.branches import enumerate_branches

import pyrobocop_pyomo as rcp

EXAMPLES = Path(__file__).parents[2] / "examples"
GALLERY = Path(__file__).parents[2] / "docs" / "examples" / "gallery.md"


@pytest.mark.casadi
@pytest.mark.parametrize("case", ["1", "2", "4", "6"])
def test_on_few_elements_the_best_of_all_branches_is_found(case: str) -> None:
    build = linear_complementarity_control.build
    result = rcp.solve(build(case, elements=3))
    assert result.solved
    assert result.objective == pytest.approx(enumerate_branches(build(case, elements=3), starts=1)[0], rel=1e-6)


@pytest.mark.slow
@pytest.mark.casadi
def test_the_chained_belt_goes_on_where_it_is() -> None:
    m = belt_drive.build("chain", elements=(8, 6))
    result = rcp.solve(m, strategies=rcp.Strategy(exploration=0))
    assert result.solved
    assert m.go_on.violation < 1e-8
    for axis in "xyz":
        before, after = m.first.trajectory(), m.second.trajectory()
        assert getattr(after, f"upper_{axis}")[0] == pytest.approx(getattr(before, f"upper_{axis}")[-1], abs=1e-8)
        assert getattr(after, f"angle_{axis}")[0] == pytest.approx(0, abs=1e-8)


@pytest.mark.parametrize("scenario", [1, 2, 3, 4])
def test_the_belt_is_taut_at_both_targets(scenario: int) -> None:
    one = belt_drive.SCENARIOS[scenario]
    lifted = belt_drive.STIFFNESS * (np.linalg.norm(np.subtract(one.lifted, belt_drive.LOWEST)) - one.length)
    assert lifted == pytest.approx(3.2113, abs=1e-4)  # the published pull that the cost compares with
    assert one.tension > 0


def test_the_drawn_quadrotor_turns_as_its_equations_say() -> None:
    rng = np.random.default_rng(0)
    for yaw, pitch, roll in rng.uniform(-1, 1, (20, 3)):
        rotation = quadrotor.turned(yaw, pitch, roll)
        assert rotation @ rotation.T == pytest.approx(np.eye(3))
        # Thrust acts along minus z of the body: the third column, as the equations of motion write it.
        (cy, sy), (cp, sp), (cr, sr) = ((np.cos(a), np.sin(a)) for a in (yaw, pitch, roll))
        assert rotation[:, 2] == pytest.approx([sr * sy + cr * cy * sp, -(cy * sr - cr * sy * sp), cr * cp])


def test_the_gallery_has_every_example_with_a_small_picture() -> None:
    page = GALLERY.read_text(encoding="utf-8")
    for path in EXAMPLES.glob("*.py"):
        if path.stem in ("run_example", "gaussian_process", "mechanism_pictures", "cart_pole_closed_loop"):
            continue
        assert f"python examples/{path.stem}.py" in page
        assert f":link: example-{path.stem}\n" in page
        picture = GALLERY.parents[1] / "images" / "examples" / f"{path.stem}.png"
        assert 5_000 < picture.stat().st_size <= 80_000
