"""Out of many views the few that differ most: place in the image, distance, tilt, turn."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from pipeline.geometry import Array
from replay.calibration.coverage import tilt_deg
from replay.calibration.lens import Lens
from replay.calibration.start import ranked_starts, start_pose
from replay.calibration.views import View

# Steps that count as equally different: shares of the image, doublings of size, degrees.
_PLACE = 0.15
_SIZE = 0.5
_TILT_DEG = 12.0
_TURN_DEG = 30.0


def rough_poses(
    views: Sequence[View], lens: Lens, image_size: tuple[int, int]
) -> list[Array | None]:
    """The board's pose (6,) in each view for a guessed lens; good for tilts to a few degrees."""
    starts = ranked_starts(lens, views, image_size)
    if not starts:
        return [None] * len(views)
    return [start_pose(lens, starts[0], view.points_m, view.pixels) for view in views]


def choose(
    views: Sequence[View], poses: Sequence[Array | None], image_size: tuple[int, int], most: int
) -> list[int]:
    """At most `most` of the views that have a pose, in their order.

    The sharpest comes first, then always the one farthest from those chosen; the softer an image,
    the shorter its distances count.
    """
    known = [i for i, pose in enumerate(poses) if pose is not None]
    if len(known) <= most:
        return known
    features = np.stack(
        [_features(views[i], pose, image_size) for i in known if (pose := poses[i]) is not None]
    )
    blur = np.array([views[i].blur_px for i in known])
    sharpness = np.minimum(1.0, np.median(blur) / blur)
    chosen = [int(np.argmin(blur))]
    nearest = np.full(len(known), np.inf)
    while len(chosen) < most:
        way = np.linalg.norm(features - features[chosen[-1]], axis=1)
        nearest = np.minimum(nearest, way)
        chosen.append(int(np.argmax(nearest * sharpness)))
    return sorted(known[i] for i in chosen)


def _features(view: View, pose: Array, image_size: tuple[int, int]) -> Array:
    hull = cv2.convexHull(view.pixels.astype(np.float32)).reshape(-1, 2)
    place = np.mean(hull, axis=0) / image_size / _PLACE
    size = np.log2(max(cv2.contourArea(hull), 1.0)) / 2 / _SIZE
    side = view.outline_px[1] - view.outline_px[0]
    turn = np.arctan2(side[1], side[0])
    # On a circle, so that turns of 179° and -179° are alike.
    circle = np.array([np.cos(turn), np.sin(turn)]) / np.radians(_TURN_DEG)
    return np.concatenate([place, [size], tilt_deg(pose) / _TILT_DEG, circle])
