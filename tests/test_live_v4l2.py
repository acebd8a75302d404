"""Cameras under /dev, with a driver that is made up: no camera is needed."""

from __future__ import annotations

import errno
import json
import struct
import subprocess
import sys
import threading
import time
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import av
import numpy as np
import pytest
from av.container import InputContainer
from click.testing import CliRunner

from recorder.cameras_cli import cameras
from recorder.errors import InputError
from recorder.info import log_info
from recorder.log.reader import LogReader
from recorder.record import record
from recorder.record_text import summary_text
from recorder.sources.encoding import encoded_image
from recorder.sources.live import device, stream, v4l2
from recorder.sources.live.clock import ARRIVAL, kernel_clock
from recorder.sources.live.container import AvPacket, ContainerConnection, av_reason
from recorder.sources.live.device import KernelStamps, device_camera
from recorder.sources.live.listing import found_cameras, listing_text
from recorder.sources.live.settings import (
    CameraSettings,
    parse_exposure,
    parse_number_or_auto,
    parse_rate,
    parse_size,
)
from recorder.sources.live.stream import ConnectionLost, Received
from recorder.sources.live.v4l2 import Device, Mode
from recorder.sources.opening import SourceOptions, open_source
from recorder.verify.run import verify
from tests.capture_helpers import end_of, events_of
from tests.conftest import ROOT
from tests.live_helpers import Taker
from tests.live_sources import LiveScript
from tests.log_helpers import images
from tests.test_sources import make_video

MJPG = int.from_bytes(b"MJPG", "little")
YUYV = int.from_bytes(b"YUYV", "little")
SIZES = {MJPG: [(1920, 1080), (128, 96)], YUYV: [(640, 480)]}


class FakeDriver:
    """Answers as a Logitech C920 does; controls by number: minimum, maximum, value."""

    def __init__(self) -> None:
        self.capabilities = 0x84A00001, 0x04200001
        self.sizes = SIZES
        self.controls = {
            v4l2.EXPOSURE_AUTO: (0, 3, 3),
            v4l2.EXPOSURE_100US: (3, 2047, 250),
            v4l2.FOCUS_AUTO: (0, 1, 1),
            v4l2.FOCUS: (0, 250, 35),
            v4l2.WHITE_BALANCE_AUTO: (0, 1, 1),
            v4l2.WHITE_BALANCE_K: (2000, 6500, 4000),
        }
        self.refused: set[tuple[int, int]] = {(v4l2.EXPOSURE_AUTO, 0), (v4l2.EXPOSURE_AUTO, 2)}
        self.set: list[tuple[int, int]] = []

    def __call__(self, fd: int, request: int, data: bytearray) -> int:
        answers = {
            0x80685600: self._capability,
            0xC0405602: self._format,
            0xC02C564A: self._size,
            0xC034564B: self._interval,
            0xC0445624: self._query,
            0xC008561B: self._get,
            0xC008561C: self._put,
        }
        if request not in answers:
            raise OSError(errno.ENOTTY, "no such ioctl")
        answers[request](data)
        return 0

    def _capability(self, data: bytearray) -> None:
        struct.pack_into("16s32s32s3I", data, 0, b"uvcvideo", b"HD Pro Webcam C920", b"usb-1",
                         0x060100, *self.capabilities)  # fmt: skip

    def _format(self, data: bytearray) -> None:
        index, kind = struct.unpack_from("2I", data)
        assert kind == 1
        formats = list(self.sizes)
        struct.pack_into("32sI", data, 12, b"", formats[self._known(index, len(formats))])

    def _size(self, data: bytearray) -> None:
        index, pixel_format = struct.unpack_from("2I", data)
        sizes = self.sizes[pixel_format]
        struct.pack_into("3I", data, 8, 1, *sizes[self._known(index, len(sizes))])

    def _interval(self, data: bytearray) -> None:
        index, _, width, _ = struct.unpack_from("4I", data)
        intervals = [(1, 30), (1, 15), (2, 15)] if width == 1920 else [(1, 30)]
        numbers = intervals[self._known(index, len(intervals))]
        struct.pack_into("3I", data, 16, 1, *numbers)

    def _query(self, data: bytearray) -> None:
        (number,) = struct.unpack_from("I", data)
        low, high, _ = self._control(number)
        struct.pack_into("32s4i", data, 8, b"a control", low, high, 1, low)

    def _get(self, data: bytearray) -> None:
        (number,) = struct.unpack_from("I", data)
        struct.pack_into("i", data, 4, self._control(number)[2])

    def _put(self, data: bytearray) -> None:
        number, value = struct.unpack("Ii", data)
        low, high, _ = self._control(number)
        if (number, value) in self.refused or not low <= value <= high:
            raise OSError(errno.EINVAL, "invalid argument")
        self.controls[number] = (low, high, value)
        self.set.append((number, value))

    def _control(self, number: int) -> tuple[int, int, int]:
        if number not in self.controls:
            raise OSError(errno.EINVAL, "invalid argument")
        return self.controls[number]

    def _known(self, index: int, count: int) -> int:
        if index >= count:
            raise OSError(errno.EINVAL, "invalid argument")
        return index


def test_numbers_are_those_of_the_kernel() -> None:
    """As <linux/videodev2.h> has them, printed by a C compiler."""
    assert v4l2.QUERYCAP == 0x80685600
    assert v4l2.ENUM_FMT == 0xC0405602
    assert v4l2.G_CTRL == 0xC008561B
    assert v4l2.S_CTRL == 0xC008561C
    assert v4l2.QUERYCTRL == 0xC0445624
    assert v4l2.ENUM_FRAMESIZES == 0xC02C564A
    assert v4l2.ENUM_FRAMEINTERVALS == 0xC034564B
    assert (v4l2.EXPOSURE_AUTO, v4l2.EXPOSURE_100US) == (0x9A0901, 0x9A0902)
    assert (v4l2.FOCUS, v4l2.FOCUS_AUTO) == (0x9A090A, 0x9A090C)
    assert (v4l2.WHITE_BALANCE_AUTO, v4l2.WHITE_BALANCE_K) == (0x98090C, 0x98091A)


def test_modes_and_names_are_read() -> None:
    with Device(Path("/dev/null"), FakeDriver()) as camera:
        assert (camera.driver, camera.card, camera.bus) == (
            "uvcvideo", "HD Pro Webcam C920", "usb-1",
        )  # fmt: skip
        assert camera.captures
        assert list(camera.modes()) == [
            Mode("MJPG", 1920, 1080, (30.0, 15.0, 7.5)),
            Mode("MJPG", 128, 96, (30.0,)),
            Mode("YUYV", 640, 480, (30.0,)),
        ]
        assert camera.control(v4l2.FOCUS) == v4l2.Control("a control", 0, 250, 0, 35)
        assert camera.control(123) is None


def test_what_is_set_is_read_back() -> None:
    driver = FakeDriver()
    settings = CameraSettings(exposure_us=5000, focus=0, white_balance_k=4500)
    with Device(Path("/dev/null"), driver) as camera:
        assert device.controls(camera) == {
            "exposure": "auto", "focus": "auto", "white_balance": "auto",
        }  # fmt: skip
        device.set_controls(camera, settings, Path("cam"))
        assert device.controls(camera) == {
            "exposure": "5000 us", "focus": "0", "white_balance": "4500 K",
        }  # fmt: skip
        # The automatic goes off before the value is set, or a driver would refuse that.
        assert driver.set == [
            (v4l2.EXPOSURE_AUTO, 1), (v4l2.EXPOSURE_100US, 50),
            (v4l2.FOCUS_AUTO, 0), (v4l2.FOCUS, 0),
            (v4l2.WHITE_BALANCE_AUTO, 0), (v4l2.WHITE_BALANCE_K, 4500),
        ]  # fmt: skip
        device.set_controls(camera, CameraSettings(None, None, "auto", "auto", "auto"), Path("cam"))
        assert set(device.controls(camera).values()) == {"auto"}


@pytest.mark.parametrize(
    ("settings", "missing", "words"),
    [
        (CameraSettings(focus=300), None, "expected focus from 0 to 250, found 300"),
        (CameraSettings(exposure_us=10**7), None, "exposure in units of 0.1 ms from 3 to 2047"),
        (CameraSettings(white_balance_k=9000), None, "white balance from 2000 to 6500"),
        (CameraSettings(focus=3), v4l2.FOCUS, "a camera whose focus can be set"),
        (CameraSettings(focus="auto"), v4l2.FOCUS_AUTO, "a camera with automatic focus"),
        (CameraSettings(exposure_us="auto"), v4l2.EXPOSURE_AUTO, "with automatic exposure"),
    ],
)
def test_what_a_camera_cannot_do_is_said(
    settings: CameraSettings, missing: int | None, words: str
) -> None:
    driver = FakeDriver()
    driver.controls.pop(missing or 0, None)
    with Device(Path("/dev/null"), driver) as camera, pytest.raises(InputError, match=words):
        device.set_controls(camera, settings, Path("cam"))


@pytest.fixture
def opened_with(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """A video in place of the device; gives the options that it was opened with."""
    make_video(tmp_path / "a.avi", "mjpeg", 30)
    seen: dict[str, str] = {}

    def open_video(spec: str, shown: str, what: str, open_s: float, **given: str) -> InputContainer:
        seen.update(given, spec=spec)
        return av.open(str(tmp_path / "a.avi"))

    monkeypatch.setattr(device, "opened", open_video)
    return seen


def test_a_device_is_a_source(tmp_path: Path, opened_with: dict[str, str]) -> None:
    path = tmp_path / "video0"
    path.touch()
    settings = CameraSettings((128, 96), Fraction(30), 5000, 0)
    driver = FakeDriver()
    source = device_camera(path, settings, "jpeg", driver)
    assert opened_with == {
        "format": "v4l2", "input_format": "mjpeg", "video_size": "128x96", "framerate": "30",
        "timestamps": "default", "fflags": "+4", "spec": str(path),
    }  # fmt: skip
    about = source.describe()
    assert (about["name"], about["codec"], about["encoding"]) == (
        "HD Pro Webcam C920", "mjpeg", "as it is",
    )  # fmt: skip
    assert (about["exposure"], about["focus"], about["white_balance"]) == ("5000 us", "0", "auto")
    assert (about["size"], about["rate_hz"]) == ("128x96", "30000/1001")
    assert source.name == "video0"
    with av.open(str(tmp_path / "a.avi")) as container:
        packets = [bytes(p) for p in container.demux(video=0) if p.size]
    driver.set.clear()
    with Taker(source) as taken:
        taken.wait_for_message("connection lost after frame 29: the stream ended")
        taken.wait_for(31)
    # Who was unplugged in between has forgotten it.
    assert driver.set.count((v4l2.FOCUS, 0)) == 2
    assert [f.data for f in taken.frames[:30]] == packets


class Unplugged:
    """A connection with one image, then none."""

    def __init__(self) -> None:
        self._image = encoded_image(np.zeros((96, 128), np.uint8), "jpeg")
        self.left = 1
        self.closed = threading.Event()

    def receive(self) -> Received | None:
        if not self.left:
            raise ConnectionLost("no such device")
        self.left -= 1
        return Received(self._image, time.time_ns())

    def describe(self) -> dict[str, str]:
        return {"clock": ARRIVAL}

    def interrupt(self) -> None: ...

    def close(self) -> None:
        self.closed.set()


def test_a_lost_device_is_closed_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """While it is held open, a camera that is plugged in again gets another number."""
    monkeypatch.setattr(stream, "_FIRST_PAUSE_S", 60.0)
    made: list[Unplugged] = []

    def connect() -> Unplugged:
        made.append(Unplugged())
        return made[-1]

    with Taker(stream.LiveCamera("video0", "/dev/video0", connect, {})) as taken:
        taken.wait_for_message("connection lost after frame 0: no such device")
        assert made[1].closed.wait(5)
        assert len(made) == 2


def test_where_there_are_no_such_devices_none_are_listed() -> None:
    script = (
        "import sys; sys.modules['fcntl'] = None\n"  # as on Windows
        "from recorder.sources.live.listing import found_cameras, listing_text\n"
        "print(listing_text(found_cameras([])))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT)
    assert done.stdout.startswith("no camera found"), done.stderr


def test_autofocus_is_warned_of(tmp_path: Path, opened_with: dict[str, str]) -> None:
    path = tmp_path / "video0"
    path.touch()
    source = device_camera(path, CameraSettings(), "jpeg", FakeDriver())
    # Before the first frame on the screen, and in the log.
    assert "autofocus is on" in (source.preparation() or "")
    with Taker(source) as taken:
        taken.wait_for(1)
    assert taken.items[0] == taken.events[0]
    assert taken.events[0].level == "warning"
    assert "autofocus is on" in taken.messages[0]


def test_a_mode_that_the_driver_changes_is_said(
    tmp_path: Path, opened_with: dict[str, str]
) -> None:
    path = tmp_path / "video0"
    path.touch()
    with pytest.raises(InputError, match="expected images of 1920x1080, found 128x96"):
        device_camera(path, CameraSettings((1920, 1080)), "jpeg", FakeDriver())


@pytest.mark.parametrize(
    ("asked", "words"),
    [("30", None), ("30000/1001", None), ("40", "expected 40 frames/s, found 29.97 at this size")],
)
def test_a_rate_that_the_driver_changes_is_said(
    tmp_path: Path, opened_with: dict[str, str], asked: str, words: str | None
) -> None:
    path = tmp_path / "video0"
    path.touch()
    settings = CameraSettings(rate_hz=Fraction(asked))
    if words is None:
        assert device_camera(path, settings, "jpeg", FakeDriver()).describe()["rate_hz"]
        return
    with pytest.raises(InputError, match=words):
        device_camera(path, settings, "jpeg", FakeDriver())


def test_arrival_of_pixels_is_not_called_late(tmp_path: Path) -> None:
    """They are whole when they arrive; of a codec, the next frame shows where one ends."""
    make_video(tmp_path / "raw.avi", "rawvideo", 3)
    connection = ContainerConnection(av.open(str(tmp_path / "raw.avi")), KernelStamps(), "jpeg")
    assert connection.receive() is not None
    assert connection.describe()["codec"] == "rawvideo"
    assert connection.describe()["clock"] == ARRIVAL
    connection.close()


def test_jpeg_is_asked_for_where_it_has_the_size(
    tmp_path: Path, opened_with: dict[str, str]
) -> None:
    """Many cameras give their largest or smallest images uncompressed only."""
    path = tmp_path / "video0"
    path.touch()
    driver = FakeDriver()
    driver.sizes = {MJPG: [(1920, 1080), (640, 480)], YUYV: [(640, 480), (128, 96)]}
    device_camera(path, CameraSettings((128, 96)), "jpeg", driver)
    assert "input_format" not in opened_with
    device_camera(path, CameraSettings(), "jpeg", driver)
    assert opened_with["input_format"] == "mjpeg"


def test_ffmpeg_knows_the_options_of_a_device(tmp_path: Path) -> None:
    """It opens the device, and only then finds that it is none; an option is refused before."""
    path = tmp_path / "video0"
    path.touch()
    if "video4linux2,v4l2" not in av.formats_available:
        pytest.skip("PyAV without V4L2")
    settings = CameraSettings((128, 96), Fraction(30))
    with pytest.raises(InputError, match="inappropriate ioctl"):
        device_camera(path, settings, "jpeg", FakeDriver())


def test_errors_of_ffmpeg_are_said_in_words() -> None:
    assert av_reason(av.error.ArgumentError(22, "Invalid argument")) == "invalid argument"
    assert av_reason(OSError(19, "No such device")) == "no such device"
    assert av_reason(ValueError("rtsp://user:password@host")) == "valueerror"


def test_pixel_formats_have_names_of_letters() -> None:
    """A driver marks what is big-endian in the top bit of the fourth letter."""
    driver = FakeDriver()
    big_endian = int.from_bytes(b"Y16 ", "little") | 1 << 31
    driver.sizes = {YUYV: [(640, 480)], big_endian: [(640, 480)]}
    found = found_cameras([Path("/dev/null")], driver)
    assert [mode.pixel_format for mode in found[0].modes] == ["YUYV", "Y16-BE"]
    assert [line[:18] for line in listing_text(found).splitlines()[1:3]] == [
        "  YUYV     640x480", "  Y16-BE   640x480",
    ]  # fmt: skip


def test_what_is_no_camera_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected a camera, found: no such file"):
        open_source("/dev/video99")
    with pytest.raises(InputError, match="expected a camera, found: inappropriate ioctl"):
        open_source("/dev/null")
    metadata_only = FakeDriver()
    metadata_only.capabilities = 0x84A00001, 0x04A00000
    with pytest.raises(InputError, match="found a device without images"):
        device_camera(Path("/dev/null"), CameraSettings(), "jpeg", metadata_only)
    planes = FakeDriver()
    planes.capabilities = 0x85201000, 0x05201000
    with pytest.raises(InputError, match="one with the multi-planar interface only"):
        device_camera(Path("/dev/null"), CameraSettings(), "jpeg", planes)
    assert "multi-planar" in listing_text(found_cameras([Path("/dev/null")], planes))


def packet_at(stamp_ns: int | None, data: bytes = b"x", *, is_corrupt: bool = False) -> AvPacket:
    packet: Any = av.Packet(data)
    packet.time_base = Fraction(1, 10**6)
    packet.pts = None if stamp_ns is None else stamp_ns // 1000
    packet.is_corrupt = is_corrupt
    return cast(AvPacket, packet)


GOOD = encoded_image(np.random.default_rng(2).integers(0, 256, (48, 64), np.uint8), "jpeg")
# Of a buffer that the driver flags, FFmpeg leaves the stamp and no bytes.
FLAGGED = b""
HALF = GOOD[: len(GOOD) // 2]


def connection_of(*packets: AvPacket) -> ContainerConnection:
    """A device that has these, and is then unplugged."""
    left = iter(packets)
    codec = SimpleNamespace(name="mjpeg")
    streams = SimpleNamespace(video=[SimpleNamespace(codec_context=codec, average_rate=30)])
    container: Any = SimpleNamespace(streams=streams, demux=lambda stream: left, close=lambda: None)
    return ContainerConnection(cast(InputContainer, container), KernelStamps(), "jpeg")


def packets_of(*images: bytes) -> list[AvPacket]:
    now_ns = time.monotonic_ns() - 10**9
    return [packet_at(now_ns + i * 10**7, data) for i, data in enumerate(images)]


def test_damaged_images_of_a_device_are_in_the_log_and_counted(tmp_path: Path) -> None:
    """As USB cameras give them when they begin; the recording begins all the same."""
    other_size = encoded_image(np.zeros((96, 128), np.uint8), "jpeg")[:-2]
    given = [FLAGGED, HALF, GOOD, FLAGGED, *[GOOD] * 3, HALF]
    connections = [
        connection_of(*packets_of(FLAGGED, HALF, other_size, GOOD)),
        connection_of(*packets_of(*given)),
    ]

    def connect() -> ContainerConnection:
        if not connections:
            raise InputError("video0", "expected a camera, found: no such device")
        return connections.pop(0)

    source = stream.LiveCamera("video0", "/dev/video0", connect, {})
    assert source.image_size == (64, 48)
    with Taker(source) as taken:
        taken.wait_for_message("connection lost after frame 7")
    assert [f.data for f in taken.frames] == given
    assert [f.frame_index for f in taken.frames] == list(range(8))
    assert sum(e.dropped for e in taken.events) == 0
    path = tmp_path / "log.mcap"
    summary = record(LiveScript(taken.items), path)
    counts = summary.counts
    assert (counts.written, counts.dropped, counts.corrupt) == (8, 0, 4)
    assert "0 dropped, " in summary_text(summary)
    assert "4 corrupt" in summary_text(summary)
    with LogReader(path) as log:
        assert [i.data for i in images(log)] == given
    assert [e.message for e in events_of(path) if e.message.startswith("frame")] == [
        "frame 0 is empty", "frame 1 is a jpeg image without its end", "frame 3 is empty",
        "frame 7 is a jpeg image without its end",
    ]  # fmt: skip
    assert end_of(path).items() >= counts.as_metadata().items()
    info = log_info(path)
    assert (info.images.count, info.recorded["frames_corrupt"], info.images.missing) == (8, 4, 0)
    assert (info.images.width_px, info.images.height_px) == (64, 48)
    rules = {verdict.rule: verdict for verdict in verify([path]).rules}
    assert (rules["counts"].level, rules["gaps"].level) == ("ok", "ok")
    assert rules["images"].values["frames_corrupt"] == 4


def test_bytes_that_are_flagged_are_kept_and_judged_by_what_they_are() -> None:
    """Who reads the log has no flag: recorder, `verify` and replay count the same."""
    stamp_ns = time.monotonic_ns()
    connection = connection_of(
        packet_at(stamp_ns, GOOD, is_corrupt=True), packet_at(stamp_ns, GOOD)
    )
    source = stream.LiveCamera("video0", "/dev/video0", lambda: connection, {})
    connection = connection_of(packet_at(stamp_ns, GOOD, is_corrupt=True))
    with Taker(source) as taken:
        taken.wait_for(1)
    assert taken.frames[0].data == GOOD
    told = taken.events[0]
    assert (told.message, told.dropped) == ("frame 0 was damaged on its way, says FFmpeg", 0)


def test_a_camera_without_a_whole_image_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "_LOOK_S", 0.1)

    class Cut(Unplugged):
        def receive(self) -> Received:
            return Received(HALF, time.time_ns())

    words = r"expected a whole image within 0.1 s, found: a jpeg image without its end"
    with pytest.raises(InputError, match=words):
        stream.LiveCamera("video0", "/dev/video0", Cut, {})


def test_kernel_stamps_become_system_time() -> None:
    stamps = KernelStamps()
    monotonic_ns, system_ns = time.monotonic_ns(), time.time_ns()
    stamps.learn(packet_at(monotonic_ns - 30_000_000))
    assert "CLOCK_MONOTONIC" in stamps.name
    found_ns = stamps.capture_ns(monotonic_ns - 30_000_000)
    assert found_ns is not None
    assert abs(found_ns - (system_ns - 30_000_000)) < 5_000_000
    # Intervals are the kernel's, to the nanosecond.
    later_ns = stamps.capture_ns(monotonic_ns + 3_333_333)
    assert later_ns == found_ns + 33_333_333


def test_other_clocks_are_told_apart() -> None:
    system_ns = time.time_ns()
    system = kernel_clock(system_ns - 10_000_000)
    assert system is not None
    assert (system.offset_ns, "CLOCK_REALTIME" in system.name) == (0, True)
    assert kernel_clock(system_ns - 3600 * 10**9) is None
    stamps = KernelStamps()
    stamps.learn(packet_at(5))
    assert stamps.name == ARRIVAL
    assert stamps.capture_ns(5) is None


def test_cameras_are_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    found = found_cameras([Path("/dev/null"), Path("/dev/video99")], FakeDriver())
    lines = listing_text(found).splitlines()
    assert lines[0] == "/dev/null: HD Pro Webcam C920 (uvcvideo, usb-1)"
    assert lines[1] == "  MJPG 1920x1080  at 30, 15, 7.5 frames/s"
    assert lines[4:] == [
        "  exposure: auto", "  focus: auto", "  white balance: auto",
        "/dev/video99: no such file or directory",
    ]  # fmt: skip
    listing = "recorder.sources.live.listing.found_cameras"
    monkeypatch.setattr(listing, lambda: found[:1])
    shown = json.loads(CliRunner().invoke(cameras, ["--json"]).stdout)
    assert shown[0]["modes"][0] == {
        "pixel_format": "MJPG", "width_px": 1920, "height_px": 1080, "rates_hz": [30, 15, 7.5],
    }  # fmt: skip
    monkeypatch.setattr(listing, list)
    result = CliRunner().invoke(cameras)
    assert (result.exit_code, "no camera found" in result.stdout) == (0, True)
    assert CliRunner().invoke(cameras, ["--json"]).stdout == "[]\n"


def test_settings_are_read_from_texts() -> None:
    assert parse_size("1920x1080") == (1920, 1080)
    assert parse_rate("30000/1001") == Fraction(30000, 1001)
    assert [parse_exposure(t) for t in ("5ms", "500us", "1/200s", "0.01 s", "auto")] == [
        5000, 500, 5000, 10000, "auto",
    ]  # fmt: skip
    assert (parse_number_or_auto("0"), parse_number_or_auto("auto")) == (0, "auto")
    for parse, texts in (
        (parse_size, ("1920", "1920x", "0x5", "-1x5")),
        (parse_rate, ("0", "x", "1/0", "-3")),
        (parse_exposure, ("5", "0ms", "ms", "-5ms", "1/0s")),
        (parse_number_or_auto, ("-1", "", "1.5", "on")),
    ):
        for text in texts:
            with pytest.raises(ValueError, match="expected"):
                parse(text)


@pytest.mark.parametrize(
    ("spec", "options", "words"),
    [
        ("http://h/", SourceOptions(camera=CameraSettings(focus=0)), "no --focus for an MJPEG"),
        ("rtsp://h/", SourceOptions(camera=CameraSettings(exposure_us=5)), "no --exposure for a"),
        ("http://h/", SourceOptions(encoding="png"), "no --encoding for an MJPEG stream"),
        ("/dev/video0", SourceOptions(fps=Fraction(3)), "no --fps for a device"),
        ("/dev/video0", SourceOptions(topic="/t"), "no --topic for a device"),
        ("ftp://h/", SourceOptions(), "expected an http://, https:// or rtsp:// URL, found ftp"),
    ],
)
def test_options_that_do_not_apply_are_refused(
    spec: str, options: SourceOptions, words: str
) -> None:
    with pytest.raises(InputError, match=words):
        open_source(spec, options)
