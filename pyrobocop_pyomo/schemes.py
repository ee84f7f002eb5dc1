"""Collocation schemes and meshes: values of `scheme=` and `mesh=`."""

from pyrobocop_pyomo.numerics import Grid, Mesh, Scheme, find_scheme, gauss_legendre, lobatto, radau

__all__ = ["Grid", "Mesh", "Scheme", "find_scheme", "gauss_legendre", "lobatto", "radau"]
