"""Data flows right, imports point left: the order of the folders, held by a test. Each test lists all offenders."""

from __future__ import annotations

import ast

import networkx as nx

from .sources import folder_trees, imported_files, nodes, trees

ORDER = [
    "errors", "optional_imports", "native", "presentation", "modeling", "rules", "numerics", "linear_solver",
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
