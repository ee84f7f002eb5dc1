"""A class with PyRoboCOP's methods is the model that the same problem has in this package."""

from __future__ import annotations

import copy
import logging
import pickle

import numpy as np
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ProblemClassError
from pyrobocop_pyomo.problem_classes import solution_arrays
from pyrobocop_pyomo.problem_classes.problem_arrays import column_array

from . import native_models, problem_styles, published_problems

EQUAL = {
    "smooth": (problem_styles.Pendulum, {}, native_models.pendulum),
    "explicit Euler": (problem_styles.Pendulum, {"roots": "explicit"}, native_models.explicit_pendulum),
    "midpoint": (problem_styles.Pendulum, {"roots": "legendre"}, native_models.midpoint_pendulum),
    "least time": (problem_styles.QuickCart, {}, native_models.quick_cart),
    "parameter": (problem_styles.ParameterCurve, {}, native_models.parameter_curve),
    "pairs at lower bounds": (problem_styles.OneSided, {}, native_models.one_sided),
    "pairs at lower and upper bounds": (problem_styles.DeadZone, {}, native_models.dead_zone),
    "modes in time": (problem_styles.ModeSequence, {}, native_models.mode_sequence),
    "learned": (problem_styles.LearnedFriction, {}, native_models.learned_friction),
    "mass matrix of the states": (problem_styles.Arm, {}, native_models.arm),
    "constant mass matrix": (problem_styles.CoupledMasses, {}, native_models.coupled_masses),
    "nonlinear in the derivative": (problem_styles.RollingBall, {}, native_models.rolling_ball),
    "varying bounds": (problem_styles.Corridor, {}, native_models.corridor),
    "objects": (problem_styles.Car, {}, native_models.car),
}


@pytest.mark.ipopt
@pytest.mark.parametrize(("problem", "arguments", "native"), EQUAL.values(), ids=EQUAL)
def test_a_class_is_the_native_model(problem, arguments, native):
    m, expected = rcp.from_pyrobocop(problem(), **arguments), native()
    m.phase.check()
    # Both on the mesh that is stated: a finer one that the motion of the equations asks for is made by the same code.
    stated = {"equations": False, "mesh_tolerance": None}
    solution, of_native = rcp.solve(m, **stated), rcp.solve(expected, **stated)
    assert solution.solved
    assert of_native.solved
    assert solution.safe is of_native.safe
    assert solution.objective == pytest.approx(of_native.objective, rel=1e-6, abs=1e-7)
    assert m.phase.trajectory().verify().largest_violation < 1e-6


def test_objects_of_a_class_follow_another_mesh_like_those_of_the_native_model():
    m, expected = rcp.from_pyrobocop(problem_styles.Car()), native_models.car()
    for model in (m, expected):
        model.phase.remesh(32)
        model.phase.check()
    assert len(m.phase.avoid.separations) == len(expected.phase.avoid.separations) == 32
    rows, native_rows = (len(list(each.component_data_objects(pyo.Constraint, active=True))) for each in (m, expected))
    assert rows == native_rows


# -------------------------------------------------------------------- once for all times


@pytest.mark.heavy
@pytest.mark.parametrize("problem", published_problems.PROBLEMS, ids=lambda problem: problem.__name__)
def test_a_class_gives_its_formulas_once_for_all_times(problem):
    calls = []

    class Counted(problem):
        elements, centres = 8, 20

        def constraint(self, c, t, x, xdot, y, u, p):
            calls.append(t)
            problem.constraint(self, c, t, x, xdot, y, u, p)

    made = Counted()
    m = rcp.from_pyrobocop(made, getattr(problem, "points", 1))
    b, sizes = m.phase, m.problem.data.sizes
    m.phase.trajectory().verify()
    assert len(calls) <= 20  # of 8 elements; it was called thousands of times
    generator = np.random.default_rng(3)
    for variable in b.component_data_objects(pyo.Var):
        variable.set_value(generator.uniform(0.1, 0.9), skip_validation=True)
    (stated,) = b.record.statements_of("ode")
    (cost,) = b.record.statements_of("integral") or (None,)
    for t in b.points:
        x, y, u, p = (
            column_array([pyo.value(one.expression) for one in m.problem.variables(b, kind, t)]) for kind in "xyup"
        )
        rates = column_array([pyo.value(rate) for rate in stated(b, t).values()])
        c = np.zeros((sizes.rows, 1))
        problem.constraint(made, c, t, x, rates, y, u, p)
        # The rows that the derivatives were found from are those that hold with them.
        assert (np.abs(c) < 1e-9 * (1 + np.abs(c).max())).sum() >= len(rates)
        if cost is not None:
            assert pyo.value(cost(b, t)) == pytest.approx(float(made.objective(t, x, rates, y, u, p)), rel=1e-9)


def test_a_class_that_compares_the_time_gives_the_formulas_of_each_side():
    m = rcp.from_pyrobocop(problem_styles.ModeSequence())
    b = m.phase
    b.initialize(x0=1.0, x1=1.0, u0=1.0)
    b.p0, b.p1 = 2.0, 3.0
    (stated,) = b.record.statements_of("ode")
    assert stated.is_template(b)
    speeds = [pyo.value(stated(b, t)[b.x1]) for t in list(b.points)[:-1]]  # at the end the states are given
    assert speeds == pytest.approx([2 * (2 - 0.5)] * 5 + [3 * (1 - 1.0)] * 4)
    b.remesh(12)
    assert b.record.statements_of("ode")[0].is_template(b)


# -------------------------------------------------------------------- what comes out


@pytest.mark.ipopt
def test_values_come_in_the_shapes_of_the_original():
    m = rcp.from_pyrobocop(problem_styles.OneSided(), 2)
    rcp.solve(m)
    x, xdot, y, u, _ = arrays = solution_arrays(m)
    assert [part.shape for part in arrays] == [(13, 1, 3), (12, 1, 2), (12, 2, 2), (12, 1, 2), (0,)]
    assert x[0, 0, 0] == 1.0
    assert x[1:, :, 0] == pytest.approx(x[:-1, :, -1])  # Radau: an element ends where the next one starts
    assert xdot == pytest.approx(3 * x[:-1, :, 1:] - 0.5 * y[:, :1] + 3 * u, abs=1e-6)
    assert y[:, 1] == pytest.approx(y[:, 0] - 2 * u[:, 0], abs=1e-6)
    with pytest.raises(ProblemClassError, match="was not made by from_pyrobocop"):
        solution_arrays(pyo.ConcreteModel(name="other"))


def test_arrays_on_another_mesh_say_that_n_has_changed(caplog):
    m = rcp.from_pyrobocop(problem_styles.Pendulum())
    solution_arrays(m)
    assert not caplog.records
    m.phase.remesh(17)
    x, xdot, y, u, _ = solution_arrays(m)
    assert [part.shape for part in (x, xdot, y, u)] == [(18, 2, 2), (17, 2, 1), (17, 0, 1), (17, 1, 1)]
    assert "N = 17 elements, where get_info says 12" in caplog.text
    caplog.clear()
    m.phase.remesh(m.problem.data.sizes.times)
    assert len(solution_arrays(m).x) == 13
    assert not caplog.records


@pytest.mark.ipopt
def test_models_survive_copies_and_pickles():
    m = rcp.from_pyrobocop(problem_styles.OneSided(), compl=1, compladapt=1)
    again = [copy.deepcopy(m), m.clone(), pickle.loads(pickle.dumps(m))]
    objectives = [rcp.solve(one, exploration=0.0).objective for one in (m, *again)]
    assert objectives == pytest.approx([objectives[0]] * 4, rel=1e-9)
    assert again[-1].phase.trajectory().verify().largest_violation < 1e-6


@pytest.mark.ipopt
@pytest.mark.parametrize("treatment", [(0, 0), (1, 0), (0, 1), (1, 1), (2, 0)])
def test_the_treatment_of_pairs_can_be_that_of_the_arguments(treatment):
    m = rcp.from_pyrobocop(problem_styles.OneSided(), 1, "radau", *treatment)
    relaxed = rcp.solve(m, polish=False, exploration=0.0, **m.problem.solve_options)
    largest = {0: 1e-4, 1: 1e-6}[treatment[1]] if treatment[0] < 2 else 1e-8
    arrays = solution_arrays(m)
    assert (arrays.y[:, 0] * arrays.y[:, 1]).max() <= 1.01 * largest
    assert relaxed.objective == pytest.approx(0.66647, rel=1e-3)


def test_without_a_wish_pairs_are_treated_as_everywhere():
    assert rcp.from_pyrobocop(problem_styles.OneSided()).problem.solve_options == {}


def test_derivatives_by_hand_are_ignored_with_a_notice(caplog):
    with caplog.at_level(logging.WARNING):
        rcp.from_pyrobocop(problem_styles.QuickCart(), autodiff=0)
    assert "gradient, jacobian, hessian are ignored" in caplog.text


def test_guesses_are_those_of_the_class_or_straight_lines():
    published = rcp.from_pyrobocop(problem_styles.Car())
    assert solution_arrays(published).x[10, 0, 0] == pytest.approx(3 - 3 * np.cos(np.pi / 4))
    lines = rcp.from_pyrobocop(problem_styles.Car(), guess="straight line")
    assert solution_arrays(lines).x[10, 0, 0] == pytest.approx(1.5)
    with pytest.raises(ProblemClassError, match="guess = 'mine'"):
        rcp.from_pyrobocop(problem_styles.Car(), guess="mine")


def test_rows_are_solved_for_the_derivatives_where_they_can_be():
    def implicit(problem):
        return rcp.from_pyrobocop(problem()).problem.implicit

    assert implicit(problem_styles.Arm) == []
    assert implicit(problem_styles.CoupledMasses) == []
    assert implicit(problem_styles.RollingBall) == [0]

    class Singular(problem_styles.Pendulum):
        def constraint(self, c, t, x, xdot, y, u, p):
            c[0] = x[0] * xdot[0] - x[1]  # a coefficient that changes its sign
            c[1] = xdot[1] - u[0]

    assert implicit(Singular) == [0]


# -------------------------------------------------------------------- objects


def bodies_of(problem):
    return rcp.from_pyrobocop(problem()).phase.avoid.record.scene.bodies


class SwappingBoxes(problem_styles.Car):
    """Two moving shapes, one of them a triangle around no centre; corners by products of arrays."""

    def get_objects_info(self):
        return 2, np.ones((2, 1)), np.array([[4], [3]])

    def get_object_vertices(self, V, ind, x, xdot, y, u):
        corners = [
            np.array([[0.3, -0.3, -0.3, 0.3], [0.2, 0.2, -0.2, -0.2]]),
            np.array([[0.3, -0.2, -0.2], [0, 0.3, -0.3]]),
        ]
        angle = x[2] if ind == 0 else 0.3 + 2 * x[2]
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        V[0:2, :] = turn @ corners[ind] + np.array([x[0] + 5 * ind, x[1]]).reshape(2, 1)
        V[2, :] = 0


class Links(problem_styles.Car):
    """An arm: the second link turns about a point that no affine function gives."""

    def get_object_vertices(self, V, ind, x, xdot, y, u):
        if ind == 0:
            problem_styles.Car.get_object_vertices(self, V, ind, x, xdot, y, u)
            return
        base, angle = np.array([np.cos(x[0]), np.sin(x[0])]), x[0] + x[2]
        for k, (along, across) in enumerate([(0.1, -0.05), (0.9, -0.05), (0.9, 0.05), (0.1, 0.05)]):
            V[0, k] = base[0] + along * np.cos(angle) - across * np.sin(angle)
            V[1, k] = base[1] + along * np.sin(angle) + across * np.cos(angle)


class FlyingBox(problem_styles.Car):
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


@pytest.mark.parametrize("problem", [problem_styles.Car, SwappingBoxes, Links, FlyingBox])
def test_shape_and_pose_give_the_corners_back(problem):
    made = problem()
    m = rcp.from_pyrobocop(made)
    generator = np.random.default_rng(1)
    numbers = generator.uniform(-1, 1, 4)
    t = m.phase.points.at(3)
    for j, number in enumerate(numbers):
        m.phase.component(f"x{j}")[t].set_value(number, skip_validation=True)
    count, _, corner_counts = made.get_objects_info()
    for k in range(count):
        expected = np.zeros((3, int(np.ravel(corner_counts)[k])))
        made.get_object_vertices(expected, k, numbers, np.zeros(4), np.zeros(0), np.zeros(2))
        body = m.phase.avoid.record.scene.bodies[f"object{k}"]
        corners = np.array(body.shape.vertices).T
        if body.moves:
            rotation, translation = body.pose(m.phase, t).numbers()
            corners = rotation @ corners + translation[:, None]
        distances = np.linalg.norm(corners[:, :, None] - expected[: len(corners), None, :], axis=0)
        assert distances.min(axis=0).max() < 1e-9
        assert distances.min(axis=1).max() < 1e-9


def test_poses_are_affine_where_they_can_be():
    kinds = [type(body.pose.rule).__name__ for body in bodies_of(SwappingBoxes).values()]
    assert kinds == ["AffinePose", "AffinePose"]
    assert type(bodies_of(Links)["object1"].pose.rule).__name__ == "PoseOfCorners"


# -------------------------------------------------------------------- what is refused


class OfItsTime(problem_styles.Pendulum):
    """Bounds in the words of NumPy before version 2, and algebraics at the start, of which there are none."""

    def bounds(self, i):
        upper = np.array([2 * np.pi, 10, np.infty, np.Infinity, 10])  # noqa: NPY201
        return np.array([-2 * np.pi, -10, np.NINF, -np.Inf, -10]), upper  # noqa: NPY201


def test_names_that_numpy_has_removed_are_there_while_a_class_is_asked():
    before = {name: hasattr(np, name) for name in ("Infinity", "infty", "PINF", "NINF", "Inf", "NaN")}
    m = rcp.from_pyrobocop(OfItsTime())
    assert {name: hasattr(np, name) for name in before} == before
    expected = rcp.from_pyrobocop(problem_styles.Pendulum())
    assert [v.bounds for v in m.phase.x1.values()] == [v.bounds for v in expected.phase.x1.values()]


class StartOfAlgebraics(problem_styles.OneSided):
    """Gives values of the algebraics at the start."""

    def initialcondition(self):
        start = super().initialcondition()
        return *(start if isinstance(start, tuple) else (start, start)), np.zeros(self.get_info()[1])


def test_algebraics_at_the_start_are_left_to_the_equations():
    m, expected = (rcp.from_pyrobocop(problem()) for problem in (StartOfAlgebraics, problem_styles.OneSided))
    assert [v.value for v in m.phase.x0.values()] == [v.value for v in expected.phase.x0.values()]


class Stretching(problem_styles.Car):
    def get_object_vertices(self, V, ind, x, xdot, y, u):
        super().get_object_vertices(V, ind, x, xdot, y, u)
        V[0, 0] = V[0, 0] + x[3]


class Steered(problem_styles.Car):
    def get_object_vertices(self, V, ind, x, xdot, y, u):
        super().get_object_vertices(V, ind, x, xdot, y, u)
        V[0, 0] = V[0, 0] + u[0]


class Branching(problem_styles.Pendulum):
    def constraint(self, c, t, x, xdot, y, u, p):
        c[0] = xdot[0] - x[1]
        c[1] = xdot[1] - (u[0] if x[0] > 0 else -u[0])


class Unfinished(problem_styles.Pendulum):
    def constraint(self, c, t, x, xdot, y, u, p):
        c[0] = xdot[0] - x[1]


class Overfilled(problem_styles.Pendulum):
    def constraint(self, c, t, x, xdot, y, u, p):
        c[0], c[1], c[2] = xdot[0] - x[1], xdot[1] - u[0], x[0]


class FloatsInside(problem_styles.Pendulum):
    def constraint(self, c, t, x, xdot, y, u, p):
        rates = np.zeros(2)
        rates[0] = x[1]


class NoCost(problem_styles.Pendulum):
    def objective(self, t, x, xdot, y, u, p):
        x[0] ** 2


class VectorCost(problem_styles.Pendulum):
    def objective(self, t, x, xdot, y, u, p):
        return x**2


class Contradictory(problem_styles.QuickCart):
    bounds_params = None

    def bounds(self, i):
        return np.zeros(3), np.ones(3)

    def initialcondition(self):
        return np.zeros(3)

    def objective(self, t, x, xdot, y, u):
        return 0


class OneTimeTooFew(problem_styles.Pendulum):
    def get_info(self):
        return 2, 0, 1, 0, 0, 10, np.linspace(0, 1, 10), 0, 0


class WithoutBound(problem_styles.OneSided):
    def bounds(self, i):
        lower, upper = super().bounds(i)
        lower[1 + 1] = -1e30
        return lower, upper


REFUSED = {
    "nothing there": (object, "no method get_info, bounds, initialpoint, initialcondition, objective, constraint"),
    "all at once": (
        Contradictory,
        r"bounds_params.*no place for the 1 parameters p.*bounds\(0\).*\[3, 3\].*initialcondition\(\) returned 3",
    ),
    "times": (OneTimeTooFew, r"10 times for 10 elements; N \+ 1 = 11"),
    "a side without bound": (WithoutBound, r"pair 0 uses the lower bound of y\[0\], which bounds\(0\) leaves infinite"),
    "a branch on a state": (Branching, "constraint.*cannot branch on variables"),
    "a row left out": (Unfinished, "row 1 of 2"),
    "a row too many": (Overfilled, r"IndexError.*n_d \+ n_a - n_cc rows"),
    "floats": (FloatsInside, "dtype=object"),
    "no cost": (NoCost, "returned None"),
    "several costs": (VectorCost, r"shape \(2,\).*Sum it"),
    "an object that is not rigid": (Stretching, "object 0 .*distances between its corners change"),
    "an object that a control moves": (Steered, r"reads u\[0\]"),
}


@pytest.mark.parametrize(("problem", "message"), REFUSED.values(), ids=REFUSED)
def test_what_contradicts_itself_is_refused_by_name(problem, message):
    with pytest.raises(ProblemClassError, match=message):
        rcp.from_pyrobocop(problem())


ARGUMENTS = [
    ({"ncolloc": 0}, "ncolloc = 0"),
    ({"roots": "lobatto"}, "roots = 'lobatto'"),
    ({"roots": "explicit", "ncolloc": 2}, "explicit Euler"),
    ({"compl": 3}, "compl = 3"),
    ({"compladapt": 2}, "compladapt = 2"),
    ({"compleps": 0.0}, "compleps = 0"),
    ({"autodiff": 2}, "autodiff = 2"),
]


@pytest.mark.parametrize(("arguments", "message"), ARGUMENTS)
def test_unknown_arguments_are_refused(arguments, message):
    with pytest.raises(ProblemClassError, match=message):
        rcp.from_pyrobocop(problem_styles.Pendulum(), **arguments)
