"""The sums of the code only fall: each is at most one per cent above the lowest that was recorded."""

import json
from pathlib import Path

import pytest
from code_lines import RECORD, c_code_lines, code_lines, module_numbers, python_code_lines, sums

ROOT = Path(__file__).parents[2]
NOW = {"sums": sums(ROOT), "folders": {part: code_lines(ROOT / part) for part in ("pyrobocop_pyomo", "tests")}}
RECORDED = json.loads(RECORD.read_text(encoding="utf-8"))
HOW = "after a removal, python benchmarks/code_lines.py --record writes down the lower sums"


@pytest.mark.parametrize("name", RECORDED["sums"])
def test_no_sum_grows(name: str) -> None:
    lowest, now = RECORDED["sums"][name], NOW["sums"][name]
    grown = {
        f"{part}/{folder}": count - before.get(folder, 0)
        for part, before in RECORDED["folders"].items()
        for folder, count in NOW["folders"][part].items()
        if count > before.get(folder, 0)
    }
    assert now <= 1.01 * lowest, f"{name}: {lowest} at their lowest, now {now}; lines grew in {grown}"
    assert now >= 0.99 * lowest, f"{name}: {lowest} recorded, now {now}; {HOW}"


def test_docstrings_comments_and_blank_lines_do_not_count() -> None:
    text = '"""Module."""\n\nimport os  # why\n\ndef one():\n    """More.\n\n    Even more.\n    """\n'
    text += "    # no\n    return (\n        1\n    )\n"
    assert python_code_lines(text) == 5
    assert c_code_lines("/* a\n b */\nint x; // y\n\n// z\n}\n") == 2


def test_numbers_of_a_module_are_those_that_names_get() -> None:
    assert module_numbers("A, B = 1, -2.0\nC: int = 3 * 4\nD = [5, 6]\nE = f(7)\ndef g():\n    h = 8\n") == 5
