"""What the README promises to somebody in a hurry: two commands, each a single line under its heading."""

from __future__ import annotations

import re

import pytest

from .code_blocks import ROOT, code_blocks

README = ROOT / "README.md"


@pytest.mark.parametrize("heading", ["Run it", "Test it"])
def test_one_single_line_command_under_the_heading(heading: str) -> None:
    """Whether they work is shown by ``.ci/run``, which takes them from the page and runs them in a fresh copy."""
    found = [block for block in code_blocks(README, "bash") if block.heading == heading]
    assert len(found) == 1
    assert found[0].text.count("\n") == 1
    assert found[0].text.strip()


def test_links_to_files_of_the_repository_lead_somewhere() -> None:
    targets = re.findall(r"\]\((?!https?:|#)([^)#]+)", README.read_text(encoding="utf-8"))
    assert targets
    missing = [target for target in targets if not (ROOT / target).exists()]
    assert not missing
