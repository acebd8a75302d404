"""What a board that was not found might be instead."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

import cv2
import numpy as np

from replay.calibration.board import Board, Charuco, Chessboard, Layout
from replay.calibration.corners import CornerFinder, charuco_layout
from replay.calibration.frames import Frames
from replay.calibration.marker_size import as_measured

_TRIED = 10
# A board is found with markers of half to one and a half times this size.
_USUAL_SHARE = 0.7


def wrong_board(frames: Frames, board: Board) -> str | None:
    """What some of the images show in place of the board, as an error; None where nobody knows."""
    if isinstance(board, Chessboard):
        return _miscounted(frames, board)
    return _wrong_markers(frames, board)


def _miscounted(frames: Frames, board: Chessboard) -> str | None:
    """For a board whose squares were counted: they are one more than the inner corners."""
    for change in (-1, 1):
        other = Chessboard(board.cols + change, board.rows + change, board.square_m)
        if min(other.corner_shape) < 3:
            continue
        finder = CornerFinder(other, thorough=False)
        for image in islice(frames.images(), _TRIED):
            if not isinstance(finder(image), str):
                return (
                    f"expected a board of {board.cols}x{board.rows} inner corners, found one of "
                    f"{other.cols}x{other.rows}: --board {other} (count where black squares meet)"
                )
    return None


def _wrong_markers(frames: Frames, board: Charuco) -> str:
    detector = cv2.aruco.ArucoDetector(board.opencv.getDictionary(), cv2.aruco.DetectorParameters())
    seen: set[int] = set()
    for image in islice(frames.images(), _TRIED):
        ids = detector.detectMarkers(image)[1]
        seen.update(int(id) for id in (np.ravel(ids) if ids is not None else ()))
    if not seen:
        return f"expected the markers of {board}, found none of {board.dictionary}"
    last = max(board.marker_corners_m)
    if foreign := sorted(id for id in seen if id > last):
        return (
            f"expected the markers 0 to {last} of {board}, found also {foreign[0]}: are the "
            "numbers of columns and rows right?"
        )
    usual = _seen(frames, replace(board, marker_m=_USUAL_SHARE * board.square_m))
    if usual is not None:
        measured = as_measured(board.with_layout(usual[0]), usual[1])
        if measured is not None:
            return (
                f"expected markers of {board.marker_m:g} m in squares of {board.square_m:g} m, "
                f"found them of about {measured.marker_m:g} m: --board {measured}"
            )
    turned = replace(board, cols=board.rows, rows=board.cols)
    if turned.cols != board.cols and (found := _seen(frames, turned)) is not None:
        return (
            f"expected a board of {board.cols}x{board.rows} squares, found one of "
            f"{turned.cols}x{turned.rows}: --board {turned.with_layout(found[0])}"
        )
    unknown = replace(board, layout=None)
    layout = charuco_layout(islice(frames.images(), _TRIED), unknown)
    if layout not in (None, board.layout):
        return f"expected the layout {board.layout}, found the other: --board {unknown}:{layout}"
    return (
        f"found markers of {board.dictionary}, but not where {board} has them: are the numbers "
        "of columns and rows right?"
    )


def _seen(frames: Frames, board: Charuco) -> tuple[Layout, list[float | None]] | None:
    """The layout in which some images show the board, and its `marker_share` in each of them."""
    for layout in replace(board, layout=None).layouts:
        finder = CornerFinder(board.with_layout(layout))
        found = [finder(image) for image in islice(frames.images(), _TRIED)]
        if shares := [one.marker_share for one in found if not isinstance(one, str)]:
            return layout, shares
    return None
