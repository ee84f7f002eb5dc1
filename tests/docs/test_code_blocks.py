"""Every Python block of README and documentation runs, page by page, top to bottom, and prints what the page shows.

A block with the language ``output`` shows what the Python blocks above it print; ``shown_output`` compares them.
"""

from __future__ import annotations

import io
from contextlib import redirect_stdout
from pathlib import Path
from types import ModuleType

import pytest

from .code_blocks import ROOT, code_blocks, pages
from .shown_output import difference

PAGES_WITH_CODE = [page for page in pages() if page.is_file() and code_blocks(page, "python")]


@pytest.mark.casadi
@pytest.mark.parametrize("page", PAGES_WITH_CODE, ids=lambda page: str(page.relative_to(ROOT)))
def test_python_blocks_run(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    # The blocks of a page share one module, like the cells of a notebook; what they write goes to a folder of ours.
    monkeypatch.chdir(tmp_path)
    namespace = ModuleType("page").__dict__
    printed = io.StringIO()
    for block in code_blocks(page, "python", "output"):
        if block.language == "output":
            told = difference(block.text, printed.getvalue())
            assert told is None, f"{page.relative_to(ROOT)}, line {block.line}: {told}"
            printed = io.StringIO()
            continue
        # Blank lines in front make a traceback point at the line of the page.
        source = "\n" * (block.line - 1) + block.text
        with redirect_stdout(printed):
            exec(compile(source, str(page), "exec", dont_inherit=True), namespace)
    assert [record.getMessage() for record in caplog.records if record.levelname == "ERROR"] == []


def test_pages_with_code_were_found() -> None:
    names = {page.name for page in PAGES_WITH_CODE}
    assert {"README.md", "tutorial.md"} <= names
