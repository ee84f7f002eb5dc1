"""The solvers' names in Pyomo's factories before their folders are loaded.

`SolverFactory("pyrobocop.mpcc")` has to work after a plain import of the package, which does not load what solves. So
a stand-in is registered under each name; its first call imports the folder of the solver, and that registers the class
itself in the stand-in's place.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from pyomo.common.factory import Factory
from pyomo.contrib.solver.common.factory import SolverFactory
from pyomo.opt.base.solvers import LegacySolverFactory

SOLVERS = {
    "pyrobocop.ipopt": ("pyrobocop_pyomo.ipopt.in_process", "Ipopt in this process: no executable needed"),
    "pyrobocop.mpcc": (
        "pyrobocop_pyomo.planning.mpcc_solver",
        "Mathematical programs with complementarity constraints: continuation, polish and certificate",
    ),
}


def _stand_in(factory: Factory, name: str, module: str) -> Callable[..., Any]:
    """What loads the module that registers a solver's class in a factory, and makes a solver of that class."""

    def make(**options: Any) -> Any:
        import_module(module)
        return factory.get_class(name)(**options)

    return make


def register() -> None:
    """Make the solvers known to Pyomo's present and older factory, by stand-ins that load them."""
    for name, (module, meaning) in SOLVERS.items():
        for factory, doc in ((SolverFactory, meaning), (LegacySolverFactory, f"{meaning} (new interface)")):
            if name not in factory:
                # The registration that all factories have: that of solvers would make a class of the stand-in.
                Factory.register(factory, name, doc)(_stand_in(factory, name, module))
