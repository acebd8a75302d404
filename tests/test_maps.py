"""`map check`: every slip that is planted is found, and what is right is left alone."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from click.testing import CliRunner, Result
from hypothesis import given
from hypothesis import strategies as st

from pipeline.geometry import Pose
from pipeline.markers import Marker, MarkerMap
from recorder.errors import InputError
from recorder.files.map_file import map_yaml, parse_map, read_map
from recorder.map_cli import map_group
from recorder.maps.check import MapCheck, check_map
from recorder.maps.check_text import check_text
from recorder.maps.findings import Severity
from recorder.maps.spacing import overlap, square_gap_m
from recorder.simulation.installation import InstallationErrors
from recorder.simulation.scene_file import load_scene, shipped_scenes
from tests import worlds

SITE = Path("map.yaml")
Content = dict[str, Any]


def ceiling() -> Content:
    """3 x 4 markers of 15 cm, half a metre apart, at 2.5 m."""
    content: Content = yaml.safe_load(map_yaml(worlds.ceiling()))
    return content | {"dictionary": "DICT_6X6_50"}


def checked(content: Content) -> MapCheck:
    return check_map(yaml.safe_dump(content).encode(), SITE)


def found(check: MapCheck, severity: Severity) -> set[tuple[str, tuple[int, ...]]]:
    return {(f.check, f.ids) for f in check.findings if f.severity == severity}


def test_a_map_that_is_right_has_nothing_to_tell() -> None:
    check = checked(ceiling())
    assert check.findings == ()
    assert check.sane
    assert {row.facing for row in check.markers} == {"down"}
    nearest = check.markers[0].nearest
    assert nearest is not None
    assert nearest.distance_m == pytest.approx(0.5)


def corners_mirrored(content: Content) -> None:
    marker = worlds.ceiling().by_id[5]
    # As a sketch of the ceiling seen from above has them.
    mirrored = marker.corners_m[[1, 0, 3, 2]]
    content["markers"][5] = {"id": 5, "corners_m": mirrored.tolist()}


def tilted(content: Content) -> None:
    tilt = Pose.from_rvec_tvec((np.radians(3.0), 0.0, 0.0), (0, 0, 0))
    quat_xyzw = (worlds.ceiling().by_id[5].T_map_marker @ tilt).quat_xyzw.tolist()
    xyz_m = content["markers"][5]["xyz_m"]
    content["markers"][5] = {"id": 5, "xyz_m": xyz_m, "quat_xyzw": quat_xyzw}


@pytest.mark.parametrize("others", [3, 4, 8, 30])
@pytest.mark.parametrize("tilt_deg", [5.0, 15.0, 25.0, 32.0, 60.0, 85.0])
def test_a_tilted_marker_on_a_flat_ceiling_is_found(others: int, tilt_deg: float) -> None:
    """The more it is tilted, the surer; and however few there are."""
    content = ceiling()
    flat = content["markers"][0]
    content["markers"] = [
        flat | {"id": i, "xyz_m": [0.5 * (i % 6), 0.5 * (i // 6), flat["xyz_m"][2]]}
        for i in range(others + 1)
    ]
    odd = content["markers"][others // 2]
    tilt = Pose.from_rvec_tvec((np.radians(tilt_deg), 0.0, 0.0), (0, 0, 0))
    quat_xyzw = (worlds.ceiling().by_id[0].T_map_marker @ tilt).quat_xyzw.tolist()
    content["markers"][others // 2] = {
        "id": odd["id"], "xyz_m": odd["xyz_m"], "quat_xyzw": quat_xyzw
    }  # fmt: skip
    check = checked(content)
    assert ("tilt", (odd["id"],)) in found(check, "warning")
    assert check.sane


def moved(content: Content, axis: int, by_m: float) -> None:
    content["markers"][5]["xyz_m"][axis] += by_m


def changed(content: Content, **values: Any) -> None:
    content["markers"][5] |= values


@pytest.mark.parametrize(
    ("slip", "severity", "expected"),
    [
        (corners_mirrored, "error", {("mirrored", (5,))}),
        (lambda c: changed(c, facing="up"), "error", {("mirrored", (5,))}),
        (tilted, "warning", {("tilt", (5,))}),
        (lambda c: moved(c, 2, -0.05), "warning", {("height", (5,))}),
        (lambda c: moved(c, 0, 0.4), "error", {("overlap", (5, 6))}),
        (lambda c: moved(c, 0, 50.0), "warning", {("far", (5,))}),
        (lambda c: moved(c, 1, 3.6), "warning", {("far", (5,))}),
        (lambda c: moved(c, 0, 500.0), "error", {("far", (5,))}),
        (lambda c: changed(c, size_m=0.16), "warning", {("size", (5,))}),
        (lambda c: changed(c, size_m=150.0), "error", {("size", (5,))}),
        (lambda c: changed(c, std_m=5.0), "warning", {("std", (5,))}),
        (lambda c: changed(c, id=50), "error", {("file", ())}),
        (lambda c: changed(c, id=6), "error", {("file", ())}),
        (lambda c: c.update(dictionary="DICT_6X6_51"), "error", {("file", ())}),
        (lambda c: c.update(dictionary="DICT_6X6_1000"), "note", {("dictionary", ())}),
    ],
)
def test_a_slip_is_found(
    slip: Callable[[Content], None], severity: Severity, expected: set[tuple[str, tuple[int, ...]]]
) -> None:
    content = ceiling()
    slip(content)
    check = checked(content)
    assert expected <= found(check, severity)
    assert check.sane == (not found(check, "error"))
    # Nothing else is blamed, nor what a marker of 150 m covers.
    blamed = {f.ids for f in check.findings if f.severity != "note" and f.ids}
    assert all(5 in ids for ids in blamed)
    assert ("size", (5,)) not in found(check, "error") or len(check.findings) == 1
    assert "\n" not in "".join(f.text for f in check.findings)


def test_all_problems_are_told_not_only_the_first() -> None:
    content = ceiling()
    content["size"] = 0.15
    content["markers"][1]["xyz"] = content["markers"][1].pop("xyz_m")
    content["markers"][2]["id"] = 3
    content["markers"][7]["id"] = 77
    content["markers"][9]["facing"] = "up"
    check = checked(content)
    texts = [f.text for f in check.findings if f.severity == "error"]
    for words in (
        "size: expected a known key, found 'size'; did you mean size_m?",
        "markers[1].xyz: expected a known key",
        "markers[3].id: expected each id once, found 3 again",
        "markers[7] (id 77): expected ids of DICT_6X6_50 (0 to 49), found 77",
        "marker 9 faces up",
    ):
        assert any(text.startswith(words) for text in texts), words
    # One line each: a marker that cannot be read has no consequences besides.
    assert len(texts) == 5
    assert len(check.markers) == 11


def test_a_wrong_common_size_is_told_once() -> None:
    check = checked(ceiling() | {"size_m": "15 cm"})
    assert [f.check for f in check.findings] == ["file"]


def test_millimetres_are_told_once() -> None:
    """Of places, of sizes, and of both; overlaps of squares of 150 m say nothing."""
    places, sizes = ceiling(), ceiling() | {"size_m": 150.0}
    for marker in places["markers"]:
        marker["xyz_m"] = [1000 * value for value in marker["xyz_m"]]
    ids = tuple(range(12))
    assert found(checked(places), "error") == {("extent", ())}
    assert found(checked(sizes), "error") == {("size", ids)}
    check = checked(places | {"size_m": 150.0})
    assert found(check, "error") == {("size", ids), ("extent", ())}
    assert len(check.findings) == 2
    assert all("metres" in finding.text for finding in check.findings)


def test_groups_that_are_far_apart_are_no_slip() -> None:
    """Two halls, markers along a corridor, and a row that is left out."""
    near = [(x, y) for x in (0.0, 0.5, 1.0) for y in (0.0, 0.5)]
    for places in (
        [*near, *((x + 80.0, y) for x, y in near)],
        [(15.0 * i, 0.0) for i in range(60)],
        [(x if x < 1.0 else 1.5, y) for x, y in near],
    ):
        markers = [Marker.from_yaw(i, (*p, 2.5), 0, "down", 0.15) for i, p in enumerate(places)]
        check = check_map(map_yaml(MarkerMap("map", "DICT_6X6_100", tuple(markers))), SITE)
        assert not [f for f in check.findings if f.severity != "note"], check_text(check)


def test_two_sites_are_one_map_and_a_question() -> None:
    """However far apart: what shows millimetres is how far it is to the next marker."""
    near = [(x, y, 2.5) for x in (0.0, 1.0, 2.0) for y in (0.0, 1.0)]
    for apart_m in (900.0, 1200.0, 30_000.0):
        places = [*near, *((x + apart_m, y, z) for x, y, z in near)]
        markers = [Marker.from_yaw(i, place, 0, "down", 0.15) for i, place in enumerate(places)]
        check = check_map(map_yaml(MarkerMap("map", "DICT_6X6_50", tuple(markers))), SITE)
        assert check.sane, check_text(check)
        assert found(check, "warning") == ({("extent", ())} if apart_m > 1000 else set())
    # One that is lost besides is told as ever.
    markers.append(Marker.from_yaw(20, (0.0, 5000.0, 2.5), 0, "down", 0.15))
    check = check_map(map_yaml(MarkerMap("map", "DICT_6X6_50", tuple(markers))), SITE)
    assert found(check, "error") == {("far", (20,))}
    assert found(check, "warning") == {("extent", ())}


def test_shipped_scenes_are_sane() -> None:
    for name, path in shipped_scenes().items():
        check = check_map(map_yaml(load_scene(path).true_map), SITE)
        assert "far" not in {f.check for f in check.findings}, name
        assert check.sane, name


KEYS = ["id", "xyz_m", "yaw_deg", "facing", "size_m", "corners_m"]
VALUES = st.one_of(
    st.integers(-1, 60),
    st.floats(-5, 5),
    st.just("down"),
    st.lists(st.floats(-5, 5), min_size=3, max_size=3),
)
CONTENTS = st.dictionaries(
    st.sampled_from(["frame", "dictionary", "size_m", "markers", "x"]),
    st.one_of(
        st.none(),
        st.text(max_size=5),
        st.floats(),
        st.just("DICT_4X4_50"),
        st.lists(st.dictionaries(st.sampled_from(KEYS), VALUES), max_size=3),
    ),
)


@given(CONTENTS)
def test_what_is_told_is_what_keeps_a_map_from_being_read(content: Content) -> None:
    data = yaml.safe_dump(content).encode()
    readable = False
    with suppress(InputError):
        parse_map(data, SITE)
        readable = True
    assert readable == (not read_map(data, SITE).problems)
    check_text(check_map(data, SITE))


def test_what_is_no_map_at_all_is_one_error() -> None:
    with pytest.raises(InputError, match="keys and values"):
        check_map(b"- 1\n", SITE)


@pytest.mark.parametrize("size_m", [0.1, 0.15, 0.2])
def test_no_false_alarms_on_a_ceiling_measured_by_hand(size_m: float) -> None:
    """1 cm and 1 degree of error in every marker is what a tape and a level give."""
    errors = InstallationErrors(
        marker_position_std_m=0.01,
        marker_height_std_m=0.01,
        marker_yaw_std_deg=1.0,
        marker_tilt_std_deg=1.0,
    )
    alarms = 0
    for seed in range(8):
        told = [
            Marker.from_yaw(i, (i % 8 * 0.6, i // 8 * 0.7, 2.6), 0.3 * i, "down", size_m)
            for i in range(48)
        ]
        true = errors.apply_to_map(MarkerMap("map", "DICT_6X6_50", tuple(told)), seed)
        alarms += len(check_map(map_yaml(true), SITE).findings)
    print(f"{alarms} alarms in 384 markers of {size_m} m")
    assert alarms <= 1


def test_real_maps_are_sane(shared_data: Path) -> None:
    files = sorted(shared_data.glob("**/map.yaml"))
    assert len(files) >= 7
    for path in files:
        check = check_map(path.read_bytes(), path)
        assert check.sane, check_text(check)
    field = shared_data / "field_2023" / "map.yaml"
    assert check_map(field.read_bytes(), field).findings == ()


def flat(id: int, x: float, y: float, z: float = 0.0, yaw_deg: float = 0.0) -> Marker:
    return Marker.from_yaw(id, (x, y, z), np.radians(yaw_deg), "up", 0.2)


def on_wall(id: int, x: float, z: float) -> Marker:
    """Faces -x, right is +y."""
    rotation = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    return Marker.from_pose(id, Pose(rotation, np.array([x, 0.0, z])), 0.2)


@pytest.mark.parametrize(
    ("other", "gap_m", "overlaps"),
    [
        (flat(1, 0.5, 0.0), 0.3, False),
        (flat(1, 0.2, 0.0), 0.0, False),
        (flat(1, 0.19, 0.0), 0.0, True),
        (flat(1, 0.0, 0.0), 0.0, True),
        # A corner towards an edge: half a diagonal from the centre.
        (flat(1, 0.5, 0.0, yaw_deg=45), 0.5 - 0.1 - 0.1 * np.sqrt(2), False),
        # Diagonal neighbours: corner to corner.
        (flat(1, 0.3, 0.3), 0.1 * np.sqrt(2), False),
        # One surface, measured 3 cm apart; then a shelf above the other.
        (flat(1, 0.1, 0.0, z=0.03), 0.0, True),
        (flat(1, 0.1, 0.0, z=0.5), 0.5, False),
        # On a wall that begins 10 cm beside the first, 10 cm above the floor; on one through it.
        (on_wall(1, 0.2, 0.2), 0.1 * np.sqrt(2), False),
        (on_wall(1, 0.05, 0.0), 0.0, True),
    ],
)  # fmt: skip
def test_gaps_between_squares(other: Marker, gap_m: float, overlaps: bool) -> None:
    marker = flat(0, 0.0, 0.0)
    for a, b in ((marker, other), (other, marker)):
        assert overlap(a, b) == overlaps
        assert square_gap_m(a, b) == pytest.approx(gap_m, abs=1e-6)


@given(
    st.floats(-0.6, 0.6), st.floats(-0.6, 0.6), st.floats(-180, 180), st.floats(-180, 180),
    st.floats(-2, 2), st.floats(-2, 2),
)  # fmt: skip
def test_gaps_do_not_depend_on_where_the_map_begins(
    x: float, y: float, yaw_a: float, yaw_b: float, tilt: float, shift: float
) -> None:
    a, b = flat(0, 0, 0, yaw_deg=yaw_a), flat(1, x, y, yaw_deg=yaw_b)
    turn = Pose.from_rvec_tvec((tilt, shift, 0.3), (shift, tilt, 1.0))
    c, d = (Marker.from_pose(m.id, turn @ m.T_map_marker, 0.2) for m in (a, b))
    gap = square_gap_m(a, b)
    assert square_gap_m(c, d) == pytest.approx(gap, abs=1e-5)
    assert square_gap_m(b, a) == pytest.approx(gap, abs=1e-5)
    # Between the inscribed and the circumscribed circles.
    distance = float(np.hypot(x, y))
    assert distance - 0.2 * np.sqrt(2) - 1e-6 <= gap <= max(0.0, distance - 0.2) + 1e-6


def test_the_quiet_zone_is_one_module() -> None:
    content = ceiling()
    # 6X6 markers have 8 modules: 18.75 mm for 15 cm.
    content["markers"] = [
        {"id": i, "xyz_m": [x, 0.0, 2.5], "yaw_deg": 0, "facing": "down"}
        for i, x in enumerate([0.0, 0.15 + 0.0188, 0.15 + 0.0188 + 0.15 + 0.0187])
    ]
    assert found(checked(content), "warning") == {("quiet_zone", (1, 2))}


def test_maps_the_wrong_way_round_are_noticed() -> None:
    content = ceiling()
    for marker in content["markers"]:
        marker["facing"] = "up"
    assert ("facing", ()) in found(checked(content), "warning")
    for marker in content["markers"]:
        marker["xyz_m"][2] = 0.0
    assert not checked(content).findings


def test_the_verdict_is_the_exit_code(tmp_path: Path) -> None:
    site = tmp_path / "map.yaml"

    def run(content: Content, *options: str) -> Result:
        site.write_text(yaml.safe_dump(content))
        return CliRunner().invoke(map_group, ["check", str(site), *options])

    content = ceiling()
    done = run(content)
    assert done.exit_code == 0
    verdict = "map.yaml: sane; 12 markers of DICT_6X6_50, 0 errors, 0 warnings"
    assert done.output.splitlines()[-1].endswith(verdict)
    moved(content, 2, 0.1)
    assert run(content).exit_code == 0
    assert run(content, "--strict").exit_code == 1
    content["markers"][0]["id"] = 1
    done = run(content, "--json")
    assert done.exit_code == 1
    report = json.loads(done.output)
    assert (report["sane"], report["errors"], report["warnings"]) == (False, 1, 1)
    assert len(report["markers"]) == 12


@pytest.mark.parametrize("name", ["1e5", "yes", "2", "a: b", "Küche", "null", "# 1"])
def test_names_stay_names(name: str) -> None:
    """Also those that YAML would take for something else."""
    marker = Marker.from_yaw(0, (0, 0, 2), 0.0, "down", 0.1, None, (name,))
    back = parse_map(map_yaml(MarkerMap(name, "DICT_6X6_50", (marker,))), SITE)
    assert back.frame == name
    assert back.markers[0].tags == (name,)
