"""Every textbook example is short, runs as a script on few elements, and shows its number beside the published one."""

import contextlib
import io
import runpy
import sys
from pathlib import Path

import pytest

TEXTBOOK = Path(__file__).parents[2] / "examples" / "textbook"
SCRIPTS = sorted(path.stem for path in TEXTBOOK.glob("*.py") if "__main__" in path.read_text(encoding="utf-8"))
# On few elements these find nothing worth showing, or take too long: the benchmark runs them in full.
FULL_ONLY = ("alp_rider", "ascent", "climb", "hang_glider", "reentry", "low_thrust_transfer", "two_burn_transfer")

pytestmark = pytest.mark.casadi


def test_there_are_at_least_twenty_of_them() -> None:
    assert len(SCRIPTS) >= 20


@pytest.mark.parametrize("name", SCRIPTS)
def test_an_example_is_short_and_names_its_source_and_its_value(name: str) -> None:
    text = (TEXTBOOK / f"{name}.py").read_text(encoding="utf-8")
    assert "PUBLISHED = " in text
    assert len(text.splitlines()) <= 60
    assert any(year in text.split('"""')[1] for year in ("19", "20"))


@pytest.mark.parametrize("name", [name for name in SCRIPTS if name not in FULL_ONLY])
def test_a_coarse_run_solves_verifies_and_draws(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # In this process: a fresh interpreter for each would take most of the time.
    pytest.importorskip("matplotlib")
    monkeypatch.syspath_prepend(str(TEXTBOOK))
    monkeypatch.syspath_prepend(str(TEXTBOOK.parent))
    monkeypatch.setattr(sys, "argv", [name, "--coarse", "--output", str(tmp_path)])
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), pytest.raises(SystemExit) as ended:
        runpy.run_path(str(TEXTBOOK / f"{name}.py"), run_name="__main__")
    assert ended.value.code == 0, printed.getvalue()
    assert "relative difference" in printed.getvalue()
    assert (tmp_path / f"{name}.png").stat().st_size > 10_000
