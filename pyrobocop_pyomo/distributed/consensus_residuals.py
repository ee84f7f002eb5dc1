"""How far agents are apart, in one round."""

from __future__ import annotations

import numpy as np

from pyrobocop_pyomo.numerics import Array

from .messages import PenaltyMatrix


class ConsensusResiduals:
    """How far the agents are apart, and how far what they agree on has moved, for each `Shared`.

    Parameters
    ----------
    groups : int

    Attributes
    ----------
    disagreement, change : float arrays, shape (groups,)
        The largest of each.
    scaled : float array, shape (groups,)
        Largest disagreement times the square root of its penalty as given: comparable between groups, whatever their
        units.
    """

    def __init__(self, groups: int) -> None:
        self.disagreement, self.change, self.scaled = np.zeros((3, groups))

    def add(self, penalty: PenaltyMatrix, gap: Array, moved: Array) -> None:
        """Add an agent: its distances from what is agreed on, and how far that has moved."""
        groups = penalty.groups
        np.maximum.at(self.scaled, groups, np.sqrt(penalty.diagonal) * np.abs(gap))
        np.maximum.at(self.disagreement, groups, np.abs(gap))
        np.maximum.at(self.change, groups, np.abs(moved))
