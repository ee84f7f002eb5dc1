"""Complementarity in any Pyomo model: the component, its canonical form and its relaxations."""

from .canonical import CanonicalForm, CanonicalPair, Part
from .component import Complementarity, ComplementarityData
from .forms import form_of
from .grouping import Grouping, PerElement, PerPair
from .pairs import active_pairs, canonical_form, canonical_pair
from .relaxations import ObjectiveTerm, Penalty, Relaxation, Scholtes
from .residuals import PairResidual, pair_residuals, side_values
from .schedules import Fixed, FollowBarrier, Geometric, Schedule
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
    "active_pairs",
    "canonical_form",
    "canonical_pair",
    "complements",
    "form_of",
    "pair_residuals",
    "side_values",
]
