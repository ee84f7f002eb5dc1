"""Execute the notebooks of this folder and store their outputs: ``python docs/notebooks/store_outputs.py [name ...]``.

`tests/notebooks` executes them in the same way, and compares.
"""

from __future__ import annotations

import re
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

import nbclient
import nbformat

FOLDER = Path(__file__).parent
# Where this machine keeps its packages, and files that are gone.
PLACES = re.compile(r"/[^\s()'\"<>]*/(?=site-packages/|animation\.gif)")
NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?(?:e[-+]?\d+)?")


def notebooks() -> list[Path]:
    """All notebooks, in the order of their names."""
    return sorted(FOLDER.glob("*.ipynb"))


def executed(path: Path) -> Any:
    """A notebook with the outputs that it has now, run in a folder that is removed afterwards."""
    notebook = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        # Jupyter's own machinery warns about itself; the cells run in a process that is not affected.
        warnings.simplefilter("ignore")
        nbclient.NotebookClient(
            notebook, timeout=120, record_timing=False, resources={"metadata": {"path": folder}}
        ).execute()
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs = [output for output in cell.outputs if not output.get("metadata", {}).get("progress")]
            for output in cell.outputs:
                leave_places_out(output)
    # The version of the Python that ran them is none of the reader's business.
    notebook.metadata.language_info = {"name": "python"}
    return notebook


def leave_places_out(output: Any) -> None:
    """Shorten paths of this machine in the text of an output."""
    if "text" in output:
        output.text = PLACES.sub(".../", output.text)
    for form in ("text/plain", "text/html"):
        if form in output.get("data", {}):
            output.data[form] = PLACES.sub(".../", output.data[form])


def kinds(cell: Any) -> list[str]:
    """What sort of outputs a cell has: the streams, and the richest form of each thing shown."""
    found = []
    for output in cell.outputs:
        if output.output_type == "stream":
            found.append(output.name)
        else:
            forms = output.get("data", {})
            found.append(next((form for form in ("image/png", "text/html", "text/plain") if form in forms), ""))
    return sorted(set(found))


def answer(cell: Any) -> tuple[str, list[float]]:
    """What a cell prints, as words without numbers, and as numbers."""
    text = "".join(output.text for output in cell.outputs if output.output_type == "stream")
    return NUMBER.sub("#", text), [float(number) for number in NUMBER.findall(text)]


def is_answer(cell: Any) -> bool:
    """True for a cell whose numbers must be the stored ones: those that the notebook is about."""
    return cell.cell_type == "code" and "answer" in cell.metadata.get("tags", ())


if __name__ == "__main__":
    wanted = sys.argv[1:]
    for file in notebooks():
        if not wanted or file.stem in wanted:
            nbformat.write(executed(file), file)
            sys.stdout.write(f"{file.name}: {file.stat().st_size / 1000:.0f} kB\n")
