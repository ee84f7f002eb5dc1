"""The core stands without the products in `contrib`: their folder may be deleted."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
# Tests that show public names of contrib, or start from what it proposes.
OF_CONTRIB = (
    "tests/architecture/test_shop_window.py",
    "tests/architecture/test_size.py",
    "tests/docs",
)


@pytest.fixture(scope="module")
def without_contrib(tmp_path_factory: pytest.TempPathFactory) -> Path:
    copy = tmp_path_factory.mktemp("core") / "copy"
    copy.mkdir()
    for name in ("pyrobocop_pyomo", "tests", "benchmarks", "examples", "docs"):
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("contrib", "__pycache__", "_build"))
    for path in filter(Path.is_file, ROOT.iterdir()):
        shutil.copy(path, copy)
    return copy


def run(folder: Path, *arguments: str) -> str:
    ended = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        timeout=1800,
    )
    assert ended.returncode == 0, ended.stdout[-4000:] + ended.stderr[-4000:]
    return ended.stdout


@pytest.mark.ipopt
@pytest.mark.slow
def test_the_first_example_of_the_readme_works_without_contrib(without_contrib: Path) -> None:
    (example,) = re.findall(r"## A first example.*?```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    said = run(without_contrib, "-c", f"import pyrobocop_pyomo\nprint(pyrobocop_pyomo.__file__)\n{example}")
    assert said.startswith(str(without_contrib))


@pytest.mark.slow
def test_the_quick_tests_of_the_core_pass_without_contrib(without_contrib: Path) -> None:
    left_out = [f"--ignore={path}" for path in OF_CONTRIB]
    said = run(without_contrib, "-m", "pytest", "-m", "quick", "-q", "-p", "no:cacheprovider", *left_out)
    assert " passed" in said
