"""From what a person names as SOURCE to a source."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from decimal import Decimal, InvalidOperation
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from recorder.errors import InputError

if TYPE_CHECKING:
    from recorder.sources.base import Source

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True)
class SourceOptions:
    """What a person may say about a source.

    Attributes:
        start_ns: capture time of time 0 in a file.
        fps: images a second in a folder of images; 1 when nothing is said.
        encoding: of video that is not JPEG already.
    """

    start_ns: int | None = None
    fps: Fraction | None = None
    encoding: Literal["jpeg", "png"] | None = None


def open_source(spec: str, options: SourceOptions | None = None) -> Source:
    """The source that `spec` names: a folder, an image, a video, a scene.yaml or a shipped scene.

    Raises:
        InputError: it is none of them, or an option does not apply to it.
    """
    options = options or SourceOptions()
    if "://" in spec or spec.startswith("/dev/"):
        raise InputError(
            spec, "expected a video, a folder of images or a scene.yaml; devices and streams "
            "are not supported yet: record them to a video file first",
        )  # fmt: skip
    path = Path(spec)
    if path.is_dir():
        return _images(path, options)
    if not path.exists():
        return _shipped_scene(path, options)
    suffix = path.suffix.lower()
    if suffix in (".yaml", ".yml"):
        return _scene(path, options)
    if suffix == ".mcap":
        raise InputError(
            path, "expected a video, a folder of images or a scene.yaml, found a log (replay it)"
        )
    from recorder.sources.images import IMAGE_SUFFIXES

    if suffix in IMAGE_SUFFIXES:
        return _images(path, options)
    from recorder.sources.video import VideoSource

    _reject(path, "a video", fps=options.fps)
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


def _images(path: Path, options: SourceOptions) -> Source:
    from recorder.sources.images import ImagesSource

    _reject(path, "images", encoding=options.encoding)
    return ImagesSource(path, fps=options.fps or Fraction(1), start_ns=options.start_ns or 0)


def _scene(path: Path, options: SourceOptions) -> Source:
    from recorder.simulation.source import SceneSource

    _reject(path, "a scene", fps=options.fps, start=options.start_ns, encoding=options.encoding)
    return SceneSource(path)


def _shipped_scene(path: Path, options: SourceOptions) -> Source:
    from recorder.simulation.scene_file import shipped_scenes

    shipped = shipped_scenes()
    if str(path) in shipped:
        return _scene(shipped[str(path)], options)
    scenes = f" (scenes that come along: {', '.join(shipped)})" if shipped else ""
    raise InputError(
        path, f"expected a video, a folder of images or a scene.yaml, found nothing there{scenes}"
    )


def _reject(path: Path, what: str, **options: object) -> None:
    for name, value in options.items():
        if value is not None:
            raise InputError(path, f"expected no --{name} for {what}, found {value}")
