"""A class with PyRoboCOP's methods is the model that the same problem has in this package."""

import pickle

import numpy as np
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.contrib.pyrobocop_classes.problem_class import ArrayToFill, column_array
from pyrobocop_pyomo.errors import ModelError

from . import problems


@pytest.mark.parametrize(
    ("roots", "scheme"),
    [("radau", "implicit_euler"), ("legendre", "implicit_midpoint"), ("explicit", "explicit_euler")],
)
def test_roots_are_those_of_the_scheme(roots, scheme):
    found, expected = (
        rcp.from_pyrobocop(problems.SwingUp(), 1, roots).phase.grid.scheme,
        rcp.schemes.find_scheme(scheme),
    )
    assert (found.c.tolist(), found.A.tolist()) == (expected.c.tolist(), expected.A.tolist())


def rows_at(b, t):
    """What the equations of a phase miss at a point, in which derivatives are variables."""
    held = [
        rows for rows in b.component_objects(pyo.Constraint) if rows.local_name.endswith(("equations", "_equation"))
    ]
    stated = [row for rows in held for index, row in rows.items() if np.ravel(index)[0] == t]
    return [pyo.value(row.body) - row.ub for row in stated]


@pytest.mark.parametrize("problem", problems.PROBLEMS, ids=lambda problem: problem.__name__)
def test_rows_and_cost_are_what_the_class_says_of_the_solution_arrays(problem):
    given = problem()
    m = rcp.from_pyrobocop(given, given.points)
    m.phase.check()
    b, generator = m.phase, np.random.default_rng(3)
    for variable in b.component_data_objects(pyo.Var):
        variable.set_value(generator.uniform(0.1, 0.9), skip_validation=True)
    x, xdot, y, u, p = rcp.solution_arrays(m)
    of_problem = () if problem is problems.DeadZone else (column_array(p),)
    cost = 0.0
    if hasattr(given, "objective_mayer"):
        first = column_array(x[0, :, 0])
        first.columns = x[0]
        cost = float(given.objective_mayer(first, column_array(x[-1, :, 0]), column_array(p)))
    for i, times in enumerate(b.grid.node_times):
        for k, t in enumerate(times[1:]):
            at_point = (x[i, :, k + 1], xdot[i, :, k], y[i, :, k], u[i, :, k])
            arguments = (t, *map(column_array, at_point), *of_problem)
            c = ArrayToFill.zeros(given.states + given.algebraics - given.pairs, 1)
            given.constraint(c, *arguments)
            # Derivatives that rows give are what makes these zero; the others are rows of the phase.
            others = np.abs(np.asarray(c, dtype=float).ravel())
            assert sorted(others[others > 1e-9]) == pytest.approx(sorted(map(abs, rows_at(b, t))), rel=1e-9)
            cost += b.grid.quadrature_weights[t] * float(np.sum(given.objective(*arguments)))
    assert pyo.value(m.cost) == pytest.approx(cost, rel=1e-9)


def test_rows_with_a_number_before_one_derivative_give_it():
    given = rcp.from_pyrobocop(problems.SwingUp()).phase
    assert given.component("equations") is None
    assert given.component("x0_derivative") is None
    left = rcp.from_pyrobocop(problems.QuickCart()).phase
    assert len(left.equations) == 2 * len(left.x0_derivative)


@pytest.mark.ipopt
def test_values_come_in_the_shapes_of_the_original():
    given = problems.LinearComplementarity()
    m = rcp.from_pyrobocop(given, 2)
    rcp.solve(m)
    x, xdot, y, u, _ = arrays = rcp.solution_arrays(m)
    assert [part.shape for part in arrays] == [(13, 2, 3), (12, 2, 2), (12, 4, 2), (12, 2, 2), (0,)]
    assert x[0, :, 0].tolist() == [-0.5, 1.0]
    assert x[1:, :, 0] == pytest.approx(x[:-1, :, -1])  # Radau: an element ends where the next one starts
    assert xdot == pytest.approx(given.A @ x[:-1, :, 1:] + given.B @ y[:, :2] + given.F @ u, abs=1e-6)
    assert y[:, 2:] == pytest.approx(given.C @ x[:-1, :, 1:] + given.D @ y[:, :2] + given.E @ u, abs=1e-6)
    with pytest.raises(ModelError, match="was not made by from_pyrobocop"):
        rcp.solution_arrays(pyo.ConcreteModel(name="other"))


@pytest.mark.ipopt
def test_a_class_is_asked_at_each_point_once_and_the_phase_keeps_its_mesh():
    times = []

    class Counted(problems.SwingUp):
        def constraint(self, c, t, x, xdot, y, u, p):
            times.append(t)
            super().constraint(c, t, x, xdot, y, u, p)

    m = rcp.from_pyrobocop(Counted())
    assert times == list(m.phase.points)
    result = rcp.solve(m)
    assert result.solved
    assert len(m.phase.grid.node_times) == Counted.elements
    assert "mesh error not known" in str(result)
    with pytest.raises(ModelError, match="was asked at the points of the mesh"):
        m.phase.remesh(20)


@pytest.mark.ipopt
def test_models_survive_copies_and_pickles():
    m = rcp.from_pyrobocop(problems.LinearComplementarity())
    models = [m, m.clone(), pickle.loads(pickle.dumps(m))]
    objectives = [rcp.solve(one, strategies=rcp.Strategy(exploration=0.0)).objective for one in models]
    assert objectives == pytest.approx([objectives[0]] * 3, rel=1e-9)
    assert models[-1].phase.trajectory().verify().largest_violation < 1e-6


def test_guesses_and_bounds_are_those_of_the_class():
    x = rcp.solution_arrays(rcp.from_pyrobocop(problems.Car())).x
    assert x[10, 0, 0] == pytest.approx(3 - 3 * np.cos(np.pi / 4))
    b = rcp.from_pyrobocop(problems.Corridor()).phase
    assert b.x0_derivative[2.0].bounds == (-1.5, 1.5)  # of element 3
    assert b.x0_derivative[2.5].bounds == (-0.6, 0.6)
    assert b.x1[2.0].bounds == (None, None)


def test_names_that_numpy_has_removed_are_there_while_a_class_is_asked():
    before = {name: hasattr(np, name) for name in ("Infinity", "infty", "PINF", "NINF", "Inf", "NaN")}
    rcp.from_pyrobocop(problems.SwingUp())
    assert {name: hasattr(np, name) for name in before} == before


# -------------------------------------------------------------------- objects


class FlyingBox(problems.Car):
    """A box in space that yaws, and a flat plate that only shifts."""

    def get_objects_info(self):
        return 2, [1, 1], [8, 4]

    def get_object_vertices(self, V, ind, x, xdot, y, u):
        signs = np.array([[sx, sy, sz] for sx in (-1, 1) for sy in (-1, 1) for sz in (-1, 1)]).T
        if ind == 0:
            c, s = np.cos(x[2]), np.sin(x[2])
            turn = np.array([[c, -s, 0 * c], [s, c, 0 * c], [0 * c, 0 * c, 1 + 0 * c]])
            V[:, :] = turn @ (signs * [[0.3], [0.2], [0.1]]) + np.array([x[0], x[1], 0.5 + x[3]]).reshape(3, 1)
        else:
            V[:, :] = np.array([[0, 1, 1, 0], [0, 0, 1, 1], [0, 0, 0, 0]]) + np.array([x[0], 0.0, -4.0]).reshape(3, 1)


@pytest.mark.parametrize("problem", [problems.Car, FlyingBox])
def test_shape_and_pose_give_the_corners_back(problem):
    given = problem()
    m = rcp.from_pyrobocop(given)
    numbers = np.random.default_rng(1).uniform(-1, 1, 4)
    t = m.phase.points.at(3)
    for j, number in enumerate(numbers):
        m.phase.component(f"x{j}")[t].set_value(number, skip_validation=True)
    for k, count in enumerate(given.get_objects_info()[2]):
        expected = np.zeros((3, count))
        given.get_object_vertices(expected, k, numbers, np.zeros(4), np.zeros(0), np.zeros(2))
        body = m.phase.avoid.record.scene.bodies[f"object{k}"]
        corners = np.array(body.shape.vertices).T
        if body.moves:
            rotation, translation = body.pose(m.phase, t).numbers()
            assert rotation @ rotation.T == pytest.approx(np.eye(len(rotation)))
            corners = rotation @ corners + translation[:, None]
        distances = np.linalg.norm(corners[:, :, None] - expected[: len(corners), None, :], axis=0)
        assert distances.min(axis=0).max() < 1e-9
        assert distances.min(axis=1).max() < 1e-9


# -------------------------------------------------------------------- what is refused


def changed(problem, **methods):
    return type("Changed", (problem,), methods)


def one_corner_moves(by):
    def get_object_vertices(self, V, ind, x, xdot, y, u):
        problems.Car.get_object_vertices(self, V, ind, x, xdot, y, u)
        V[0, 0] = V[0, 0] + by(x, u)

    return changed(problems.Car, get_object_vertices=get_object_vertices)


def of_rows(constraint):
    return changed(problems.SwingUp, constraint=lambda self, c, t, x, xdot, y, u, p: constraint(c, x, xdot, u))


def branches(c, x, xdot, u):
    c[0], c[1] = xdot[0] - x[1], xdot[1] - (u[0] if x[0] > 0 else -u[0])


def leaves_a_row_out(c, x, xdot, u):
    c[0] = xdot[0] - x[1]


def fills_floats(c, x, xdot, u):
    np.zeros(2)[0] = x[1]


def of_cost(objective):
    return changed(problems.SwingUp, objective=lambda self, t, x, xdot, y, u, p: objective(x))


REFUSED = {
    "nothing there": (object, "no method get_info, bounds, initialpoint, initialcondition, objective, constraint"),
    "no bounds of parameters": (changed(problems.QuickCart, bounds_params=None), "no method bounds_params"),
    "no place for parameters": (
        changed(problems.QuickCart, objective=lambda self, t, x, xdot, y, u: 0),
        r"objective.*cannot be called with 6 arguments",
    ),
    "times": (changed(problems.SwingUp, get_info=lambda self: (2, 0, 1, 0, 0, 10, np.arange(10))), "gives 10 times"),
    "counts": (changed(problems.SwingUp, get_info=lambda self: (2, 0, None)), "expected .n_d, n_a"),
    "bounds": (changed(problems.SwingUp, bounds=lambda self, i: (np.zeros(3), np.ones(3))), r"bounds\(0\) returned 6"),
    "text": (changed(problems.SwingUp, initialpoint=lambda self, i: ["a"]), r"initialpoint\(0\) returned \['a'\]"),
    "a start of the wrong length": (
        changed(problems.SwingUp, initialcondition=lambda self: np.zeros(3)),
        r"initialcondition\(\) returned 3 numbers",
    ),
    "bounds that cross": (changed(problems.SwingUp, bounds=lambda self, i: (np.ones(5), np.zeros(5))), "exceeds"),
    "a side without bound": (
        changed(problems.DeadZone, get_complementarity_info=lambda self: [[0], [1], [1], [1]]),
        r"the side 1 of y\[0\], which is no finite bound",
    ),
    "a branch on a state": (of_rows(branches), "constraint: its rule asks whether a relation"),
    "a row left out": (of_rows(leaves_a_row_out), "gives 1 formulas in 2 rows"),
    "floats": (of_rows(fills_floats), "dtype=object"),
    "no cost": (of_cost(lambda x: None), "returned nothing"),
    "several costs": (of_cost(lambda x: x**2), r"shape \(2,\).*Sum it"),
    "an object that is not rigid": (one_corner_moves(lambda x, u: x[3]), "object 0 has corners whose distances change"),
    "an object that a control moves": (one_corner_moves(lambda x, u: u[0]), "object 0 has corners that are no numbers"),
}


@pytest.mark.parametrize(("problem", "message"), REFUSED.values(), ids=REFUSED)
def test_what_contradicts_itself_is_refused_by_name(problem, message):
    with pytest.raises(ModelError, match=message):
        rcp.from_pyrobocop(problem())


def test_unknown_roots_are_refused():
    with pytest.raises(ModelError, match="roots = 'lobatto'"):
        rcp.from_pyrobocop(problems.SwingUp(), roots="lobatto")
    with pytest.raises(ModelError):
        rcp.from_pyrobocop(problems.SwingUp(), 2, "explicit")
