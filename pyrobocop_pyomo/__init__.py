"""Plan motion through contact and around obstacles, as ordinary Pyomo models."""

from pyrobocop_pyomo._version import __version__
from pyrobocop_pyomo.errors import PyRobocopError, SolveFailed

__all__ = ["PyRobocopError", "SolveFailed", "__version__"]
