"""Where in the image the board was, how it was tilted, and what is missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.geometry import Array
from replay.calibration.views import View

# Cells of the coverage map along the longer side.
_CELLS = 96
_REGIONS = (
    ("top left", "top", "top right"),
    ("left", "centre", "right"),
    ("bottom left", "bottom", "bottom right"),
)
# Of a region's area, within the board of at least one view.
_REGION_COVERED = 0.3
# Below this tilt the distance and the focal length look nearly alike.
TILTED_DEG = 15.0
_TILTED_VIEWS = 2


@dataclass(frozen=True, eq=False)
class Coverage:
    """What the views cover.

    Attributes:
        counts: (rows, cols) in how many views a cell of the image is within the corners found.
        tilts_deg: (V, 2) of the board's normal from the optical axis, to the right and down.
    """

    counts: npt.NDArray[np.int64]
    tilts_deg: Array

    @property
    def share(self) -> float:
        """Of the image's area, within the corners of at least one view."""
        return float(np.mean(self.counts > 0))

    @property
    def regions(self) -> dict[str, float]:
        """The same for each ninth of the image."""
        rows = np.array_split(self.counts > 0, 3, axis=0)
        return {
            name: float(np.mean(part))
            for names, row in zip(_REGIONS, rows, strict=True)
            for name, part in zip(names, np.array_split(row, 3, axis=1), strict=True)
        }

    @property
    def missing_regions(self) -> list[str]:
        return [name for name, share in self.regions.items() if share < _REGION_COVERED]

    @property
    def missing_tilts(self) -> list[str]:
        enough = np.count_nonzero(np.abs(self.tilts_deg) >= TILTED_DEG, axis=0) >= _TILTED_VIEWS
        ways = ("to the left or right", "up or down")
        return [way for way, is_enough in zip(ways, enough, strict=True) if not is_enough]

    def missing(self) -> str | None:
        """What to take more views of, for people; None when nothing is missing."""
        parts = []
        if self.missing_regions:
            parts.append(f"with the board at the {_listed(self.missing_regions)} of the image")
        if self.missing_tilts:
            parts.append(f"with the board tilted {_listed(self.missing_tilts)} by 20° to 45°")
        return ", and ".join(parts) or None


def coverage(
    views: Sequence[View], poses: Sequence[Array], image_size: tuple[int, int]
) -> Coverage:
    """
    Args:
        poses: axis-angle and translation of T_camera_board; may be fewer, where some have none.
    """
    scale = _CELLS / max(image_size)
    shape = max(3, round(image_size[1] * scale)), max(3, round(image_size[0] * scale))
    counts = np.zeros(shape, np.int64)
    for view in views:
        outline = cv2.convexHull((view.pixels + 0.5).astype(np.float32)).reshape(-1, 2)
        cells = np.round(outline * (shape[1] / image_size[0], shape[0] / image_size[1]) - 0.5)
        inside = np.zeros(shape, np.uint8)
        cv2.fillConvexPoly(inside, cells.astype(np.int32), (1,))
        counts += inside
    return Coverage(counts, np.array([tilt_deg(pose) for pose in poses]).reshape(-1, 2))


def tilt_deg(pose: Array) -> Array:
    """(2,) the angles of the board's normal from the optical axis, to the right and down."""
    rotation, _ = cv2.Rodrigues(pose[:3])
    x, y, z = np.asarray(rotation)[:, 2]
    sign = 1.0 if z >= 0 else -1.0
    return np.degrees([np.arctan2(sign * x, abs(z)), np.arctan2(sign * y, abs(z))])


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
