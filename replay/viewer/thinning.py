"""However many rows come, few enough to keep and to draw."""

from __future__ import annotations

from array import array

import numpy as np

from pipeline.geometry import Array

# More points of a line than a screen can show.
MOST_ROWS = 20_000


class Thinned:
    """Evenly spaced rows of numbers: all of them up to `most`, then every second, fourth, …"""

    def __init__(self, width: int, most: int = MOST_ROWS) -> None:
        """`most`: even."""
        self._width, self._most = width, most
        self._flat = array("d")
        self._stride = 1
        self._count = 0
        self._last: tuple[float, ...] = ()

    def add(self, *row: float) -> None:
        if self._count % self._stride == 0:
            self._flat.extend(row)
            if len(self._flat) == self._most * self._width:
                every_second = np.array(self._flat).reshape(-1, self._width)[::2]
                self._flat = array("d", every_second.ravel())
                self._stride *= 2
        self._count += 1
        self._last = row

    def rows(self) -> Array:
        """What was kept (N, width), in order; first and last are always there."""
        kept = np.array(self._flat, dtype=np.float64).reshape(-1, self._width)
        if (self._count - 1) % self._stride == 0 or not self._count:
            return kept
        return np.vstack([kept, [self._last]])
