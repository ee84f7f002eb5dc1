"""What pip installs is enough: no compiler, no ASL, no executable."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap

import pytest

PROGRAM = """
    import logging
    import pyomo.environ as pyo
    import pyrobocop_pyomo as rcp
    from pyrobocop_pyomo.linear_solver import find_linear_solver

    assert find_linear_solver() is None

    smooth = pyo.ConcreteModel()
    smooth.x = pyo.Var(range(2), initialize=2.0)
    smooth.row = pyo.Constraint(expr=smooth.x[0] + smooth.x[1] == 1)
    smooth.cost = pyo.Objective(expr=smooth.x[0] ** 2 + 3 * smooth.x[1] ** 2)
    assert abs(rcp.solve(smooth, progress=False).objective - 0.75) < 1e-7

    motion = pyo.ConcreteModel()
    motion.move = b = rcp.PhaseBlock(duration=1.0, elements=6, stages=3)
    b.x, b.v = rcp.State(initial=0.0, final=1.0), rcp.State(initial=0.0, final=0.0)
    b.u = rcp.Control()

    @b.ode
    def newton(b, t):
        return {b.x: b.v[t], b.v: b.u[t]}

    motion.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    assert abs(rcp.solve(motion, progress=False).objective - 12.0) < 1e-6

    pairs = pyo.ConcreteModel()
    pairs.x, pairs.y = pyo.Var(bounds=(0, None), initialize=1.0), pyo.Var(bounds=(0, None), initialize=1.0)
    pairs.pair = rcp.Complementarity(rule=rcp.complements(pairs.x >= 0, pairs.y >= 0))
    pairs.cost = pyo.Objective(expr=(pairs.x - 1) ** 2 + (pairs.y - 2) ** 2)
    assert rcp.solve(pairs, progress=False).solved
"""


@pytest.mark.ipopt
@pytest.mark.casadi
def test_three_models_are_solved_without_compiler_and_asl(tmp_path):
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYROBOCOP_")}
    environment |= {
        "PYROBOCOP_NATIVE": "off",
        "PYOMO_CONFIG_DIR": str(tmp_path),
        "PATH": "",
        "CC": str(tmp_path / "none"),
    }
    ended = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(PROGRAM)], capture_output=True, text=True, timeout=900, env=environment
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
