"""Viewers beside a recording: one that is slow, fails or hangs costs the log nothing."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path

import pytest

from recorder.record import record
from recorder.sources.base import CapturedFrame
from tests.capture_helpers import end_of, indices_of, told_of
from tests.live_sources import LiveScript, now_frames
from tests.log_helpers import frame
from tests.test_record import ScriptedSource


def test_a_slow_viewer_misses_frames_and_the_log_none(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    shown: list[int] = []

    def show(item: CapturedFrame) -> None:
        shown.append(item.frame_index)
        time.sleep(0.05)

    summary = record(LiveScript(now_frames(100), rate_hz=200), path, sinks=[show])
    assert indices_of(path) == list(range(100))
    assert shown == sorted(shown)
    assert shown[-1] == 99
    assert summary.display_dropped == 100 - len(shown) > 50
    assert end_of(path)["display_dropped"] == str(summary.display_dropped)


def test_a_viewer_that_fails_does_not_end_a_recording(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"

    def fail(item: CapturedFrame) -> None:
        raise RuntimeError("no window")

    record(LiveScript(now_frames(30), rate_hz=100), path, sinks=[fail])
    assert len(indices_of(path)) == 30
    (event,) = told_of(path)
    assert event.message == "a viewer failed and shows nothing any more: no window"


def test_a_viewer_that_would_end_its_thread_does_not_hold_up_a_file(tmp_path: Path) -> None:
    def leave(item: CapturedFrame) -> None:
        raise SystemExit

    record(ScriptedSource([frame(i) for i in range(30)]), tmp_path / "log.mcap", sinks=[leave])
    (event,) = told_of(tmp_path / "log.mcap")
    assert event.message == "a viewer failed and shows nothing any more: SystemExit"


def test_a_viewer_of_a_file_sees_every_frame_and_changes_nothing(tmp_path: Path) -> None:
    frames = [frame(i) for i in range(50)]
    seen: list[CapturedFrame] = []

    def show(item: CapturedFrame) -> None:
        time.sleep(0.002)
        seen.append(item)

    record(ScriptedSource([*frames]), tmp_path / "a.mcap", sinks=[show])
    record(ScriptedSource([*frames]), tmp_path / "b.mcap")
    assert seen == frames
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


def test_a_viewer_that_hangs_does_not_keep_a_file_from_being_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("recorder.capture.recording._STOP_S", 0.2)
    release = threading.Event()

    def hang(item: CapturedFrame) -> None:
        if item.frame_index == 0:
            os.kill(os.getpid(), signal.SIGINT)
        release.wait(20)

    path = tmp_path / "log.mcap"
    started = time.monotonic()
    try:
        summary = record(ScriptedSource([frame(i) for i in range(50)]), path, sinks=[hang])
    finally:
        release.set()
    assert time.monotonic() - started < 10
    assert summary.ended == end_of(path)["ended"] == "interrupted"
    assert indices_of(path) == list(range(summary.frames_written))
