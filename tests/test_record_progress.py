"""What a recording says where there is no terminal, and of lost connections at its end."""

from __future__ import annotations

import io
import re
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from recorder.capture.outages import OutageClock
from recorder.log.reader import LogReader
from recorder.record import record
from recorder.record_progress import RecordProgress
from recorder.record_text import ending_text, exit_code, status_text, summary_text
from recorder.sources.base import SourceEvent
from tests.live_sources import Item, LiveScript, now_frames


def event(text: str, connected: bool, silent_s: float) -> SourceEvent:
    return SourceEvent(time.time_ns(), "error", text, connected=connected, silent_s=silent_s)


def test_outages_are_added_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """From the last frame on, not from when its being the last was noticed."""
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    clock = OutageClock()
    assert clock.outages.count == 0
    clock.tell(connected=False, silent_s=10.0)
    now[0] = 102.0
    clock.tell(connected=False, silent_s=12.0)
    assert (clock.outages.seconds, clock.outages.at_end) == (12.0, True)
    now[0] = 103.5
    clock.tell(connected=True, silent_s=13.5)
    now[0] = 110.0
    assert (clock.outages.count, clock.outages.seconds, clock.outages.at_end) == (1, 13.5, False)
    clock.tell(connected=False, silent_s=0.0)
    now[0] = 111.0
    assert (clock.outages.count, clock.outages.seconds, clock.outages.at_end) == (2, 14.5, True)


def test_a_lost_camera_is_on_screen_while_it_lasts_and_in_the_exit_code(tmp_path: Path) -> None:
    frames = list(now_frames(12))
    said: list[str] = []
    items: list[Item] = [*frames[:4], event("lost", False, 10.0), *frames[4:]]
    summary = record(
        LiveScript(items, rate_hz=20),
        tmp_path / "a.mcap",
        on_status=lambda s: said.append(status_text(s)),
    )
    assert re.match(r"camera lost for 1\d s, dropped 0, late ", said[-1])
    assert any(text.startswith("dropped 0, late ") for text in said)
    assert [exit_code(summary, endless=endless) for endless in (True, False)] == [1, 1]
    assert ending_text(summary) == "Error: the camera was lost; the log is complete up to then"
    items = [*frames[:4], event("lost", False, 10.0), event("back", True, 10.5), *frames[4:]]
    summary = record(LiveScript(items), tmp_path / "b.mcap")
    assert exit_code(summary, endless=False) == 0


def test_the_rate_is_that_of_the_last_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    progress = RecordProgress("record", None)
    rates = []
    for i in range(100):
        now[0] += 0.1
        rates.append(progress._rate_hz(3 * min(i, 49)))
    assert rates[40] == pytest.approx(30)
    assert rates[-1] == 0


def test_lost_connections_are_in_the_summary_and_in_the_log(tmp_path: Path) -> None:
    frames = list(now_frames(12))
    items: list[Item] = [
        *frames[:4], event("lost", False, 10.0), *frames[4:5], event("back", True, 12.5),
        *frames[5:10], event("lost again", False, 4.0), *frames[10:],
    ]  # fmt: skip
    path = tmp_path / "log.mcap"
    summary = record(LiveScript(items), path)
    outages = summary.outages
    assert (outages.count, outages.at_end) == (2, True)
    assert 16.5 <= outages.seconds < 30
    line = f"connection lost 2 times, for {outages.seconds:.1f} s in all, and not back at the end"
    assert line in summary_text(summary).splitlines()
    with LogReader(path) as log:
        end = log.metadata["session_end"]
    assert (end["connection_lost"], end["connection_lost_at_end"]) == ("2", "yes")
    assert float(end["connection_lost_s"]) == round(outages.seconds, 1)


def test_a_connection_that_holds_is_not_mentioned(tmp_path: Path) -> None:
    summary = record(LiveScript(now_frames(5)), tmp_path / "log.mcap")
    assert "connection lost" not in summary_text(summary)


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time, to be set."""
    value = [1000.0]
    monkeypatch.setattr(time, "monotonic", lambda: value[0])
    return value


def test_without_a_terminal_faults_of_frames_are_told_once_in_a_while(
    capsys: pytest.CaptureFixture[str], now: list[float]
) -> None:
    with RecordProgress("record", None) as progress:
        for k in range(26):
            told = [f"frame {k} is empty", f"{k + 1} more like this: frame {k} is empty"]
            told += ["connection lost", "connected again after 0.5 s"] if k in (3, 5) else []
            progress.show(k, "all well", told)
            now[0] += 1.0
    lines = capsys.readouterr().err.splitlines()
    assert [line for line in lines if "connect" in line] == [
        "record: connection lost",
        "record: connected again after 0.5 s",
    ] * 2
    for start in ("", "1 more like this: "):
        assert f"record: {start}frame 0 is empty" in lines
    assert len(lines) == 4 + 2 * 3


SLOW = "the disk took {} s to sync: a power loss meanwhile would have cost more"


@pytest.mark.parametrize(
    ("texts", "expected"),
    [
        ([SLOW.format(f"{1 + k / 10:.1f}") for k in range(26)], 3),
        ([f"{k + 2} more like this: {SLOW.format(1.5)}" for k in range(26)], 3),
        ([f"queue full: {k} frames wait" for k in range(26)], 3),
        ([f"connection lost after frame {k}: closed" for k in range(26)], 26),
        ([f"connected again after {k}.5 s" for k in range(26)], 26),
        (["no connection: expected an answer, found none"] * 26, 26),
    ],
)
def test_what_is_said_again_and_again_is_told_once_in_a_while(
    capsys: pytest.CaptureFixture[str], now: list[float], texts: list[str], expected: int
) -> None:
    """Of one kind a line every ten seconds; when a camera was gone, always."""
    with RecordProgress("record", None) as progress:
        for text in texts:
            progress.show(1, "all well", [text])
            now[0] += 1.0
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == expected
    assert lines == [f"record: {text}" for text in texts[:: 10 if expected == 3 else 1]]


def test_in_a_terminal_there_is_a_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = io.StringIO()
    monkeypatch.setattr(screen, "isatty", lambda: True)
    monkeypatch.setattr(sys, "stderr", screen)
    with RecordProgress("record", 10) as progress:
        progress.show(4, "dropped 0", ["connection lost"])
        progress.show(5, "dropped 0", ["connected again after 2.0 s"])
    text = screen.getvalue()
    assert "5/10" in text
    assert "dropped 0" in text
    assert "record: connection lost\n" in text
    assert "record: connected again after 2.0 s\n" in text


def test_without_a_terminal_it_says_now_and_then_that_all_is_well(
    capsys: pytest.CaptureFixture[str], now: list[float]
) -> None:
    with RecordProgress("track", None) as progress:
        for _ in range(130):
            progress.show(round(now[0]), "dropped 0", ())
            now[0] += 1.0
    assert capsys.readouterr().err.splitlines() == [
        "track: 1060 frames, dropped 0",
        "track: 1120 frames, dropped 0",
    ]


def test_a_status_tells_what_was_written_since_the_one_before(tmp_path: Path) -> None:
    """Also two problems at once, and faults of single frames."""
    frames = list(now_frames(30))
    items: list[Item] = [
        *frames[:5], event("lost", False, 1.0), event("odd", False, 1.0),
        replace(frames[5], data=b""), *frames[6:],
    ]  # fmt: skip
    told: list[str] = []
    record(
        LiveScript(items, rate_hz=60),
        tmp_path / "log.mcap",
        on_status=lambda status: told.extend(status.told),
    )
    assert [text for text in told if "late" not in text] == ["lost", "odd", "frame 5 is empty"]
