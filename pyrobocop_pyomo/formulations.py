"""How the rows say that two bodies are apart: values of `formulation=` of an `ObstacleAvoidanceBlock`."""

from pyrobocop_pyomo.obstacles import Dual, Formulation, Mixed, Offset, Optimality, Plane, TurningPlane

__all__ = ["Dual", "Formulation", "Mixed", "Offset", "Optimality", "Plane", "TurningPlane"]
