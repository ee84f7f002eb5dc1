"""The methods that ``mpcc_methods.py`` compares, each a function of a model, a backend to Ipopt and a time limit."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import pyomo.environ as pyo
from pyomo import mpec
from pyomo.common.collections import Bunch
from pyomo.common.modeling import unique_component_name
from pyomo.contrib.solver.common.factory import SolverFactory
from pyomo.contrib.solver.common.results import SolutionStatus
from pyomo.opt import SolverFactory as LegacySolverFactory

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.complementarity.relaxations import RELAXATIONS
from pyrobocop_pyomo.ipopt.backends import find_ipopt_executable


@dataclass(frozen=True)
class Effort:
    """What a method says of itself: whether it has solved the problem, and Ipopt's iterations in all solves."""

    claims: bool
    iterations: int


def ipopt(model: Any, backend: str, limit: float, options: dict[str, Any] | None = None) -> Effort:
    """One cold solve by Ipopt from the values on the model; the last point is put on the model in any case."""
    options = {"max_iter": 3000, **(options or {})}
    if backend == "executable":
        solver = SolverFactory("ipopt", executable=find_ipopt_executable())
        options["max_cpu_time"] = limit
        extra: dict[str, Any] = {"writer_config": {"linear_presolve": False, "scale_model": False}}
    else:
        solver = SolverFactory("pyrobocop.ipopt")
        extra = {"derivatives": backend, "time_limit": limit}
    results = solver.solve(
        model,
        load_solutions=False,
        raise_exception_on_nonoptimal_result=False,
        solver_options=options,
        **extra,
    )
    # Without any point (too few degrees of freedom, proven infeasible) the values stay as they are.
    with contextlib.suppress(Exception):
        results.solution_loader.load_vars()
    solved = results.solution_status is SolutionStatus.optimal
    return Effort(solved, int(getattr(results.extra_info, "iteration_count", None) or 0))


def as_pyomo_mpec(model: Any) -> None:
    """State every pair of this package as one of pyomo.mpec, in relations: variables alone are nothing there."""
    for data in list(model.component_data_objects(rcp.Complementarity, active=True)):
        sides = [_relation(*side) for side in zip(data.args, data.bounds, strict=True)]
        block = data.parent_block()
        name = unique_component_name(block, "pair_of_mpec")
        block.add_component(name, mpec.Complementarity(expr=mpec.complements(*sides)))
        data.deactivate()
    for component in list(model.component_objects(rcp.Complementarity, active=True)):
        component.deactivate()


def _relation(side: Any, bound: str | None) -> Any:
    if not (hasattr(side, "is_variable_type") and side.is_variable_type()):
        return side
    lower = bound == "lower" or (bound is None and side.has_lb())
    return side >= side.lower if lower else side <= side.upper


def stock_transformation(model: Any, backend: str, limit: float) -> Effort:
    """Pyomo's ``mpec.simple_nonlinear`` as it is: products bounded by zero, one solve."""
    as_pyomo_mpec(model)
    pyo.TransformationFactory("mpec.simple_nonlinear").apply_to(model)
    return ipopt(model, backend, limit)


def stock_solver(model: Any, backend: str, limit: float) -> Effort:
    """Pyomo's solver ``mpec_nlp`` with its loop from 1 to its final 1e-7."""
    as_pyomo_mpec(model)
    CountedIpopt.backend, CountedIpopt.until, CountedIpopt.efforts = backend, time.perf_counter() + limit, []
    pyo.SolverFactory("mpec_nlp").solve(model, options={"solver": "counted_ipopt", "epsilon_initial": 1.0})
    # It reports the same for everything; what its last solve said is the most that can be held in its favour.
    return Effort(CountedIpopt.efforts[-1].claims, sum(effort.iterations for effort in CountedIpopt.efforts))


@LegacySolverFactory.register("counted_ipopt", doc="Ipopt by a chosen backend, which counts (for benchmarks)")
class CountedIpopt:
    """What ``mpec_nlp`` calls for each solve: it takes solvers by name only, hence the state on the class."""

    backend = ""
    until = 0.0
    efforts: list[Effort] = []  # noqa: RUF012

    def __init__(self, **_: Any) -> None:
        pass

    def __enter__(self) -> CountedIpopt:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def solve(self, model: Any, **_: Any) -> Bunch:
        """Solve once more from where the last solve ended."""
        self.efforts.append(ipopt(model, self.backend, max(0.1, self.until - time.perf_counter())))
        return Bunch(solver=Bunch())


def default(model: Any, backend: str, limit: float) -> Effort:
    """``rcp.solve`` as it is."""
    return _solve(model, backend, limit)


def cold_continuation(model: Any, backend: str, limit: float) -> Effort:
    """delta from 1 to 1e-8 by 0.1; each solve starts from the last point, without multipliers."""
    until = time.perf_counter() + limit
    iterations = 0
    with _relaxed(model, delta=1.0) as delta:
        for step in rcp.relaxations.Geometric(1.0, 0.1, 1e-8).steps():
            delta.set_value(step)
            effort = ipopt(model, backend, max(0.1, until - time.perf_counter()), {"bound_relax_factor": 0.0})
            iterations += effort.iterations
    return Effort(effort.claims, iterations)


def warm_continuation(model: Any, backend: str, limit: float) -> Effort:
    """The same path, warm-started with multipliers, by ``rcp.solve``."""
    return _solve(model, backend, limit, strategies=rcp.Strategy(schedule=rcp.relaxations.Geometric()))


def tight(model: Any, backend: str, limit: float) -> Effort:
    """One solve with delta = 1e-8 from the given start."""
    return _solve(model, backend, limit, strategies=rcp.Strategy(schedule=rcp.relaxations.Fixed(1e-8)))


def _solve(model: Any, backend: str, limit: float, **choices: Any) -> Effort:
    result = rcp.solve(model, backend=backend, time_limit=limit, progress=False, **choices)
    return Effort(result.solved, result.iterations)


@contextlib.contextmanager
def _relaxed(model: Any, delta: float) -> Iterator[Any]:
    relax = pyo.TransformationFactory("pyrobocop.relax_complementarity")
    token = relax.apply_to(model, delta=delta)
    try:
        yield relax.delta_of(model)
    finally:
        relax.revert(model, token)


def _with_relaxation(word: str) -> Callable[..., Effort]:
    def method(model: Any, backend: str, limit: float) -> Effort:
        return _solve(
            model, backend, limit, strategies=rcp.Strategy(schedule=rcp.relaxations.Geometric(), relaxation=word)
        )

    return method


METHODS: dict[str, Callable[..., Effort]] = {
    "Pyomo mpec.simple_nonlinear": stock_transformation,
    "Pyomo mpec_nlp, 1 to 1e-7": stock_solver,
    "rcp.solve": default,
    "cold continuation, 1 to 1e-8": cold_continuation,
    "warm continuation, 1 to 1e-8": warm_continuation,
    "one solve, delta = 1e-8": tight,
    **{f"{word}, continued": _with_relaxation(word) for word in RELAXATIONS if word != "scholtes"},
}
"""Name in the table -> method."""
