"""The solvers' names in Pyomo's factories before their folders are loaded.

`SolverFactory("pyrobocop.mpcc")` has to work after a plain import of the package, which does not load what solves. So
a stand-in is registered under each name; its first call imports the folder of the solver, and that registers the class
itself in the stand-in's place.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from pyomo.common.factory import Factory
from pyomo.contrib.solver.common.factory import SolverFactory
from pyomo.opt.base.solvers import LegacySolverFactory

SOLVERS = {
    "pyrobocop.ipopt": (
        "pyrobocop_pyomo.ipopt.in_process",
        "Ipopt in this process: no executable needed",
    ),
    "pyrobocop.mpcc": (
        "pyrobocop_pyomo.planning.older_interface",
        "Mathematical programs with complementarity constraints: continuation, polish and certificate",
    ),
}


class SolverOnDemand:
    """Stands in a factory for a solver whose module is not loaded yet.

    Parameters
    ----------
    factory : pyomo.common.factory.Factory
        Where the solver's module registers the class.
    name : str
        The solver's name there.
    module : str
        The module that registers it.
    """

    def __init__(self, factory: Factory, name: str, module: str) -> None:
        self._factory = factory
        self._name = name
        self._module = module

    def __call__(self, **options: Any) -> Any:
        """Load the solver's class, and make one."""
        import_module(self._module)
        return self._factory.get_class(self._name)(**options)


def register() -> None:
    """Make the solvers known to Pyomo's present and older factory, by stand-ins that load them."""
    for name, (module, meaning) in SOLVERS.items():
        for factory, doc in ((SolverFactory, meaning), (LegacySolverFactory, f"{meaning} (new interface)")):
            if name not in factory:
                # The registration that all factories have: that of solvers would make a class of the stand-in.
                Factory.register(factory, name, doc)(SolverOnDemand(factory, name, module))
