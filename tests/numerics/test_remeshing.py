"""Better meshes from errors of elements."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pyrobocop_pyomo.numerics import Mesh, remesh

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
