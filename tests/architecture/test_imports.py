"""Data flows right, imports point left: the order of the folders, held by a test."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2] / "pyrobocop_pyomo"

ORDER = [
    "_version", "errors", "optional_imports", "modeling", "numerics", "geometry", "plotting", "complementarity",
    "catalogue", "trajectories", "transcription", "continuous", "phases", "motion", "car_paths", "obstacles",
    "mechanics", "diagnosis", "programs", "ipopt", "mpcc", "solving", "planning", "studies", "distributed",
]  # fmt: skip

PACKAGE_FILES = list(ROOT.glob("*/**/*.py"))


def imported_folders(path: Path) -> list[tuple[int, str]]:
    """(line, folder) for each import of this package; a relative import across folders is an error."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            assert node.level <= 1, f"{path}, line {node.lineno}: siblings by one dot, other folders by full name"
            names = [node.module] if node.level == 0 and node.module else []
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            continue
        for name in names:
            parts = name.split(".")
            if parts[0] == "pyrobocop_pyomo":
                assert len(parts) > 1, f"{path}, line {node.lineno}: never import the package root"
                found.append((node.lineno, parts[1]))
    return found


@pytest.mark.parametrize("path", PACKAGE_FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_only_point_left(path: Path) -> None:
    here = ORDER.index(path.relative_to(ROOT).parts[0])
    for line, folder in imported_folders(path):
        assert ORDER.index(folder) <= here, f"{path}, line {line}: must not import '{folder}'"


@pytest.mark.parametrize("path", PACKAGE_FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_import_hides_inside_a_function(path: Path) -> None:
    """An import inside a function would dodge a cycle: a cycle means that a concept lives in the wrong folder."""
    for function in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(function, (ast.FunctionDef, ast.AsyncFunctionDef)):
            for node in ast.walk(function):
                ours = isinstance(node, ast.ImportFrom) and (
                    node.level > 0 or (node.module or "").startswith("pyrobocop_pyomo")
                )
                assert not ours, f"{path}, line {node.lineno}: import of this package inside {function.name}()"
