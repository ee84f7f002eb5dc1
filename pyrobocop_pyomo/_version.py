"""The version, alone in a file so that the build can read it without importing Pyomo."""

__version__ = "1.0.0rc1"
