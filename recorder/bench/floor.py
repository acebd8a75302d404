"""A chessboard floor: places as rows and columns of its lines."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Floor:
    """Where the crossings of a chessboard floor's lines are in the map.

    Whole numbers are crossings, halves the middles of squares. Columns count along the floor's own
    x axis, rows to the left of it, so that seen from above rows go up where columns go right.

    Attributes:
        square_m: side of a square.
        origin_m: map x, y of the crossing of row 0 and column 0.
        yaw_rad: heading of the columns' direction in the map.
        z_m: height of the camera while it stands on this floor.
    """

    square_m: float
    origin_m: tuple[float, float] = (0.0, 0.0)
    yaw_rad: float = 0.0
    z_m: float | None = None

    def place(self, row: float, col: float) -> tuple[float, float]:
        """Map x, y in metres."""
        cos, sin = _exact(math.cos(self.yaw_rad)), _exact(math.sin(self.yaw_rad))
        x_m = self.origin_m[0] + self.square_m * (col * cos - row * sin)
        y_m = self.origin_m[1] + self.square_m * (col * sin + row * cos)
        return x_m, y_m

    def yaw_of(self, heading_rad: float) -> float:
        """Map yaw of a heading on the floor, counted from the columns' direction to the left."""
        return self.yaw_rad + heading_rad


def _exact(value: float) -> float:
    """Floors lie along the map's axes: no 6e-17 for the cosine of 90 degrees."""
    return round(value) + 0.0 if abs(value - round(value)) < 1e-15 else value
