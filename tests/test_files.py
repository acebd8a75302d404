"""The files people write: what is read, what is written back, and what is said about mistakes."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pipeline.camera import Camera
from pipeline.geometry import Pose
from pipeline.markers import Facing, Marker, MarkerMap
from recorder.errors import InputError
from recorder.files.camera_file import camera_yaml, parse_camera
from recorder.files.map_file import map_yaml, parse_map
from recorder.files.truth_file import check_frame, parse_truth, truth_kind
from recorder.files.yaml_file import parse_yaml

CAMERA = b"""\
image_width: 640
image_height: 480
camera_name: 7
camera_matrix: {rows: 3, cols: 3, data: [500, 0, 320, 0, 501, 240, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-1e-1, 0.01, 0, 0, 0]}
binning_x: 0
roi: {x_offset: 0, y_offset: 0, height: 0, width: 0, do_rectify: false}
"""
MAP = """\
frame: map
dictionary: DICT_6X6_1000
size_m: 0.15
markers:
  - {id: 0, xyz_m: [0.333, 0.0, 2.5], yaw_deg: 90, facing: down}
  - {id: 1, xyz_m: [1.0, 0.5, 1.2], quat_xyzw: [0.5, 0.5, 0.5, 0.5], size_m: 0.2, std_m: 0.01}
  - {id: 2, corners_m: [[0, 0.1, 0], [0.1, 0.1, 0], [0.1, 0, 0], [0, 0, 0]], tags: [inner, rot90]}
"""
POSE = "1 2 3 0 0 0 1"


def problem(parse: object, data: bytes | str, name: str = "x.yaml") -> str:
    raw = data.encode() if isinstance(data, str) else data
    with pytest.raises(InputError) as caught:
        parse(raw, Path(name))  # type: ignore[operator]
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith(name)
    return text


def test_camera_is_read_as_ros_writes_it() -> None:
    camera = parse_camera(CAMERA, Path("camera.yaml"))
    assert camera.image_size == (640, 480)
    assert camera.name == "7"
    np.testing.assert_array_equal(camera.camera_matrix, [[500, 0, 320], [0, 501, 240], [0, 0, 1]])
    np.testing.assert_array_equal(camera.dist_coeffs, [-0.1, 0.01, 0, 0, 0])


@given(
    numbers=hnp.arrays(np.float64, 4, elements=st.floats(1e-9, 1e6)),
    coefficients=hnp.arrays(np.float64, 8, elements=st.floats(-1e3, 1e3)),
)
def test_camera_round_trips_number_for_number(
    numbers: np.typing.NDArray[np.float64], coefficients: np.typing.NDArray[np.float64]
) -> None:
    fx, fy, cx, cy = numbers
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    camera = Camera(64, 48, matrix, "rational_polynomial", coefficients, "odd: name")
    back = parse_camera(camera_yaml(camera), Path("camera.yaml"))
    np.testing.assert_array_equal(back.camera_matrix, camera.camera_matrix)
    np.testing.assert_array_equal(back.dist_coeffs, camera.dist_coeffs)
    assert (back.name, back.distortion_model) == (camera.name, camera.distortion_model)


@pytest.mark.parametrize(
    "name", ["1e5", "1E-3", "007", "yes", "~", "a: b", "", "Küche", "x\u2028y"]
)
def test_a_cameras_name_comes_back_as_it_was(name: str) -> None:
    camera = replace(parse_camera(CAMERA, Path("camera.yaml")), name=name)
    assert parse_camera(camera_yaml(camera), Path("camera.yaml")).name == name


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b"image_width: 640\n", b"", ["image_width", "found none"]),
        (b"image_width", b"imagewidth", ["imagewidth", "did you mean image_width?"]),
        (b"640", b"6.5", ["image_width", "integer", "6.5"]),
        (b"640", b"-640", ["image_width", "-640"]),
        (b"rows: 3", b"rowz: 3", ["camera_matrix.rowz", "did you mean rows?"]),
        (b"[500, 0,", b"[500,", ["camera_matrix.data", "9 numbers", "8"]),
        (b"[500, 0,", b"[five, 0,", ["camera_matrix.data[0]", "number", "'five'"]),
        (b"[500, 0,", b"[.nan, 0,", ["camera_matrix.data[0]", "finite", "nan"]),
        (b"plumb_bob", b"fisheye", ["plumb_bob", "equidistant", "'fisheye'"]),
        (b"plumb_bob", b"equidistant", ["4 coefficients", "found 5"]),
        (b"binning_x: 0", b"binning_x: 2", ["binning_x", "unbinned", "2"]),
        (b"x_offset: 0", b"x_offset: 8", ["roi", "whole image"]),
        (b"roi: {", b"image_width: 3\nroi: {", ["line 8", "once", "image_width"]),
        (b"image_width: 640", b"image_width: [640", ["line"]),
        (b"image_width: 640", b"image_width: \xff", ["line 1", "UTF-8"]),
        (b"image_width: 640", b"image_width: \x07", ["line 1", "control character"]),
        (b"image_width: 640", b"image_width: 2024-13-45", ["YAML"]),
        (b"image_width: 640", b"image_width: !!python/name:os.system ''", ["line 1"]),
    ],
)
def test_camera_mistakes_are_named(old: bytes, new: bytes, words: list[str]) -> None:
    assert old in CAMERA
    text = problem(parse_camera, CAMERA.replace(old, new, 1))
    assert all(word in text for word in words), text


@pytest.mark.parametrize("data", [b"", b"# nothing\n", b"- 1\n", b"text", b"42"])
def test_what_is_no_mapping_is_said(data: bytes) -> None:
    assert "expected keys and values" in problem(parse_camera, data)


@given(st.binary(max_size=200))
def test_no_bytes_break_the_yaml_reader(data: bytes) -> None:
    with suppress(InputError):
        parse_yaml(data, Path("x.yaml"))


def test_map_places_markers_in_three_ways() -> None:
    marker_map = parse_map(MAP.encode(), Path("map.yaml"))
    down, free, corners = marker_map.markers
    # Facing down with yaw 90: x points to map y, y to map x, the print looks down.
    np.testing.assert_allclose(
        down.T_map_marker.rotation, [[0, 1, 0], [1, 0, 0], [0, 0, -1]], atol=1e-12
    )
    np.testing.assert_allclose(down.corners_m[0], [0.333 + 0.075, -0.075, 2.5], atol=1e-12)
    assert (free.size_m, free.std_m) == (0.2, 0.01)
    # A third of a turn about (1, 1, 1): x to y, y to z, z to x.
    np.testing.assert_allclose(free.T_map_marker.apply([[1, 0, 0]]), [[1.0, 1.5, 1.2]])
    assert corners.tags == ("inner", "rot90")
    np.testing.assert_array_equal(corners.corners_m[0], [0, 0.1, 0])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[1.0, 0.5, 1.2]", "[1.0, 0.5]", ["markers[1].xyz_m", "3 items", "2"]),
        ("facing: down", "facing: left", ["markers[0].facing", "'up' or 'down'", "'left'"]),
        ("yaw_deg", "yaw_dge", ["markers[0].yaw_dge", "did you mean yaw_deg?"]),
        (", facing: down", "", ["markers[0]", "one way", "xyz_m, yaw_deg"]),
        ("facing: down", "facing: down, quat_xyzw: [0, 0, 0, 1]", ["markers[0]", "one way"]),
        ("id: 2, corners_m", "id: 2, corner_m", ["markers[2].corner_m", "corners_m?"]),
        ("id: 1,", "id: 0,", ["markers[1].id", "once", "markers[0]"]),
        ("id: 1,", "id: 1000,", ["0 to 999", "1000"]),
        ("id: 1,", "id: yes,", ["markers[1].id", "integer", "True"]),
        ("DICT_6X6_1000", "DICT_6X6", ["dictionary", "'DICT_6X6'"]),
        ("size_m: 0.15\n", "", ["markers[0]", "size_m"]),
        ("size_m: 0.15\n", "size_m: 0\n", ["size_m", "greater than 0"]),
        ("[0.5, 0.5, 0.5, 0.5]", "[0, 0, 0, 0]", ["markers[1]", "length above zero"]),
        ("[0, 0.1, 0]", "[0, 0.2, 0]", ["markers[2]", "square"]),
        ("tags:", "size_m: 0.2, tags:", ["markers[2]", "0.2", "0.1000"]),
        ("tags: [inner, rot90]", "tags: inner", ["markers[2].tags", "list", "'inner'"]),
    ],
)
def test_map_mistakes_are_named(old: str, new: str, words: list[str]) -> None:
    assert old in MAP
    text = problem(parse_map, MAP.replace(old, new, 1), "map.yaml")
    assert all(word in text for word in words), text


coordinates = st.floats(-50, 50)


@st.composite
def markers(draw: st.DrawFn, id: int) -> Marker:
    xyz = [draw(coordinates) for _ in range(3)]
    size_m = draw(st.sampled_from([0.1, 0.15, 0.3]))
    std_m = draw(st.none() | st.floats(1e-4, 0.1))
    tags = tuple(draw(st.lists(st.sampled_from(["inner", "a b", "yes", "1"]), max_size=2)))
    kind = draw(st.sampled_from(["yaw", "quat", "corners"]))
    if kind == "yaw":
        yaw_rad = draw(st.floats(-4, 4))
        facing: Facing = draw(st.sampled_from(["up", "down"]))
        return Marker.from_yaw(id, xyz, yaw_rad, facing, size_m, std_m, tags)
    quat = np.array([draw(st.floats(-1, 1)) for _ in range(4)]) + np.array([0, 0, 0, 3.0])
    marker = Marker.from_pose(id, Pose.from_quat(xyz, quat), size_m, std_m, tags)
    if kind == "quat":
        return marker
    offset = np.array([[draw(st.floats(-1e-3, 1e-3)) for _ in range(3)] for _ in range(4)])
    return Marker.from_corners(id, marker.corners_m + offset, std_m, tags)


@given(st.lists(st.integers(0, 999), min_size=1, max_size=6, unique=True).flatmap(
    lambda ids: st.tuples(*(markers(i) for i in ids))
), st.booleans())  # fmt: skip
def test_map_round_trips(placed: tuple[Marker, ...], inverted: bool) -> None:
    marker_map = MarkerMap("hall 2", "DICT_6X6_1000", placed, inverted)
    back = parse_map(map_yaml(marker_map), Path("map.yaml"))
    assert (back.frame, back.dictionary, back.inverted) == ("hall 2", "DICT_6X6_1000", inverted)
    for a, b in zip(marker_map.markers, back.markers, strict=True):
        assert (a.id, a.std_m, a.tags) == (b.id, b.std_m, b.tags)
        np.testing.assert_allclose(a.corners_m, b.corners_m, rtol=0, atol=1e-9)
        np.testing.assert_allclose(a.T_map_marker.rotation, b.T_map_marker.rotation, atol=1e-8)
        assert math.isclose(a.size_m, b.size_m, rel_tol=1e-9)


def test_truth_yaml_is_read() -> None:
    truth = parse_truth(
        b"frame: hall\nmethod: tape\n"
        b"path: {points_m: [[0,0],[3,0]], closed: true, std_m: 5e-2}\n"
        b"poses: [{from_s: 1, to_s: 2, x_m: 1, y_m: 2, yaw_deg: 180, std_m: 0.01}]\n",
        Path("truth.yaml"),
    )
    assert (truth.frame, truth.method, truth.trajectory) == ("hall", "tape", None)
    assert truth.path is not None
    np.testing.assert_array_equal(truth.path.points_m, [[0, 0], [3, 0]])
    assert (truth.path.closed, truth.path.std_m) == (True, 0.05)
    (pose,) = truth.poses
    assert (pose.z_m, pose.yaw_rad) == (None, math.pi)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ("frame: map\n", ["path, poses or both"]),
        ("path: {points_m: [[0,0],[1,1]]}", ["path.std_m", "found none"]),
        ("path: {points_m: [[0,0]], std_m: 1}", ["path.points_m", "2 items"]),
        ("path: {points_m: [[0,0],[1,1,1]], std_m: 1}", ["path.points_m[1]", "2 items"]),
        ("poses: [{from_s: 2, to_s: 1, x_m: 0, y_m: 0, std_m: 1}]", ["poses[0]", "after from_s"]),
        (
            "poses: [{from_s: 4, to_s: 6, x_m: 0, y_m: 0, std_m: 1},"
            " {from_s: 0, to_s: 5, x_m: 0, y_m: 0, std_m: 1}]",
            ["poses[0].from_s", "overlap", "poses[1]"],
        ),
    ],
)
def test_truth_mistakes_are_named(data: str, words: list[str]) -> None:
    text = problem(parse_truth, data)
    assert all(word in text for word in words), text


@given(st.lists(st.integers(0, 2 * 10**18), min_size=1, max_size=20, unique=True))
def test_tum_times_are_exact_to_the_nanosecond(stamps_ns: list[int]) -> None:
    lines = [f"{Decimal(ns) / 10**9} {POSE}" for ns in stamps_ns]
    truth = parse_truth("\n".join(["# t x y z ...", *lines]).encode(), Path("t.tum"))
    assert truth.trajectory is not None
    assert truth.trajectory.timestamp_ns is not None
    assert truth.trajectory.timestamp_ns.tolist() == sorted(stamps_ns)
    assert truth.trajectory.frame_index is None


def test_csv_is_sorted_and_may_have_more_columns() -> None:
    data = "note,frame_index,x_m,y_m,z_m,qx,qy,qz,qw\nb,7,4,5,6,0,0,1,0\na,2,1,2,3,0,0,0,1\n"
    trajectory = parse_truth(data.encode(), Path("t.csv")).trajectory
    assert trajectory is not None
    assert trajectory.frame_index is not None
    assert trajectory.frame_index.tolist() == [2, 7]
    np.testing.assert_array_equal(trajectory.positions_m, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(trajectory.quats_xyzw, [[0, 0, 0, 1], [0, 0, 1, 0]])


HEADER = "frame_index,x_m,y_m,z_m,qx,qy,qz,qw\n"


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("t.tum", f"0 {POSE}\n1 2 3\n", ["line 2", "3 fields"]),
        ("t.tum", f"0 {POSE}\n0 {POSE}\n", ["line 2", "once"]),
        ("t.tum", "0 1 2 3 0 0 0 nan\n", ["line 1", "qw", "'nan'"]),
        ("t.tum", "0 1 2 3 1 0 0 1\n", ["line 1", "length 1", "1.414"]),
        ("t.tum", f"inf {POSE}\n", ["line 1", "t", "'inf'"]),
        ("t.tum", "# nothing\n", ["at least one pose"]),
        ("t.csv", "", ["header", "frame_index or timestamp_ns"]),
        ("t.csv", "stamp,x,y\n", ["header", "stamp, x, y"]),
        ("t.csv", HEADER + "0,1,2,3,0,0,0,1\n1.5,1,2,3,0,0,0,1\n", ["line 3", "'1.5'"]),
        ("t.csv", HEADER + "0,1,2,3\n", ["line 2", "8 columns", "4"]),
        ("t.csv", HEADER + "0,1,2,3,0,0,0,1\n0,1,2,3,0,0,0,1\n", ["line 3", "once"]),
    ],
)
def test_trajectory_mistakes_are_named(name: str, data: str, words: list[str]) -> None:
    text = problem(parse_truth, data, name)
    assert all(word in text for word in words), text


def test_kind_of_truth_is_seen_in_its_content() -> None:
    assert truth_kind(f"# x\n1.5 {POSE}".encode(), Path("gt.txt")) == "tum"
    assert truth_kind((HEADER + "0").encode(), Path("gt")) == "csv"
    assert truth_kind(b"frame: map\n", Path("gt")) == "yaml"
    assert truth_kind(b"frame: map\n", Path("gt.CSV")) == "csv"


def test_truth_in_another_frame_than_the_map_is_refused() -> None:
    marker_map = parse_map(MAP.encode(), Path("map.yaml"))
    poses = b"poses: [{from_s: 0, to_s: 1, x_m: 0, y_m: 0, std_m: 1}]"
    check_frame(parse_truth(b"frame: map\n" + poses, Path("t.yaml")), marker_map, Path("t.yaml"))
    check_frame(parse_truth(f"0 {POSE}".encode(), Path("t.tum")), marker_map, Path("t.tum"))
    other = parse_truth(b"frame: hall\n" + poses, Path("t.yaml"))
    with pytest.raises(InputError, match=r"t\.yaml: frame: .*'map'.*'hall'"):
        check_frame(other, marker_map, Path("t.yaml"))


def test_shared_files_are_read(shared_data: Path) -> None:
    for path in shared_data.rglob("camera.yaml"):
        assert parse_camera(path.read_bytes(), path).width_px >= 640
    for path in shared_data.rglob("map.yaml"):
        marker_map = parse_map(path.read_bytes(), path)
        back = parse_map(map_yaml(marker_map), path)
        for a, b in zip(marker_map.markers, back.markers, strict=True):
            np.testing.assert_allclose(a.corners_m, b.corners_m, rtol=0, atol=1e-9)
    path = shared_data / "moving_board" / "cam_0" / "truth.csv"
    trajectory = parse_truth(path.read_bytes(), path).trajectory
    assert trajectory is not None
    assert len(trajectory) == 57
