"""How the true site differs from what the log is told."""

from __future__ import annotations

from typing import Annotated

import cv2
import numpy as np
from pydantic import Field

from pipeline.camera import Camera
from pipeline.geometry import Pose
from pipeline.markers import Marker, MarkerMap
from recorder.files.yaml_file import FileModel
from recorder.simulation.optics import NotNegative, Vector2


class InstallationErrors(FileModel):
    """Errors of installation and calibration: told to true, drawn with the scene's seed."""

    marker_position_std_m: Annotated[
        NotNegative, Field(description="each of the two directions of the marker's plane")
    ] = 0.0
    marker_height_std_m: Annotated[NotNegative, Field(description="across its plane")] = 0.0
    marker_yaw_std_deg: Annotated[NotNegative, Field(description="in its plane")] = 0.0
    marker_tilt_std_deg: Annotated[NotNegative, Field(description="about its x and y axes")] = 0.0
    focal: Annotated[float, Field(gt=-0.5, lt=1, description="true = told * (1 + focal)")] = 0.0
    principal_point_px: Vector2 = Field(default=[0.0, 0.0], description="true - told")

    @property
    def of_camera(self) -> bool:
        return bool(self.focal or any(self.principal_point_px))

    @property
    def of_markers(self) -> bool:
        return bool(
            self.marker_position_std_m
            or self.marker_height_std_m
            or self.marker_yaw_std_deg
            or self.marker_tilt_std_deg
        )

    def apply_to_camera(self, camera: Camera) -> Camera:
        """The true camera."""
        matrix = np.array(camera.camera_matrix)
        matrix[0, 0] *= 1.0 + self.focal
        matrix[1, 1] *= 1.0 + self.focal
        matrix[:2, 2] += self.principal_point_px
        return Camera(
            camera.width_px,
            camera.height_px,
            matrix,
            camera.distortion_model,
            camera.dist_coeffs,
            camera.name,
        )

    def apply_to_map(self, told: MarkerMap, seed: int) -> MarkerMap:
        """The true map; a marker's error depends on the seed and its id alone."""
        return MarkerMap(
            told.frame,
            told.dictionary,
            tuple(self._moved(marker, seed) for marker in told.markers),
            told.inverted,
        )

    def _moved(self, marker: Marker, seed: int) -> Marker:
        draws = np.random.default_rng([seed, 3, marker.id]).standard_normal(6)
        across, height = self.marker_position_std_m, self.marker_height_std_m
        tilt, yaw = self.marker_tilt_std_deg, self.marker_yaw_std_deg
        shift = draws[:3] * (across, across, height)
        turn, _ = cv2.Rodrigues(np.radians(draws[3:] * (tilt, tilt, yaw)))
        T_marker_true = Pose(np.asarray(turn, dtype=np.float64), shift)
        T_map_true = marker.T_map_marker @ T_marker_true
        return Marker.from_pose(marker.id, T_map_true, marker.size_m, marker.std_m, marker.tags)
