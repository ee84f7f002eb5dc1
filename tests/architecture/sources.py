"""The package's files as syntax trees, read once, and what can be asked of them."""

import ast
import functools
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2] / "pyrobocop_pyomo"


@functools.cache
def trees() -> dict[Path, ast.Module]:
    """Path relative to the package -> syntax tree, for every file of it."""
    return {path.relative_to(ROOT): ast.parse(path.read_text(encoding="utf-8")) for path in sorted(ROOT.rglob("*.py"))}


def folder_trees() -> dict[Path, ast.Module]:
    """The files in folders: neither the shop window nor the version."""
    return {path: tree for path, tree in trees().items() if len(path.parts) > 1}


def nodes(tree: ast.AST, *kinds: type[ast.AST]) -> Iterator[ast.AST]:
    """All nodes of these kinds."""
    return (node for node in ast.walk(tree) if isinstance(node, kinds))


def imported_files(path: Path, node: ast.Import | ast.ImportFrom) -> set[Path]:
    """The files of the package that an import statement in a file asks for names."""
    if isinstance(node, ast.Import):
        choices = [[alias.name] for alias in node.names]
    else:
        here = ["pyrobocop_pyomo", *path.parts[:-1]]
        base = here[: len(here) + 1 - node.level] if node.level else []
        module = ".".join([*base, *([node.module] if node.module else [])])
        # `from .folder import name`: the name is a file of the folder, or something that the folder's face knows.
        choices = [[f"{module}.{alias.name}", module] for alias in node.names]
    found = (next(filter(None, map(_file_of, names)), None) for names in choices)
    return {file for file in found if file is not None}


def _file_of(module: str) -> Path | None:
    package, *parts = module.split(".")
    path = Path(*parts)
    files = (path.with_suffix(".py") if parts else None, path / "__init__.py")
    return next((file for file in files if package == "pyrobocop_pyomo" and file in trees()), None)
