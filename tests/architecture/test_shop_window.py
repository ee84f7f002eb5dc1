"""What `import pyrobocop_pyomo` does and does not do, and the names that people may rely on."""

from __future__ import annotations

import json
import subprocess
import sys
import textwrap

import pytest

import pyrobocop_pyomo

PUBLIC = """
    ActiveSide Algebraic AllPairs AugmentedLagrangian Backend Body BodyPath CarPath CarSearch Certificate
    ChenHarkerKanzowSmale Complementarity Containment Control Crossed Diagnosis Duration Elastic FischerBurmeister
    Fixed FollowBarrier Geometric GeometryError Grid HomotopyResult JoinedTrajectory Kadrani KanzowSchwartz
    LinFukushima Link Mesh MultistartResult ObstacleAvoidanceBlock ObstacleError PairReport Parameter Penalty
    PerElement PerPair PerPhase PhaseBlock Polytope Pose PyRobocopError Quality RecedingHorizon RefinedResult
    RefinementEnd SafetyReport Scheme Scholtes Sensitivity SequenceRanking SignedDistance SimulationFailed SolveFailed
    SolveResult SquareSlider Start State Stationarity SteffensenUlbrich StopReason Strategy Superlinear Trajectory
    TwoSided Verification __version__ active_pairs animate_avoidance animate_scene available_backends complements
    dae_trajectory decompose diagnose draw_avoidance draw_linkage draw_planar_pushing draw_scene explicit find_scheme
    gauss_legendre homotopy hybrid_a_star join_trajectories label_measurements lobatto mode_sequences multistart
    phases_of planar_pose radau sensitivity signed_distance solve solve_refined solve_sequences spatial_pose
    waypoint_guess
"""

EXTRAS = ("casadi", "highspy", "matplotlib", "pandas", "xarray", "dask", "mpi4py", "shapely", "trimesh", "coal")


def in_a_fresh_process(code: str) -> subprocess.CompletedProcess:
    # The same warnings as here: what is deprecated must not hide in an import.
    command = [sys.executable, "-W", "error", "-c", textwrap.dedent(code)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)


def test_public_names_are_pinned() -> None:
    """A name once shown is a promise: changing this list is a decision, and CHANGELOG.md says so."""
    assert sorted(pyrobocop_pyomo.__all__) == PUBLIC.split()
    for name in pyrobocop_pyomo.__all__:
        assert getattr(pyrobocop_pyomo, name) is not None


def test_import_prints_nothing() -> None:
    ended = in_a_fresh_process("import pyrobocop_pyomo")
    assert ended.stdout == ""
    assert ended.stderr == ""


def test_import_loads_no_extra() -> None:
    ended = in_a_fresh_process("import json, sys, pyrobocop_pyomo; print(json.dumps(list(sys.modules)))")
    assert not set(EXTRAS) & set(json.loads(ended.stdout))


def test_import_registers_transformation_and_solvers() -> None:
    ended = in_a_fresh_process("""
        import pyomo.environ as pyo
        from pyomo.contrib.solver.common.factory import SolverFactory
        import pyrobocop_pyomo
        print("pyrobocop.relax_complementarity" in pyo.TransformationFactory)
        for name in ("pyrobocop.ipopt", "pyrobocop.mpcc"):
            print(name in pyo.SolverFactory, name in SolverFactory)
    """)
    assert ended.stdout.split() == ["True"] * 5


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


def test_import_survives_a_variable_that_names_no_executable(monkeypatch: pytest.MonkeyPatch) -> None:
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
def test_import_costs_less_than_a_second_on_top_of_pyomo() -> None:
    # Processor time, and the best of several runs: what else the machine does is not our cost.
    code = """
        import time
        import pyomo.environ
        before = time.process_time()
        import pyrobocop_pyomo
        print(time.process_time() - before)
    """
    seconds = min(float(in_a_fresh_process(code).stdout) for _ in range(4))
    assert seconds < 1.0
