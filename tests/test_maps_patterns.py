"""`map check` on slips that only a wrong unit, a common yaw or a regular grid give away."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import yaml

from pipeline.geometry import Array, Pose, rotation_z
from pipeline.markers import Marker
from recorder.files.map_file import parse_map
from recorder.maps.check import MapCheck, check_map
from recorder.maps.findings import Severity
from recorder.maps.pattern import pattern_findings
from recorder.maps.units import unit_findings
from recorder.simulation.scene_file import load_scene, shipped_scenes

Entry = dict[str, Any]
Entries = list[Entry]


def grid(rows: int = 3, cols: int = 4, pitch_m: float = 0.8) -> Entries:
    """As `init` writes it: ids row by row from the origin, all turned alike."""
    return [
        {
            "id": i,
            "xyz_m": [i % cols * pitch_m, i // cols * pitch_m, 2.5],
            "yaw_deg": 0,
            "facing": "down",
        }
        for i in range(rows * cols)
    ]


def checked(entries: Entries) -> MapCheck:
    content = {"dictionary": "DICT_6X6_50", "size_m": 0.15, "markers": entries}
    return check_map(yaml.safe_dump(content).encode(), Path("map.yaml"))


def told(check: MapCheck, *severities: Severity) -> list[tuple[str, tuple[int, ...], str]]:
    wanted = severities or ("error", "warning")
    return [(f.check, f.ids, f.text) for f in check.findings if f.severity in wanted]


def the_warning(entries: Entries) -> tuple[str, tuple[int, ...], str]:
    check = checked(entries)
    assert check.sane
    (only,) = told(check)
    return only


def on_ceiling(places: npt.ArrayLike, yaw_rad: npt.ArrayLike = 0.0) -> list[Marker]:
    places = np.asarray(places, dtype=np.float64)
    yaws = np.broadcast_to(np.asarray(yaw_rad, dtype=np.float64), len(places))
    return [
        Marker.from_yaw(i, (x, y, 2.5), float(yaw), "down", 0.15)
        for i, ((x, y), yaw) in enumerate(zip(places, yaws, strict=True))
    ]


def nodes(rows: int, cols: int, pitches_m: tuple[float, float] = (0.8, 0.8)) -> Array:
    x, y = np.meshgrid(np.arange(cols) * pitches_m[0], np.arange(rows) * pitches_m[1])
    return np.column_stack([x.ravel(), y.ravel()])


@pytest.mark.parametrize("yaw_deg", [1.57, -1.5708, 3.14, 3.14159, 4.712, 6.283])
def test_radians_are_told(yaw_deg: float) -> None:
    entries = grid()
    entries[5]["yaw_deg"] = yaw_deg
    check, ids, text = the_warning(entries)
    assert (check, ids) == ("yaw", (5,))
    assert (
        the_warning([entry | {"yaw_deg": entry["yaw_deg"] or 90} for entry in entries])[0] == "yaw"
    )
    assert f"marker 5 has a yaw of {round(yaw_deg, 4):g} degrees, which looks like" in text


def test_radians_all_over_a_map_are_told_once() -> None:
    entries = grid()
    for entry in entries:
        entry["yaw_deg"] = 1.5708
    assert the_warning(entries)[:2] == ("yaw", tuple(range(12)))
    for yaw_deg in (0, 1.5, 2, 3, 6, 90, 157, 15.7):
        for entry in entries:
            entry["yaw_deg"] = yaw_deg
        assert not checked(entries).findings


def test_yaws_of_a_survey_are_not_taken_for_radians() -> None:
    """Of markers that are tilted a little, no one wrote a yaw_deg."""
    tilt = Pose.from_rvec_tvec((0.002, 0.001, 0.0), (0, 0, 0))
    flat = Marker.from_yaw(0, (0, 0, 2.5), np.radians(1.57), "down", 0.15)
    assert unit_findings([flat])
    assert not unit_findings([Marker.from_pose(0, flat.T_map_marker @ tilt, 0.15)])


@pytest.mark.parametrize(
    ("height_m", "odd"),
    [(2500.0, True), (250.0, True), (-250.0, True), (51.0, True), (-3.0, False), (40.0, False)],
)
def test_heights_that_no_ceiling_has_are_told(height_m: float, odd: bool) -> None:
    entries = grid()
    for entry in entries:
        entry["xyz_m"][2] = height_m
        entry["facing"] = "down" if height_m > 0 else "up"
    if odd:
        assert the_warning(entries)[:2] == ("heights", ())
    else:
        assert not checked(entries).findings


def test_centimetres_are_told_once() -> None:
    entries = grid()
    for entry in entries:
        entry["xyz_m"] = [100 * value for value in entry["xyz_m"]]
    check, ids, text = the_warning(entries)
    assert (check, ids) == ("extent", ())
    assert "80.00 m" in text
    assert "533 times" in text


@pytest.mark.parametrize("x_m", [1.9, 1.55, 1.2, 2.1])
def test_a_place_off_the_grid_is_told_with_by_how_much(x_m: float) -> None:
    entries = grid()
    entries[6]["xyz_m"][0] = x_m
    check, ids, text = the_warning(entries)
    assert (check, ids) == ("grid", (6,))
    assert f"11 others are on: {abs(x_m - 1.6):.3f} m from its nearest" in text
    assert "x 1.6 y 0.8 m" in text


@pytest.mark.parametrize(("id", "axis"), [(1, 0), (6, 0), (11, 0), (3, 0), (9, 1), (4, 1), (11, 1)])
def test_a_wrong_sign_is_told_where_it_leads_off_the_grid(id: int, axis: int) -> None:
    entries = grid()
    entries[id]["xyz_m"][axis] *= -1
    check, ids, text = the_warning(entries)
    assert (check, ids) == ("grid", (id,))
    assert "a wrong sign?" in text


def test_a_grid_may_be_turned_and_on_the_floor() -> None:
    places = nodes(4, 5, (0.8, 0.6))
    places[7, 1] += 0.3
    turned = (places @ rotation_z(0.4)[:2, :2].T) + (3.0, -1.0)
    for markers in (
        on_ceiling(turned, 0.4),
        [Marker.from_yaw(i, (*p, 0.0), 0.4, "up", 0.15) for i, p in enumerate(turned)],
    ):
        (only,) = pattern_findings(markers)
        assert (only.check, only.ids) == ("grid", (7,))
        assert "0.300 m from" in only.text
        assert "0.8 x 0.6 m" in only.text


def test_a_corridor_is_a_grid_of_one_row() -> None:
    places = nodes(1, 12)
    places[5, 0] += 0.25
    (only,) = pattern_findings(on_ceiling(places))
    assert (only.check, only.ids) == ("grid", (5,))
    assert "of 0.8 m" in only.text


def test_a_slip_shows_among_places_measured_by_hand() -> None:
    rng = np.random.default_rng(4)
    for _ in range(20):
        places = nodes(5, 6) + rng.normal(0, 0.005, (30, 2))
        places[14, 0] += 0.3
        (only,) = pattern_findings(on_ceiling(places))
        assert only.ids == (14,)


def scattered(rng: np.random.Generator) -> Array:
    return rng.uniform(0, rng.uniform(1.5, 12), (int(rng.integers(8, 40)), 2))


def on_decimetres(rng: np.random.Generator) -> Array:
    """Irregular, but with round numbers."""
    raster = float(rng.choice([0.1, 0.25, 0.5, 1.0]))
    rounded: Array = np.unique(np.round(scattered(rng) / raster) * raster, axis=0)
    return rounded


def rings(rng: np.random.Generator) -> Array:
    count = int(rng.integers(8, 24))
    turns = np.arange(count) * 2 * np.pi / count
    ring = np.column_stack([np.cos(turns), np.sin(turns)])
    return np.concatenate([radius * ring for radius in (0.4, 0.8, 1.2)])


def by_hand(rng: np.random.Generator) -> Array:
    pitches_m = (rng.uniform(0.35, 1.5), rng.uniform(0.35, 1.5))
    places = nodes(int(rng.integers(3, 8)), int(rng.integers(3, 8)), pitches_m)
    return places + rng.normal(0, 0.01, places.shape)


def uneven_rows(rng: np.random.Generator) -> Array:
    x, y = (np.cumsum(rng.uniform(0.4, 1.5, count)) for count in (5, 4))
    return np.array([(a, b) for a in x for b in y])


def two_halls(rng: np.random.Generator) -> Array:
    second = nodes(3, 2) + np.array([rng.uniform(8, 20), 0.3])
    return np.concatenate([nodes(5, 8), second])


def with_holes(rng: np.random.Generator) -> Array:
    """Lamps where markers would be."""
    return rng.permutation(nodes(5, 6))[: int(rng.integers(20, 29))]


def last_row_elsewhere(rng: np.random.Generator) -> Array:
    places = nodes(6, 5)
    places[-5:, 1] += rng.uniform(0.1, 0.7)
    return places


@pytest.mark.parametrize(
    "places",
    [scattered, on_decimetres, rings, by_hand, uneven_rows, two_halls, with_holes,
     last_row_elsewhere],
)  # fmt: skip
@pytest.mark.parametrize("turned_alike", [True, False])
def test_no_grid_is_seen_where_there_is_none_to_keep(
    places: Callable[[np.random.Generator], Array], turned_alike: bool
) -> None:
    rng = np.random.default_rng(7)
    for _ in range(100):
        there = places(rng)
        yaws = 0.3 if turned_alike else rng.uniform(-np.pi, np.pi, len(there))
        found = [f for f in pattern_findings(on_ceiling(there, yaws)) if f.check == "grid"]
        assert not found, found[0].text


def test_a_marker_between_those_of_a_full_grid_is_no_slip() -> None:
    assert not pattern_findings(on_ceiling([*nodes(4, 5), (1.2, 1.2)]))


@pytest.mark.parametrize("yaw_deg", [90, -90, 180, 12])
def test_one_that_is_turned_unlike_the_others_is_told(yaw_deg: float) -> None:
    entries = grid()
    entries[5]["yaw_deg"] = yaw_deg
    check, ids, text = the_warning(entries)
    assert (check, ids) == ("turn", (5,))
    assert f"turned by {abs(yaw_deg)} deg against the 11 others that face down" in text
    entries[8]["yaw_deg"] = 45
    assert {ids for _, ids, _ in told(checked(entries))} == {(5,), (8,)}
    # Three are no slip of one or two.
    entries[0]["yaw_deg"] = 45
    assert not checked(entries).findings


def test_a_turned_marker_on_a_wall_is_told_about_the_wall() -> None:
    """Across the seam of the angles, too: all of the others are about upside down."""
    upright = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    rng = np.random.default_rng(1)
    rolls = np.pi + rng.normal(0, 0.01, 9)
    rolls[3] = np.pi / 2
    markers = [
        Marker.from_pose(i, Pose(upright @ rotation_z(roll), np.array([0.0, i, 1.0])), 0.2)
        for i, roll in enumerate(rolls)
    ]
    (only,) = pattern_findings(markers)
    assert (only.check, only.ids) == ("turn", (3,))
    assert "turned by 90 deg" in only.text or "turned by 89 deg" in only.text


def test_rings_and_other_scenes_have_nothing_to_tell(shared_data: Path) -> None:
    maps = {str(path): load_scene(path).true_map for path in shipped_scenes().values()}
    files = shared_data.glob("**/map.yaml")
    maps |= {str(path): parse_map(path.read_bytes(), path) for path in files}
    for name, marker_map in maps.items():
        assert not pattern_findings(marker_map.markers), name
        assert not unit_findings(marker_map.markers), name


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_few_markers_are_said_not_to_be_compared(count: int) -> None:
    check = checked(grid()[:count])
    assert not told(check)
    notes = [f.text for f in check.findings if f.check == "few"]
    assert len(notes) == (count in (2, 3))
    assert all("fewer than 4 markers" in text for text in notes)


def test_one_of_few_that_faces_the_other_way_is_told() -> None:
    entries = grid()[:3]
    entries[1]["facing"] = "up"
    check, ids, text = the_warning(entries)
    assert (check, ids) == ("mirrored", (1,))
    assert "(0, 2 down; 1 up)" in text
    assert the_warning(entries[:2])[:2] == ("mirrored", (0, 1))
    # A floor and a ceiling.
    entries[1]["xyz_m"][2] = 0.0
    assert not told(checked(entries))


@pytest.mark.parametrize(("tilt_deg", "odd"), [(0.8, False), (1.5, True), (20.0, True)])
def test_one_of_few_that_is_tilted_is_told(tilt_deg: float, odd: bool) -> None:
    entries = grid()[:3]
    tilt = Pose.from_rvec_tvec((np.radians(tilt_deg), 0.0, 0.0), (0, 0, 0))
    flat = Marker.from_yaw(1, entries[1]["xyz_m"], 0.0, "down", 0.15)
    quat_xyzw = (flat.T_map_marker @ tilt).quat_xyzw.tolist()
    entries[1] = {"id": 1, "xyz_m": entries[1]["xyz_m"], "quat_xyzw": quat_xyzw}
    assert [found[:2] for found in told(checked(entries))] == [("tilt", (1,))] * odd
    # Where none of the others is level, nobody is the odd one.
    entries[0] = entries[1] | {"id": 0, "xyz_m": entries[0]["xyz_m"]}
    assert not told(checked(entries))
