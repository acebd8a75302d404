"""A live recording: every frame as it was, and what is said while it runs."""

from __future__ import annotations

from pathlib import Path

from recorder.log.reader import LogReader
from recorder.record import Notes, Status, record
from recorder.record_text import status_text
from recorder.sources.base import CapturedFrame, SourceEvent
from tests.capture_helpers import end_of, told_of
from tests.live_sources import Item, LiveScript, now_frames
from tests.log_helpers import images, same_image


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
    assert f"dropped 0, late {late}, corrupt 0, " in status_text(states[-1])


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


def test_announced_drops_are_in_the_status_before_the_next_frame(tmp_path: Path) -> None:
    states: list[Status] = []
    script: list[Item] = [*now_frames(2), SourceEvent(0, "warning", "4 are lost", dropped=4)]
    source = LiveScript(script, stays=True)
    summary = record(source, tmp_path / "a.mcap", duration_s=0.3, on_status=states.append)
    assert states[-1].counts.dropped == summary.frames_dropped == 4
