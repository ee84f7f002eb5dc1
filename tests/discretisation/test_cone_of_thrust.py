"""Where a row is no convex function of the controls, the least integrand is not above that of an optimal answer."""

from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import NDArray

from pyrobocop_pyomo.discretisation.lagrangian import least_integrand_within_rows

Array = NDArray[np.float64]


class Cone:
    """A thrust that costs its size, of which the part along the costate is worth something.

    ``size - worth * along`` with ``along ** 2 <= size ** 2`` and a size from one to three: for a worth below one the
    least size is best, for a worth above one the largest.
    """

    def __init__(self, worth: float) -> None:
        self.worth = worth

    def integrand(self, given: Mapping[str, Array], *, apart: bool = False) -> Array:
        multiplier = 0.5 * self.worth / self.best
        row = 0.0 if apart else multiplier * (given["along"] ** 2 - given["size"] ** 2)
        return given["size"] - self.worth * given["along"] + row

    def own_rows(self, given: Mapping[str, Array]) -> list[tuple[Array, Array, Array]]:
        body = given["along"] ** 2 - given["size"] ** 2
        return [(body, np.full(body.shape, -np.inf), np.zeros(body.shape))]

    def limits(self, name: str) -> tuple[Array, Array]:
        none = np.full((1, 1), np.inf)
        return (np.full((1, 1), 1.0), np.full((1, 1), 3.0)) if name == "size" else (-none, none)

    @property
    def best(self) -> float:
        return 1.0 if self.worth < 1.0 else 3.0


@pytest.mark.parametrize("worth", [0.3, 0.5, 0.9, 1.2, 2.0])
def test_the_optimum_is_not_improved_and_not_made_worse(worth: float) -> None:
    cone = Cone(worth)
    here = {"size": np.full((1, 1), cone.best), "along": np.full((1, 1), cone.best)}
    assert least_integrand_within_rows(cone, here) == pytest.approx(cone.integrand(here), abs=1e-6)


class HalfPlane:
    """Two controls, each best at one; a row limits the first alone, and the answer is a hair beyond it."""

    def integrand(self, given: Mapping[str, Array], *, apart: bool = False) -> Array:
        return (given["limited"] - 1.0) ** 2 + (given["other"] - 1.0) ** 2

    def own_rows(self, given: Mapping[str, Array]) -> list[tuple[Array, Array, Array]]:
        body = given["limited"]
        return [(body, np.full(body.shape, -np.inf), np.full(body.shape, 1.0 - 1e-9))]

    def limits(self, name: str) -> tuple[Array, Array]:
        return np.full((1, 1), -3.0), np.full((1, 1), 3.0)


def test_a_row_that_is_missed_by_a_hair_moves_no_control_that_it_does_not_read() -> None:
    plane, here = HalfPlane(), {"limited": np.ones((1, 1)), "other": np.ones((1, 1))}
    with np.errstate(all="ignore"):  # as its caller does
        assert least_integrand_within_rows(plane, here) == pytest.approx(0.0, abs=1e-6)
