"""A compiled library is loaded only if it is there, made of the sources as they are, and can be loaded."""

import ctypes
import subprocess
import sys
from pathlib import Path

import pytest

from pyrobocop_pyomo.native import shared_library as module
from pyrobocop_pyomo.native.shared_library import compile_library, library_file, shared_library

ROOT = Path(__file__).parents[2]
ANSWER = '__attribute__((visibility("default"))) int answer(void) {{ return {}; }}\n'


@pytest.fixture
def source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    if module.find_compiler() is None:
        pytest.skip("there is no C compiler")
    monkeypatch.delenv(module.SWITCH_VARIABLE, raising=False)
    monkeypatch.setitem(module.LIBRARIES, "answer", tmp_path)
    file = tmp_path / "answer.c"
    file.write_text(ANSWER.format(42))
    return file


def test_a_library_stands_for_the_sources_that_it_was_compiled_from(source: Path) -> None:
    assert shared_library("answer") is None
    first = compile_library("answer")
    assert compile_library("answer") == shared_library("answer") == first
    assert ctypes.CDLL(str(first)).answer() == 42
    source.write_text(ANSWER.format(43))
    assert shared_library("answer") is None
    second = compile_library("answer")
    assert ctypes.CDLL(str(second)).answer() == 43
    assert sorted(source.parent.iterdir()) == sorted([source, second])  # nothing older stays, nothing half built


def test_without_a_compiler_or_switched_off_there_is_none(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "there-is-no-such-compiler")
    with pytest.raises(OSError, match="no C compiler"):
        compile_library("answer")
    monkeypatch.delenv("CC")
    library = compile_library("answer")
    monkeypatch.setenv(module.SWITCH_VARIABLE, "off")
    assert shared_library("answer") is None
    monkeypatch.delenv(module.SWITCH_VARIABLE)
    library.write_text("junk")
    assert shared_library("answer") is None


def test_a_source_that_does_not_compile_is_told_with_the_command_and_leaves_nothing(source: Path) -> None:
    source.write_text("int answer(void) { return nothing; }\n")
    with pytest.raises(OSError, match=r"answer\.c[\s\S]*nothing"):
        compile_library("answer")
    assert list(source.parent.iterdir()) == [source]


def test_the_installation_compiles_with_nothing_but_python() -> None:
    """Before the package's requirements are there."""
    script = "import runpy, sys; print(*runpy.run_path(sys.argv[1])['LIBRARIES'])"
    file = ROOT / "pyrobocop_pyomo" / "native" / "shared_library.py"
    ended = subprocess.run([sys.executable, "-S", "-c", script, str(file)], capture_output=True, text=True, check=False)
    assert ended.stdout.split() == list(module.LIBRARIES)
    assert library_file("term_evaluation").parent.is_dir()
