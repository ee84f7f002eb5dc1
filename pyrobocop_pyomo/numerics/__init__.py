"""Collocation schemes, Lagrange bases and meshes: NumPy and SciPy only, no model."""

from .lagrange import barycentric_weights, differentiation_matrix, evaluation_matrix, integration_matrix
from .mesh import Grid, Mesh
from .schemes import CollocationScheme, find_scheme, gauss_legendre, radau

__all__ = [
    "CollocationScheme",
    "Grid",
    "Mesh",
    "barycentric_weights",
    "differentiation_matrix",
    "evaluation_matrix",
    "find_scheme",
    "gauss_legendre",
    "integration_matrix",
    "radau",
]
