"""Figures and pictures of the pages are made by commands, which the pages name, and which the tests run coarsely."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from .code_blocks import FENCE, ROOT, pages

BENCHMARKS = ROOT / "benchmarks"
IMAGES = ROOT / "docs" / "images"
TESTS_OF_BENCHMARKS = (ROOT / "tests" / "benchmarks" / "test_benchmarks.py").read_text(encoding="utf-8")
TEXTS = {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in pages() if path.is_file()}
TEXTS["CHANGELOG.md"] = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")

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
    assert name == "solve_files" or f'run_quick("{name}"' in TESTS_OF_BENCHMARKS


@pytest.mark.parametrize("page", TEXTS)
def test_named_commands_exist(page: str) -> None:
    for name in BENCHMARK.findall(TEXTS[page]):
        assert (BENCHMARKS / f"{name}.py").is_file(), name
    for name in re.findall(r"python benchmarks/(\w+)\.py", TEXTS[page]):
        assert name in scripts(), f"{name} is no command"
    for name in EXAMPLE.findall(TEXTS[page]):
        assert (ROOT / "examples" / f"{name}.py").is_file(), name


@pytest.mark.parametrize("page", TEXTS)
def test_times_stand_beside_the_command_that_measures_them(page: str) -> None:
    if page.startswith("docs/examples/"):
        return  # written by one command, which stands at the top: the test below
    for section in sections(TEXTS[page]):
        found = MEASURED_TIME.search(section)
        assert found is None or "benchmarks/" in section, section[max(found.start() - 200, 0) : found.end() + 50]


@pytest.mark.parametrize("page", sorted((ROOT / "docs" / "examples").glob("*.md")), ids=lambda page: page.stem)
def test_generated_pages_name_their_command(page: Path) -> None:
    written_by = re.search(r"`python benchmarks/(\w+)\.py (?:--\w+ )*--docs docs`", page.read_text(encoding="utf-8"))
    assert written_by is not None
    assert '"--docs"' in scripts()[written_by[1]].read_text(encoding="utf-8")


@pytest.mark.parametrize("image", sorted(path.relative_to(IMAGES) for path in IMAGES.rglob("*.*")), ids=str)
def test_every_picture_is_made_by_a_script_that_its_pages_name(image: Path) -> None:
    showing = [page for page, text in TEXTS.items() if image.as_posix() in IMAGE.findall(text)]
    assert showing, "no page shows it"
    if all(f'savefig("{image.name}")' in TEXTS[page] for page in showing):
        return  # its page's own code makes it, which test_code_blocks runs
    folder = "textbook/" if image.parts[0] == "textbook" else ""
    examples = [path.stem for path in (ROOT / "examples" / folder).glob("*.py") if image.stem.startswith(path.stem)]
    benchmarks = [
        path.name for path in BENCHMARKS.glob("*.py") if f'"{image.name}"' in path.read_text(encoding="utf-8")
    ]
    assert examples or benchmarks, "no example has its name, and no benchmark writes it"
    maker = f"examples/{folder}{max(examples, key=len)}.py" if examples else f"benchmarks/{benchmarks[0]}"
    for page in showing:
        assert maker in TEXTS[page], page
