"""Time and space: boundaries without equations, pyomo.dae for the other set, before or after."""

from math import pi, sin, sinh

import pyomo.environ as pyo
import pytest
from catalogue.pyomo_examples import exchanger, heat, heat_exact, laplace, steady_exchanger
from harness.dae import free_variables, solved
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.numerics.matching import maximum_matching

OURS = pyo.TransformationFactory("pyrobocop.collocation")


def discretise(m, *steps):
    """Apply transformations in order: (name of the set, scheme, elements)."""
    for name, scheme, elements in steps:
        domain = m.component(name)
        if scheme in ("BACKWARD", "FORWARD", "CENTRAL"):
            pyo.TransformationFactory("dae.finite_difference").apply_to(m, wrt=domain, nfe=elements, scheme=scheme)
        elif scheme == "dae":
            pyo.TransformationFactory("dae.collocation").apply_to(m, wrt=domain, nfe=elements, ncp=3)
        else:
            OURS.apply_to(m, wrt=domain, nfe=elements, ncp=3, scheme=scheme)
    return m


def largest_error(u, exact):
    return max(abs(data.value - exact(*index)) for index, data in u.items())


def values(variable):
    """In the order of the indices, which pyomo.dae rounds to six digits."""
    return [variable[index].value for index in sorted(variable)]


# -------------------------------------------------------------------- one set by pyomo.dae


@pytest.mark.casadi
@pytest.mark.parametrize("space", ["BACKWARD", "dae"])
def test_pyomo_dae_in_space_before_or_after(space):
    """In time our rows are those of dae.collocation, so that all values agree, at the corners as well."""
    elements = {"BACKWARD": 5, "dae": 2}[space]
    theirs = solved(discretise(heat(), ("x", space, elements), ("t", "dae", 3)))
    for steps in (
        [("x", space, elements), ("t", "radau", 3)],
        [("t", "radau", 3), ("x", space, elements)],
    ):
        ours = discretise(heat(), *steps)
        assert values(solved(ours).u) == pytest.approx(values(theirs.u), abs=1e-6)


@pytest.mark.casadi
@pytest.mark.parametrize("time", ["BACKWARD", "dae"])
def test_pyomo_dae_in_time_before_or_after(time):
    found = []
    for steps in ([("x", "gauss", 3), ("t", time, 3)], [("t", time, 3), ("x", "gauss", 3)]):
        m = solved(discretise(heat(), *steps))
        found.append(values(m.u))
    assert found[0] == pytest.approx(found[1], abs=1e-6)


# -------------------------------------------------------------------- both sets by this package


@pytest.mark.casadi
@pytest.mark.parametrize("time", ["radau", "gauss"])
def test_heat_equation_without_equations_at_the_boundaries(time):
    """Square, accurate at every point, and the same in either order."""
    found = []
    for steps in ([("x", "gauss", 3), ("t", time, 3)], [("t", time, 3), ("x", "gauss", 3)]):
        m = discretise(heat(), *steps)
        assert free_variables(m) == 0
        assert largest_error(solved(m).u, heat_exact) < 2e-3
        found.append(values(m.u))
    assert found[0] == pytest.approx(found[1], abs=1e-8)


def test_refusal_and_another_mesh_leave_no_trace():
    m = discretise(heat(), ("x", "gauss", 2), ("t", "radau", 2))
    n = discretise(heat(), ("x", "gauss", 3), ("t", "gauss", 2))
    with pytest.raises(ModelError, match=r"'dudx2\[1,.*has no equation, .* gauss has none at either end"):
        OURS.apply_to(m, wrt=m.x, nfe=3, ncp=3)
    OURS.apply_to(m, wrt=m.x, nfe=3, ncp=3, scheme="gauss")
    OURS.apply_to(m, wrt=m.t, nfe=2, ncp=3, scheme="gauss")
    assert list(m.x) == list(n.x)
    assert list(m.t) == list(n.t)
    names = [{row.name for row in one.component_data_objects(pyo.Constraint, active=True)} for one in (m, n)]
    assert names[0] == names[1]


def test_copies_are_discretised_the_same():
    m = heat()
    n = OURS.create_using(m, nfe=2, ncp=2, scheme="gauss")
    assert list(m.x) == [0, 1]
    o = discretise(OURS.create_using(m, wrt=m.t, nfe=2, ncp=3), ("x", "BACKWARD", 2))
    p = discretise(heat(), ("t", "radau", 2), ("x", "BACKWARD", 2))
    assert free_variables(n) == 0
    rows = [{row.name: str(row.expr) for row in one.component_data_objects(pyo.Constraint)} for one in (o, p)]
    assert rows[0] == rows[1]


@pytest.mark.casadi
def test_plate_without_time():
    """``u_xx + u_yy = 0`` with a sine on one edge; no equation holds on any edge, and the edges need one corner."""
    m = laplace()
    m.u[0, 0].fix(0)
    OURS.apply_to(m, nfe=3, ncp=4, scheme="gauss")
    solved(m)
    assert free_variables(m) == 0
    inner = [(x, y) for x in m.x for y in m.y if x not in (0, 1) and y not in (0, 1)]
    error = max(abs(m.u[x, y].value - sin(pi * x) * sinh(pi * (1 - y)) / sinh(pi)) for x, y in inner)
    assert error < 5e-3


# -------------------------------------------------------------------- opposite directions


@pytest.mark.casadi
def test_steady_exchanger():
    """Both streams are linear, and their difference is the same everywhere."""
    m = steady_exchanger()
    OURS.apply_to(m, nfe=10, scheme="gauss")
    assert free_variables(m) == 0
    solved(m)
    # up' = down' = -c/2 and up - down = c, so 1 - c = down(0) = c / 2.
    c = 2 / 3
    assert max(abs(m.up[z].value - (1 - c * z / 2)) for z in m.z) < 1e-9
    assert max(abs(m.down[z].value - (c / 2 - c * z / 2)) for z in m.z) < 1e-9
    assert rcp.dae_trajectory(m, m.z).states["down"][0] == pytest.approx(c / 2, abs=1e-9)


@pytest.mark.casadi
def test_exchanger_from_a_cold_start():
    """The answers of two meshes close in on each other."""
    ends = []
    for elements in (1, 3, 6):
        m = discretise(exchanger(), ("z", "gauss", elements), ("t", "radau", 2))
        assert free_variables(m) == 0
        solved(m)
        ends.append((m.up[1, 1].value, m.down[1, 0].value))
    coarse, fine = (max(abs(a - b) for a, b in zip(one, ends[-1], strict=True)) for one in ends[:-1])
    assert fine < coarse
    assert fine < 1e-2


# -------------------------------------------------------------------- matchings


@given(st.lists(st.lists(st.integers(0, 5), min_size=1, max_size=3, unique=True), max_size=8))
@settings(max_examples=50, deadline=None)
def test_a_matching_prefers_the_rows_before(incidence):
    """As many rows as any matching; and each prefix of the rows is matched as well as it can be alone."""
    matching = maximum_matching(incidence, 6)
    for count in range(len(incidence) + 1):
        alone = maximum_matching(incidence[:count], 6)
        assert sum(c >= 0 for c in matching.column_of[:count]) == count - len(alone.unmatched_rows)
