"""A video file as a source."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import UTC, datetime, timedelta
from fractions import Fraction
from pathlib import Path

import av
from av.container import InputContainer
from av.packet import Packet
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from recorder.errors import InputError
from recorder.sources.base import CapturedFrame, SourceEvent
from recorder.sources.encoding import Encoding, encoded_image

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


class VideoSource:
    """The first video stream of a file; what is JPEG in it keeps its bytes.

    Other codecs are decoded, and encoded as JPEG of quality 95 or as PNG. Capture is the frame's
    time stamp in the file plus the start: the one given, else the container's creation time, else
    0. A frame that cannot be read leaves a gap in the frame numbers and an event; what a trimmed
    file holds and does not show is not part of it.
    """

    def __init__(
        self, path: Path, *, start_ns: int | None = None, encoding: Encoding = "jpeg"
    ) -> None:
        """Reads what the container says of itself.

        Raises:
            InputError: not a video.
        """
        self.name = path.stem
        self._path = path
        self._encoding = encoding
        with self._open() as container:
            stream = _video_stream(container)
            if stream is None or not stream.codec_context.width:
                raise InputError(path, "expected a video, found no video stream in it")
            self._codec = stream.codec_context.name
            self._size = (stream.codec_context.width, stream.codec_context.height)
            self._frame_count = _frame_count(container, stream)
            self._rate = stream.average_rate
            created_ns = _creation_time_ns({**stream.metadata, **container.metadata})
        self._start_ns = created_ns if start_ns is None else start_ns

    def describe(self) -> dict[str, str]:
        return {
            "kind": "video",
            "name": self._path.name,
            "codec": self._codec,
            "encoding": "as it is" if self._passes_through else self._encoding,
            "start_ns": str(self._start_ns),
        }

    @property
    def attachments(self) -> Mapping[str, bytes]:
        return {}

    @property
    def image_size(self) -> tuple[int, int]:
        return self._size

    def frame_count(self) -> int | None:
        return self._frame_count

    def preparation(self) -> str | None:
        return None

    @property
    def _passes_through(self) -> bool:
        return self._codec == "mjpeg"

    def frames(self) -> Iterator[CapturedFrame | SourceEvent]:
        with self._open() as container:
            stream = _video_stream(container)
            if stream is None:
                return
            pictures = self._packets if self._passes_through else self._decoded
            yield from pictures(container, stream)

    def _packets(
        self, container: InputContainer, stream: VideoStream
    ) -> Iterator[CapturedFrame | SourceEvent]:
        last_ns = self._start_ns
        packets = (p for p in _demuxed(container, stream) if p is None or not p.is_discard)
        for index, packet in enumerate(packets):
            if packet is None or packet.is_corrupt or not packet.size:
                yield _lost(last_ns, index)
                continue
            last_ns = self._capture_ns(packet.pts, packet.time_base, index)
            yield CapturedFrame(index, last_ns, last_ns, bytes(packet), "jpeg")

    def _decoded(
        self, container: InputContainer, stream: VideoStream
    ) -> Iterator[CapturedFrame | SourceEvent]:
        last_ns = self._start_ns
        index = 0
        # Packets and images do not match one to one: a field may be a packet, and what an edit
        # list leaves out is decoded for the sake of what follows. So only errors count as losses.
        for packet in _demuxed(container, stream, flush=True):
            try:
                pictures = packet.decode() if packet is not None else None
            except av.error.FFmpegError:
                pictures = None
            if pictures is None:
                yield _lost(last_ns, index)
                index += 1
                continue
            for picture in pictures:
                if not isinstance(picture, VideoFrame) or picture.is_corrupt:
                    yield _lost(last_ns, index)
                else:
                    last_ns = self._capture_ns(picture.pts, picture.time_base, index)
                    data = encoded_picture(picture, self._encoding)
                    yield CapturedFrame(index, last_ns, last_ns, data, self._encoding)
                index += 1

    def _capture_ns(self, pts: int | None, time_base: Fraction | None, index: int) -> int:
        if pts is not None and time_base is not None:
            offset_s = pts * time_base
        elif self._rate:
            offset_s = index / self._rate
        else:
            raise InputError(self._path, "expected time stamps or a frame rate, found neither")
        timestamp_ns = self._start_ns + round(offset_s * 10**9)
        if not 0 <= timestamp_ns < 2**63:
            raise InputError(
                self._path, "expected times from 1970 to 2262, found others (--start moves them)"
            )
        return timestamp_ns

    def _open(self) -> InputContainer:
        try:
            return av.open(str(self._path), mode="r")
        except FileNotFoundError as error:
            raise InputError(self._path, "expected a video, found no file") from error
        except (av.error.FFmpegError, OSError, ValueError) as error:
            raise InputError(self._path, "expected a video, found something else") from error


def encoded_picture(picture: VideoFrame, encoding: Encoding) -> bytes:
    """A decoded picture as JPEG of quality 95 or as PNG."""
    return encoded_image(picture.to_ndarray(format="bgr24"), encoding)


def _video_stream(container: InputContainer) -> VideoStream | None:
    return container.streams.video[0] if container.streams.video else None


def _frame_count(container: InputContainer, stream: VideoStream) -> int | None:
    """As the container says, without what its edit list leaves out."""
    if stream.frames and "mp4" in container.format.name.split(","):
        # Not in every PyAV that will do; without it the number is a little too high.
        entries = getattr(stream, "index_entries", ())
        return sum(not entry.is_discard for entry in entries) or stream.frames
    return stream.frames or None


def _demuxed(
    container: InputContainer, stream: VideoStream, flush: bool = False
) -> Iterator[Packet[VideoStream] | None]:
    """The packets of the stream, None for what cannot be read; `flush` adds the empty last one."""
    packets = container.demux(stream)
    while True:
        try:
            packet = next(packets)
        except (StopIteration, av.error.EOFError):
            return
        except av.error.FFmpegError:
            # A container that is damaged here cannot be read on.
            yield None
            return
        if packet.size or flush or packet.pts is not None:
            yield packet


def _lost(timestamp_ns: int, index: int) -> SourceEvent:
    return SourceEvent(timestamp_ns, "warning", f"frame {index} is corrupt", dropped=1)


def _creation_time_ns(metadata: Mapping[str, str]) -> int:
    """The container's creation time; 0 where there is none, or a nonsense one before 1970."""
    try:
        created = datetime.fromisoformat(metadata.get("creation_time", ""))
    except ValueError:
        return 0
    if created.tzinfo is None:
        created = created.replace(tzinfo=UTC)
    return max(0, (created - _EPOCH) // timedelta(microseconds=1) * 1000)
