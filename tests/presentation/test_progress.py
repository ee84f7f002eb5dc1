"""What a terminal shows: one live line that is replaced, and lines that stay."""

import io
from typing import Any

import pytest

from pyrobocop_pyomo.presentation import progress
from pyrobocop_pyomo.presentation.progress import Progress


@pytest.mark.parametrize("columns", [20, 80])
def test_a_live_line_never_wraps(monkeypatch: pytest.MonkeyPatch, columns: int) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    stream = io.StringIO()
    bar = Progress(True, stream)
    bar.live("long " * 40)
    bar.live("short")
    bar.line("stays")
    shown = stream.getvalue().split("\r")[1:]
    assert [len(text.rstrip("\n")) for text in shown] == [columns - 1, columns - 1, 5]
    assert shown[-1] == "stays\n"


def test_what_was_said_is_not_said_again() -> None:
    stream = io.StringIO()
    bar = Progress(True, stream)
    for text in ("ipopt", "a round", "ipopt", "another"):
        bar.line_once(text)
    assert stream.getvalue().replace("\r", "") == "ipopt\na round\nanother\n"


def test_nothing_is_shown_unless_asked_for_or_on_a_terminal() -> None:
    stream = io.StringIO()
    bar = Progress(None, stream)
    bar.live("live")
    bar.line("line")
    assert stream.getvalue() == ""


@pytest.mark.parametrize("delay", [0.0, 1e9])
def test_a_notebook_gets_one_area_and_only_from_long_work(monkeypatch: pytest.MonkeyPatch, delay: float) -> None:
    shown: list[str] = []

    class Area:
        def update(self, data: dict[str, str], **options: Any) -> None:
            shown[-1] = data["text/plain"]

    def display(data: dict[str, str], **options: Any) -> Area:
        shown.append(data["text/plain"])
        return Area()

    monkeypatch.setattr(progress, "notebook_display", lambda: display)
    monkeypatch.setattr(progress, "NOTEBOOK_DELAY", delay)
    bar = Progress()
    bar.live("first")
    bar.line("stays")
    bar.live("second")
    assert shown == ([] if delay else ["stays\nsecond"])
    bar.live("")
    assert shown == ([] if delay else ["stays"])
    Progress(False).line("nothing is asked for")
    Progress().live("")  # the end of work that showed nothing
    assert len(shown) <= 1
