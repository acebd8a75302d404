"""A live source that PyAV reads: a V4L2 device, an RTSP stream."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping
from fractions import Fraction
from typing import Protocol, TypeAlias

import av
from av.container import InputContainer
from av.packet import Packet
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from recorder.errors import InputError
from recorder.sources.encoding import Encoding
from recorder.sources.live import clock
from recorder.sources.live.stream import ConnectionLost, Received
from recorder.sources.video import encoded_picture

# How long a read may block, and how often a device is asked that does not block.
READ_S = 0.4
_POLL_S = 0.002
_UNDECODED = "cannot be decoded"

AvPacket: TypeAlias = "Packet[VideoStream]"


class StampClock(Protocol):
    """From a container's times to the system's."""

    name: str

    def learn(self, packet: AvPacket) -> None:
        """What a packet says of the clock."""
        ...

    def capture_ns(self, time_ns: int | None) -> int | None:
        """System time of a time in the container, or of the last packet; None: unknown."""
        ...


class ContainerConnection:
    """The first video stream; JPEG stays as it is, all else is decoded and encoded again."""

    def __init__(self, container: InputContainer, stamps: StampClock, encoding: Encoding) -> None:
        self._container = container
        self._stream = container.streams.video[0]
        self._stamps = stamps
        self._encoding = encoding
        self._codec = self._stream.codec_context.name
        self._pending: deque[Received] = deque()
        self._key_seen = False

    def receive(self) -> Received | None:
        until_s = time.monotonic() + READ_S
        while not self._pending:
            packet = self._packet(until_s)
            if packet is None:
                return None
            self._stamps.learn(packet)
            if self._codec == "mjpeg":
                stamp_ns = self._capture_ns(packet.pts, packet.time_base)
                # Of a buffer that a driver flags FFmpeg leaves no bytes: an empty image. Others are
                # judged by what they are: who reads the log sees no flag.
                flagged = packet.is_corrupt and packet.size
                problem = "was damaged on its way, says FFmpeg" if flagged else None
                return Received(bytes(packet), time.time_ns(), stamp_ns, problem=problem)
            self._decode(packet)
        return self._pending.popleft()

    def describe(self) -> Mapping[str, str]:
        as_it_is = self._codec == "mjpeg"
        # A parser sees the end of a frame when the next one begins.
        late = self._stamps.name == clock.ARRIVAL and self._codec not in ("mjpeg", "rawvideo")
        values = {
            "codec": self._codec,
            "encoding": "as it is" if as_it_is else self._encoding,
            "clock": self._stamps.name + (", after decoding, about a frame late" if late else ""),
        }
        if rate := self._stream.average_rate:
            values["rate_hz"] = str(rate)
        return values

    def interrupt(self) -> None:
        """A read ends by itself."""

    def close(self) -> None:
        self._container.close()

    def _packet(self, until_s: float) -> AvPacket | None:
        while True:
            try:
                # One at a time: a demuxer that has raised gives no more.
                packet = next(self._container.demux(self._stream), None)
            except av.error.BlockingIOError:
                if time.monotonic() > until_s:
                    return None
                time.sleep(_POLL_S)
                continue
            except (av.error.ExitError, av.error.TimeoutError):
                return None
            except (av.error.FFmpegError, OSError, ValueError) as error:
                raise ConnectionLost(av_reason(error)) from error
            if packet is None or (not packet.size and packet.pts is None):
                raise ConnectionLost("the stream ended")
            return packet

    def _decode(self, packet: AvPacket) -> None:
        # What comes before the first key frame shows nothing, and is no loss.
        self._key_seen = self._key_seen or packet.is_keyframe
        if not self._key_seen:
            return
        try:
            pictures = packet.decode()
        except (av.error.FFmpegError, ValueError):
            self._pending.append(Received(b"", time.time_ns(), problem=_UNDECODED))
            return
        for picture in pictures:
            stamp_ns = self._capture_ns(picture.pts, picture.time_base)
            arrival_ns = time.time_ns()
            if not isinstance(picture, VideoFrame) or picture.is_corrupt:
                received = Received(b"", arrival_ns, stamp_ns, problem=_UNDECODED)
            else:
                data = encoded_picture(picture, self._encoding)
                received = Received(data, arrival_ns, stamp_ns, self._encoding)
            self._pending.append(received)

    def _capture_ns(self, pts: int | None, time_base: Fraction | None) -> int | None:
        if pts is None or time_base is None:
            return self._stamps.capture_ns(None)
        return self._stamps.capture_ns(round(pts * time_base * 10**9))


def opened(spec: str, shown: str, what: str, open_s: float, **options: str) -> InputContainer:
    """A container with a video stream in it.

    Args:
        shown: `spec` as it may be shown.
        what: what was expected, for the message.

    Raises:
        InputError: there is none.
    """
    format = options.pop("format", None)
    try:
        container = av.open(
            spec, mode="r", format=format, options=options, timeout=(open_s, READ_S)
        )
    except (av.error.FFmpegError, OSError, ValueError) as error:
        raise InputError(shown, f"expected {what}, found: {av_reason(error)}") from error
    if not container.streams.video:
        container.close()
        raise InputError(shown, f"expected {what}, found no video stream in it")
    return container


def av_reason(error: Exception) -> str:
    """Without the URL, which may have a password in it."""
    text = getattr(error, "strerror", None) or type(error).__name__
    return str(text).lower()
