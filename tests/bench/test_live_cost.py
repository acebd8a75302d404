"""What live tracking and the live view cost: latency, frames a second, memory."""

from __future__ import annotations

import json
import statistics
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import pytest
import yaml

from recorder.log.reader import LogReader
from recorder.simulation.scene_file import shipped_scenes
from recorder.sources.base import CapturedFrame
from replay.stages import cores
from tests.bench.long_logs import rendered
from tests.bench.page import report
from tests.bench.plain_loop import plain_loop
from tests.bench.processes import Sample, watch
from tests.log_helpers import images
from tests.mjpeg_server import Script, Served
from tests.picture_server import PictureProcess
from tests.ports import black_hole

pytestmark = pytest.mark.bench

SMALL, LARGE = (1280, 720), (1920, 1080)
PICTURES = 30
PLAIN_RUNS = 5


@dataclass(frozen=True, eq=False)
class Pictures:
    """A drive's frames, and where they and the files of its log are."""

    frames: list[CapturedFrame]
    files: dict[str, bytes]
    folder: Path

    @property
    def jpegs(self) -> Path:
        return self.folder / "jpegs"

    @property
    def given(self) -> list[str]:
        """Calibration and map as the verbs take them."""
        camera, map_file = self.folder / "camera.yaml", self.folder / "map.yaml"
        return ["--camera", str(camera), "--map", str(map_file)]

    @property
    def kilobytes(self) -> float:
        return statistics.mean(len(frame.data) for frame in self.frames) / 1000


def draw(folder: Path, width_px: int, height_px: int, jpeg_quality: int = 80) -> Pictures:
    """The drive under the ceiling, there and back, by a camera of this resolution."""
    scene: dict[str, Any] = yaml.safe_load(shipped_scenes()["configuration_2"].read_text())
    lens = scene["camera"]
    lens["f_px"] *= width_px / lens["width_px"]
    lens.update(width_px=width_px, height_px=height_px)
    scene["image"]["jpeg_quality"] = jpeg_quality
    pictures = folder / "jpegs"
    pictures.mkdir(parents=True)
    path = folder / "scene.yaml"
    path.write_text(yaml.safe_dump(scene))
    files, frames = rendered(str(path), PICTURES)
    for i, frame in enumerate([*frames, *reversed(frames)]):
        (pictures / f"{i:02}.jpg").write_bytes(frame.data)
    for name in ("camera.yaml", "map.yaml"):
        (folder / name).write_bytes(files[name])
    return Pictures(frames, files, folder)


def arucolog(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "arucolog", *arguments]


def core_share(samples: list[Sample], *, children: bool = False) -> float:
    """Percent of a core between the first and the last of them."""
    first, last = samples[0], samples[-1]
    name = "children_cpu_s" if children else "cpu_s"
    used_s = getattr(last, name) - getattr(first, name)
    return float(100e9 * used_s / (last.time_ns - first.time_ns))


@dataclass(frozen=True)
class TrackCost:
    """One run of `arucolog track`.

    Attributes:
        summary: the result's.
        early_mb: at most, in the first half; `late_mb`: in the last quarter; `finish_mb`: after
            the last frame, while the result is finished.
    """

    served: list[Served]
    summary: dict[str, Any]
    early_mb: float
    late_mb: float
    finish_mb: float
    core_percent: float

    @property
    def tracked(self) -> int:
        return int(self.summary["frames"])

    @property
    def dropped(self) -> int:
        return int(self.summary["frames_dropped"])

    @property
    def seconds(self) -> float:
        """As long as frames came, the last one's interval included."""
        between = (self.served[-1].sent_ns - self.served[0].sent_ns) / 1e9
        return between * len(self.served) / (len(self.served) - 1)


def tracking(pictures: Pictures, folder: Path, rate_hz: float, seconds: float) -> TrackCost:
    """Tracks a network camera, whole command, and looks at what it takes."""
    folder.mkdir()
    log = folder / "log.mcap"
    script = Script(count=round(rate_hz * seconds), rate_hz=rate_hz, stamps=True)
    with PictureProcess(script, folder / "served", pictures.jpegs) as server:
        # Silent for the last two seconds: what was served and what came of it are the same frames.
        limits = ["--duration", f"{seconds + 2}s", "--json"]
        done = watch(arucolog("track", server.url, "-o", str(log), *pictures.given, *limits))
        served = server.served()
    with LogReader(log) as reader:
        summary = json.loads(done.stdout)
        assert len(images(reader)) == summary["frames"]
    log.unlink()
    start_ns, end_ns = served[0].sent_ns, served[-1].sent_ns
    took_ns = end_ns - start_ns
    samples = done.between(start_ns, end_ns)
    early = done.between(start_ns, start_ns + took_ns // 2)
    late = done.between(end_ns - took_ns // 4, end_ns)
    return TrackCost(
        served,
        summary,
        max(sample.rss_mb for sample in early),
        max(sample.rss_mb for sample in late),
        max(sample.rss_mb for sample in done.samples if sample.time_ns > end_ns),
        core_share(samples),
    )


def step_ms(pictures: Pictures) -> float:
    """What OpenCV alone takes for a frame in one thread, its median over some rounds."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        rounds = [plain_loop(pictures.files, pictures.frames, 1) for _ in range(PLAIN_RUNS)]
    finally:
        cv2.setNumThreads(threads)
    return 1e3 * statistics.median(rounds) / len(pictures.frames)


def test_latency_of_tracking_a_network_camera(tmp_path: Path) -> None:
    pictures = {size: draw(tmp_path / f"{size[0]}", *size) for size in (SMALL, LARGE)}
    plain_ms = {size: step_ms(drawn) for size, drawn in pictures.items()}
    runs = ((SMALL, 10, 20), (SMALL, 20, 20), (SMALL, 30, 20), (LARGE, 30, 60), (LARGE, 60, 20))
    text = (
        "| size | frames/s | s | tracked/s | dropped | latency: median | 95 % | largest (ms) "
        "| median / OpenCV's time | of a core | MB: first half | last quarter | finishing |\n"
        f"|{'---|' * 13}\n"
    )
    costs: list[tuple[tuple[int, int], int, TrackCost]] = []
    for k, (size, rate_hz, seconds) in enumerate(runs):
        cost = tracking(pictures[size], tmp_path / str(k), rate_hz, seconds)
        costs.append((size, rate_hz, cost))
        latency = cost.summary["latency_ms"]
        text += (
            f"| {size[0]}x{size[1]} | {rate_hz} | {seconds} | {cost.tracked / cost.seconds:.1f} "
            f"| {cost.dropped} of {len(cost.served)} | {latency['median']:.1f} "
            f"| {latency['p95']:.1f} | {latency['max']:.1f} "
            f"| {latency['median'] / plain_ms[size]:.1f} | {cost.core_percent:.0f} % "
            f"| {cost.early_mb:.0f} | {cost.late_mb:.0f} | {cost.finish_mb:.0f} |\n"
        )
    report(
        "Live tracking",
        "`arucolog track` of a network camera on loopback whose process shares the cores: frames "
        f"of `configuration_2` ({pictures[SMALL].kilobytes:.0f} and "
        f"{pictures[LARGE].kilobytes:.0f} kB) with its "
        "markers, all outputs written. Tracked and dropped are all that were served. The latency "
        "is `latency_ms` of summary.json: from a frame's capture (here the server's X-Timestamp, "
        "just before it is sent) to its track, by the system clock: wire, log, decoding, "
        "detection, pose and filters, but not the tables and the Rerun file. OpenCV alone, in one "
        f"thread, decodes, detects and solves in {plain_ms[SMALL]:.1f} and "
        f"{plain_ms[LARGE]:.1f} ms.\n\n{text}",
    )
    for size, rate_hz, cost in costs:
        latency = cost.summary["latency_ms"]
        assert (latency["from"], latency["clock"][:6]) == ("capture", "server")
        assert cost.tracked + cost.dropped == len(cost.served)
        if size == SMALL:
            assert latency["median"] < 1000 / rate_hz
        # Of what the cores could do with OpenCV alone; the server takes its part of them.
        possible_hz = min(rate_hz, cores() * 1e3 / plain_ms[size])
        assert cost.tracked / cost.seconds > 0.4 * possible_hz
        # A minute of the large ones is 400 MB; neither they nor the Rerun file may be in memory.
        assert cost.late_mb < cost.early_mb + 100
        assert cost.finish_mb < cost.late_mb + 100


def test_a_minute_beside_a_viewer_that_never_reads(tmp_path: Path) -> None:
    pictures = draw(tmp_path / "pictures", *SMALL, jpeg_quality=90)
    log = tmp_path / "log.mcap"
    script = Script(count=1800, rate_hz=30.0, stamps=True)
    with (
        PictureProcess(script, tmp_path / "served", pictures.jpegs) as server,
        black_hole() as port,
    ):
        live = ["--live", f"127.0.0.1:{port}", "--duration", "62s"]
        done = watch(arucolog("record", server.url, "-o", str(log), *pictures.given, *live))
        served = server.served()
    with LogReader(log) as reader:
        found = [image.frame_index for image in images(reader)]
        end = reader.metadata["session_end"]
    start_ns, end_ns = served[0].sent_ns, served[-1].sent_ns
    second = 10**9
    early = done.between(start_ns + 5 * second, start_ns + 20 * second)
    late = done.between(end_ns - 15 * second, end_ns)
    running = done.between(start_ns + 5 * second, end_ns)
    recorder_mb, view_mb = (
        [max(getattr(sample, name) for sample in part) for part in (early, late)]
        for name in ("rss_mb", "child_mb")
    )
    recorder, view = core_share(running), core_share(running, children=True)
    report(
        "A viewer that never reads",
        f"`record --live` for a minute, {len(served)} frames of 1280x720 at 30/s, "
        f"{pictures.kilobytes:.0f} kB each, into a connection that nobody reads: {len(found)} "
        f"written, {end['frames_dropped']} dropped, {end['display_dropped']} not shown. Recorder: "
        f"**{recorder:.1f} % of a core**, {recorder_mb[0]:.0f} MB in the first 20 s, "
        f"{recorder_mb[1]:.0f} MB in the last 15 s. The process that draws, started again whenever "
        f"its viewer takes nothing for ten seconds: {view:.1f} % of a core, {view_mb[0]:.0f} MB "
        f"and {view_mb[1]:.0f} MB.",
    )
    assert found == list(range(len(served)))
    assert (end["frames_written"], end["frames_dropped"]) == (str(script.count), "0")
    # The last one may be on its way.
    assert int(end["display_dropped"]) >= len(served) - 2
    assert recorder_mb[1] < recorder_mb[0] + 10
    assert view_mb[1] < view_mb[0] + 20
    assert recorder < 15
