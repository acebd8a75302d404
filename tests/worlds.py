"""Small worlds with exact answers: cameras, maps, and the corners that a pose would give."""

from __future__ import annotations

import numpy as np

from pipeline.camera import Camera, DistortionModel
from pipeline.detection import Detections
from pipeline.geometry import Array, Pose, rotation_z
from pipeline.markers import Marker, MarkerMap

COEFFICIENTS: dict[DistortionModel, tuple[float, ...]] = {
    "plumb_bob": (-0.28, 0.09, 0.0008, -0.0011, -0.01),
    "rational_polynomial": (0.4, -0.2, 0.0007, -0.0009, 0.05, 0.7, -0.15, 0.02),
    "equidistant": (-0.01, 0.004, -0.002, 0.0005),
}


def camera(model: DistortionModel = "plumb_bob", *, ideal: bool = False) -> Camera:
    """A 1280x720 camera with a wide lens."""
    coefficients = np.zeros(len(COEFFICIENTS[model])) if ideal else COEFFICIENTS[model]
    matrix = [[900.0, 0.0, 632.5], [0.0, 905.0, 365.2], [0.0, 0.0, 1.0]]
    return Camera(1280, 720, np.array(matrix), model, np.array(coefficients))


def ceiling(rows: int = 3, cols: int = 4, height_m: float = 2.5, pitch_m: float = 0.5) -> MarkerMap:
    """A grid of 15 cm markers that face down, each turned differently."""
    markers = []
    for i in range(rows * cols):
        row, col = divmod(i, cols)
        xyz = ((col - (cols - 1) / 2) * pitch_m, (row - (rows - 1) / 2) * pitch_m, height_m)
        markers.append(Marker.from_yaw(i, xyz, 0.4 * i, "down", 0.15))
    return MarkerMap("map", "DICT_6X6_1000", tuple(markers))


def looking_up(x_m: float = 0.0, y_m: float = 0.0, z_m: float = 0.3, yaw_rad: float = 0.0) -> Pose:
    """T_map_camera of a level camera that looks up; its x axis has heading `yaw_rad`."""
    return Pose(rotation_z(yaw_rad), np.array([x_m, y_m, z_m]))


def corners(T_map_camera: Pose, camera: Camera, marker_map: MarkerMap) -> Detections:
    """What a perfect detector gives: every marker wholly in the image, facing the camera."""
    T_camera_map = T_map_camera.inverse()
    ids, pixels = [], []
    for marker in marker_map.markers:
        if marker.normal @ (T_map_camera.translation - marker.centre_m) <= 0:
            continue
        projected = camera.project(T_camera_map.apply(marker.corners_m))
        inside = (projected >= 0).all() and (projected < camera.image_size).all()
        if inside:
            ids.append(marker.id)
            pixels.append(projected)
    return Detections(np.array(ids, dtype=np.int64), np.array(pixels).reshape(-1, 4, 2))


def with_noise(detections: Detections, sigma_px: float, seed: int) -> Detections:
    """The same with Gaussian corner noise."""
    noise: Array = np.random.default_rng(seed).normal(0, sigma_px, detections.corners_px.shape)
    return Detections(detections.ids, detections.corners_px + noise)
