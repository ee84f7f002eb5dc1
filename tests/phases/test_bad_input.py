"""Whatever is wrong is named, with a remedy, and leaves nothing behind."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import contents, free_variables, rank, rows

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import InitialGuessError, ModelError, PyRobocopError
from pyrobocop_pyomo.phases import Declaration

NAN, INF = float("nan"), float("inf")


def started() -> tuple[pyo.ConcreteModel, Any]:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=1, elements=3, stages=2, scheme="gauss")
    b.x = rcp.State(initial=0)
    b.u = rcp.Control()
    return m, b


def complete(m: pyo.ConcreteModel) -> None:
    """What was refused must not stand in the way of what is right."""
    m.p.z = rcp.Algebraic(initial_guess=1)
    m.p.ode(lambda b, t: {b.x: b.u[t] * b.z[t]})
    m.p.residual(rule)
    m.p.check()
    assert len(free_variables(m)) - len(rows(m)) == len(m.p.points)
    assert rank(m) == len(rows(m))


def rule(b: Any, t: float) -> Any:
    return b.z[t] == 2 + b.x[t]


DECLARATIONS = {
    "state, bounds, initial above": (rcp.State(bounds=(0, 1), initial=2), "initial value 2 lies outside its bounds"),
    "state, bounds, final below": (rcp.State(bounds=(0, 1), final=-1), "final value -1 lies outside its bounds"),
    "initial is nan": (rcp.State(initial=NAN), "its initial value is nan; expected a finite number"),
    "initial crosses": (rcp.State(initial=(2, 1)), "lower of its initial bounds, 2, exceeds the upper, 1"),
    "final leaves nothing": (rcp.State(bounds=(0, 1), final=(2, 3)), "leave nothing of its bounds"),
    "bounds hold nan": (rcp.Algebraic(bounds=(NAN, 1)), "hold a NaN. Give numbers"),
    "bounds exclude all": (rcp.Control(bounds=(INF, None)), "exclude every number"),
    "bounds are three": (rcp.Control(bounds=(0, 1, 2)), r"expected a pair \(lower, upper\)"),
    "bounds cross in time": (rcp.Control(bounds=lambda t: (t, 0.5)), "exceeds the upper, 0.5"),
    "piecewise constant bounds cross": (
        rcp.Control(bounds=lambda t: (10 * t, 10 * t + 0.1), parametrization="piecewise_constant"),
        "lower of its bounds between",
    ),
    "guess of a control too long": (rcp.Control(initial_guess=[0.0] * 7), "has 7 values; 3 elements need 3 or 6"),
    "guess holds nan": (rcp.Control(initial_guess=[0, NAN, 0]), "value 1 of the initial guess is nan"),
    "guess is a matrix": (rcp.Control(initial_guess=np.zeros((2, 3))), r"has shape \(2, 3\)"),
    "guess function of a parameter": (
        rcp.Parameter(initial_guess=abs),
        "function of time, but 'phase .* is one number",
    ),
    "duration as a name": (rcp.Duration(bounds=(1, 2)), r"given to PhaseBlock\(duration="),
    "base class": (Declaration(), "a Declaration cannot be declared"),
}


@pytest.mark.parametrize("case", DECLARATIONS)
def test_a_declaration_that_contradicts_itself_is_refused_whole(case: str) -> None:
    declaration, message = DECLARATIONS[case]
    m, b = started()
    before = contents(m)
    with pytest.raises((ModelError, InitialGuessError), match=message) as caught:
        b.z = declaration
    assert "phase 'p'" in str(caught.value)
    assert contents(m) == before
    complete(m)


def test_a_class_in_place_of_a_declaration_is_refused() -> None:
    m, b = started()
    with pytest.raises(ModelError, match=r"phase 'p': 'z' was given the class; write Algebraic\(\)"):
        b.z = rcp.Algebraic
    complete(m)


def test_an_unknown_parametrization_is_refused() -> None:
    with pytest.raises(
        ModelError,
        match="'linear' is unknown; choose one of 'collocated', 'piecewise_constant', 'piecewise_linear'",
    ):
        rcp.Control(parametrization="linear")


@pytest.mark.parametrize("name", ["x", "time", "points", "duration", "grid", "ode", "x_continuity", "name"])
def test_a_taken_name_is_refused(name: str) -> None:
    m, b = started()
    before = contents(m)
    with pytest.raises(ModelError, match=f"the name '{name}' .* is taken. Choose another"):
        setattr(b, name, rcp.Control())
    assert contents(m) == before
    complete(m)


@pytest.mark.parametrize(
    ("mine", "needing"),
    [("y_continuity", rcp.State()), ("y_per_element", rcp.Control(parametrization="piecewise_constant"))],
)
def test_a_name_that_a_declaration_generates_must_be_free(mine: str, needing: Any) -> None:
    m, b = started()
    setattr(b, mine, rcp.Control())
    before = contents(m)
    with pytest.raises(ModelError, match=f"the name '{mine}' is needed for what is generated"):
        b.y = needing
    assert contents(m) == before


@pytest.mark.parametrize("mine", ["x_derivative", "x_collocation", "x_equation"])
def test_a_name_that_an_ode_generates_must_be_free(mine: str) -> None:
    m = pyo.ConcreteModel()
    m.p = rcp.PhaseBlock()
    m.p.x = rcp.State(derivative_bounds=(0, 1))
    setattr(m.p, mine, rcp.Control())
    before = contents(m)
    with pytest.raises(ModelError, match=f"the name '{mine}' is needed for what is generated"):
        m.p.ode(lambda b, t: {b.x: 1.0})
    assert contents(m) == before


def test_a_state_named_like_a_derivative_is_not_taken_for_one() -> None:
    _, b = started()
    b.x_derivative = rcp.State(initial=0)
    with pytest.raises(ModelError, match="'x_derivative' is needed"):
        b.derivative(b.x)
    assert b.component("x_collocation") is None


def returns_none(b: Any, t: float) -> None:
    b.x[t] + 1


def inequality(b: Any, t: float) -> Any:
    return [b.x[t] == 1, b.u[t] <= 1]


def number(b: Any, t: float) -> Any:
    return 3.0


def equation_for_some(b: Any, t: float) -> Any:
    return [] if t < 0.5 else [b.x[t] == b.u[t]]


STATEMENTS = {
    "ode names what is not": ("ode", lambda b, t: {"q": 1.0}, "'q' is no state"),
    "ode at some points": ("ode", lambda b, t: {b.x: 1.0} if t < 0.5 else {}, "gives no derivative of 'x' at t = 0"),
    "a state twice": ("ode", lambda b, t: {b.x: 1.0, "x": 2.0}, "gives the derivative of 'x' twice at t = "),
    "ode gives None": ("ode", lambda b, t: {b.x: None}, "gives 'None' as the derivative of 'x'"),
    "ode gives a relation": ("ode", lambda b, t: {b.x: b.u[t] == 1}, "expected a number or an expression"),
    "residual returns None": ("residual", returns_none, "residual 'returns_none' returned None at t = "),
    "residual is an inequality": ("residual", inequality, "states the inequality .* Write ==, or use 'constraint'"),
    "residual is a number": ("residual", number, "returned 3.0 at t = .* expected an equality in variables"),
    "residual at some points": ("residual", equation_for_some, "states 0 equations at t = .* and 1 at t = "),
}


@pytest.mark.parametrize("case", STATEMENTS)
def test_a_statement_that_cannot_be_rows_is_refused_whole(case: str) -> None:
    kind, statement, message = STATEMENTS[case]
    m, b = started()
    before = contents(m)
    with pytest.raises(rcp.errors.PyRobocopError, match=message):
        getattr(b, kind)(statement)
    assert contents(m) == before
    complete(m)


def test_a_second_equation_for_a_state_is_refused_and_names_the_first() -> None:
    m, b = started()
    b.y = rcp.State(initial=0)
    b.ode(first := lambda b, t: {b.x: b.u[t]})
    before = contents(m)

    def second(b, t):
        return {b.y: 1.0, b.x: 2.0}

    with pytest.raises(ModelError, match=f"second equation for state 'x'; '{first.__name__}' has given one"):
        b.ode(second)
    assert contents(m) == before
    assert "y" not in b.record.equation_of
    b.ode(lambda b, t: {b.y: 1.0})
    b.check()


def test_a_cell_that_is_run_again_is_answered_by_which_cells_to_run() -> None:
    _, b = started()

    def motion(b, t):
        return {b.x: b.u[t]}

    b.ode(motion)
    with pytest.raises(ModelError, match="cell that is run again"):
        b.x = rcp.State(initial=0)
    with pytest.raises(ModelError, match="cell that is run again"):
        b.ode(motion)
    with pytest.raises(ModelError) as of_every_phase:
        b.time = rcp.State(initial=0)
    assert "again" not in str(of_every_phase.value)


@pytest.mark.parametrize("kind", ["ode", "residual", "constraint", "complementarity"])
def test_the_exception_of_a_rule_comes_out_unchanged(kind: str) -> None:
    m, b = started()
    before = contents(m)
    own = RuntimeError("mine")

    def raises_halfway(b, t):
        b.derivative(b.x)  # makes a variable that has to go again
        if t > 0.5:
            raise own
        return {"ode": {b.x: 1.0}, "complementarity": rcp.complements(b.x[t] >= 0, b.u[t] >= 0)}.get(kind, b.x[t] == 1)

    with pytest.raises(RuntimeError) as caught:
        getattr(b, kind)(raises_halfway)
    assert caught.value is own
    assert contents(m) == before
    complete(m)


def test_a_rule_named_like_a_component_is_refused() -> None:
    m, b = started()

    def u(b, t):
        return b.x[t] <= 1

    before = contents(m)
    with pytest.raises(ModelError, match=r"the name 'u' is taken or no identifier. Rename the function"):
        b.constraint(u)
    assert contents(m) == before


def test_rows_of_lambdas_are_numbered_and_follow_another_mesh() -> None:
    _, b = started()
    b.constraint(lambda b, t: b.x[t] <= 5)
    b.constraint(lambda b, t: [b.x[t] >= -5, b.u[t] <= 7])
    b.constraint(lambda b, t: b.x[t] <= 6, name="high")
    b.remesh(3)
    points = len(b.points)
    assert [len(b.component(name)) for name in ("constraint_1", "constraint_2", "high")] == [points, 2 * points, points]


def test_rules_may_be_named_like_methods() -> None:
    _, b = started()

    def clear(b, t):
        return b.x[t] <= 5

    b.constraint(clear)
    assert len(b.clear_rows) == len(b.points)
    assert callable(b.clear)


@pytest.mark.parametrize("name", ["two words", 3, "u", "time"])
def test_a_name_for_rows_that_is_none_is_refused(name: Any) -> None:
    m, b = started()
    before = contents(m)
    with pytest.raises(ModelError, match=f"{name}.*no identifier"):
        b.constraint(lambda b, t: b.x[t] <= 1, name=name)
    assert contents(m) == before


def test_a_function_assigned_states_nothing_and_is_refused() -> None:
    m, b = started()
    with pytest.raises(ModelError, match=r"'path', which states nothing.*constraint\(rule, name='path'\)"):
        b.path = lambda b, t: b.x[t] <= 1
    complete(m)


OPTIONS = {
    "zero": ({"duration": 0}, ModelError, "duration = 0; expected a positive number"),
    "text": ({"duration": "long"}, ModelError, "duration = 'long'"),
    "no bounds": ({"duration": rcp.Duration()}, ModelError, "lower bound of the duration is None"),
    "bounds from 0": ({"duration": rcp.Duration(bounds=(0, 1))}, ModelError, "is 0.0; it must be positive"),
    "bad guess": (
        {"duration": rcp.Duration(bounds=(1, 2), initial_guess=-1)},
        InitialGuessError,
        "the initial guess is -1; it must be pos",
    ),
    "no elements": ({"elements": 0}, ModelError, "elements = 0; expected an integer of at least 1"),
    "mesh falls": (
        {"mesh": [0, 0.6, 0.5, 1]},
        ModelError,
        "must increase, but boundary 1 is 0.6 and boundary 2 is 0.5",
    ),
    "mesh is text": ({"mesh": "fine"}, ModelError, "mesh = 'fine' is no sequence"),
    "mesh too long": ({"mesh": [0, 1, 2]}, ModelError, "mesh runs from 0 to 2, the phase from 0 to 1"),
    "mesh and elements": ({"mesh": [0, 1], "elements": 3}, ModelError, "elements = 3, but the given mesh has 1"),
    "mesh of a free duration": (
        {"mesh": [0, 2], "duration": rcp.Duration(bounds=(1, 2))},
        ModelError,
        "or with free element widths, takes a mesh from 0 to 1",
    ),
    "stages": ({"stages": 0}, ModelError, "stages = 0; expected an integer"),
    "too many stages": ({"scheme": "implicit_euler", "stages": 2}, ModelError, "'implicit_euler' has 1 stage"),
}


@pytest.mark.parametrize("case", OPTIONS)
def test_a_phase_without_a_grid_is_not_added(case: str) -> None:
    options, error, message = OPTIONS[case]
    m = pyo.ConcreteModel()
    with pytest.raises(error, match=re.escape(message)) as caught:
        m.p = rcp.PhaseBlock(**options)
    assert "phase 'p'" in str(caught.value)
    assert list(m.component_map()) == []
    m.p = rcp.PhaseBlock()
    assert m.p.grid.mesh.elements == 10


@pytest.mark.parametrize("indexes", [(), ([1, 2],)])
def test_a_phase_whose_own_rule_fails_is_not_added(indexes: tuple) -> None:
    own = ZeroDivisionError("mine")

    def build(b, *index):
        b.x = rcp.State(initial=0)
        raise own

    m = pyo.ConcreteModel()
    with pytest.raises(ZeroDivisionError) as caught:
        m.p = rcp.PhaseBlock(*indexes, rule=build)
    assert caught.value is own
    assert list(m.component_map()) == []


def check_fails(b: Any, message: str) -> None:
    with pytest.raises(ModelError, match=message):
        b.check()


def test_what_does_not_fit_together_is_named() -> None:
    _, b = started()
    check_fails(b, r"state 'x' \(declared at test_bad_input.py:\d+\) has no equation. State its derivative in an ode")
    b.ode(lambda b, t: {b.x: b.u[t]})
    b.check()
    b.z = rcp.Algebraic()
    check_fails(b, "too few equations. 1 state and 1 algebraic need 2 equations per collocation point; stated are 1")

    def twice(b, t):
        return [b.z[t] == 1, b.x[t] == b.z[t]]

    b.residual(twice)
    check_fails(b, "too many equations. .* 1 in odes, 2 in residuals .* declare what it determines as Algebraic")


@pytest.mark.parametrize(
    ("kind", "declaration"),
    [("control", rcp.Control()), ("control", rcp.Control(parametrization="piecewise_constant")),
     ("parameter", rcp.Parameter())],
)  # fmt: skip
def test_what_appears_nowhere_is_named_until_it_appears(kind: str, declaration: Any) -> None:
    m, b = started()
    b.ode(lambda b, t: {b.x: b.u[t]})
    b.lost = declaration
    check_fails(b, f"{kind} 'lost' .* appears in no equation, constraint or objective. Use it or remove it")
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: (b.lost if kind == "parameter" else b.lost[t]) ** 2))
    b.check()
    m.cost.deactivate()
    check_fails(b, "'lost'")
    m.row = pyo.Constraint(expr=sum(b.lost.values()) == 1)
    b.check()


def test_an_algebraic_that_appears_nowhere_is_named() -> None:
    _, b = started()
    b.z = rcp.Algebraic()
    b.ode(lambda b, t: {b.x: b.u[t]})

    def of_another(b, t):
        return b.u[t] == b.x[t]

    b.residual(of_another)
    check_fails(b, "algebraic 'z' .* appears in no equation")


def test_declaring_on_many_phases_at_once_is_refused() -> None:
    m = pyo.ConcreteModel()
    m.p = rcp.PhaseBlock([1, 2])
    with pytest.raises(ModelError, match=r"phases 'p': 'x' .* is declared on one phase at a time"):
        m.p.x = rcp.State()
    m.p[1].x = rcp.State()
    assert m.p[2].component("x") is None


# --------------------------------------------------------------------
# A slip in a rule is named with its remedy, and the phase stays as it was.


@pytest.mark.parametrize(
    ("rule", "message"),
    [
        (lambda b, t: {b.x: b.gain[t] * b.u[t]}, r"ode 'rule': its rule reads 'gain' at \[t\].*Write b\.gain\."),
        (lambda b, t: {b.x: b.u[t] / (1.0 - t)}, r"divides numbers by zero at t = 1 .*scheme='gauss'"),
    ],
)
def test_a_slip_is_named_with_its_remedy(rule: Callable[..., Any], message: str) -> None:
    m = pyo.ConcreteModel()
    m.go = b = rcp.PhaseBlock(duration=1.0, elements=2)
    b.x, b.u, b.gain = rcp.State(initial=0), rcp.Control(), rcp.Parameter(bounds=(0, 1))
    before = list(b.component_map())
    with pytest.raises(ModelError, match=message):
        b.ode(rule, name="rule")
    assert list(b.component_map()) == before


SINGULAR = lambda t: 1 / (1 - t)  # noqa: E731


@pytest.mark.parametrize(
    ("state", "control", "rule"),
    [
        ({}, {}, lambda b, t: b.x[t] ** 2 / (1 - t)),  # where Pyomo's own error says nothing
        ({}, {}, lambda b, t: b.u[t] ** 2 * (1 - t) ** -0.5),
        ({}, {"bounds": lambda t: (0, SINGULAR(t))}, None),
        ({"initial_guess": SINGULAR}, {}, None),
        ({"history": lambda t: 1 / (t + 0.5)}, {}, lambda b, t: b.x.delayed(t, 1.5)),
    ],
)
def test_what_divides_by_zero_is_named_with_the_time(state: Any, control: Any, rule: Any) -> None:
    m = pyo.ConcreteModel()
    m.go = b = rcp.PhaseBlock(duration=1.0, elements=2)

    def state_all() -> None:
        b.x, b.u = rcp.State(**state), rcp.Control(**control)
        b.ode(lambda b, t: {b.x: b.u[t]})
        b.integral(rule)

    with pytest.raises(PyRobocopError, match=r"go': .*divides numbers by zero at t = (1|-0\.5) "):
        state_all()
