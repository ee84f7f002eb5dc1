"""Objects show themselves in one short line, and in a notebook by their whole text."""

import pickle
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pyomo.environ as pyo
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.presentation import Presented
from pyrobocop_pyomo.solving import StopReason

LONGEST_LINE = 200


def text_of(html: str) -> str:
    """The text of HTML whose tags are all closed in order."""
    return "".join(ElementTree.fromstring(html).itertext())


def cart() -> Any:
    m = pyo.ConcreteModel(name="cart")
    m.cart = b = rcp.PhaseBlock(duration=2.0, elements=4, scheme="radau", stages=2)
    b.position = rcp.State(initial=0, final=1)
    b.velocity = rcp.State(initial=0, final=0, bounds=(-3, 3))
    b.arm = rcp.State(index=range(2), initial=0.0)
    b.force = rcp.Control(bounds=(-10, 10))
    b.ode(lambda b, t: {b.position: b.velocity[t], b.velocity: b.force[t]}, name="newton")
    b.ode(lambda b, t: {b.arm: [b.velocity[t], b.force[t]]}, name="arm_motion")
    for variable in m.component_data_objects(pyo.Var):
        variable.set_value(0.5)
    return m


@pytest.mark.parametrize(
    "shape",
    [
        rcp.Polytope.box(1, 2, name="<a & b>"),
        rcp.Polytope.ball(0.3, (1, 2, 3)),
        rcp.Polytope.from_halfspaces([[0.0, 1.0]], [0.0], bounded=False),
        rcp.Polytope.point((1e3, 0.0)),
    ],
    ids=lambda shape: str(shape)[:12],
)
def test_shapes_show_their_name(shape: rcp.Polytope) -> None:
    assert text_of(shape._repr_html_()) == str(shape)
    assert len(repr(shape)) < LONGEST_LINE
    assert shape.name in repr(shape)


def test_a_phase_shows_its_declarations_in_a_line() -> None:
    phase = cart().cart
    assert repr(phase) == "<PhaseBlock: 'cart': 4 states, 1 control, 4 elements of radau(2)>"
    assert "not constructed" in repr(rcp.PhaseBlock())
    assert text_of(phase._repr_html_()) == repr(phase)


def test_completion_finds_what_was_declared() -> None:
    phase = cart().cart
    trajectory = phase.trajectory()
    for shown in (phase, trajectory, rcp.join_trajectories([trajectory])):
        assert {"position", "velocity", "arm", "arm_0", "force"} <= set(dir(shown))
    for shown in (phase, trajectory, rcp.Polytope.box(1, 1)):
        for name in dir(shown):  # as completion by type does; nothing may fail
            if not name.startswith("__"):
                hasattr(shown, name)


@pytest.mark.casadi
def test_results_and_reports_are_short_lines_and_whole_texts() -> None:
    m = cart()
    m.cost = pyo.Objective(expr=m.cart.integral(lambda b, t: b.force[t] ** 2))
    result = rcp.solve(m)
    trajectory = m.cart.trajectory()
    shown = [
        result,
        result.best,
        result.discretisation,
        trajectory.verify(),
        trajectory.grid,
        trajectory.grid.mesh,
        trajectory.grid.scheme,
        rcp.diagnose(m),
        rcp.studies.multistart(m, 2, seed=1),
    ]
    for one in shown:
        assert len(repr(one)) < LONGEST_LINE
        assert "\n" not in repr(one)
        assert type(one).__name__ in repr(one)
        assert text_of(one._repr_html_()) == str(one)
    for text in (repr(result), result._repr_html_()):
        assert f"objective {result.objective:.6g}" in text
    assert all(hasattr(result, name) for name in dir(result))


def test_a_subclass_that_is_a_dataclass_keeps_the_short_line() -> None:
    grid = cart().cart.trajectory().grid
    assert isinstance(grid, Presented)
    assert "boundaries=(" not in repr(grid)
    assert repr(pickle.loads(pickle.dumps(grid))) == repr(grid)


# --------------------------------------------------------------------
# Variables over time and declarations show themselves by what the user knows of them.


def test_a_variable_over_time_shows_its_range() -> None:
    m = cart()  # a block does not keep its model alive
    b = m.cart
    b.push = rcp.Control()
    b.push.set_values(dict.fromkeys(b.push))
    assert repr(b.push).endswith("times, no values yet>")
    for t in b.position:
        b.position[t].set_value(2.0 * t - 1.0, skip_validation=True)
    assert repr(b.position) == f"<SignalVar: 'cart.position' at {len(b.position)} times, -1 .. 3>"
    assert str(b.position) == "cart.position"


@given(st.dictionaries(st.sampled_from(["initial", "final", "initial_guess"]), st.floats(-9, 9), min_size=1))
def test_a_declaration_shows_what_was_given_and_can_be_read_back(given_values: dict[str, float]) -> None:
    declaration = rcp.State(**given_values)
    assert eval(repr(declaration), {"State": rcp.State}) == declaration
    assert repr(declaration).count("=") == len(given_values)


def test_declarations_hide_defaults() -> None:
    assert repr(rcp.Control(bounds=(-1, 1))) == "Control(bounds=(-1, 1))"
    assert repr(rcp.Duration(bounds=(0.5, 5))) == "Duration(bounds=(0.5, 5))"
    assert "\n" not in repr(rcp.State(initial=np.eye(4)))


@pytest.mark.casadi
@pytest.mark.parametrize(
    ("reason", "words"),
    [(StopReason.INTERRUPTED, "solved when interrupted."), (StopReason.TIME_LIMIT, "solved at the time limit.")],
)
def test_a_run_that_was_cut_short_says_so_in_its_line(reason: StopReason, words: str) -> None:
    m = pyo.ConcreteModel(name="cut")
    m.x = pyo.Var(initialize=1.0)
    m.cost = pyo.Objective(expr=(m.x - 2.0) ** 2)
    result = rcp.solve(m)
    assert words not in repr(result)
    assert words in repr(replace(result, stop_reason=reason))
