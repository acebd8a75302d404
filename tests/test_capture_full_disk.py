"""A disk that is full or nearly so: the recording stops in time, and its log is whole."""

from __future__ import annotations

import errno
import os
import threading
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import BinaryIO

import pytest

from recorder.capture.disk import DiskGuard
from recorder.errors import InputError
from recorder.log import log_file
from recorder.log.log_file import LogFile
from recorder.log.reader import LogReader
from recorder.log.writer import LogWriter
from recorder.record import record
from recorder.record_text import ending_text
from recorder.sources.base import CapturedFrame
from tests.capture_helpers import end_of, indices_of
from tests.live_sources import LiveScript, now_frames
from tests.log_helpers import images
from tests.small_disks import mounted
from tests.test_log_broken import SmallDisk


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    with mounted(tmp_path / "small", 12) as folder:
        yield folder


def test_a_recording_stops_before_the_disk_is_full(small_disk: Path) -> None:
    path = small_disk / "log.mcap"
    # 3 MB/s: a megabyte from one look at the disk to the next, and to the stop.
    source = LiveScript(now_frames(size=50_000), rate_hz=60)
    summary = record(source, path, min_free_bytes=5_000_000)
    assert summary.ended == end_of(path)["ended"] == "disk_low"
    assert "nearly full" in (ending_text(summary) or "")
    # Everything that was captured until then is in it.
    found = indices_of(path)
    assert found == list(range(summary.frames_written))
    assert summary.frames_dropped == 0
    free = os.statvfs(small_disk)
    # The reserve for the end of the log, up to 2 MiB, is given back.
    assert 3_000_000 < free.f_bavail * free.f_frsize < 7_500_000
    with pytest.raises(InputError, match=r"expected more than 10\.0 MB of free disk space"):
        record(source, small_disk / "next.mcap", min_free_bytes=10_000_000)
    assert [p.name for p in small_disk.iterdir()] == ["log.mcap"]


def test_a_disk_that_someone_else_fills_ends_a_live_recording_whole(small_disk: Path) -> None:
    path = small_disk / "log.mcap"

    def fill(item: CapturedFrame) -> None:
        if item.frame_index == 50:
            with (small_disk / "other").open("wb", buffering=0) as other:
                try:
                    while True:
                        other.write(bytes(1 << 16))
                except OSError:
                    pass

    source = LiveScript(now_frames(size=20_000), rate_hz=200, on_frame=fill)
    summary = record(source, path)
    assert summary.ended == end_of(path)["ended"] == "disk_full"
    with LogReader(path) as log:
        found = images(log)
        assert log.cut_short is None
    assert [image.frame_index for image in found] == list(range(len(found)))
    assert len(found) == int(end_of(path)["frames_written"]) >= 50
    # One more may have been on its way when nothing was taken any more.
    assert source.given - len(found) - summary.frames_dropped in (0, 1)


@pytest.fixture
def disks(monkeypatch: pytest.MonkeyPatch) -> list[SmallDisk]:
    """Of logs that are recorded: in memory, 3 MB each, their reserve on the same disk."""
    made: list[SmallDisk] = []

    def open_raw(path: Path) -> SmallDisk:
        made.append(SmallDisk(path, 3_000_000))
        return made[-1]

    ensure, release = LogFile.ensure, LogFile.release

    def ensure_there(self: LogFile, size: int) -> None:
        ensure(self, size)
        made[-1].reserved = self._reserved

    def release_there(self: LogFile) -> None:
        release(self)
        made[-1].reserved = 0

    monkeypatch.setattr(LogFile, "ensure", ensure_there)
    monkeypatch.setattr(LogFile, "release", release_there)
    monkeypatch.setattr("recorder.record.LogWriter", partial(LogWriter, open_raw=open_raw))
    return made


def test_a_full_disk_ends_a_live_recording_whole(tmp_path: Path, disks: list[SmallDisk]) -> None:
    """As above, on a disk that needs no one's permission."""
    path = tmp_path / "log.mcap"
    source = LiveScript(now_frames(size=20_000), rate_hz=200)
    summary = record(source, path)
    assert len(disks) == 1
    assert summary.ended == end_of(path)["ended"] == "disk_full"
    with LogReader(path) as log:
        found = images(log)
        assert log.cut_short is None
    assert [image.frame_index for image in found] == list(range(len(found)))
    assert len(found) == int(end_of(path)["frames_written"]) == summary.frames_written > 30
    assert source.given - len(found) - summary.frames_dropped in (0, 1)
    assert path.stat().st_size <= 3_000_000


def test_a_live_recording_stops_when_little_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "log.mcap"

    def usage(folder: Path) -> SimpleNamespace:
        taken = path.stat().st_size if path.exists() else 0
        return SimpleNamespace(total=20_000_000, free=12_000_000 - taken)

    monkeypatch.setattr("recorder.capture.disk.shutil.disk_usage", usage)
    source = LiveScript(now_frames(size=50_000), rate_hz=60)
    summary = record(source, path, min_free_bytes=10_000_000)
    assert summary.ended == end_of(path)["ended"] == "disk_low"
    assert indices_of(path) == list(range(summary.frames_written))
    assert summary.frames_dropped == 0
    # 2 MB, and what came from one look at the disk to the next, and to the stop.
    assert 2_000_000 < path.stat().st_size < 8_000_000
    with pytest.raises(InputError, match=r"expected more than 12\.0 MB of free disk space"):
        record(source, tmp_path / "next.mcap", min_free_bytes=12_000_000)


def test_a_disk_that_does_not_tell_its_size_is_not_low(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    silent = SimpleNamespace(total=0, free=0)
    monkeypatch.setattr("recorder.capture.disk.shutil.disk_usage", lambda folder: silent)
    summary = record(
        LiveScript(now_frames(size=5_000), rate_hz=60), tmp_path / "log.mcap", duration_s=0.2
    )
    assert summary.ended == "complete"


def test_a_recording_whose_source_has_ended_is_complete_on_a_low_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    low = threading.Event()

    def when_all_is_taken(item: CapturedFrame) -> None:
        until = time.monotonic() + 10
        while any(t.name == "source" for t in threading.enumerate()) and time.monotonic() < until:
            time.sleep(0.01)
        low.set()

    monkeypatch.setattr(DiskGuard, "is_low", lambda self, written: low.is_set())
    source = LiveScript(now_frames(3))
    summary = record(source, tmp_path / "log.mcap", on_written=when_all_is_taken)
    assert (summary.ended, summary.frames_written) == ("complete", 3)


def test_a_frame_for_which_there_was_no_reserve_is_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    allocate = log_file._allocate

    def only_once(file: BinaryIO, start: int, size: int) -> None:
        if start:
            raise OSError(errno.ENOSPC, "No space left on device")
        allocate(file, start, size)

    monkeypatch.setattr(log_file, "_allocate", only_once)
    path = tmp_path / "log.mcap"
    source = LiveScript(now_frames(3, size=600_000), rate_hz=10, stays=True)
    summary = record(source, path, duration_s=5)
    assert summary.ended == end_of(path)["ended"] == "disk_full"
    assert indices_of(path) == [0]
    assert (summary.frames_written, summary.frames_dropped) == (1, 1)
    assert end_of(path)["frames_dropped"] == str(summary.frames_dropped)
