"""Moving a plan ahead by kept weights is the same as sampling its trajectory later."""

import numpy as np
import pyomo.environ as pyo
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.phases.phase_values import PhaseValues
from pyrobocop_pyomo.studies.persistent_nlp import ShiftedPlan


@pytest.mark.parametrize("scheme", ["radau", "gauss"])
@pytest.mark.parametrize("parametrization", ["collocated", "piecewise_constant", "piecewise_linear"])
@given(
    advance=st.one_of(st.floats(0, 2), st.sampled_from([0.0, 0.25, 0.5, 2.0])),
    seed=st.integers(0, 99),
)
@settings(max_examples=10)
def test_kept_weights_are_the_polynomials(scheme: str, parametrization: str, advance: float, seed: int) -> None:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=2.0, elements=8, stages=3, scheme=scheme)
    b.x, b.u = rcp.State(initial=0.0), rcp.Control(parametrization=parametrization)
    b.y = rcp.Algebraic()
    values = PhaseValues(b)
    random = np.random.default_rng(seed)
    found = {name: random.normal(size=len(nodes.times)) for name, nodes in values.nodes.items()}
    plan = values.trajectory(found, evaluate=False)
    expected = values.sampled(plan, lambda t: t + advance)
    moved = ShiftedPlan(b, values)
    for _ in range(2):  # the second time from what was kept
        ahead = moved.ahead(found, advance)
        assert list(ahead) == list(found)
        for name, numbers in expected.items():
            np.testing.assert_allclose(ahead[name], numbers, atol=1e-12)
