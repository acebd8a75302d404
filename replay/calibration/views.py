"""Views of the board: gathered from many images, the sharp ones kept, those alike only once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.detection import GrayImage
from pipeline.geometry import Array
from recorder.errors import InputError
from replay.calibration.board import Board
from replay.calibration.corners import CornerFinder, Corners
from replay.calibration.frames import Frames

# The board's outline moved by less than this share of the image's diagonal: the same view again.
_ALIKE = 0.01
# Softer than this, and much softer than most: the camera or the board moved.
_BLURRED_PX = 2.0
_BLURRED = 2.5
# Of more frames than this, a chessboard that is not found at once is not searched for longer.
_THOROUGH = 300


@dataclass(frozen=True, eq=False)
class View:
    """One view of the board.

    Attributes:
        points_m: (N, 3) the corners found, in the board's frame.
        pixels: (N, 2) where they are in the image.
        outline_px: (4, 2) the outer corners of the whole board's grid by homography.
        marker_share: as of `Corners`.
    """

    name: str
    points_m: Array
    pixels: Array
    blur_px: float
    outline_px: Array
    marker_share: float | None = None


@dataclass(frozen=True)
class SetAside:
    """An image that is not used, and why."""

    name: str
    reason: str


@dataclass(frozen=True, eq=False)
class Gathered:
    """What a source has to offer.

    Attributes:
        views: different from each other, in the source's order.
        set_aside: every other image looked at, in the source's order.
    """

    image_size: tuple[int, int]
    views: tuple[View, ...]
    set_aside: tuple[SetAside, ...]

    @property
    def looked_at(self) -> int:
        return len(self.views) + len(self.set_aside)


def kinds_of_reasons(reasons: Iterable[str]) -> dict[str, int]:
    """How many images were set aside for which kind of reason, the most frequent first."""
    counts: Counter[str] = Counter()
    for reason in reasons:
        kind = reason.split(":")[0]
        counts["like another view" if kind.startswith("like ") else kind] += 1
    return dict(counts.most_common())


def gather(
    frames: Frames, board: Board, tick: Callable[[int], None] = lambda found: None
) -> Gathered:
    """Every view of the board that differs from the others, the sharper of two that do not.

    Keeps corners only, no images.

    Args:
        board: a Charuco's layout must be known.
        tick: called after each image with the number of views so far.

    Raises:
        InputError: no image can be decoded.
    """
    size: tuple[int, int] | None = None
    finder = CornerFinder(board, thorough=len(frames) <= _THOROUGH)
    views: dict[int, View] = {}
    aside: dict[int, SetAside] = {}

    def look(image: GrayImage | None) -> tuple[tuple[int, int], Corners | str] | None:
        if image is None:
            return None
        width, height = image.shape[1], image.shape[0]
        return (width, height), finder(image)

    for i, (frame, seen) in enumerate(frames.map(look)):
        if seen is None:
            aside[i] = SetAside(frame.name, "no readable image")
        elif size not in (None, seen[0]):
            aside[i] = SetAside(frame.name, "not of the size of the first image")
        else:
            size, found = seen
            view = found if isinstance(found, str) else _view(frame.name, found, board)
            if isinstance(view, str):
                aside[i] = SetAside(frame.name, view)
            else:
                _add(i, view, views, aside, size)
        tick(len(views))
    if size is None:
        raise InputError(frames.source, "expected images, found none that can be read")
    _set_blurred_aside(views, aside)
    return Gathered(
        size,
        tuple(views[i] for i in sorted(views)),
        tuple(aside[i] for i in sorted(aside)),
    )


def _view(name: str, corners: Corners, board: Board) -> View | str:
    points = board.points_m[corners.ids]
    all_points = board.points_m
    cols, rows = board.corner_shape
    outline = all_points[[0, cols - 1, cols * rows - 1, cols * (rows - 1)]]
    homography, _ = cv2.findHomography(points[:, :2], corners.pixels, 0)
    if homography is None:
        return "the corners found are not those of a plane"
    matrix = np.asarray(homography, dtype=np.float64)
    outline_px = cv2.perspectiveTransform(outline[None, :, :2].copy(), matrix)[0]
    return View(
        name,
        points,
        corners.pixels,
        corners.blur_px,
        np.asarray(outline_px),
        corners.marker_share,
    )


def _add(
    i: int,
    view: View,
    views: dict[int, View],
    aside: dict[int, SetAside],
    size: tuple[int, int],
) -> None:
    """Puts the view among the others; of two that are alike, the softer is set aside."""
    limit = _ALIKE * float(np.hypot(*size))
    if views:
        places = list(views)
        outlines = np.stack([views[place].outline_px for place in places])
        shift = np.sqrt(np.mean(np.sum((outlines - view.outline_px) ** 2, axis=2), axis=1))
        nearest = places[int(np.argmin(shift))]
        if shift.min() < limit:
            other = views[nearest]
            if view.blur_px >= other.blur_px:
                aside[i] = SetAside(view.name, f"like {other.name}, and not sharper")
                return
            del views[nearest]
            aside[nearest] = SetAside(other.name, f"like {view.name}, which is sharper")
    views[i] = view


def _set_blurred_aside(views: dict[int, View], aside: dict[int, SetAside]) -> None:
    if not views:
        return
    limit = max(_BLURRED_PX, _BLURRED * float(np.median([v.blur_px for v in views.values()])))
    for i in [i for i, view in views.items() if view.blur_px > limit]:
        view = views.pop(i)
        aside[i] = SetAside(
            view.name, f"blurred: {view.blur_px:.1f} px, most are below {limit:.1f}"
        )
