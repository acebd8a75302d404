"""From an image to marker corners."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field, field_validator

from pipeline.geometry import Array
from pipeline.markers import MarkerMap, load_dictionary
from pipeline.settings import Settings

GrayImage = npt.NDArray[np.uint8]
CornerRefinement = Literal["none", "subpix", "contour", "apriltag"]

# Set by other keys, or (useAruco3Detection) silently switching the corner refinement off.
_RESERVED = ("cornerRefinementMethod", "detectInvertedMarker", "useAruco3Detection")


@dataclass(frozen=True, eq=False)
class Detections:
    """The markers decoded in one image, known or not.

    Attributes:
        ids: (N,) int64.
        corners_px: (N, 4, 2) distorted pixels, in the corner order of `Marker`.
    """

    ids: npt.NDArray[np.int64]
    corners_px: Array

    @classmethod
    def none(cls) -> Detections:
        return cls(np.empty(0, np.int64), np.empty((0, 4, 2)))

    def __len__(self) -> int:
        return len(self.ids)

    def select(self, index: npt.ArrayLike) -> Detections:
        """The detections at `index` (positions or a mask)."""
        return Detections(self.ids[index], self.corners_px[index])  # type: ignore[index]


class ArucoDetection(Settings):
    """OpenCV's ArUco detector; the paper's choice is its defaults with `contour` corners."""

    kind: Literal["aruco"] = "aruco"
    corner_refinement: CornerRefinement = "contour"
    parameters: dict[str, bool | int | float] = Field(
        default={}, description="further cv2.aruco.DetectorParameters, by OpenCV's names"
    )

    @field_validator("parameters")
    @classmethod
    def _known(cls, parameters: dict[str, bool | int | float]) -> dict[str, bool | int | float]:
        defaults = cv2.aruco.DetectorParameters()
        names = [n for n in dir(defaults) if n[0].islower() and not callable(getattr(defaults, n))]
        for name, value in parameters.items():
            if name in _RESERVED or name not in names:
                raise ValueError(
                    f"expected a name of cv2.aruco.DetectorParameters "
                    f"(without {', '.join(_RESERVED)}), found {name!r}"
                )
            try:
                setattr(defaults, name, value)
            except TypeError as error:
                expected = type(getattr(defaults, name)).__name__
                raise ValueError(f"expected {expected} for {name}, found {value!r}") from error
        _try_out(defaults)
        return dict(sorted(parameters.items()))

    def build(self, marker_map: MarkerMap) -> ArucoDetector:
        return ArucoDetector(self, marker_map)


def _try_out(parameters: cv2.aruco.DetectorParameters) -> None:
    """Detects one drawn marker: OpenCV checks its parameters only where it uses them.

    Raises:
        ValueError: OpenCV refuses them.
    """
    dictionary = load_dictionary("DICT_4X4_50")
    image = np.full((120, 120), 255, np.uint8)
    image[30:90, 30:90] = cv2.aruco.generateImageMarker(dictionary, 7, 60)
    try:
        cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(image)
    except cv2.error as error:
        raise ValueError(f"expected what OpenCV accepts, found: {error.err}") from error


class ArucoDetector:
    """Finds the markers of a map's dictionary in gray images."""

    def __init__(self, settings: ArucoDetection, marker_map: MarkerMap) -> None:
        parameters = cv2.aruco.DetectorParameters()
        for name, value in settings.parameters.items():
            setattr(parameters, name, value)
        method = f"CORNER_REFINE_{settings.corner_refinement.upper()}"
        parameters.cornerRefinementMethod = getattr(cv2.aruco, method)
        # Not the negative of the image: there CONTOUR's half-pixel shift goes the other way, and on
        # a real white-on-black board the position error grew by a quarter.
        parameters.detectInvertedMarker = marker_map.inverted
        self._detector = cv2.aruco.ArucoDetector(load_dictionary(marker_map.dictionary), parameters)

    def __call__(self, image: GrayImage) -> Detections:
        """The markers in a gray image (H, W), in OpenCV's order."""
        corners, ids, _ = self._detector.detectMarkers(image)
        if ids is None or len(corners) == 0:
            return Detections.none()
        return Detections(
            np.asarray(ids).ravel().astype(np.int64),
            np.asarray(corners, dtype=np.float64).reshape(-1, 4, 2),
        )
