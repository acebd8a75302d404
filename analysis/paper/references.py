"""The paper's numbers.

Source: S. Hinderer, M. Scheffler, B. Yang, "Investigation of ArUco Marker Placement for Planar
Indoor Localization", ICAR 2025, doi 10.1109/ICAR65334.2025.11338671.
"""

from __future__ import annotations

from typing import NamedTuple


class Row(NamedTuple):
    """RMSE and mean error: x and y in cm, heading in degrees."""

    rmse_x_cm: float
    rmse_y_cm: float
    rmse_yaw_deg: float
    mean_x_cm: float
    mean_y_cm: float
    mean_yaw_deg: float


# Classes of single markers, by the map's tags.
CLASSES: dict[str, tuple[str, ...]] = {
    "all": (),
    "90° inner": ("rot90", "inner"),
    "90° outer": ("rot90", "outer"),
    "45° inner": ("rot45", "inner"),
    "45° outer": ("rot45", "outer"),
    "22.5° outer": ("rot22.5", "outer"),
}

# Table II. Its 45° inner heading is a slip: an RMSE of 0.01 beside a mean of 0.24 cannot be.
PLACEMENT_LOW: dict[str, Row] = {
    "all": Row(2.75, 5.16, 0.36, 0.75, -0.52, -0.13),
    "90° inner": Row(1.70, 2.24, 0.28, 1.27, -1.77, 0.01),
    "90° outer": Row(1.00, 1.37, 0.77, -0.41, -1.31, -0.42),
    "45° inner": Row(3.61, 8.60, 0.01, 1.90, 3.98, 0.24),
    "45° outer": Row(1.83, 2.26, 0.19, 1.48, 1.93, -0.16),
    "22.5° outer": Row(3.49, 4.89, 0.26, -0.70, -4.62, -0.23),
}

# Table III.
PLACEMENT_HIGH: dict[str, Row] = {
    "all": Row(45.29, 31.38, 1.04, 10.34, -8.38, -0.03),
    "90° inner": Row(36.97, 5.66, 0.42, 15.72, -5.30, 0.01),
    "90° outer": Row(7.31, 5.53, 0.52, 2.74, 0.95, -0.25),
    "45° inner": Row(46.52, 51.10, 1.87, 1.43, -21.10, 0.85),
    "45° outer": Row(61.86, 53.22, 1.45, -3.67, -5.00, -1.17),
    "22.5° outer": Row(49.49, 14.27, 0.49, 22.93, -9.94, 0.19),
}

# Table IV, by number of markers.
COUNT: dict[int, Row] = {
    1: Row(45.29, 31.38, 1.04, 10.34, -8.38, -0.03),
    2: Row(24.94, 21.96, 0.59, 4.32, -4.28, -0.09),
    3: Row(8.83, 8.81, 0.16, 3.02, -3.62, -0.06),
    4: Row(5.10, 5.55, 0.10, 2.59, -3.75, -0.06),
    5: Row(3.72, 4.59, 0.08, 2.49, -3.79, -0.07),
    6: Row(3.22, 4.22, 0.07, 2.43, -3.78, -0.07),
    7: Row(2.97, 4.03, 0.07, 2.40, -3.77, -0.07),
}

# Share of markers with an error above 20 cm at 2.991 m.
LARGE_SHARE = {"inner": 0.50, "outer": 0.3125}
