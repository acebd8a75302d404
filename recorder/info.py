"""What is in a log."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from recorder.bench.marks import Mark, MarkReader
from recorder.errors import InputError
from recorder.image_header import read_header
from recorder.log import topics
from recorder.log.counts import said_counts
from recorder.log.reader import LogReader
from recorder.log.records import ExactPose, LogEvent, LogImage
from recorder.usual_interval import usual_interval_ns

T = TypeVar("T")

# A pause longer than this many usual intervals is a gap.
_GAP_FACTOR = 1.5
_EVENTS_KEPT = 100
# In whose name marks and notes are.
OPERATOR = "operator"


@dataclass(frozen=True)
class Gap:
    """Frames missing, or a pause, between two images.

    Attributes:
        after_frame: number of the last image before it.
        at_s: its capture, in seconds of the log.
        pause_s: to the next image.
        missing: frame numbers left out.
    """

    after_frame: int
    at_s: float
    pause_s: float
    missing: int


@dataclass(frozen=True)
class ImageInfo:
    """The images of a log; width and height are None where no header could be read."""

    count: int
    width_px: int | None
    height_px: int | None
    formats: dict[str, int]
    bytes: int
    first_timestamp_ns: int | None
    duration_s: float
    rate_hz: float | None
    missing: int
    gaps: tuple[Gap, ...]


@dataclass(frozen=True)
class CameraInfo:
    """The calibration of a log."""

    name: str
    width_px: int
    height_px: int
    distortion_model: str
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float


@dataclass(frozen=True)
class MapInfo:
    """The marker map of a log."""

    frame: str
    dictionary: str
    markers: int
    sizes_m: tuple[float, ...]


@dataclass(frozen=True)
class TruthInfo:
    """The ground truth of a log; `exact_poses` counts those on /truth/exact."""

    method: str | None
    path_points: int
    stood_poses: int
    trajectory_poses: int
    exact_poses: int
    waypoints: int = 0


@dataclass(frozen=True)
class LogInfo:
    """Everything `arucolog info` tells.

    Attributes:
        ended: as `LogReader.ending`.
        shortfall: why it is not whole; None where it is.
        problems: what is wrong with the files in the log.
        events: the first hundred, and of those behind them the operator's.
        recorded: what the recorder said when it ended: its counts, and lost connections.
        marks: of waypoints, by the operator; those undone too.
    """

    path: str
    bytes: int
    ended: str
    shortfall: str | None
    images: ImageInfo
    camera: CameraInfo | None
    map: MapInfo | None
    truth: TruthInfo | None
    events_by_level: dict[str, int]
    events: tuple[dict[str, Any], ...]
    problems: tuple[str, ...]
    session: dict[str, str]
    marks: tuple[Mark, ...] = ()
    recorded: dict[str, Any] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def log_info(path: Path) -> LogInfo:
    """Read a log once and say what is in it.

    Raises:
        InputError: not a log.
    """
    with LogReader(path) as log:
        images = ImageCounter(log.start_ns or 0)
        levels: Counter[str] = Counter()
        events: list[dict[str, Any]] = []
        marks = MarkReader(log.start_ns or 0)
        exact = 0
        for record in log.records():
            if isinstance(record, LogImage):
                images.add(record)
            elif isinstance(record, ExactPose):
                exact += 1
            elif isinstance(record, LogEvent):
                levels[record.level] += 1
                marks.add(record.timestamp_ns, record.message)
                if len(events) < _EVENTS_KEPT or record.name == OPERATOR:
                    at_s = (record.timestamp_ns - (log.start_ns or 0)) / 1e9
                    events.append(
                        {
                            "at_s": at_s,
                            "level": record.level,
                            "text": record.message,
                            "by": record.name,
                        }
                    )
        problems: list[str] = []
        return LogInfo(
            path=str(path),
            bytes=path.stat().st_size,
            ended=log.ending,
            shortfall=log.shortfall,
            images=images.info(),
            camera=_try(lambda: _camera(log), problems),
            map=_try(lambda: _map(log), problems),
            truth=_try(lambda: _truth(log, exact), problems),
            events_by_level=dict(levels),
            events=tuple(events),
            problems=tuple(dict.fromkeys(problems)),
            session=dict(log.metadata.get(topics.SESSION, {})),
            marks=marks.marks,
            recorded=_recorded(log.metadata.get(topics.SESSION_END, {})),
        )


class ImageCounter:
    """Counts images as they go by, in 16 bytes for each: a log may have millions."""

    def __init__(self, start_ns: int) -> None:
        self._start_ns = start_ns
        self._indices = array("q")
        self._times_ns = array("q")
        self._formats: Counter[str] = Counter()
        self._bytes = 0
        self._size: tuple[int | None, int | None] = (None, None)

    def add(self, image: LogImage) -> None:
        self._indices.append(image.frame_index)
        self._times_ns.append(image.timestamp_ns)
        self._formats[image.format] += 1
        self._bytes += len(image.data)
        if self._size[0] is None and (header := read_header(image.data)):
            self._size = (header.width_px, header.height_px)

    def info(self) -> ImageInfo:
        times_ns = np.array(self._times_ns, dtype=np.int64)
        steps_ns = np.diff(times_ns)
        numbers = np.maximum(np.diff(np.array(self._indices, dtype=np.int64)), 1)
        missing = numbers - 1
        usual_ns = usual_interval_ns(
            steps_ns.astype(np.float64), numbers, np.ones(len(steps_ns), dtype=bool)
        )
        if usual_ns is None:
            usual_ns = float(np.median(steps_ns)) if len(steps_ns) else 0.0
        gaps = np.flatnonzero((missing > 0) | (steps_ns > _GAP_FACTOR * usual_ns))
        duration_s = float(np.maximum(steps_ns, 0).sum()) / 1e9
        return ImageInfo(
            count=len(times_ns),
            width_px=self._size[0],
            height_px=self._size[1],
            formats=dict(self._formats),
            bytes=self._bytes,
            first_timestamp_ns=self._times_ns[0] if self._times_ns else None,
            duration_s=duration_s,
            rate_hz=len(steps_ns) / duration_s if duration_s > 0 else None,
            missing=int(missing.sum()),
            gaps=tuple(
                Gap(
                    self._indices[i],
                    (self._times_ns[i] - self._start_ns) / 1e9,
                    float(steps_ns[i]) / 1e9,
                    int(missing[i]),
                )
                for i in gaps.tolist()
            ),
        )


def _recorded(end: Mapping[str, str]) -> dict[str, Any]:
    """Numbers as numbers; `ended` is told elsewhere, and what is no count is left out."""
    found: dict[str, Any] = dict(said_counts(end))
    if end.get("connection_lost", "").isdecimal():
        found["connection_lost"] = int(end["connection_lost"])
    with suppress(ValueError):
        found["connection_lost_s"] = float(end.get("connection_lost_s", ""))
    if (at_end := end.get("connection_lost_at_end")) in ("yes", "no"):
        found["connection_lost_at_end"] = at_end == "yes"
    return found


def _camera(log: LogReader) -> CameraInfo | None:
    camera = log.camera()
    if camera is None:
        return None
    k = camera.camera_matrix
    return CameraInfo(
        camera.name,
        camera.width_px,
        camera.height_px,
        camera.distortion_model,
        *(float(k[i, j]) for i, j in ((0, 0), (1, 1), (0, 2), (1, 2))),
    )


def _map(log: LogReader) -> MapInfo | None:
    marker_map = log.marker_map()
    if marker_map is None:
        return None
    sizes_m = sorted({round(m.size_m, 4) for m in marker_map.markers})
    return MapInfo(marker_map.frame, marker_map.dictionary, len(marker_map.markers), tuple(sizes_m))


def _truth(log: LogReader, exact: int) -> TruthInfo | None:
    truth = log.truth()
    if truth is None:
        return TruthInfo(None, 0, 0, 0, exact) if exact else None
    return TruthInfo(
        truth.method or None,
        len(truth.path.points_m) if truth.path else 0,
        len(truth.poses),
        len(truth.trajectory) if truth.trajectory else 0,
        exact,
        len(truth.waypoints),
    )


def _try(read: Callable[[], T | None], problems: list[str]) -> T | None:
    try:
        return read()
    except InputError as error:
        problems.append(str(error))
        return None
