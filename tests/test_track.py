"""Live tracking: what is tracked is what is recorded, and a replay says the same."""

from __future__ import annotations

import itertools
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest
from click.testing import CliRunner

from pipeline.detection import Detections
from pipeline.localizer import FrameResult, PipelineSettings
from recorder.errors import InputError
from recorder.log.reader import LogReader
from recorder.log.records import LogEvent
from recorder.record import record
from recorder.sources.base import CapturedFrame, Source, SourceEvent
from recorder.sources.images import ImagesSource
from recorder.sources.opening import open_source
from recorder.verify.run import verify
from replay.live.gate import Admission, gated
from replay.live.latency import Latencies, Latency
from replay.live.track import Tracked, TrackOptions, TrackStatus, track
from replay.live.track_text import latency_text, situation_text, status_text
from replay.result import open_result
from replay.result_run import ResultRun
from replay.run import ReplayOptions, replay
from replay.stages import DetectorPool
from replay.track_cli import track as track_verb
from tests import worlds
from tests.live_sources import LiveScript, now_frames
from tests.log_helpers import frame, images
from tests.mjpeg_server import Script
from tests.picture_server import ATTACHMENTS, PictureServer, pictures
from tests.ports import nobody
from tests.rrd_files import entities
from tests.terminals import Terminal

ROOT = Path(__file__).resolve().parents[1]
TABLES = ("detections", "poses", "tracks", "truth")
OPTIONS = TrackOptions(jobs=2)


class Camera(LiveScript):
    """The pictures at a rate, captured when they are taken."""

    image_size = (1280, 720)
    attachments = ATTACHMENTS

    def __init__(self, count: int | None, rate_hz: float = 30.0, **more: Any) -> None:
        super().__init__(self._now(count), rate_hz=rate_hz, **more)

    @staticmethod
    def _now(count: int | None) -> Iterator[CapturedFrame]:
        for source in now_frames(count):
            yield CapturedFrame(
                source.frame_index,
                source.timestamp_ns,
                source.arrival_ns,
                pictures()[source.frame_index % 40],
                "jpeg",
            )


def tracked(
    source: Source, tmp_path: Path, options: TrackOptions = OPTIONS, **more: Any
) -> Tracked:
    return track(source, tmp_path / "log.mcap", tmp_path / "live", "live", options, **more)


def assert_replays_the_same(tmp_path: Path) -> dict[str, Any]:
    """The log's replay leaves the same files and tables; returns its summary."""
    live, again = tmp_path / "live", tmp_path / "again"
    summary = replay(tmp_path / "log.mcap", again, "live", ReplayOptions(progress=False))
    assert {p.name for p in live.iterdir()} == {p.name for p in again.iterdir()}
    for name in TABLES:
        table = live / f"{name}.parquet"
        if table.exists():
            assert table.read_bytes() == (again / table.name).read_bytes(), name
    for name in ("settings.yaml", "camera.yaml", "map.yaml"):
        assert (live / name).read_bytes() == (again / name).read_bytes()
    said = open_result(live).summary
    for key in ("log", "log_sha256", "inputs", "frames", "start_ns", "end_ns", "status", "errors"):
        assert said[key] == summary[key], key
    return summary


def events_of(path: Path) -> list[str]:
    with LogReader(path) as log:
        return [r.message for r in log.records() if isinstance(r, LogEvent)]


def test_what_a_camera_gives_is_tracked_as_a_replay_would(tmp_path: Path) -> None:
    states: list[TrackStatus] = []
    with PictureServer(Script(rate_hz=20, stamps=True)) as server:
        options = TrackOptions(jobs=2, duration_s=2.0)
        done = tracked(
            open_source(server.url),
            tmp_path,
            options,
            attachments=ATTACHMENTS,
            on_status=states.append,
        )
    assert done.summary is not None
    assert done.recorded.ended == "complete"
    assert done.summary["frames"] == done.recorded.frames_written >= 30
    assert_replays_the_same(tmp_path)
    latency = done.summary["latency_ms"]
    assert 1.0 < latency["median"] <= latency["p95"] <= latency["max"] < 2000.0
    assert (latency["from"], latency["clock"]) == ("capture", "server (X-Timestamp of each part)")
    assert "latency from capture to track, ms: median" in latency_text(latency)
    assert re.fullmatch(
        r"dropped 0, late \d+, corrupt 0, latency \d+/\d+/\d+ ms", status_text(states[-1])
    )
    assert re.fullmatch(
        r"ok, 1\d markers, x -?\d\.\d{3} y -?\d\.\d{3} m, yaw -?\d+\.\d°",
        situation_text(states[-1].situation),
    )
    # The first tracker's position, and the pose's heading.
    result = open_result(tmp_path / "live")
    track_rows = result.table("tracks").query("tracker == 'adaptive'").reset_index(drop=True)
    here = states[-1].situation
    (row,) = np.flatnonzero(track_rows["x_m"] == here.x_m)
    assert row >= len(track_rows) - 5
    assert (track_rows["y_m"][row], result.table("poses")["yaw_rad"][row]) == (
        here.y_m,
        here.yaw_rad,
    )


def test_of_a_file_nothing_is_dropped_and_the_log_is_that_of_record(tmp_path: Path) -> None:
    folder = tmp_path / "images"
    folder.mkdir()
    for i in range(30):
        (folder / f"{i}.jpg").write_bytes(pictures()[i] if i != 7 else pictures()[i][:-3000])
    done = tracked(ImagesSource(folder), tmp_path, attachments=ATTACHMENTS)
    record(ImagesSource(folder), tmp_path / "recorded.mcap", attachments=ATTACHMENTS)
    assert (tmp_path / "recorded.mcap").read_bytes() == (tmp_path / "log.mcap").read_bytes()
    assert done.summary is not None
    assert (done.summary["frames"], done.summary["frames_dropped"]) == (30, 0)
    assert done.summary["latency_ms"]["from"] == "hand-over"
    assert_replays_the_same(tmp_path)


def test_exact_and_measured_truth_are_a_replays_to_the_last_bit(tmp_path: Path) -> None:
    files = {**ATTACHMENTS, "truth.yaml": worlds.TRUTH_YAML}

    class Drive(ImagesSource):
        def __init__(self) -> None:
            self.name = "drive"

        image_size = (1280, 720)

        def frames(self) -> Iterator[CapturedFrame]:
            for i, pose in enumerate(worlds.drive(20)):
                stamp = worlds.START_NS + i * worlds.FRAME_NS
                yield CapturedFrame(i, stamp, stamp, pictures()[i], "jpeg", pose)

        def describe(self) -> dict[str, str]:
            return {}

        attachments = files

        def frame_count(self) -> int:
            return 20

    tracked(Drive(), tmp_path)
    summary = assert_replays_the_same(tmp_path)
    assert summary["errors"]["exact"]["fixes"]["n"] == 20
    assert summary["errors"]["measured"]["fixes"]["n"] == 1


def test_what_the_pipeline_is_too_slow_for_is_in_neither_and_is_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    detect = DetectorPool._detect

    def slowly(self: DetectorPool, data: bytes) -> Detections | None:
        time.sleep(0.1)
        return detect(self, data)

    monkeypatch.setattr(DetectorPool, "_detect", slowly)
    source = Camera(90, rate_hz=60.0)
    done = tracked(source, tmp_path)
    assert source.held_up_s < 0.1
    counts = done.recorded.counts
    assert counts.dropped > 30
    assert counts.written + counts.dropped == 90
    monkeypatch.undo()
    assert_replays_the_same(tmp_path)
    assert done.summary is not None
    assert done.summary["frames_dropped"] == counts.dropped
    # As many wait as can be at work soon: what is tracked is not old.
    assert done.summary["latency_ms"]["median"] < 900.0
    told = [text for text in events_of(tmp_path / "log.mcap") if "too slow" in text]
    assert "dropped: the pipeline is too slow for it" in told[0]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_leaves_log_and_result_whole(tmp_path: Path, number: signal.Signals) -> None:
    def stop(item: CapturedFrame, result: FrameResult) -> None:
        if item.frame_index == 20:
            os.kill(os.getpid(), number)

    done = tracked(Camera(None), tmp_path, on_result=stop)
    assert done.recorded.ended == "interrupted"
    assert done.summary is not None
    assert done.summary["frames"] >= 20
    assert_replays_the_same(tmp_path)


def test_a_killed_run_leaves_a_log_that_replays(tmp_path: Path) -> None:
    for name, data in ATTACHMENTS.items():
        (tmp_path / name).write_bytes(data)
    log = tmp_path / "log.mcap"
    with PictureServer(Script(rate_hz=20)) as server:
        command = [sys.executable, "-m", "arucolog", "track", server.url, "-o", str(log)]
        files = ["--camera", str(tmp_path / "camera.yaml"), "--map", str(tmp_path / "map.yaml")]
        process = subprocess.Popen([*command, *files], cwd=ROOT, stderr=subprocess.DEVNULL)
        until = time.monotonic() + 30
        while not (log.exists() and log.stat().st_size > 2_000_000):
            assert time.monotonic() < until
            assert process.poll() is None
            time.sleep(0.05)
        process.kill()
        process.wait()
    summary = replay(log, tmp_path / "again", "again", ReplayOptions(progress=False))
    assert summary["frames"] > 20
    assert summary["status"] == {"ok": summary["frames"]}
    assert "cut short" in summary["log_cut_short"]


def test_without_calibration_or_map_nothing_begins(tmp_path: Path) -> None:
    source = LiveScript([frame(0)])
    with pytest.raises(InputError, match="expected a calibration, found none; give one with"):
        tracked(source, tmp_path)
    given = {"camera.yaml": ATTACHMENTS["camera.yaml"]}
    with pytest.raises(InputError, match="expected a marker map, found none; give one with"):
        tracked(source, tmp_path, attachments=given)
    assert list(tmp_path.iterdir()) == []


def test_a_camera_that_fails_leaves_its_log_and_no_result(tmp_path: Path) -> None:
    source = Camera(10)
    gone = InputError("camera", "expected frames, found none")
    source._items = [*Camera._now(10), gone]
    done = tracked(source, tmp_path)
    assert (done.recorded.ended, done.summary) == ("failed", None)
    assert [p.name for p in tmp_path.iterdir()] == ["log.mcap"]
    with LogReader(tmp_path / "log.mcap") as log:
        assert len(images(log)) == 10


@pytest.fixture
def full_at_frame_5(monkeypatch: pytest.MonkeyPatch) -> None:
    """There is no space for the result's sixth frame."""
    keep = ResultRun.keep

    def fail(self: ResultRun, item: Any, result: FrameResult) -> None:
        if result.frame_index == 5:
            raise OSError(28, "No space left on device")
        keep(self, item, result)

    monkeypatch.setattr(ResultRun, "keep", fail)


@pytest.mark.usefixtures("full_at_frame_5")
def test_a_recording_goes_on_when_tracking_fails(tmp_path: Path) -> None:
    states: list[TrackStatus] = []
    camera = Camera(120, rate_hz=60)
    done = tracked(camera, tmp_path, on_status=states.append)
    assert (done.recorded.ended, done.summary) == ("complete", None)
    assert done.problem is not None
    assert "No space left" in done.problem
    assert [p.name for p in tmp_path.iterdir()] == ["log.mcap"]
    with LogReader(tmp_path / "log.mcap") as log:
        found = images(log)
    assert len(found) + done.recorded.counts.dropped == 120
    assert [image.frame_index for image in found][-60:] == list(range(60, 120))
    told = "tracking failed, recording goes on: [Errno 28] No space left on device"
    assert [text for text in events_of(tmp_path / "log.mcap") if "tracking" in text] == [told]
    assert states[-1].situation.status == "tracking failed"
    rules = {verdict.rule: verdict.level for verdict in verify([tmp_path / "log.mcap"]).rules}
    assert rules["end"] == rules["counts"] == "ok"


def test_a_recording_goes_on_when_no_thread_can_be_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    submit, taken = DetectorPool.submit, itertools.count()

    def fail(self: DetectorPool, data: bytes) -> Any:
        if next(taken) == 10:
            raise RuntimeError("can't start new thread")
        return submit(self, data)

    monkeypatch.setattr(DetectorPool, "submit", fail)
    with pytest.raises(RuntimeError, match="can't start new thread"):
        tracked(Camera(60, rate_hz=60), tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["log.mcap"]
    with LogReader(tmp_path / "log.mcap") as log:
        assert images(log)[-1].frame_index == 59
        assert log.metadata["session_end"]["ended"] == "complete"


@pytest.mark.usefixtures("full_at_frame_5")
def test_of_a_file_that_cannot_be_tracked_nothing_is_left(tmp_path: Path) -> None:
    """It can be read again."""

    class File(Camera):
        stop = None  # type: ignore[assignment]

    with pytest.raises(InputError, match=r"expected to track its frames, found:.* No space left"):
        tracked(File(300, rate_hz=1000), tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("full_at_frame_5")
def test_the_verb_says_that_tracking_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    camera = Camera(30, rate_hz=60)
    monkeypatch.setattr("recorder.sources.opening.open_source", lambda *_: camera)
    log = tmp_path / "log.mcap"
    verb: click.Command = track_verb()
    done = CliRunner().invoke(verb, ["/dev/none", "-o", str(log)])
    assert done.exit_code == 1
    assert f"{log}: " in done.stdout
    assert "Error: tracking failed: " in done.stderr
    assert ": could not be written: No space left on device" in done.stderr
    assert f"No result; `arucolog replay {log}` makes it." in done.stderr


def test_what_is_slow_the_first_time_hits_no_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[int] = []
    advance = ResultRun.localize

    def note(self: ResultRun, item: Any) -> FrameResult:
        seen.append(item.image.timestamp_ns)
        return advance(self, item)

    monkeypatch.setattr(ResultRun, "localize", note)
    done = tracked(Camera(5), tmp_path)
    assert seen[0] == 0
    assert len(seen) == 6
    assert done.summary is not None
    assert done.summary["frames"] == 5


def test_the_rerun_file_is_that_of_a_replay(tmp_path: Path) -> None:
    source = Camera(12)
    frames = [*Camera._now(12)]
    hot = SourceEvent(frames[5].timestamp_ns, "warning", "the camera is hot")
    source._items = [*frames[:6], hot, *frames[6:]]
    tracked(source, tmp_path)
    assert_replays_the_same(tmp_path)
    live, again = (tmp_path / name / "replay.rrd" for name in ("live", "again"))
    assert entities(live) == entities(again)
    assert "/events" in entities(live)
    assert sorted(p.name for p in (tmp_path / "live").glob("*.rrd")) == ["replay.rrd"]
    no = tmp_path / "no"
    no.mkdir()
    tracked(Camera(3), no, TrackOptions(rrd=False))
    assert not (no / "live" / "replay.rrd").exists()


def test_the_gate_is_bounded_in_frames_and_bytes_and_one_always_fits() -> None:
    gate = Admission(3, 100)
    assert gate.try_enter(1000)
    assert not gate.try_enter(1)
    gate.leave(1000)
    assert [gate.try_enter(40) for _ in range(3)] == [True, True, False]
    gate.leave(40)
    assert [gate.try_enter(10) for _ in range(3)] == [True, True, False]


def test_a_source_that_waits_is_held_up_at_the_gate_and_let_go_when_it_closes() -> None:
    gate = Admission(2)
    passed: list[int] = []
    told: list[str] = []

    class File:
        name = "file"

        def frames(self) -> Iterator[CapturedFrame]:
            yield from (frame(i) for i in range(10))

    def run() -> None:
        try:
            for item in gated(File(), gate).frames():  # type: ignore[arg-type]
                assert isinstance(item, CapturedFrame)
                passed.append(item.frame_index)
        except InputError as error:
            told.append(str(error))

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    time.sleep(0.1)
    assert passed == [0, 1]
    gate.leave(len(frame(0).data))
    time.sleep(0.1)
    assert passed == [0, 1, 2]
    gate.close("no disk")
    thread.join(5)
    assert not thread.is_alive()
    assert passed == [0, 1, 2]
    assert told == ["file: expected to track its frames, found: no disk"]


def test_latencies_are_those_of_all_frames_and_of_the_last_seconds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = [100.0]
    monkeypatch.setattr("replay.live.latency.time.monotonic", lambda: now[0])
    latencies = Latencies()
    assert np.isnan(latencies.recent().median_ms)
    values = np.random.default_rng(0).gamma(2.0, 20.0, 1000)
    for value in values:
        latencies.add(float(value))
        now[0] += 0.01
    overall, recent = latencies.overall(), latencies.recent()
    assert overall == Latency(
        float(np.percentile(values, 50)), float(np.percentile(values, 95)), float(values.max())
    )
    last = values[-500:]
    assert recent.max_ms == last.max()
    assert recent.median_ms == pytest.approx(np.median(last), rel=0.02)


def test_what_a_camera_says_is_on_screen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Warning(Camera):
        def preparation(self) -> str | None:
            return "autofocus is on"

    source = Warning(3)
    lost = SourceEvent(0, "error", "connection lost: gone")
    source._items = [*source._items, lost, KeyboardInterrupt()]
    monkeypatch.setattr("recorder.sources.opening.open_source", lambda *_: source)
    verb: click.Command = track_verb()
    done = CliRunner().invoke(verb, ["/dev/none", "-o", str(tmp_path / "log.mcap"), "--no-rrd"])
    assert done.exit_code == 0
    assert "autofocus is on" in done.stderr
    assert "track: connection lost: gone" in done.stderr.splitlines()


def test_what_is_counted_and_the_latency_have_room_and_what_is_not_shown_is_in_the_log(
    tmp_path: Path,
) -> None:
    for name, data in ATTACHMENTS.items():
        (tmp_path / name).write_bytes(data)
    log = tmp_path / "log.mcap"
    given = ["--camera", str(tmp_path / "camera.yaml"), "--map", str(tmp_path / "map.yaml")]
    with PictureServer(Script(rate_hz=20.0, stamps=True)) as server, nobody() as port:
        command = ["-m", "arucolog", "track", server.url, "-o", str(log), *given]
        with Terminal([*command, "--live", f"127.0.0.1:{port}"], columns=80) as terminal:
            terminal.wait_for(r"not shown [1-9]\d*")
            terminal.wait_for(r"dropped 0, late \d+, corrupt 0")
            terminal.wait_for(r"ok, \d+ markers, x -?\d\.\d{3} y -?\d\.\d{3} m, yaw -?\d+\.\d°")
            time.sleep(1.0)
            terminal.press("\x03")
            assert terminal.wait() == 0
    with LogReader(log) as reader:
        written = len(images(reader))
        missed = int(reader.metadata["session_end"]["display_dropped"])
    # Some were still being tracked when the log ended.
    assert written - 15 <= missed <= written
    assert written > 15


def test_the_verb_records_tracks_and_reports(tmp_path: Path) -> None:
    folder = tmp_path / "images"
    folder.mkdir()
    for i in range(8):
        (folder / f"{i}.jpg").write_bytes(pictures()[i])
    for name, data in ATTACHMENTS.items():
        (tmp_path / name).write_bytes(data)
    files = ["--camera", str(tmp_path / "camera.yaml"), "--map", str(tmp_path / "map.yaml")]
    log = tmp_path / "drive.mcap"
    verb: click.Command = track_verb()
    done = CliRunner().invoke(verb, [str(folder), *files, "-o", str(log)], catch_exceptions=False)
    assert done.exit_code == 0
    assert f"{log}: 8 frames" in done.output
    assert "latency from hand-over to track, ms: median" in done.output
    (result,) = (tmp_path / "drive.results").iterdir()
    assert open_result(result).summary["frames"] == 8
    # Where a replay with the same settings would put it.
    again = CliRunner().invoke(verb, [str(folder), *files, "-o", str(log)])
    assert isinstance(again.exception, InputError)
    more = [*files, "-o", str(log), "--force", "--json", "--set", "pose.max_markers=3"]
    done = CliRunner().invoke(verb, [str(folder), *more], catch_exceptions=False)
    assert done.exit_code == 0
    assert json.loads(done.stdout)["frames"] == 8
    assert open_result(Path(json.loads(done.stdout)["folder"])).settings == PipelineSettings(
        pose=PipelineSettings().pose.model_copy(update={"max_markers": 3})
    )
