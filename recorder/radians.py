"""Angles that were written in radians where degrees are meant."""

from __future__ import annotations

import math

# Quarter turns in radians are written with two digits after the point, or more.
_OFF = 0.006


def looks_like_radians(angle_deg: float) -> bool:
    """Whether it is one to four quarter turns in radians: 1.57, -3.14, 6.283."""
    quarters = round(angle_deg / (math.pi / 2))
    return 1 <= abs(quarters) <= 4 and abs(angle_deg - quarters * math.pi / 2) < _OFF
