"""Files of a folder are solved to their known optima, kept, and checked by their statement."""

from __future__ import annotations

import importlib
import shutil
from pathlib import Path
from typing import Any

import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.__main__ import main
from pyrobocop_pyomo.errors import CheckpointError, ModelError
from pyrobocop_pyomo.studies import SweepResult, solve_files

from .points import COLLECTION, OPTIMA

module = importlib.import_module("pyrobocop_pyomo.studies.solve_files")


def objectives(result: SweepResult) -> dict[str, float]:
    return {outcome.name: outcome.numbers["checked"] for outcome in result}


def folder_with(names: list[str], folder: Path) -> Path:
    folder.mkdir()
    for name in names:
        shutil.copy(COLLECTION / f"{name}.nl", folder)
    return folder


@pytest.mark.ipopt
def test_the_command_line_solves_a_folder_to_the_known_optima(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    results = tmp_path / "results.jsonl"
    assert main(["solve", str(COLLECTION), "--results", str(results), "--time-limit", "60"]) == 0
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
    assert main(["solve", str(COLLECTION), "--results", str(results), "--time-limit", "60"]) == 0
    assert capsys.readouterr().out.splitlines() == lines


@pytest.mark.ipopt
def test_only_what_is_new_or_has_changed_is_solved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, file = folder_with(["df1", "gauvin"], tmp_path / "some"), tmp_path / "results.jsonl"
    opened: list[str] = []
    read = module.read_file

    def noted(path: str) -> Any:
        opened.append(Path(path).stem)
        return read(path)

    monkeypatch.setattr(module, "read_file", noted)
    first = solve_files(folder, file=file)
    assert opened == ["df1", "gauvin"]
    assert objectives(solve_files(folder, file=file)) == objectives(first)
    assert opened == ["df1", "gauvin"]
    shutil.copy(COLLECTION / "box.nl", folder / "before.nl")
    gauvin = (folder / "gauvin.nl").read_text()
    (folder / "gauvin.nl").write_text(gauvin.replace("n-10", "n-9"))
    found = objectives(solve_files(folder, file=file))
    assert opened == ["df1", "gauvin", "before", "gauvin"]
    assert found["df1.nl"] == objectives(first)["df1.nl"]
    assert found["before.nl"] == pytest.approx(OPTIMA["box"], abs=1e-6)
    assert found["gauvin.nl"] == pytest.approx(28.8)  # at (2.4, 13.8)
    solve_files(folder, file=file, again=True)
    assert len(opened) == 7


@pytest.mark.ipopt
@pytest.mark.slow
def test_processes_find_the_same(tmp_path: Path) -> None:
    alone = solve_files(COLLECTION)
    together = solve_files(COLLECTION, workers=2, file=tmp_path / "results.jsonl")
    assert objectives(together) == pytest.approx(objectives(alone), abs=1e-8)
    assert objectives(solve_files(COLLECTION, file=tmp_path / "results.jsonl")) == objectives(together)


@pytest.mark.ipopt
def test_a_file_that_cannot_be_read_leaves_the_others_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = folder_with(["ralph2"], tmp_path / "some")
    (folder / "broken.nl").write_text("nothing")
    assert main(["solve", str(folder), "--results", str(tmp_path / "results.jsonl")]) == 1
    first, second = capsys.readouterr().out.splitlines()[1:]
    assert "broken.nl" in first
    assert "is no .nl file" in first
    assert "optimal" in second


@pytest.mark.ipopt
def test_ctrl_c_keeps_what_is_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, file = folder_with(["df1", "gauvin", "ralph2"], tmp_path / "some"), tmp_path / "results.jsonl"
    read = module.read_file

    def interrupted(path: str) -> Any:
        if Path(path).stem == "gauvin":
            raise KeyboardInterrupt
        return read(path)

    with monkeypatch.context() as patch:
        patch.setattr(module, "read_file", interrupted)
        partly = solve_files(folder, file=file)
    assert partly.remaining == ("gauvin.nl", "ralph2.nl")
    assert not partly.reached
    whole = solve_files(folder, file=file)
    assert whole.reached
    assert objectives(whole)["df1.nl"] == objectives(partly)["df1.nl"]


@pytest.mark.ipopt
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


def test_nothing_to_solve_and_files_of_something_else_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(ModelError, match=r"no \.nl or \.json files in"):
        solve_files(tmp_path)
    assert main(["solve", str(tmp_path)]) == 1
    assert "no .nl or .json files" in capsys.readouterr().err
    precious = tmp_path / "precious.txt"
    precious.write_text("keep me")
    with pytest.raises(CheckpointError, match="is not removed"):
        solve_files(COLLECTION, file=precious, again=True)
    assert precious.read_text() == "keep me"


def test_the_namespace_reads_and_writes(tmp_path: Path) -> None:
    model = rcp.files.read_file(COLLECTION / "gauvin.nl").model()
    path = rcp.files.write_file(model, tmp_path / "copy.nl")
    assert rcp.files.read_file(path).model().name == "copy"
    with pytest.raises(ModelError, match="writer = 'nl'"):
        rcp.files.write_file(model, path, writer="nl")
    with pytest.raises(ModelError, match=r"neither a \.nl nor"):
        rcp.files.write_file(model, tmp_path / "copy.lp")
