"""The reference shows every public name, and pages reach each other."""

from __future__ import annotations

import importlib
import inspect
import re
from pathlib import Path
from types import ModuleType

import pytest

import pyrobocop_pyomo

from .code_blocks import ROOT, code_blocks


def shown_paths() -> set[str]:
    """Full names of all classes and functions that the reference describes."""
    paths = set()
    for page in (ROOT / "docs" / "reference").glob("*.md"):
        for path in re.findall(r"auto(?:class|function):: (\S+)", page.read_text(encoding="utf-8")):
            paths.add(path if "." in path else f"pyrobocop_pyomo.{path}")
    return paths


def public_paths(shown: ModuleType) -> set[str]:
    """Full names of what a namespace offers, and the namespaces in it."""
    public = set()
    for name in set(shown.__all__) - {"__version__", "errors"}:
        value = getattr(shown, name)
        public |= public_paths(value) if inspect.ismodule(value) else {f"{shown.__name__}.{name}"}
    return public


def test_every_public_name_is_in_the_reference() -> None:
    assert public_paths(pyrobocop_pyomo) - shown_paths() == set()
    assert "automodule:: pyrobocop_pyomo.errors" in (ROOT / "docs/reference/errors.md").read_text(encoding="utf-8")


def test_every_namespace_is_in_the_table() -> None:
    table = (ROOT / "docs" / "reference" / "namespaces.md").read_text(encoding="utf-8")
    namespaces = [name for name in pyrobocop_pyomo.__all__ if inspect.ismodule(getattr(pyrobocop_pyomo, name))]
    assert [name for name in namespaces if f"`rcp.{name}`" not in table] == []


@pytest.mark.parametrize("folder", ["complementarity", "mpcc", "solving"])
def test_every_name_that_a_folder_offers_is_in_the_reference(folder: str) -> None:
    shown = {path.rpartition(".")[2] for path in shown_paths()}
    names = vars(importlib.import_module(f"pyrobocop_pyomo.{folder}")).items()
    assert {name for name, value in names if not (name.startswith("_") or inspect.ismodule(value))} <= shown


def test_every_error_is_drawn_in_the_tree() -> None:
    errors = pyrobocop_pyomo.errors
    defined = [name for name, value in vars(errors).items() if isinstance(value, type)]
    assert [name for name in defined if name not in errors.__doc__] == []


def pages_below(page: Path) -> set[Path]:
    """Pages that the tables of contents of a page lead to, and the page."""
    found = {page}
    for block in code_blocks(page, "{toctree}"):
        entries = (page.parent / f"{entry}.md" for entry in block.text.split())
        found = found.union(*(pages_below(entry) for entry in entries if entry.is_file()))
    return found


def test_every_page_is_in_the_table_of_contents() -> None:
    pages = {page for page in (ROOT / "docs").rglob("*.md") if "_build" not in page.parts}
    assert pages - pages_below(ROOT / "docs" / "index.md") == set()


def test_templates_named_for_extension_points_exist() -> None:
    text = (ROOT / "docs" / "developer" / "index.md").read_text(encoding="utf-8")
    named = re.findall(r"`(\w+\.py)` \|$", text, re.MULTILINE)
    assert len(named) >= 4
    missing = [name for name in named if not (ROOT / "tests" / "extension_templates" / name).is_file()]
    assert not missing
