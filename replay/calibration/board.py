"""The boards that a camera is calibrated with, as a person names them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import cv2
import numpy as np

from pipeline.geometry import Array, read_only
from pipeline.markers import load_dictionary

Layout = Literal["new", "legacy"]

FORMS = "chessboard:COLSxROWS:SQUARE_M or charuco:COLSxROWS:SQUARE_M:MARKER_M:DICTIONARY[:LAYOUT]"

# From 4 x 4 squares on a picture of the board bends enough to tell a lens from a pose.
_FEWEST = {"chessboard": 3, "charuco": 4}
_MOST = 200
# A square of 25 is one of 25 mm.
_LARGEST_M = 1.0


@dataclass(frozen=True)
class Chessboard:
    """A plain chessboard, by its inner corners (those where two black squares meet)."""

    cols: int
    rows: int
    square_m: float

    @property
    def corner_shape(self) -> tuple[int, int]:
        """Columns and rows of inner corners."""
        return self.cols, self.rows

    @property
    def points_m(self) -> Array:
        """(N, 3) the inner corners, row by row; a corner's id is its place here."""
        return _grid(self.cols, self.rows, self.square_m)

    def __str__(self) -> str:
        return f"chessboard:{self.cols}x{self.rows}:{self.square_m:g}"


@dataclass(frozen=True)
class Charuco:
    """A chessboard with markers in its white squares, by its squares.

    Attributes:
        layout: how boards with an even number of rows begin, at the top left: `new` with a black
            square, `legacy` (OpenCV before 4.6) with a white one; the same for an odd number.
            None: not known yet.
    """

    cols: int
    rows: int
    square_m: float
    marker_m: float
    dictionary: str
    layout: Layout | None = None

    @property
    def corner_shape(self) -> tuple[int, int]:
        """Columns and rows of inner corners."""
        return self.cols - 1, self.rows - 1

    @property
    def points_m(self) -> Array:
        """(N, 3) the inner corners, row by row; a corner's id is its place here."""
        first = np.array([self.square_m, self.square_m, 0.0])
        return read_only(_grid(self.cols - 1, self.rows - 1, self.square_m) + first)

    @property
    def layouts(self) -> tuple[Layout, ...]:
        """Those that differ and are possible."""
        if self.layout is not None:
            return (self.layout,)
        return ("new", "legacy") if self.rows % 2 == 0 else ("new",)

    def with_layout(self, layout: Layout) -> Charuco:
        return replace(self, layout=layout)

    @cached_property
    def opencv(self) -> cv2.aruco.CharucoBoard:
        """OpenCV's board; of the new layout where none is known."""
        board = cv2.aruco.CharucoBoard(
            (self.cols, self.rows),
            self.square_m,
            self.marker_m,
            load_dictionary(self.dictionary),
        )
        board.setLegacyPattern(self.layout == "legacy")
        return board

    @cached_property
    def marker_corners_m(self) -> dict[int, Array]:
        """The four corners (4, 2) of each marker by its id."""
        corners = self.opencv.getObjPoints()
        return {
            int(id): read_only(np.asarray(points)[:, :2])
            for id, points in zip(np.ravel(self.opencv.getIds()), corners, strict=True)
        }

    def __str__(self) -> str:
        text = f"charuco:{self.cols}x{self.rows}:{self.square_m:g}:{self.marker_m:g}"
        return f"{text}:{self.dictionary}" + (f":{self.layout}" if self.layout else "")


Board = Chessboard | Charuco


def parse_board(text: str) -> Board:
    """The board that `text` names.

    Raises:
        ValueError: says what was expected; the text is of neither form, or no such board exists.
    """
    kind, *parts = text.strip().split(":")
    kind = kind.lower()
    if kind == "chessboard" and len(parts) == 2:
        cols, rows = _shape(parts[0], kind)
        return Chessboard(cols, rows, _length(parts[1], "the square"))
    if kind == "charuco" and len(parts) in (4, 5):
        cols, rows = _shape(parts[0], kind)
        square_m, marker_m = _length(parts[1], "the square"), _length(parts[2], "the marker")
        if marker_m >= square_m:
            raise ValueError(
                f"expected markers smaller than the squares, found {marker_m:g} in {square_m:g}"
            )
        name = parts[3].upper()
        size = len(load_dictionary(name).bytesList)
        if cols * rows // 2 > size:
            raise ValueError(
                f"expected a dictionary of at least {cols * rows // 2} markers, "
                f"found {name} with {size}"
            )
        layout = parts[4].lower() if len(parts) == 5 else None
        if layout not in (None, "new", "legacy"):
            raise ValueError(f"expected the layout new or legacy, found {parts[4]!r}")
        return Charuco(cols, rows, square_m, marker_m, name, layout)  # type: ignore[arg-type]
    raise ValueError(f"expected {FORMS}, found {text!r}")


def _shape(text: str, kind: str) -> tuple[int, int]:
    cols, x, rows = text.lower().partition("x")
    if not (x and cols.isdecimal() and rows.isdecimal()):
        raise ValueError(f"expected COLSxROWS such as 9x6, found {text!r}")
    least = _FEWEST[kind]
    what = "inner corners" if kind == "chessboard" else "squares"
    if not (least <= int(cols) <= _MOST and least <= int(rows) <= _MOST):
        raise ValueError(f"expected {least} to {_MOST} {what} each way, found {text}")
    return int(cols), int(rows)


def _length(text: str, what: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not 0 < value <= _LARGEST_M:
        raise ValueError(
            f"expected the side of {what} in metres, at most {_LARGEST_M:g}, found {text!r}"
        )
    return value


def _grid(cols: int, rows: int, pitch_m: float) -> Array:
    y, x = np.mgrid[0:rows, 0:cols]
    return read_only(
        np.column_stack([x.ravel() * pitch_m, y.ravel() * pitch_m, np.zeros(cols * rows)])
    )
