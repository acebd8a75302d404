"""What a replay costs beside OpenCV's own work, and how much memory it takes."""

from __future__ import annotations

import re
import statistics
import subprocess
import sys
import time
from contextlib import suppress
from itertools import islice
from pathlib import Path

import cv2
import pytest

from recorder.files.camera_file import parse_camera
from recorder.files.map_file import parse_map
from recorder.sources.base import CapturedFrame
from recorder.sources.opening import open_source
from tests.bench.long_logs import rendered, write_repeated
from tests.bench.page import report
from tests.bench.plain_loop import plain_loop

pytestmark = pytest.mark.bench

RUNS = 5
FRAMES, TIMES = 60, 10


@pytest.fixture(scope="module")
def drive() -> tuple[dict[str, bytes], list[CapturedFrame]]:
    return rendered("configuration_2", FRAMES)


def run(log: Path, out: Path, *more: str) -> tuple[float, float]:
    """Seconds and peak MB of a whole `arucolog replay`, from start to exit."""
    command = [sys.executable, "-m", "arucolog", "replay", str(log), "-o", str(out), "--force"]
    started = time.perf_counter()
    process = subprocess.Popen(
        [*command, *more], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    # Not `ru_maxrss`: a child begins with its parent's.
    status, peak_kb = Path(f"/proc/{process.pid}/status"), 0
    while process.poll() is None:
        found = re.search(r"VmHWM:\s+(\d+) kB", status.read_text())
        peak_kb = max(peak_kb, int(found.group(1)) if found else 0)
        with suppress(subprocess.TimeoutExpired):
            process.wait(0.05)
    assert process.returncode == 0
    return time.perf_counter() - started, peak_kb / 1024


def test_a_replay_costs_little_beyond_opencv(
    drive: tuple[dict[str, bytes], list[CapturedFrame]], tmp_path: Path
) -> None:
    files, frames = drive
    log = write_repeated(tmp_path / "a.mcap", files, frames, TIMES)
    n = FRAMES * TIMES
    plain, whole, single, viewer = [], [], [], []
    for _ in range(RUNS):
        plain.append(plain_loop(files, frames, TIMES))
        whole.append(run(log, tmp_path / "r", "--no-rrd")[0])
        single.append(run(log, tmp_path / "r", "--no-rrd", "--jobs", "1")[0])
        viewer.append(run(log, tmp_path / "r")[0])
    median = statistics.median(plain)
    rows = [
        ("decode, detect, solve: a plain loop over OpenCV", plain),
        ("`replay --no-rrd`", whole),
        ("`replay --no-rrd --jobs 1`", single),
        ("`replay` with replay.rrd", viewer),
    ]
    text = (
        f"{n} frames of 1920x1080, OpenCV with {cv2.getNumThreads()} threads; the plain loop's "
        "time is without imports, a replay's is the whole command's. Median of "
        f"{RUNS}, taken in turn.\n\n"
        "| | s | frames/s | plain loop / this |\n|---|---|---|---|\n"
    )
    for name, seconds in rows:
        took = statistics.median(seconds)
        text += f"| {name} | {took:.2f} | {n / took:.1f} | {median / took:.2f} |\n"
    report("What a replay costs", text)
    assert median / statistics.median(whole) >= 0.8
    assert median / statistics.median(single) >= 0.8


def test_memory_does_not_grow_with_the_log(tmp_path: Path) -> None:
    """Ten times the log in nearly the same memory; frames of 960x540, so that many can be shown."""
    files, frames = rendered("sample", FRAMES)
    text = "| frames | peak MB with replay.rrd | peak MB with `--no-rrd` |\n|---|---|---|\n"
    peaks: list[tuple[float, float]] = []
    for times in (10, 100):
        log = write_repeated(tmp_path / f"{times}.mcap", files, frames, times)
        both = tuple(run(log, tmp_path / "r", *more)[1] for more in ((), ("--no-rrd",)))
        peaks.append((both[0], both[1]))
        text += f"| {FRAMES * times} | {both[0]:.0f} | {both[1]:.0f} |\n"
    report("Memory of a replay", text)
    assert max(max(row) for row in peaks) < 500
    short, long = peaks
    # 0.5 kB a frame are series that the viewer's file needs at its end.
    assert long[0] - short[0] < 50
    assert long[1] - short[1] < 50


def test_the_simulated_camera_is_fast() -> None:
    """Rendering, noise and JPEG as `record` has them, once the first frame is there."""
    text = "| scene | size | markers in the map | frames/s |\n|---|---|---|---|\n"
    rates = {}
    for scene in ("configuration_1_high", "configuration_1_low", "configuration_2", "hard"):
        source = open_source(scene)
        frames = source.frames()
        next(frames)
        started = time.perf_counter()
        count = sum(1 for _ in islice(frames, 40))
        rates[scene] = count / (time.perf_counter() - started)
        camera = parse_camera(source.attachments["camera.yaml"], Path("camera.yaml"))
        markers = len(parse_map(source.attachments["map.yaml"], Path("map.yaml")).markers)
        size = f"{camera.width_px}x{camera.height_px}"
        text += f"| `{scene}` | {size} | {markers} | {rates[scene]:.1f} |\n"
    report("The simulated camera", text)
    assert rates["configuration_1_high"] >= 10
