"""The ink of a marker, as one outline: cells that only abut would show hairlines in print."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.markers import load_dictionary

Cells = npt.NDArray[np.bool_]
Corner = tuple[int, int]


def ink_cells(dictionary: str, marker_id: int, inverted: bool) -> tuple[Cells, int]:
    """Which cells are inked, row 0 on top, as OpenCV draws the marker.

    Returns:
        The cells, and how many rows of them on each side are the quiet zone: one where the marker
        is white on black, else none.

    Raises:
        ValueError: an unknown dictionary, or an id outside it.
    """
    found = load_dictionary(dictionary)
    if not 0 <= marker_id < len(found.bytesList):
        raise ValueError(
            f"expected ids of {dictionary} (0 to {len(found.bytesList) - 1}), found {marker_id}"
        )
    side = found.markerSize + 2
    ink: Cells = cv2.aruco.generateImageMarker(found, marker_id, side) == 0
    if inverted:
        return np.pad(~ink, 1, constant_values=True), 1
    return ink, 0


def outlines(ink: Cells) -> list[list[Corner]]:
    """Closed polygons around the ink, x right and y down in cells, without their last point.

    Ink is on the right of each edge, so holes run the other way round than what they are in: a
    fill by the nonzero or the even-odd rule gives exactly the cells.
    """
    padded = np.pad(ink, 1)
    following: dict[Corner, list[Corner]] = {}
    for row, column in np.argwhere(ink):
        y, x = int(row), int(column)
        above, below = padded[y, x + 1], padded[y + 2, x + 1]
        left, right = padded[y + 1, x], padded[y + 1, x + 2]
        edges = (
            (above, (x, y), (x + 1, y)),
            (right, (x + 1, y), (x + 1, y + 1)),
            (below, (x + 1, y + 1), (x, y + 1)),
            (left, (x, y + 1), (x, y)),
        )
        for neighbour, start, end in edges:
            if not neighbour:
                following.setdefault(start, []).append(end)
    polygons = []
    while following:
        start = next(iter(following))
        polygon, here = [], start
        while True:
            polygon.append(here)
            ends = following[here]
            here = ends.pop()
            if not ends:
                del following[polygon[-1]]
            if here == start:
                break
        polygons.append(_without_straight_corners(polygon))
    return polygons


def _without_straight_corners(polygon: list[Corner]) -> list[Corner]:
    kept = []
    for i, (x, y) in enumerate(polygon):
        (x0, y0), (x1, y1) = polygon[i - 1], polygon[(i + 1) % len(polygon)]
        if (x1 - x) * (y - y0) != (y1 - y) * (x - x0):
            kept.append((x, y))
    return kept
