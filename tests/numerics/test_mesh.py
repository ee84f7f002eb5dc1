"""Meshes and grids: nothing is rounded, nothing is doubled."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.numerics import Grid, Mesh, gauss_legendre, radau


def test_uniform_boundaries_are_the_nearest_floats() -> None:
    assert Mesh.uniform(0, 10, 100).boundaries[3] == 0.3


@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=20, unique=True))
def test_given_boundaries_are_kept_bit_by_bit(values: list[float]) -> None:
    boundaries = tuple(sorted(values))
    assert Mesh.given(boundaries).boundaries == boundaries


@given(elements=st.integers(1, 30), stages=st.integers(1, 6), use_radau=st.booleans())
def test_a_grid_has_its_counts_and_its_weights_sum_to_the_duration(elements: int, stages: int, use_radau: bool) -> None:
    grid = Grid((radau if use_radau else gauss_legendre)(stages), Mesh.uniform(1.0, 4.0, elements))
    assert len(grid.points) == elements * stages
    assert len(grid.times) == elements * stages + (1 if use_radau else elements + 1)
    assert list(grid.times) == sorted(set(grid.times))
    assert set(grid.mesh.boundaries) <= set(grid.times)
    assert sum(grid.quadrature_weights.values()) == pytest.approx(3.0)
    assert [grid.element_of[t] for t in grid.points] == list(np.repeat(np.arange(elements), stages))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Mesh.uniform(0, 1, 0), "elements = 0; expected an integer of at least 1"),
        (lambda: Mesh.uniform(0, 1, 2.5), r"elements = 2\.5"),
        (lambda: Mesh.given([0.0]), "a mesh of 0 elements"),
        (lambda: Mesh.given([0, 2, 1]), "must increase, but boundary 1 is 2 and boundary 2 is 1"),
        (lambda: Mesh.given([0, float("nan")]), "boundary 1 is nan"),
    ],
)
def test_what_is_no_mesh_is_refused(make, message: str) -> None:
    with pytest.raises(ModelError, match=message):
        make()
