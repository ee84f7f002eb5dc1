"""A compiled library is loaded only if it is what its name says and nobody else could have written it."""

from __future__ import annotations

import ctypes
import os
import shutil
import stat
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from pyrobocop_pyomo.errors import BuildFailed
from pyrobocop_pyomo.ipopt.ipopt_executable import find_ipopt_executable
from pyrobocop_pyomo.native import shared_library as module
from pyrobocop_pyomo.native.shared_library import build_shared_library, native_cache, shared_library

pytestmark = [
    pytest.mark.skipif(module.find_compiler() is None, reason="there is no C compiler"),
    pytest.mark.skipif(sys.platform == "win32", reason="modes of files are those of POSIX"),
]

ANSWER = '__attribute__((visibility("default"))) int answer(void) {{ return {}; }}\n'


@pytest.fixture
def source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(module.CACHE_VARIABLE, str(tmp_path / "cache"))
    monkeypatch.delenv(module.SWITCH_VARIABLE, raising=False)
    file = tmp_path / "answer.c"
    file.write_text(ANSWER.format(42))
    return file


def answer_of(library: Path | None) -> int:
    assert library is not None
    return ctypes.CDLL(str(library)).answer()


def compilations(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    done, compiled = [], module._compiled
    monkeypatch.setattr(module, "_compiled", lambda *given: done.append(given[0]) or compiled(*given))
    return done


def test_a_library_is_compiled_once_and_kept(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done = compilations(monkeypatch)
    first, second = (build_shared_library("answer", [source]) for _ in range(2))
    assert first == second
    assert answer_of(first) == 42
    assert done == ["answer"]
    assert stat.S_IMODE(native_cache().stat().st_mode) == 0o700
    assert sorted(path.name for path in native_cache().iterdir()) == [first.name]  # nothing half built stays


def test_another_source_and_other_flags_are_other_libraries(source: Path) -> None:
    first = build_shared_library("answer", [source])
    optimised = build_shared_library("answer", [source], flags=(*module.FLAGS, "-DNEVER_READ"))
    source.write_text(ANSWER.format(43))
    second = build_shared_library("answer", [source])
    assert len({first, second, optimised}) == 3
    assert (answer_of(first), answer_of(second)) == (42, 43)


@pytest.mark.parametrize("damage", ["cut", "foreign content", "writable by others", "a link"])
def test_what_is_damaged_or_may_be_foreign_is_replaced(
    damage: str, source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = build_shared_library("answer", [source])
    content = kept.read_bytes()
    if damage == "cut":
        kept.write_bytes(content[: len(content) // 2])
    elif damage == "foreign content":
        kept.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    elif damage == "writable by others":
        kept.chmod(0o777)
    else:
        shutil.move(kept, tmp_path / "elsewhere.so")
        kept.symlink_to(tmp_path / "elsewhere.so")
    done = compilations(monkeypatch)
    again = build_shared_library("answer", [source])
    assert done == ["answer"]
    assert not again.is_symlink()
    assert again.read_bytes() == content
    assert answer_of(again) == 42


def test_nothing_is_loaded_from_a_folder_that_others_can_write_to(source: Path) -> None:
    native_cache().mkdir(parents=True)
    native_cache().chmod(0o777)
    with pytest.raises(BuildFailed, match="others may write"):
        build_shared_library("answer", [source])
    assert shared_library("answer", [source]) is None


def test_a_library_beside_its_source_needs_no_compiler(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    brought = build_shared_library("answer", [source], beside=True)
    assert brought.parent == source.parent
    monkeypatch.setenv("CC", "there-is-no-such-compiler")
    assert shared_library("answer", [source]) == brought
    source.write_text(ANSWER.format(44))  # an older library does not stand for a newer source
    with pytest.raises(BuildFailed, match="no C compiler"):
        build_shared_library("answer", [source])


def test_without_a_compiler_or_switched_off_there_is_none(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as without:
        without.setenv(module.SWITCH_VARIABLE, "off")
        assert shared_library("answer", [source]) is None
    monkeypatch.setenv("CC", "there-is-no-such-compiler")
    assert shared_library("answer", [source]) is None
    assert not native_cache().exists() or not list(native_cache().iterdir())


def test_a_source_that_does_not_compile_is_told_with_the_command(source: Path) -> None:
    source.write_text("int answer(void) { return nothing; }\n")
    with pytest.raises(BuildFailed, match=r"answer\.c[\s\S]*nothing"):
        build_shared_library("answer", [source])
    assert not list(native_cache().iterdir())


def test_a_compiler_that_is_killed_leaves_nothing(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = tmp_path / "temporary"
    elsewhere.mkdir()
    monkeypatch.setenv("TMPDIR", str(elsewhere))
    killed = tmp_path / "killed-compiler"
    killed.write_text('#!/bin/sh\ntouch "$TMPDIR/half-done.s"\nkill -KILL $$\n')
    killed.chmod(0o755)
    monkeypatch.setenv("CC", str(killed))
    with pytest.raises(BuildFailed, match="code -9"):
        build_shared_library("answer", [source])
    assert [*elsewhere.iterdir(), *native_cache().iterdir()] == []


def test_what_a_killed_process_left_is_removed_and_what_another_compiles_is_not(source: Path) -> None:
    kept = build_shared_library("answer", [source])
    abandoned, busy = (native_cache() / f".building-{name}" for name in ("abandoned", "busy"))
    for scratch in (abandoned, busy):
        scratch.mkdir()
        (scratch / "half-done.so").touch()
    yesterday = kept.stat().st_mtime - 86400
    os.utime(abandoned, (yesterday, yesterday))
    assert build_shared_library("answer", [source], force=True).parent == native_cache()
    assert set(native_cache().iterdir()) == {kept, busy}


@pytest.mark.parametrize("names", [[], ["answer.c"]], ids=["none", "inside"])
def test_sources_in_an_archive_are_told(source: Path, tmp_path: Path, names: list[str]) -> None:
    archive = tmp_path / "package.zip"
    archive.touch()
    sources = [archive / name for name in names]
    with pytest.raises(BuildFailed, match="'answer' are no files here, as where .* zip"):
        build_shared_library("answer", sources)
    assert shared_library("answer", sources) is None


def test_several_at_once_compile_the_same_library(source: Path) -> None:
    with ThreadPoolExecutor(4) as threads:
        found = set(threads.map(lambda _: build_shared_library("answer", [source]), range(4)))
    assert len(found) == 1
    assert answer_of(found.pop()) == 42


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written_to_is_told(source: Path, tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(BuildFailed, match="cannot make the folder"):
            build_shared_library("answer", [source])
    finally:
        tmp_path.chmod(0o700)


def test_what_a_compiler_writes_is_offered_only_if_it_can_be_loaded(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    junk = tmp_path / "junk-compiler"
    junk.write_text('#!/bin/sh\nwhile [ "$1" != "-o" ]; do shift; done\necho junk > "$2"\n')
    junk.chmod(0o755)
    monkeypatch.setenv("CC", str(junk))
    assert shared_library("answer", [source]) is None


def test_a_folder_without_execution_gives_no_library(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "noexec"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "noexec,mode=700", "tmpfs", str(folder)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("mounting needs rights that are not given here")
    try:
        monkeypatch.setenv(module.CACHE_VARIABLE, str(folder))
        assert build_shared_library("answer", [source]).is_file()
        assert shared_library("answer", [source]) is None
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


def test_a_user_without_a_home_gets_a_private_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_home() -> Path:
        raise RuntimeError("Could not determine home directory.")

    for name in (module.CACHE_VARIABLE, "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(Path, "home", no_home)
    assert native_cache().name == f"pyrobocop_pyomo-{os.geteuid()}"
    find_ipopt_executable()
