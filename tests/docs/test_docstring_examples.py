"""Examples in docstrings run, and print what they show."""

from __future__ import annotations

import doctest
import importlib
import re
from pathlib import Path
from typing import Any

import pytest

import pyrobocop_pyomo

from .code_blocks import ROOT

PACKAGE = ROOT / "pyrobocop_pyomo"


def modules_with_examples() -> list[Any]:
    files = [path for path in sorted(PACKAGE.rglob("*.py")) if "    >>> " in path.read_text(encoding="utf-8")]
    return [module_parameter(path) for path in files]


def module_parameter(path: Path) -> Any:
    name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
    solves = re.search(r"^ +(>>>|\.\.\.) .*solve\w*\(", path.read_text(encoding="utf-8"), re.MULTILINE)
    return pytest.param(name, marks=[pytest.mark.casadi] if solves else [])


@pytest.mark.parametrize("name", modules_with_examples())
def test_examples_in_docstrings_run(name: str) -> None:
    module = importlib.import_module(name)
    found = doctest.testmod(module)
    assert found.attempted > 0
    assert found.failed == 0


def test_the_main_components_have_an_example() -> None:
    main = ["PhaseBlock", "Link", "Complementarity", "ObstacleAvoidanceBlock", "Containment"]
    assert [name for name in main if ">>> " not in getattr(pyrobocop_pyomo, name).__doc__] == []
