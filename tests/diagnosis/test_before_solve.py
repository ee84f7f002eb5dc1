"""What `solve` refuses or doubts before it begins: solve, diagnose and verify say the same of one model."""

import math
from collections.abc import Callable
from typing import Any

import pyomo.dae as dae
import pyomo.environ as pyo
import pyomo.gdp as gdp
import pytest
from harness.phases import integrator, with_phase
from harness.small_problems import corner
from pyomo.common.errors import InfeasibleConstraintException

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.diagnosis.diagnose import doubts_before_solve
from pyrobocop_pyomo.errors import ContradictionError, ModelError

pytestmark = pytest.mark.casadi


# -------------------------------------------------------------------- starts


def driven(rule: Callable[[Any, float], Any], fixed: str = "declared", scheme: str = "radau") -> pyo.ConcreteModel:
    """A state that starts at 1, and a rule that holds of it at all points but that one."""
    x = {"initial" if fixed == "declared" else "initial_guess": 1}
    m, b = integrator(x=x, u={"bounds": (-1e3, 1e3)}, elements=4, scheme=scheme)
    if fixed == "fixed":
        b.x[0].fix(1)
    b.constraint(rule, name="limit")
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2 + 1e-3 * (b.x[t] - 1) ** 2))
    return m


def late(b: Any, t: float) -> Any:
    """Violated by 0.5 at the start, and by nothing at any later point."""
    return b.x[t] <= 0.5 + 1e3 * t


@pytest.mark.parametrize("scheme", ["radau", "gauss", "implicit_euler"])
@pytest.mark.parametrize("fixed", ["declared", "fixed"])
def test_a_start_that_breaks_a_constraint_is_refused_and_reported_and_not_verified(fixed: str, scheme: str) -> None:
    m = driven(late, fixed, scheme)
    with pytest.raises(ContradictionError, match="initial values violate constraint 'limit' by 0.5 at t = 0: x = 1"):
        rcp.solve(m)
    assert issubclass(ContradictionError, InfeasibleConstraintException)  # as Pyomo's own writers say it
    (finding,) = rcp.diagnose(m).errors
    assert finding.components == ("p.limit",)
    m.p.limit.deactivate()
    assert rcp.diagnose(m).errors == []  # what is not active is not meant
    assert rcp.solve(m, progress=False).solved
    m.p.limit.activate()
    assert m.p.trajectory().verify().equations == pytest.approx(0.5)


def test_a_rule_that_skips_the_start_says_nothing_of_it() -> None:
    m = driven(lambda b, t: pyo.Constraint.Skip if t == b.initial_time else late(b, t))
    assert rcp.diagnose(m).errors == []
    assert rcp.solve(m, progress=False).doubts == ()
    assert m.p.trajectory().verify().largest_violation < 1e-6


def test_what_is_not_given_is_no_contradiction() -> None:
    m = driven(late, "free")
    assert doubts_before_solve(m) == ()  # a free start
    m = driven(lambda b, t: b.x[t] <= 2)
    m.top = pyo.Var(initialize=0.5)
    m.p.constraint(lambda b, t: b.x[t] <= m.top, name="below")
    assert doubts_before_solve(m) == ()  # a guess is no value
    m.top.fix()
    with pytest.raises(ContradictionError, match=r"x = 1, top = 0.5"):
        rcp.solve(m)


def test_a_start_that_a_link_gives_is_not_judged_by_its_guess() -> None:
    m = driven(lambda b, t: b.x[t] <= 2)
    m.q = b = rcp.PhaseBlock(elements=2)
    b.x = rcp.State(initial_guess=1)
    b.ode(lambda b, t: {b.x: -b.x[t]})
    b.constraint(late, name="limit")
    m.link = rcp.Link(m.p, m.q)
    assert doubts_before_solve(m) == ()


@pytest.mark.parametrize("gap", ["state", "algebraic"])
def test_a_contact_that_starts_inside_is_refused(gap: str) -> None:
    m, b = with_phase("p", "falling", elements=5, scheme="implicit_euler")
    b.y, b.v = rcp.State(initial=-0.2), rcp.State(initial=0)
    b.force = rcp.Algebraic(bounds=(0, None))
    b.ode(lambda b, t: {b.y: b.v[t], b.v: b.force[t] - 9.81})
    if gap == "algebraic":
        b.gap = rcp.Algebraic(bounds=(0, None))
        b.residual(lambda b, t: 2 * b.gap[t] == 2 * b.y[t], name="kinematics")
        b.complementarity(lambda b, t: rcp.complements(b.gap[t], b.force[t]), name="contact")
    else:
        b.complementarity(lambda b, t: rcp.complements(b.y[t] >= 0, b.force[t] >= 0), name="contact")
    with pytest.raises(ContradictionError, match="violate a side of the pair 'contact' by 0.2 at t = 0"):
        rcp.solve(m)
    assert rcp.diagnose(m).errors
    assert b.trajectory().verify().natural_residual >= 0.2 - 1e-9
    b.y[0].fix(0.2)
    assert rcp.diagnose(m).errors == []


def test_a_fixed_value_outside_its_bounds_is_refused() -> None:
    m = driven(lambda b, t: b.x[t] <= 2)
    m.p.x.setub(0.5)
    m.p.x[0].fix(1)
    with pytest.raises(ContradictionError, match=r"'p.x\[0.0\]' is fixed to 1, outside its bounds \(None, 0.5\)"):
        rcp.solve(m)
    assert rcp.diagnose(m).errors


# -------------------------------------------------------------------- what is not transformed


def decaying() -> pyo.ConcreteModel:
    m = pyo.ConcreteModel("decaying")
    m.t = dae.ContinuousSet(bounds=(0, 1))
    m.x = pyo.Var(m.t, initialize=1)
    m.dx = dae.DerivativeVar(m.x, wrt=m.t, initialize=0)
    m.decay = pyo.Constraint(m.t, rule=lambda m, t: m.dx[t] == -m.x[t])
    m.x[0].fix(1)
    return m


def chosen() -> pyo.ConcreteModel:
    m = pyo.ConcreteModel("chosen")
    m.x = pyo.Var(bounds=(0, 3), initialize=1)
    m.either = gdp.Disjunction(expr=[[m.x >= 1], [m.x <= 0.5]])
    m.cost = pyo.Objective(expr=(m.x - 0.7) ** 2)
    return m


WAYS = {
    "solve": lambda m: rcp.solve(m, progress=False),
    "pyrobocop.mpcc": lambda m: pyo.SolverFactory("pyrobocop.mpcc").solve(m),
    "pyrobocop.ipopt": lambda m: pyo.SolverFactory("pyrobocop.ipopt").solve(m),
    "vectorised": lambda m: pyo.SolverFactory("pyrobocop.ipopt", derivatives="vectorised").solve(m),
    "diagnose": lambda m: rcp.diagnose(m).raise_for_errors(),
}


@pytest.mark.parametrize("way", WAYS)
def test_a_model_of_pyomo_dae_that_was_not_discretised_is_refused(way: str) -> None:
    said = (
        r"ContinuousSet 't' was not discretised: nothing ties 'dx'.*'pyrobocop.collocation'.*wrt=m.t.*'dae.collocation'"
    )
    with pytest.raises(ModelError, match=said):
        WAYS[way](decaying())


@pytest.mark.parametrize("name", ["pyrobocop.collocation", "dae.collocation"])
def test_once_discretised_it_is_solved_and_nothing_is_doubted(name: str) -> None:
    m = decaying()
    pyo.TransformationFactory(name).apply_to(m, wrt=m.t, nfe=5, ncp=3)
    assert rcp.solve(m, progress=False).doubts == ()
    assert m.x[1].value == pytest.approx(math.exp(-1), abs=1e-6)


def test_a_continuous_set_without_derivatives_is_a_set() -> None:
    m = decaying()
    m.del_component(m.decay)
    m.del_component(m.dx)
    m.decay = pyo.Constraint(m.t, rule=lambda m, t: m.x[t] == 1)
    assert rcp.solve(m, progress=False).solved


@pytest.mark.parametrize("way", WAYS)
def test_a_disjunction_is_refused_with_what_takes_it(way: str) -> None:
    with pytest.raises(ModelError, match=r"'either'.* pyomo.gdp.*'gdp.bigm'.*SolverFactory\('gdpopt'\)"):
        WAYS[way](chosen())


@pytest.mark.parametrize("way", ["pyrobocop.ipopt", "vectorised"])
def test_pairs_are_refused_where_only_constraints_are_seen(way: str) -> None:
    m = corner((1, 2))
    with pytest.raises(ModelError, match=r"'pair' holds pairs.*'pyrobocop.mpcc'.*'pyrobocop.relax_complementarity'"):
        WAYS[way](m)
    WAYS["pyrobocop.mpcc"](m)
    assert m.x.value * m.y.value == pytest.approx(0, abs=1e-7)


@pytest.mark.parametrize("way", ["pyrobocop.ipopt", "vectorised", "solve"])
def test_discrete_variables_are_refused_with_what_takes_them(way: str) -> None:
    m = pyo.ConcreteModel("whole")
    m.n = pyo.Var(domain=pyo.Integers, bounds=(0, 3), initialize=1)
    m.cost = pyo.Objective(expr=(m.n - 1.2) ** 2)
    with pytest.raises(ModelError, match=r"1 discrete variables \('n'\).*mixed-integer solver.*Control\(integer="):
        WAYS[way](m)


@pytest.mark.parametrize("keyword", ["within", "domain"])
def test_the_domain_of_a_control_is_called_integer(keyword: str) -> None:
    with pytest.raises(ModelError, match=rf"no keyword '{keyword}'. Write integer=\(0, 1\)"):
        rcp.Control(**{keyword: pyo.Integers})
    with pytest.raises(ModelError, match=rf"no keyword '{keyword}'. Write bounds="):
        rcp.State(**{keyword: pyo.NonNegativeReals})


# -------------------------------------------------------------------- phases that nothing joins


def thrown(*, start: Any = None, gain: bool = False) -> pyo.ConcreteModel:
    """Two phases whose objective is one sum; the second one is to end at 1."""
    m = pyo.ConcreteModel("thrown")
    m.gain = pyo.Var(initialize=1.0, bounds=(0.5, 2))
    m.first, m.second = rcp.PhaseBlock(elements=3), rcp.PhaseBlock(elements=3)
    m.first.x, m.second.x = rcp.State(initial=0), rcp.State(initial=start, final=1)
    for b in (m.first, m.second):
        b.u = rcp.Control()
        b.ode(lambda b, t: {b.x: b.u[t] * (m.gain if gain else 1)})
    m.cost = pyo.Objective(expr=sum(b.integral(lambda b, t: b.u[t] ** 2) for b in (m.first, m.second)) + m.gain)
    return m


def test_a_forgotten_link_is_doubted_in_the_first_lines() -> None:
    m = thrown()
    result = rcp.solve(m, progress=False)
    assert result.objective == pytest.approx(0.5, abs=1e-6)  # of the gain alone: nothing has to move
    first, second, *_ = str(result).splitlines()
    assert first.startswith("thrown: ")
    assert second.startswith("DOUBTFUL: nothing joins the phases 'first' and 'second'")
    assert "rcp.Link(m.first, m.second)" in second
    assert [finding.message for finding in rcp.diagnose(m).findings] == [result.doubts[0].message]


def with_link(m: Any) -> None:
    m.link = rcp.Link(m.first, m.second)


def with_row(m: Any) -> None:
    m.row = pyo.Constraint(expr=m.first.x.at_end == m.second.x.at_start)


def with_pair(m: Any) -> None:
    m.pair = rcp.Complementarity(expr=rcp.complements(m.first.x[1] >= 0, m.second.x[0] >= 0))


@pytest.mark.parametrize("join", [with_link, with_row, with_pair])
def test_a_link_a_row_or_a_pair_joins(join: Callable[[Any], None]) -> None:
    m = thrown()
    join(m)
    assert doubts_before_solve(m) == ()


def test_a_variable_that_both_hold_joins_while_it_is_free() -> None:
    m = thrown(gain=True)
    assert doubts_before_solve(m) == ()
    m.gain.fix()
    assert len(doubts_before_solve(m)) == 1


@pytest.mark.parametrize("start", [0.5, (0, 1)])
def test_phases_with_starts_of_their_own_are_meant_apart(start: Any) -> None:
    assert doubts_before_solve(thrown(start=start)) == ()


def test_a_periodic_phase_beside_another_is_meant_apart() -> None:
    m = thrown()
    m.again = rcp.Link(m.second, m.second)
    assert doubts_before_solve(m) == ()


# -------------------------------------------------------------------- variables that are left


def tanks(count: int, given: int, objective: Any = None) -> pyo.ConcreteModel:
    """As many tanks one after the other, some of whose levels are given at first."""
    m = pyo.ConcreteModel("tanks")
    m.t = dae.ContinuousSet(bounds=(0, 1))
    m.level = pyo.Var(range(count), m.t, initialize=1)
    m.rate = dae.DerivativeVar(m.level, wrt=m.t, initialize=0)
    m.flow = pyo.Constraint(
        range(count),
        m.t,
        rule=lambda m, i, t: m.rate[i, t] == (m.level[i - 1, t] if i else 0) - m.level[i, t],
    )
    pyo.TransformationFactory("dae.collocation").apply_to(m, wrt=m.t, nfe=3, ncp=2)
    for i in range(given):
        m.level[i, 0].fix(1)
    if objective is not None:
        m.cost = pyo.Objective(expr=objective)
    return m


@pytest.mark.parametrize("given", [0, 1, 3])
@pytest.mark.parametrize(("objective", "said"), [(None, "there is no objective"), (0, "'cost' is constant")])
def test_without_an_objective_what_is_left_is_counted_and_named(given: int, objective: Any, said: str) -> None:
    (doubt,) = rcp.solve(tanks(4, given, objective), progress=False).doubts
    count = 4 - given
    assert said in doubt.message
    assert f"{count} variable{'s are' if count > 1 else ' is'} left" in doubt.message
    assert doubt.components == ("level",)
    assert f"'level[{given},0" in doubt.message  # the start, and not what follows from it


@pytest.mark.parametrize("objective", [None, 0])
def test_nothing_is_left_where_all_is_given_or_an_objective_chooses(objective: Any) -> None:
    assert rcp.solve(tanks(3, 3, objective), progress=False).doubts == ()
    m = tanks(3, 0)
    m.cost = pyo.Objective(expr=sum(m.level[i, 1] ** 2 for i in range(3)))
    assert doubts_before_solve(m) == ()


@pytest.mark.ipopt
def test_without_an_objective_too_many_equations_are_counted_and_named() -> None:
    m = tanks(3, 3)
    assert doubts_before_solve(m) == ()
    m.more = pyo.Constraint(expr=m.level[0, 1] == pyo.exp(-1))
    m.none = pyo.Constraint(expr=m.level[0, 0] == 1)  # all of it is fixed: judged by its values
    result = rcp.solve(m, progress=False)
    (doubt,) = result.doubts
    second = str(result).splitlines()[1]
    assert second.startswith("DOUBTFUL: there is no objective, and 13 equations hold only 12 variables")
    assert set(doubt.components) == {"more", "flow", "rate_disc_eq"}  # nothing of the other two tanks
    m.more.deactivate()
    assert doubts_before_solve(m) == ()


def test_a_complementarity_problem_is_square() -> None:
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(3), initialize=1, bounds=(0, None))
    m.pairs = rcp.Complementarity(range(3), rule=lambda m, i: rcp.complements(m.x[i], m.x[i] + m.x[(i + 1) % 3] >= i))
    assert doubts_before_solve(m) == ()


@pytest.mark.parametrize("objective", [None, 0])
def test_controls_are_there_to_be_chosen_and_lost_starts_are_not(objective: Any) -> None:
    def model(start: Any) -> pyo.ConcreteModel:
        m, b = with_phase("p", "feasible", elements=3, duration=rcp.Duration(bounds=(0.5, 2)))
        b.x, b.y = rcp.State(initial=0, final=1), rcp.State(initial=start)
        b.twice, b.u = rcp.Algebraic(), rcp.Control(bounds=(-3, 3))
        b.ode(lambda b, t: {b.x: b.u[t], b.y: b.twice[t]})
        b.residual(lambda b, t: b.twice[t] == 2 * b.x[t])
        if objective is not None:
            m.cost = pyo.Objective(expr=objective)
        return m

    choice = [doubt for doubt in doubts_before_solve(model(0)) if "'p.u' may be chosen" not in doubt.message]
    assert choice == []
    *_, doubt = doubts_before_solve(model(None))
    assert "1 variable is left" in doubt.message
    assert "'p.y[0.0]'" in doubt.message


def reaching(*stages: str) -> pyo.ConcreteModel:
    """One state of each phase has to get from 0 to 1 at the least effort, which is 1 over its duration."""
    m = pyo.ConcreteModel("reaching")
    for stage in stages:
        b = rcp.PhaseBlock(elements=4)
        m.add_component(stage, b)
        b.x, b.y = (
            rcp.State(initial=0 if stage == stages[0] else None),
            rcp.State(initial=0 if len(stages) == 1 else None),
        )
        b.u = rcp.Control(bounds=(-5, 5))
        b.ode(lambda b, t: {b.x: b.u[t], b.y: b.x[t]})
    b.x[1].fix(1)
    m.cost = pyo.Objective(expr=sum(m.component(each).integral(lambda b, t: b.u[t] ** 2) for each in stages))
    return m


def without_cost(m: Any) -> None:
    m.del_component(m.cost)


def fixed_only(m: Any) -> None:
    m.cost.set_value(m.a.x[0] ** 2 + m.a.x[1])


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (without_cost, "there is no objective"),
        (lambda m: m.cost.deactivate(), "the objective 'cost' is deactivated"),
        (lambda m: m.cost.set_value(3.0), "objective 'cost' is the number 3.0: it holds no variable."),
        (fixed_only, "objective 'cost' is the number 1.0: it holds no variable that is not fixed."),
    ],
)
def test_an_objective_that_chooses_nothing_is_doubted_in_the_first_lines(spoil: Any, said: str) -> None:
    m = reaching("a")
    assert doubts_before_solve(m) == ()
    spoil(m)
    result = rcp.solve(m, progress=False)
    assert str(result).splitlines()[1].startswith(f"DOUBTFUL: {said}")
    assert rcp.diagnose(m).findings == result.doubts


@pytest.mark.parametrize("off", ["a", "b"])
def test_a_deactivated_phase_that_is_read_is_doubted(off: str) -> None:
    """At 0.5 the effort of both is least; without the equations of one of them it is 0."""
    m = reaching("a", "b")
    m.link = rcp.Link(m.a, m.b)
    m.component(off).deactivate()
    (doubt,) = doubts_before_solve(m)
    assert f"phase '{off}' is deactivated" in doubt.message
    assert doubt.components == (off, "cost", "link.continuity")
    m.link.deactivate()
    m.cost.set_value(m.a.integral(lambda b, t: b.u[t] ** 2))
    assert [found.components for found in doubts_before_solve(m)] == ([("a", "cost")] if off == "a" else [])


@pytest.mark.parametrize(
    ("keywords", "left"),
    [
        ({}, []),
        ({"states": ["x"]}, ["'y'"]),
        ({"states": ["x"], "jump": lambda pre, post: {"y": 2 * pre.y}}, []),
        ({"jump": lambda pre, post: post.x + post.y == pre.x}, ["'y'"]),
        ({"jump": lambda pre, post: [post.x + post.y == pre.x, post.x - post.y == pre.y]}, []),
        ({"jump": lambda pre, post: post.y >= pre.y}, []),
        ({"omit": ["y"]}, []),
    ],
)
def test_a_start_that_a_link_leaves_open_is_doubted_unless_it_is_omitted(keywords: Any, left: list[str]) -> None:
    m = reaching("a", "b")
    m.a.y[0].fix(0)
    m.link = rcp.Link(m.a, m.b, **keywords)
    doubts = [doubt.message.partition(" without")[0] for doubt in doubts_before_solve(m)]
    assert doubts == [f"link 'link' leaves {name} of 'b'" for name in left]
    m.rest = rcp.Link(m.a, m.b, states=["y"])
    assert doubts_before_solve(m) == ()


@pytest.mark.parametrize("kind", ["constraint", "complementarity", "constraint_at_boundaries"])
@pytest.mark.parametrize("normalised", [False, True])
def test_a_rule_that_skips_every_point_is_refused_unless_it_never_looks_at_the_time(
    kind: str, normalised: bool
) -> None:
    _, b = with_phase("p", duration=rcp.Duration(bounds=(0.5, 2)) if normalised else 1.0, elements=4)
    b.x = rcp.State(initial=0)
    b.ode(lambda b, t: {b.x: 1.0})
    state = getattr(b, kind)
    with pytest.raises(ModelError, match="'late' states nothing: it skips all .* points"):
        state(lambda b, t: b.x[t] <= 0.1 if t == 0.37 else pyo.Constraint.Skip, name="late")
    assert b.component("late") is None
    state(lambda b, t: pyo.Constraint.Skip, name="off")
    assert len(b.off) == 0


def test_bounds_that_were_made_to_cross_are_named() -> None:
    m = driven(lambda b, t: pyo.Constraint.Skip)
    for variable in m.p.u.values():
        variable.setlb(2e3)
    with pytest.raises(ContradictionError, match=r"'p\.u\[.*lower bound 2000 above the upper 1000, and at 11 more ind"):
        rcp.solve(m)
