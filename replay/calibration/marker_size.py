"""How large a ChArUco board's markers are, measured in its pictures."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import cv2
import numpy as np

from pipeline.detection import GrayImage
from pipeline.geometry import Array
from replay.calibration.board import Charuco

# Profiles into a square from its four sides, in shares of the side: how far, and where along it.
_STEP = 0.005
_DEPTHS = np.arange(-0.1, 0.45, _STEP)
_PLACES = np.array([0.42, 0.46, 0.5, 0.54, 0.58])
# Where a profile becomes bright farther from the square's side than this, it is not that side.
_OFF_SIDE = 0.05
_FEWEST_SQUARES = 2

# Measured shares were right to 1 % in the median of real and drawn boards, in focus or not, and to
# 2 % in single views, also where the size given was half or one and a quarter of the true one.
_TOLERANCE = 0.03
_FEWEST_VIEWS = 3


def marker_share(
    image: GrayImage, ids: np.typing.NDArray[np.int64], pixels: Array, board: Charuco
) -> float | None:
    """The markers' side as a share of the squares', or None where too few squares show it.

    Measured at the white gaps around the markers, between chessboard corners: each marker by the
    homography of its own square, so that the lens need not be known.

    Args:
        ids, pixels: (N,) and (N, 2) chessboard corners found.
    """
    place = {int(id): i for i, id in enumerate(ids)}
    cols = board.corner_shape[0]
    gaps = []
    for col, row in _marker_squares(board):
        first = (row - 1) * cols + col - 1
        corners = [first, first + 1, first + cols + 1, first + cols]
        if not (0 < col <= cols and row > 0 and all(corner in place for corner in corners)):
            continue
        gap = _gap(image, pixels[[place[corner] for corner in corners]])
        if gap is not None:
            gaps.append(gap)
    return 1 - 2 * float(np.median(gaps)) if len(gaps) >= _FEWEST_SQUARES else None


def as_measured(board: Charuco, shares: Iterable[float | None]) -> Charuco | None:
    """The board with markers of the measured size; None where that is the size given, or unknown.

    Args:
        shares: of some views.
    """
    known = [share for share in shares if share is not None]
    if len(known) < _FEWEST_VIEWS:
        return None
    marker_m = float(np.median(known)) * board.square_m
    if abs(marker_m / board.marker_m - 1) <= _TOLERANCE:
        return None
    return replace(board, marker_m=float(f"{marker_m:.3g}"))


def _marker_squares(board: Charuco) -> list[tuple[int, int]]:
    """Column and row of each square with a marker."""
    middles = [corners.mean(axis=0) / board.square_m for corners in board.marker_corners_m.values()]
    return [(int(col), int(row)) for col, row in middles]


def _gap(image: GrayImage, corners_px: Array) -> float | None:
    """Width of the white gap around the marker of one square, in shares of the square's side.

    Ink, light and blur move the gap's two edges in opposite directions, the outer one away from
    zero: what they do to one is taken from the other.
    """
    unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
    matrix = cv2.getPerspectiveTransform(unit, corners_px.astype(np.float32))
    at = cv2.perspectiveTransform(_LINES.reshape(1, -1, 2), matrix).reshape(_LINES.shape)
    at = at.astype(np.float32)
    grey = cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_LINEAR).astype(np.float64)
    dark, bright = np.percentile(grey, (5, 95))
    above = grey - (dark + bright) / 2
    rises = (above[:, :-1] < 0) & (above[:, 1:] >= 0)
    outer = rises.argmax(axis=1)
    falls = (above[:, :-1] >= 0) & (above[:, 1:] < 0)
    falls &= np.arange(falls.shape[1]) > outer[:, None]
    inner = falls.argmax(axis=1)
    begin, end = _crossings(above, outer), _crossings(above, inner)
    good = rises.any(axis=1) & falls.any(axis=1) & (np.abs(begin) < _OFF_SIDE)
    return float(np.median((begin + end)[good])) if good.mean() > 0.5 else None


def _crossings(above: Array, before: np.typing.NDArray[np.intp]) -> Array:
    """Depth of zero in each row, linearly between the sample `before` and the next."""
    row = np.arange(len(above))
    first, second = above[row, before], above[row, before + 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(_DEPTHS[before] + _STEP * first / (first - second))


def _lines() -> Array:
    """(profiles, samples, 2) in a square whose sides are 1."""
    along, into = np.meshgrid(_PLACES, _DEPTHS, indexing="ij")
    return np.concatenate(
        [
            np.stack(pair, axis=-1)
            for pair in ((along, into), (along, 1 - into), (into, along), (1 - into, along))
        ]
    )


_LINES = _lines()
