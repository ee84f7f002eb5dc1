"""References of textbook problems whose sources give too few digits, by Radau collocation in CasADi and Ipopt alone.

    python benchmarks/independent_transcription.py [--quick] [--only NAME ...]

Nothing of `pyrobocop_pyomo` takes part in the computation: the problems are stated a second time, as CasADi functions,
in ``benchmarks/textbook_references``, and collocated here with the flipped Legendre-Gauss-Radau points. Elements are
halved where the differential equations do not hold between the points, until they hold or elements are tiny; then all
are halved and get one point more. Shown are the optimum on the last two of these meshes, how far they are apart,
relatively, and the value that the table of ``benchmarks/textbook.py`` compares with.

The exit code is 0 only if both meshes and the table agree to 1e-6.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import casadi
import numpy as np
from table import Table, show_progress
from textbook_problems import PROBLEMS
from textbook_references import STATEMENTS
from textbook_references.statement import Arc, Ends, Statement

QUICK = "short_wire"
AGREEMENT = 1e-6
ROUNDS = 25  # of refinement, at most
COLUMNS = [
    ("problem", "<26"), ("elements", ">8d"), ("optimum", ">17.11g"), ("finer", ">17.11g"), ("apart", ">8.0e"),
    ("in the table", ">15.10g"), ("off", ">8.0e"), ("CPU s", ">6.1f"), ("verdict", "<12"),
]  # fmt: skip


@dataclass(frozen=True)
class Optimum:
    """What a mesh gives.

    Attributes
    ----------
    objective : float
    converged : bool
        Whether Ipopt says so.
    meshes : list of array
        Boundaries of elements from 0 to 1, of each arc.
    degree : int
    points : list of (states, controls, duration)
        Of each arc: states at all nodes, shape (n, elements * degree + 1); controls at collocation points, shape
        (m, elements * degree).
    parameters : array
    errors : list of array
        How far the states miss the integral of their rates in each element, relative to their sizes.
    """

    objective: float
    converged: bool
    meshes: list[np.ndarray]
    degree: int
    points: list[tuple[np.ndarray, np.ndarray, float]]
    parameters: np.ndarray
    errors: list[np.ndarray]


def nodes(degree: int) -> np.ndarray:
    """Zero and the Radau points up to one."""
    return np.array([0.0, *casadi.collocation_points(degree, "radau")])


def lagrange(at: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Values of the Lagrange polynomials of `at` at other places: one row for each place."""
    values = np.ones((len(places), len(at)))
    for j, own in enumerate(at):
        for i, other in enumerate(at):
            if i != j:
                values[:, j] *= (places - other) / (own - other)
    return values


def differentiation(at: np.ndarray) -> np.ndarray:
    """Derivatives of the Lagrange polynomials of `at` at these places themselves."""
    weights = np.array([1 / np.prod(own - np.delete(at, j)) for j, own in enumerate(at)])
    with np.errstate(divide="ignore"):
        matrix = weights[None, :] / weights[:, None] / (at[:, None] - at[None, :])
    np.fill_diagonal(matrix, 0.0)
    np.fill_diagonal(matrix, -matrix.sum(axis=1))
    return matrix


class _ArcVariables:
    """An arc on a mesh: variables, rows, bounds and the guess."""

    def __init__(self, arc: Arc, mesh: np.ndarray, degree: int, p: Any, before: _ArcVariables | None) -> None:
        self.arc, self.mesh, self.degree = arc, mesh, degree
        n, m, count = len(arc.states), len(arc.controls), (len(mesh) - 1) * degree
        self.scale = np.array(arc.scale or [1.0] * n, dtype=float)
        self.x, self.u = casadi.MX.sym("x", n, count + 1), casadi.MX.sym("u", m, count)
        self.duration = casadi.MX.sym("T")
        self.begins = before.begins + before.duration if arc.follows and before is not None else casadi.MX(arc.start)
        at = nodes(degree)
        places = np.concatenate([low + (high - low) * at[1:] for low, high in pairwise(mesh)])
        self.places = np.concatenate([[0.0], places])
        self.function = _function(arc, p.numel())
        t = self.begins + self.duration * casadi.DM(places).T
        states = casadi.diag(casadi.DM(self.scale)) @ self.x
        rates, running, path = self.function.map(count)(t, states[:, 1:], self.u, casadi.repmat(p, 1, count))
        matrix, rows = differentiation(at)[1:], []
        for k, width in enumerate(np.diff(mesh)):
            here = slice(k * degree + 1, (k + 1) * degree + 1)
            left = self.x[:, k * degree : (k + 1) * degree + 1] @ casadi.DM(matrix).T
            right = rates[:, here.start - 1 : here.stop - 1] * (width * self.duration)
            rows.append(casadi.vec(left - casadi.diag(casadi.DM(1 / self.scale)) @ right))
        weights = quadrature(at)
        all_weights = np.concatenate([width * weights for width in np.diff(mesh)])
        integral = self.duration * (running @ casadi.DM(all_weights))
        self.rows, self.path = casadi.vertcat(*rows), casadi.vec(path)
        self.ends = Ends(self.begins, states[:, 0], self.begins + self.duration, states[:, -1], integral)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Of all variables, scaled."""
        arc, count = self.arc, self.x.shape[1]
        low, high = (
            np.repeat(np.array(side, dtype=float)[:, None], count, 1) for side in zip(*arc.states, strict=True)
        )
        for given, column in ((arc.first, 0), (arc.last, -1)):
            for i, value in enumerate(given):
                if value is not None:
                    low[i, column] = high[i, column] = value
        low, high = low / self.scale[:, None], high / self.scale[:, None]
        fixed = isinstance(arc.duration, (int, float))
        times = (arc.duration, arc.duration) if fixed else arc.duration
        controls = np.array(arc.controls, dtype=float).reshape(-1, 2)
        sides = []
        for side, states in enumerate((low, high)):
            sides.append(np.concatenate([states.T.ravel(), np.tile(controls[:, side], count - 1), [times[side]]]))
        return sides[0], sides[1]

    def guess(self) -> np.ndarray:
        """What the statement says, scaled."""
        pairs = [self.arc.guess(float(s)) for s in self.places]
        states = np.array([pair[0] for pair in pairs], dtype=float) / self.scale
        controls = np.array([pair[1] for pair in pairs[1:]], dtype=float)
        fixed = isinstance(self.arc.duration, (int, float))
        time_taken = self.arc.duration if fixed else self.arc.guessed_duration
        return np.concatenate([states.ravel(), controls.ravel(), [time_taken]])

    def interpolated(self, mesh: np.ndarray, degree: int, point: tuple[np.ndarray, np.ndarray, float]) -> np.ndarray:
        """A point of another mesh on this one, scaled."""
        states, controls, duration = point
        x = np.array([_value(mesh, degree, states, s, skip=0) for s in self.places]) / self.scale
        u = np.array([_value(mesh, degree, controls, s, skip=1) for s in self.places[1:]])
        return np.concatenate([x.ravel(), u.ravel(), [duration]])

    def split(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """States, controls and the duration from all variables."""
        n, columns = self.x.shape
        states = values[: n * columns].reshape(columns, n).T * self.scale[:, None]
        controls = values[n * columns : -1].reshape(columns - 1, -1).T
        return states, controls, float(values[-1])

    def errors(self, point: tuple[np.ndarray, np.ndarray, float], p: np.ndarray, begins: float) -> np.ndarray:
        """How far the states of each element miss the integrals of their rates, relative to their sizes."""
        states, controls, duration = point
        at, d = nodes(self.degree), self.degree
        inner = nodes(self.degree + 2)[1:]
        weights = quadrature(nodes(self.degree + 2))
        x_at, u_at = lagrange(at, inner), lagrange(at[1:], inner)
        derivatives = x_at @ differentiation(at)
        size = np.maximum(np.abs(states).max(axis=1), 1e-3 * self.scale)
        found = []
        for k, (low, high) in enumerate(pairwise(self.mesh)):
            x, u = states[:, k * d : (k + 1) * d + 1], controls[:, k * d : (k + 1) * d]
            t = begins + duration * (low + (high - low) * inner)
            given = np.repeat(p[:, None], len(inner), 1)
            rates = np.array(self.function.map(len(inner))(t[None, :], x @ x_at.T, u @ u_at.T, given)[0])
            misses = np.abs(x @ derivatives.T - rates * duration * (high - low)) @ weights
            found.append(float((misses / size).max()))
        return np.array(found)


def quadrature(at: np.ndarray) -> np.ndarray:
    """Weights of the points after the first."""
    points, weights = np.polynomial.legendre.leggauss(len(at))
    return lagrange(at[1:], (points + 1) / 2).T @ weights / 2


def _function(arc: Arc, parameters: int) -> casadi.Function:
    t, x = casadi.SX.sym("t"), casadi.SX.sym("x", len(arc.states))
    u, p = casadi.SX.sym("u", len(arc.controls)), casadi.SX.sym("p", parameters)
    running = casadi.SX(0) if arc.running is None else arc.running(t, x, u, p)
    path = [] if arc.path is None else arc.path(t, x, u, p)
    rates = casadi.vertcat(*arc.dynamics(t, x, u, p))
    return casadi.Function("arc", [t, x, u, p], [rates, running, casadi.vertcat(casadi.SX(0, 1), *path)])


def _value(mesh: np.ndarray, degree: int, values: np.ndarray, place: float, *, skip: int) -> np.ndarray:
    k = int(np.clip(np.searchsorted(mesh, place, side="left") - 1, 0, len(mesh) - 2))
    inside = np.array([(place - mesh[k]) / (mesh[k + 1] - mesh[k])])
    columns = values[:, k * degree : (k + 1) * degree + 1 - skip]
    return columns @ lagrange(nodes(degree)[skip:], inside)[0]


def optimum(statement: Statement, meshes: Sequence[np.ndarray], degree: int, warm: Optimum | None = None) -> Optimum:
    """On given meshes, from the guess of the statement or from the optimum on others."""
    p = casadi.MX.sym("p", len(statement.parameters))
    arcs: list[_ArcVariables] = []
    for arc, mesh in zip(statement.arcs, meshes, strict=True):
        arcs.append(_ArcVariables(arc, mesh, degree, p, arcs[-1] if arcs else None))
    ends = [arc.ends for arc in arcs]
    variables = casadi.vertcat(*(part for a in arcs for part in (casadi.vec(a.x), casadi.vec(a.u), a.duration)), p)
    sides = [arc.bounds() for arc in arcs]
    given = np.array(statement.parameters, dtype=float).reshape(-1, 3)
    low, high = (np.concatenate([*(s[side] for s in sides), given[:, side]]) for side in (0, 1))
    if warm is None:
        start = np.concatenate([*(arc.guess() for arc in arcs), given[:, 2]])
    else:
        before = zip(arcs, warm.meshes, warm.points, strict=True)
        start = np.concatenate([*(arc.interpolated(m, warm.degree, q) for arc, m, q in before), warm.parameters])
    rows, row_low, row_high = [], [], []
    for arc in arcs:
        rows += [arc.rows, arc.path]
        bounds = np.tile(np.array(arc.arc.path_bounds, dtype=float).reshape(-1, 2), (arc.x.shape[1] - 1, 1))
        zeros = np.zeros(arc.rows.numel())
        row_low += [zeros, bounds[:, 0]]
        row_high += [zeros, bounds[:, 1]]
    if statement.conditions is not None:
        rows.append(casadi.vertcat(*statement.conditions(ends, p)))
        bounds = np.array(statement.condition_bounds, dtype=float)
        row_low.append(bounds[:, 0])
        row_high.append(bounds[:, 1])
    factor = (-1.0 if statement.maximise else 1.0) * statement.size
    program = {"x": variables, "f": statement.objective(ends, p) / factor, "g": casadi.vertcat(*rows)}
    options: dict[str, Any] = {"tol": 1e-10, "constr_viol_tol": 1e-10, "print_level": 0, "sb": "yes", "max_iter": 3000}
    options |= {"acceptable_tol": 1e-8, "acceptable_iter": 30, "bound_relax_factor": 1e-11}
    options |= statement.options if warm is None else {"mu_init": 1e-5, "bound_push": 1e-6, "bound_frac": 1e-6}
    solver = casadi.nlpsol("solver", "ipopt", program, {"ipopt": options, "print_time": False, "error_on_fail": False})
    found = solver(x0=start, lbx=low, ubx=high, lbg=np.concatenate(row_low), ubg=np.concatenate(row_high))
    values, points, passed = np.array(found["x"]).ravel(), [], 0
    for arc in arcs:
        length = arc.x.numel() + arc.u.numel() + 1
        points.append(arc.split(values[passed : passed + length]))
        passed += length
    parameters, errors, begins = values[passed:], [], 0.0
    for arc, point in zip(arcs, points, strict=True):
        begins = begins if arc.arc.follows else arc.arc.start
        errors.append(arc.errors(point, parameters, begins))
        begins += point[2]
    converged = solver.stats()["success"]
    return Optimum(factor * float(found["f"]), converged, list(meshes), degree, points, parameters, errors)


def first_mesh(arc: Arc, elements: int) -> np.ndarray:
    """Equal elements, and the instants that have to be boundaries."""
    equal = np.linspace(0.0, 1.0, elements + 1)
    kept = [s for s in equal if all(abs(s - other) > 0.2 / elements for other in arc.breaks)]
    return np.unique([0.0, *kept, *arc.breaks, 1.0])


def refined(statement: Statement) -> tuple[Optimum, Optimum]:
    """The optimum on a mesh that follows the solution, and on one with twice the elements and one point more."""
    meshes = [first_mesh(arc, statement.elements) for arc in statement.arcs]
    found = optimum(statement, meshes, statement.degree)
    for _ in range(ROUNDS):
        wide = [np.diff(mesh) > statement.width for mesh in meshes]
        marks = [(errors > statement.error) & w for errors, w in zip(found.errors, wide, strict=True)]
        if not any(mark.any() for mark in marks):
            break
        meshes = [_halved(mesh, mark) for mesh, mark in zip(meshes, marks, strict=True)]
        found = optimum(statement, meshes, statement.degree, found if found.converged else None)
    meshes = [_halved(mesh, np.ones(len(mesh) - 1, dtype=bool)) for mesh in meshes]
    return found, optimum(statement, meshes, statement.degree + 1, found)


def _halved(mesh: np.ndarray, marks: np.ndarray) -> np.ndarray:
    return np.unique(np.concatenate([mesh, ((mesh[1:] + mesh[:-1]) / 2)[marks]]))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = [statement.name for statement in STATEMENTS]
    parser.add_argument("--only", nargs="+", choices=names, metavar="NAME", help="some of the problems")
    parser.add_argument("--quick", action="store_true", help="one problem")
    arguments = parser.parse_args()
    shown = arguments.only or ([QUICK] if arguments.quick else names)
    given = {problem.name: problem.published for problem in PROBLEMS}
    table, right = Table(COLUMNS), True
    table.header()
    for statement in STATEMENTS:
        if statement.name not in shown:
            continue
        show_progress(statement.name)
        started = time.process_time()
        first, finer = refined(statement)
        apart = abs(first.objective - finer.objective) / abs(finer.objective)
        written = given.get(statement.name)
        off = None if written is None else abs(written - finer.objective) / abs(finer.objective)
        sure = first.converged and finer.converged and apart <= AGREEMENT
        agrees = sure and off is not None and off <= AGREEMENT
        right &= agrees
        show_progress("")
        table.add(
            statement.name, sum(len(mesh) - 1 for mesh in finer.meshes), first.objective, finer.objective, apart,
            written, off, time.process_time() - started,
            "agrees" if agrees else "sure" if sure else "not sure" if finer.converged else "not solved",
        )  # fmt: skip
    sys.exit(0 if right else 1)


if __name__ == "__main__":
    main()
