"""Complementarity in any Pyomo model: the component, its canonical form and its relaxations."""

from .absolute_values import AbsoluteValuesToComplementarity
from .canonical import CanonicalForm, CanonicalPair, SidePart
from .component import Complementarity, ComplementarityData
from .disjunctions import ComplementarityToDisjunctions
from .forms import form_of
from .grouping import AllPairs, Crossed, Grouping, PerElement, PerPair, PerPhase
from .lifting import LiftedPair, SideVariable
from .pairs import active_pairs, active_sources, canonical_form, canonical_pair
from .relaxations import (
    ChenHarkerKanzowSmale,
    Elastic,
    FischerBurmeister,
    KanzowSchwartz,
    ObjectiveTerm,
    Penalty,
    Relaxation,
    Scholtes,
    SteffensenUlbrich,
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
from .residuals import (
    ComponentResidual,
    PairResidual,
    component_residuals,
    pair_residuals,
    side_values,
    sides_at_zero,
)
from .schedules import BarrierSchedule, Fixed, FollowBarrier, Geometric, Schedule, Superlinear
from .statement import Complements, complements, either_zero
from .transformation import RelaxComplementarity
from .units import register_with_pyomo

register_with_pyomo()

__all__ = [
    "AbsoluteValuesToComplementarity",
    "AllPairs",
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
    "KanzowSchwartz",
    "LiftedPair",
    "ObjectiveTerm",
    "PairResidual",
    "Penalty",
    "PerElement",
    "PerPair",
    "PerPhase",
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
    "revert",
    "rows_of",
    "shifted_rows_of",
    "side_values",
    "sides_at_zero",
    "sources_of",
    "without_penalty",
]
