"""From marker corners to the camera's pose: the paper's solver and the checks on its result."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field, PositiveFloat, PositiveInt, field_validator

from pipeline.camera import Camera
from pipeline.detection import Detections
from pipeline.geometry import Array, Pose
from pipeline.markers import MarkerMap
from pipeline.selection import MaxMarkers, Selection, check_spans, limit_at, select, usable
from pipeline.settings import Settings

BoolArray = npt.NDArray[np.bool_]

Status = Literal[
    "ok",
    "no_markers",
    "unknown_ids",
    "duplicate_ids",
    "solver_failed",
    "non_finite",
    "behind_markers",
    "reprojection",
    "undecodable",
]


@dataclass(frozen=True, eq=False)
class PoseFix:
    """One frame's pose, or why there is none; a rejected finite pose keeps its numbers.

    Attributes:
        n_detected: decoded markers, known or not.
        used_ids: markers handed to the solver, RANSAC's outliers included.
        n_explained: those whose four corners the pose fits within the gate.
        reprojection_rms_px: over the explained markers (NaN without any).
        reprojection_rms_used_px: over all used markers.
        fallback: RANSAC failed and the plain iterative solver gave the pose.
        mean_distance_m: from the camera to the centres of the used markers.
    """

    status: Status
    n_detected: int = 0
    used_ids: tuple[int, ...] = ()
    n_explained: int = 0
    T_map_camera: Pose | None = None
    reprojection_rms_px: float = np.nan
    reprojection_rms_used_px: float = np.nan
    fallback: bool = False
    mean_distance_m: float = np.nan

    @property
    def n_used(self) -> int:
        return len(self.used_ids)


class RansacIterative(Settings):
    """The paper's solver: all corners of all markers in one RANSAC, then Levenberg-Marquardt."""

    kind: Literal["ransac_iterative"] = "ransac_iterative"
    max_markers: MaxMarkers = Field(
        default=None, description="null: all; or by time: [{until_s: 12, n: 1}, {n: null}]"
    )
    selection: Selection = "nearest_center"
    max_reprojection_px: PositiveFloat = Field(
        default=5.0, description="a marker whose four corners fit better (rms) is explained"
    )
    ransac_reprojection_px: PositiveFloat = Field(default=8.0, description="OpenCV's default")
    ransac_iterations: PositiveInt = Field(default=100, description="OpenCV's default")
    ransac_confidence: Annotated[float, Field(gt=0, lt=1)] = Field(
        default=0.99, description="OpenCV's default"
    )

    @field_validator("max_markers")
    @classmethod
    def _spans_grow(cls, limit: MaxMarkers) -> MaxMarkers:
        return check_spans(limit)

    def __call__(
        self, detections: Detections, camera: Camera, marker_map: MarkerMap, time_s: float
    ) -> PoseFix:
        """The camera's pose from one image's detections, `time_s` seconds into the log."""
        found = usable(detections, marker_map)
        if found.reason is not None:
            return PoseFix(found.reason, n_detected=len(detections))
        chosen = select(
            found.detections, limit_at(self.max_markers, time_s), self.selection, camera
        )
        if camera.distortion_model == "equidistant":
            # A corner beyond the lens' 90° has no ideal pixel: that marker is of no use.
            rays = camera.undistort(chosen.corners_px.reshape(-1, 2)).reshape(len(chosen), -1)
            chosen = chosen.select(np.isfinite(rays).all(axis=1))
            if not len(chosen):
                return PoseFix("solver_failed", n_detected=len(detections))
        ids = tuple(int(i) for i in chosen.ids)
        T_camera_map, fallback = self._solve(chosen, camera, marker_map)
        if T_camera_map is None:
            return PoseFix("solver_failed", len(detections), ids, fallback=fallback)
        return judge(
            T_camera_map.inverse(),
            chosen,
            camera,
            marker_map,
            self.max_reprojection_px,
            n_detected=len(detections),
            fallback=fallback,
        )

    def _solve(
        self, chosen: Detections, camera: Camera, marker_map: MarkerMap
    ) -> tuple[Pose | None, bool]:
        """T_camera_map or None, and whether the fallback was needed."""
        object_points = marker_map.corners_m(int(i) for i in chosen.ids)
        pixels = chosen.corners_px.reshape(-1, 2)
        dist_coeffs: Array | None = camera.dist_coeffs
        if camera.distortion_model == "equidistant":
            # solvePnP knows no fisheye: hand it the pixels that an ideal lens would have given.
            pixels = camera.undistort(pixels) @ camera.camera_matrix[:2, :2].T
            pixels = pixels + camera.camera_matrix[:2, 2]
            dist_coeffs = None
        try:
            solved, rvec, tvec, _ = cv2.solvePnPRansac(
                object_points,
                pixels,
                camera.camera_matrix,
                dist_coeffs,
                iterationsCount=self.ransac_iterations,
                reprojectionError=self.ransac_reprojection_px,
                confidence=self.ransac_confidence,
                flags=cv2.SOLVEPNP_ITERATIVE,
            )
        except cv2.error:
            solved = False
        if solved:
            return Pose.from_rvec_tvec(rvec, tvec), False
        try:
            solved, rvec, tvec = cv2.solvePnP(
                object_points,
                pixels,
                camera.camera_matrix,
                dist_coeffs,
                flags=cv2.SOLVEPNP_ITERATIVE,
            )
        except cv2.error:
            solved = False
        return (Pose.from_rvec_tvec(rvec, tvec), True) if solved else (None, False)


def judge(
    T_map_camera: Pose,
    used: Detections,
    camera: Camera,
    marker_map: MarkerMap,
    max_reprojection_px: float,
    *,
    n_detected: int,
    fallback: bool = False,
) -> PoseFix:
    """A solver's pose with its status: finite, on the visible side, most markers explained.

    A marker is explained when its four corners' rms distance is at most `max_reprojection_px`.
    """
    ids = tuple(int(i) for i in used.ids)
    if not T_map_camera.is_finite():
        return PoseFix("non_finite", n_detected, ids, fallback=fallback)
    T_camera_map = T_map_camera.inverse()
    corners_camera = T_camera_map.apply(marker_map.corners_m(ids)).reshape(-1, 4, 3)
    projected = camera.project(corners_camera).reshape(-1, 4, 2)
    squares = ((projected - used.corners_px) ** 2).sum(axis=2)
    squares[~np.isfinite(squares)] = np.inf
    explained = np.sqrt(squares.mean(axis=1)) <= max_reprojection_px

    status: Status = "ok"
    # RANSAC's outliers may be anywhere; a marker that fits cannot show its back.
    asked = explained if explained.any() else np.ones_like(explained)
    if (~_printed_side(T_map_camera, corners_camera, ids, marker_map) & asked).any():
        status = "behind_markers"
    elif 2 * int(explained.sum()) <= len(ids):
        status = "reprojection"
    centres_m = np.array([marker_map.by_id[i].centre_m for i in ids])
    return PoseFix(
        status,
        n_detected,
        ids,
        int(explained.sum()),
        T_map_camera,
        float(np.sqrt(squares[explained].mean())) if explained.any() else np.nan,
        float(np.sqrt(squares.mean())),
        fallback,
        float(np.linalg.norm(centres_m - T_map_camera.translation, axis=1).mean()),
    )


def _printed_side(
    T_map_camera: Pose, corners_camera: Array, ids: tuple[int, ...], marker_map: MarkerMap
) -> BoolArray:
    """(N,) whether camera and printed face are in front of each other."""
    markers = [marker_map.by_id[i] for i in ids]
    facing = [float(m.normal @ (T_map_camera.translation - m.centre_m)) > 0 for m in markers]
    return np.array(facing) & (corners_camera[..., 2] > 0).all(axis=1)
