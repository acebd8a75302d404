"""How far the view of the scene and the plots have to reach."""

from __future__ import annotations

import numpy as np

from pipeline.geometry import Array
from replay.viewer.thinning import Thinned

# The share of the way to the outermost markers that has to be in view.
_FRAMED = 0.45


class InnovationLimit:
    """How far a plot of one tracker's innovations has to reach."""

    def __init__(self) -> None:
        # The largest innovation and sigma of a frame.
        self._frames = Thinned(2)

    def add(self, innovation_m: Array, variance_m2: Array) -> None:
        self._frames.add(float(np.abs(innovation_m).max()), float(np.sqrt(variance_m2.max())))

    def value(self) -> float:
        """Metres; a few outliers and the first frames' wide band may reach beyond."""
        frames = self._frames.rows()
        if not len(frames):
            return 0.0
        innovations, sigmas = frames.T
        return 1.2 * max(float(np.percentile(innovations, 98)), float(np.percentile(sigmas, 80)))


def without_outliers(fixes: Array) -> Array:
    """Positions (N, 3), those far out (single markers give them) moved to the others' edge."""
    if len(fixes) < 20:
        return fixes
    low, high = np.percentile(fixes, [2.0, 98.0], axis=0)
    return np.clip(fixes, low, high)


def markers_in_view(corners_m: Array, driven: Array) -> Array:
    """Marker corners (N, 3) drawn towards the positions driven through (M, 3), to frame the scene.

    What people look at is the drive; of a large ceiling its part above is enough.
    """
    if not len(driven):
        return corners_m
    middle = (driven.min(axis=0) + driven.max(axis=0)) / 2.0
    nearer: Array = middle + (corners_m - middle) * (_FRAMED, _FRAMED, 1.0)
    return nearer
