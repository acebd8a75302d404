"""The compiled inner loop that draws flat grids of cells, each pixel the mean over its square."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from pipeline.geometry import Array
from recorder.simulation.compilation import compiled

FloatImage: TypeAlias = npt.NDArray[np.float32]

# Side of the blocks of pixels that are tested against a quad at once.
TILE_PX = 16
# A distorted tile is not quite the quadrilateral of its corners.
_TILE_MARGIN = 0.5
_VERTICES = 12
# The polygons of one pixel in the scratch array.
_SQUARE, _ROW_BELOW, _ROW, _PART_RIGHT, _PART = range(5)
# What a range of cell coordinates holds when it is not one reflectance.
_NOTHING = -1.0
_SEVERAL = -2.0


@compiled
def _cell(s: float, n: int) -> int:
    """The cell of a coordinate: 0 and n + 1 are the margins."""
    if s < 0.0:
        return 0
    if s >= n:
        return n + 1
    return int(s) + 1


@compiled
def _line(i: int, n: int, margin: float) -> float:
    """The coordinate where cell i begins."""
    if i == 0:
        return -margin
    if i == n + 2:
        return n + margin
    return float(i - 1)


@compiled
def _cut(
    scratch: Array, source: int, count: int, axis: int, bound: float, sign: float, target: int
) -> int:
    """The part of a convex polygon where sign * (coordinate - bound) >= 0; returns its vertices."""
    kept = 0
    for a in range(count):
        b = a + 1 if a + 1 < count else 0
        da = sign * (scratch[source, a, axis] - bound)
        db = sign * (scratch[source, b, axis] - bound)
        if da >= 0.0:
            scratch[target, kept, 0] = scratch[source, a, 0]
            scratch[target, kept, 1] = scratch[source, a, 1]
            kept += 1
        if (da >= 0.0) != (db >= 0.0):
            f = da / (da - db)
            for i in range(2):
                start = scratch[source, a, i]
                scratch[target, kept, i] = start + f * (scratch[source, b, i] - start)
            kept += 1
    return kept


@compiled
def _area(scratch: Array, polygon: int, count: int) -> float:
    total = 0.0
    x, y = scratch[polygon, 0, 0], scratch[polygon, 0, 1]
    for a in range(1, count - 1):
        total += (scratch[polygon, a, 0] - x) * (scratch[polygon, a + 1, 1] - y)
        total -= (scratch[polygon, a + 1, 0] - x) * (scratch[polygon, a, 1] - y)
    return 0.5 * abs(total)


@compiled
def _only_cell(
    s_min: float, s_max: float, t_min: float, t_max: float, cells: FloatImage, margin: float
) -> float:
    """The one reflectance in a range of cell coordinates, or _NOTHING, or _SEVERAL."""
    n_rows, n_cols = cells.shape[0] - 2, cells.shape[1] - 2
    right, bottom = n_cols + margin, n_rows + margin
    if s_max <= -margin or t_max <= -margin or s_min >= right or t_min >= bottom:
        return _NOTHING
    if s_min < -margin or t_min < -margin or s_max > right or t_max > bottom:
        return _SEVERAL
    i0, i1 = _cell(s_min, n_cols), _cell(s_max, n_cols)
    j0, j1 = _cell(t_min, n_rows), _cell(t_max, n_rows)
    value = cells[j0, i0]
    for j in range(j0, j1 + 1):
        for i in range(i0, i1 + 1):
            if cells[j, i] != value:
                return _SEVERAL
    return value if value >= 0.0 else _NOTHING


@compiled
def _extent(scratch: Array, polygon: int, count: int, axis: int) -> tuple[float, float]:
    low = high = scratch[polygon, 0, axis]
    for a in range(1, count):
        low = min(low, scratch[polygon, a, axis])
        high = max(high, scratch[polygon, a, axis])
    return low, high


@compiled
def _integrate(scratch: Array, cells: FloatImage, margin: float) -> tuple[float, float]:
    """Exact integral over the quadrilateral scratch[_SQUARE, :4].

    Returns:
        The mean of the cells weighted by area, and the covered share.
    """
    n_rows, n_cols = cells.shape[0] - 2, cells.shape[1] - 2
    s_min, s_max = _extent(scratch, _SQUARE, 4, 0)
    t_min, t_max = _extent(scratch, _SQUARE, 4, 1)
    alone = _only_cell(s_min, s_max, t_min, t_max, cells, margin)
    if alone != _SEVERAL:
        return max(alone, 0.0), 1.0 if alone >= 0.0 else 0.0
    square = _area(scratch, _SQUARE, 4)
    if square <= 0.0:
        return 0.0, 0.0
    light = 0.0
    covered = 0.0
    for j in range(_cell(t_min, n_rows), _cell(t_max, n_rows) + 1):
        low, high = _line(j, n_rows, margin), _line(j + 1, n_rows, margin)
        row, count = _SQUARE, 4
        if t_min < low:
            count = _cut(scratch, row, count, 1, low, 1.0, _ROW_BELOW)
            row = _ROW_BELOW
        if t_max > high:
            count = _cut(scratch, row, count, 1, high, -1.0, _ROW)
            row = _ROW
        if count < 3:
            continue
        row_min, row_max = _extent(scratch, row, count, 0)
        for i in range(_cell(row_min, n_cols), _cell(row_max, n_cols) + 1):
            if cells[j, i] < 0.0:
                continue
            left, right = _line(i, n_cols, margin), _line(i + 1, n_cols, margin)
            part, kept = row, count
            if row_min < left:
                kept = _cut(scratch, part, kept, 0, left, 1.0, _PART_RIGHT)
                part = _PART_RIGHT
            if row_max > right:
                kept = _cut(scratch, part, kept, 0, right, -1.0, _PART)
                part = _PART
            area = _area(scratch, part, kept)
            light += area * cells[j, i]
            covered += area
    return light / square, covered / square


@compiled
def draw_quad(
    image: FloatImage,
    rays: FloatImage,
    middle: Array,
    instants: Array,
    cells: FloatImage,
    margin: float,
    reach: float,
) -> None:
    """Composites one flat grid of cells over the image: the exact mean over each pixel's square.

    During the exposure a pixel's square keeps the shape that it has on the quad in the middle.

    Args:
        image: (H, W), changed in place.
        rays: (H + 1, W + 1, 2) normalized image coordinates of the pixels' corners.
        middle: (1, 3, 3) from a ray (x, y, 1) to cell coordinates, w positive in front of the
            camera; at mid-exposure.
        instants: (K, 3, 3) the same at K times within the exposure.
        cells: (rows + 2, columns + 2) reflectance, the margins' cells included; negative: a hole.
        margin: width of the margin, in cells.
        reach: how far, in cells, anything on the quad moves from its place at mid-exposure.
    """
    height, width = image.shape
    # Corners of one tile's pixels on the quad: s, t, and whether they are on it.
    corners = np.empty((TILE_PX + 1, TILE_PX + 1, 3))
    scratch = np.zeros((5, _VERTICES, 2))
    for top in range(0, height, TILE_PX):
        bottom = min(top + TILE_PX, height)
        for left in range(0, width, TILE_PX):
            right = min(left + TILE_PX, width)
            if not _tile_meets(rays, middle, top, bottom, left, right, cells, margin, reach):
                continue
            for j in range(bottom - top + 1):
                for i in range(right - left + 1):
                    s, t, w = _project(
                        middle, 0, rays[top + j, left + i, 0], rays[top + j, left + i, 1]
                    )
                    corners[j, i, 0], corners[j, i, 1], corners[j, i, 2] = s, t, w
            for j in range(bottom - top):
                for i in range(right - left):
                    # Also false for NaN: a pixel without a ray.
                    if not (
                        corners[j, i, 2] > 0.0
                        and corners[j, i + 1, 2] > 0.0
                        and corners[j + 1, i + 1, 2] > 0.0
                        and corners[j + 1, i, 2] > 0.0
                    ):
                        continue
                    for axis in range(2):
                        scratch[_SQUARE, 0, axis] = corners[j, i, axis]
                        scratch[_SQUARE, 1, axis] = corners[j, i + 1, axis]
                        scratch[_SQUARE, 2, axis] = corners[j + 1, i + 1, axis]
                        scratch[_SQUARE, 3, axis] = corners[j + 1, i, axis]
                    s_min, s_max = _extent(scratch, _SQUARE, 4, 0)
                    t_min, t_max = _extent(scratch, _SQUARE, 4, 1)
                    alone = _only_cell(
                        s_min - reach, s_max + reach, t_min - reach, t_max + reach, cells, margin
                    )
                    v, u = top + j, left + i
                    if alone >= 0.0:
                        image[v, u] = alone
                    elif alone == _SEVERAL:
                        x = 0.5 * (rays[v, u, 0] + rays[v + 1, u + 1, 0])
                        y = 0.5 * (rays[v, u, 1] + rays[v + 1, u + 1, 1])
                        light, covered = _mean(middle, instants, x, y, cells, margin, scratch)
                        image[v, u] = image[v, u] * (1.0 - covered) + light


@compiled
def _project(h: Array, k: int, x: float, y: float) -> tuple[float, float, float]:
    """Where the ray (x, y, 1) meets the quad by h[k]: s, t and w, positive if it does."""
    w = h[k, 2, 0] * x + h[k, 2, 1] * y + h[k, 2, 2]
    if not w > 0.0:
        return 0.0, 0.0, w
    depth = 1.0 / w
    s = (h[k, 0, 0] * x + h[k, 0, 1] * y + h[k, 0, 2]) * depth
    t = (h[k, 1, 0] * x + h[k, 1, 1] * y + h[k, 1, 2]) * depth
    return s, t, w


@compiled
def _mean(
    middle: Array,
    instants: Array,
    x: float,
    y: float,
    cells: FloatImage,
    margin: float,
    scratch: Array,
) -> tuple[float, float]:
    """The mean of `_integrate` while the pixel's square moves over the quad.

    Args:
        x, y: the ray of the pixel's centre.
        scratch: its _SQUARE is the pixel's at mid-exposure.
    """
    count = instants.shape[0]
    if count == 1:
        return _integrate(scratch, cells, margin)
    s_last, t_last, _ = _project(middle, 0, x, y)
    light = 0.0
    covered = 0.0
    for k in range(count):
        s, t, w = _project(instants, k, x, y)
        if not w > 0.0:
            continue
        for corner in range(4):
            scratch[_SQUARE, corner, 0] += s - s_last
            scratch[_SQUARE, corner, 1] += t - t_last
        s_last, t_last = s, t
        light_k, covered_k = _integrate(scratch, cells, margin)
        light += light_k
        covered += covered_k
    return light / count, covered / count


@compiled
def _tile_meets(
    rays: FloatImage,
    middle: Array,
    top: int,
    bottom: int,
    left: int,
    right: int,
    cells: FloatImage,
    margin: float,
    reach: float,
) -> bool:
    """Whether a tile of pixels may see the quad; from pixels to the plane nothing folds over."""
    n_rows, n_cols = cells.shape[0] - 2, cells.shape[1] - 2
    s_min, s_max, t_min, t_max = np.inf, -np.inf, np.inf, -np.inf
    behind = 0
    for corner in range(4):
        v = bottom if corner // 2 else top
        u = right if corner % 2 else left
        x, y = rays[v, u, 0], rays[v, u, 1]
        s, t, w = _project(middle, 0, x, y)
        if not w > 0.0:
            # A missing ray says nothing about the rest of the tile.
            if w != w:
                return True
            behind += 1
            continue
        s_min, s_max = min(s_min, s), max(s_max, s)
        t_min, t_max = min(t_min, t), max(t_max, t)
    if behind == 4:
        return False
    if behind:
        return True
    s_slack = _TILE_MARGIN * (s_max - s_min) + reach + margin
    t_slack = _TILE_MARGIN * (t_max - t_min) + reach + margin
    return (
        s_max + s_slack >= 0.0
        and t_max + t_slack >= 0.0
        and s_min - s_slack <= n_cols
        and t_min - t_slack <= n_rows
    )
