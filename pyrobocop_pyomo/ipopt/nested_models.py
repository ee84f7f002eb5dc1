"""Random models whose named Expressions use each other: what an AMPL Solver Library has to differentiate rightly."""

from __future__ import annotations

import random
from typing import Any

import pyomo.environ as pyo

# Larger values would leave finite differences too few digits.
LARGEST_VALUE = 30.0


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
