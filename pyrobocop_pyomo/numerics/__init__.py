"""Collocation schemes, Lagrange bases and meshes: NumPy only, no model."""
