"""What a recording says where there is no terminal, and of lost connections at its end."""

from __future__ import annotations

import io
import sys
import time
from pathlib import Path

import pytest

from recorder import record_progress
from recorder.capture.log_thread import Problem
from recorder.capture.outages import OutageClock
from recorder.log.reader import LogReader
from recorder.record import record
from recorder.record_progress import RecordProgress
from recorder.record_text import summary_text
from recorder.sources.base import SourceEvent
from tests.live_sources import Item, LiveScript, now_frames


def event(text: str, connected: bool) -> SourceEvent:
    return SourceEvent(time.time_ns(), "error", text, connected=connected)


def test_outages_are_added_up(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    clock = OutageClock()
    assert clock.outages.count == 0
    clock.tell(connected=False)
    now[0] = 2.0
    clock.tell(connected=False)
    assert (clock.outages.seconds, clock.outages.at_end) == (2.0, True)
    now[0] = 3.5
    clock.tell(connected=True)
    now[0] = 10.0
    assert (clock.outages.count, clock.outages.seconds, clock.outages.at_end) == (1, 3.5, False)
    clock.tell(connected=False)
    now[0] = 11.0
    assert (clock.outages.count, clock.outages.seconds, clock.outages.at_end) == (2, 4.5, True)


def test_lost_connections_are_in_the_summary_and_in_the_log(tmp_path: Path) -> None:
    frames = list(now_frames(12))
    items: list[Item] = [
        *frames[:4], event("lost", False), *frames[4:5], event("back", True), *frames[5:10],
        event("lost again", False), *frames[10:],
    ]  # fmt: skip
    path = tmp_path / "log.mcap"
    summary = record(LiveScript(items, rate_hz=40), path)
    outages = summary.outages
    assert (outages.count, outages.at_end) == (2, True)
    # From the fourth item to the sixth, and from the thirteenth on.
    assert outages.seconds == pytest.approx(4 / 40, abs=0.06)
    line = f"connection lost 2 times, for {outages.seconds:.1f} s in all, and not back at the end"
    assert line in summary_text(summary).splitlines()
    with LogReader(path) as log:
        end = log.metadata["session_end"]
    assert (end["connection_lost"], end["connection_lost_at_end"]) == ("2", "yes")
    assert float(end["connection_lost_s"]) == round(outages.seconds, 1)


def test_a_connection_that_holds_is_not_mentioned(tmp_path: Path) -> None:
    summary = record(LiveScript(now_frames(5)), tmp_path / "log.mcap")
    assert "connection lost" not in summary_text(summary)


def test_without_a_terminal_each_kind_of_problem_is_told_once_in_a_while(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(record_progress, "_AGAIN_S", 0.2)
    with RecordProgress("record", None) as progress:
        for k in range(30):
            progress.show(k, "all well", Problem(f"frame {k} is empty", 0.0))
            progress.show(k, "all well", Problem("connection lost", 0.01 * k))
            time.sleep(0.01)
        progress.show(30, "all well", None)
    lines = capsys.readouterr().err.splitlines()
    assert lines.count("record: connection lost") == 1
    assert 2 <= sum(line.endswith("is empty") for line in lines) <= 3
    assert lines[0] == "record: frame 0 is empty"


def test_in_a_terminal_there_is_a_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = io.StringIO()
    monkeypatch.setattr(screen, "isatty", lambda: True)
    monkeypatch.setattr(sys, "stderr", screen)
    with RecordProgress("record", 10) as progress:
        progress.show(4, "2 s ago: connection lost, dropped 0", Problem("connection lost", 2.0))
    text = screen.getvalue()
    assert "4/10" in text
    assert "2 s ago: connection lost, dropped 0" in text
    assert "record: connection lost" not in text


def test_without_a_terminal_it_says_now_and_then_that_all_is_well(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(record_progress, "_ALIVE_S", 0.05)
    with RecordProgress("track", None) as progress:
        progress.show(1, "dropped 0", None)
        time.sleep(0.06)
        progress.show(7, "dropped 0", None)
        progress.show(8, "dropped 0", None)
    assert capsys.readouterr().err.splitlines() == ["track: 7 frames, dropped 0"]
