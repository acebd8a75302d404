"""Recording in threads: what is slow never holds up what must not wait, and nothing goes unsaid."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import BinaryIO

import pytest

from recorder.capture.disk import DiskGuard
from recorder.capture.frame_queue import FrameQueue
from recorder.capture.parts import PartsWriter
from recorder.errors import InputError
from recorder.log import log_file
from recorder.log.event_limit import EventLimiter
from recorder.log.frame_checks import FrameChecks
from recorder.log.log_file import LogFile
from recorder.log.reader import LogEvent, LogReader
from recorder.log.writer import LogWriter
from recorder.record import Notes, Status, record
from recorder.record_text import ending_text, status_text, summary_text
from recorder.sources.base import CapturedFrame, SourceEvent
from recorder.verify.run import verify
from tests.live_sources import Item, LiveScript, now_frames
from tests.log_helpers import frame, images, same_image
from tests.test_log_broken import SmallDisk
from tests.test_record import ScriptedSource


def end_of(path: Path) -> dict[str, str]:
    with LogReader(path) as log:
        return dict(log.metadata["session_end"])


def events_of(path: Path) -> list[LogEvent]:
    with LogReader(path) as log:
        return [r for r in log.records() if isinstance(r, LogEvent)]


def told_of(path: Path) -> list[LogEvent]:
    """Without late frames: this machine may be slow."""
    return [event for event in events_of(path) if " is late: " not in event.message]


def indices_of(path: Path) -> list[int]:
    with LogReader(path) as log:
        return [image.frame_index for image in images(log)]


def jpeg_like(index: int, data: bytes) -> CapturedFrame:
    return replace(frame(index), data=data, T_map_camera=None)


def test_a_full_queue_drops_the_newest_and_says_so() -> None:
    queue = FrameQueue(waits=False, max_frames=3)
    for i in range(7):
        assert queue.put(frame(i))
    assert (queue.frames, queue.lost_frames) == (3, 4)
    first = queue.get(0)
    assert first is not None
    queue.put(frame(7))
    found = [queue.get(0) for _ in range(4)]
    assert [i.frame_index for i in found if isinstance(i, CapturedFrame)] == [1, 2, 7]
    lost = found[2]
    assert isinstance(lost, SourceEvent)
    assert (lost.dropped, lost.timestamp_ns) == (4, frame(6).timestamp_ns)
    assert (queue.frames, queue.bytes, queue.lost_frames) == (0, 0, 0)


def test_the_queue_is_bounded_in_bytes_and_takes_one_frame_of_any_size() -> None:
    queue = FrameQueue(waits=False, max_bytes=10_000)
    queue.put(frame(0, size=50_000))
    queue.put(frame(1))
    assert (queue.frames, queue.lost_frames) == (1, 1)
    queue.get(0)
    for i in range(2, 20):
        queue.put(frame(i))
    assert queue.bytes <= 10_000
    assert queue.frames == 10_000 // len(frame(0).data)


def test_what_is_lost_at_the_end_is_said_too() -> None:
    queue = FrameQueue(waits=False, max_frames=1)
    for i in range(3):
        queue.put(frame(i))
    queue.close()
    assert not queue.put(frame(3))
    queue.get(0)
    said = queue.get(0)
    assert isinstance(said, SourceEvent)
    assert said.dropped == 2
    assert queue.ended


def test_a_flood_of_messages_is_bounded_and_its_losses_are_kept() -> None:
    queue = FrameQueue(waits=False, max_frames=10)
    for _ in range(1000):
        queue.put(SourceEvent(5, "warning", "bad", dropped=1))
    queue.close()
    found = []
    while (item := queue.get(0)) is not None:
        found.append(item)
    assert len(found) == 11
    assert sum(i.dropped for i in found if isinstance(i, SourceEvent)) == 1000


def test_a_source_that_waits_is_held_up_and_loses_nothing() -> None:
    queue = FrameQueue(waits=True, max_frames=2)
    done = threading.Event()

    def fill() -> None:
        for i in range(50):
            queue.put(frame(i))
        queue.close()
        done.set()

    threading.Thread(target=fill, daemon=True).start()
    time.sleep(0.05)
    assert not done.is_set()
    found = []
    while not queue.ended:
        item = queue.get(1)
        assert isinstance(item, CapturedFrame)
        found.append(item.frame_index)
    assert found == list(range(50))


def test_a_live_recording_has_every_frame_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    frames = list(now_frames(100))
    states: list[Status] = []
    summary = record(LiveScript(frames, rate_hz=200), path, on_status=states.append)
    with LogReader(path) as log:
        found = images(log)
        assert all(map(same_image, found, frames))
        assert len(found) == len(frames)
        assert log.metadata["session"]["live"] == "yes"
        assert log.metadata["session"]["queue"] == "300 frames, 64 MiB"
    end = end_of(path)
    assert end["frames_written"] == "100"
    assert end["frames_dropped"] == end["frames_corrupt"] == end["display_dropped"] == "0"
    assert states[-1].counts.written == summary.frames_written == 100
    assert states[-1].free_bytes > 0
    late = summary.counts.late
    assert f"dropped 0, late {late}, corrupt 0, queue 0" in status_text(states[-1])


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


def faulty_frames() -> list[Item]:
    """A camera at 10 frames/s with one of each fault: at 20 late, 30 back, 40 to 44 corrupt."""
    whole = frame(0).data
    step_ns = 100_000_000
    items: list[Item] = []
    for i in range(60):
        late_ns = 3 * step_ns if i >= 20 else 0
        back_ns = 7_200_000_000_000 if i >= 30 else 0
        item = replace(frame(i), T_map_camera=None)
        stamp_ns, arrival_ns = item.timestamp_ns + late_ns - back_ns, item.arrival_ns + late_ns
        items.append(replace(item, timestamp_ns=stamp_ns, arrival_ns=arrival_ns))
    other_size = frame(0).data.replace(b"\0\0\0\x40\0\0\0\x30", b"\0\0\0\x20\0\0\0\x30", 1)
    for i, data in ((40, b""), (41, whole[:-40]), (42, b"\xff\xd8nonsense"), (43, other_size)):
        whole_frame = items[i]
        assert isinstance(whole_frame, CapturedFrame)
        items[i] = replace(whole_frame, data=data)
    return items


def test_late_corrupt_empty_and_misstamped_frames_are_kept_counted_and_noted(
    tmp_path: Path,
) -> None:
    path = tmp_path / "log.mcap"
    items = faulty_frames()
    summary = record(LiveScript(items), path)
    counts = summary.counts
    assert (counts.written, counts.dropped, counts.late) == (60, 0, 1)
    assert (counts.corrupt, counts.stamped_back) == (4, 1)
    assert end_of(path).items() >= counts.as_metadata().items()
    with LogReader(path) as log:
        found = images(log)
    assert [image.data for image in found] == [
        i.data for i in items if isinstance(i, CapturedFrame)
    ]
    assert [event.message for event in events_of(path)] == [
        "frame 20 is late: 0.400 s after the one before",
        "frame 30 is stamped 7199.900000 s before the one before",
        "frame 40 is empty",
        "frame 41 is a png image without its end",
        "frame 42 is not a readable png image",
        "frame 43 is of 32x48, not 64x48",
    ]
    assert "0 dropped, 1 late, 4 corrupt, 1 with a stamp that jumps back" in summary_text(summary)


def test_frames_that_make_up_for_a_pause_are_not_late_nor_those_behind_them() -> None:
    checks = FrameChecks(live=True)
    step_ns = 33_000_000
    arrivals = [i * step_ns for i in range(40)]
    # Thirty frames come at once after a second, then all is as before.
    arrivals += [arrivals[-1] + 31 * step_ns + i * 10**6 for i in range(30)]
    arrivals += [arrivals[39] + (31 + i) * step_ns for i in range(1, 80)]
    late = [i for i, ns in enumerate(arrivals) if checks.add(i, ns, ns).late_ns]
    assert late == [40]


@pytest.mark.parametrize("jitter_ns", [0, -2_000_000, 2_000_000])
def test_a_frame_that_a_driver_drops_without_a_word_is_seen(jitter_ns: int) -> None:
    checks = FrameChecks(live=True)
    arrivals = [i * 33_333_333 for i in range(40) if i != 20]
    arrivals[20] += jitter_ns
    late = [i for i, ns in enumerate(arrivals) if checks.add(i, ns, ns).late_ns]
    assert late == [20]


def test_frames_lost_on_the_way_do_not_make_the_next_one_late() -> None:
    checks = FrameChecks(live=True)
    indices = [*range(20), *range(25, 40)]
    assert not any(checks.add(i, i * 10**8, i * 10**8).late_ns for i in indices)


def test_ten_thousand_corrupt_frames_are_counted_and_do_not_flood(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    items = [jpeg_like(i, b"x") for i in range(10_000)]
    # 10 frames/s: 1000 s of log.
    with LogWriter(path, attachments={}, session={}, live=True) as writer:
        for item in items:
            fast = replace(item, timestamp_ns=item.frame_index * 10**6, arrival_ns=0)
            writer.write_frame(replace(fast, arrival_ns=fast.timestamp_ns))
    events = events_of(path)
    assert end_of(path)["frames_corrupt"] == "10000"
    assert end_of(path)["events"] == str(len(events))
    # Ten seconds with five of a kind and one that counts the others.
    assert len(events) == 60
    more = [int(e.message.split()[0]) for e in events if "more like this" in e.message]
    assert sum(more) + 50 == 10_000


def test_events_of_other_kinds_are_not_held_back() -> None:
    limiter = EventLimiter()
    for i in range(20):
        admitted, said = limiter.admit(i, f"frame {i} is empty")
        assert admitted == (i < 5)
        assert said is None
    assert limiter.admit(21, "the camera is hot") == (True, None)
    assert limiter.admit(2 * 10**9, "frame 99 is empty") == (
        True,
        "15 more like this: frame 19 is empty",
    )
    assert list(limiter.rest()) == []


def test_notes_of_others_go_into_the_log_and_are_never_held_back(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    notes = Notes()

    def mark(item: CapturedFrame) -> None:
        for k in range(10 if item.frame_index == 5 else 0):
            notes.add(f"arrived at {k}", level="warning", timestamp_ns=item.timestamp_ns)

    record(LiveScript(now_frames(20), rate_hz=50, on_frame=mark), path, notes=notes)
    found = told_of(path)
    assert [e.message for e in found] == [f"arrived at {k}" for k in range(10)]
    assert {e.name for e in found} == {"operator"}


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


def test_the_last_problem_is_on_screen_until_frames_come_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lost = SourceEvent(frame(2).timestamp_ns, "error", "connection lost after frame 2: gone")
    frames = [*now_frames(6)]
    states: list[Status] = []
    script: list[Item] = [*frames[:3], SourceEvent(0, "info", "hello"), lost]
    source = LiveScript(script, stays=True)
    monkeypatch.setattr("recorder.capture.log_thread._SHOWN_S", 0.0)
    record(source, tmp_path / "a.mcap", duration_s=0.4, on_status=states.append)
    assert states[-1].problem is not None
    assert states[-1].problem.text == lost.message
    assert status_text(states[-1]).startswith("0 s ago: connection lost after frame 2: gone, drop")
    source = LiveScript([*script, *frames[3:]])
    record(source, tmp_path / "b.mcap", on_status=states.append)
    assert states[-1].problem is None
    assert status_text(states[-1]).startswith("dropped 0")


def test_announced_drops_are_in_the_status_before_the_next_frame(tmp_path: Path) -> None:
    states: list[Status] = []
    script: list[Item] = [*now_frames(2), SourceEvent(0, "warning", "4 are lost", dropped=4)]
    source = LiveScript(script, stays=True)
    summary = record(source, tmp_path / "a.mcap", duration_s=0.3, on_status=states.append)
    assert states[-1].counts.dropped == summary.frames_dropped == 4


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
    assert verify([path], decode=False).count("failed") == 0


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


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    folder = tmp_path / "small"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=12m", "tmpfs", str(folder)]
    try:
        done = subprocess.run(mount, capture_output=True, check=False)
    except OSError:
        pytest.skip("no mount here")
    if done.returncode:
        pytest.skip("no file system can be mounted here")
    try:
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)


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
        return SimpleNamespace(free=12_000_000 - taken)

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
