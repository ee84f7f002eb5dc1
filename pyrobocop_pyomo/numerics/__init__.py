"""Collocation schemes, Lagrange bases, meshes and matchings: NumPy and SciPy only, no model."""

from .arrays import Array as Array
from .arrays import BoolArray as BoolArray
from .arrays import Indices as Indices
from .matching import Matching as Matching
from .mesh import Grid as Grid
from .mesh import Mesh as Mesh
from .mesh import remesh as remesh
from .polynomials import barycentric_weights as barycentric_weights
from .polynomials import differentiation_matrix as differentiation_matrix
from .polynomials import evaluation_matrix as evaluation_matrix
from .polynomials import integration_matrix as integration_matrix
from .schemes import Scheme as Scheme
from .schemes import find_scheme as find_scheme
from .schemes import gauss_legendre as gauss_legendre
from .schemes import lobatto as lobatto
from .schemes import radau as radau
