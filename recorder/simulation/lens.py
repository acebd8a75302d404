"""The rays of a camera's pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pipeline.camera import Camera
from pipeline.geometry import Array

# A ray that does not come back to its pixel is outside what the distortion model can describe.
_ROUND_TRIP_PX = 0.01
_CHECK_EVERY_PX = 8
_NODE_SPACING_PX = 16


@dataclass(frozen=True, eq=False)
class RayField:
    """Normalized image coordinates: the ray is x, y, 1.

    Attributes:
        corners: (H + 1, W + 1, 2) of the pixels' corners, from pixel (-0.5, -0.5); NaN where the
            lens model has no ray.
        nodes: (h, w, 2) of an even, coarse grid whose outer nodes are the image's corners; the
            pinhole's rays where the lens model has none.
    """

    corners: npt.NDArray[np.float32]
    nodes: Array

    @classmethod
    def of(cls, camera: Camera) -> RayField:
        width, height = camera.image_size
        columns = math.ceil(width / _NODE_SPACING_PX)
        rows = math.ceil(height / _NODE_SPACING_PX)
        corners = _rays(camera, _grid(width, height, width, height))
        pixels = _grid(width, height, columns, rows)
        nodes = _rays(camera, pixels)
        k = camera.camera_matrix
        pinhole = (pixels - k[:2, 2]) / (k[0, 0], k[1, 1])
        return cls(corners.astype(np.float32), np.where(np.isnan(nodes), pinhole, nodes))


def _grid(width: int, height: int, columns: int, rows: int) -> Array:
    """(rows + 1, columns + 1, 2) pixels of an even grid between the image's outer corners."""
    u_px = np.arange(columns + 1) * (width / columns) - 0.5
    v_px = np.arange(rows + 1) * (height / rows) - 0.5
    return np.stack(np.meshgrid(u_px, v_px), axis=-1)


def _rays(camera: Camera, pixels: Array) -> Array:
    rays = camera.undistort(pixels.reshape(-1, 2)).reshape(pixels.shape)
    rays[_folded(rays)] = np.nan
    every = _CHECK_EVERY_PX
    if _lost(camera, rays[::every, ::every], pixels[::every, ::every]).any():
        rays[_lost(camera, rays, pixels)] = np.nan
    return rays


def _lost(camera: Camera, rays: Array, pixels: Array) -> npt.NDArray[np.bool_]:
    points = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=-1)
    back = camera.project(np.nan_to_num(points).reshape(-1, 3)).reshape(pixels.shape)
    error = np.linalg.norm(back - pixels, axis=-1)
    lost: npt.NDArray[np.bool_] = ~(error < _ROUND_TRIP_PX)
    return lost


def _folded(rays: Array) -> npt.NDArray[np.bool_]:
    """Where neighbouring rays are turned over: beyond where the distortion turns back."""
    du, dv = np.gradient(rays, axis=1), np.gradient(rays, axis=0)
    return ~(du[..., 0] * dv[..., 1] - du[..., 1] * dv[..., 0] > 0)
