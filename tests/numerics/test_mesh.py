"""Meshes and grids: nothing is rounded or doubled; delays lead from boundary to boundary, errors to finer meshes."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.numerics import Grid, Mesh, gauss_legendre, radau, remesh
from pyrobocop_pyomo.numerics.mesh import mesh_of_delays


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
        (lambda: Mesh.given([0, 2, 1]), "must increase, but 2 at 1 is followed by 1"),
        (lambda: Mesh.given([0, float("nan")]), "nan at .1. is not finite"),
    ],
)
def test_what_is_no_mesh_is_refused(make, message: str) -> None:
    with pytest.raises(ModelError, match=message):
        make()


# --------------------------------------------------------------------
# Further boundaries of a mesh: delays lead from boundary to boundary.


@given(
    parts=st.integers(1, 12),
    windows=st.integers(1, 6),
    rest=st.sampled_from([0.0, 0.25, 0.6]),
    elements=st.integers(2, 40),
)
@settings(max_examples=40, deadline=None)
def test_a_mesh_of_delays_is_moved_onto_itself(parts: int, windows: int, rest: float, elements: int) -> None:
    delay = 0.1 * parts
    end = delay * (windows + rest)
    assume(end > delay)
    mesh = mesh_of_delays(Mesh.uniform(0.0, end, elements), [delay], 1000)
    boundaries = np.array(mesh.boundaries)
    for earlier in boundaries[boundaries > delay + 1e-9] - delay:
        assert np.abs(boundaries - earlier).min() < 1e-9 * end
    assert mesh.widths.max() <= end / elements * (1 + 1e-9)


def test_several_delays_have_a_common_part_or_none() -> None:
    mesh = mesh_of_delays(Mesh.uniform(0.0, 3.0, 10), [0.4, 0.6], 1000)
    assert np.abs(np.subtract.outer(np.array(mesh.boundaries), [0.4, 0.6])).min(axis=0).max() < 1e-9
    given_mesh = Mesh.uniform(0.0, 3.0, 10)
    assert mesh_of_delays(given_mesh, [0.4, 0.4 * 2**0.5], 80) is given_mesh
    assert mesh_of_delays(given_mesh, [1e-4], 80) is given_mesh
    uneven = Mesh((0.0, 0.2, 3.0))
    assert mesh_of_delays(uneven, [0.7], 80) is uneven  # the user's own


# --------------------------------------------------------------------
# Better meshes from errors of elements.


meshes = st.lists(st.floats(0.01, 10), min_size=1, max_size=12).map(
    lambda widths: Mesh.given([0.0, *np.cumsum(widths).tolist()])
)


@given(mesh=meshes, data=st.data(), order=st.integers(1, 8))
def test_large_errors_are_split_and_all_boundaries_stay(mesh: Mesh, data: st.DataObject, order: int) -> None:
    errors = data.draw(st.lists(st.floats(0, 1e3) | st.just(np.inf), min_size=mesh.elements, max_size=mesh.elements))
    finer = remesh(mesh, errors, 1e-3, order)
    assert set(mesh.boundaries) <= set(finer.boundaries)
    boundaries = np.array(finer.boundaries)
    for start, end, error in zip(mesh.boundaries, mesh.boundaries[1:], errors, strict=False):
        parts = int(((boundaries > start) & (boundaries <= end)).sum())
        assert parts == 1 if error <= 1e-3 else 2 <= parts <= 4


@given(order=st.integers(1, 8), scale=st.floats(1e-3, 1e6))
def test_parts_follow_from_the_order(order: int, scale: float) -> None:
    """An error C h^(order + 1) of the parts is within the tolerance, unless the number of parts is limited."""
    parts = remesh(Mesh.uniform(0, 1, 1), [scale], 1.0, order, most_parts=50).elements
    assert parts == 50 or scale / parts ** (order + 1) <= 1.0
    if scale > 1:
        assert parts == 2 or scale / (parts - 1) ** (order + 1) > 0.5


def test_tiny_errors_are_joined_but_not_over_what_is_kept() -> None:
    mesh = Mesh.uniform(0, 4, 4)
    assert remesh(mesh, [1e-13] * 4, 1e-6, 5, keep={0.0, 4.0}).boundaries == (0, 2, 4)
    assert remesh(mesh, [1e-13] * 4, 1e-6, 5, keep={2.0}).boundaries == (0, 2, 4)
    assert remesh(mesh, [1e-13] * 4, 1e-6, 5, keep={1.0, 2.0, 3.0}) == mesh
    assert remesh(mesh, [1e-13] * 4, 1e-6, 5) == mesh
    # 2^6 times 1e-8 would be too near to the tolerance; a large neighbour forbids it as well.
    assert remesh(mesh, [1e-8] * 4, 1e-6, 5, keep=()) == mesh
    assert remesh(mesh, [1e-13, 1e-8, 1e-13, 1e-13], 1e-6, 5, keep=()).boundaries == (0, 1, 2, 4)


def test_where_there_is_no_error_a_tolerance_of_zero_asks_for_nothing() -> None:
    mesh = Mesh.uniform(0, 1, 3)
    with np.errstate(all="raise"):
        assert remesh(mesh, [0.0, 0.0, 0.0], 0.0, 2) == mesh
        assert remesh(mesh, [0.0, 1.0, np.inf], 0.0, 2).elements == 1 + 4 + 4


def test_a_mesh_within_the_tolerance_stays() -> None:
    mesh = Mesh.uniform(0, 1, 3)
    assert remesh(mesh, [1e-6, 9e-7, 2e-7], 1e-6, 5, keep=()) == mesh
    assert remesh(mesh, [1e-6, 9e-7, 1.1e-6], 1e-6, 5).elements == pytest.approx(4)
