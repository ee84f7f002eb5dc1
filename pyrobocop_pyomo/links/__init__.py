"""Phases joined end to start: states that continue, or jump."""

from .link_states import PhaseEnd
from .links import Link, LinkData

__all__ = ["Link", "LinkData", "PhaseEnd"]
