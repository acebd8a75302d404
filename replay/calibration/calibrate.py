"""From views to a calibration: views chosen, those that do not fit removed, errors measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.camera import Camera
from pipeline.geometry import Array
from recorder.errors import InputError
from replay.calibration.board import Board
from replay.calibration.choice import choose, rough_poses
from replay.calibration.coverage import Coverage, coverage
from replay.calibration.fit import Fit
from replay.calibration.heldout import Candidate, HeldOut, candidates, held_out
from replay.calibration.lens import Lens
from replay.calibration.outliers import without_outliers
from replay.calibration.uncertainty import projection_std_px
from replay.calibration.views import Gathered, SetAside, View, kinds_of_reasons

FEWEST_VIEWS = 10


@dataclass(frozen=True, eq=False)
class Calibration:
    """A calibrated camera and all that is known about how good it is.

    Attributes:
        views: those it was fitted to.
        set_aside: every other image, with the reason.
        std, std_by_views: (P,) standard deviations, from independent corner errors and from
            leaving out one view after the other.
        projection_std_px: (rows, cols) over the image, from `std_by_views`.
    """

    board: Board
    camera: Camera
    fit: Fit
    views: tuple[View, ...]
    set_aside: tuple[SetAside, ...]
    held_out: HeldOut
    candidates: tuple[Candidate, ...]
    coverage: Coverage
    std: Array
    std_by_views: Array
    projection_std_px: Array

    @property
    def lens(self) -> Lens:
        return self.fit.lens


def calibrate(
    gathered: Gathered,
    board: Board,
    lens: Lens,
    source: Path,
    *,
    most_views: int = 60,
    name: str = "camera",
    tick: Callable[[str], None] = lambda step: None,
) -> Calibration:
    """The camera that the views were taken with.

    Args:
        source: for messages.
        tick: called with the name of each step before it begins.

    Raises:
        InputError: fewer than ten usable views; says what is missing.
    """
    size = gathered.image_size
    tick("choosing views")
    poses = rough_poses(gathered.views, lens, size)
    if len(gathered.views) < FEWEST_VIEWS:
        raise InputError(source, too_few(gathered, board, poses))
    chosen = choose(gathered.views, poses, size, most_views)
    aside = list(gathered.set_aside)
    for i, view in enumerate(gathered.views):
        if poses[i] is None:
            aside.append(SetAside(view.name, "no pose of the board explains its corners"))
        elif i not in chosen:
            aside.append(SetAside(view.name, f"not needed beside {len(chosen)} that differ more"))
    tick("fitting")
    views = [gathered.views[i] for i in chosen]
    fitted = without_outliers(lens, views, size) if len(views) >= FEWEST_VIEWS else None
    if fitted is None:
        raise InputError(
            source,
            "expected views that some lens explains, found none: is the board the right one?",
        )
    fit, kept, outliers = fitted
    aside += outliers
    if len(kept) < FEWEST_VIEWS:
        raise InputError(
            source,
            f"expected at least {FEWEST_VIEWS} usable views, found {len(kept)}; the others do not "
            f"fit: {', '.join(f'{o.name} ({o.reason})' for o in outliers)}",
        )
    views = [views[i] for i in kept]
    tick("holding out views")
    held = held_out(fit, views)
    tick("comparing lenses")
    compared = candidates(fit, held, views, size)
    by_views = fit.covariance_by_views
    return Calibration(
        board=board,
        camera=lens.camera(fit.values, size, name),
        fit=fit,
        views=tuple(views),
        set_aside=tuple(aside),
        held_out=held,
        candidates=compared,
        coverage=coverage(views, list(fit.poses), size),
        std=np.sqrt(np.diag(fit.covariance)),
        std_by_views=np.sqrt(np.diag(by_views)),
        projection_std_px=projection_std_px(lens, fit.values, by_views, size),
    )


def too_few(gathered: Gathered, board: Board, poses: Sequence[Array | None]) -> str:
    """One line: how many usable views there are, why not more, and which to take."""
    reasons = kinds_of_reasons(one.reason for one in gathered.set_aside)
    images = "image" if gathered.looked_at == 1 else "images"
    text = (
        f"expected at least {FEWEST_VIEWS} usable views of {board}, found {len(gathered.views)} "
        f"in {gathered.looked_at} {images}"
    )
    if reasons:
        text += " (" + ", ".join(f"{reason}: {n}" for reason, n in reasons.items()) + ")"
    if not gathered.views:
        return text + "; are its kind, its numbers of columns and rows and its dictionary right?"
    seen = coverage(
        gathered.views, [pose for pose in poses if pose is not None], gathered.image_size
    )
    return text + f"; take more {seen.missing() or 'of other places, distances and tilts'}"
