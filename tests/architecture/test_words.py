"""One word, one meaning, and the field's: retired words do not come back in public names."""

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pyrobocop_pyomo

from .sources import ROOT, folder_trees, nodes, trees

PROJECT = ROOT.parent

# What an expert in nonlinear programming, trajectory optimisation or robotics would look for -> what it replaces.
RETIRED = {
    "strategy, fallback sequence, run": "rung ladder climb",
    "iterate, continuation run": "attempt",
    "persistent, compiled": "kept_model written",
    "backend, vectorised": "route mapped",
    "check": "judge",
    "chord_deviation, curvature_bound, mismatch, jump": "sag bend strays leaps",
    "interval, taylor_form": "jet enclosure",
    "zero_order_hold, piecewise_constant": "held",
    "segment, subinterval": "piece stretch stretches",
    "rule_proxies": "stand_in",
    "grid_path, best_first_search, car_kinematics, heuristic_weight": "ways_around outward_search rolling eagerness",
    "penalty_term": "charge charged uncharged",
    "deactivate": "asleep sleeping silence silenced put_to_sleep",
}
ADVICE = {word: better for better, words in RETIRED.items() for word in words.split()}
# A plural counts as its singular.
PATTERN = re.compile(rf"(?:^|_)({'|'.join(sorted(ADVICE, key=len, reverse=True))})(?:s|d)?(?=_|$)")


def words_of(name: str) -> str:
    """``ModeSequence`` and ``mode_sequence`` are the same words."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


def public_names() -> Iterator[tuple[str, str]]:
    """(where, name) of modules, classes, functions, methods, fields and parameters without a leading underscore."""
    yield from (("pyrobocop_pyomo.__all__", name) for name in pyrobocop_pyomo.__all__)
    for path, tree in folder_trees().items():
        if any(part.startswith("_") for part in path.parts if part != "__init__.py"):
            continue
        yield from ((str(path), part.removesuffix(".py")) for part in path.parts)
        yield from members(str(path), tree.body)


def members(where: str, body: list[ast.stmt]) -> Iterator[tuple[str, str]]:
    """The public names that a module or a class binds, and the parameters of its functions."""
    for node in body:
        if isinstance(node, (ast.Assign, ast.AnnAssign)):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names = [target.id for target in targets if isinstance(target, ast.Name)]
            yield from ((f"{where}, line {node.lineno}", name) for name in names if not name.startswith("_"))
        if isinstance(node, (ast.ClassDef, ast.FunctionDef)) and (
            not node.name.startswith("_") or node.name in ("__init__", "__call__")
        ):
            yield f"{where}, line {node.lineno}", node.name
            if isinstance(node, ast.ClassDef):
                yield from members(f"{where}, {node.name}", node.body)
            else:
                yield from (
                    (f"{where}, {node.name}(), line {parameter.lineno}", parameter.arg)
                    for parameter in nodes(node.args, ast.arg)
                )


def test_no_retired_word_in_a_public_name() -> None:
    offenders = [
        f"{where}: '{name}' has '{found.group(1)}'; the field says {ADVICE[found.group(1).lower()]}"
        for where, name in public_names()
        if (found := PATTERN.search(words_of(name)))
    ]
    assert not offenders, "\n".join(offenders)


# Turns of phrase that have to be read twice -> what is written instead.
RETIRED_PHRASES = {
    "is asked": "is evaluated, is required, is requested",
    "are asked": "are evaluated, are required, are requested",
    "are refused by name": "raise an error that names ...",
    "is refused by name": "raises an error that names ...",
    "have no say": "are ignored",
    "has no say": "is ignored",
    "without a word": "by default",
    "is told so": "raises ... naming it",
    "is told by name": "raises ... naming it",
    "shall": "must",
    "a certain point": "a certified point",
    "kept from everything": "keeps a clearance of ...",
    "typical slips": "typical mistakes",
    "written anew": "an independent implementation",
}
# Where people read: docstrings, comments and messages, and all pages, those that are generated included.
TEXTS = {"pyrobocop_pyomo": ("*.py",), "docs": ("*.md",), "examples": ("*.py", "*.md"), "benchmarks": ("*.py", "*.md")}


def texts() -> Iterator[Path]:
    """Sources and pages, and those at the root of the project."""
    for folder, endings in TEXTS.items():
        for ending in endings:
            yield from (path for path in (PROJECT / folder).rglob(ending) if "_build" not in path.parts)
    yield from PROJECT.glob("*.md")


def test_no_retired_phrase_where_people_read() -> None:
    # A phrase may be broken over two lines.
    phrases = "|".join(r"\s+".join(map(re.escape, phrase.split())) for phrase in RETIRED_PHRASES)
    pattern = re.compile(rf"(?i)\b({phrases})\b")
    offenders = []
    for path in texts():
        text = path.read_text(encoding="utf-8")
        for found in pattern.finditer(text):
            phrase = " ".join(found[1].lower().split())
            line = text.count("\n", 0, found.start()) + 1
            offenders.append(f"{path.relative_to(PROJECT)}, line {line}: '{phrase}'; write {RETIRED_PHRASES[phrase]}")
    assert not offenders, "\n".join(offenders)


# --------------------------------------------------------------------
# Names: a class or a public function has one name, and the name stands for nothing else in the whole package.


def listed_twice(found: dict[str, list[Path]]) -> str:
    """One line per name that several files define."""
    return "\n".join(f"{name}: {', '.join(map(str, paths))}" for name, paths in sorted(found.items()) if len(paths) > 1)


def test_no_name_of_a_class_or_of_a_public_function_twice() -> None:
    """Also where the two would never meet in one file."""
    classes: defaultdict[str, list[Path]] = defaultdict(list)
    functions: defaultdict[str, list[Path]] = defaultdict(list)
    for path, tree in trees().items():
        for node in nodes(tree, ast.ClassDef):
            classes[node.name].append(path)
        for node in tree.body:
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)) and not node.name.startswith("_"):
                functions[node.name].append(path)
    for found in (classes, functions):
        assert not listed_twice(found), listed_twice(found)
