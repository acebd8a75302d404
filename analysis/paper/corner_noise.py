"""How far the detector's corners are from the true ones, measured on rendered frames.

A marker's four corners err together (an edge that is moved takes two of them along), and CONTOUR
moves all edges inwards. So the error of a marker is one vector of eight numbers in a frame that
turns with the marker, with a mean and a covariance of its own for each slant: the angle of the
marker's edges to the pixel rows or columns. An edge along the rows lies at one place in all pixels
that it crosses, so that its error does not average out along it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from pipeline.camera import Camera
from pipeline.detection import ArucoDetection, Detections
from pipeline.geometry import Array, Pose
from pipeline.markers import MarkerMap
from recorder.simulation.renderer import Renderer

# Fewer markers of a class than this many times its eight numbers give no covariance to trust.
MIN_SAMPLES = 40


@dataclass(frozen=True, eq=False)
class CornerNoise:
    """Mean (8,) and covariance (8, 8) in px², by slant in degrees, and how many were measured.

    The numbers are x, y of the four corners along the marker's own sides in the image.
    """

    mean_px: dict[float, Array]
    covariance_px2: dict[float, Array]
    samples: dict[float, int]

    def inward_px(self) -> float:
        """Mean shift of a corner towards the marker's centre, along its diagonal."""
        weights = np.array([self.samples[name] for name in self.mean_px], dtype=np.float64)
        means = np.array(
            [-(mean.reshape(4, 2) * _OUTWARD).sum(axis=1).mean() for mean in self.mean_px.values()]
        )
        return float(weights @ means / weights.sum())

    def rms_px(self) -> float:
        """Root mean square distance of a corner from the true one, bias included."""
        total = sum(
            n
            * (
                float(self.mean_px[name] @ self.mean_px[name])
                + float(np.trace(self.covariance_px2[name]))
            )
            / 4
            for name, n in self.samples.items()
        )
        return float(np.sqrt(total / sum(self.samples.values())))


# Unit vectors from the centre to each corner, along the marker's sides.
_OUTWARD = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / np.sqrt(2.0)


# The paper's classes: markers turned by multiples of 90°, 45° and 22.5° in a camera that is not.
SLANTS_DEG = (0.0, 22.5, 45.0)


def slant_deg(corners_px: Array) -> float:
    """Which of `SLANTS_DEG` is nearest to the angle of a marker's edges to rows or columns."""
    x = _along_sides(corners_px)[:, 0]
    angle = float(np.degrees(np.arctan2(x[1], x[0]))) % 90.0
    return min(SLANTS_DEG, key=lambda slant: abs(min(angle, 90.0 - angle) - slant))


def measure(
    renderer: Renderer,
    camera: Camera,
    marker_map: MarkerMap,
    poses: Iterable[Pose],
    detector: ArucoDetection,
) -> CornerNoise:
    """Renders a frame at each pose and compares what is detected with what was drawn.

    Raises:
        ValueError: a slant was seen too seldom for a covariance.
    """
    find = detector.build(marker_map)
    samples: defaultdict[float, list[Array]] = defaultdict(list)
    for index, T_map_camera in enumerate(poses):
        found = find(renderer.capture(T_map_camera, index))
        T_camera_map = T_map_camera.inverse()
        for marker_id, corners in zip(found.ids.tolist(), found.corners_px, strict=True):
            marker = marker_map.by_id.get(marker_id)
            if marker is None:
                continue
            exact = camera.project(T_camera_map.apply(marker.corners_m))
            error = (corners - exact) @ _along_sides(exact)
            samples[slant_deg(exact)].append(error.ravel())
    few = {name: len(rows) for name, rows in samples.items() if len(rows) < MIN_SAMPLES}
    if few or not samples:
        raise ValueError(f"expected at least {MIN_SAMPLES} markers of each slant, found {few}")
    stacked = {name: np.array(rows) for name, rows in sorted(samples.items())}
    return CornerNoise(
        {name: rows.mean(axis=0) for name, rows in stacked.items()},
        {name: np.cov(rows, rowvar=False) for name, rows in stacked.items()},
        {name: len(rows) for name, rows in stacked.items()},
    )


class NoisyCorners:
    """What the detector would find: exact corners of the true site, with the measured noise."""

    def __init__(self, camera: Camera, marker_map: MarkerMap, noise: CornerNoise) -> None:
        """`camera`, `marker_map`: the true ones."""
        self._camera = camera
        self._markers = marker_map.markers
        self._corners_m = marker_map.corners_m(m.id for m in self._markers)
        self._normals = np.array([m.normal for m in self._markers])
        self._centres_m = np.array([m.centre_m for m in self._markers])
        self._mean = noise.mean_px
        self._factor = {slant: _factor(c) for slant, c in noise.covariance_px2.items()}

    def __call__(self, T_map_camera: Pose, rng: np.random.Generator) -> Detections:
        """The markers wholly in the image, by id; each with a fresh draw of the noise."""
        exact = self._camera.project(T_map_camera.inverse().apply(self._corners_m))
        exact = exact.reshape(-1, 4, 2)
        draws = rng.standard_normal((len(exact), 8))
        size = np.array(self._camera.image_size)
        facing = ((T_map_camera.translation - self._centres_m) * self._normals).sum(axis=1) > 0
        with np.errstate(invalid="ignore"):
            inside = ((exact >= 2.0) & (exact <= size - 3.0)).all(axis=(1, 2)) & facing
        index = np.flatnonzero(inside)
        corners = np.array([exact[i] + self._error(exact[i], draws[i]) for i in index])
        ids = np.array([self._markers[i].id for i in index], dtype=np.int64)
        return Detections(ids, corners.reshape(-1, 4, 2))

    def _error(self, corners_px: Array, draw: Array) -> Array:
        """(4, 2) in the image's axes."""
        slant = slant_deg(corners_px)
        error = self._mean[slant] + self._factor[slant] @ draw
        return np.asarray(error.reshape(4, 2) @ _along_sides(corners_px).T)


def _along_sides(corners_px: Array) -> Array:
    """(2, 2) whose columns are the marker's x (to the right) and y (downwards) in the image."""
    right = (corners_px[1] - corners_px[0]) + (corners_px[2] - corners_px[3])
    x = right / np.linalg.norm(right)
    return np.array([[x[0], -x[1]], [x[1], x[0]]])


def _factor(covariance: Array) -> Array:
    """A square root of a covariance that may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def jittered(poses: Iterable[Pose], seed: int, spread_m: float) -> list[Pose]:
    """Each pose moved and turned a little: it cuts markers' edges elsewhere in the pixels."""
    rng = np.random.default_rng([seed, 11])
    return [
        Pose(pose.rotation, pose.translation + rng.uniform(-spread_m, spread_m, 3))
        @ Pose.from_rvec_tvec(rng.uniform(-0.01, 0.01, 3), np.zeros(3))
        for pose in poses
    ]
