"""Further boundaries of a mesh: delays lead from boundary to boundary."""

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from pyrobocop_pyomo.numerics import Mesh
from pyrobocop_pyomo.numerics.mesh import mesh_of_delays


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
