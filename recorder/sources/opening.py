"""From what a person names as SOURCE to a source."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from decimal import Decimal, InvalidOperation
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from recorder.errors import InputError
from recorder.sources.live.settings import CameraSettings

if TYPE_CHECKING:
    from recorder.sources.base import Source

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True)
class SourceOptions:
    """What a person may say about a source.

    Attributes:
        start_ns: capture time of time 0 in a file.
        fps: images a second in a folder of images; 1 when nothing is said.
        encoding: of video that is not JPEG already, and of uncompressed images.
        topic: of a ROS bag.
        camera: how a camera is to be set.
    """

    start_ns: int | None = None
    fps: Fraction | None = None
    encoding: Literal["jpeg", "png"] | None = None
    topic: str | None = None
    camera: CameraSettings = field(default_factory=CameraSettings)


def open_source(spec: str, options: SourceOptions | None = None) -> Source:
    """The source that `spec` names.

    A device, the URL of a stream, a ROS bag, a folder of images, an image, a video, a scene.yaml or
    a shipped scene. A device and a stream are a `LiveSource`.

    Raises:
        InputError: it is none of them, or an option does not apply to it.
    """
    options = options or SourceOptions()
    if "://" in spec or spec.startswith("/dev/"):
        return _live(spec, options)
    path = Path(spec)
    if not path.exists():
        return _shipped_scene(path, options)
    suffix = path.suffix.lower()
    if suffix in (".yaml", ".yml"):
        return _scene(path, options)
    if path.is_dir() or suffix in (".bag", ".active", ".db3", ".mcap"):
        from recorder.sources.bags.bag import is_bag

        if is_bag(path):
            return _bag(path, options)
    if path.is_dir():
        return _images(path, options)
    if suffix == ".mcap":
        raise InputError(
            path, "expected a video, a folder of images or a scene.yaml, found a log (replay it)"
        )
    from recorder.sources.images import IMAGE_SUFFIXES

    if suffix in IMAGE_SUFFIXES:
        return _images(path, options)
    from recorder.sources.video import VideoSource

    _only(path, "a video", options, "start", "encoding")
    return VideoSource(path, start_ns=options.start_ns, encoding=options.encoding or "jpeg")


def parse_start(text: str) -> int:
    """Nanoseconds since the Unix epoch from seconds or an ISO 8601 time (UTC unless it says).

    Raises:
        ValueError: neither of them, or before 1970.
    """
    try:
        start_ns = int((Decimal(text) * 10**9).to_integral_value())
    except (InvalidOperation, OverflowError, ValueError):
        try:
            start = datetime.fromisoformat(text)
        except ValueError as error:
            raise ValueError(
                "expected seconds since 1970 or a time such as 2025-06-01T12:00:00Z, "
                f"found {text!r}"
            ) from error
        if start.tzinfo is None:
            start = start.replace(tzinfo=UTC)
        start_ns = (start - _EPOCH) // timedelta(microseconds=1) * 1000
    if not 0 <= start_ns < 2**63:
        raise ValueError(f"expected a time since 1970, found {text!r}")
    return start_ns


def _live(spec: str, options: SourceOptions) -> Source:
    scheme, separator, _ = spec.partition("://")
    if not separator:
        from recorder.sources.live.device import device_camera

        _only(spec, "a device", options, "encoding", "camera")
        return device_camera(Path(spec), options.camera, options.encoding or "jpeg")
    from recorder.sources.live.http_mjpeg import http_camera, without_password

    shown = without_password(spec)
    if scheme in ("http", "https"):
        _only(shown, "an MJPEG stream", options)
        return http_camera(spec)
    if scheme in ("rtsp", "rtsps"):
        from recorder.sources.live.rtsp import rtsp_camera

        _only(shown, "a stream", options, "encoding")
        return rtsp_camera(spec, options.encoding or "jpeg")
    raise InputError(shown, f"expected an http://, https:// or rtsp:// URL, found {scheme}://")


def _bag(path: Path, options: SourceOptions) -> Source:
    from recorder.sources.bags.source import BagSource

    _only(path, "a ROS bag", options, "topic", "encoding")
    return BagSource(path, topic=options.topic, encoding=options.encoding)


def _images(path: Path, options: SourceOptions) -> Source:
    from recorder.sources.images import ImagesSource

    _only(path, "images", options, "fps", "start")
    return ImagesSource(path, fps=options.fps, start_ns=options.start_ns or 0)


def _scene(path: Path, options: SourceOptions) -> Source:
    from recorder.simulation.source import SceneSource

    _only(path, "a scene", options)
    return SceneSource(path)


def _shipped_scene(path: Path, options: SourceOptions) -> Source:
    from recorder.simulation.scene_file import shipped_scenes

    shipped = shipped_scenes()
    if str(path) in shipped:
        return _scene(shipped[str(path)], options)
    scenes = f" (scenes that come along: {', '.join(shipped)})" if shipped else ""
    raise InputError(
        path,
        "expected a camera, a stream's URL, a video, a folder of images, a ROS bag or a "
        f"scene.yaml, found nothing there{scenes}",
    )


def _only(path: str | Path, what: str, options: SourceOptions, *allowed: str) -> None:
    """Refuses an option that does not apply; `camera` stands for all that can be set on one."""
    given: dict[str, object] = {
        "start": options.start_ns,
        "fps": options.fps,
        "encoding": options.encoding,
        "topic": options.topic,
    }
    for name, value in given.items():
        if value is not None and name not in allowed:
            raise InputError(path, f"expected no --{name} for {what}, found {value}")
    if "camera" not in allowed:
        for name in options.camera.given():
            raise InputError(path, f"expected no --{name} for {what}: it applies to devices")
