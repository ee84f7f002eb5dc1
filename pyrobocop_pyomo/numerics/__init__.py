"""Collocation schemes, Lagrange bases and meshes: NumPy and SciPy only, no model."""

from .lagrange import barycentric_weights, differentiation_matrix, evaluation_matrix, integration_matrix
from .mesh import Grid, Mesh
from .families import explicit, find_scheme, gauss_legendre, lobatto, radau
from .schemes import Scheme

__all__ = [
    "Scheme",
    "Grid",
    "Mesh",
    "barycentric_weights",
    "differentiation_matrix",
    "evaluation_matrix",
    "explicit",
    "find_scheme",
    "gauss_legendre",
    "integration_matrix",
    "lobatto",
    "radau",
]
