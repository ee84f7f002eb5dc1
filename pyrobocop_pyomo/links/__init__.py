"""Phases joined end to start: states that continue, or jump."""

from .links import Link, LinkData, PhaseEnd

__all__ = ["Link", "LinkData", "PhaseEnd"]
