"""How a recording ends: in time, by a signal, by an error; its log is whole."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from recorder.capture.parts import PartsWriter
from recorder.errors import InputError
from recorder.record import Status, record
from recorder.record_text import ending_text
from recorder.sources.base import CapturedFrame, SourceEvent
from recorder.verify.run import verify
from tests.capture_helpers import end_of, indices_of
from tests.live_sources import LiveScript, now_frames
from tests.log_helpers import frame
from tests.test_record import ScriptedSource


def test_a_recording_lasts_as_long_as_it_was_told_to(tmp_path: Path) -> None:
    summary = record(
        ScriptedSource([frame(i) for i in range(60)]), tmp_path / "a.mcap", duration_s=2
    )
    assert (summary.ended, summary.frames_written) == ("complete", 20)
    started = time.monotonic()
    live = LiveScript(now_frames(), rate_hz=100)
    summary = record(live, tmp_path / "b.mcap", duration_s=0.5)
    assert 0.5 < time.monotonic() - started < 5.0
    assert summary.ended == "complete"
    assert 20 <= summary.frames_written <= 100
    # Also when nothing comes any more.
    summary = record(LiveScript(now_frames(3), stays=True), tmp_path / "c.mcap", duration_s=0.5)
    assert (summary.ended, summary.frames_written) == ("complete", 3)


def test_a_source_that_does_not_listen_is_left_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("recorder.capture.recording._STOP_S", 0.3)
    release = threading.Event()

    class Deaf(LiveScript):
        def frames(self) -> Iterator[CapturedFrame | SourceEvent]:
            yield from now_frames(5)
            release.wait()

    path = tmp_path / "log.mcap"
    try:
        summary = record(Deaf([]), path, duration_s=0.2)
    finally:
        release.set()
    assert (summary.ended, summary.frames_written) == ("complete", 5)
    assert end_of(path)["ended"] == "complete"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_end_a_live_recording_whole(tmp_path: Path, number: signal.Signals) -> None:
    path = tmp_path / "log.mcap"

    def stop(item: CapturedFrame) -> None:
        if item.frame_index == 30:
            os.kill(os.getpid(), number)

    before = signal.getsignal(number)
    source = LiveScript(now_frames(), rate_hz=200, on_frame=stop)
    summary = record(source, path)
    assert signal.getsignal(number) == before
    assert summary.ended == end_of(path)["ended"] == "interrupted"
    found = indices_of(path)
    # What was captured before is in it.
    assert found == list(range(summary.frames_written))
    assert len(found) >= 30


def test_a_second_interrupt_does_not_cost_the_end_of_the_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    close = PartsWriter.close

    def interrupted(self: PartsWriter) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        close(self)

    monkeypatch.setattr(PartsWriter, "close", interrupted)
    summary = record(LiveScript(now_frames(5)), tmp_path / "log.mcap")
    assert summary.ended == end_of(tmp_path / "log.mcap")["ended"] == "complete"


def test_an_error_of_a_live_source_keeps_what_was_recorded(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    gone = InputError("http://camera", "expected frames, found no server")
    summary = record(LiveScript([*now_frames(10), gone]), path)
    assert (summary.ended, summary.problem) == ("failed", str(gone))
    assert ending_text(summary) == f"Error: {gone}"
    assert len(indices_of(path)) == 10
    assert end_of(path)["ended"] == f"error: {gone}"
    with pytest.raises(InputError, match="no server"):
        record(LiveScript([gone]), tmp_path / "none.mcap")
    assert not (tmp_path / "none.mcap").exists()


def test_a_status_that_cannot_be_shown_leaves_a_whole_log(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    states: list[Status] = []

    def show(status: Status) -> None:
        states.append(status)
        if len(states) == 3:
            raise BrokenPipeError

    source = LiveScript(now_frames(size=20_000), rate_hz=500)
    with pytest.raises(BrokenPipeError):
        record(source, path, on_status=show)
    assert not {"source", "log", "sync"} & {thread.name for thread in threading.enumerate()}
    assert end_of(path)["frames_written"] == str(len(indices_of(path)))
    rules = {v.rule: v.level for v in verify([path], decode=False).rules}
    assert {rules[name] for name in ("checksums", "index", "counts")} == {"ok"}


def test_force_keeps_the_old_log_unless_the_new_one_is_better(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    record(LiveScript(now_frames(3)), path)
    old = path.read_bytes()
    # Nothing in it: the old one stays.
    gone = InputError("camera", "expected frames, found none")
    with pytest.raises(InputError):
        record(LiveScript([gone]), path, force=True)
    assert path.read_bytes() == old
    # Ended by an error: both stay.
    summary = record(LiveScript([*now_frames(4), gone]), path, force=True)
    assert summary.ended == "failed"
    assert path.read_bytes() == old
    assert len(indices_of(tmp_path / "log.mcap.part")) == 4
    # Ended by its operator: it takes the place of the old one, and touches no unfinished one.
    summary = record(LiveScript([*now_frames(5), KeyboardInterrupt()]), path, force=True)
    assert summary.ended == "interrupted"
    assert len(indices_of(path)) == 5
    assert len(indices_of(tmp_path / "log.mcap.part")) == 4
    assert sorted(p.name for p in tmp_path.iterdir()) == ["log.mcap", "log.mcap.part"]


def test_a_log_that_is_being_recorded_is_not_replaced(tmp_path: Path) -> None:
    pytest.importorskip("fcntl")
    path = tmp_path / "log.mcap"
    refused: list[str] = []

    def intrude(item: CapturedFrame) -> None:
        if item.frame_index == 5:
            try:
                record(LiveScript(now_frames(3)), path, force=True)
            except InputError as error:
                refused.append(str(error))

    summary = record(LiveScript(now_frames(20), rate_hz=50, on_frame=intrude), path)
    assert (summary.ended, summary.counts.written) == ("complete", 20)
    text = "expected a log to replace, found one that is being recorded"
    assert refused == [f"{path}: {text}"]
    # Nobody writes it any more.
    assert record(LiveScript(now_frames(3)), path, force=True).counts.written == 3
