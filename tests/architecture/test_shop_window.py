"""What `import pyrobocop_pyomo` does and does not do, and how it shows its names."""

import ast
import functools
import re
import subprocess
import sys
import textwrap
from collections import Counter
from pathlib import Path
from types import ModuleType

import pytest

import pyrobocop_pyomo as rcp

ROOT = Path(rcp.__file__).parent

NAMESPACES = "errors estimation ipopt mechanics relaxations scenes schemes studies teams"


# Who only states problems needs none of these, and no extra: a plain import loads NumPy, and of SciPy nothing.
ON_DEMAND = """
    casadi highspy matplotlib pandas dask distributed mpi4py shapely trimesh yourdfpy
    networkx scipy.interpolate scipy.linalg scipy.optimize scipy.sparse scipy.spatial scipy.stats
    pyrobocop_pyomo.catalogue pyrobocop_pyomo.diagnosis pyrobocop_pyomo.discretisation
    pyrobocop_pyomo.distributed pyrobocop_pyomo.ipopt
    pyrobocop_pyomo.linear_solver
    pyrobocop_pyomo.mechanics pyrobocop_pyomo.motion pyrobocop_pyomo.mpcc pyrobocop_pyomo.obstacles
    pyrobocop_pyomo.contrib pyrobocop_pyomo.planning pyrobocop_pyomo.programs pyrobocop_pyomo.solving
    pyrobocop_pyomo.studies
"""


def in_a_fresh_process(code: str) -> subprocess.CompletedProcess:
    # The same warnings as here: what is deprecated must not hide in an import.
    command = [sys.executable, "-W", "error", "-c", textwrap.dedent(code)]
    return subprocess.run(command, capture_output=True, text=True, timeout=900, check=True)


def found(namespace: str) -> ModuleType:
    return functools.reduce(getattr, filter(None, namespace.split(".")), rcp)


def shown_by(namespace: str) -> set[str]:
    if namespace == "errors":
        return {name for name, value in vars(rcp.errors).items() if isinstance(value, type)}
    return set(found(namespace).__all__)


def test_a_public_name_has_one_home() -> None:
    names = [name for namespace in ["", *NAMESPACES.split(), "mechanics.planar"] for name in shown_by(namespace)]
    # In space the words of the plane come again: one word for one thing, in two worlds that never meet in one model.
    names += shown_by("mechanics.spatial") - shown_by("mechanics.planar")
    assert [name for name, count in Counter(names).items() if count > 1] == []


def test_completion_offers_the_public_names() -> None:
    assert dir(rcp) == sorted(rcp.__all__)


def test_namespaces_only_show_what_folders_define() -> None:
    """A module beside `__init__` holds imports and `__all__`; nothing in the package imports it."""
    modules = {path.stem for path in ROOT.glob("*.py")} & set(NAMESPACES.split()) - {"errors"}
    for name in modules:
        docstring, *statements = ast.parse((ROOT / f"{name}.py").read_text(encoding="utf-8")).body
        assert isinstance(docstring, ast.Expr)
        # What is loaded on demand, of `contrib`, needs a table and the function that reads it.
        assert all(isinstance(each, (ast.ImportFrom, ast.Assign, ast.FunctionDef)) for each in statements)
    sources = "\n".join(path.read_text(encoding="utf-8") for path in ROOT.glob("*/**/*.py"))
    assert modules & set(re.findall(r"^from pyrobocop_pyomo\.(\w+) import", sources, re.MULTILINE)) == set()


@pytest.mark.heavy
def test_what_many_scripts_do_without_is_loaded_on_demand() -> None:
    ended = in_a_fresh_process(f"""
        import sys
        import pyrobocop_pyomo as rcp
        print(any(name in sys.modules for name in {ON_DEMAND.split()}))
        from pyrobocop_pyomo import Team, estimate
        print(rcp.Team is Team, rcp.mechanics.SoftWall.__name__, hasattr(rcp, "nothing"))
        print(all(getattr(rcp, name) is not None for name in rcp.__all__))
    """)
    assert ended.stdout.split() == ["False", "True", "SoftWall", "False", "True"]


@pytest.mark.heavy
def test_import_registers_transformation_and_solvers() -> None:
    ended = in_a_fresh_process("""
        import pyomo.environ as pyo
        from pyomo.contrib.solver.common.factory import SolverFactory
        import pyrobocop_pyomo
        for name in ("pyrobocop.collocation", "pyrobocop.relax_complementarity"):
            print(name in pyo.TransformationFactory)
        for name, kind in {"pyrobocop.ipopt": "InProcessIpopt", "pyrobocop.mpcc": "Mpcc"}.items():
            for factory in (pyo.SolverFactory, SolverFactory):
                doc = factory.doc(name)
                print(name in factory)
                print(kind in [base.__name__ for base in type(factory(name)).__mro__])
                print(factory.doc(name) == doc)  # the stand-in said what the solver says
    """)
    assert ended.stdout.split() == ["True"] * 14


@pytest.mark.heavy
def test_import_leaves_pyomo_as_it_was() -> None:
    """No logger, handler or warning filter is changed, and no path of an executable."""
    ended = in_a_fresh_process("""
        import logging, warnings
        import numpy, pyomo.environ  # which have filters of their own
        from pyomo.common import Executable
        def state():
            loggers = logging.getLogger("pyomo").level, logging.getLogger().handlers[:]
            return loggers, warnings.filters[:], Executable("ipopt").path()
        before = state()
        import pyrobocop_pyomo
        print(before == state())
    """)
    assert ended.stdout.split() == ["True"]


@pytest.mark.heavy
def test_import_prints_nothing_and_survives_a_variable_without_executable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYROBOCOP_IPOPT_EXECUTABLE", "/nowhere/ipopt")
    ended = in_a_fresh_process("import pyrobocop_pyomo")
    assert (ended.stdout, ended.stderr) == ("", "")


@pytest.mark.casadi
def test_the_first_solve_does_not_import_statistics() -> None:
    """Pyomo imports `scipy.stats`, which takes 0.6 s, whenever SciPy is found by its finder of modules."""
    ended = in_a_fresh_process("""
        import sys
        import pyomo.environ as pyo
        import pyrobocop_pyomo as rcp
        m = pyo.ConcreteModel()
        m.x, m.y = pyo.Var(bounds=(0, None), initialize=1), pyo.Var(bounds=(0, None), initialize=1)
        m.pair = rcp.Complementarity(expr=rcp.complements(m.x >= 0, m.y >= 0))
        m.row = pyo.Constraint(expr=m.x + m.y >= 1.5)
        m.cost = pyo.Objective(expr=m.x**2 + (m.y - 1) ** 2)
        rcp.solve(m, backend="casadi").raise_for_status()
        print("scipy.sparse" in sys.modules, "scipy.stats" in sys.modules)
        from pyomo.common.dependencies import scipy
        print(scipy.stats.norm is not None)  # what Pyomo itself wants of SciPy is still there
    """)
    assert ended.stdout.split() == ["True", "False", "True"]


@pytest.mark.slow
def test_import_costs_less_than_the_libraries_below_it() -> None:
    # Processor time of both in one process: what else the machine does slows both.
    code = """
        import time
        started = time.process_time()
        import networkx, numpy, pyomo.environ, scipy.optimize
        below = time.process_time()
        import pyrobocop_pyomo
        print((time.process_time() - below) / (below - started))
    """
    assert any(float(in_a_fresh_process(code).stdout) < 1.0 for _ in range(4))
