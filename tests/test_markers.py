"""The three ways to place a marker agree; an image drawn from the corners decodes."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.detection import ArucoDetection
from pipeline.geometry import Pose
from pipeline.markers import Facing, Marker, MarkerMap, marker_rotation
from tests import worlds


@pytest.mark.parametrize("facing", ["up", "down"])
@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.5, np.pi])
def test_the_three_ways_to_place_a_marker_agree(facing: Facing, yaw: float) -> None:
    xyz = (0.4, -0.2, 2.5)
    flat = Marker.from_yaw(3, xyz, yaw, facing, 0.15)
    quaternion = Pose(marker_rotation(yaw, facing), np.zeros(3)).quat_xyzw
    posed = Marker.from_pose(3, Pose.from_quat(xyz, quaternion), 0.15)
    cornered = Marker.from_corners(3, flat.corners_m)
    for other in (posed, cornered):
        np.testing.assert_allclose(other.corners_m, flat.corners_m, atol=1e-12)
        np.testing.assert_allclose(
            other.T_map_marker.rotation, flat.T_map_marker.rotation, atol=1e-9
        )
        assert other.size_m == pytest.approx(0.15)


def test_facing_down_as_the_design_writes_it() -> None:
    c, s = np.cos(0.3), np.sin(0.3)
    expected = np.array([[c, s, 0], [s, -c, 0], [0, 0, -1]])
    np.testing.assert_allclose(marker_rotation(0.3, "down"), expected, atol=1e-15)


def test_a_drawn_ceiling_marker_is_decoded_with_its_corners_in_the_maps_order() -> None:
    """Warps the printed marker onto its projected corners; a mirrored map would not decode."""
    camera = worlds.camera(ideal=True)
    marker_map = worlds.ceiling()
    T_map_camera = worlds.looking_up(0.1, -0.05, 0.3, 0.5)
    expected = worlds.corners(T_map_camera, camera, marker_map)
    image = worlds.draw(T_map_camera, camera, marker_map)
    found = ArucoDetection(corner_refinement="subpix").build(marker_map)(image)
    assert sorted(found.ids) == sorted(expected.ids)
    for marker_id, corners in zip(found.ids, found.corners_px, strict=True):
        index = list(expected.ids).index(marker_id)
        assert np.abs(corners - expected.corners_px[index]).max() < 1.5


@pytest.mark.parametrize(
    ("corners", "message"),
    [
        ([[0, 0, 0], [1, 0, 0], [1, 1, 0]], "shape"),
        ([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], "plane square"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], "plane square"),
        ([[0, 0, 0], [1, 0, 0.3], [1, 1, 0], [0, 1, 0.3]], "plane square"),
        ([[0, 0, 0]] * 4, "four different"),
    ],
)
def test_corners_that_are_no_square_are_refused(corners: list[list[float]], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Marker.from_corners(0, corners)


def test_a_map_with_mistakes_is_refused() -> None:
    marker = Marker.from_yaw(7, (0, 0, 1), 0, "down", 0.1)
    with pytest.raises(ValueError, match="twice"):
        MarkerMap("map", "DICT_4X4_50", (marker, marker))
    with pytest.raises(ValueError, match="DICT_9X9"):
        MarkerMap("map", "DICT_9X9", (marker,))
    with pytest.raises(ValueError, match="0 to 49"):
        MarkerMap("map", "DICT_4X4_50", (Marker.from_yaw(50, (0, 0, 1), 0, "down", 0.1),))
    with pytest.raises(ValueError, match="at least one"):
        MarkerMap("map", "DICT_4X4_50", ())
