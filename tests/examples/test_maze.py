"""What is learned is worth something: plans by it end where the ball then is."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import pyrobocop_pyomo as rcp

pytestmark = pytest.mark.casadi


def loaded_maze() -> ModuleType:
    path = Path(__file__).parents[2] / "examples" / "maze.py"
    spec = importlib.util.spec_from_file_location("example_maze", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_plan_by_the_learned_model_leads_the_ball_nearer_to_its_end_than_one_by_known_terms() -> None:
    pytest.importorskip("scipy")
    maze = loaded_maze()
    model = maze.build("outer", samples=300)
    assert rcp.solve(model).solved
    plan = model.roll.trajectory()
    error = abs(maze.tried(model)[-1] - plan.theta[-1])
    assert error < 0.1

    def nothing(X: np.ndarray) -> np.ndarray:
        return np.zeros(len(X))

    known = maze.learned("outer", 300)
    nothing_learned = rcp.Function(nothing, lambda X: np.zeros_like(X), lambda X: np.zeros((*X.shape, X.shape[1])))
    maze.learned = lambda ring, samples: maze.LearnedRing(known.weights, nothing_learned)
    by_known_terms = maze.build("outer", samples=300)
    assert rcp.solve(by_known_terms).solved
    without = abs(maze.tried(by_known_terms)[-1] - by_known_terms.roll.trajectory().theta[-1])
    assert error < 0.5 * without


def test_the_servo_step_is_the_flow_of_its_equation() -> None:
    maze = loaded_maze()
    state = np.array([[0.3], [0.2], [0.05], [-0.4], [-0.02], [0.3]])
    commands = np.array([[0.03], [-0.06]])
    exact = maze.simulate_step("outer", state, commands, parts=200)
    for row, command in ((2, 0.03), (4, -0.06)):
        np.testing.assert_allclose(
            maze.servo_step(state[row], state[row + 1], command), exact[row : row + 2], rtol=1e-9
        )
