"""Complementarity in any Pyomo model: the component, its canonical form and its relaxations."""

from .absolute_values import AbsoluteValuesToComplementarity
from .canonical import CanonicalForm, CanonicalPair, SidePart
from .component import Complementarity, ComplementarityData
from .disjunctions import ComplementarityToDisjunctions
from .forms import form_of
from .grouping import AllPairs, Crossed, Grouping, PerElement, PerPair, PerPhase
from .lifting import LiftedPair, SideVariable
from .pairs import active_pairs, active_sources, canonical_form, canonical_pair
from .parameters import reset_parameters, update_parameters
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
from .relaxing import (
    RelaxationToken,
    crossed_pairs_of,
    delta_of,
    generating_pairs,
    has_penalty,
    lifted_pairs_of,
    pairs_of,
    relax,
    relaxation_of,
    relaxation_rows_of,
    revert,
    rows_of,
    shifted_rows_of,
    sources_of,
    without_penalty,
)
from .replaced_rows import ReplacementToken
from .residuals import ComponentResidual, PairResidual, component_residuals, pair_residuals, side_values
from .schedules import BarrierSchedule, Fixed, FollowBarrier, Geometric, Schedule, Superlinear
from .statement import Complements, complements, either_zero
from .switched_products import ProductsToComplementarity
from .transformation import RelaxComplementarity
from .units import register_with_pyomo

register_with_pyomo()

__all__ = [
    "AbsoluteValuesToComplementarity",
    "AllPairs",
    "AugmentedLagrangian",
    "BarrierSchedule",
    "CanonicalForm",
    "CanonicalPair",
    "ChenHarkerKanzowSmale",
    "Complementarity",
    "ComplementarityData",
    "ComplementarityToDisjunctions",
    "Complements",
    "ComponentResidual",
    "Crossed",
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
    "Penalty",
    "PerElement",
    "PerPair",
    "PerPhase",
    "ProductsToComplementarity",
    "RelaxComplementarity",
    "Relaxation",
    "RelaxationToken",
    "ReplacementToken",
    "Schedule",
    "Scholtes",
    "SidePart",
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
    "crossed_pairs_of",
    "delta_of",
    "either_zero",
    "form_of",
    "generating_pairs",
    "has_penalty",
    "lifted_pairs_of",
    "pair_residuals",
    "pairs_of",
    "relax",
    "relaxation_of",
    "relaxation_rows_of",
    "reset_parameters",
    "revert",
    "rows_of",
    "shifted_rows_of",
    "side_values",
    "sources_of",
    "update_parameters",
    "without_penalty",
]
