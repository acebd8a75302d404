"""A disk that is slow or fails, a log that is taken away while it is recorded."""

from __future__ import annotations

import errno
import time
from functools import partial
from pathlib import Path

import pytest

from recorder.capture.frame_queue import FrameQueue
from recorder.errors import InputError
from recorder.log.log_file import LogFile
from recorder.log.reader import LogReader
from recorder.log.writer import LogWriter
from recorder.record import record
from recorder.record_text import ending_text
from recorder.sources.base import CapturedFrame
from tests.capture_helpers import end_of, events_of, indices_of, told_of
from tests.live_sources import LiveScript, now_frames
from tests.log_helpers import frame, images
from tests.test_record import ScriptedSource


def test_a_slow_disk_costs_frames_that_are_counted_and_never_holds_up_the_camera(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = LogFile.write

    def slowly(self: LogFile, data: bytes) -> int:
        if len(data) > 100_000:
            time.sleep(0.4)
        return write(self, data)

    monkeypatch.setattr(LogFile, "write", slowly)
    small = partial(FrameQueue, max_frames=20)
    monkeypatch.setattr("recorder.capture.recording.FrameQueue", small)
    path = tmp_path / "log.mcap"
    source = LiveScript(now_frames(400, size=100_000), rate_hz=250)
    summary = record(source, path)
    assert source.held_up_s < 0.3
    written, dropped = summary.frames_written, summary.frames_dropped
    assert dropped > 100
    assert written + dropped == source.given == 400
    end = end_of(path)
    assert (end["frames_written"], end["frames_dropped"]) == (str(written), str(dropped))
    found = indices_of(path)
    assert len(found) == written
    assert found == sorted(found)
    texts = [event.message for event in events_of(path)]
    assert any("frames dropped: they came faster than they could be written" in t for t in texts)


class FailingFile:
    """A file whose writes fail from some byte on."""

    def __init__(self, path: Path, good_bytes: int) -> None:
        self._file = path.open("xb", buffering=0)
        self._good = good_bytes

    def write(self, data: memoryview, /) -> int | None:
        if self._file.tell() + len(data) > self._good:
            self._file.write(data[: len(data) // 2])
            raise OSError(errno.EIO, "Input/output error")
        return self._file.write(data)

    def truncate(self, size: int, /) -> int:
        return self._file.truncate(size)

    def fileno(self) -> int:
        return self._file.fileno()

    def close(self) -> None:
        self._file.close()


def test_a_write_error_ends_the_recording_and_leaves_whole_chunks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    failing = partial(LogWriter, open_raw=lambda path: FailingFile(path, 2_500_000))
    monkeypatch.setattr("recorder.record.LogWriter", failing)
    path = tmp_path / "log.mcap"
    source = LiveScript(now_frames(100, size=50_000), rate_hz=500)
    summary = record(source, path)
    assert summary.ended == "failed"
    assert "found: input/output error" in (ending_text(summary) or "")
    with LogReader(path) as log:
        found = images(log)
        assert log.cut_short is not None
    # Two chunks of 1 MiB were written, the third failed.
    assert [image.frame_index for image in found] == list(range(len(found)))
    assert 40 <= len(found) <= 50
    # The summary counts what is there; one more may have been on its way.
    assert summary.frames_written == len(found)
    assert source.given - summary.frames_written - summary.frames_dropped in (0, 1)


def test_a_sync_error_ends_the_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(number: int) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr("recorder.log.log_file.fdatasync", fail)
    summary = record(LiveScript(now_frames(), rate_hz=100), tmp_path / "log.mcap")
    assert summary.ended == "failed"
    assert "input/output error" in (summary.problem or "")
    assert summary.frames_written > 50


def test_whatever_a_sync_raises_ends_the_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(number: int) -> None:
        raise ValueError("no such file")

    monkeypatch.setattr("recorder.log.log_file.fdatasync", fail)
    path = tmp_path / "log.mcap"
    # Its last sync fails as well, and the log has its end by then.
    with pytest.raises(ValueError, match="no such file"):
        record(LiveScript(now_frames(), rate_hz=100), path, duration_s=20)
    assert 20 < len(indices_of(path)) < 1000


def test_a_sync_that_takes_over_a_second_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("recorder.capture.disk._SLOW_S", 0.1)
    monkeypatch.setattr("recorder.log.log_file.fdatasync", lambda number: time.sleep(0.2))
    path = tmp_path / "log.mcap"
    record(LiveScript(now_frames(3), stays=True), path, duration_s=1.5)
    texts = [event.message for event in told_of(path)]
    assert texts
    assert all(text.startswith("the disk took 0.") for text in texts)


def test_what_took_the_place_of_a_log_is_not_removed(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with LogWriter(path, attachments={}, session={}) as writer:
        writer.write_frame(frame(0))
        path.rename(tmp_path / "moved.mcap")
        path.write_text("somebody else's")
        writer.discard()
    assert path.read_text() == "somebody else's"


def test_a_log_made_read_only_is_finished(tmp_path: Path) -> None:
    """Permissions are looked at when a file is opened; what is open stays writable."""
    path = tmp_path / "log.mcap"

    def protect(item: CapturedFrame) -> None:
        if item.frame_index == 20:
            path.chmod(0o444)

    summary = record(LiveScript(now_frames(60), rate_hz=200, on_frame=protect), path)
    assert summary.ended == "complete"
    assert indices_of(path) == list(range(60))


@pytest.mark.parametrize("live", [True, False])
def test_a_log_that_is_removed_while_recording_is_said_at_once(tmp_path: Path, live: bool) -> None:
    path = tmp_path / "log.mcap"
    removed = 0.0

    def remove(item: CapturedFrame) -> None:
        nonlocal removed
        if item.frame_index == 20:
            path.unlink()
            removed = time.monotonic()

    source = LiveScript(now_frames(), rate_hz=100, on_frame=remove)
    if live:
        summary = record(source, path)
        assert summary.ended == "failed"
        assert "removed or replaced" in (ending_text(summary) or "")
    else:
        waiting = ScriptedSource([])
        waiting.frames = source.frames  # type: ignore[method-assign]
        with pytest.raises(InputError, match="removed or replaced"):
            record(waiting, path)
    assert time.monotonic() - removed < 3.0
    assert list(tmp_path.iterdir()) == []
