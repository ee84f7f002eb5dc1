"""The only place that tries packages which are not required, or too slow to import before they are used.

Each name is a deferred module: nothing is imported before its first attribute is used, so
``import pyrobocop_pyomo`` stays quick and works without any extra. Where the package is missing, that first
use raises a `ModuleNotFoundError` that names the extra to install.
"""

from __future__ import annotations

import importlib
import sys
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType
from typing import Any

from pyomo.common.dependencies import attempt_import


def _remedy(package: str, extra: str) -> str:
    return f"{package} is needed here and is not installed. Run: pip install 'pyrobocop_pyomo[{extra}]'"


casadi, casadi_available = attempt_import("casadi", error_message=_remedy("CasADi", "ipopt"))
matplotlib, matplotlib_available = attempt_import(
    "matplotlib",
    error_message=_remedy("Matplotlib", "plot"),
    deferred_submodules=["cm", "colors", "figure", "lines", "patches"],
)
# Not loaded with Matplotlib, so that each is deferred on its own.
art3d, _ = attempt_import("mpl_toolkits.mplot3d.art3d", error_message=_remedy("Matplotlib", "plot"))
animation, _ = attempt_import("matplotlib.animation", error_message=_remedy("Matplotlib", "plot"))
# With it functions travel to other processes as they are, without a module that these could import.
cloudpickle, cloudpickle_available = attempt_import(
    "cloudpickle", error_message=_remedy("cloudpickle", "dask"), catch_exceptions=(ImportError,)
)
distributed, _ = attempt_import("distributed", error_message=_remedy("Dask distributed", "dask"))
# Without an MPI library, mpi4py raises a RuntimeError. Its import initialises MPI.
mpi, _ = attempt_import(
    "mpi4py.MPI", error_message=_remedy("mpi4py", "mpi"), catch_exceptions=(ImportError, RuntimeError)
)
mpi_futures, _ = attempt_import("mpi4py.futures", error_message=_remedy("mpi4py", "mpi"))
# Of Pyomo itself, but it takes its time.
parmest_models, _ = attempt_import("pyomo.contrib.parmest.utils.model_utils")
shapely, shapely_available = attempt_import("shapely", error_message=_remedy("Shapely", "shapes"))
trimesh, trimesh_available = attempt_import("trimesh", error_message=_remedy("trimesh", "shapes"))
yourdfpy, yourdfpy_available = attempt_import("yourdfpy", error_message=_remedy("yourdfpy", "robots"))
pandas, pandas_available = attempt_import("pandas", error_message=_remedy("pandas", "tables"))


class _OrdinaryFinder:
    """Finds SciPy as Python does."""

    @staticmethod
    def find_spec(name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        return PathFinder.find_spec(name, path, target) if name == "scipy" else None


def _import_scipy() -> ModuleType:
    """Import SciPy without its statistics.

    Pyomo's finder of modules imports ``scipy.stats`` (0.6 s) as soon as anybody imports SciPy. Found by the ordinary
    finder instead, SciPy comes alone; Pyomo still imports the statistics when it uses SciPy itself.
    """
    if "scipy" not in sys.modules:
        # Python's own import does the rest: its locks keep other threads from a module that is not complete yet.
        sys.meta_path.insert(0, _OrdinaryFinder)
        try:
            return importlib.import_module("scipy")
        finally:
            sys.meta_path.remove(_OrdinaryFinder)
    return importlib.import_module("scipy")


# Required, but deferred all the same: the parts of SciPy that are used take a tenth of a second and more to import.
networkx, _ = attempt_import("networkx")
scipy, _ = attempt_import(
    "scipy",
    importer=_import_scipy,
    deferred_submodules=[
        "integrate",
        "ndimage",
        "optimize",
        "sparse",
        "sparse.csgraph",
        "sparse.linalg",
        "spatial",
        "special",
    ],
)
