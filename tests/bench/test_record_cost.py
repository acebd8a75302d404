"""What a live recording costs: frames a second, share of a core, memory."""

from __future__ import annotations

import hashlib
import resource
import time
from pathlib import Path

import pytest

from recorder.log.reader import LogReader
from recorder.record import Status, record
from recorder.sources.live.http_mjpeg import http_camera
from tests.bench.page import report
from tests.live_sources import LiveScript, now_frames
from tests.log_helpers import images
from tests.mjpeg_server import MjpegProcess, Script

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


def rss_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


def test_a_minute_of_a_network_camera(tmp_path: Path) -> None:
    """1080p at 30 frames/s over loopback: every frame as it was served, or counted."""
    path = tmp_path / "log.mcap"
    script = Script(rate_hz=30.0, width_px=1920, height_px=1080, frame_bytes=300_000)
    memory_mb: list[float] = []

    def look(status: Status) -> None:
        memory_mb.append(rss_mb())

    with MjpegProcess(script, tmp_path / "served") as server:
        source = http_camera(server.url)
        used_s = time.process_time()
        summary = record(source, path, duration_s=60.0, on_status=look)
        used_s = time.process_time() - used_s
        served = [entry.sha256 for entry in server.served()]
    with LogReader(path) as log:
        found = [hashlib.sha256(image.data).hexdigest() for image in images(log)]
    early_mb, late_mb = max(memory_mb[50:150]), max(memory_mb[-100:])
    report(
        "A minute of a network camera",
        f"1080p at 30 frames/s, 300 kB each, over loopback: {len(found)} frames as they were "
        f"served, {summary.counts.dropped} dropped, **{100 * used_s / summary.duration_s:.1f} % of "
        f"a core** (at most 10), {early_mb:.0f} MB after 15 s, {late_mb:.0f} MB at the end.",
    )
    assert len(found) > 1700
    assert found == served[: len(found)]
    assert summary.counts.dropped == summary.counts.corrupt == 0
    assert used_s < 0.1 * summary.duration_s
    assert late_mb < early_mb + 10


def test_as_fast_as_a_network_camera_can_give(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    script = Script(count=2500, width_px=1920, height_px=1080, frame_bytes=400_000)
    changed: list[tuple[float, int]] = []

    def look(status: Status) -> None:
        written = status.counts.written
        if written and (not changed or written > changed[-1][1]):
            changed.append((time.perf_counter(), written))

    with MjpegProcess(script, tmp_path / "served") as server:
        summary = record(http_camera(server.url), path, duration_s=15.0, on_status=look)
        served = len(server.served())
    counts = summary.counts
    # By the clock, from the first frame seen to the last one written, within a look's tenth.
    seconds = changed[-1][0] - changed[0][0] + 0.1
    rate = counts.written / seconds
    report(
        "As fast as a camera can give",
        f"{served} frames of 400 kB over loopback, as fast as they can be read: {counts.written} "
        f"written and {counts.dropped} dropped in {seconds:.1f} s, **{rate:.0f} a second** written "
        "(at least 500). The server shares the cores and the disk is this machine's.",
    )
    assert counts.written + counts.dropped == served == script.count
    assert rate >= 500
