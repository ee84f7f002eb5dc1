"""Names: a class or a public function has one name, and the name stands for nothing else in the whole package."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

from .sources import nodes, trees


def listed_twice(found: dict[str, list[Path]]) -> str:
    """One line per name that several files define."""
    return "\n".join(f"{name}: {', '.join(map(str, paths))}" for name, paths in sorted(found.items()) if len(paths) > 1)


def test_no_class_name_twice() -> None:
    """Also where the two would never meet in one file."""
    found: defaultdict[str, list[Path]] = defaultdict(list)
    for path, tree in trees().items():
        for node in nodes(tree, ast.ClassDef):
            found[node.name].append(path)
    assert not listed_twice(found), listed_twice(found)


def test_no_public_function_name_twice() -> None:
    found: defaultdict[str, list[Path]] = defaultdict(list)
    for path, tree in trees().items():
        for node in tree.body:
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)) and not node.name.startswith("_"):
                found[node.name].append(path)
    assert not listed_twice(found), listed_twice(found)
