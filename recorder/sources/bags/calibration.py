"""sensor_msgs/CameraInfo as a calibration."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.camera import Camera

_TRANSPORTS = ("compressed",)
_OTHER_NAMES = {"fisheye": "equidistant", "rational": "rational_polynomial"}


def info_topic(image_topic: str) -> str:
    """Where ROS publishes the calibration of an image topic: beside it."""
    parts = image_topic.split("/")
    if parts[-1] in _TRANSPORTS:
        parts = parts[:-1]
    return "/".join([*parts[:-1], "camera_info"])


def is_rectified(image_topic: str) -> bool:
    """By ROS's names, `image_rect`, `image_rect_color`."""
    return any(part.startswith("image_rect") for part in image_topic.split("/"))


def camera_of(message: Any, *, ros1: bool, rectified: bool, name: str) -> Camera:
    """The camera of a CameraInfo.

    Args:
        ros1: the message has ROS 1's names of fields (D, K, P).
        rectified: the images are: they have P's intrinsics and no distortion.

    Raises:
        ValueError: it is not calibrated, or not of the whole image with a known distortion.
    """
    if ros1:
        k, p, dist_coeffs = message.K, message.P, message.D
    else:
        k, p, dist_coeffs = message.k, message.p, message.d
    if not np.any(k):
        raise ValueError("expected a calibrated camera, found zeros")
    region = message.roi
    if message.binning_x > 1 or message.binning_y > 1:
        raise ValueError("expected a calibration of the unbinned image")
    if region.x_offset or region.y_offset or (region.width, region.height) not in (
        (0, 0),
        (message.width, message.height),
    ):  # fmt: skip
        raise ValueError("expected a calibration of the whole image, found a region")
    model = _OTHER_NAMES.get(message.distortion_model, message.distortion_model)
    matrix = np.array(k, float).reshape(3, 3)
    coefficients = np.array(dist_coeffs, float)
    if rectified:
        matrix = np.array(p, float).reshape(3, 4)[:, :3]
        model, coefficients = "plumb_bob", np.zeros(5)
    elif not len(coefficients) and model in ("", "plumb_bob"):
        model, coefficients = "plumb_bob", np.zeros(5)
    return Camera(message.width, message.height, matrix, model, coefficients, name)
