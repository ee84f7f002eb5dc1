"""The reference shows every public name, and pages reach each other."""

import importlib
import inspect
import re
from pathlib import Path
from types import ModuleType

import pytest

import pyrobocop_pyomo

from .code_blocks import FENCE, ROOT, code_blocks, pages


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
