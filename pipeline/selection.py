"""Which of the detected markers are used for a pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field, PositiveFloat, PositiveInt

from pipeline.camera import Camera
from pipeline.detection import Detections
from pipeline.geometry import Array
from pipeline.markers import MarkerMap
from pipeline.settings import Settings

Selection = Literal["nearest_center", "farthest_center", "largest", "lowest_id"]


class MarkerLimit(Settings):
    """At most `n` markers (null: all) before `until_s` seconds of the log (absent: to its end)."""

    until_s: PositiveFloat | None = None
    n: PositiveInt | None = Field(description="null: all markers")


MaxMarkers = PositiveInt | tuple[MarkerLimit, ...] | None


def check_spans(limit: MaxMarkers) -> MaxMarkers:
    """`limit` itself.

    Raises:
        ValueError: time spans do not grow, or one before the last has no end.
    """
    if isinstance(limit, tuple):
        ends = [span.until_s for span in limit]
        finite = [end for end in ends if end is not None]
        if None in ends[:-1] or finite != sorted(set(finite)):
            raise ValueError(
                f"expected growing until_s, absent only in the last span, found {ends}"
            )
    return limit


def limit_at(limit: MaxMarkers, time_s: float) -> int | None:
    """The limit at `time_s` of the log: of the first span not ended; after the last, none."""
    if not isinstance(limit, tuple):
        return limit
    for span in limit:
        if span.until_s is None or time_s < span.until_s:
            return span.n
    return None


@dataclass(frozen=True, eq=False)
class Usable:
    """The detections left for the solver, and why there may be none."""

    detections: Detections
    reason: Literal["no_markers", "unknown_ids", "duplicate_ids"] | None


def usable(detections: Detections, marker_map: MarkerMap) -> Usable:
    """Known markers seen exactly once: two different markers cannot both carry one id."""
    if not len(detections):
        return Usable(detections, "no_markers")
    ids, counts = np.unique(detections.ids, return_counts=True)
    once = np.isin(detections.ids, ids[counts == 1])
    known = np.isin(detections.ids, marker_map.ids)
    left = detections.select(once & known)
    if len(left):
        return Usable(left, None)
    return Usable(left, "unknown_ids" if once.any() else "duplicate_ids")


def select(
    detections: Detections, limit: int | None, selection: Selection, camera: Camera
) -> Detections:
    """At most `limit` detections by the criterion, ties by id, in the detector's order."""
    if limit is None or len(detections) <= limit:
        return detections
    centres = detections.corners_px.mean(axis=1)
    distance = np.linalg.norm(centres - camera.image_centre_px, axis=1)
    rank = {
        "nearest_center": distance,
        "farthest_center": -distance,
        "largest": -_areas_px2(detections),
        "lowest_id": detections.ids,
    }[selection]
    chosen = np.lexsort((detections.ids, rank))[:limit]
    return detections.select(np.sort(chosen))


def _areas_px2(detections: Detections) -> Array:
    """(N,) area of each marker's quadrangle, by the shoelace formula."""
    x, y = detections.corners_px[..., 0], detections.corners_px[..., 1]
    twice = x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y
    return np.asarray(np.abs(twice.sum(axis=1)) / 2.0)
