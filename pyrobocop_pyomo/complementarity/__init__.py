"""Complementarity in any Pyomo model: the component, its canonical form and its relaxations."""

from .canonical import CanonicalForm, CanonicalPair, Part
from .component import Complementarity, ComplementarityData
from .disjunctions import ComplementarityToDisjunctions, DisjunctionToken
from .forms import form_of
from .grouping import AllPairs, Crossed, Grouping, PerElement, PerPair, PerPhase
from .lifting import LiftedPair, SideVariable
from .pairs import active_pairs, active_sources, canonical_form, canonical_pair
from .relaxations import (
    AugmentedLagrangian,
    ChenHarkerKanzowSmale,
    Elastic,
    FischerBurmeister,
    Kadrani,
    KanzowSchwartz,
    KeepsBounds,
    KeepsMultipliers,
    LinFukushima,
    ObjectiveTerm,
    Penalty,
    Relaxation,
    Scholtes,
    SteffensenUlbrich,
    TwoSided,
)
from .residuals import ComponentResidual, PairResidual, component_residuals, pair_residuals, side_values
from .schedules import Fixed, FollowBarrier, Geometric, Schedule, Superlinear
from .statement import Complements, complements
from .transformation import RelaxationToken, RelaxComplementarity

__all__ = [
    "AllPairs",
    "AugmentedLagrangian",
    "CanonicalForm",
    "CanonicalPair",
    "ChenHarkerKanzowSmale",
    "Complementarity",
    "ComplementarityData",
    "ComplementarityToDisjunctions",
    "Complements",
    "ComponentResidual",
    "Crossed",
    "DisjunctionToken",
    "Elastic",
    "FischerBurmeister",
    "Fixed",
    "FollowBarrier",
    "Geometric",
    "Grouping",
    "Kadrani",
    "KanzowSchwartz",
    "KeepsBounds",
    "KeepsMultipliers",
    "LiftedPair",
    "LinFukushima",
    "ObjectiveTerm",
    "PairResidual",
    "Part",
    "Penalty",
    "PerElement",
    "PerPair",
    "PerPhase",
    "RelaxComplementarity",
    "Relaxation",
    "RelaxationToken",
    "Schedule",
    "Scholtes",
    "SideVariable",
    "SteffensenUlbrich",
    "Superlinear",
    "TwoSided",
    "active_pairs",
    "active_sources",
    "canonical_form",
    "canonical_pair",
    "complements",
    "component_residuals",
    "form_of",
    "pair_residuals",
    "side_values",
]
