from __future__ import annotations

import io
import sys
import time

import pytest

from irt.cli import progress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def work(monkeypatch: pytest.MonkeyPatch, stream: io.StringIO, patience_s: float) -> str:
    monkeypatch.setattr(progress, "_PATIENCE_S", patience_s)
    monkeypatch.setattr(sys, "stderr", stream)
    with progress.progress_bar() as update:
        for done in range(1, 4):
            time.sleep(0.11)  # the bar is drawn ten times a second at most
            update(done, 3, f"step {done}")
    return stream.getvalue()


def test_long_work_shows_a_bar_and_wipes_it_away(monkeypatch) -> None:
    shown = work(monkeypatch, Terminal(), patience_s=0.0)
    assert "step 3: 100%" in shown
    assert shown.endswith("\r")
    assert "\n" not in shown


def test_short_work_shows_none(monkeypatch) -> None:
    assert work(monkeypatch, Terminal(), patience_s=3600.0) == ""


def test_without_a_terminal_there_is_none(monkeypatch) -> None:
    assert work(monkeypatch, io.StringIO(), patience_s=0.0) == ""
