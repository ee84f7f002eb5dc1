"""What goes into the wheel that people install."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest

import pyrobocop_pyomo

ROOT = Path(__file__).parents[2]


def test_the_version_to_cite_is_the_version() -> None:
    cited = re.search(r"^version: (.*)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    assert cited is not None
    assert cited.group(1) == pyrobocop_pyomo.__version__.partition(".dev")[0]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> ZipFile:
    pytest.importorskip("build")
    # On a copy, because setuptools leaves its traces beside the sources.
    copy = tmp_path_factory.mktemp("distribution")
    for name in ("pyproject.toml", "setup.cfg", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    shutil.copytree(
        ROOT / "pyrobocop_pyomo", copy / "pyrobocop_pyomo", ignore=shutil.ignore_patterns("__pycache__", "*.so")
    )
    # First a source distribution, then the wheel out of it; without isolation, which would download setuptools.
    command = [sys.executable, "-m", "build", "--no-isolation", str(copy)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ZipFile(next((copy / "dist").glob("*.whl")))


@pytest.mark.slow
def test_wheel_holds_the_package_and_its_type_marker(wheel: ZipFile) -> None:
    folder = ROOT / "pyrobocop_pyomo"
    sources = {
        path.relative_to(ROOT).as_posix()
        for path in (*folder.rglob("*.py"), *folder.rglob("*.[ch]"), *folder.rglob("*.cpp"))
    }
    packed = {name for name in wheel.namelist() if ".dist-info/" not in name}
    assert packed == sources | {"pyrobocop_pyomo/py.typed"}


@pytest.mark.slow
def test_metadata_name_licence_requirements_and_page(wheel: ZipFile) -> None:
    (name,) = (name for name in wheel.namelist() if name.endswith(".dist-info/METADATA"))
    metadata = wheel.read(name).decode()
    assert "BSD-3-Clause" in metadata
    assert "# pyrobocop_pyomo" in metadata
    required = [line for line in metadata.splitlines() if line.startswith("Requires-Dist") and "extra" not in line]
    assert sorted(re.split("[<>=]", line.split()[1])[0] for line in required) == ["networkx", "numpy", "pyomo", "scipy"]
    assert all(">=" in line for line in required)
