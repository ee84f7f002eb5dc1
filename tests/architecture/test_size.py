"""A budget of code lines that only falls: a change that raises a number says why in its message."""

from __future__ import annotations

from collections import Counter
from functools import cache
from pathlib import Path

import pytest
from code_lines import c_code_lines, code_lines, python_code_lines

from .sources import ROOT as PACKAGE_ROOT
from .sources import trees

ROOT = Path(__file__).parents[2]
LARGEST_SHARE = 0.12

PACKAGE = {
    ".": 600, "car_paths": 1807, "complementarity": 3005, "continuous": 2397, "diagnosis": 1432, "discretisation":
    1167, "distributed": 2263, "estimation": 2005, "execution": 1161, "files": 830, "geometry": 1667, "ipopt": 1797,
    "linear_solver": 2026, "links": 456, "mechanics": 2260, "modeling": 2887, "motion": 2756, "mpcc": 1328,
    "native": 157, "numerics": 1985, "obstacles": 4183, "phases": 6951, "planning": 2584, "plotting": 1059,
    "presentation": 147, "problem_classes": 1331, "programs": 4136, "robots": 391, "rules": 274, "solving": 5208,
    "studies": 2718, "trajectories": 572, "transcription": 105,
}  # fmt: skip
TESTS = {
    ".": 108, "adversary": 1073, "architecture": 565, "benchmarks": 301, "car_paths": 957, "catalogue": 1067,
    "complementarity": 3333, "continuous": 1643, "diagnosis": 440, "discretisation": 638, "distributed": 1552,
    "docs": 1743, "estimation": 540, "examples": 818, "extension_templates": 181, "files": 632, "geometry": 996,
    "harness": 843, "ipopt": 1152, "linear_solver": 527, "mechanics": 1646, "mistakes": 563, "modeling": 975,
    "motion": 1652, "mpcc": 425, "mpcc_catalogue": 521, "native": 169, "nonsmooth": 186, "notebooks": 46,
    "numerics": 1106, "obstacles": 3152, "phases": 5739, "plotting": 628, "presentation": 221, "problem_classes":
    1172, "programs": 1644, "robots": 175, "rules": 167, "solving": 5918, "studies": 2006, "trajectories": 464,
    "transcription": 127,
}  # fmt: skip
BUDGETS = {"pyrobocop_pyomo": PACKAGE, "tests": TESTS}


@cache
def lines_of(part: str) -> dict[str, int]:
    return code_lines(ROOT / part)


@pytest.mark.parametrize("part", BUDGETS)
def test_no_folder_exceeds_its_budget(part: str) -> None:
    lines, budget = lines_of(part), BUDGETS[part]
    grown = {folder: (budget.get(folder, 0), count) for folder, count in lines.items() if count > budget.get(folder, 0)}
    assert not grown, f"folder: (budget, lines) {grown}"


@pytest.mark.parametrize("part", BUDGETS)
def test_a_budget_that_is_no_longer_needed_is_lowered(part: str) -> None:
    lines = lines_of(part)
    loose = {
        folder: (budget, lines.get(folder, 0))
        for folder, budget in BUDGETS[part].items()
        if lines.get(folder, 0) < 0.97 * budget - 10
    }
    assert not loose, f"folder: (budget, lines) {loose}"


def test_no_folder_holds_more_than_its_share_of_the_lines() -> None:
    """Then it holds more than one subject: divide it."""
    lines: Counter[str] = Counter()
    for path in trees():
        lines[path.parts[0]] += len((PACKAGE_ROOT / path).read_text(encoding="utf-8").splitlines())
    shares = {folder: count / lines.total() for folder, count in lines.most_common()}
    too_large = {folder: f"{share:.1%}" for folder, share in shares.items() if share > LARGEST_SHARE}
    assert not too_large, f"more than {LARGEST_SHARE:.0%} of {lines.total()} lines: {too_large}"


def test_docstrings_comments_and_blank_lines_do_not_count() -> None:
    text = '"""Module."""\n\nimport os  # why\n\ndef one():\n    """More.\n\n    Even more.\n    """\n'
    text += "    # no\n    return (\n        1\n    )\n"
    assert python_code_lines(text) == 5
    assert c_code_lines("/* a\n b */\nint x; // y\n\n// z\n}\n") == 2
