"""A board's corners in an image, to a tenth of a pixel, and how sharp they are."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.detection import GrayImage
from pipeline.geometry import Array
from replay.calibration.board import Board, Charuco, Layout
from replay.calibration.marker_size import marker_share

# Large images are searched in a smaller copy first; corners are refined in the image itself.
_SEARCH_PX = 960
# Half the refinement window, as a share of the way to the next corner. Of 0.2 to 0.4 this gave the
# lowest residuals on real boards; from 0.4 on windows of tilted boards reach the next edges.
_WINDOW = 0.3
_WINDOWS_PX = (2, 15)
# A window stops so far before the markers of a ChArUco board. OpenCV's detector lets it reach into
# them at its corners, with errors twice as large on drawn boards.
_BEFORE_MARKER_PX = 1.5
_SAMPLES = 9
_REFINE = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-4)

# A view of fewer corners, or of fewer rows or columns, says next to nothing about the lens.
FEWEST_CORNERS = 8
_FEWEST_LINES = 3

# Markers of the other layout are one square off, by turns to the left and to the right.
_DECISIVE = 4.0
_MARKERS_TO_DECIDE = 6
_VOTES = 5


@dataclass(frozen=True, eq=False)
class Corners:
    """The corners of a board that were found in one image.

    Attributes:
        ids: (N,) their places in the board's `points_m`.
        pixels: (N, 2).
        blur_px: sigma of the Gaussian that would make a step as soft as the board's edges; of
            edges in two directions the softer ones, so that motion blur counts in full.
        marker_share: the side of a ChArUco board's markers as a share of the squares', where it
            can be measured.
    """

    ids: np.typing.NDArray[np.int64]
    pixels: Array
    blur_px: float
    marker_share: float | None = None


class CornerFinder:
    """Finds one board in images; the same image always gives the same corners."""

    def __init__(self, board: Board, *, thorough: bool = True) -> None:
        """
        Args:
            board: a Charuco of known layout, or a Chessboard.
            thorough: look again, up to a second long, where a chessboard is not found at once.
        """
        self.board = board
        self._thorough = thorough
        self._charuco = (
            cv2.aruco.CharucoDetector(board.opencv) if isinstance(board, Charuco) else None
        )

    def __call__(self, image: GrayImage) -> Corners | str:
        """The corners, or in words why there are none to use."""
        if self._charuco is not None:
            ids, pixels = _find_charuco(image, self._charuco)
        else:
            ids, pixels = self._find_chessboard(image)
        if not len(ids):
            return "the board was not found"
        rows, cols = np.divmod(ids, self.board.corner_shape[0])
        lines = min(len(np.unique(rows)), len(np.unique(cols)))
        if len(ids) < FEWEST_CORNERS or lines < _FEWEST_LINES:
            return f"too few corners of the board were found: {len(ids)}"
        if isinstance(self.board, Charuco):
            pixels = _refined(image, ids, pixels, self.board)
        if not np.isfinite(pixels).all():
            return "the board's corners are not finite"
        share = None
        if isinstance(self.board, Charuco):
            share = marker_share(image, ids, pixels, self.board)
        return Corners(ids, pixels, blur(image, ids, pixels, self.board.corner_shape[0]), share)

    def _find_chessboard(self, image: GrayImage) -> tuple[np.typing.NDArray[np.int64], Array]:
        shape = self.board.corner_shape
        scale = min(1.0, _SEARCH_PX / max(image.shape))
        found = _search(image, shape, scale)
        if found is None and self._thorough:
            found = _search(image, shape, 1.0) if scale < 1 else None
            found = found if found is not None else _search_by_sectors(image, shape)
        if found is None:
            return np.empty(0, np.int64), np.empty((0, 2))
        ids = np.arange(len(found), dtype=np.int64)
        # The second time from where the spacing is known well.
        for _ in range(2):
            found = _refined(image, ids, found, self.board)
        return ids, found


def charuco_layout(images: Iterable[GrayImage], board: Charuco) -> Layout | None:
    """Which layout the board in the images has; None where its markers cannot tell.

    Judged by how well one homography takes the markers from the board to the image; looks at
    images until some of them agree.
    """
    boards = {layout: board.with_layout(layout) for layout in board.layouts}
    if len(boards) == 1:
        return next(iter(boards))
    detector = cv2.aruco.ArucoDetector(
        next(iter(boards.values())).opencv.getDictionary(), cv2.aruco.DetectorParameters()
    )
    votes: dict[Layout, int] = dict.fromkeys(boards, 0)
    for image in images:
        corners, ids, _ = detector.detectMarkers(image)
        if ids is None:
            continue
        found = {
            int(id): np.asarray(quad, dtype=np.float64).reshape(4, 2)
            for id, quad in zip(np.ravel(ids), corners, strict=True)
        }
        misfits = sorted((_misfit(found, b.marker_corners_m), name) for name, b in boards.items())
        (best, layout), (other, _) = misfits
        if np.isfinite(other) and other > _DECISIVE * best:
            votes[layout] += 1
        if max(votes.values()) >= _VOTES:
            break
    ranked = sorted(votes, key=lambda layout: -votes[layout])
    return ranked[0] if votes[ranked[0]] > votes[ranked[1]] else None


def blur(image: GrayImage, ids: np.typing.NDArray[np.int64], pixels: Array, cols: int) -> float:
    """Sigma in pixels of the blur of the edges between neighbouring corners; see `Corners`."""
    inside = image[
        max(0, int(pixels[:, 1].min())) : int(pixels[:, 1].max()) + 1,
        max(0, int(pixels[:, 0].min())) : int(pixels[:, 0].max()) + 1,
    ]
    dark, bright = np.percentile(inside, (10, 90))
    if bright <= dark:
        return float("inf")
    softest = 0.0
    for step in (1, cols):
        first, second = _neighbours(ids, pixels, step, cols)
        if not len(first):
            continue
        along = second - first
        length = np.linalg.norm(along, axis=1, keepdims=True)
        normal = np.column_stack([-along[:, 1], along[:, 0]]) / length
        # Profiles across the middle of each edge, up to where a marker could begin.
        offsets = np.arange(-3.0, 3.5, 0.5)
        at = ((first + second) / 2)[:, None] + offsets[None, :, None] * normal[:, None]
        profile = cv2.remap(
            image, at.astype(np.float32)[..., 0], at.astype(np.float32)[..., 1], cv2.INTER_LINEAR
        ).astype(np.float64)
        # Over one pixel: finer differences show the interpolation.
        slope = np.abs(profile[:, 2:] - profile[:, :-2]).max(axis=1)
        softest = max(softest, (bright - dark) / max(float(np.median(slope)), 1e-6))
    return float(softest / np.sqrt(2 * np.pi))


def _find_charuco(
    image: GrayImage, detector: cv2.aruco.CharucoDetector
) -> tuple[np.typing.NDArray[np.int64], Array]:
    pixels, ids, _, _ = detector.detectBoard(image)
    if ids is None or pixels is None:
        return np.empty(0, np.int64), np.empty((0, 2))
    order = np.argsort(np.ravel(ids), kind="stable")
    return (
        np.ravel(ids)[order].astype(np.int64),
        np.asarray(pixels, dtype=np.float64).reshape(-1, 2)[order],
    )


def _search(image: GrayImage, shape: tuple[int, int], scale: float) -> Array | None:
    small = image
    if scale < 1:
        small = np.asarray(
            cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8
        )
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, pixels = cv2.findChessboardCorners(small, shape, flags=flags)
    if not found:
        return None
    pixels = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
    ratio = np.array(image.shape[::-1]) / np.array(small.shape[::-1])
    # Pixel centres are at integers: the image's corner is at -0.5 in both.
    return np.asarray((pixels + 0.5) * ratio - 0.5)


def _search_by_sectors(image: GrayImage, shape: tuple[int, int]) -> Array | None:
    """The slower search that withstands blur and shadows; corners good to a quarter of a pixel."""
    found, pixels = cv2.findChessboardCornersSB(image, shape, flags=cv2.CALIB_CB_ACCURACY)
    return np.asarray(pixels, dtype=np.float64).reshape(-1, 2) if found else None


def _refined(
    image: GrayImage, ids: np.typing.NDArray[np.int64], pixels: Array, board: Board
) -> Array:
    """The corners where the grey values have their saddles; those that run away stay."""
    windows = np.clip(_windows_px(ids, pixels, board), *_WINDOWS_PX).astype(np.int64)
    refined = pixels.copy()
    for half in np.unique(windows):
        those = windows == half
        start = np.ascontiguousarray(pixels[those], dtype=np.float32).reshape(-1, 1, 2)
        moved = cv2.cornerSubPix(image, start, (int(half), int(half)), (-1, -1), _REFINE)
        refined[those] = np.asarray(moved, dtype=np.float64).reshape(-1, 2)
    return refined


def _windows_px(ids: np.typing.NDArray[np.int64], pixels: Array, board: Board) -> Array:
    """(N,) half the side of a window about each corner that holds its own edges only.

    By homography: on the far side of a tilted board the next corner may not have been found.
    """
    points = board.points_m[:, :2]
    homography, _ = cv2.findHomography(points[ids], pixels, 0)
    if homography is None:
        return np.zeros(len(ids))
    matrix = np.asarray(homography, dtype=np.float64)

    def projected(places: Array) -> Array:
        return np.asarray(cv2.perspectiveTransform(places.reshape(1, -1, 2), matrix)[0])

    middles = projected(points[ids])
    steps = board.square_m * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    neighbours = projected(points[ids][:, None] + steps).reshape(-1, 4, 2)
    windows = _WINDOW * np.linalg.norm(neighbours - middles[:, None], axis=2).min(axis=1)
    if isinstance(board, Charuco):
        outlines = np.stack(list(board.marker_corners_m.values()))
        along = np.linspace(0, 1, _SAMPLES)[:, None, None, None]
        edges = outlines + along * (np.roll(outlines, -1, axis=1) - outlines)
        ways = np.abs(projected(edges)[None] - middles[:, None]).max(axis=2).min(axis=1)
        windows = np.minimum(windows, ways - _BEFORE_MARKER_PX)
    return np.asarray(windows, np.float64)


def _neighbours(
    ids: np.typing.NDArray[np.int64], pixels: Array, step: int, cols: int
) -> tuple[Array, Array]:
    """Corners and those that follow them, in the row (step 1) or the column (step `cols`)."""
    place = {int(id): i for i, id in enumerate(ids)}
    pairs = [
        (i, place[int(id) + step])
        for i, id in enumerate(ids)
        if int(id) + step in place and (step != 1 or (id + 1) % cols)
    ]
    first, second = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    return pixels[first], pixels[second]


def _misfit(found: dict[int, Array], expected: dict[int, Array]) -> float:
    """Rms in pixels of the markers' corners about one homography of the board; inf without any."""
    known = [id for id in found if id in expected]
    if len(known) < _MARKERS_TO_DECIDE:
        return float("inf")
    board = np.vstack([expected[id] for id in known])
    pixels = np.vstack([found[id] for id in known])
    homography, _ = cv2.findHomography(board, pixels, 0)
    if homography is None:
        return float("inf")
    mapped = cv2.perspectiveTransform(board[None], np.asarray(homography, dtype=np.float64))[0]
    return float(np.sqrt(np.mean(np.sum((mapped - pixels) ** 2, axis=1))))
