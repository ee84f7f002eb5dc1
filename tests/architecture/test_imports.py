"""Data flows right, imports point left: the order of the folders, held by a test. Each test lists all offenders."""

import ast
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import networkx as nx
import pytest

from .sources import folder_trees, imported_files, nodes, trees

ORDER = [
    "errors", "optional_imports", "native", "presentation", "modeling", "templates", "numerics", "linear_solver",
    "geometry", "plotting", "complementarity", "trajectories", "transcription", "continuous", "phases",
    "links", "motion", "obstacles", "mechanics", "discretisation",
    "diagnosis", "programs", "ipopt", "mpcc", "solving", "planning", "execution", "studies",
    "distributed", "contrib",
]  # fmt: skip
IMPORTS = (ast.Import, ast.ImportFrom)


def test_imports_only_point_left() -> None:
    """Siblings by one dot, other folders by full name, never the package root (whose version file is no folder)."""
    offenders = []
    for path, tree in folder_trees().items():
        here = ORDER.index(path.parts[0])
        for node in nodes(tree, *IMPORTS):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else [node.module or ""]
            where = f"{path}, line {node.lineno}"
            if isinstance(node, ast.ImportFrom) and node.level > 1:
                offenders.append(f"{where}: siblings by one dot, other folders by full name")
            for name in names:
                package, _, module = name.partition(".")
                if package == "pyrobocop_pyomo" and not module:
                    offenders.append(f"{where}: never import the package root")
                elif package == "pyrobocop_pyomo" and module != "_version":
                    folder = module.split(".")[0]
                    if ORDER.index(folder) > here:
                        offenders.append(f"{where}: must not import '{folder}'")
    assert not offenders, "\n".join(offenders)


# Meshes of trimesh have vertices, too.
MESHES = {"contrib/robots/decomposition.py", "contrib/robots/urdf.py"}


def test_only_geometry_knows_the_vertices_of_a_shape() -> None:
    """Others ask how high a shape is, for points that cover it, or for the corners that a formulation needs."""
    offenders = [
        f"{path}, line {node.lineno}"
        for path, tree in folder_trees().items()
        if path.parts[0] != "geometry" and path.as_posix() not in MESHES
        for node in nodes(tree, ast.Attribute)
        if node.attr == "vertices"
    ]
    assert not offenders, "\n".join(offenders)


def test_no_import_hides_inside_a_function() -> None:
    """An import inside a function would dodge a cycle: a cycle means that a concept lives in the wrong folder."""
    offenders = [
        f"{path}, line {node.lineno}: import of this package inside {function.name}()"
        for path, tree in folder_trees().items()
        for function in nodes(tree, ast.FunctionDef, ast.AsyncFunctionDef)
        for node in nodes(function, *IMPORTS)
        if imported_files(path, node)
    ]
    assert not offenders, "\n".join(offenders)


def test_no_cycle_of_files() -> None:
    """What is imported for type checkers only counts as well: a file that needs another's types knows it."""
    graph = nx.DiGraph()
    for path, tree in trees().items():
        for node in nodes(tree, *IMPORTS):
            graph.add_edges_from((path, target) for target in imported_files(path, node))
    cycles = [" -> ".join(map(str, cycle)) for cycle in nx.simple_cycles(graph, length_bound=4)]
    tangles = [sorted(map(str, group)) for group in nx.strongly_connected_components(graph) if len(group) > 1]
    assert not tangles, "\n".join([*map(str, tangles), *sorted(cycles)])


# --------------------------------------------------------------------
# The core stands without the products in `contrib`: their folder may be deleted.


ROOT = Path(__file__).parents[2]
# Stating, transcription, solving, obstacles, proofs and teams, by a file or two of each.
OF_THE_CORE = (
    "tests/phases/test_writings.py", "tests/phases/test_structure.py", "tests/solving/test_starts_of_plans.py",
    "tests/solving/test_failures.py", "tests/obstacles/test_typical_slips.py", "tests/obstacles/test_rerouting.py",
    "tests/motion/test_refused_poses.py", "tests/distributed/test_central_model.py",
)  # fmt: skip


@pytest.fixture(scope="module")
def without_contrib(tmp_path_factory: pytest.TempPathFactory) -> Path:
    copy = tmp_path_factory.mktemp("core") / "copy"
    copy.mkdir()
    for name in ("pyrobocop_pyomo", "tests", "benchmarks", "examples", "docs"):
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("contrib", "__pycache__", "_build"))
    for path in filter(Path.is_file, ROOT.iterdir()):
        shutil.copy(path, copy)
    return copy


def run(folder: Path, *arguments: str) -> str:
    ended = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        timeout=1800,
    )
    assert ended.returncode == 0, ended.stdout[-4000:] + ended.stderr[-4000:]
    return ended.stdout


@pytest.mark.ipopt
@pytest.mark.slow
def test_the_first_example_of_the_readme_works_without_contrib(without_contrib: Path) -> None:
    (example,) = re.findall(r"## A first example.*?```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    said = run(without_contrib, "-c", f"import pyrobocop_pyomo\nprint(pyrobocop_pyomo.__file__)\n{example}")
    assert said.startswith(str(without_contrib))


@pytest.mark.slow
def test_the_quick_tests_of_the_core_pass_without_contrib(without_contrib: Path) -> None:
    said = run(without_contrib, "-m", "pytest", "-m", "quick", "-q", "-p", "no:cacheprovider", *OF_THE_CORE)
    assert " passed" in said
