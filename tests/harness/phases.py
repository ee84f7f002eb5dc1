"""Small phases with known answers, and what can be asked of any built phase."""

import inspect
import io
import math
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from mistakes.entries import driven, newton
from pyomo.core.expr.visitor import identify_variables
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import structural_rank

import pyrobocop_pyomo as rcp
import pyrobocop_pyomo.ipopt.in_process

HORIZON = 1.5
COLLOCATED = [
    rcp.schemes.radau(1), rcp.schemes.radau(3), rcp.schemes.gauss_legendre(1), rcp.schemes.gauss_legendre(2)
]  # fmt: skip
SCHEMES = [*COLLOCATED, rcp.schemes.lobatto(3)]
each_collocated = pytest.mark.parametrize("scheme", COLLOCATED, ids=str)
each_scheme = pytest.mark.parametrize("scheme", SCHEMES, ids=str)
OPTIONS = inspect.signature(rcp.PhaseBlock).parameters


def one_phase(name: str = "p", /, *, model: str | None = None, **stated: Any) -> tuple[pyo.ConcreteModel, Any]:
    """A model and its phase, in which everything is declared that is no option of a phase."""
    m = pyo.ConcreteModel(name=model)
    b = rcp.PhaseBlock(**{option: stated.pop(option) for option in OPTIONS if option in stated})
    m.add_component(name, b)
    for each, declaration in stated.items():
        b.declare(each, declaration)
    return m, b


def with_phase(name: str, model: str | None = None, **options: Any) -> tuple[pyo.ConcreteModel, Any]:
    """A model, and its one phase."""
    m = pyo.ConcreteModel(name=model)
    m.add_component(name, rcp.PhaseBlock(**options))
    return m, m.component(name)


def oscillators(**options: Any) -> pyo.ConcreteModel:
    """``x' = x cos(t + 1/2)`` and ``y' = -y^2 cos(t + 13/10) / 2`` from 1, over 3/2."""
    m = pyo.ConcreteModel("oscillators")
    m.swing = rcp.PhaseBlock(**{"duration": HORIZON, **options})
    m.swing.x = rcp.State(initial=1, initial_guess=1)
    m.swing.y = rcp.State(initial=1, initial_guess=1)
    m.swing.ode(oscillate)
    return m


def cart(**options: Any) -> pyo.ConcreteModel:
    """A mass that goes from 0 to 1 and rests there, at the least effort: 12 / duration**3 where its force suffices."""
    m = pyo.ConcreteModel(name="cart")
    driven(m, **options)
    return m


def integrator(*, x: Any = None, u: Any = None, **options: Any) -> tuple[pyo.ConcreteModel, Any]:
    """A model and its phase 'p', with a control ``u`` that is the rate of a state ``x``; options of both by name."""
    m, b = with_phase("p", "integrator", **{"duration": 1.0, "elements": 2, **options})
    b.x, b.u = rcp.State(**(x or {})), rcp.Control(**(u or {}))
    b.ode(lambda b, t: {b.x: b.u[t]})
    return m, b


def mass(*, x: Any = None, v: Any = None, u: Any = None, **options: Any) -> tuple[pyo.ConcreteModel, Any]:
    """A model and its phase 'p', with a control ``u`` that is the rate of the speed ``v`` of ``x``; options by name."""
    m, b = with_phase("p", "mass", **options)
    b.x, b.v, b.u = rcp.State(**(x or {})), rcp.State(**(v or {})), rcp.Control(**(u or {}))
    b.ode(newton)
    return m, b


def rest_to_rest(distance: float = 1.0, force: Any = (-1, 1), *, v: Any = None, u: Any = None, **options: Any) -> Any:
    """A mass that goes from rest to rest in the least time; options of its speed and its force by name."""
    options = {"duration": rcp.Duration(bounds=(0.1, 10), initial_guess=2), **options}
    speed, control = {"initial": 0, "final": 0, **(v or {})}, {"bounds": force, **(u or {})}
    m, b = mass(x={"initial": 0, "final": distance}, v=speed, u=control, **options)
    m.time = pyo.Objective(expr=b.duration)
    return m


def bryson_denham(height: float = 1 / 9, **options: Any) -> Any:
    """A mass that is thrown up and comes back below a ceiling, at the least effort: ``4 / (9 height)`` up to 1 / 6."""
    height_of = {"initial": 0, "final": 0, "bounds": (None, height)}
    m, b = mass(x=height_of, v={"initial": 1, "final": -1}, duration=1.0, **options)
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2 / 2))
    return m


def oscillate(b: Any, t: float) -> dict[Any, Any]:
    clock = b.time_at(t)
    return {b.x: b.x[t] * pyo.cos(clock + 0.5), b.y: -0.5 * b.y[t] ** 2 * pyo.cos(clock + 1.3)}


def exact_x(t: float) -> float:
    return math.exp(math.sin(t + 0.5) - math.sin(0.5))


def exact_y(t: float) -> float:
    return 1 / (1 + 0.5 * (math.sin(t + 1.3) - math.sin(1.3)))


def running_costs(phase: Any) -> tuple[Any, Any]:
    """Integrals of ``x^2 cos(t + 1/2)`` and ``y cos(t + 13/10)``."""
    return (
        phase.integral(lambda b, t: b.x[t] ** 2 * pyo.cos(b.time_at(t) + 0.5)),
        phase.integral(lambda b, t: b.y[t] * pyo.cos(b.time_at(t) + 1.3)),
    )


EXACT_COSTS = ((exact_x(HORIZON) ** 2 - 1) / 2, -2 * math.log(exact_y(HORIZON)))


def solve(model: pyo.ConcreteModel, tolerance: float = 1e-13) -> None:
    """Solve in process; raises unless Ipopt converged."""
    pyo.SolverFactory("pyrobocop.ipopt").solve(model, options={"tol": tolerance})


def free_variables(model: Any) -> list[Any]:
    return [v for v in model.component_data_objects(pyo.Var) if not v.fixed]


def rows(model: Any) -> list[Any]:
    return list(model.component_data_objects(pyo.Constraint, active=True))


def rank(model: Any) -> int:
    """Structural rank of all rows in the variables that are not fixed."""
    column = {id(v): j for j, v in enumerate(free_variables(model))}
    entries = [
        (i, column[id(v)])
        for i, row in enumerate(rows(model))
        for v in identify_variables(row.body, include_fixed=False)
    ]
    i, j = np.array(entries).T
    return int(structural_rank(coo_matrix((np.ones(len(i)), (i, j)), shape=(len(rows(model)), len(column))).tocsr()))


def undetermined(model: Any) -> list[str]:
    """Names of variables that no row and no objective holds."""
    expressions = [row.body for row in rows(model)]
    expressions += [o.expr for o in model.component_data_objects(pyo.Objective, active=True)]
    seen = {id(v) for expression in expressions for v in identify_variables(expression)}
    return [v.name for v in model.component_data_objects(pyo.Var) if id(v) not in seen]


def text(model: Any) -> str:
    """All that Pyomo prints of a model."""
    stream = io.StringIO()
    model.pprint(ostream=stream)
    return stream.getvalue()


def contents(model: Any) -> list[str]:
    """Every component below a model and every row, by names that are the same when the model above is collected."""
    return [
        f"{data.getname(fully_qualified=True, relative_to=model)}: {type(data).__name__}"
        for block in model.block_data_objects()
        for component in block.component_map().values()
        for data in (component, *(component.values() if component.ctype is pyo.Constraint else ()))
    ]
