"""Numbers for drawing: plain arrays of what was collected, and how far it reaches."""

from __future__ import annotations

from array import array
from collections import deque
from statistics import median

import numpy as np

from pipeline.geometry import Array

# Half the height of the flat uncertainty ellipses.
THIN_M = 1e-3


# Changes of height below this share of the scene's radius are noise.
_LEVEL = 0.1
_RECENT_FIXES = 15
# The share of the way to the outermost markers that has to be in view.
_FRAMED = 0.45


class RecentHeight:
    """The median height of the last fixes: follows a lifted camera, not a single marker's noise."""

    def __init__(self) -> None:
        self._heights: deque[float] = deque(maxlen=_RECENT_FIXES)

    def add(self, z_m: float) -> None:
        self._heights.append(z_m)

    def value(self) -> float:
        return median(self._heights) if self._heights else 0.0


class InnovationLimit:
    """How far a plot of one tracker's innovations has to reach."""

    def __init__(self) -> None:
        self._innovations = array("f")
        self._sigmas = array("f")

    def add(self, innovation_m: Array, variance_m2: Array) -> None:
        self._innovations.append(float(np.abs(innovation_m).max()))
        self._sigmas.append(float(np.sqrt(variance_m2.max())))

    def value(self) -> float:
        """Metres; a few outliers and the first frames' wide band may reach beyond."""
        if not self._innovations:
            return 0.0
        innovations, sigmas = np.array(self._innovations), np.array(self._sigmas)
        return 1.2 * max(float(np.percentile(innovations, 98)), float(np.percentile(sigmas, 80)))


def rows(flat: array[float], width: int) -> Array:
    return np.array(flat, dtype=np.float64).reshape(-1, width)


def height(fixes: Array, exact: Array) -> float:
    """The height at which a truth without one is drawn."""
    heights = exact if len(exact) else fixes
    return float(np.median(heights[:, 2])) if len(heights) else 0.0


def drawn(track: Array, k: int, radius_m: float) -> Array:
    """The line (N, 3) of the k-th tracker, level where the camera's height hardly changes.

    A tracker knows no height: z of `track` is that of the last fixes.
    """
    line = track.copy()
    if len(line):
        low, middle, high = np.percentile(line[:, 2], [5.0, 50.0, 95.0])
        if high - low < _LEVEL * radius_m:
            line[:, 2] = middle
        # A little apart, or lines along the same way would flicker.
        line[:, 2] += k * THIN_M
    return line


def core(fixes: Array) -> Array:
    """The fixes without the far outliers of single markers, for framing the scene."""
    if len(fixes) < 20:
        return fixes
    low, high = np.percentile(fixes, [2.0, 98.0], axis=0)
    return np.clip(fixes, low, high)


def drawn_in(corners_m: Array, driven: Array) -> Array:
    """Marker corners (N, 3), those far from the drive moved towards it, for framing the scene.

    What people look at is the drive; of a large ceiling its part above is enough.
    """
    if not len(driven):
        return corners_m
    middle = (driven.min(axis=0) + driven.max(axis=0)) / 2.0
    return middle + (corners_m - middle) * (_FRAMED, _FRAMED, 1.0)


def ellipse(covariance: Array) -> tuple[tuple[float, float, float], float]:
    """Half sizes at 3σ and the angle of the first axis."""
    values, vectors = np.linalg.eigh(covariance)
    half = 3.0 * np.sqrt(np.maximum(values, 0.0))
    angle = float(np.arctan2(vectors[1, 0], vectors[0, 0]))
    return (float(half[0]), float(half[1]), THIN_M), angle
