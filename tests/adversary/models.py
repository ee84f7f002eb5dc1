"""Problems for the adversary: small, solved as they stand, and stated by functions that build them anew each time."""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

import pyomo.environ as pyo
from pyomo.dae import ContinuousSet, DerivativeVar, Integral

import pyrobocop_pyomo as rcp

ROOT = Path(__file__).parents[2]


def _script(path: str) -> ModuleType:
    """A file outside of the tests, under a name of its own: some benchmarks and examples have names in common."""
    name = "adversary_" + path.replace("/", "_")
    if name not in sys.modules:
        found = spec_from_file_location(name, ROOT / f"{path}.py")
        assert found is not None
        assert found.loader is not None
        sys.modules[name] = module_from_spec(found)
        found.loader.exec_module(sys.modules[name])
    return sys.modules[name]


restated = _script("benchmarks/restated_problems")
ACCELERATION, LENGTH, SPEED = restated.ACCELERATION, restated.LENGTH, restated.SPEED
Restated, Units = restated.Restated, restated.Units


@dataclass(frozen=True)
class Problem:
    """A problem whose answer is known by solving it.

    Attributes
    ----------
    name : str
    build : callable
        Makes the model, ready to be solved.
    in_units : callable or None
        The same in units chosen, with the dimension of its objective.
    convex : bool
        Whether there is one optimum.
    undiscretised : callable or None
        The same before its transformation.
    """

    name: str
    build: Callable[[], pyo.ConcreteModel]
    in_units: Callable[[Any], tuple[pyo.ConcreteModel, tuple[int, int, int]]] | None = None
    convex: bool = False
    undiscretised: Callable[[], pyo.ConcreteModel] | None = None

    @property
    def answer(self) -> rcp.SolveResult:
        """The result of the problem as it stands."""
        return _answer(self)


@cache
def _answer(problem: Problem) -> rcp.SolveResult:
    result = rcp.solve(problem.build(), progress=False)
    assert result.solved, f"{problem.name} is no problem for the adversary: {result}"
    return result


def objective_of(model: pyo.ConcreteModel) -> Any:
    """The one active objective."""
    (found,) = model.component_data_objects(pyo.Objective, active=True)
    return found


# ---------------------------------------------------------------------------------------- with units


def lift(units: Any) -> tuple[pyo.ConcreteModel, tuple[int, int, int]]:
    """A mass that rests on the floor is lifted: a pair of gap and force."""
    p = Restated(units, 2, elements=8, scheme="implicit_euler")
    p.declare(rcp.State, LENGTH, height={"initial": 0, "final": 0.5, "bounds": (0, None)})
    p.declare(rcp.State, SPEED, speed={"initial": 0, "final": 0})
    p.declare(rcp.Algebraic, ACCELERATION, force={"bounds": (0, None)})
    p.declare(rcp.Control, ACCELERATION, thrust={"bounds": (0, 15)})
    p.ode(lambda v: {"height": v.speed, "speed": v.thrust + v.force - 9.81})
    p.pairs(lambda v: [(v.height, LENGTH, v.force, ACCELERATION)])
    p.model.cost = pyo.Objective(expr=p.integral(lambda v: v.thrust**2, (2, -4, 0)))
    return p.model, (2, -3, 0)


def regulator(units: Any) -> tuple[pyo.ConcreteModel, tuple[int, int, int]]:
    """A linear system with a quadratic cost and bounds that are active."""
    p = Restated(units, 2, elements=8)
    p.declare(rcp.State, LENGTH, x={"initial": 1}, y={"initial": -0.5, "bounds": (-2, 2)})
    p.declare(rcp.Control, SPEED, u={"bounds": (-1, 1)})
    p.ode(lambda v: {"x": v.y + v.u, "y": 0.5 * v.x - v.y})
    p.constraint("together", LENGTH, lambda v: (-0.4, v.x + 2 * v.y, None))
    p.model.cost = pyo.Objective(expr=p.integral(lambda v: v.x**2 + v.y**2 + 0.1 * v.u**2, (2, 0, 0)))
    return p.model, (2, 1, 0)


# ---------------------------------------------------------------------------------------- other kinds


def two_legs() -> pyo.ConcreteModel:
    """Two phases with one clock each, joined by a link."""
    m = pyo.ConcreteModel(name="two legs")
    for name, ends, limit in (("first", {"initial": 0}, 3.0), ("second", {"final": 2}, 6.0)):
        setattr(m, name, rcp.PhaseBlock(duration=1, elements=6))
        b = getattr(m, name)
        b.x = rcp.State(**ends)
        b.v = rcp.State(**dict.fromkeys(ends, 0))
        b.u = rcp.Control(bounds=(-limit, limit))
        b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] - 0.1 * b.v[t]})
    m.link = rcp.Link(m.first, m.second)
    m.cost = pyo.Objective(expr=sum(b.integral(lambda b, t: b.u[t] ** 2) for b in (m.first, m.second)))
    return m


def fit() -> pyo.ConcreteModel:
    """Two parameters of a decay from noisy samples."""
    m = pyo.ConcreteModel(name="fit")
    m.p = b = rcp.PhaseBlock(duration=2, mesh=[0, 0.25, 0.5, 1, 1.5, 2])
    b.x = rcp.State(initial=2, initial_guess=1)
    b.rate, b.source = rcp.Parameter(bounds=(0, 5), initial_guess=1), rcp.Parameter(bounds=(-1, 1), initial_guess=0)
    b.ode(lambda b, t: {b.x: b.source - b.rate * b.x[t]})
    samples = {0.25: 1.62, 0.5: 1.29, 1: 0.87, 1.5: 0.55, 2: 0.44}
    m.cost = pyo.Objective(expr=sum((b.x[t] - seen) ** 2 for t, seen in samples.items()))
    return m


def quadratic_program() -> pyo.ConcreteModel:
    """No time at all."""
    m = pyo.ConcreteModel(name="quadratic program")
    m.x = pyo.Var(range(5), bounds=(-3, 3), initialize=0.5)
    x = m.x
    m.cost = pyo.Objective(expr=sum((i + 1) * (x[i] - i) ** 2 for i in x) + x[0] * x[1])
    m.sum = pyo.Constraint(expr=sum(x[i] for i in x) == 2)
    m.mix = pyo.Constraint(expr=x[0] - 2 * x[1] + x[4] >= 1)
    return m


def dae_cart() -> pyo.ConcreteModel:
    """A cart of pyomo.dae, not discretised."""
    m = pyo.ConcreteModel(name="dae cart")
    m.t = ContinuousSet(bounds=(0, 2))
    m.x, m.v = pyo.Var(m.t, initialize=0), pyo.Var(m.t, initialize=0)
    m.force = pyo.Var(m.t, bounds=(-4, 4), initialize=0)
    m.dx, m.dv = DerivativeVar(m.x, wrt=m.t), DerivativeVar(m.v, wrt=m.t)
    m.kinematics = pyo.Constraint(m.t, rule=lambda m, t: m.dx[t] == m.v[t])
    m.newton = pyo.Constraint(m.t, rule=lambda m, t: m.dv[t] == m.force[t] - 0.5 * m.v[t])
    m.x[0].fix(0), m.v[0].fix(0), m.x[2].fix(1), m.v[2].fix(0)
    m.effort = Integral(m.t, wrt=m.t, rule=lambda m, t: m.force[t] ** 2)
    m.cost = pyo.Objective(expr=m.effort)
    return m


def dae_hanger() -> pyo.ConcreteModel:
    """A tank of pyomo.dae whose drain opens where a level is reached: pairs over time, not discretised."""
    m = pyo.ConcreteModel(name="dae hanger")
    m.t = ContinuousSet(bounds=(0, 1))
    m.x, m.u = pyo.Var(m.t, initialize=0.5), pyo.Var(m.t, bounds=(-3, 3), initialize=0)
    m.drain = pyo.Var(m.t, bounds=(0, None), initialize=0)
    m.dx = DerivativeVar(m.x, wrt=m.t)
    m.flow = pyo.Constraint(m.t, rule=lambda m, t: m.dx[t] == m.u[t] - m.drain[t])
    m.level = rcp.Complementarity(m.t, rule=lambda m, t: rcp.complements(m.drain[t] >= 0, 1 - m.x[t] >= 0))
    m.x[0].fix(0.5)
    m.effort = Integral(m.t, wrt=m.t, rule=lambda m, t: (m.x[t] - 2) ** 2 + 0.1 * (m.u[t] - 1) ** 2 + m.drain[t] ** 2)
    m.cost = pyo.Objective(expr=m.effort)
    return m


def _discretised(build: Callable[[], pyo.ConcreteModel], **options: Any) -> Callable[[], pyo.ConcreteModel]:
    def discretised() -> pyo.ConcreteModel:
        m = build()
        pyo.TransformationFactory("pyrobocop.collocation").apply_to(m, wrt=m.t, **options)
        return m

    return discretised


def _restated(of: Any, convex: bool = False) -> Problem:
    return Problem(of.__name__, lambda: of(Units())[0], of, convex)


def _textbook(name: str, family: str) -> Problem:
    build = getattr(_script(f"benchmarks/textbook_problems/{family}"), name)
    return Problem(f"textbook {name}", lambda: build(elements=10))


def _example(name: str, *case: str, **mesh: int) -> Problem:
    build = _script(f"examples/{name}").build
    return Problem(f"example {name}", lambda: build(*case, **mesh))


def _problems() -> tuple[Problem, ...]:
    in_units = ("brachistochrone", "bryson_denham", "moon_landing", "zermelo", "orbit_raising", "block_with_friction")
    return (
        _restated(lift),
        _restated(regulator, convex=True),
        *(_restated(getattr(restated, name), convex=name == "bryson_denham") for name in in_units),
        Problem("two_legs", two_legs, convex=True),
        Problem("fit", fit),
        Problem("quadratic_program", quadratic_program, convex=True),
        Problem("dae_cart", _discretised(dae_cart, nfe=6, ncp=3, scheme="LAGRANGE-RADAU"), None, True, dae_cart),
        Problem("dae_hanger", _discretised(dae_hanger, nfe=8, ncp=1, scheme="LAGRANGE-RADAU"), None, False, dae_hanger),
        *(
            _textbook(name, "small")
            for name in ("jacobson_lele", "fastest_stop", "singular_arc", "fishing", "rayleigh")
        ),
        *(_textbook(name, "chemistry") for name in ("stirred_tank", "consecutive_reactions")),
        _example("cart_pole", elements=10),
        _example("pendulum", elements=20),
        _example("hopper", "leap", elements=5),
        _example("linear_complementarity_control", elements=20),
    )


PROBLEMS = {problem.name: problem for problem in _problems()}
