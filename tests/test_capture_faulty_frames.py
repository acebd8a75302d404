"""Frames that are late, corrupt or misstamped: kept, counted and noted, without a flood."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from recorder.info import log_info
from recorder.log.event_limit import EventLimiter
from recorder.log.frame_checks import FrameChecks
from recorder.log.reader import LogReader
from recorder.log.writer import LogWriter
from recorder.record import record
from recorder.record_text import summary_text
from recorder.recover import recover
from recorder.sources.base import CapturedFrame
from tests.capture_helpers import end_of, events_of
from tests.live_sources import Item, LiveScript
from tests.log_helpers import frame, images


def jpeg_like(index: int, data: bytes) -> CapturedFrame:
    return replace(frame(index), data=data, T_map_camera=None)


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
    # 58 steps of 0.1 s and the late one's 0.3 s more; no time passed at the jump.
    assert summary.duration_s == pytest.approx(6.1)
    assert log_info(path).images.duration_s == pytest.approx(6.1)
    saved = recover(path, tmp_path / "saved.mcap")
    assert saved.duration_s == pytest.approx(6.1)
    assert saved.counts == counts


def test_frames_that_make_up_for_a_pause_are_not_late_nor_those_behind_them() -> None:
    checks = FrameChecks(live=True)
    step_ns = 33_000_000
    arrivals = [i * step_ns for i in range(40)]
    # Thirty frames come at once after a second, then all is as before.
    arrivals += [arrivals[-1] + 31 * step_ns + i * 10**6 for i in range(30)]
    arrivals += [arrivals[39] + (31 + i) * step_ns for i in range(1, 80)]
    late = [i for i, ns in enumerate(arrivals) if checks.add(i, ns, ns).late_ns]
    assert late == [40]


@pytest.mark.parametrize("apart_ns", [10_000, 300_000, 10_000_000, 25_000_000])
@pytest.mark.parametrize("stalled_at", [10, 40, 75, 200])
def test_of_a_long_stall_one_frame_is_late(stalled_at: int, apart_ns: int) -> None:
    """150 frames make up for it."""
    checks = FrameChecks(live=True)
    step_ns = 33_333_333
    arrivals = [i * step_ns for i in range(1000)]
    arrivals[stalled_at] += 150 * step_ns
    for i in range(stalled_at + 1, 1000):
        arrivals[i] = max(arrivals[i], arrivals[i - 1] + apart_ns)
    late = [i for i, ns in enumerate(arrivals) if checks.add(i, ns, ns).late_ns]
    assert late == [stalled_at]


def test_a_camera_that_goes_faster_after_an_outage_is_soon_known_for_it() -> None:
    checks = FrameChecks(live=True)
    arrivals = [i * 10**8 for i in range(100)]
    arrivals += [arrivals[-1] + 10**10 + i * 33_333_333 for i in range(600)]
    # A frame is lost, of those that come faster.
    del arrivals[-40]
    late = [i for i, ns in enumerate(arrivals) if checks.add(i, ns, ns).late_ns]
    assert late == [100, len(arrivals) - 39]


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
