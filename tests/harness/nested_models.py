"""Random models whose named Expressions use each other: what an AMPL Solver Library has to differentiate rightly."""

import random
from typing import Any

import numpy as np
import pyomo.environ as pyo

from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, NonlinearProgram

# Larger values would leave finite differences too few digits.
LARGEST_VALUE = 30.0
# Of 3000 random models with nested Expressions, ten of those that the library of 2019 differentiates wrongly:
# gradients, Hessians, both; and one that it does when the expressions are written out.
NESTED = (15, 165, 256, 285, 464, 737, 856, 1784, 2195, 2905)
EXPANDED = (871,)


def nested_model(seed: int, *, named: bool = True) -> pyo.ConcreteModel:
    """A model with one to eight rows in two to ten variables, made of two to twenty expressions.

    Parameters
    ----------
    seed : int
        Another number gives another model, the same number the same.
    named : bool
        Whether what is used many times is a named Expression.
    """
    choice = random.Random(seed)
    while True:
        model = _model(choice, named)
        expressions = [*model.e.values(), *(row.body for row in model.rows.values()), model.objective.expr]
        if all(abs(pyo.value(expression)) < LARGEST_VALUE for expression in expressions):
            return model


def _model(choice: random.Random, named: bool) -> pyo.ConcreteModel:
    model = pyo.ConcreteModel("nested")
    model.x = pyo.Var(range(choice.randint(2, 10)), initialize=lambda _, i: 0.5 + choice.random())
    model.e = pyo.Expression(range(choice.randint(2, 20)))
    x = list(model.x.values())
    atoms = list(x)
    for i in model.e:
        expression = _expression(choice, atoms, choice.randint(1, 3))
        model.e[i] = expression
        atoms += 2 * [model.e[i] if named else expression]
    model.rows = pyo.Constraint(range(choice.randint(1, 8)))
    for i in model.rows:
        leaves = atoms[len(x) :] if choice.random() < 0.7 else atoms
        every = sum(variable + 0.001 * variable**2 for variable in x) if i == 0 else x[0] + 0.001 * x[-1] ** 2
        model.rows[i] = _expression(choice, leaves, choice.randint(1, 4)) + every <= 100
    model.objective = pyo.Objective(expr=_expression(choice, atoms, choice.randint(0, 4)) + x[0] ** 2)
    return model


def _expression(choice: random.Random, atoms: list[Any], depth: int) -> Any:
    def inner() -> Any:
        return _expression(choice, atoms, depth - 1)

    if depth == 0 or choice.random() < 0.2:
        return choice.choice(atoms)
    made = (
        lambda: inner() + inner(),
        lambda: inner() + choice.choice(atoms),
        lambda: inner() + choice.choice((1.0, -0.5)),
        lambda: sum(inner() for _ in range(choice.randint(3, 5))),
        lambda: inner() - inner(),
        lambda: inner() * inner(),
        lambda: inner() / (2 + pyo.cos(inner())),
        lambda: pyo.sin(inner()),
        lambda: pyo.exp(0.3 * pyo.sin(inner())),
        lambda: inner() ** 2,
        lambda: -inner(),
        lambda: 2.0 * inner(),
    )
    return choice.choice(made)()


def differ_from_differences(
    program: NonlinearProgram, x: FloatArray, factor: float = 1.0, multipliers: FloatArray | None = None
) -> list[str]:
    """Which derivatives are not those of the functions: by central differences, to five digits of the largest.

    A long step is wrong where the function bends, a short one where it is rounded; a wrong derivative is so with each.
    """
    multipliers = np.linspace(0.7, 1.9, program.m) if multipliers is None else multipliers
    gradient, jacobian = program.gradient(x), _jacobian(program, x)
    hessian = np.zeros((program.n, program.n))
    np.add.at(hessian, program.hessian_structure, program.hessian(x, factor, multipliers))
    hessian += np.tril(hessian, -1).T

    def functions(at: FloatArray) -> FloatArray:
        return np.append(program.objective(at), program.constraints(at))

    def lagrangian_gradient(at: FloatArray) -> FloatArray:
        return factor * program.gradient(at) + multipliers @ _jacobian(program, at)

    differ = ["gradient", "Jacobian", "Hessian"]
    for length in (1e-5, 1e-6, 1e-7):
        steps = length * np.eye(program.n)
        first = np.array([functions(x + step) - functions(x - step) for step in steps]).T / (2 * length)
        second = np.array([lagrangian_gradient(x + step) - lagrangian_gradient(x - step) for step in steps])
        compared = {
            "gradient": (gradient, first[0]), "Jacobian": (jacobian, first[1:]),
            "Hessian": (hessian, second / (2 * length)),
        }  # fmt: skip
        differ = [name for name in differ if not _agree(*compared[name])]
        if not differ:
            break
    return differ


def _agree(given: FloatArray, found: FloatArray) -> bool:
    return bool(np.max(np.abs(given - found), initial=0.0) < 1e-5 * (1.0 + np.max(np.abs(found), initial=0.0)))


def _jacobian(program: NonlinearProgram, x: FloatArray) -> FloatArray:
    values = np.zeros((program.m, program.n))
    np.add.at(values, program.jacobian_structure, program.jacobian(x))
    return values
