"""What can be said about a model before it is solved."""

from .diagnose import diagnose
from .findings import DegreesOfFreedom, Diagnosis, Finding, Severity, Subject

__all__ = ["DegreesOfFreedom", "Diagnosis", "Finding", "Severity", "Subject", "diagnose"]
