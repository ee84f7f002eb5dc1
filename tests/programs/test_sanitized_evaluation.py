"""The compiled evaluation under sanitizers: no access outside of its arrays, nothing undefined."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import pyrobocop_pyomo

GCC = shutil.which("gcc")


def runtime(name: str) -> str | None:
    """A sanitizer's library; gcc repeats the bare name of one that is not there."""
    found = subprocess.run([str(GCC), f"-print-file-name={name}"], capture_output=True, text=True, check=True)
    return found.stdout.strip() if Path(found.stdout.strip()).is_absolute() else None


@pytest.mark.heavy
@pytest.mark.casadi
@pytest.mark.skipif(GCC is None or not sys.platform.startswith("linux"), reason="needs gcc's sanitizers")
def test_no_block_reads_or_writes_outside_of_its_arrays(tmp_path: Path) -> None:
    libraries = [runtime(name) for name in ("libasan.so", "libubsan.so")]
    if None in libraries:
        pytest.skip("gcc has no sanitizers here")
    laws = Path(__file__).with_name("test_compiled_terms.py")
    # A copy of the package, imported from the working folder.
    compiled = shutil.ignore_patterns("__pycache__", "*.so")
    folder = Path(pyrobocop_pyomo.__file__).parent
    shutil.copytree(folder, tmp_path / "pyrobocop_pyomo", ignore=compiled)
    for name in ("setup.py", "setup.cfg", "pyproject.toml", "README.md"):
        shutil.copy(folder.parent / name, tmp_path)
    compiler = f"{GCC} -fsanitize=address,undefined -fno-sanitize-recover=all -g"
    command = [sys.executable, "setup.py", "build_ext", "--inplace"]
    subprocess.run(command, cwd=tmp_path, env={**os.environ, "CC": compiler}, check=True)
    ended = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", laws, "-k", "129 or ipopt_runs"],
        cwd=tmp_path,
        env={
            **os.environ,
            # Ipopt loads it in a way that sanitizers refuse; it has a test of its own.
            "PYROBOCOP_LINEAR_SOLVER": "none",
            # Python itself frees not all that it takes; the library is loaded into a process without the runtimes.
            "LD_PRELOAD": " ".join(map(str, libraries)),
            "ASAN_OPTIONS": "detect_leaks=0",
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stdout[-3000:] + ended.stderr[-3000:]
    assert "passed" in ended.stdout
    assert "skipped" not in ended.stdout  # without the library there is nothing to test
