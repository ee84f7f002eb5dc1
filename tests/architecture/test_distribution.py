"""What goes into the source distribution and the wheel, and what the package index shows of them."""

import importlib.util
import os
import re
import runpy
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path
from zipfile import ZipFile

import pytest

import pyrobocop_pyomo

ROOT = Path(__file__).parents[2]
REPOSITORY = "https://example.org/owner/name"
FOLDERS = ("benchmarks", "docs", "examples", "pyrobocop_pyomo", "tests")
INSIDE = re.compile(rf"{REPOSITORY}/(blob|raw)/v1/([^)#]+)")


def test_the_version_to_cite_is_the_version() -> None:
    cited = re.search(r"^version: (.*)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    assert cited is not None
    assert cited.group(1) == pyrobocop_pyomo.__version__.partition(".dev")[0]


def test_links_on_the_package_index_lead_to_files_of_the_repository() -> None:
    absolute_links = runpy.run_path(str(ROOT / "setup.py"))["absolute_links"]
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    shown = absolute_links(text, REPOSITORY, "v1")
    targets = re.findall(r"(!?)\[[^]]*\]\(([^)]+)\)", shown)
    assert all(target.startswith("https://") for _, target in targets)
    within = [(mark, *found.groups()) for mark, target in targets if (found := INSIDE.match(target))]
    assert {(mark, kind) for mark, kind, _ in within} == {("!", "raw"), ("", "blob")}
    assert [path for _, _, path in within if not (ROOT / path).is_file()] == []
    assert INSIDE.sub(r"\2", shown) == text  # nothing else changes
    assert absolute_links(shown, "https://example.org/another", "v2") == shown


def test_addresses_anchors_and_code_are_no_relative_links() -> None:
    absolute_links = runpy.run_path(str(ROOT / "setup.py"))["absolute_links"]
    same = "[a](https://b.org/c.png) [d](#e) [f](mailto:g@h.org) `i[j](k)`\n```python\nl[m](n)\n```\n"
    assert absolute_links(same, REPOSITORY, "v1") == same
    linked = absolute_links("[![`a`](b.png)](c.md#d)", REPOSITORY, "v1")
    assert linked == f"[![`a`]({REPOSITORY}/raw/v1/b.png)]({REPOSITORY}/blob/v1/c.md#d)"


def files_in(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def distributions(tmp_path_factory: pytest.TempPathFactory) -> tuple[set[str], Path, Path]:
    """The files of the project, and what is built of them: the source distribution and the wheel."""
    pytest.importorskip("build")
    # On a copy, because setuptools leaves its traces beside the sources.
    copy = tmp_path_factory.mktemp("distribution") / "copy"
    made = shutil.ignore_patterns(".*", "__pycache__", "_build", "generated", "*.so", "*.dylib", "*.dll")
    for folder in FOLDERS:
        shutil.copytree(ROOT / folder, copy / folder, ignore=made)
    for kind in ("*.md", "*.py", "*.cff", "*.cfg", "*.toml", "LICENSE", "MANIFEST.in"):
        for path in ROOT.glob(kind):
            shutil.copy(path, copy)
    files = files_in(copy)
    (copy / "pyrobocop_pyomo" / "programs" / "left-by-build-ext.so").touch()
    # First a source distribution, then the wheel out of it; without isolation, which would download setuptools.
    command = [sys.executable, "-m", "build", "--no-isolation", str(copy)]
    environment = {**os.environ, "PYROBOCOP_REPOSITORY": f"{REPOSITORY}/", "PYROBOCOP_NATIVE": "off"}
    ended = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return files, next((copy / "dist").glob("*.tar.gz")), next((copy / "dist").glob("*.whl"))


@pytest.fixture
def wheel(distributions: tuple[set[str], Path, Path]) -> ZipFile:
    return ZipFile(distributions[2])


@pytest.mark.slow
def test_source_distribution_holds_all_that_the_tests_and_the_pages_need(
    distributions: tuple[set[str], Path, Path],
) -> None:
    files, source, _ = distributions
    with tarfile.open(source) as archive:
        packed = {member.name.partition("/")[2] for member in archive.getmembers() if member.isfile()}
    assert {name for name in packed if not name.startswith("pyrobocop_pyomo.egg-info/")} == files | {"PKG-INFO"}


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [
        ["twine", "check", "--strict"],
        ["check_wheel_contents"],
        ["pyroma", "--min=10", "--skip-tests=AuthorEmail"],  # the project gives no address
    ],
    ids=lambda command: command[0],
)
def test_the_package_index_takes_what_is_built(command: list[str], distributions: tuple[set[str], Path, Path]) -> None:
    if importlib.util.find_spec(command[0]) is None:
        pytest.skip(f"{command[0]} is not installed")
    _, source, packed = distributions
    paths = {"twine": [source, packed], "check_wheel_contents": [packed], "pyroma": [source]}[command[0]]
    command = [sys.executable, "-m", *command, *map(str, paths)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr


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
    assert "License-Expression: BSD-3-Clause\n" in metadata
    assert "# pyrobocop_pyomo" in metadata
    pages = {line.partition(": ")[2] for line in metadata.splitlines() if line.startswith("Project-URL: ")}
    changes = f"{REPOSITORY}/blob/v{pyrobocop_pyomo.__version__}/CHANGELOG.md"
    assert {f"Source, {REPOSITORY}", f"Issues, {REPOSITORY}/issues", f"Changelog, {changes}"} < pages
    assert "](docs/" not in metadata
    required = [line for line in metadata.splitlines() if line.startswith("Requires-Dist") and "extra" not in line]
    assert sorted(re.split("[<>=]", line.split()[1])[0] for line in required) == ["networkx", "numpy", "pyomo", "scipy"]
    assert all(">=" in line for line in required)
