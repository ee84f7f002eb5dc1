"""Complementarity in any Pyomo model: the component, its canonical form and its relaxations."""

from .component import Complementarity, ComplementarityData
from .grouping import Grouping, PerElement, PerPair
from .lifting import LiftedPair, SideVariable
from .pairs import CanonicalForm, CanonicalPair, Part, active_pairs, active_sources, canonical_form, canonical_pair
from .relaxations import ObjectiveTerm, Penalty, Relaxation, Scholtes
from .residuals import PairResidual, pair_residuals
from .schedules import Fixed, FollowBarrier, Geometric, Schedule
from .sides import canonical_side
from .statement import Complements, complements
from .transformation import RelaxationToken, RelaxComplementarity

__all__ = [
    "CanonicalForm",
    "CanonicalPair",
    "Complementarity",
    "ComplementarityData",
    "Complements",
    "Fixed",
    "FollowBarrier",
    "Geometric",
    "Grouping",
    "LiftedPair",
    "ObjectiveTerm",
    "PairResidual",
    "Part",
    "Penalty",
    "PerElement",
    "PerPair",
    "RelaxComplementarity",
    "Relaxation",
    "RelaxationToken",
    "Schedule",
    "Scholtes",
    "SideVariable",
    "active_pairs",
    "active_sources",
    "canonical_form",
    "canonical_pair",
    "canonical_side",
    "complements",
    "pair_residuals",
]
