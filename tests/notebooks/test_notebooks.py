"""Every notebook runs from top to bottom in a fresh kernel, and shows what is stored in it.

Numbers are compared in the cells with the tag ``answer``; elsewhere they may change with the machine, as seconds and
residuals do, and the kinds of outputs are compared.
"""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

nbformat = pytest.importorskip("nbformat")
pytest.importorskip("nbclient")
pytest.importorskip("ipykernel")
pytest.importorskip("matplotlib")

FOLDER = Path(__file__).parents[2] / "docs" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
LARGEST = 300_000  # bytes


def _loaded() -> ModuleType:
    """The script that stores outputs, which is in no package."""
    specification = importlib.util.spec_from_file_location("store_outputs", FOLDER / "store_outputs.py")
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


script = _loaded()


def test_there_are_ten_notebooks() -> None:
    assert len(NOTEBOOKS) == 10
    assert script.notebooks() == NOTEBOOKS


@pytest.mark.casadi
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_shows_what_is_stored(path: Path) -> None:
    stored = [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
    now = [cell for cell in script.executed(path).cells if cell.cell_type == "code"]
    for before, after in zip(stored, now, strict=True):
        assert "stderr" not in script.kinds(after), after.outputs
        assert script.kinds(before) == script.kinds(after), before.source
        if script.is_answer(before):
            words, numbers = script.answer(before)
            words_now, numbers_now = script.answer(after)
            assert words == words_now
            assert numbers_now == pytest.approx(numbers, rel=1e-3, abs=2e-4)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_is_stored_with_outputs_and_a_picture(path: Path) -> None:
    assert path.stat().st_size < LARGEST
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert any("image/png" in script.kinds(cell) for cell in cells)
    assert all(cell.execution_count == place for place, cell in enumerate(cells, start=1)), "run it from the top"
    assert any(script.is_answer(cell) and script.answer(cell)[0] for cell in cells)
    assert notebook.cells[0].source.startswith("# ")
