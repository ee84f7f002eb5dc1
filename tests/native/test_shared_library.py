"""A compiled library is loaded only if it is there, made of the sources as they are, and can be loaded."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pyrobocop_pyomo.native import shared_library as module
from pyrobocop_pyomo.native.shared_library import library_file, shared_library

ROOT = Path(__file__).parents[2]
NAME = "term_evaluation"


@pytest.fixture
def library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A library in a folder of its own, with a source."""
    compiled = library_file(NAME)
    if not compiled.is_file():
        pytest.skip("it is not compiled here")
    monkeypatch.delenv(module.SWITCH_VARIABLE, raising=False)
    for source in module.library_sources(NAME):
        shutil.copy(source, tmp_path)
    monkeypatch.setitem(module.LIBRARIES, NAME, tmp_path)
    return Path(shutil.copy(compiled, tmp_path))


def test_a_library_stands_for_the_sources_that_it_was_compiled_from(library: Path) -> None:
    assert shared_library(NAME) == library
    with (library.parent / "term_evaluation.c").open("a", encoding="utf-8") as source:
        source.write("\n")
    assert shared_library(NAME) is None


def test_switched_off_or_damaged_there_is_none(library: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(module.SWITCH_VARIABLE, "off")
    assert shared_library(NAME) is None
    monkeypatch.delenv(module.SWITCH_VARIABLE)
    library.write_text("junk")
    assert shared_library(NAME) is None


def test_the_installation_compiles_with_nothing_but_python() -> None:
    """Before the package's requirements are there."""
    script = "import runpy, sys; print(*runpy.run_path(sys.argv[1])['LIBRARIES'])"
    file = ROOT / "pyrobocop_pyomo" / "native" / "shared_library.py"
    ended = subprocess.run([sys.executable, "-S", "-c", script, str(file)], capture_output=True, text=True, check=False)
    assert ended.stdout.split() == list(module.LIBRARIES)
    assert all(folder.is_dir() for folder in module.LIBRARIES.values())
