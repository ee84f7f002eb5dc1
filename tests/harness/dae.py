"""Small models of pyomo.dae, and a picture of everything that a refusal must not change."""

import pyomo.environ as pyo
from pyomo.contrib.incidence_analysis import IncidenceGraphInterface
from pyomo.dae import ContinuousSet, DerivativeVar, Integral

import pyrobocop_pyomo as rcp


def tank(points=(0, 2)):
    m = pyo.ConcreteModel(name="tank")
    m.t = ContinuousSet(initialize=points)
    m.x, m.u, m.z = pyo.Var(m.t, initialize=1), pyo.Var(m.t, initialize=0), pyo.Var(m.t)
    m.dx = DerivativeVar(m.x)
    m.ode = pyo.Constraint(m.t, rule=lambda m, t: m.dx[t] == m.u[t] - m.z[t])
    m.drain = pyo.Constraint(m.t, rule=lambda m, t: m.z[t] == m.x[t] ** 2)
    m.x[0].fix(1)
    return m


def driven_tank(points=(0, 2), **options):
    """Without the drain: the inflow alone decides, and its variable takes options."""
    m = pyo.ConcreteModel(name="tank")
    m.t = ContinuousSet(initialize=points)
    m.x, m.u = pyo.Var(m.t, initialize=1), pyo.Var(m.t, **options)
    m.dx = DerivativeVar(m.x)
    m.ode = pyo.Constraint(m.t, rule=lambda m, t: m.dx[t] == m.u[t] - m.x[t])
    m.x[0].fix(1)
    return m


def sizes(m):
    """Numbers of variables and of equations, by Pyomo; of which as many as there are of the fewer can be matched."""
    graph = IncidenceGraphInterface(m, include_inequality=False)
    found = len(graph.variables), len(graph.constraints)
    assert len(graph.maximum_matching()) == min(found)
    return found


def free_variables(m):
    """How many more variables than equations."""
    variables, equations = sizes(m)
    return variables - equations


def solved(m, **options):
    tight = {"tol": 1e-12, "constr_viol_tol": 1e-13, "bound_relax_factor": 0.0}
    rcp.solve(m, progress=False, options=tight, **options).raise_for_status()
    return m


def picture(m):
    """Everything that a refusal must not change."""
    lines = [str(list(m.t)), str(m.t.get_discretization_info()), str(m.t.get_finite_elements())]
    for component in m.component_objects(descend_into=True):
        lines.append(f"{component.name} {component.ctype.__name__} {getattr(component, 'active', None)}")
        if component.ctype in (pyo.Var, DerivativeVar):
            lines += [f"{v.name} {v.value} {v.fixed} {v.bounds} {v.domain}" for v in component.values()]
        elif component.ctype in (pyo.Constraint, pyo.Objective, pyo.Expression, Integral):
            lines += [f"{e.name} {e.expr} {getattr(e, 'active', None)}" for e in component.values()]
    return lines
