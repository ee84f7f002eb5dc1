"""Files of a folder are solved to their known optima, kept, and checked by their statement."""

import importlib
import shutil
from pathlib import Path
from typing import Any

import pytest
from solve_files import main, solve_files

pytestmark = pytest.mark.ipopt

module = importlib.import_module("solve_files")
COLLECTION = Path(__file__).parent / "collection"
# Best objective of each file, and where it is from.
OPTIMA = {
    "box": 0.25,  # by inspection: (2, 0.5)
    "capacity": 4.0,  # by inspection: the flow 2, the toll 0.25
    "df1": 0.0,  # MacMPEC
    "gauvin": 20.0,  # MacMPEC
    "ralph2": 0.0,  # MacMPEC
}


def folder_with(names: list[str], folder: Path) -> Path:
    folder.mkdir()
    for name in names:
        shutil.copy(COLLECTION / f"{name}.nl", folder)
    return folder


def test_the_command_line_solves_a_folder_to_the_known_optima(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    results = tmp_path / "results.jsonl"
    assert main([str(COLLECTION), "--results", str(results), "--time-limit", "60"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[:5] == ["case", "name", "checked", "violation", "natural"]
    rows = {words[1].removesuffix(".nl"): words for words in map(str.split, lines[1:])}
    assert rows.keys() == OPTIMA.keys()
    for name, optimum in OPTIMA.items():
        judged, violation, natural = map(float, rows[name][2:5])
        assert judged == pytest.approx(optimum, abs=1e-6)
        assert max(violation, natural) <= 1e-6
        assert "optimal" in rows[name]
        assert "proven" in rows[name]
    # All of it again is read from the results.
    assert main([str(COLLECTION), "--results", str(results), "--time-limit", "60"]) == 0
    assert capsys.readouterr().out.splitlines() == lines


def test_the_numbers_are_those_of_the_file_and_not_of_the_solver(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A solver that claims another point to be optimal is found out."""
    folder = folder_with(["box"], tmp_path / "some")
    sweep_module = importlib.import_module("pyrobocop_pyomo.studies.case_solver")
    solve = sweep_module.solve_as_given

    def lying(model: Any, **options: Any) -> Any:
        result = solve(model, **options)
        model.x["1"].set_value(0.0)  # y, while x stays at 2
        return result

    monkeypatch.setattr(sweep_module, "solve_as_given", lying)
    (outcome,) = solve_files(folder)
    assert outcome.verdict == "optimal"
    assert outcome.numbers["natural"] == pytest.approx(0.5)
    assert outcome.numbers["checked"] == pytest.approx(1.0)
