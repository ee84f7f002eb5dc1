"""One name, one thing."""

from __future__ import annotations

import ast
from collections import defaultdict

from .sources import folder_trees, nodes


def test_no_class_name_twice() -> None:
    """Private ones too: who reads a message, a log line or a traceback sees the name only."""
    homes = defaultdict(list)
    for path, tree in folder_trees().items():
        for node in nodes(tree, ast.ClassDef):
            homes[node.name].append(f"{path}, line {node.lineno}")
    twice = {name: places for name, places in homes.items() if len(places) > 1}
    assert not twice, "\n".join(f"{name}: {'; '.join(places)}" for name, places in twice.items())
