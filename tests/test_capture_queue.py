"""The queue between a source and its log: bounded, and what it loses is said."""

from __future__ import annotations

import threading
import time

from recorder.capture.frame_queue import FrameQueue
from recorder.sources.base import CapturedFrame, SourceEvent
from tests.log_helpers import frame


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
