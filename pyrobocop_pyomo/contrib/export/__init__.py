"""Controllers as C source, for robots that have Ipopt but no Python."""

from .exported_controller import export_controller

__all__ = ["export_controller"]
