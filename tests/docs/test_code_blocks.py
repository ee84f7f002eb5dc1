"""Every Python block of README and documentation runs, page by page, top to bottom."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from .code_blocks import ROOT, code_blocks, pages

PAGES_WITH_CODE = [page for page in pages() if page.is_file() and code_blocks(page, "python")]


@pytest.mark.casadi
@pytest.mark.parametrize("page", PAGES_WITH_CODE, ids=lambda page: str(page.relative_to(ROOT)))
def test_python_blocks_run(page: Path, tmp_path: Path, monkeypatch: Any) -> None:
    # The blocks of a page share one module, like the cells of a notebook; what they write goes to a folder of ours.
    monkeypatch.chdir(tmp_path)
    namespace = ModuleType("page").__dict__
    for block in code_blocks(page, "python"):
        # Blank lines in front make a traceback point at the line of the page.
        source = "\n" * (block.line - 1) + block.text
        exec(compile(source, str(page), "exec", dont_inherit=True), namespace)


def test_pages_with_code_were_found() -> None:
    names = {page.name for page in PAGES_WITH_CODE}
    assert {"README.md", "tutorial.md"} <= names
