"""The only place that tries packages which are not required, or too slow to import before they are used.

Each name is a deferred module: nothing is imported before its first attribute is used, so
``import pyrobocop_pyomo`` stays quick and works without any extra. Where the package is missing, that first
use raises a `ModuleNotFoundError` that names the extra to install.
"""

from __future__ import annotations

from pyomo.common.dependencies import attempt_import


def _remedy(package: str, extra: str) -> str:
    return f"{package} is needed here and is not installed. Run: pip install 'pyrobocop_pyomo[{extra}]'"


casadi, casadi_available = attempt_import("casadi", error_message=_remedy("CasADi", "ipopt"))
highspy, highspy_available = attempt_import("highspy", error_message=_remedy("HiGHS", "certify"))
matplotlib, matplotlib_available = attempt_import(
    "matplotlib",
    error_message=_remedy("Matplotlib", "plot"),
    deferred_submodules=["cm", "colors", "figure", "lines", "patches"],
)
# Not loaded with Matplotlib, so that each is deferred on its own.
art3d, _ = attempt_import("mpl_toolkits.mplot3d.art3d", error_message=_remedy("Matplotlib", "plot"))
animation, _ = attempt_import("matplotlib.animation", error_message=_remedy("Matplotlib", "plot"))
shapely, shapely_available = attempt_import("shapely", error_message=_remedy("Shapely", "shapes"))
trimesh, trimesh_available = attempt_import("trimesh", error_message=_remedy("trimesh", "shapes"))
pandas, pandas_available = attempt_import("pandas", error_message=_remedy("pandas", "tables"))
xarray, xarray_available = attempt_import("xarray", error_message=_remedy("xarray", "tables"))

# Required, but deferred all the same: with Pyomo loaded, the first import of SciPy takes half a second.
networkx, _ = attempt_import("networkx")
scipy, _ = attempt_import(
    "scipy",
    deferred_submodules=["integrate", "optimize", "sparse", "sparse.csgraph", "sparse.linalg", "spatial", "special"],
)
