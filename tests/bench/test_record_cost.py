"""What a live recording costs: frames a second, share of a core, memory."""

from __future__ import annotations

import resource
import time
from pathlib import Path

import pytest

from recorder.record import record
from tests.live_sources import LiveScript, now_frames

pytestmark = pytest.mark.bench


def measure(path: Path, frames: int, rate_hz: float, size: int) -> tuple[int, int, float, float]:
    """Frames written and dropped, seconds, seconds of the processor."""
    source = LiveScript(now_frames(frames, size=size), rate_hz=rate_hz)
    started, used = time.perf_counter(), time.process_time()
    summary = record(source, path)
    wall_s, cpu_s = time.perf_counter() - started, time.process_time() - used
    path.unlink()
    counts = summary.counts
    print(
        f"\n{rate_hz:.0f} frames/s of {size / 1000:.0f} kB: {counts.written / wall_s:.0f} a second "
        f"written, {counts.dropped} dropped, {100 * cpu_s / wall_s:.1f} % of a core, "
        f"{1e6 * cpu_s / counts.written:.0f} µs a frame, {max_rss_mb():.0f} MB"
    )
    return counts.written, counts.dropped, wall_s, cpu_s


def max_rss_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def test_five_hundred_large_frames_a_second(tmp_path: Path) -> None:
    written, _, wall_s, _ = measure(tmp_path / "log.mcap", 3000, 550.0, 400_000)
    assert written / wall_s >= 500


def test_thirty_frames_a_second_take_a_tenth_of_a_core(tmp_path: Path) -> None:
    written, dropped, wall_s, cpu_s = measure(tmp_path / "log.mcap", 600, 30.0, 300_000)
    assert (written, dropped) == (600, 0)
    assert cpu_s < 0.1 * wall_s


def test_memory_is_flat(tmp_path: Path) -> None:
    measure(tmp_path / "log.mcap", 500, 400.0, 200_000)
    before_mb = max_rss_mb()
    measure(tmp_path / "log.mcap", 3000, 400.0, 200_000)
    # The queue alone may hold 64 MiB.
    assert max_rss_mb() - before_mb < 70
