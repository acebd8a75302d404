"""Where to begin: lenses and poses from nothing but the views."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from pipeline.camera import Camera
from pipeline.geometry import Array
from replay.calibration.fit import Fit, fit_lens, rms
from replay.calibration.lens import Lens, camera_matrix
from replay.calibration.views import View

# Focal lengths to begin with, as shares of the longer side: from a fisheye to a telephoto lens.
_FOCAL_STARTS = (0.25, 0.4, 0.6, 0.9, 1.3, 2.0, 3.5, 6.0)
_STARTS_TRIED = 2
_RANKED_BY = 40
# `undistort` does not ask for the image's size.
_ANY_SIZE = (1, 1)
_WIDEST = 5.0


def first_fit(
    lens: Lens, views: Sequence[View], image_size: tuple[int, int], loss_px: float | None = None
) -> tuple[Fit, list[int]] | None:
    """A fit from nothing but the views, and which of the views are in it.

    Those whose pose cannot be found at any start are left out. None: no start leads anywhere.
    """
    best: tuple[Fit, list[int]] | None = None
    for values in ranked_starts(lens, views, image_size)[:_STARTS_TRIED]:
        starts = {}
        for i, view in enumerate(views):
            pose = start_pose(lens, values, view.points_m, view.pixels)
            # A tilted board may reach behind the camera where its middle does not.
            if pose is not None and lens.project(values, pose, view.points_m) is not None:
                starts[i] = pose
        kept = list(starts)
        poses = np.stack(list(starts.values()))
        chosen = [views[i] for i in kept]
        # First what bends most: with everything free at once, far starts go astray.
        late = [name for name in lens.names[4:] if name not in ("k1", "k2")]
        for stage in (lens.without(lens.names[4:]), lens.without(late), lens):
            fit = fit_lens(stage, chosen, values, poses, loss_px=loss_px)
            values, poses = fit.values, fit.poses
        if best is None or (-len(kept), _typical(fit)) < (-len(best[1]), _typical(best[0])):
            best = fit, kept
    return best


def ranked_starts(lens: Lens, views: Sequence[View], image_size: tuple[int, int]) -> list[Array]:
    """Parameters (P,) under which most views look like a board, the best first."""
    ranked = []
    views = views[:: max(1, -(-len(views) // _RANKED_BY))]
    for share in _FOCAL_STARTS:
        values = start_values(lens, share * max(image_size), image_size)
        errors = []
        for view in views:
            pose = start_pose(lens, values, view.points_m, view.pixels)
            projected = lens.project(values, pose, view.points_m) if pose is not None else None
            if projected is not None:
                errors.append(rms(view.pixels - projected[0]))
        if errors and len(errors) > len(views) // 2:
            missing = len(views) - len(errors)
            ranked.append((missing, float(np.median(errors)), share, values))
    return [values for *_, values in sorted(ranked, key=lambda entry: entry[:3])]


def _typical(fit: Fit) -> float:
    return float(np.median(fit.view_rms_px))


def start_values(lens: Lens, f_px: float, image_size: tuple[int, int]) -> Array:
    """(P,) a lens without distortion."""
    values = np.zeros(len(lens.names))
    values[:4] = f_px, f_px, (image_size[0] - 1) / 2, (image_size[1] - 1) / 2
    return values


def start_pose(lens: Lens, values: Array, points_m: Array, pixels: Array) -> Array | None:
    """(6,) T_camera_board from a view, good enough to start from; None where there is none."""
    camera = Camera(*_ANY_SIZE, camera_matrix(values), lens.model, values[4:])
    rays = camera.undistort(pixels)
    # Rays far off the axis would rule the fit of a plane, and it needs not all of them.
    usable = np.isfinite(rays).all(axis=1) & (np.abs(rays).max(axis=1) < _WIDEST)
    if np.count_nonzero(usable) < 6:
        return None
    try:
        found, rvec, tvec = cv2.solvePnP(
            points_m[usable], rays[usable], np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
        )
    except cv2.error:
        return None
    pose = np.concatenate([np.ravel(rvec), np.ravel(tvec)]).astype(np.float64)
    if not found or not np.isfinite(pose).all() or pose[5] <= 0:
        return None
    return pose
