"""What travels between the coordinator of a team and its agents: plain numbers and arrays, nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pyrobocop_pyomo.numerics import Array


@dataclass(frozen=True)
class QuantityFacts:
    """One shared variable over its index, as an agent's model has it.

    Attributes
    ----------
    name : str
        Of the variable in the model, such as ``"push[a].fx"``.
    keys : tuple
        Its indices, in order.
    units : str
        As the model declares them, empty where it does not.
    group : int
        The number of its `Shared`.
    penalty : float
        As given.
    """

    name: str
    keys: tuple[object, ...]
    units: str
    group: int
    penalty: float


@dataclass(frozen=True)
class ProblemFacts:
    """What the coordinator learns about an agent's problem when it is built.

    Attributes
    ----------
    quantities : tuple of QuantityFacts
        In the order of the agent's shared values.
    has_pairs : bool
    values, fixed : float and bool arrays, shape (n,)
        First values of the shared variables, and which are fixed.
    plan : mapping of component name to float array
        The first one: what the physical score reads, and where robots are that are kept apart.
    own_controls : mapping of agent to tuple of str
        Controls of the phases of each agent whose model is in the problem: those that are free and not shared.
    """

    quantities: tuple[QuantityFacts, ...]
    has_pairs: bool
    values: Array
    fixed: np.ndarray
    plan: Mapping[str, Array]
    own_controls: Mapping[str, tuple[str, ...]]


@dataclass(frozen=True)
class Order:
    """What an agent is told to solve in a round.

    The agent minimises its own objective plus ``linear @ v`` plus ``v @ (diagonal * v) / 2`` in its shared values v.

    Attributes
    ----------
    linear, diagonal : float arrays, shape (n,)
    mu : float or None
        The barrier problem to solve; None for the problem itself, with the delta of `delta`.
    delta : float or None
        Of relaxed pairs, where mu is None: a solve without the multipliers of the last one, with this delta throughout.
    tolerance : float
    iterations : int
        Limit of Ipopt's iterations. Time limits inside a round would make iterates depend on the machine.
    values : float array, shape (n,), or None
        Where the shared variables start, if not where they are.
    others : float array, shape (neighbours, coordinates, times), or None
        Positions to keep away from.
    """

    linear: Array
    diagonal: Array
    mu: float | None
    delta: float | None = None
    tolerance: float = 1e-6
    iterations: int = 150
    values: Array | None = None
    others: Array | None = None


@dataclass(frozen=True)
class Report:
    """What an agent answers to an order.

    Attributes
    ----------
    values : float array, shape (n,)
        Its shared values.
    status : str
        Name of the `IpoptStatus`.
    usable : bool
        Whether the point can be used, which it can at an iteration limit too.
    iterations : int
    cpu_seconds : float
    objective : float
        The agent's own, without the terms of the team.
    plan : mapping of component name to float array
    """

    values: Array
    status: str
    usable: bool
    iterations: int
    cpu_seconds: float
    objective: float
    plan: Mapping[str, Array]
