"""Damage inside images is found while they are recorded, and leaves the camera in peace."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from recorder.capture import inspection
from recorder.capture.inspection import InspectionThread
from recorder.log.reader import LogReader
from recorder.log.records import LogEvent
from recorder.record import record
from recorder.verify.run import verify
from tests.live_sources import LiveScript, now_frames

RNG = np.random.default_rng(4)
PIXELS = cv2.GaussianBlur(RNG.integers(0, 256, (240, 320), np.uint8), (5, 5), 0)
WHOLE = cv2.imencode(".jpg", PIXELS)[1].tobytes()
BROKEN = WHOLE[: len(WHOLE) // 2] + WHOLE[len(WHOLE) // 2 + 300 :]


class Camera(LiveScript):
    """JPEGs of which some are damaged inside."""

    image_size = (320, 240)

    def __init__(self, count: int, damaged: tuple[int, ...], rate_hz: float | None) -> None:
        data = [BROKEN if i in damaged else WHOLE for i in range(count)]
        frames = [
            replace(f, data=data[f.frame_index], format="jpeg", T_map_camera=None)
            for f in now_frames(count)
        ]
        super().__init__(frames, rate_hz=rate_hz)


@pytest.fixture
def all_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """It looks into every frame, also where the machine is busy."""
    monkeypatch.setattr(inspection, "_SHARE", 1.0)
    monkeypatch.setattr(inspection, "_WAITING", 100)


@pytest.mark.usefixtures("all_the_time")
def test_damage_is_counted_told_and_in_the_log(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    summary = record(Camera(40, (7, 8, 39), rate_hz=50), path)
    assert (summary.counts.written, summary.counts.corrupt) == (40, 3)
    assert summary.counts.inspected == 40
    with LogReader(path) as log:
        told = [r.message for r in log.records() if isinstance(r, LogEvent)]
        end = log.metadata["session_end"]
    for number in (7, 8, 39):
        assert f"frame {number} is a damaged jpeg image" in told
    assert (end["frames_corrupt"], end["frames_inspected"]) == ("3", "40")
    rules = {verdict.rule: verdict for verdict in verify([path]).rules}
    assert rules["counts"].level == "ok"
    assert rules["images"].text.startswith("3 frames corrupt")


@pytest.mark.usefixtures("all_the_time")
def test_the_parts_of_a_recording_say_together_what_was_found(tmp_path: Path) -> None:
    from recorder.capture.parts import SplitLimit

    camera = Camera(40, (5, 30), rate_hz=50)
    summary = record(camera, tmp_path / "log.mcap", split=SplitLimit(seconds=0.3))
    assert len(summary.parts) >= 2
    assert (summary.counts.corrupt, summary.counts.inspected) == (2, 40)
    ends = []
    for part in summary.parts:
        with LogReader(part) as log:
            ends.append(log.metadata["session_end"])
    assert sum(int(end["frames_corrupt"]) for end in ends) == 2
    assert sum(int(end["frames_inspected"]) for end in ends) == 40


def test_a_flood_is_not_held_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where there is no time to look into all, some are, and that it was some is said."""

    def slow(data: bytes, format: str) -> None:
        until_s = time.thread_time() + 0.005
        while time.thread_time() < until_s:
            pass

    monkeypatch.setattr(inspection, "flaw", slow)
    source = Camera(200, (), rate_hz=100)
    summary = record(source, tmp_path / "log.mcap")
    assert (summary.counts.written, summary.counts.dropped) == (200, 0)
    # 5 ms and the rest, 160 ms: in 2 s some 12, and at the end those that wait.
    assert 5 <= summary.counts.inspected <= 70
    assert source.held_up_s < 0.5


def test_that_nobody_looks_any_more_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(data: bytes, format: str) -> None:
        raise MemoryError("out of memory")

    monkeypatch.setattr(inspection, "flaw", fail)
    summary = record(Camera(20, (), rate_hz=50), tmp_path / "log.mcap")
    assert (summary.counts.written, summary.counts.inspected) == (20, 0)
    with LogReader(tmp_path / "log.mcap") as log:
        told = [r.message for r in log.records() if isinstance(r, LogEvent)]
    assert told.count("images are not looked into any more: out of memory") == 1


def test_a_file_is_not_inspected(tmp_path: Path) -> None:
    """It can be read again, and its log is always the same."""

    class File(Camera):
        stop = None  # type: ignore[assignment]

    summary = record(File(10, (3,), rate_hz=None), tmp_path / "log.mcap")
    assert (summary.counts.corrupt, summary.counts.inspected) == (0, 0)


def test_it_rests_as_long_as_its_share_says(monkeypatch: pytest.MonkeyPatch) -> None:
    looked: list[float] = []

    def flaw(data: bytes, format: str) -> None:
        looked.append(time.monotonic())
        until_s = time.thread_time() + 0.004
        while time.thread_time() < until_s:
            pass

    monkeypatch.setattr(inspection, "flaw", flaw)
    thread = InspectionThread()
    thread.start()
    for item in Camera(4, (), rate_hz=None).frames():
        thread.offer(item)  # type: ignore[arg-type]
    until_s = time.monotonic() + 10
    while len(looked) < 3 and time.monotonic() < until_s:
        time.sleep(0.01)
    thread.close()
    pauses = np.diff(looked)
    assert len(list(thread.take())) == 4
    assert pauses[0] >= 0.09
    assert pauses[1] >= 0.09
