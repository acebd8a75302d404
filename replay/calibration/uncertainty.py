"""What the uncertainty of the parameters means in the image."""

from __future__ import annotations

import numpy as np

from pipeline.geometry import Array
from replay.calibration.lens import Lens

_CELLS = 32
# The weights of the turn hardly change after three.
_ROUNDS = 4


def projection_std_px(
    lens: Lens, values: Array, covariance: Array, image_size: tuple[int, int]
) -> Array:
    """(rows, cols) standard deviation, in pixels, of where far points appear over the image.

    Parameters that trade against each other (k1 of a rational lens against k4) may each be
    uncertain while the lens is not. A turn of the camera as a whole is no error of the lens: the
    best small one is taken out, to which a point counts the less, the less is known there; else
    corners that no view was in would blur all the rest. NaN where the lens gives no ray.

    Source: D. Kogan, mrcal, "A tour of mrcal: uncertainty": projection uncertainty at infinity.
    """
    step = max(image_size) / _CELLS
    rows, cols = (max(2, round(size / step)) for size in image_size[::-1])
    v, u = np.meshgrid(
        np.linspace(0, image_size[1] - 1, rows),
        np.linspace(0, image_size[0] - 1, cols),
        indexing="ij",
    )
    rays = lens.camera(values, image_size).undistort(np.column_stack([u.ravel(), v.ravel()]))
    known = np.isfinite(rays).all(axis=1)
    std = np.full(len(rays), np.nan)
    points = np.column_stack([rays[known], np.ones(np.count_nonzero(known))])
    projected = lens.project(values, np.zeros(6), points)
    if projected is not None and len(points) >= 3:
        _, by_values, by_pose = projected
        turn = by_pose[:, :3]
        root = np.ones((len(turn), 1))
        for _ in range(_ROUNDS):
            best = np.linalg.lstsq(root * turn, root * by_values, rcond=None)[0]
            moved = (by_values - turn @ best).reshape(-1, 2, len(values))
            variance = np.maximum(np.einsum("nij,jk,nik->n", moved, covariance, moved), 0.0)
            middle = float(np.median(variance))
            if not 0.0 < middle < np.inf:
                break
            root = np.repeat(1.0 / np.sqrt(variance + middle), 2)[:, None]
        std[known] = np.sqrt(variance)
    return std.reshape(rows, cols)
