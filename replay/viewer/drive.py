"""The whole drive, drawn at all times: fixes, tracks and exact poses."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from statistics import median

import numpy as np
import rerun as rr

from pipeline.geometry import Array
from recorder.files.truth_file import Truth
from replay.viewer import scene, style
from replay.viewer.extent import markers_in_view, without_outliers
from replay.viewer.layout import RESULT_ASPECT, Eye, Point, eye_on
from replay.viewer.thinning import MOST_ROWS, Thinned

# So many fixes tell the height: it follows a lifted camera, not a single marker's noise.
_RECENT_FIXES = 15
# Changes of height below this share of the scene's radius are noise.
_LEVEL = 0.1
# Lines along the same way are a little apart, or they would flicker.
_APART_M = 1e-3


class WholeDrive:
    """Collects positions frame by frame, in bounded memory, and logs them when asked."""

    def __init__(self, tracker_names: Iterable[str], most: int = MOST_ROWS) -> None:
        """`most`: so many positions of each kind are kept; even."""
        self._tracks = {name: Thinned(3, most) for name in tracker_names}
        self._fixes = Thinned(3, most)
        self._rejected = Thinned(3, most)
        self._exact = Thinned(3, most)
        self._heights: deque[float] = deque(maxlen=_RECENT_FIXES)

    def add_fix(self, position_m: Array) -> None:
        self._fixes.add(*position_m.tolist())
        self._heights.append(float(position_m[2]))

    def add_rejected(self, position_m: Array) -> None:
        self._rejected.add(*position_m.tolist())

    def add_exact(self, position_m: Array) -> None:
        self._exact.add(*position_m.tolist())

    def add_track(self, tracker: str, xy_m: Array) -> Point:
        """Returns where to draw it: a tracker knows no height, it is that of the last fixes."""
        x, y = xy_m.tolist()
        point = (x, y, median(self._heights) if self._heights else 0.0)
        self._tracks[tracker].add(*point)
        return point

    def eye(self, marker_corners_m: Array) -> Eye:
        """An eye on the drive and the markers (N, 3) above it."""
        exact = self._exact.rows()
        driven = exact if len(exact) else without_outliers(self._fixes.rows())
        return eye_on(markers_in_view(marker_corners_m, driven), driven, aspect=RESULT_ASPECT)

    def log(
        self,
        stream: rr.RecordingStream,
        paths: style.ResultPaths,
        looks: Mapping[str, style.Look],
        truth: Truth | None,
        radius_m: float,
    ) -> None:
        """Draws everything; `radius_m` is the scene's."""
        fixes, exact = self._fixes.rows(), self._exact.rows()
        for name, points, colour, size in (
            ("ok", fixes, style.FIX_COLOUR, 2.0),
            ("rejected", self._rejected.rows(), style.REJECTED_COLOUR, 2.5),
        ):
            if len(points):
                cloud = rr.Points3D(points, colors=colour, radii=-size)
                stream.log(f"{paths.fixes}/{name}", cloud, static=True)
        for k, (name, track) in enumerate(self._tracks.items()):
            line, look = levelled(track.rows(), radius_m), looks[name]
            line[:, 2] += k * _APART_M
            scene.log_line(stream, f"{paths.tracker(name)}/path", line, look.colour, look.path_px)
        if len(exact):
            scene.log_line(stream, style.TRUTH_EXACT, exact, style.TRUTH_COLOUR)
        if truth is not None:
            scene.log_truth(stream, truth, _height(exact if len(exact) else fixes))


def levelled(track: Array, radius_m: float) -> Array:
    """A copy of the line (N, 3), at one height where the camera's hardly changes."""
    line = track.copy()
    if len(line):
        low, middle, high = np.percentile(line[:, 2], [5.0, 50.0, 95.0])
        if high - low < _LEVEL * radius_m:
            line[:, 2] = middle
    return line


def _height(positions_m: Array) -> float:
    """The height at which a truth without one is drawn."""
    return float(np.median(positions_m[:, 2])) if len(positions_m) else 0.0
