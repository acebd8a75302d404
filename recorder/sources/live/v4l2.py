"""What Linux says of a camera and lets one set: a few ioctls of linux/videodev2.h."""

from __future__ import annotations

import errno
import os
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

# The structs, with the padding that they have on every architecture.
_CAPABILITY = struct.Struct("=16s32s32s2I I12x")  # driver, card, bus, version, all, of this node
_FORMAT = struct.Struct("=3I32sI16x")  # index, type, flags, description, pixel format
_FRAME_SIZE = struct.Struct("=3I6I8x")  # index, pixel format, type, width and height or ranges
_INTERVAL = struct.Struct("=5I6I8x")  # index, pixel format, size, type, fraction or ranges
_QUERY = struct.Struct("=2I32s4iI8x")  # id, type, name, minimum, maximum, step, default, flags
_CONTROL = struct.Struct("=Ii")  # id, value


def _iowr(number: int, layout: struct.Struct, *, write: bool = True) -> int:
    """_IOWR('V', number, layout) of asm-generic/ioctl.h, or _IOR."""
    return (3 if write else 2) << 30 | layout.size << 16 | ord("V") << 8 | number


QUERYCAP = _iowr(0, _CAPABILITY, write=False)
ENUM_FMT = _iowr(2, _FORMAT)
G_CTRL = _iowr(27, _CONTROL)
S_CTRL = _iowr(28, _CONTROL)
QUERYCTRL = _iowr(36, _QUERY)
ENUM_FRAMESIZES = _iowr(74, _FRAME_SIZE)
ENUM_FRAMEINTERVALS = _iowr(75, _INTERVAL)

WHITE_BALANCE_AUTO = 0x0098090C
WHITE_BALANCE_K = 0x0098091A
EXPOSURE_AUTO = 0x009A0901
EXPOSURE_100US = 0x009A0902
FOCUS = 0x009A090A
FOCUS_AUTO = 0x009A090C

EXPOSURE_MANUAL = 1
# By the driver either the whole exposure is automatic or, on USB cameras, its time (at a fixed
# aperture).
EXPOSURE_AUTOMATIC = (3, 0)

_CAN_CAPTURE = 0x1
_CAN_CAPTURE_PLANES = 0x1000
_HAS_NODE_CAPABILITIES = 0x80000000
_BUFFER_CAPTURE = 1
_DISCRETE = 1
_CONTROL_DISABLED = 0x1
_BIG_ENDIAN = 1 << 31

Ioctl = Callable[[int, int, bytearray], int]


@dataclass(frozen=True)
class Mode:
    """One way a camera can send images.

    Attributes:
        pixel_format: four letters, `-BE` after them for big-endian; `MJPG` is JPEG.
        rates_hz: fastest first; empty where the driver gives a range or nothing.
    """

    pixel_format: str
    width_px: int
    height_px: int
    rates_hz: tuple[float, ...]


@dataclass(frozen=True)
class Control:
    """Something to set, and what it is set to."""

    name: str
    minimum: int
    maximum: int
    default: int
    value: int


class Device:
    """An open /dev/video*; use it in a `with` block.

    Raises:
        OSError: it cannot be opened, or is no V4L2 device.
    """

    def __init__(self, path: Path, ioctl: Ioctl | None = None) -> None:
        self._ioctl = ioctl or _fcntl
        self._fd = os.open(path, os.O_RDWR | os.O_NONBLOCK)
        try:
            data = self._call(QUERYCAP, _CAPABILITY, b"", b"", b"", 0, 0, 0)
        except OSError:
            os.close(self._fd)
            raise
        driver, card, bus, _, everything, here = data
        self.driver, self.card, self.bus = _text(driver), _text(card), _text(bus)
        capabilities = here if everything & _HAS_NODE_CAPABILITIES else everything
        self.captures = bool(capabilities & _CAN_CAPTURE)
        # Another interface, of some cameras on boards; FFmpeg does not speak it.
        self.only_planes = not self.captures and bool(capabilities & _CAN_CAPTURE_PLANES)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        os.close(self._fd)

    def modes(self) -> Iterator[Mode]:
        """By pixel format, as the driver lists them; sizes in steps give the largest only."""
        for entry in self._listed(ENUM_FMT, _FORMAT, _BUFFER_CAPTURE, 0, b"", 0):
            pixel_format: int = entry[4]
            for _, _, kind, *size in self._listed(
                ENUM_FRAMESIZES, _FRAME_SIZE, pixel_format, *[0] * 7
            ):
                width, height = (size[0], size[1]) if kind == _DISCRETE else (size[1], size[4])
                rates_hz = self._rates(pixel_format, width, height)
                yield Mode(_four_letters(pixel_format), width, height, rates_hz)
                if kind != _DISCRETE:
                    break

    def control(self, number: int) -> Control | None:
        """A control and its value; None where the camera has none of that number."""
        try:
            data = self._call(QUERYCTRL, _QUERY, number, 0, b"", 0, 0, 0, 0, 0)
            _, _, name, minimum, maximum, _, default, flags = data
            if flags & _CONTROL_DISABLED:
                return None
            _, value = self._call(G_CTRL, _CONTROL, number, 0)
        except OSError as error:
            if error.errno in (errno.EINVAL, errno.ENOTTY):
                return None
            raise
        return Control(_text(name), minimum, maximum, default, value)

    def set_control(self, number: int, value: int) -> None:
        self._call(S_CTRL, _CONTROL, number, value)

    def _rates(self, pixel_format: int, width: int, height: int) -> tuple[float, ...]:
        listed = self._listed(ENUM_FRAMEINTERVALS, _INTERVAL, pixel_format, width, height, *[0] * 7)
        rates = {i[6] / i[5] for i in listed if i[4] == _DISCRETE and i[5]}
        return tuple(sorted(rates, reverse=True))

    def _listed(
        self, request: int, layout: struct.Struct, *values: int | bytes
    ) -> Iterator[tuple[int, ...]]:
        """What a driver lists by index, until it says that there is no more."""
        for index in range(1000):
            try:
                yield self._call(request, layout, index, *values)
            except OSError as error:
                if error.errno in (errno.EINVAL, errno.ENOTTY):
                    return
                raise

    def _call(self, request: int, layout: struct.Struct, *values: int | bytes) -> tuple[int, ...]:
        data = bytearray(layout.pack(*values))
        self._ioctl(self._fd, request, data)
        return layout.unpack(data)


def _fcntl(fd: int, request: int, data: bytearray) -> int:
    import fcntl  # not on Windows

    return int(fcntl.ioctl(fd, request, data, True))


def _four_letters(pixel_format: int) -> str:
    letters = (pixel_format & ~_BIG_ENDIAN).to_bytes(4, "little").decode("ascii", "replace")
    return letters.rstrip() + ("-BE" if pixel_format & _BIG_ENDIAN else "")


def _text(data: bytes | int) -> str:
    return data.split(b"\0")[0].decode("utf-8", "replace") if isinstance(data, bytes) else ""
