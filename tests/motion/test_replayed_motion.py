"""Safe is said of motions under the controls only that were followed everywhere; else it is said why they were not."""

from typing import Any

import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp

BALL = rcp.Polytope.ball(0.05, (0.0, 0.0))
WALL = {"wall": rcp.Polytope.box(6.0, 0.2, center=(0.5, 0.4))}
NARROW = 1e-4  # of an element's way of 0.125


def beside_the_wall(points: Any, obstacles: Any = None, **options: Any) -> Any:
    return rcp.ObstacleAvoidanceBlock(
        points,
        body=BALL,
        pose=lambda b, t: rcp.planar_pose(b.x[t], b.y[t]),
        obstacles=obstacles or WALL,
        clearance=0.05,
        **options,
    )


def drift(rate: Any, **start: Any) -> Any:
    """A ball that drives along a wall at speed one, and is moved to the side."""
    m = pyo.ConcreteModel(name="drift")
    m.move = b = rcp.PhaseBlock(duration=1.0, elements=8, scheme="radau", stages=2)
    b.x, b.y = rcp.State(initial=0.0), rcp.State(initial=0.0)
    b.u = rcp.Control(initial_guess=0.0)
    b.ode(lambda b, t: {b.x: 1.0, b.y: b.u[t] + rate(b, t)}, name="motion")
    b.avoid = beside_the_wall(b.time)
    b.x[:].set_value(0.0)
    for t in b.time:
        b.x[t].set_value(t)
        b.y[t].set_value(0.0)
    return m


JET = rcp.Function(lambda X: 600.0 * (abs(X - 0.43) < NARROW)[:, 0], lambda X: 0.0 * X, name="jet")
TABLE = rcp.Table(
    [0.43 + k * NARROW for k in range(-3, 4)], [0.0, 0, 0, 600.0, 0, 0, 0], outside="constant", name="gusts"
)
NARROW_PLACES = {
    "formula": lambda b, t: 600.0 * pyo.exp(-(((b.x[t] - 0.43) / NARROW) ** 2)),
    "formula at an instant": lambda b, t: 600.0 * pyo.exp(-(((b.x[t] - 0.4375) / NARROW) ** 2)),
    "condition": lambda b, t: pyo.Expr_if(pyo.inequality(0.43, b.x[t], 0.43 + NARROW), 600.0, 0.0),
    "two steps": lambda b, t: (
        300.0 * (pyo.tanh((b.x[t] - 0.43) / NARROW) - pyo.tanh((b.x[t] - 0.43 - NARROW) / NARROW))
    ),
    "two conditions": lambda b, t: (
        pyo.Expr_if(b.x[t] >= 0.43, 600.0, 0.0) * pyo.Expr_if(b.x[t] <= 0.43 + NARROW, 1.0, 0.0)
    ),
    "three kinks": lambda b, t: (
        6e6 * (abs(b.x[t] - 0.43 + NARROW) - 2 * abs(b.x[t] - 0.43) + abs(b.x[t] - 0.43 - NARROW))
    ),
    "of a control": lambda b, t: 600.0 * pyo.exp(-(((b.u[t] + b.x[t] - 0.43) / NARROW) ** 2)),
    "function in Python": lambda b, t: JET(b.x[t]),
    "narrow table": lambda b, t: TABLE(b.x[t]),
    "branch on the time": lambda b, t: 600.0 if abs(t - 0.43) < NARROW else 0.0,
}


@pytest.mark.parametrize("place", NARROW_PLACES)
def test_what_may_be_passed_between_two_instants_is_not_called_safe(place: str) -> None:
    report = drift(NARROW_PLACES[place]).move.avoid.verify()
    assert report.safe is not True
    assert report.safe is False or "phase 'move'" in report.not_replayed


@pytest.mark.parametrize(
    "rate",
    [
        lambda b, t: -0.5 * b.y[t] + 0.1 * pyo.sin(5 * b.x[t]),
        lambda b, t: -0.1 * abs(b.y[t] - 0.01) * b.x[t] ** 2 / (1 + b.y[t] ** 2),
        lambda b, t: 0.02 * pyo.tanh((b.x[t] - 0.43) / 1e-3),  # one step is no jet
        lambda b, t: pyo.Expr_if(b.x[t] >= 0.43, 0.02, 0.0),
        lambda b, t: 0.01 * rcp.Table([0.0, 0.5, 1.0, 1.5], [0.0, 1.0, 0.0, 1.0])(b.x[t]),
    ],
    ids=["smooth", "kink", "steep step", "one condition", "table"],
)
def test_what_shows_at_instants_is_called_safe(rate: Any) -> None:
    m = drift(rate)
    m.move.initialize(m.move.simulate())
    assert m.move.avoid.verify().safe is True


def euler(kind: str) -> Any:
    """The plain points, or the set of pyomo.dae, of a body between two walls that a spring drives."""
    m = pyo.ConcreteModel(name=kind)
    points = [0.1 * k for k in range(11)]
    m.x, m.y, m.u = (pyo.Var(points, initialize=0.0) for _ in range(3))
    if kind == "points":
        m.euler = pyo.Constraint(
            range(1, 11), rule=lambda m, k: m.y[0.1 * k] == m.y[0.1 * (k - 1)] + 0.1 * m.u[0.1 * k]
        )
    else:
        m.sums = pyo.Constraint(range(11), rule=lambda m, k: m.y[0.1 * k] == 0.1 * sum(m.u[0.1 * j] for j in range(k)))
    m.avoid = beside_the_wall(points)
    m.cost = pyo.Objective(expr=sum((m.y[t] - 0.3) ** 2 + m.x[t] ** 2 + 0.01 * m.u[t] ** 2 for t in points))
    return m


@pytest.mark.ipopt
@pytest.mark.parametrize("kind", ["points", "sums"])
def test_rows_between_points_are_a_motion_that_nobody_follows(kind: str) -> None:
    m = euler(kind)
    result = rcp.solve(m, progress=False)
    assert result.solved
    assert result.safe is None
    assert "solved, clear along straight lines; the motion under the controls was not replayed" in str(result)
    solver = pyo.SolverFactory("pyrobocop.mpcc")
    assert "clear along straight lines" in solver.solve(m).solver.message


def test_points_that_are_chosen_freely_are_the_motion() -> None:
    """A start, a goal, and limits of steps leave the way free: what goes along the lines goes by the plan."""
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var([0.0, 1.0, 2.0], initialize=lambda m, t: t), pyo.Var([0.0, 1.0, 2.0], initialize=0.0)
    m.start = pyo.Constraint(expr=m.x[0.0] == 0.0)
    m.goal = pyo.Constraint(expr=m.x[2.0] + m.y[2.0] == 2.0)
    m.step = pyo.Constraint(expr=m.x[1.0] - m.x[0.0] <= 1.5)
    m.avoid = beside_the_wall([0.0, 1.0, 2.0])
    assert m.avoid.verify().safe is True
    assert str(m.avoid.verify()).startswith("safe along straight lines")
    m.joined = pyo.Constraint(expr=m.x[1.0] == m.x[0.0] + m.y[1.0] + 1.0)
    assert m.avoid.verify().safe is None


def test_a_trajectory_alone_is_clear_at_best() -> None:
    """A guess that nobody solved, and that its equations would leave at once."""
    m = drift(lambda b, t: 5.0 + 0.0 * b.y[t])
    body = rcp.Body(BALL, pose=lambda b, t: rcp.planar_pose(b.x[t], b.y[t]))
    report = rcp.verify_motion(m.move.trajectory(), bodies={"ball": body}, obstacles=WALL, clearance=0.05)
    assert report.safe is None
    assert "a trajectory has no equations" in str(report).splitlines()[0]
    assert m.move.avoid.verify().safe is False


def two_phases(link: dict[str, Any], *, goes_on: bool = True) -> Any:
    m = pyo.ConcreteModel(name="two")
    for name in ("one", "two"):
        start = {"start": m.one} if goes_on and name == "two" else {}
        b = rcp.PhaseBlock(duration=1.0, elements=4, scheme="radau", stages=2, **start)
        m.add_component(name, b)
        b.x, b.y, b.v = rcp.State(initial_guess=0.0), rcp.State(initial_guess=0.0), rcp.State(initial_guess=0.0)
        b.a = rcp.Control(initial_guess=0.0)
        b.ode(lambda b, t: {b.x: b.v[t], b.y: 0.0, b.v: b.a[t]})
    m.link = rcp.Link(m.one, m.two, **link)
    for b in (m.one, m.two):
        b.initialize(**dict.fromkeys("xyva", 0.0))
    return m


@pytest.mark.parametrize(("link", "jump"), [({"omit": ["x"]}, True), ({}, False), ({"jump": "x"}, False)])
def test_a_position_that_a_link_leaves_free_may_jump(link: dict[str, Any], jump: bool) -> None:
    if "jump" in link:
        link = {"jump": lambda pre, post: {"x": pre.x + 0.6}}
    m = two_phases(link)
    m.two.avoid = beside_the_wall(m.two.time)
    assert m.two.avoid.verify().safe is not False
    for t in m.two.time:
        m.two.x[t].set_value(0.6)
    report = m.two.avoid.verify()
    assert (report.safe is None and "jumps by 0.6" in report.not_replayed) is jump


@pytest.mark.parametrize(("goes_on", "safe"), [(False, None), (True, True)])
def test_a_clock_that_starts_anew_beside_a_moving_obstacle_is_no_known_motion(goes_on: bool, safe: Any) -> None:
    m = two_phases({}, goes_on=goes_on)
    door = {"door": rcp.Body(BALL, pose=lambda b, t: rcp.planar_pose(3.0, b.time_at(t)))}
    m.two.avoid = beside_the_wall(m.two.time, door)
    report = m.two.avoid.verify()
    assert report.safe is safe
    assert safe or "its time starts anew" in str(report).splitlines()[0]


@pytest.mark.ipopt
def test_the_best_of_several_starts_is_judged_as_it_stands_on_the_model() -> None:
    m = drift(lambda b, t: -0.5 * b.y[t])
    m.cost = pyo.Objective(expr=m.move.integral(lambda b, t: 10.0 * (b.y[t] - 0.3) ** 2 + 0.01 * b.u[t] ** 2))
    found = rcp.studies.multistart(m, 3, seed=2, progress=False)
    assert found.result.safe is True
    assert "CHANGED" not in str(found.result)
    assert str(m.move.avoid.verify()) == str(found.result.safety)
    assert found.load(1).safe is True
    m.move.y[1.0].set_value(0.1)
    assert found.result.safe is None
