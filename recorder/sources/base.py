"""What every source of frames gives the recorder."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol

from pipeline.geometry import Pose


@dataclass(frozen=True, eq=False)
class CapturedFrame:
    """One compressed image as its source gave it.

    Attributes:
        frame_index: the source's own number; a gap in it is a dropped frame.
        timestamp_ns: capture, nanoseconds since the Unix epoch.
        arrival_ns: arrival at the recorder; equal to the capture for sources that are files.
        data: the compressed image.
        format: `jpeg`, `png` or `webp`.
        T_map_camera: the camera's exact pose, where the source knows it.
    """

    frame_index: int
    timestamp_ns: int
    arrival_ns: int
    data: bytes
    format: str
    T_map_camera: Pose | None = None


@dataclass(frozen=True)
class SourceEvent:
    """Something a source has to say for the log: a frame it could not read, a camera error.

    Attributes:
        timestamp_ns: capture time of the frame concerned, else of the last good one.
        level: `info`, `warning` or `error`.
        dropped: how many frames were lost with it.
        connected: of a live source: False when it was lost with this, True when it is back.
        silent_s: with `connected`, how long nothing had come by then.
    """

    timestamp_ns: int
    level: str
    message: str
    dropped: int = 0
    connected: bool | None = None
    silent_s: float = 0.0


class Source(Protocol):
    """A camera, or something that stands for one."""

    name: str  # the stem of default log names

    def describe(self) -> dict[str, str]:
        """What it is and how it was set, for the session metadata; the same on every call."""
        ...

    @property
    def attachments(self) -> Mapping[str, bytes]:
        """`camera.yaml`, `map.yaml`, `truth.yaml` where the source brings them."""
        ...

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height in pixels, the same for every frame."""
        ...

    def frame_count(self) -> int | None:
        """How many frames `frames` will give, where that is known before."""
        ...

    def preparation(self) -> str | None:
        """What a person should know before the first frame, such as that it will take long."""
        ...

    def frames(self) -> Iterator[CapturedFrame | SourceEvent]:
        """The frames in the order of capture, and between them what went wrong."""
        ...


class LiveSource(Source, Protocol):
    """A source that does not wait: what is not taken in time is lost.

    `frames` blocks until the next frame, in a thread of its own. Capture times are those of the
    clock that `describe()["clock"]` names; arrivals are of the system clock.
    """

    def stop(self) -> None:
        """From another thread: let `frames` end, within a second, also while nothing arrives."""
        ...
