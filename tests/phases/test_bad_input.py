"""Whatever is wrong is named, with a remedy, and leaves nothing behind."""

import re
from collections.abc import Callable
from operator import methodcaller
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.checked import unchanged
from harness.phases import contents, free_variables, one_phase, rank, rows

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import InitialGuessError, ModelError, PyRobocopError
from pyrobocop_pyomo.phases import Declaration

NAN, INF = float("nan"), float("inf")
Act = Callable[[Any], Any]  # on a phase


def started() -> tuple[pyo.ConcreteModel, Any]:
    return one_phase(duration=1, elements=3, stages=2, scheme="gauss", x=rcp.State(initial=0), u=rcp.Control())


def complete(m: pyo.ConcreteModel) -> None:
    """What was refused must not stand in the way of what is right."""
    m.p.z = rcp.Algebraic(initial_guess=1)
    m.p.ode(lambda b, t: {b.x: b.u[t] * b.z[t]})
    m.p.residual(lambda b, t: b.z[t] == 2 + b.x[t])
    m.p.check()
    assert len(free_variables(m)) - len(rows(m)) == len(m.p.points)
    assert rank(m) == len(rows(m))


def declared(declaration: Any, name: str = "z") -> Act:
    return lambda b: setattr(b, name, declaration)


DECLARATIONS = {
    "state, bounds, initial above": (rcp.State(bounds=(0, 1), initial=2), "initial value 2 lies outside its bounds"),
    "final leaves nothing": (rcp.State(bounds=(0, 1), final=(2, 3)), "leave nothing of its bounds"),
    "bounds hold nan": (rcp.Algebraic(bounds=(NAN, 1)), "hold a NaN. Give numbers"),
    "bounds exclude all": (rcp.Control(bounds=(INF, None)), "exclude every number"),
    "guess is a matrix": (rcp.Control(initial_guess=np.zeros((2, 3))), r"has shape \(2, 3\)"),
    "guess of a parameter too long": (rcp.Parameter(initial_guess=[1, 2]), "has 2 values; one number need 1"),
    "guess function of a parameter": (rcp.Parameter(initial_guess=abs), "of time, but 'phase .* is one number"),
    "duration as a name": (rcp.Duration(bounds=(1, 2)), r"given to PhaseBlock\(duration="),
    "base class": (Declaration(), "a Declaration cannot be declared"),
    "a class": (rcp.Algebraic, r"'z' was given the class; write Algebraic\(\)"),
    "a function": (lambda b, t: b.x[t] <= 1, r"'z', which states nothing.*constraint\(rule, name='z'\)"),
}
TAKEN = ["x", "time", "points", "duration", "grid", "ode", "x_continuity", "name"]


def u(b: Any, t: float) -> Any:
    return b.x[t] <= 1


STATEMENTS = {
    "a state twice": ("ode", lambda b, t: {b.x: 1.0, "x": 2.0}, "gives the derivative of 'x' twice at t = "),
    "residual is an inequality": ("residual", lambda b, t: [b.x[t] == 1, b.u[t] <= 1], "inequality .* Write ==, or us"),
    "residual is a number": ("residual", lambda b, t: 3.0, "returned 3.0 at t = .* expected an equality in variables"),
    "residual at some points": (
        "residual",
        lambda b, t: [] if t < 0.5 else [b.x[t] == b.u[t]],
        "states 0 equations at t = .* and 1 at t = ",
    ),
    "boundaries read a control": (
        "constraint_at_boundaries",
        lambda b, t: b.u[t] <= 1,
        "reads what has no value at an element boundary .*'constraint'",
    ),
    "a rule named like a component": ("constraint", u, "the name 'u' is taken or no identifier. Rename the function"),
}
WRONG: dict[str, tuple[Act, str]] = {
    **{case: (declared(declaration), message) for case, (declaration, message) in DECLARATIONS.items()},
    **{name: (declared(rcp.Control(), name), f"the name '{name}' .* is taken. Choose another") for name in TAKEN},
    **{case: (methodcaller(kind, rule), message) for case, (kind, rule, message) in STATEMENTS.items()},
    **{
        f"rows named {name}": (methodcaller("constraint", u, name=name), f"{name}.*no identifier")
        for name in ("two words", 3, "u", "time")
    },
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_refused_whole_and_stands_in_no_way(case: str) -> None:
    act, message = WRONG[case]
    m, b = started()
    with unchanged(contents, m), pytest.raises((ModelError, InitialGuessError), match=message) as caught:
        act(b)
    assert "phase 'p'" in str(caught.value)
    complete(m)


@pytest.mark.parametrize(
    ("mine", "act"),
    [
        ("y_continuity", declared(rcp.State(), "y")),
        ("y_per_element", declared(rcp.Control(parametrization="piecewise_constant"), "y")),
        *(
            (f"w_{made}", lambda b: b.ode(lambda b, t: {b.w: 1.0}))
            for made in ("derivative", "collocation", "equation")
        ),
    ],
)
def test_a_name_that_is_generated_must_be_free(mine: str, act: Act) -> None:
    m, b = started()
    b.w = rcp.State(derivative_bounds=(0, 1))
    setattr(b, mine, rcp.Control())
    with unchanged(contents, m), pytest.raises(ModelError, match=f"the name '{mine}' is needed for what is generated"):
        act(b)


def test_a_state_named_like_a_derivative_is_not_taken_for_one() -> None:
    _, b = started()
    b.x_derivative = rcp.State(initial=0)
    with pytest.raises(ModelError, match="'x_derivative' is needed"):
        b.derivative(b.x)
    assert b.component("x_collocation") is None


def test_a_second_equation_for_a_state_is_refused_and_names_the_first() -> None:
    m, b = started()
    b.y = rcp.State(initial=0)
    b.ode(first := lambda b, t: {b.x: b.u[t]})
    message = f"second equation for state 'x'; '{first.__name__}' has given one"
    with unchanged(contents, m), pytest.raises(ModelError, match=message):
        b.ode(lambda b, t: {b.y: 1.0, b.x: 2.0})
    assert "y" not in b.record.equation_of
    b.ode(lambda b, t: {b.y: 1.0})
    b.check()


def test_a_cell_that_is_run_again_is_answered_by_which_cells_to_run() -> None:
    _, b = started()

    def motion(b, t):
        return {b.x: b.u[t]}

    b.ode(motion)
    for again in (declared(rcp.State(initial=0), "x"), methodcaller("ode", motion)):
        with pytest.raises(ModelError, match="cell that is run again"):
            again(b)
    with pytest.raises(ModelError) as of_every_phase:
        b.time = rcp.State(initial=0)
    assert "again" not in str(of_every_phase.value)


@pytest.mark.parametrize("own", [RuntimeError("mine"), TypeError("tuple indices must be integers or slices, not str")])
@pytest.mark.parametrize("kind", ["ode", "residual", "constraint", "complementarity"])
def test_the_exception_of_a_rule_comes_out_unchanged(kind: str, own: Exception) -> None:
    m, b = started()

    def raises_halfway(b, t):
        b.derivative(b.x)  # makes a variable that has to go again
        if t > 0.5:
            raise own
        return {"ode": {b.x: 1.0}, "complementarity": rcp.complements(b.x[t] >= 0, b.u[t] >= 0)}.get(kind, b.x[t] == 1)

    with unchanged(contents, m), pytest.raises(type(own)) as caught:
        getattr(b, kind)(raises_halfway)
    assert caught.value is own
    complete(m)


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


OPTIONS = {
    "zero": ({"duration": 0}, "duration = 0; expected a positive number"),
    "bounds from 0": ({"duration": rcp.Duration(bounds=(0, 1))}, "is 0.0; it must be positive"),
    "bad guess": ({"duration": rcp.Duration(bounds=(1, 2), initial_guess=-1)}, "initial guess is -1; it must be pos"),
    "mesh is text": ({"mesh": "fine"}, "mesh = 'fine' is no sequence"),
    "mesh and elements": ({"mesh": [0, 1], "elements": 3}, "elements = 3, but the given mesh has 1"),
    "mesh of a free duration": ({"mesh": [0, 2], "duration": rcp.Duration(bounds=(1, 2))}, "takes a mesh from 0 to 1"),
    "too many stages": ({"scheme": "implicit_euler", "stages": 2}, "'implicit_euler' has 1 stage"),
    "widths from 0": ({"free_element_widths": (0, 2)}, "_widths = (0, 2); expected (smallest, largest) factor"),
    "widths above 1": ({"free_element_widths": (1.5, 2)}, "0 < smallest <= 1 <= largest"),
    "start is text": ({"start": "noon"}, "start = 'noon'; expected a finite number, Start"),
    "start crosses": ({"start": rcp.Start(bounds=(2, 1))}, "start: the lower of its bounds, 2, exceeds the upper, 1"),
}


@pytest.mark.parametrize("case", OPTIONS)
def test_a_phase_without_a_grid_is_not_added(case: str) -> None:
    options, message = OPTIONS[case]
    m = pyo.ConcreteModel()
    with pytest.raises((ModelError, InitialGuessError), match=re.escape(message)) as caught:
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

    b.residual(lambda b, t: [b.z[t] == 1, b.x[t] == b.z[t]], name="twice")
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


def test_declaring_on_many_phases_at_once_is_refused() -> None:
    m = pyo.ConcreteModel()
    m.p = rcp.PhaseBlock([1, 2])
    with pytest.raises(ModelError, match=r"phases 'p': 'x' .* is declared on one phase at a time"):
        m.p.x = rcp.State()
    m.p[1].x = rcp.State()
    assert m.p[2].component("x") is None


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
    _, b = one_phase("go", duration=1.0, elements=2)

    def state_all() -> None:
        b.x, b.u = rcp.State(**state), rcp.Control(**control)
        b.ode(lambda b, t: {b.x: b.u[t]})
        b.integral(rule)

    with pytest.raises(PyRobocopError, match=r"go': .*divides numbers by zero at t = (1|-0\.5) "):
        state_all()
