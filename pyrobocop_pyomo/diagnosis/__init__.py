"""What can be said about a model before it is solved."""

from .diagnose import diagnose
from .findings import Diagnosis, Finding, Severity

__all__ = ["Diagnosis", "Finding", "Severity", "diagnose"]
