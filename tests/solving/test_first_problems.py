"""Problems as somebody states them who has just read the documentation."""

import pyomo.environ as pyo
import pytest
from harness.checked import solution
from harness.phases import one_phase, rest_to_rest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ComplementarityError, ContradictionError
from pyrobocop_pyomo.solving.violations import remarks_on_phases_with_pairs

pytestmark = pytest.mark.casadi


def test_control_that_jumps_and_passes_its_bound_between_the_points_is_named():
    def verified(parametrization):
        m = rest_to_rest(u={"parametrization": parametrization}, elements=7)
        result = solution(m, mesh_tolerance=None, strategies=rcp.Strategy(exploration=0))
        return m.p.trajectory().verify().bounds_passed, str(result)

    passed, text = verified("collocated")
    assert passed["u"].excess > 0.01
    assert "'u' passes its bound" in text
    assert "parametrization='piecewise_constant' for a control" in text
    passed, text = verified("piecewise_constant")
    assert "u" not in passed
    assert "passes its bound" not in text


# --------------------------------------------------------------------
# What is said about problems whose first statement cannot work names what to write instead.


def dropped(**declarations):
    m, b = one_phase("fall", model="dropped", duration=0.5, elements=4, scheme="implicit_euler")
    b.height, b.speed = rcp.State(initial=1.0), rcp.State(initial=0)
    b.force = rcp.Algebraic(bounds=(0, None))
    for name, declaration in declarations.items():
        setattr(b, name, declaration)
    b.ode(lambda b, t: {b.height: b.speed[t], b.speed: b.force[t] - 9.81})
    m.cost = pyo.Objective(expr=b.speed[b.final_time] ** 2)
    return m


def test_pair_whose_side_is_a_condition_is_answered_by_how_to_write_it():
    m = dropped()
    m.fall.height.setlb(0.5)
    m.fall.complementarity(lambda b, t: rcp.complements(0.1 - b.height[t] >= 0, b.force[t] >= 0), name="near")
    with pytest.raises(ContradictionError, match=r"'near' by 0.9 at t = 0.*complements\(gap >= 0, force >= 0\)"):
        rcp.solve(m, progress=False)  # by the start that is given
    m.fall.height[0].unfix()
    with pytest.raises(ComplementarityError, match=r"'fall\.near.*complements\(gap >= 0, force >= 0\)"):
        rcp.solve(m, progress=False)


def test_motion_without_choice_is_told_to_be_simulated():
    m = dropped()
    m.fall.complementarity(lambda b, t: rcp.complements(b.height[t] >= 0, b.force[t] >= 0), name="floor")
    assert "'fall' has nothing to choose" in "".join(remarks_on_phases_with_pairs(m))
    m.fall.initialize(m.fall.simulate())  # as it says
    rcp.solve(m, progress=False).raise_for_status()
    chosen = dropped(push=rcp.Control())
    chosen.fall.complementarity(lambda b, t: rcp.complements(b.height[t] >= 0, b.force[t] >= 0), name="floor")
    assert not list(remarks_on_phases_with_pairs(chosen))
    assert not list(remarks_on_phases_with_pairs(dropped()))  # no pairs
