"""A model learned from data has its formula, and the derivatives of that."""

import numpy as np
import pytest
from gaussian_process import GaussianProcessMean
from hypothesis import given, settings
from hypothesis import strategies as st


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


@given(st.integers(0, 1000), st.floats(-50, 50))
@settings(max_examples=20)
def test_neither_the_order_of_centres_nor_the_origin_matters(seed: int, shift: float) -> None:
    mean, parts = some_mean(seed)
    order = np.random.default_rng(seed).permutation(12)
    moved = GaussianProcessMean(
        **{**parts, "centres": parts["centres"][order] + shift, "weights": parts["weights"][order]}
    )
    points = np.random.default_rng(seed + 1).normal(size=(4, 3))
    for name in ("value", "jacobian", "hessian"):
        np.testing.assert_allclose(getattr(moved, name)(points + shift), getattr(mean, name)(points), atol=1e-9)


def test_data_without_noise_is_reproduced_and_noise_is_found() -> None:
    random = np.random.default_rng(0)
    x = random.uniform(-2, 2, (80, 2))
    y = np.sin(2 * x[:, 0]) + 0.3 * x[:, 1]
    exact = GaussianProcessMean.fit(x, y, length_scales=[0.8, 1.5], signal=1.0, noise=1e-5)
    np.testing.assert_allclose(exact.value(x), y, atol=1e-5)
    noisy = GaussianProcessMean.fit(x, y + random.normal(0, 0.1, 80))
    assert noisy.noise == pytest.approx(0.1, rel=0.35)
    new = random.uniform(-1.5, 1.5, (50, 2))
    assert np.abs(noisy.value(new) - np.sin(2 * new[:, 0]) - 0.3 * new[:, 1]).mean() < 0.08
