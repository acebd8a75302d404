"""How the camera moves: its exact pose T_map_camera at any time."""

from __future__ import annotations

import math
from bisect import bisect_right
from itertools import pairwise
from typing import Annotated, Literal, Self, TypeAlias

import cv2
import numpy as np
from pydantic import Field, model_validator

from pipeline.geometry import Array, Pose, rotation_z
from recorder.files.yaml_file import FileModel
from recorder.simulation.optics import NotNegative, Positive, Vector2, Vector3

Looking: TypeAlias = Literal["up", "down"]
Corner: TypeAlias = Literal["top_left", "top_right", "bottom_right", "bottom_left"]

# Clockwise seen with map x to the right and y up; signs of the offsets from the centre.
_CORNERS: dict[Corner, tuple[int, int]] = {
    "top_left": (-1, 1),
    "top_right": (1, 1),
    "bottom_right": (1, -1),
    "bottom_left": (-1, -1),
}


def camera_rotation(
    looking: Looking, yaw_rad: float, roll_rad: float = 0.0, pitch_rad: float = 0.0
) -> Array:
    """R_map_camera (3, 3): heading, then pitch about its y axis, then roll about its x axis.

    Looking up, the optical axis is map z; looking down, it is -z. Neither tilt changes the yaw.
    """
    rotation = rotation_z(yaw_rad)
    if looking == "down":
        rotation = rotation @ np.diag([1.0, -1.0, -1.0])
    pitch, _ = cv2.Rodrigues(np.array([0.0, pitch_rad, 0.0]))
    roll, _ = cv2.Rodrigues(np.array([roll_rad, 0.0, 0.0]))
    return np.asarray(rotation @ pitch @ roll, dtype=np.float64)


class _Attitude(FileModel):
    looking: Looking
    roll_deg: float = 0.0
    pitch_deg: float = 0.0

    def _pose(self, xyz_m: list[float], yaw_rad: float) -> Pose:
        roll, pitch = math.radians(self.roll_deg), math.radians(self.pitch_deg)
        return Pose(camera_rotation(self.looking, yaw_rad, roll, pitch), np.array(xyz_m))


class StaticTrajectory(_Attitude):
    """A camera that stands still."""

    kind: Literal["static"] = "static"
    xyz_m: Vector3
    yaw_deg: float = 0.0

    @property
    def duration_s(self) -> float | None:
        return None

    def pose(self, t_s: float) -> Pose:
        return self._pose(self.xyz_m, math.radians(self.yaw_deg))


class RectangleTrajectory(_Attitude):
    """Once around a rectangle along map x and y, at constant speed, turning on the spot.

    The drive ends where it starts; before and after it the camera stands there.
    """

    kind: Literal["rectangle"] = "rectangle"
    centre_m: Vector2 = Field(default=[0.0, 0.0])
    width_m: Annotated[float, Field(gt=0, description="along x")]
    height_m: Annotated[float, Field(gt=0, description="along y")]
    z_m: float = 0.0
    speed_mps: Positive
    start: Corner = "top_left"
    direction: Literal["clockwise", "counterclockwise"] = "clockwise"
    dwell_s: Annotated[NotNegative, Field(description="stands at the start first")] = 0.0
    yaw_deg: Annotated[float | Literal["follow"], Field(description="follow: ahead")] = 0.0

    @property
    def duration_s(self) -> float | None:
        return self.dwell_s + 2 * (self.width_m + self.height_m) / self.speed_mps

    @property
    def corners_m(self) -> Array:
        """(4, 2) corners in the order of the drive."""
        names = list(_CORNERS)
        step = 1 if self.direction == "clockwise" else -1
        first = names.index(self.start)
        signs = np.array([_CORNERS[names[(first + step * i) % 4]] for i in range(4)])
        return np.array(self.centre_m) + signs * (self.width_m / 2, self.height_m / 2)

    def pose(self, t_s: float) -> Pose:
        corners = self.corners_m
        sides = np.roll(corners, -1, axis=0) - corners
        lengths = np.linalg.norm(sides, axis=1)
        driven_m = float(np.clip((t_s - self.dwell_s) * self.speed_mps, 0.0, lengths.sum()))
        ends = np.cumsum(lengths)
        side = min(int(np.searchsorted(ends, driven_m, side="right")), 3)
        ahead = sides[side] / lengths[side]
        x, y = corners[side] + ahead * (driven_m - ends[side] + lengths[side])
        yaw_rad = (
            math.atan2(ahead[1], ahead[0])
            if self.yaw_deg == "follow"
            else math.radians(self.yaw_deg)
        )
        return self._pose([float(x), float(y), self.z_m], yaw_rad)


class Waypoint(FileModel):
    """Where the camera is at a time."""

    t_s: NotNegative
    xyz_m: Vector3
    yaw_deg: float = 0.0
    roll_deg: float = 0.0
    pitch_deg: float = 0.0


class WaypointTrajectory(FileModel):
    """Straight between timed points, turning evenly (slerp); it stands before and after them."""

    kind: Literal["waypoints"] = "waypoints"
    looking: Looking
    points: Annotated[list[Waypoint], Field(min_length=2)]

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        times = [point.t_s for point in self.points]
        for before, after in pairwise(times):
            if after <= before:
                raise ValueError(f"expected increasing t_s, found {after} after {before}")
        return self

    @property
    def duration_s(self) -> float | None:
        return self.points[-1].t_s

    def pose(self, t_s: float) -> Pose:
        last = len(self.points) - 2
        i = min(max(bisect_right(self.points, t_s, key=lambda p: p.t_s) - 1, 0), last)
        start, end = self.points[i], self.points[i + 1]
        share = min(max((t_s - start.t_s) / (end.t_s - start.t_s), 0.0), 1.0)
        T_map_start, T_map_end = self._at(start), self._at(end)
        turn = (T_map_start.inverse() @ T_map_end).rvec
        step, _ = cv2.Rodrigues(turn * share)
        moved = T_map_end.translation - T_map_start.translation
        return Pose(T_map_start.rotation @ step, T_map_start.translation + share * moved)

    def _at(self, point: Waypoint) -> Pose:
        yaw, roll, pitch = (
            math.radians(a) for a in (point.yaw_deg, point.roll_deg, point.pitch_deg)
        )
        return Pose(camera_rotation(self.looking, yaw, roll, pitch), np.array(point.xyz_m))


AnyTrajectory: TypeAlias = Annotated[
    StaticTrajectory | RectangleTrajectory | WaypointTrajectory, Field(discriminator="kind")
]
