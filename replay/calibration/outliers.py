"""Views that do not fit the others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from replay.calibration.fit import Fit, fit_lens, fit_pose, rms
from replay.calibration.lens import Lens
from replay.calibration.start import first_fit, start_pose
from replay.calibration.views import SetAside, View

# A view is an outlier when it fits so many times worse than the one in the middle.
_OUTLIER = 3.0
# A view as good as this stays, however good the others are.
_FINE_PX = 0.15
_LOSS_PX = 1.0
_MOST_ROUNDS = 10


def without_outliers(
    lens: Lens, views: Sequence[View], image_size: tuple[int, int]
) -> tuple[Fit, list[int], list[SetAside]] | None:
    """The fit to the views that agree, which they are, and why the others are none of them.

    Views that are out are measured again with each fit, and come back where they fit.
    """
    first = first_fit(lens, views, image_size, loss_px=_LOSS_PX)
    if first is None:
        return None
    fit, kept = first
    poses = dict(zip(kept, fit.poses, strict=True))
    errors = np.full(len(views), np.inf)
    limit = np.inf
    kept = []
    for _ in range(_MOST_ROUNDS):
        for i, view in enumerate(views):
            start = poses.get(i)
            if start is None:
                start = start_pose(lens, fit.values, view.points_m, view.pixels)
            pose = fit_pose(lens, fit.values, view, start) if start is not None else None
            projected = lens.project(fit.values, pose, view.points_m) if pose is not None else None
            errors[i] = np.inf
            if pose is not None and projected is not None:
                poses[i] = pose
                errors[i] = rms(view.pixels - projected[0])
        limit = max(_FINE_PX, _OUTLIER * float(np.median(errors)))
        agreeing = [i for i in range(len(views)) if errors[i] <= limit and np.isfinite(errors[i])]
        if agreeing == kept or not agreeing:
            break
        kept = agreeing
        fit = fit_lens(
            lens, [views[i] for i in kept], fit.values, np.stack([poses[i] for i in kept])
        )
    if not kept:
        return None
    middle = float(np.median(errors))
    outliers = [
        SetAside(
            view.name,
            f"does not fit: {errors[i]:.2f} px rms, {errors[i] / middle:.1f} times the median"
            if np.isfinite(errors[i])
            else "does not fit: no pose of the board explains its corners",
        )
        for i, view in enumerate(views)
        if i not in kept
    ]
    return fit, kept, outliers
