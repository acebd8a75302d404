"""The live view: what the viewer gets, and that none of what happens to it reaches the log."""

from __future__ import annotations

import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from pathlib import Path

import click
import cv2
import numpy as np
import pytest
import rerun as rr
from click.testing import CliRunner

import recorder.cli
from pipeline.localizer import Frame, Localizer, PipelineSettings
from recorder.errors import InputError
from recorder.image_decoding import decode_gray
from recorder.live_option import OpenView
from recorder.log.derived import Known
from recorder.log.reader import LogReader
from recorder.log.records import LogImage
from recorder.record import record
from recorder.sources.base import CapturedFrame, Source
from recorder.sources.opening import open_source
from replay.live import address as address_module
from replay.live import view as view_module
from replay.live.address import Address, local_viewer, parse_address
from replay.live.child import ViewSetup
from replay.live.sink import live_sink
from replay.live.stream import NAME, LiveDrive, LiveImages
from replay.live.view import LiveView
from replay.viewer import style
from replay.viewer.output import RecordingFile
from replay.viewer.program import has_graphics, viewer_program
from replay.viewer.screenshot import headless_viewer
from tests import worlds
from tests.live_sources import LiveScript
from tests.log_helpers import images
from tests.mjpeg_server import Script
from tests.picture_server import ATTACHMENTS, PictureServer, pictures
from tests.ports import black_hole, free_port, nobody
from tests.rrd_files import entities, rows, static

PATHS = style.ResultPaths(NAME)
SETUP = ViewSetup("camera", "id", ATTACHMENTS, PipelineSettings())


class Camera(LiveScript):
    """The pictures at 20 frames/s."""

    image_size = (1280, 720)

    def __init__(self, count: int, rate_hz: float = 20.0) -> None:
        super().__init__(self._now(count), rate_hz=rate_hz)

    @staticmethod
    def _now(count: int) -> Iterator[CapturedFrame]:
        for i in range(count):
            now_ns = time.time_ns()
            yield CapturedFrame(i, now_ns, now_ns, pictures()[i % 40], "jpeg")


def captured(i: int) -> CapturedFrame:
    stamp_ns = worlds.START_NS + i * worlds.FRAME_NS
    return CapturedFrame(i, stamp_ns, stamp_ns, pictures()[i], "jpeg")


def image_of(frame: CapturedFrame) -> LogImage:
    stamps = (frame.timestamp_ns, frame.arrival_ns)
    return LogImage(frame.frame_index, *stamps, frame.data, frame.format)


@pytest.mark.parametrize(
    ("text", "host", "port"),
    [
        ("robot", "robot", 9876),
        ("robot:1234", "robot", 1234),
        ("192.168.1.5", "192.168.1.5", 9876),
        ("[::1]:1234", "::1", 1234),
        ("[::1]", "::1", 9876),
    ],
)
def test_addresses(text: str, host: str, port: int) -> None:
    assert parse_address(text) == Address(host, port)


def test_an_address_becomes_the_url_of_a_viewer() -> None:
    assert Address("robot", 9876).url == "rerun+http://robot:9876/proxy"
    assert Address("::1", 1).url == "rerun+http://[::1]:1/proxy"


@pytest.mark.parametrize(
    "text", [":", ":1", "robot:", "robot:x", "robot:70000", "http://a:1", "/", "9876"]
)
def test_what_is_no_address(text: str) -> None:
    with pytest.raises(ValueError, match="expected HOST or HOST:PORT"):
        parse_address(text)
    with pytest.raises(click.BadParameter), live_sink(text, Camera(1), {}):
        pass


def test_without_a_screen_this_machine_shows_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(address_module, "has_display", lambda: False)
    monkeypatch.setattr(Address, "listens", lambda self: False)
    with pytest.raises(InputError, match="no screen to show it on; --live HOST"):
        local_viewer()


def test_the_stream_holds_image_detections_pose_and_tracks(tmp_path: Path) -> None:
    known = Known.parse(ATTACHMENTS)
    assert known.camera is not None
    assert known.marker_map is not None
    settings = PipelineSettings()
    file = RecordingFile(tmp_path / "live.rrd", "id", "live")
    drive = LiveDrive(file.stream, known, tuple(settings.trackers), worlds.START_NS)
    localizer = Localizer(settings, known.camera, known.marker_map, worlds.START_NS)
    results = []
    for i in range(20):
        frame = captured(i)
        found = localizer.step(Frame(i, frame.timestamp_ns, decode_gray(frame.data)))
        drive.show(image_of(frame), found, worlds.drive(20)[i] if i > 4 else None)
        results.append(found)
    file.close()
    path = tmp_path / "live.rrd"
    sent = rows(path, style.IMAGE, "EncodedImage:blob")
    assert {i: bytes(blob[0]) for i, blob in sent.items()} == {i: pictures()[i] for i in range(20)}
    outlines = rows(path, PATHS.detections, "LineStrips2D:strips")
    assert {i: len(strips) for i, strips in outlines.items()} == {
        r.frame_index: len(r.detections.ids) for r in results
    }
    where = rows(path, PATHS.camera, "Transform3D:translation")
    for found in results:
        assert found.fix.T_map_camera is not None
        translation = found.fix.T_map_camera.translation
        np.testing.assert_allclose(where[found.frame_index][0], translation, atol=1e-6)
    for name in settings.trackers:
        track = rows(path, f"{PATHS.tracker(name)}/position", "Points3D:positions")
        xy = [r.tracks[name].x[[0, 2]] for r in results]
        np.testing.assert_allclose([track[i][0][:2] for i in range(20)], xy, atol=1e-5)
        assert len(static(path, f"{PATHS.tracker(name)}/path", "LineStrips3D:strips")[0]) > 10
    # Errors show once the truth is known.
    errors = rows(path, PATHS.plot("error", "adaptive"), "Scalars:scalars")
    assert min(errors) == 5
    assert style.MARKERS in entities(path)


def test_images_alone_leave_out_what_is_none(tmp_path: Path) -> None:
    file = RecordingFile(tmp_path / "live.rrd", "id", "live")
    view = LiveImages(file.stream, worlds.START_NS)
    for i in range(4):
        frame = captured(i)
        view.show(image_of(replace(frame, data=frame.data[:500]) if i == 2 else frame))
    file.close()
    assert set(rows(tmp_path / "live.rrd", style.IMAGE, "EncodedImage:blob")) == {0, 1, 3}


@pytest.mark.parametrize("viewer", [black_hole, nobody])
def test_a_viewer_that_takes_nothing_costs_no_frame_of_the_log(
    viewer: Callable[[], AbstractContextManager[int]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    source = Camera(60)
    with viewer() as port:
        started = time.monotonic()
        with live_sink(f"127.0.0.1:{port}", source, ATTACHMENTS) as sink:
            summary = record(source, tmp_path / "log.mcap", attachments=ATTACHMENTS, sinks=[sink])
            recorded_s = time.monotonic() - started
        took_s = time.monotonic() - started
    assert (summary.ended, summary.frames_written, summary.frames_dropped) == ("complete", 60, 0)
    assert source.held_up_s < 0.1
    assert recorded_s < 4.5
    assert took_s < recorded_s + 5.0
    # The last one may be on its way.
    assert 58 <= summary.display_dropped <= 60
    with LogReader(tmp_path / "log.mcap") as log:
        assert [bytes(image.data) for image in images(log)] == [
            pictures()[i % 40] for i in range(60)
        ]
        assert log.metadata["session_end"]["display_dropped"] == str(summary.display_dropped)
    said = capsys.readouterr().err
    assert "live view: 0 frames shown" in said
    assert ("nobody listens there yet" in said) == (viewer is nobody)


def test_the_log_of_a_file_is_the_same_whoever_watches(tmp_path: Path) -> None:
    source = LiveScript([])
    with nobody() as port, live_sink(f"127.0.0.1:{port}", source, {}) as sink:
        for i in range(3):
            sink(captured(i))
        assert sink.missed >= 2  # type: ignore[attr-defined]
    waiting = type("File", (), {"name": "file", "attachments": {}})()
    with nobody() as port, live_sink(f"127.0.0.1:{port}", waiting, {}) as sink:
        for i in range(3):
            sink(captured(i))
        assert sink.missed == 0  # type: ignore[attr-defined]


class Server:
    """A server of Rerun's that takes what is shown, in a process of its own."""

    def __init__(self, port: int) -> None:
        self._process = subprocess.Popen(
            [viewer_program(), "--serve-grpc", "--bind", "127.0.0.1", "--port", str(port)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        wait_for(Address("127.0.0.1", port).listens)

    def kill(self) -> None:
        # `rerun` is a script that starts the server: they go together.
        os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()


def wait_for(condition: Callable[[], bool], timeout_s: float = 30.0) -> None:
    until = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.05)


def test_a_viewer_that_is_killed_is_found_again_when_it_is_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(view_module, "_PAUSE_S", 0.5)
    port = free_port()
    server = Server(port)
    stop = threading.Event()
    try:
        with LiveView(Address("127.0.0.1", port), SETUP) as view:

            def feed() -> None:
                for i in range(10_000):
                    view.offer(replace(captured(i % 40), frame_index=i))
                    if stop.wait(0.05):
                        return

            feeder = threading.Thread(target=feed)
            feeder.start()
            wait_for(lambda: view.shown > 5)
            server.kill()
            wait_for(lambda: view.problem is not None)
            shown = view.shown
            server = Server(port)
            wait_for(lambda: view.shown > shown + 5)
            assert view.problem is None
            stop.set()
            feeder.join()
        assert view.missed > 5
    finally:
        stop.set()
        server.kill()


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_what_a_viewer_received_can_be_read_back(tmp_path: Path) -> None:
    """Over the wire and through Rerun's own server, into a file."""
    port = free_port()
    server = Server(port)
    saved = tmp_path / "received.rrd"
    saver = None
    try:
        with LiveView(Address("127.0.0.1", port), SETUP) as view:
            for i in range(12):
                view.offer(captured(i))
                wait_for(lambda: view.shown > i)  # noqa: B023
        saver = subprocess.Popen(
            [viewer_program(), "--save", saved, f"rerun+http://127.0.0.1:{port}/proxy"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        wait_for(lambda: saved.exists() and saved.stat().st_size > 12 * len(pictures()[0]))
        time.sleep(0.5)
    finally:
        server.kill()
        if saver is not None:
            os.killpg(saver.pid, signal.SIGTERM)
            saver.wait()
    assert set(rows(saved, style.IMAGE, "EncodedImage:blob")) == set(range(12))
    assert PATHS.detections in entities(saved)


@pytest.mark.skipif(not has_graphics(), reason="no Vulkan driver")
def test_the_viewer_shows_what_is_being_recorded(tmp_path: Path) -> None:
    picture = tmp_path / "picture.png"
    with (
        PictureServer(Script(rate_hz=10)) as server,
        headless_viewer((1280, 800), time.monotonic() + 90, picture) as (viewer, port),
    ):
        source = open_source(server.url)
        with live_sink(f"127.0.0.1:{port}", source, ATTACHMENTS) as sink:
            summary = record(
                source, tmp_path / "log.mcap", attachments=ATTACHMENTS, sinks=[sink], duration_s=8
            )
        picture.write_bytes(viewer.take_screenshot())
        views = viewer.get_state().views
    assert {view.name for view in views} >= {"Camera image", "Map and trajectories", "Markers"}
    assert [report for view in views for report in view.reports] == []
    assert summary.display_dropped < summary.frames_written / 2
    image = cv2.imread(str(picture))
    assert image is not None
    # The drawn camera image is bright and takes a good part of an otherwise dark window.
    assert 0.03 < (image.min(axis=2) > 200).mean() < 0.5


def test_rerun_is_only_in_the_process_that_draws() -> None:
    """Its streams cannot be ended while a viewer takes nothing: they would hold up the recorder."""
    assert not hasattr(view_module, "rr")
    assert rr.get_global_data_recording() is None


def test_the_verb_hands_its_frames_to_whoever_shows_them(tmp_path: Path) -> None:
    folder = tmp_path / "images"
    folder.mkdir()
    for i in range(3):
        (folder / f"{i}.jpg").write_bytes(pictures()[i])
    asked: list[tuple[str, str, set[str]]] = []
    seen: list[bytes] = []

    @contextmanager
    def show(
        text: str, source: Source, attachments: Mapping[str, bytes]
    ) -> Iterator[Callable[[CapturedFrame], None]]:
        asked.append((text, source.name, set(attachments)))
        yield lambda frame: seen.append(frame.data)

    def record_verb(live: OpenView | None) -> click.Command:
        (verb,) = (verb for verb in recorder.cli.commands(live) if verb.name == "record")
        return verb

    for k, (arguments, text) in enumerate([(["--live"], ""), (["--live", "robot"], "robot")]):
        log = str(tmp_path / f"{k}.mcap")
        done = CliRunner().invoke(record_verb(show), [str(folder), "-o", log, *arguments])
        assert done.exit_code == 0, done.output
        assert asked.pop() == (text, "images", set())
        assert seen == list(pictures()[:3])
        seen.clear()
    log = str(tmp_path / "none.mcap")
    assert CliRunner().invoke(record_verb(show), [str(folder), "-o", log]).exit_code == 0
    assert asked == []
    # Without anybody to show them there is no such option.
    log = str(tmp_path / "other.mcap")
    assert CliRunner().invoke(record_verb(None), [str(folder), "-o", log, "--live"]).exit_code == 2


@pytest.mark.parametrize("source", ["http://robot.local/stream", "/dev/video0"])
def test_a_source_behind_live_is_no_viewer(source: str) -> None:
    @contextmanager
    def show(*_: object) -> Iterator[Callable[[CapturedFrame], None]]:
        yield lambda frame: None

    (verb,) = (verb for verb in recorder.cli.commands(show) if verb.name == "record")
    done = CliRunner().invoke(verb, ["--live", source])
    assert done.exit_code == 2
    assert f"found '{source}'; SOURCE goes before --live" in " ".join(done.stderr.split())
