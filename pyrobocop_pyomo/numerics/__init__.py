"""Collocation schemes, Lagrange bases and meshes: NumPy and SciPy only, no model."""

from .families import explicit, find_scheme, gauss_legendre, lobatto, radau
from .lagrange import barycentric_weights, differentiation_matrix, evaluation_matrix, integration_matrix
from .mesh import Grid, Mesh
from .remeshing import remesh
from .schemes import Scheme

__all__ = [
    "Grid",
    "Mesh",
    "Scheme",
    "barycentric_weights",
    "differentiation_matrix",
    "evaluation_matrix",
    "explicit",
    "find_scheme",
    "gauss_legendre",
    "integration_matrix",
    "lobatto",
    "radau",
    "remesh",
]
