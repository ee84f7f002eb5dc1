"""What the README promises to somebody in a hurry: two commands, each a single line under its heading."""

import doctest
import importlib
import io
import re
from contextlib import redirect_stdout
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import pyrobocop_pyomo

from .code_blocks import ROOT, code_blocks, pages
from .shown_output import difference

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


# --------------------------------------------------------------------
# The comparison of shown and printed output sees what it should see, and nothing else.


PRINTED = "cart: 20 equations,\n  objective 13.42590 after 57 iterations in 0.20 s, violation 1.7e-09\n"


@pytest.mark.parametrize(
    "shown",
    [
        PRINTED,
        "cart: 20 equations, objective 13.4259",
        "cart: ... objective 13.4260 after 61 iterations in 3.5 s, violation 2.0e-11",
        "objective 13.42590 after\n57 iterations ...",
    ],
)
def test_what_changes_with_the_machine_may_differ(shown: str) -> None:
    assert difference(shown, PRINTED) is None


@pytest.mark.parametrize(
    ("shown", "said"),
    [
        ("cart: 21 equations", "shows 21 where its code prints 20"),
        ("objective 13.4659", "shows 13.4659 where its code prints 13.42590"),
        ("cart: 20 rows", "and its code prints"),
        ("objective unknown", "and its code prints"),
        ("violation 1.7e-09 of ...", "and its code prints"),
    ],
)
def test_other_words_and_other_numbers_are_told(shown: str, said: str) -> None:
    message = difference(shown, PRINTED)
    assert message is not None
    assert said in message


# --------------------------------------------------------------------
# Examples in docstrings run, and print what they show.


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


# --------------------------------------------------------------------
# Every Python block of README and documentation runs, page by page, top to bottom, and prints what the page shows.


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
