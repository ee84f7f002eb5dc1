"""Laws of meshes that resolve functions of time: what they see, and that units and phase shifts do not matter."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from pyrobocop_pyomo.numerics import Mesh, find_scheme
from pyrobocop_pyomo.numerics.resolved_functions import TOLERANCE, FunctionsOfTime, Resolution, mesh_of_delays

RADAU, EULER = find_scheme("radau", 3), find_scheme("implicit_euler")


def resolved(
    function: Callable, elements: int = 10, most: int = 1000, end: float = 1.0, scheme=RADAU, start: float = 0.0
) -> Resolution:
    functions = FunctionsOfTime(lambda t: np.asarray(function(t))[None, None], start, end, 4000)
    return functions.resolving(Mesh.uniform(start, end, elements), scheme, most)


def distance(function: Callable, mesh: Mesh, scheme=RADAU) -> float:
    """Of the polynomials through the stages, by other code and at other places."""
    total = departure = 0.0
    mean = np.mean(function(np.linspace(mesh.boundaries[0], mesh.boundaries[-1], 100_001)))
    for start, width in zip(mesh.boundaries, mesh.widths, strict=False):
        at = start + width * (np.arange(200) + 0.5) / 200
        through = np.polyfit(scheme.c - 0.5, function(start + width * scheme.c), scheme.stages - 1)
        total += width * np.abs(np.polyval(through, (at - start) / width - 0.5) - function(at)).mean()
        departure += width * np.abs(function(at) - mean).mean()
    return total / departure


@given(periods=st.floats(3, 60), shift=st.floats(0, 7), elements=st.integers(4, 60))
@settings(max_examples=30, deadline=None)
def test_a_period_is_found_whatever_its_phase(periods: float, shift: float, elements: int) -> None:
    def wave(t):
        return 3.0 + np.sin(2 * np.pi * periods * t + shift)

    found = resolved(wave, elements)
    assert found.missed <= TOLERANCE
    assert distance(wave, found.mesh) < 1.3 * TOLERANCE
    assert found.mesh.elements <= max(elements, 10 * periods + 10)  # and not many more than it takes
    assert not found.jumps


@pytest.mark.parametrize("elements", [5, 10, 30])
@pytest.mark.parametrize("multiple", [1, 2, 7])
def test_a_period_of_which_each_element_has_the_same_part_is_found(elements: int, multiple: int) -> None:
    """Every point of a kind sees the same value there."""
    found = resolved(lambda t: np.sin(2 * np.pi * multiple * elements * t), elements)
    assert found.mesh.elements >= 2.5 * multiple * elements
    assert found.missed <= TOLERANCE


@given(factor=st.floats(1e-4, 1e6), size=st.floats(1e-3, 1e5))
@settings(max_examples=25, deadline=None)
def test_units_of_time_and_of_values_do_not_matter(factor: float, size: float) -> None:
    def function(t):
        return np.exp(-(((t - 0.37) / 0.02) ** 2)) + 0.2 * np.cos(20 * t)

    one, other = resolved(function), resolved(lambda t: size * function(t / factor), end=factor)
    assert other.mesh.elements == one.mesh.elements
    assert np.allclose(np.array(other.mesh.boundaries) / factor, one.mesh.boundaries, atol=1e-9)


@given(coefficients=st.lists(st.floats(-3, 3), min_size=3, max_size=3), elements=st.integers(1, 20))
@settings(max_examples=25, deadline=None)
def test_what_the_polynomials_reproduce_keeps_the_mesh(coefficients: list[float], elements: int) -> None:
    found = resolved(np.polynomial.Polynomial(coefficients), elements)
    assert found.mesh == Mesh.uniform(0.0, 1.0, elements)


@given(place=st.floats(0.03, 0.97), width=st.floats(2e-3, 2e-2), elements=st.integers(3, 20))
@settings(max_examples=25, deadline=None)
def test_a_pulse_between_the_points_gets_small_elements_and_the_rest_stays(
    place: float, width: float, elements: int
) -> None:
    def pulse(t):
        return np.exp(-(((t - place) / width) ** 2))

    found = resolved(pulse, elements)
    assert found.missed <= TOLERANCE
    assert distance(pulse, found.mesh) < 2 * TOLERANCE
    assert found.mesh.elements <= elements + 40


@given(places=st.lists(st.floats(0.02, 0.98), min_size=1, max_size=5, unique=True), elements=st.integers(2, 12))
@settings(max_examples=30, deadline=None)
def test_boundaries_stand_at_jumps_so_that_each_element_sees_one_side(places: list[float], elements: int) -> None:
    places = sorted(places)
    assume(np.diff([0.0, *places, 1.0]).min() > 0.01)
    # A jump beside a boundary gets none of its own.
    assume(np.abs(np.subtract.outer(places, np.linspace(0.0, 1.0, elements + 1))).min() > 2e-3)

    def steps(t):
        return np.searchsorted(places, t, side="right") % 2 + 0.1 * t

    found = resolved(steps, elements)
    assert len(found.jumps) == len(places)
    assert np.abs(np.array(found.jumps) - places).max() < 1e-10
    # The last stage of an element is its end: it has to see what was before.
    for start, end in zip(found.mesh.boundaries, found.mesh.boundaries[1:], strict=False):
        stages = start + (end - start) * RADAU.c
        assert np.ptp(steps(stages) - 0.1 * stages) < 1e-9


def test_a_scheme_with_one_point_does_not_see_a_constant_in_what_rises() -> None:
    found = resolved(lambda t: np.sin(40 * np.pi * t), elements=20, scheme=EULER)
    assert found.mesh.elements > 60
    assert resolved(lambda t: 2 * t, elements=3, scheme=EULER).mesh.elements == 3


def test_there_are_never_more_elements_than_allowed() -> None:
    found = resolved(lambda t: np.sin(300 * t), elements=7, most=23)
    assert found.mesh.elements == 23
    assert found.missed > TOLERANCE


def test_a_ripple_on_a_large_value_does_not_count() -> None:
    assert resolved(lambda t: 1000 + 0.1 * np.sin(300 * t)).mesh.elements == 10


# -------------------------------------------------------------------- delays


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
