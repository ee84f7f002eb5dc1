"""The structural index: what is refused, what is let through, and who is named."""

from __future__ import annotations

import pickle
from typing import Any

import pyomo.environ as pyo
import pytest
from pyomo.mpec import Complementarity as PyomoComplementarity
from pyomo.mpec import complements as pyomo_complements

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.phases.structure import PointStructure, middle_point

LENGTH, GRAVITY = 1.0, 9.81


def pendulum(constraint: Any, **options: Any) -> pyo.ConcreteModel:
    """A mass on a rod in Cartesian coordinates; the rod is stated as position, velocity or acceleration."""
    m = pyo.ConcreteModel("pendulum")
    m.swing = b = rcp.PhaseBlock(**{"duration": 1, "elements": 5, "stages": 2, **options})
    for name, initial in {"x": LENGTH, "y": 0.0, "u": 0.0, "v": 0.0}.items():
        setattr(b, name, rcp.State(initial=initial, initial_guess=initial))
    b.tension = rcp.Algebraic()
    b.ode(mass)
    b.residual(constraint)
    return m


def mass(b: Any, t: float) -> Any:
    along = b.tension[t]
    return {b.x: b.u[t], b.y: b.v[t], b.u: -along * b.x[t], b.v: -along * b.y[t] - GRAVITY}


def position(b: Any, t: float) -> Any:
    return b.x[t] ** 2 + b.y[t] ** 2 == LENGTH**2


def velocity(b: Any, t: float) -> Any:
    return b.x[t] * b.u[t] + b.y[t] * b.v[t] == 0


def acceleration(b: Any, t: float) -> Any:
    return b.u[t] ** 2 + b.v[t] ** 2 - GRAVITY * b.y[t] == b.tension[t] * (b.x[t] ** 2 + b.y[t] ** 2)


def accelerations_as_derivatives(b: Any, t: float) -> Any:
    """The same through the derivatives, which the ode has given: they hold the tension."""
    return (
        b.u[t] ** 2
        + b.v[t] ** 2
        + b.x[t] * b.derivative(b.u)[t]
        + b.y[t] * b.derivative(b.v)[t]
        == 0
    )  # fmt: skip


@pytest.mark.parametrize("constraint", [acceleration, accelerations_as_derivatives])
def test_index_one_passes(constraint: Any) -> None:
    pendulum(constraint).swing.check()


@pytest.mark.parametrize("constraint", [position, velocity])
def test_a_higher_index_is_refused_with_the_equation_and_the_unknown(constraint: Any) -> None:
    m = pendulum(constraint)
    with pytest.raises(ModelError) as caught:
        m.swing.check()
    message = str(caught.value)
    assert f"equation '{constraint.__name__}' holds no derivative and no algebraic to determine" in message
    assert "nothing determines unknown 'tension'" in message
    assert "allow_higher_index=True" in message


@pytest.mark.casadi
def test_an_expert_may_allow_it_and_gets_the_motion() -> None:
    m = pendulum(velocity, allow_higher_index=True, elements=20, stages=3)
    rcp.solve(m, options={"tol": 1e-11}).raise_for_status()
    b, end = m.swing, 1.0
    energy = (b.u[end].value ** 2 + b.v[end].value ** 2) / 2 + GRAVITY * b.y[end].value
    assert energy == pytest.approx(0.0, abs=1e-4)
    assert b.x[end].value ** 2 + b.y[end].value ** 2 == pytest.approx(LENGTH**2, abs=1e-6)


def test_the_permission_survives_clone_and_pickle() -> None:
    m = pendulum(position, allow_higher_index=True)
    m.clone().swing.check()
    pickle.loads(pickle.dumps(m)).swing.check()


def test_equations_that_share_an_unknown_are_named_with_it() -> None:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(elements=2)
    b.x = rcp.State(initial=0)
    b.y, b.z = rcp.Algebraic(), rcp.Algebraic()
    b.ode(lambda b, t: {b.x: b.z[t]})

    def springs(b, t):
        return {"left": b.y[t] == b.x[t], "right": b.y[t] == 2 * b.x[t]}

    b.residual(springs)
    with pytest.raises(ModelError, match=r"equations 'springs\[left\]', 'springs\[right\]' share only unknown"):
        b.check()


def no_motion(b: Any, t: float) -> Any:
    return b.v[t] == 0


def newton(b: Any, t: float) -> Any:
    return b.derivative(b.v)[t] == b.u[t] - b.x[t]


def test_a_kept_derivative_is_an_unknown_like_any_other() -> None:
    def pushed(residual: Any) -> Any:
        m = pyo.ConcreteModel()
        m.p = b = rcp.PhaseBlock(elements=2)
        b.x = rcp.State(initial=0)
        b.v = rcp.State(initial=0, derivative_bounds=(-1, 1))
        b.f, b.u = rcp.Algebraic(), rcp.Control()
        b.ode(lambda b, t: {b.x: b.v[t], b.v: b.f[t] + b.u[t]})
        b.residual(residual)
        return m.p

    with pytest.raises(ModelError, match="equation 'no_motion' holds no derivative"):
        pushed(no_motion).check()
    b = pushed(newton)
    b.check()
    structure = PointStructure(b, middle_point(b.record))
    assert list(structure.unknowns) == ["derivative of v", "f"]
    assert list(structure.rows) == ["ode of v", "newton"]


@pytest.mark.parametrize("package", ["ours", "pyomo"])
def test_a_pair_determines_an_algebraic_that_it_holds(package: str) -> None:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(elements=2)
    b.x = rcp.State(initial=1)
    b.force = rcp.Algebraic(bounds=(0, None))
    b.ode(lambda b, t: {b.x: b.force[t]})
    if package == "ours":

        @b.complementarity
        def contact(b, t):
            return rcp.complements(b.x[t] >= 0, b.force[t] >= 0)
    else:
        b.contact = PyomoComplementarity(b.points, rule=lambda b, t: pyomo_complements(b.x[t] >= 0, b.force[t] >= 0))
    b.check()
    structure = PointStructure(b, middle_point(b.record))
    assert structure.undetermined == []
    assert list(structure.helpers) == ["contact"]


def test_an_equation_that_determines_a_control_passes() -> None:
    """A feedback law stated as a residual: unusual, since the control is then an algebraic, but nothing is wrong."""
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(elements=2)
    b.x = rcp.State(initial=1)
    b.u, b.z = rcp.Control(), rcp.Algebraic(bounds=(0, None))
    b.ode(lambda b, t: {b.x: b.u[t] + b.z[t]})

    def feedback(b, t):
        return b.u[t] == -b.x[t]

    def stop(b, t):
        return rcp.complements(b.x[t] >= 0, b.z[t] >= 0)

    b.residual(feedback)
    b.complementarity(stop)
    b.check()
    structure = PointStructure(b, middle_point(b.record))
    assert structure.leftover_rows == ["feedback"]
    assert not structure.has_higher_index
