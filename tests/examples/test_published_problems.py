"""Examples of published problems, held to what is known about them without the publication."""

from pathlib import Path

import belt_drive
import linear_complementarity_control
import numpy as np
import pytest
from gaussian_process import GaussianProcessMean
from hypothesis import given, settings
from hypothesis import strategies as st
from mpcc_catalogue.branches import enumerate_branches

import pyrobocop_pyomo as rcp

EXAMPLES = Path(__file__).parents[2] / "examples"
GALLERY = Path(__file__).parents[2] / "docs" / "examples" / "gallery.md"


@pytest.mark.casadi
@pytest.mark.parametrize("case", ["1", "6"])
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


def test_the_gallery_has_every_example_with_a_small_picture() -> None:
    page = GALLERY.read_text(encoding="utf-8")
    for path in EXAMPLES.glob("*.py"):
        if path.stem in ("run_example", "gaussian_process", "mechanism_pictures", "cart_pole_closed_loop"):
            continue
        assert f"python examples/{path.stem}.py" in page
        assert f":link: example-{path.stem}\n" in page
        picture = GALLERY.parents[1] / "images" / "examples" / f"{path.stem}.png"
        assert 5_000 < picture.stat().st_size <= 80_000


# --------------------------------------------------------------------
# A model learned from data has its formula, and the derivatives of that.


def some_mean(seed: int, centres: int = 12, inputs: int = 3) -> tuple[GaussianProcessMean, dict]:
    random = np.random.default_rng(seed)
    parts = {
        "centres": random.normal(size=(centres, inputs)),
        "weights": random.normal(size=centres),
        "length_scales": random.uniform(0.5, 2.0, inputs),
        "signal": 1.3,
        "offset": 0.4,
    }
    return GaussianProcessMean(**parts), parts


def formula(parts: dict, points: np.ndarray) -> np.ndarray:
    scaled = (points[:, None] - parts["centres"]) / parts["length_scales"]
    return parts["offset"] + parts["signal"] ** 2 * np.exp(-0.5 * (scaled**2).sum(axis=2)) @ parts["weights"]


@given(st.integers(0, 1000), st.integers(1, 4))
@settings(max_examples=20)
def test_the_mean_is_its_formula_and_its_derivatives_pass_the_check(seed: int, inputs: int) -> None:
    mean, parts = some_mean(seed, inputs=inputs)
    points = np.random.default_rng(seed + 1).normal(size=(5, inputs))
    np.testing.assert_allclose(mean.value(points), formula(parts, points), rtol=1e-10, atol=1e-12)
    mean.as_function().check_derivatives(points)
