"""Cameras over HTTP: every byte, every fault."""

from __future__ import annotations

import hashlib
import http.server
import io
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import pytest

from recorder.capture import inspection
from recorder.errors import InputError
from recorder.image_header import ImageHeader, read_header
from recorder.log.reader import LogReader
from recorder.log.records import LogEvent
from recorder.record import record
from recorder.sources.base import CapturedFrame
from recorder.sources.live import stream
from recorder.sources.live.http_mjpeg import HttpConnection, http_camera, without_password
from recorder.sources.live.multipart import CutError, parts
from recorder.sources.opening import open_source
from recorder.verify.run import verify
from tests.live_helpers import Taker
from tests.log_helpers import images, png
from tests.mjpeg_server import Fault, MjpegProcess, MjpegServer, Script, Served


def digests(frames: list[CapturedFrame]) -> list[str]:
    return [hashlib.sha256(frame.data).hexdigest() for frame in frames]


def with_bytes(served: list[Served]) -> list[str]:
    """What a source must give of it: all that went out to its end."""
    return [entry.sha256 for entry in served if entry.kind != "cut"]


@pytest.mark.parametrize(("length", "chunked"), [(True, False), (False, False), (True, True)])
def test_every_frame_comes_byte_for_byte(length: bool, chunked: bool) -> None:
    script = Script(count=300, frame_bytes=20_000, length=length, chunked=chunked)
    with MjpegServer(script) as server:
        source = open_source(server.url)
        assert source.image_size == (64, 48)
        assert source.frame_count() is None
        with Taker(source) as taken:  # type: ignore[arg-type]
            # Without a length, the last one ends when the connection does.
            taken.wait_for(300 if length else 299)
        served = server.served()
    count = len(taken.frames)
    assert digests(taken.frames) == with_bytes(served)[:count]
    assert [f.frame_index for f in taken.frames] == list(range(count))
    assert {f.format for f in taken.frames} == {"jpeg"}
    assert all(b.timestamp_ns > a.timestamp_ns for a, b in pairwise(taken.frames))
    assert all(0 <= f.arrival_ns - f.timestamp_ns < 10**9 for f in taken.frames)
    assert abs(taken.frames[-1].arrival_ns - served[-1].sent_ns) < 2 * 10**9
    assert taken.events == []
    assert taken.stop_s < 1.0


def test_faults_are_told_and_numbers_go_on() -> None:
    faults = {
        10: Fault("corrupt"),
        20: Fault("empty"),
        30: Fault("truncated"),
        40: Fault("disconnect"),
        50: Fault("cut"),
        60: Fault("down", 0.8),
    }
    with MjpegServer(Script(count=80, faults=faults)) as server:
        with Taker(http_camera(server.url)) as taken:
            taken.wait_for(80)
        served = server.served()
    frames = taken.frames
    assert digests(frames) == with_bytes(served)
    # The cut frame has a number of its own: it was lost, and came again as the next.
    assert [f.frame_index for f in frames] == [i for i in range(81) if i != 50]
    told = [(e.level, e.message.partition(":")[0], e.dropped) for e in taken.events]
    again = [t for t in told if t[1].startswith("connected again after ")]
    assert len(again) == 3
    assert [t for t in told if t not in again] == [
        ("error", "connection lost after frame 39", 0),
        ("error", "connection lost in the middle of frame 50", 1),
        ("error", "connection lost after frame 60", 0),
    ]
    assert sum(e.dropped for e in taken.events) + len(frames) == 81


def test_a_corrupt_jpeg_is_kept_as_it_is() -> None:
    script = Script(count=3, frame_bytes=5000, faults={1: Fault("corrupt")})
    with MjpegServer(script) as server:
        with Taker(http_camera(server.url)) as taken:
            taken.wait_for(3)
        assert server.served()[1].kind == "corrupt"
        assert digests(taken.frames) == with_bytes(server.served())


def test_jitter_loses_nothing() -> None:
    script = Script(count=150, rate_hz=150, jitter_s=0.05, frame_bytes=20_000)
    with MjpegServer(script) as server:
        with Taker(http_camera(server.url)) as taken:
            taken.wait_for(150)
        assert digests(taken.frames) == with_bytes(server.served())
    assert taken.events == []


def test_a_stall_loses_nothing() -> None:
    script = Script(count=40, rate_hz=100, faults={20: Fault("stall", 0.6)})
    with MjpegServer(script) as server:
        with Taker(http_camera(server.url)) as taken:
            taken.wait_for(40)
        assert digests(taken.frames) == with_bytes(server.served())
    assert taken.events == []
    assert taken.frames[20].arrival_ns - taken.frames[19].arrival_ns >= 0.59e9


def test_a_recording_says_all_that_went_wrong(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Frame 10 is looked into, also where the machine is busy.
    monkeypatch.setattr(inspection, "_SHARE", 1.0)
    faults = {
        15: Fault("stall", 0.5),
        10: Fault("corrupt"),
        30: Fault("empty"),
        40: Fault("truncated"),
        50: Fault("cut"),
        60: Fault("down", 0.5),
    }
    shifts = {70: -5.0}
    script = Script(
        count=90,
        rate_hz=60,
        width_px=320,
        height_px=240,
        stamps=True,
        stamp_shifts_s=shifts,
        faults=faults,
    )
    with MjpegServer(script) as server:
        source = http_camera(server.url)

        def stop_at_the_end() -> None:
            server.finished.wait(20)
            time.sleep(0.3)
            source.stop()

        threading.Thread(target=stop_at_the_end).start()
        summary = record(source, tmp_path / "log.mcap")
        served = server.served()
    counts = summary.counts
    assert (counts.written, counts.dropped, counts.corrupt, counts.stamped_back) == (90, 1, 3, 1)
    assert (summary.outages.count, summary.outages.at_end) == (2, False)
    assert 0.4 < summary.outages.seconds < 4
    assert counts.late >= 2
    with LogReader(tmp_path / "log.mcap") as log:
        assert [hashlib.sha256(i.data).hexdigest() for i in images(log)] == with_bytes(served)
        told = [r.message for r in log.records() if isinstance(r, LogEvent)]
        assert log.metadata["session"]["source.clock"] == "server (X-Timestamp of each part)"
        assert log.shortfall is None
    rules = {v.rule: v.level for v in verify([tmp_path / "log.mcap"]).rules}
    assert rules["counts"] == rules["end"] == "ok"
    for words in (
        "frame 10 is a damaged jpeg image", "frame 15 is late", "frame 30 is empty",
        "frame 40 is a jpeg image without its end",
        "connection lost in the middle of frame 50", "connection lost after frame 60",
        "connected again", "frame 71 is stamped",
    ):  # fmt: skip
        assert any(message.startswith(words) for message in told), words


def test_silence_is_a_lost_connection(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("recorder.sources.live.http_mjpeg.SILENCE_S", 1.0)
    script = Script(count=20, faults={10: Fault("stall", 2.0)})
    with MjpegServer(script) as server, Taker(http_camera(server.url)) as taken:
        taken.wait_for(19)
    assert taken.messages[0].startswith("connection lost in the middle of frame 10")
    lost, back = taken.events
    # What is told is how long there were no frames, also before that was noticed.
    pause_s = (taken.frames[10].arrival_ns - taken.frames[9].arrival_ns) / 1e9
    assert pause_s > 1.5
    assert lost.silent_s >= 1.0
    assert back.silent_s == pytest.approx(pause_s, abs=0.2)
    assert back.message == f"connected again after {back.silent_s:.1f} s"
    assert sum(e.dropped for e in taken.events) == 1


@pytest.mark.parametrize("when", ["nothing comes", "in a frame", "nobody listens"])
def test_stop_ends_it_within_a_second(when: str) -> None:
    faults = {5: Fault("stall" if when == "in a frame" else "down", 30.0)}
    script = Script(count=5 if when == "nothing comes" else 50, faults=faults)
    with MjpegServer(script) as server:
        with Taker(http_camera(server.url)) as taken:
            taken.wait_for(5)
            if when == "nobody listens":
                taken.wait_for_message("connection lost")
            time.sleep(0.3)
        assert taken.stop_s < 1.0
        # And it stays stopped.
        assert len(taken.frames) == 5


def test_stop_does_not_wait_for_a_connection_that_is_being_made() -> None:
    answer = threading.Event()

    class Slow:
        def __init__(self) -> None:
            self.closed = False

        def receive(self) -> stream.Received:
            return stream.Received(jpeg, 1)

        def describe(self) -> dict[str, str]:
            return {"clock": "none"}

        def interrupt(self) -> None: ...

        def close(self) -> None:
            self.closed = True

    made: list[Slow] = []

    def connect() -> Slow:
        if made:
            answer.wait(10)
        made.append(Slow())
        return made[-1]

    with MjpegServer(Script()) as server:
        connection = HttpConnection(server.url)
        received = connection.receive()
        connection.close()
    assert received is not None
    jpeg = received.data
    with Taker(stream.LiveCamera("slow", "slow", connect, {})) as taken:
        time.sleep(0.2)
    assert taken.stop_s < 1.0
    assert taken.items == []
    answer.set()
    for _ in range(100):
        if len(made) == 2 and made[1].closed:
            return
        time.sleep(0.01)
    pytest.fail("the connection that came too late was left open")


def test_stamps_of_the_server_are_the_capture_times() -> None:
    script = Script(count=60, rate_hz=200, stamps=True, stamp_shifts_s={30: -0.5})
    with MjpegServer(script) as server:
        source = http_camera(server.url)
        assert source.describe()["clock"] == "server (X-Timestamp of each part)"
        with Taker(source) as taken:
            taken.wait_for(60)
        served = server.served()
    assert [f.timestamp_ns for f in taken.frames] == [s.stamp_ns for s in served]
    assert taken.frames[30].timestamp_ns < taken.frames[29].timestamp_ns
    assert taken.events == []


def test_a_server_with_another_clock_is_not_believed() -> None:
    script = Script(count=5, stamps=True, stamp_shifts_s={0: -3600})
    with MjpegServer(script) as server:
        source = http_camera(server.url)
        # The look at the start saw the clock before it was moved.
        assert source.describe()["clock"] == "server (X-Timestamp of each part)"
        with Taker(source) as taken:
            taken.wait_for(5)
    assert all(0 <= f.arrival_ns - f.timestamp_ns < 10**9 for f in taken.frames)
    assert taken.messages == ["capture times are now from: arrival (system clock)"]


def test_another_size_is_left_to_the_log() -> None:
    """It is a frame all the same, and the writer says what is wrong with it."""
    with MjpegServer(Script(count=5)) as small, MjpegServer(Script(width_px=32)) as narrow:
        source = http_camera(small.url)
        urls = iter([small.url, narrow.url])
        source._connect = lambda: HttpConnection(next(urls))
        with Taker(source) as taken:
            taken.wait_for(5)
            assert source._connection is not None
            source._connection.interrupt()
            taken.wait_for(6)
    assert read_header(taken.frames[5].data) == ImageHeader("jpeg", 32, 48)
    assert taken.frames[5].frame_index == 5


def test_a_password_is_not_shown() -> None:
    assert without_password("http://me:secret@cam:80/x?y=1") == "http://me:***@cam:80/x?y=1"
    assert without_password("http://cam/x@y") == "http://cam/x@y"
    assert without_password("http://cam:80/x@y") == "http://cam:80/x@y"
    assert without_password("http://[::1]:80/x@y") == "http://[::1]:80/x@y"
    assert without_password("http://me:a/b@cam/x") == "http://me:***@cam/x"
    shown = without_password("http://cam/v.cgi?user=me&pwd=secret&rate=0")
    assert shown == "http://cam/v.cgi?user=me&pwd=***&rate=0"
    with MjpegServer(Script()) as server:
        source = http_camera(server.url.replace("//", "//me:secret@"))
    assert "secret" not in str(source.describe())
    assert source.name == "127.0.0.1"
    with pytest.raises(InputError) as caught:
        http_camera(server.url.replace("//", "//me:secret@"))
    assert "secret" not in str(caught.value)


@contextmanager
def web_server(status: int, kind: str, body: bytes, *login: str) -> Iterator[str]:
    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            for scheme in login:
                self.send_header("WWW-Authenticate", f'{scheme} realm="camera"')
            if status in (301, 302):
                self.send_header("Location", "http://elsewhere/")
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: object) -> None: ...

    with http.server.HTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()
        thread.join()


@pytest.mark.parametrize(
    ("status", "kind", "words"),
    [
        (404, "text/html", "expected a stream, found 404 Not Found"),
        (401, "text/html", "expected to be let in, found 401: give http://USER:PASSWORD@HOST"),
        (302, "text/html", "found a redirect to http://elsewhere/"),
        (200, "image/jpeg", r"expected an MJPEG stream .*found image/jpeg"),
        (200, "multipart/x-mixed-replace", "expected an MJPEG stream"),
        (200, "multipart/x-mixed-replace; boundary=b", "a first image, found: the server ended"),
    ],
)
def test_what_is_no_stream_is_said(status: int, kind: str, words: str) -> None:
    with web_server(status, kind, b"text") as url, pytest.raises(InputError, match=words):
        http_camera(url)


@pytest.mark.parametrize("stamp_ns", [None, 0, -5 * 10**9])
def test_a_stamp_that_is_none_is_the_arrival(stamp_ns: int | None) -> None:
    class Stamped:
        def receive(self) -> stream.Received:
            return stream.Received(png(), 7 * 10**18, stamp_ns, "png")

        def describe(self) -> dict[str, str]:
            return {"clock": "its own"}

        def interrupt(self) -> None: ...

        def close(self) -> None: ...

    camera = stream.LiveCamera("camera", "spec", Stamped, {})
    found = next(iter(camera.frames()))
    camera.stop()
    assert found.timestamp_ns == 7 * 10**18


def test_a_password_with_a_slash_is_helped_with() -> None:
    with pytest.raises(InputError, match=r"in a password / is %2F") as error:
        http_camera("http://me:se/cret@127.0.0.1:9/stream")
    assert "cret" not in str(error.value)


def test_a_path_may_have_any_letters() -> None:
    with MjpegServer(Script()) as server:
        assert http_camera(f"{server.url}/Lager Süd?x=ä b").image_size == (64, 48)


def test_nobody_there_is_said() -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with pytest.raises(InputError, match=r"expected a server, found none .*refused"):
        http_camera(f"http://127.0.0.1:{port}/")
    for url in ("http:///stream", "http://[::1", "http://cam:port/"):
        with pytest.raises(InputError, match="expected a URL"):
            open_source(url)


def stream_of(*pieces: bytes) -> io.BytesIO:
    return io.BytesIO(b"".join(pieces))


def test_parts_may_hold_anything_when_their_length_is_known() -> None:
    body = b"\r\n--b\r\nContent-Length: 3\r\n\r\nxyz\r\n--b--\r\n"
    head = b"--b\r\ncontent-LENGTH:%d\r\nX: 1\r\n\r\n" % len(body)
    (part,) = parts(stream_of(b"preamble\r\n", head, body, b"\r\n--b--\r\n"), "--b")
    assert part.data == body
    assert part.headers == {"content-length": str(len(body)), "x": "1"}
    assert part.skipped == len(b"preamble\r\n")


def test_a_wrong_length_is_found_out() -> None:
    first = b"--b\r\nContent-Length: 4\r\n\r\n123456\r\n"
    second = b"--b\r\nContent-Length: 2\r\n\r\nab\r\n"
    found = list(parts(stream_of(first, second), "b"))
    assert [part.data for part in found] == [b"1234", b"ab"]
    assert [part.skipped for part in found] == [0, 4]


@pytest.mark.parametrize(
    "end",
    [
        b"--b\r\nContent-Length: 4\r\n\r\n12",
        b"--b\r\nContent-Length: 4\r\n",
        b"--b\r\n\r\n\xff\xd8 half a JPEG",
    ],
)
def test_a_part_that_is_cut_is_no_part(end: bytes) -> None:
    found = parts(stream_of(b"--b\r\nContent-Length: 2\r\n\r\nab\r\n", end), "b")
    assert next(found).data == b"ab"
    with pytest.raises(CutError):
        next(found)


def test_a_whole_jpeg_needs_no_boundary_after_it() -> None:
    found = list(parts(stream_of(b"--b\r\n\r\n\xff\xd8\n\xff\xd9\r\n"), "b"))
    assert [part.data for part in found] == [b"\xff\xd8\n\xff\xd9"]


@pytest.mark.bench
def test_speed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """At least 500 frames/s of 400 kB."""
    script = Script(count=3000, width_px=1920, height_px=1080, frame_bytes=400_000)
    with MjpegProcess(script, tmp_path / "served") as server:
        source = http_camera(server.url)
        used_s, started_s, count = time.process_time(), time.monotonic(), 0
        for item in source.frames():
            assert isinstance(item, CapturedFrame)
            assert len(item.data) == 400_000
            count += 1
            if count == script.count:
                break
        took_s = time.monotonic() - started_s
        used_s = time.process_time() - used_s
    with capsys.disabled():
        rate, each_ms = count / took_s, used_s / count * 1e3
        print(f"\n{rate:.0f} frames/s of 400 kB, {each_ms:.2f} ms of one core each")
    assert rate > 500
