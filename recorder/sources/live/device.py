"""A camera that Linux has under /dev."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from fractions import Fraction
from pathlib import Path

from recorder.errors import InputError
from recorder.sources.encoding import Encoding
from recorder.sources.live import clock, v4l2
from recorder.sources.live.container import AvPacket, ContainerConnection, opened
from recorder.sources.live.settings import Auto, CameraSettings
from recorder.sources.live.stream import LiveCamera

_OPEN_S = 10.0
# AVFMT_FLAG_NONBLOCK, which FFmpeg has no word for: else a read waits for a camera that is stuck.
_NONBLOCK = "+4"
_SAME_RATE = 0.01
ONLY_PLANES = "one with the multi-planar interface only, which cannot be read"


class KernelStamps:
    """Capture times from the stamps that the driver puts on its buffers."""

    def __init__(self) -> None:
        self.name = clock.ARRIVAL
        self._clock: clock.KernelClock | None = None
        self._learned = False

    def learn(self, packet: AvPacket) -> None:
        """The clock, from the first stamp."""
        if not self._learned and packet.pts is not None:
            self._learned = True
            self._clock = clock.kernel_clock(round(packet.pts * packet.time_base * 10**9))
            self.name = self._clock.name if self._clock else clock.ARRIVAL

    def capture_ns(self, time_ns: int | None) -> int | None:
        return time_ns + self._clock.offset_ns if self._clock and time_ns is not None else None


def device_camera(
    path: Path, settings: CameraSettings, encoding: Encoding, ioctl: v4l2.Ioctl | None = None
) -> LiveCamera:
    """The camera at `path`, set as `settings` say; the log is told what it is set to then.

    Raises:
        InputError: it cannot be opened, or does not have what is to be set.
    """
    about, gives_jpeg = _configured(path, settings, ioctl)
    options = {"format": "v4l2", "timestamps": "default", "fflags": _NONBLOCK}
    if gives_jpeg:
        options["input_format"] = "mjpeg"
    if settings.size:
        options["video_size"] = f"{settings.size[0]}x{settings.size[1]}"
    if settings.rate_hz:
        options["framerate"] = str(settings.rate_hz)

    def connect() -> ContainerConnection:
        # A camera that was unplugged has forgotten its settings.
        _configured(path, settings, ioctl)
        container = opened(str(path), str(path), "a camera", _OPEN_S, **options)
        return ContainerConnection(container, KernelStamps(), encoding)

    camera = LiveCamera(path.name, str(path), connect, about, warnings_of(about))
    _check_mode(camera, settings, path)
    return camera


def _configured(
    path: Path, settings: CameraSettings, ioctl: v4l2.Ioctl | None
) -> tuple[dict[str, str], bool]:
    """Sets the camera; what it is and is set to, and whether it gives JPEG of that size."""
    try:
        with v4l2.Device(path, ioctl) as device:
            if device.only_planes:
                raise InputError(path, f"expected a camera, found {ONLY_PLANES}")
            if not device.captures:
                raise InputError(
                    path, "expected a camera, found a device without images (see: arucolog cameras)"
                )
            set_controls(device, settings, path)
            about = {
                "kind": "v4l2",
                "device": str(path),
                "name": device.card,
                "bus": device.bus,
                "driver": device.driver,
                **controls(device),
            }
            return about, _gives_jpeg(device.modes(), settings.size)
    except OSError as error:
        raise InputError(path, f"expected a camera, found: {_reason(error)}") from error


def set_controls(device: v4l2.Device, settings: CameraSettings, path: Path) -> None:
    """Exposure, focus and white balance; a fixed value turns the automatic off first.

    Raises:
        InputError: the camera has no such control, or not that value.
    """
    exposure = settings.exposure_us
    if exposure is not None:
        automatic = device.control(v4l2.EXPOSURE_AUTO)
        if automatic is None and exposure == "auto":
            raise InputError(path, "expected a camera with automatic exposure, found one without")
        if automatic is not None:
            _set_exposure_mode(device, exposure, path)
        in_units = exposure if exposure == "auto" else max(1, round(exposure / 100))
        _set(device, v4l2.EXPOSURE_100US, in_units, "exposure in units of 0.1 ms", path)
    for value, automatic_id, fixed_id, name in (
        (settings.focus, v4l2.FOCUS_AUTO, v4l2.FOCUS, "focus"),
        (settings.white_balance_k, v4l2.WHITE_BALANCE_AUTO, v4l2.WHITE_BALANCE_K, "white balance"),
    ):
        if value is None:
            continue
        if device.control(automatic_id) is not None:
            device.set_control(automatic_id, int(value == "auto"))
        elif value == "auto":
            raise InputError(path, f"expected a camera with automatic {name}, found one without")
        _set(device, fixed_id, value, name, path)


def controls(device: v4l2.Device) -> dict[str, str]:
    """What the camera is set to, for the log; without what it does not have."""
    found = {}
    for key, automatic_id, fixed_id, scale, unit in (
        ("exposure", v4l2.EXPOSURE_AUTO, v4l2.EXPOSURE_100US, 100, " us"),
        ("focus", v4l2.FOCUS_AUTO, v4l2.FOCUS, 1, ""),
        ("white_balance", v4l2.WHITE_BALANCE_AUTO, v4l2.WHITE_BALANCE_K, 1, " K"),
    ):
        automatic, fixed = device.control(automatic_id), device.control(fixed_id)
        manual = v4l2.EXPOSURE_MANUAL if automatic_id == v4l2.EXPOSURE_AUTO else 0
        if automatic is not None and automatic.value != manual:
            found[key] = "auto"
        elif fixed is not None:
            found[key] = f"{fixed.value * scale}{unit}"
    return found


def warnings_of(about: Mapping[str, str]) -> tuple[str, ...]:
    """What spoils a recording and can be helped."""
    if about.get("focus") != "auto":
        return ()
    return (
        "autofocus is on: refocusing changes the calibration in mid-session (--focus N fixes it)",
    )


def devices() -> list[Path]:
    """The /dev/video* there are, by number."""
    found = [p for p in Path("/dev").glob("video*") if p.name.removeprefix("video").isdecimal()]
    return sorted(found, key=lambda p: int(p.name.removeprefix("video")))


def _set_exposure_mode(device: v4l2.Device, exposure: int | Auto, path: Path) -> None:
    modes = v4l2.EXPOSURE_AUTOMATIC if exposure == "auto" else (v4l2.EXPOSURE_MANUAL,)
    for mode in modes:
        try:
            return device.set_control(v4l2.EXPOSURE_AUTO, mode)
        except OSError as error:
            last = error
    raise InputError(path, f"expected --exposure {exposure} to be taken, found: {_reason(last)}")


def _set(device: v4l2.Device, number: int, value: int | Auto, name: str, path: Path) -> None:
    if value == "auto":
        return
    control = device.control(number)
    if control is None:
        raise InputError(path, f"expected a camera whose {name} can be set, found another one")
    if not control.minimum <= value <= control.maximum:
        raise InputError(
            path, f"expected {name} from {control.minimum} to {control.maximum}, found {value}"
        )
    device.set_control(number, value)


def _gives_jpeg(modes: Iterable[v4l2.Mode], size: tuple[int, int] | None) -> bool:
    """Some cameras have their largest or smallest images uncompressed only."""
    sizes = [(m.width_px, m.height_px) for m in modes if m.pixel_format in ("MJPG", "JPEG")]
    return size in sizes if size and len(sizes) > 1 else bool(sizes)


def _check_mode(camera: LiveCamera, settings: CameraSettings, path: Path) -> None:
    """A driver takes the nearest mode it has without a word.

    Raises:
        InputError: the mode is not the one that was asked for.
    """
    if settings.size and camera.image_size != settings.size:
        found = "x".join(map(str, camera.image_size))
        wanted = "x".join(map(str, settings.size))
        raise InputError(
            path, f"expected images of {wanted}, found {found} (arucolog cameras lists the modes)"
        )
    # Drivers round: 10000000/333333 is a 30.
    rate_hz = Fraction(camera.describe().get("rate_hz", 0))
    if settings.rate_hz and rate_hz and abs(rate_hz / settings.rate_hz - 1) > _SAME_RATE:
        raise InputError(
            path,
            f"expected {float(settings.rate_hz):g} frames/s, found {float(rate_hz):g} at this size"
            " (arucolog cameras lists the modes)",
        )


def _reason(error: OSError) -> str:
    if error.errno is None:
        return str(error)
    return os.strerror(error.errno).lower()
