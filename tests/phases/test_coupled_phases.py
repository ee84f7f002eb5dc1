"""A phase whose rules read another phase is verified with the values of that phase at the same instants."""

import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp

READ = {
    "closure": lambda m, b: m.body,
    "parent block": lambda m, b: b.parent_block().body,
    "model": lambda m, b: b.model().body,
}


def carried(read: str = "closure", scheme: str = "radau", stages: int | None = 3, elements: int = 4, **other):
    """A body with x' = v, and a robot with y' = x + w and d = x - y, which reads x of the body."""
    m = pyo.ConcreteModel()
    grid = {"duration": 2.0, "elements": elements, "scheme": scheme, "stages": stages}
    m.body = b = rcp.PhaseBlock(**{**grid, **other})
    b.x, b.v = rcp.State(initial=1.0), rcp.Control()
    b.ode(lambda b, t: {b.x: b.v[t]})
    m.me = r = rcp.PhaseBlock(**grid)
    r.y, r.d, r.w = rcp.State(initial=0.0), rcp.Algebraic(), rcp.Control()
    of = READ[read]
    r.ode(lambda r, t: {r.y: of(m, r).x[t] + r.w[t]})

    r.residual(lambda r, t: r.d[t] == of(m, r).x[t] - r.y[t], name="distance")

    r.constraint(lambda r, t: of(m, r).v[t] + r.w[t] <= 10.0, name="speeds")

    @r.complementarity
    def pushing(r, t):
        return rcp.complements(r.d[t] + r.y[t] - of(m, r).x[t] + 1.0 >= 0, r.w[t] + 3.0 - of(m, r).v[t] >= 0)

    return m


def two(grid, **other):
    m = pyo.ConcreteModel()
    m.body, m.me = rcp.PhaseBlock(**grid), rcp.PhaseBlock(**{**grid, **other})
    return m


def set_exactly(m, speed: float) -> None:
    """With v = c and w = c - 3, where the second side of the pair is zero: x = 1 + c t, and y' = x + w."""
    m.body.initialize(x=lambda t: 1.0 + speed * t, v=speed)
    m.me.initialize(w=speed - 3.0, y=lambda t: t + speed * t**2 / 2 + (speed - 3.0) * t)
    m.me.d.set_values({t: m.body.x[t].value - m.me.y[t].value for t in m.me.d})


def values(m) -> list:
    return [(v.name, v.value, v.stale) for v in m.component_data_objects(pyo.Var)]


@pytest.mark.parametrize("read", READ)
@pytest.mark.parametrize(("scheme", "stages"), [("radau", 3), ("gauss", 2), ("lobatto", 3)])
def test_what_stands_on_the_model_is_verified_between_the_points_too(read, scheme, stages):
    m = carried(read, scheme, stages)
    set_exactly(m, 5.0)
    verification = m.me.trajectory().verify()
    assert verification.largest_violation < 1e-12
    assert verification.remarks == ()
    assert not verification.bounds_passed
    assert verification.element_error < 1e-8
    assert verification.horizon_error < 1e-8


@pytest.mark.parametrize("read", READ)
def test_another_plan_on_the_model_is_not_mixed_with_the_trajectory(read):
    m = carried(read)
    set_exactly(m, 5.0)
    mine = m.me.trajectory()
    set_exactly(m, -4.0)
    before = values(m)
    alone = mine.verify()
    assert alone.largest_violation < 1e-12
    assert alone.element_error is None
    assert len(alone.remarks) == 4
    assert all("body" in remark and "initialize both" in remark for remark in alone.remarks)
    assert values(m) == before


def test_a_jump_at_an_element_boundary_belongs_to_the_element_that_is_integrated():
    m = two({"duration": 2.0, "elements": 4, "scheme": "implicit_euler"})
    m.body.force = rcp.Control()
    m.me.v = rcp.State(initial=0.0)
    m.me.ode(lambda r, t: {r.v: m.body.force[t]})
    speed = 0.0
    for i, t in enumerate(m.body.points):
        m.body.force[t].set_value((-1.0) ** i)
        speed += 0.5 * (-1.0) ** i
        m.me.v[t].set_value(speed)
    m.me.v[0.0].set_value(0.0)
    verification = m.me.trajectory().verify()
    assert verification.largest_violation < 1e-12
    assert verification.element_error < 1e-12


def test_fixed_instants_and_parameters_are_those_of_the_trajectories():
    m = two({"duration": 1.0, "elements": 2})
    m.body.x, m.me.y, m.me.k = rcp.State(), rcp.State(), rcp.Parameter()
    m.body.ode(lambda b, t: {b.x: 0.0})
    m.me.ode(lambda r, t: {r.y: m.body.x[0.0] * m.me.k})

    def put(x, k):
        m.body.initialize(x=x)
        m.me.initialize(k=k, y=lambda t: x * k * t)

    put(2.0, 3.0)
    before = values(m)
    assert m.me.trajectory().verify().defect < 1e-12
    assert values(m) == before


def test_a_simulation_reads_the_other_phase_between_the_points():
    m = two({"duration": 2.0, "elements": 4})
    m.body.x, m.me.y = rcp.State(), rcp.State(initial=0.0)
    m.body.ode(lambda b, t: {b.x: 5.0})
    m.me.ode(lambda r, t: {r.y: m.body.x[t]})
    m.body.initialize(x=lambda t: 1.0 + 5.0 * t)
    trajectory = m.me.simulate()
    assert trajectory.states["y"][-1] == pytest.approx(2.0 + 5.0 * 2.0, rel=1e-8)


def test_a_phase_of_another_grid_is_read_at_common_times_only_and_said_so():
    m = two({"duration": 2.0, "elements": 4, "scheme": "implicit_euler"}, elements=2)
    m.body.x, m.me.y = rcp.State(), rcp.State()
    m.body.ode(lambda b, t: {b.x: 1.0})
    m.me.ode(lambda r, t: {r.y: m.body.x[t]})
    m.body.initialize(x=lambda t: t)
    m.me.initialize(y=lambda t: t * (t + 1.0) / 2)
    verification = m.me.trajectory().verify()
    assert verification.defect < 1e-12
    assert verification.element_error is None
    assert any("between the points" in remark for remark in verification.remarks)
    mine = m.me.trajectory()
    m.body.initialize(x=7.0)
    m.me.initialize(y=7.0)
    again = mine.verify()
    assert again.defect < 1e-12
    assert any("body" in remark for remark in again.remarks)
