"""Names: a class name stands for one class in the whole package."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

from .sources import nodes, trees


def test_no_class_name_twice() -> None:
    """One word, one meaning: also where the two classes would never meet in one file."""
    found: defaultdict[str, list[Path]] = defaultdict(list)
    for path, tree in trees().items():
        for node in nodes(tree, ast.ClassDef):
            found[node.name].append(path)
    twice = {name: [str(path) for path in paths] for name, paths in found.items() if len(paths) > 1}
    assert not twice, "\n".join(f"{name}: {', '.join(paths)}" for name, paths in twice.items())
