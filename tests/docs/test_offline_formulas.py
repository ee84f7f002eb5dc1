"""Formulas of the documentation render without a network, and by commands that MathJax takes where they stand."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"


def test_no_page_numbers_a_formula_by_hand():
    # Sphinx puts a formula of several lines into an environment that takes no \tag: it would be shown as source.
    tagged = [page for page in DOCS.rglob("*.md") if r"\tag{" in page.read_text(encoding="utf-8")]
    assert not tagged


def test_mathjax_is_copied_from_a_package():
    pytest.importorskip("sphinx-mathjax-offline", reason="the extra docs is not installed")
    settings: dict[str, object] = {}
    exec((DOCS / "conf.py").read_text(encoding="utf-8"), settings)
    (script,) = (Path(path) for path in settings["html_static_path"] if Path(path).name == settings["mathjax_path"])
    assert re.search(rb"MathJax", script.read_bytes())
    assert "http" not in settings["mathjax_path"]
