"""What the README promises to somebody in a hurry: two commands, each a single line under its heading."""

import doctest
import importlib
import inspect
import io
import pydoc
import re
from contextlib import redirect_stdout, suppress
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import pyrobocop_pyomo

from .code_blocks import FENCE, ROOT, code_blocks, pages
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


# --------------------------------------------------------------------
# The reference shows every public name, and pages reach each other.


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


def is_there(path: str) -> bool:
    module, _, name = path.rpartition(".")
    with suppress(ImportError):
        return hasattr(importlib.import_module(module), name)
    return pydoc.locate(path) is not None  # below a namespace that is no module


def test_every_public_name_is_in_the_reference() -> None:
    """A name once shown is a promise: changing the reference is a decision, and CHANGELOG.md says so."""
    assert public_paths(pyrobocop_pyomo) - shown_paths() == set()
    assert [path for path in shown_paths() if not is_there(path)] == []
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


def test_files_to_open_for_a_change_exist() -> None:
    text = (ROOT / "docs" / "developer" / "changes.md").read_text(encoding="utf-8")
    rows = [row for row in text.splitlines() if row.startswith("| ") and not row.startswith("| to change")]
    assert len(rows) >= 10
    named = re.findall(r"`((?:pyrobocop_pyomo|tests|docs)/[\w/.]+)`", text)
    assert [name for name in named if not (ROOT / name).is_file()] == []
    for name, words in re.findall(r"`(pyrobocop_pyomo/[\w/]+\.py)`[^|`]*`([\w.]+)`", text):
        assert words.rpartition(".")[2] in (ROOT / name).read_text(encoding="utf-8")


# --------------------------------------------------------------------
# Figures and pictures of the pages are made by commands, which the pages name, and which the tests run coarsely.


BENCHMARKS = ROOT / "benchmarks"
IMAGES = ROOT / "docs" / "images"
TESTS_OF_BENCHMARKS = (ROOT / "tests" / "benchmarks" / "test_benchmarks.py").read_text(encoding="utf-8")
PICTURES = {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in pages() if path.is_file()}
PICTURES["CHANGELOG.md"] = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")

IMAGE = re.compile(r"images/([\w/]+\.(?:png|gif|svg))")
BENCHMARK = re.compile(r"\bbenchmarks/(\w+)\.py")
EXAMPLE = re.compile(r"\bexamples/((?:textbook/)?\w+)\.py")
# Times of this package's own work; "within 10 seconds" of a motion or a limit is none.
MEASURED_TIME = re.compile(
    r"\bCPU (?:s|seconds|milliseconds)\b|\bprocessor (?:time|seconds)\b|\d (?:ms|milliseconds)\b"
)


def scripts() -> dict[str, Path]:
    """Benchmarks that are commands; the other files are parts of them."""
    found = {path.stem: path for path in sorted(BENCHMARKS.glob("*.py"))}
    return {name: path for name, path in found.items() if '__name__ == "__main__"' in path.read_text(encoding="utf-8")}


def sections(text: str) -> list[str]:
    """What stands between headings; comments in code are no headings."""
    without_code = FENCE.sub("", text)
    return re.split(r"^#+ .*$", without_code, flags=re.MULTILINE)


@pytest.mark.parametrize("name", scripts())
def test_every_benchmark_is_run_by_a_test(name: str) -> None:
    """What solves files that are given has tests of its own beside the others."""
    assert name == "solve_files" or re.search(rf'(run_quick\(|^    )"{name}[" ]', TESTS_OF_BENCHMARKS, re.MULTILINE)


@pytest.mark.parametrize("page", PICTURES)
def test_named_commands_exist(page: str) -> None:
    for name in BENCHMARK.findall(PICTURES[page]):
        assert (BENCHMARKS / f"{name}.py").is_file(), name
    for name in re.findall(r"python benchmarks/(\w+)\.py", PICTURES[page]):
        assert name in scripts(), f"{name} is no command"
    for name in EXAMPLE.findall(PICTURES[page]):
        assert (ROOT / "examples" / f"{name}.py").is_file(), name


@pytest.mark.parametrize("page", PICTURES)
def test_times_stand_beside_the_command_that_measures_them(page: str) -> None:
    if page.startswith("docs/examples/"):
        return  # written by one command, which stands at the top: the test below
    for section in sections(PICTURES[page]):
        found = MEASURED_TIME.search(section)
        assert found is None or "benchmarks/" in section, section[max(found.start() - 200, 0) : found.end() + 50]


@pytest.mark.parametrize("page", sorted((ROOT / "docs" / "examples").glob("*.md")), ids=lambda page: page.stem)
def test_generated_pages_name_their_command(page: Path) -> None:
    written_by = re.search(r"`python benchmarks/(\w+)\.py (?:--\w+ )*--docs docs`", page.read_text(encoding="utf-8"))
    assert written_by is not None
    assert '"--docs"' in scripts()[written_by[1]].read_text(encoding="utf-8")


@pytest.mark.parametrize("image", sorted(path.relative_to(IMAGES) for path in IMAGES.rglob("*.*")), ids=str)
def test_every_picture_is_made_by_a_script_that_its_pages_name(image: Path) -> None:
    showing = [page for page, text in PICTURES.items() if image.as_posix() in IMAGE.findall(text)]
    assert showing, "no page shows it"
    if all(f'savefig("{image.name}")' in PICTURES[page] for page in showing):
        return  # its page's own code makes it, which test_code_blocks runs
    folder = "textbook/" if image.parts[0] == "textbook" else ""
    examples = [path.stem for path in (ROOT / "examples" / folder).glob("*.py") if image.stem.startswith(path.stem)]
    benchmarks = [
        path.name for path in BENCHMARKS.glob("*.py") if f'"{image.name}"' in path.read_text(encoding="utf-8")
    ]
    assert examples or benchmarks, "no example has its name, and no benchmark writes it"
    maker = f"examples/{folder}{max(examples, key=len)}.py" if examples else f"benchmarks/{benchmarks[0]}"
    for page in showing:
        assert maker in PICTURES[page], page
