"""Collocation schemes, Lagrange bases, meshes and matchings: NumPy and SciPy only, no model."""

from .arrays import Array, BoolArray, Indices
from .families import explicit, find_scheme, gauss_legendre, lobatto, radau
from .lagrange import barycentric_weights, differentiation_matrix, evaluation_matrix, integration_matrix
from .matching import Matching, maximum_matching
from .mesh import Grid, Mesh
from .remeshing import remesh
from .schemes import Scheme

__all__ = [
    "Array",
    "BoolArray",
    "Grid",
    "Indices",
    "Matching",
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
    "maximum_matching",
    "radau",
    "remesh",
]
