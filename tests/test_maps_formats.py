"""Maps of other tools: what one entry of theirs means in space, by hand, and there and back."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner, Result
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.geometry import Array, Pose, rotation_z
from pipeline.markers import Marker, MarkerMap, load_dictionary
from recorder.errors import InputError
from recorder.files.map_file import parse_map
from recorder.map_cli import map_group
from recorder.maps.fiducial_slam import roll_pitch_yaw
from recorder.maps.formats import FormatName, MapDefaults, export_map, import_map

SITE = Path("map.yaml")
HALF_M = 0.05
TAGS = MapDefaults("DICT_APRILTAG_36h11", 2 * HALF_M)


def wpilib(W: float, X: float, Y: float, Z: float) -> bytes:
    pose = {
        "translation": {"x": 1.0, "y": 2.0, "z": 3.0},
        "rotation": {"quaternion": {"W": W, "X": X, "Y": Y, "Z": Z}},
    }
    layout = {"tags": [{"ID": 4, "pose": pose}], "field": {"length": 16.5, "width": 8.0}}
    return json.dumps(layout).encode()


# Corners about (1, 2, 3) in half sides: first, second (so OpenCV's x axis), third, fourth.
@pytest.mark.parametrize(
    ("name", "data", "corners"),
    [
        # Unturned, a tag looks along +x with its own up along z: who looks at it from +x has y to
        # the right. OpenCV's first corner is AprilTag's lower right, then lower left.
        ("wpilib", wpilib(1, 0, 0, 0), [(0, 1, -1), (0, -1, -1), (0, -1, 1), (0, 1, 1)]),
        # Turned by 180 degrees about z it looks along -x, right is -y.
        ("wpilib", wpilib(0, 0, 0, 1), [(0, -1, -1), (0, 1, -1), (0, 1, 1), (0, -1, 1)]),
        # By 90 degrees about y it looks down, its up is +x, right is +y.
        (
            "wpilib",
            wpilib(0.5**0.5, 0, 0.5**0.5, 0),
            [(-1, 1, 0), (-1, -1, 0), (1, -1, 0), (1, 1, 0)],
        ),
        # fiducial_slam: unturned, the print lies on the floor, right is +x, up is +y.
        (
            "fiducial_slam",
            b"4 1 2 3 0 0 0 0 0\n",
            [(-1, 1, 0), (1, 1, 0), (1, -1, 0), (-1, -1, 0)],
        ),
        # Rolled by 180 degrees it hangs on the ceiling: up is -y.
        (
            "fiducial_slam",
            b"4 1 2 3 180 0 0 0 0 5 6\n",
            [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)],
        ),
        # Rolled by 90 degrees: on a wall, up is z, it looks along -y. Then yaw by 90: it looks
        # along +x, right is +y.
        (
            "fiducial_slam",
            b"4 1 2 3 90 0 90 0 0\n",
            [(0, -1, 1), (0, 1, 1), (0, 1, -1), (0, -1, -1)],
        ),
        # Pitch by 90: right is down, it looks along +x, up is +y.
        (
            "fiducial_slam",
            b"4 1 2 3 0 90 0 0 0\n",
            [(0, 1, 1), (0, 1, -1), (0, -1, -1), (0, -1, 1)],
        ),
        # CSV: facing down with yaw 90, right is +y; up is that of the ceiling seen from below, +x.
        (
            "csv",
            b"marker_id,x_m,y_m,z_m,yaw_deg,facing\n4,1,2,3,90,down\n",
            [(1, -1, 0), (1, 1, 0), (-1, 1, 0), (-1, -1, 0)],
        ),
        # 120 degrees about (1, 1, 1): x to y, y to z, z to x.
        (
            "csv",
            b"z_m,y_m,x_m,qx,qy,qz,qw,marker_id\n3,2,1,0.5,0.5,0.5,0.5,4\n",
            [(0, -1, 1), (0, 1, 1), (0, 1, -1), (0, -1, -1)],
        ),
    ],
)
def test_what_an_entry_means(
    name: FormatName, data: bytes, corners: list[tuple[int, int, int]]
) -> None:
    (marker,) = import_map(data, Path("x"), name, TAGS).marker_map.markers
    assert marker.id == 4
    expected = np.array([1.0, 2.0, 3.0]) + HALF_M * np.array(corners)
    np.testing.assert_allclose(marker.corners_m, expected, rtol=0, atol=1e-12)


def test_corners_in_csv_are_kept_as_measured() -> None:
    header = ",".join(f"{axis}{i}_m" for i in range(4) for axis in "xyz")
    data = f"marker_id,{header},std_m,tags\n7,0,0.1,1,0.101,0.1,1,0.1,0,1,0,0,1,0.002,a; b c\n"
    (marker,) = import_map(data.encode(), Path("x.csv"), "csv", TAGS).marker_map.markers
    assert marker.corners_m.tolist() == [[0, 0.1, 1], [0.101, 0.1, 1], [0.1, 0, 1], [0, 0, 1]]
    assert (marker.std_m, marker.tags) == (0.002, ("a", "b c"))


def test_the_field_that_was_photographed(shared_data: Path) -> None:
    """Its map.yaml explains real photos of these tags."""
    folder = shared_data / "field_2023"
    known = parse_map((folder / "map.yaml").read_bytes(), folder / "map.yaml")
    path = folder / "2023-chargedup.json"
    defaults = MapDefaults("DICT_APRILTAG_16h5", 0.1524)
    found = import_map(path.read_bytes(), path, "wpilib", defaults).marker_map
    assert found.ids == known.ids
    for marker in known.markers:
        np.testing.assert_allclose(
            found.by_id[marker.id].corners_m, marker.corners_m, rtol=0, atol=1e-6
        )


@pytest.mark.parametrize("family", ["16_05", "25_09", "36_11"])
def test_apriltags_own_pictures_are_turned_to_opencvs(shared_data: Path, family: str) -> None:
    """AprilTag's corners begin at the lower left of its picture and go round by the right."""
    folder = shared_data / "apriltag_board/rendered/640x480"
    image = cv2.imread(str(folder / f"tag{family}_640x480.png"), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    name = "DICT_APRILTAG_" + family.replace("_", "h").replace("h0", "h")
    corners, ids, _ = cv2.aruco.ArucoDetector(load_dictionary(name)).detectMarkers(image)
    lines = (folder / f"corners_tag{family}.txt").read_text().split("\n")
    seen = {}
    for i in range(0, len(lines) - 4, 5):
        points = [[float(value) for value in line.split()] for line in lines[i + 1 : i + 5]]
        lower_left, lower_right, upper_right, upper_left = points
        seen[int(lines[i])] = np.array([upper_left, upper_right, lower_right, lower_left])
    assert ids is not None
    for marker_id, found in zip(ids.ravel(), corners, strict=True):
        turned = np.roll(seen[int(marker_id)], 2, axis=0)
        assert np.abs(np.asarray(found).reshape(4, 2) - turned).max() < 4.0


QUATERNIONS = st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(
    lambda q: float(np.linalg.norm(q)) > 1e-3
)
POSES = st.builds(
    Pose.from_quat, st.lists(st.floats(-100, 100), min_size=3, max_size=3), QUATERNIONS
)


@st.composite
def maps(draw: st.DrawFn) -> MarkerMap:
    """Of one size, as two of the formats can hold no more."""
    ids = draw(st.lists(st.integers(0, 586), min_size=1, max_size=4, unique=True))
    stds = st.none() | st.floats(1e-4, 1)
    tags = st.sampled_from([(), ("a", "b")])
    markers = [Marker.from_pose(i, draw(POSES), 0.1, draw(stds), draw(tags)) for i in ids]
    return MarkerMap("map", "DICT_APRILTAG_36h11", tuple(markers))


@given(maps())
@pytest.mark.parametrize("name", ["wpilib", "fiducial_slam", "csv"])
def test_there_and_back(name: FormatName, marker_map: MarkerMap) -> None:
    made = export_map(marker_map, SITE, name)
    back = import_map(made.data, SITE, name, TAGS).marker_map
    assert [m.id for m in back.markers] == [m.id for m in marker_map.markers]
    for marker in marker_map.markers:
        found = back.by_id[marker.id]
        np.testing.assert_allclose(found.corners_m, marker.corners_m, rtol=0, atol=1e-9)
        if name != "wpilib" and marker.std_m is not None:
            assert found.std_m == pytest.approx(marker.std_m)
        if name == "csv":
            assert (found.std_m, found.tags) == (marker.std_m, marker.tags)


@given(QUATERNIONS)
@settings(max_examples=50)
def test_roll_pitch_yaw_are_about_fixed_axes(quat_xyzw: list[float]) -> None:
    rotation = Pose.from_quat([0, 0, 0], quat_xyzw).rotation
    check_angles(rotation, roll_pitch_yaw(rotation))


@pytest.mark.parametrize("pitch_deg", [90.0, -90.0, 89.9999999])
def test_roll_pitch_yaw_at_the_gimbal_lock(pitch_deg: float) -> None:
    pitch = Pose.from_rvec_tvec((0, np.radians(pitch_deg), 0), (0, 0, 0)).rotation
    rotation = rotation_z(0.7) @ pitch
    check_angles(rotation, roll_pitch_yaw(rotation))


def check_angles(rotation: Array, angles: Array) -> None:
    about_x, about_y, about_z = (
        Pose.from_rvec_tvec(axis * angle, (0, 0, 0)).rotation
        for axis, angle in zip(np.eye(3), angles, strict=True)
    )
    np.testing.assert_allclose(about_z @ about_y @ about_x, rotation, rtol=0, atol=1e-12)


def test_what_a_format_cannot_hold_is_said() -> None:
    corners_m = np.array([[0, 0.1, 0], [0.101, 0.1, 0], [0.1, 0, 0], [0, 0, 0]])
    measured = Marker.from_corners(1, corners_m)
    tagged = Marker.from_yaw(0, (-1, 0, 0), 0.0, "up", 0.1, 0.01, ("a",))
    marker_map = MarkerMap("hall", "DICT_APRILTAG_36h11", (measured, tagged), inverted=True)
    notes = " ".join(export_map(marker_map, SITE, "wpilib").notes)
    for words in ("DICT_APRILTAG_36h11", "frame hall", "inverted", "size_m 0.1, ", "std_m of 1",
                  "tags of 1", "corners of 1", "--field-m", "negative x"):  # fmt: skip
        assert words in notes, words
    notes = " ".join(export_map(marker_map, SITE, "fiducial_slam").notes)
    assert "std_m of" not in notes
    assert "variance 0" in notes
    notes = " ".join(export_map(marker_map, SITE, "csv").notes)
    assert notes == "not in this format: dictionary DICT_APRILTAG_36h11; frame hall; inverted"


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("wpilib", b"{", ["line 1", "JSON"]),
        ("wpilib", b"[1]", ["keys and values"]),
        ("wpilib", b'{"tags": []}', ["tags", "at least 1"]),
        ("wpilib", wpilib(0, 0, 0, 0), ["tags[0].pose.rotation.quaternion", "length"]),
        ("wpilib", wpilib(1, 0, 0, 0).replace(b'"W": 1', b'"W": "1"'), ["W", "number", "'1'"]),
        ("wpilib", wpilib(1, 0, 0, 0).replace(b'"ID": 4', b'"ID": 999'), ["0 to 586", "999"]),
        ("fiducial_slam", b"", ["at least one marker"]),
        ("fiducial_slam", b"1 2 3\n", ["line 1", "found 3 fields"]),
        ("fiducial_slam", b"\n1 0 0 0 0 0 x 0 0\n", ["line 2", "'x'"]),
        ("fiducial_slam", b"1 0 0 0 0 0 nan 0 0\n", ["line 1", "finite"]),
        ("fiducial_slam", b"1 0 0 0 0 0 0 0 0\n1 0 0 1 0 0 0 0 0\n", ["id 1 twice"]),
        ("wpilib", b" \n", ["JSON", "an empty file"]),
        ("csv", b"id,x_m\n", ["header", "marker_id", "found id"]),
        ("csv", b"marker_id,x_m\n1,2,3\n", ["line 2", "2 columns"]),
        ("csv", b"marker_id,x_m\n1,2\n", ["line 2", "y_m, z_m too"]),
        ("csv", b"marker_id,x_m,y_m,z_m\n1,2,3,4\n", ["line 2", "one way to place it"]),
        ("csv", b"marker_id,x_m,y_m,z_m\nA,2,3,4\n", ["line 2", "whole number", "'A'"]),
        ("csv", b"marker_id,x_m,y_m,z_m\n1,2,inf,4\n", ["line 2", "y_m", "'inf'"]),
        (
            "csv",
            b"marker_id;x_m;y_m\n1;2,5;3\n",
            ["header", "commas between columns", "semicolons"],
        ),
        ("csv", b"marker_id\tx_m\n1\t2\n", ["header", "commas between columns", "tabs"]),
        ("csv", b"\xff", ["line 1", "UTF-8"]),
    ],
)
def test_mistakes_are_named(name: FormatName, data: bytes, words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        import_map(data, Path("x.txt"), name, TAGS)
    text = str(caught.value)
    assert text.startswith("x.txt: ")
    assert all(word in text for word in words), text


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(map_group, [str(argument) for argument in arguments])


def test_from_the_command_line(tmp_path: Path) -> None:
    layout, site = tmp_path / "field.json", tmp_path / "map.yaml"
    layout.write_bytes(wpilib(1, 0, 0, 0))
    done = run("import", layout, "-o", site)
    assert done.exit_code == 0, done.output
    assert "assumed: DICT_APRILTAG_36h11, 0.1651 m" in done.output
    assert isinstance(run("import", layout, "-o", site).exception, InputError)
    for suffix in ("csv", "txt", "json"):
        done = run("export", site, "-o", tmp_path / f"out.{suffix}")
        assert done.exit_code == 0, done.output
        assert "not in this format: dictionary" in done.output
    done = run("export", site, "-o", tmp_path / "b.json", "--field-m", "16.5", "8.0")
    written = json.loads((tmp_path / "b.json").read_text())
    assert written["field"] == {"length": 16.5, "width": 8.0}
    again = run("import", tmp_path / "out.txt", "-o", tmp_path / "c.yaml")
    assert "--dictionary and --size-m" in str(again.exception)
    aruco = ("--dictionary", "DICT_6X6_50", "--size-m", "0.1")
    assert run("import", tmp_path / "out.txt", "-o", tmp_path / "c.yaml", *aruco).exit_code == 0
    for arguments in (
        ("import", layout, "-o", tmp_path / "d.yaml", *aruco),
        ("export", tmp_path / "c.yaml", "-o", tmp_path / "d.json"),
    ):
        assert "AprilTag family" in str(run(*arguments).exception)
    assert not list(tmp_path.glob("d.*"))
    assert "--format" in str(run("export", site, "-o", tmp_path / "x.xml").exception)
    (tmp_path / "e.csv").write_text("marker_id,x_m,y_m,z_m,yaw_deg,facing\n1,0,0,2,0,down\n")
    sizeless = ("import", tmp_path / "e.csv", "-o", tmp_path / "d.yaml", "--dictionary")
    assert "expected --size-m too" in str(run(*sizeless, "DICT_6X6_50").exception)
    assert run(*sizeless, "DICT_6X6_50", "--size-m", "0.1").exit_code == 0
    refused = run("export", site, "-o", tmp_path / "d.csv", "--field-m", "16.5", "8.0")
    assert refused.exit_code == 2
    assert "--field-m is for wpilib" in refused.output


def test_the_field_of_a_layout_is_told_and_can_be_given_back(tmp_path: Path) -> None:
    layout, site, back = (tmp_path / name for name in ("a.json", "map.yaml", "b.json"))
    content = json.loads(wpilib(1, 0, 0, 0))
    content["field"] = {"length": 16.541, "width": 8.211}
    layout.write_text(json.dumps(content))
    done = run("import", layout, "-o", site)
    assert "not in a map: the field of 16.541 x 8.211 m" in done.output
    *_, said, _ = done.output.partition("--field-m 16.541 8.211")
    assert said
    done = run("export", site, "-o", back, "--field-m", "16.541", "8.211")
    assert json.loads(back.read_text())["field"] == content["field"]
    content["field"] = {"length": "long", "width": 8.211}
    layout.write_text(json.dumps(content))
    failed = run("import", layout, "-o", site, "--force")
    assert "field.length: expected a number" in str(failed.exception)
