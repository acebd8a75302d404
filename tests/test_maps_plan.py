"""Plans: to scale, every id on them, and the first corner where it is."""

from __future__ import annotations

import io
from pathlib import Path

import cv2
import numpy as np
import pypdfium2  # type: ignore[import-untyped]
import pytest
from click.testing import CliRunner, Result

from pipeline.detection import GrayImage
from pipeline.markers import Facing, Marker, MarkerMap
from recorder.errors import InputError
from recorder.files.map_file import map_yaml
from recorder.files.truth_file import parse_truth
from recorder.map_cli import map_group
from recorder.maps.plan import PlanFormat, PlanOptions, draw_plan
from recorder.maps.plan_frame import View
from tests import worlds

DPI = 200
MM = DPI / 25.4
# As they are drawn: blue faces down, vermilion up.
BLUE, VERMILION = (0, 114, 178), (213, 94, 0)


def picture(data: bytes) -> GrayImage:
    """RGB of a PDF's page."""
    bitmap = pypdfium2.PdfDocument(io.BytesIO(data))[0].render(scale=DPI / 72.0)
    return np.ascontiguousarray(bitmap.to_numpy()[:, :, 2::-1])


def drawn_in(image: GrayImage, colour: tuple[int, int, int]) -> np.typing.NDArray[np.bool_]:
    near = np.asarray((np.abs(image.astype(int) - colour) < 40).all(axis=2))
    # The legend is not the plan.
    near[-int(30 * MM) :] = False
    return near


def one(facing: Facing, yaw_deg: float, x_m: float = 0.0) -> MarkerMap:
    marker = Marker.from_yaw(3, (x_m, 0.0, 2.0), np.radians(yaw_deg), facing, 0.2)
    return MarkerMap("map", "DICT_6X6_50", (marker,))


@pytest.mark.parametrize(("scale", "span_mm"), [(10, 120.0), (20, 60.0)])
def test_lengths_on_paper_are_those_of_the_site(scale: int, span_mm: float) -> None:
    """Outer edges of two markers of 20 cm, a metre apart."""
    markers = tuple(
        Marker.from_yaw(i, (x, 0.3, 2.0), 0.0, "down", 0.2) for i, x in enumerate((-0.5, 0.5))
    )
    marker_map = MarkerMap("map", "DICT_6X6_50", markers)
    plan = draw_plan(marker_map, "pdf", PlanOptions(scale=scale))
    assert plan.scale == scale
    columns = np.flatnonzero(drawn_in(picture(plan.data), BLUE).any(axis=0))
    # The outline's stroke is about its edge.
    assert (columns[-1] - columns[0]) / MM == pytest.approx(span_mm, abs=0.5)


@pytest.mark.parametrize(
    ("facing", "yaw_deg", "quadrant"),
    [
        ("up", 0.0, (-1, 1)),
        ("up", 90.0, (-1, -1)),
        # Seen through its back, up in the print is -y.
        ("down", 0.0, (-1, -1)),
        ("down", 90.0, (1, -1)),
    ],
)
def test_the_dot_is_at_the_first_corner(
    facing: Facing, yaw_deg: float, quadrant: tuple[int, int]
) -> None:
    marker_map = one(facing, yaw_deg)
    corner = marker_map.markers[0].corners_m[0, :2]
    assert tuple(np.sign(corner)) == quadrant
    image = picture(draw_plan(marker_map, "pdf", PlanOptions(scale=5)).data)
    ink = drawn_in(image, VERMILION if facing == "up" else BLUE)
    rows, cols = np.flatnonzero(ink.any(axis=1)), np.flatnonzero(ink.any(axis=0))
    row, col = (rows[0] + rows[-1]) / 2, (cols[0] + cols[-1]) / 2
    solid = cv2.erode(ink.astype(np.uint8), np.ones((9, 9), np.uint8))
    found = np.argwhere(solid).mean(axis=0)
    assert np.sign(found[1] - col) == quadrant[0]
    assert np.sign(row - found[0]) == quadrant[1]


@pytest.mark.parametrize("apart_m", [300.0, 2000.0])
def test_a_marker_is_seen_however_large_the_site_is(apart_m: float) -> None:
    places = ((0.0, 0.0), (apart_m, 0.0), (0.0, apart_m), (apart_m, apart_m))
    markers = tuple(
        Marker.from_yaw(i, (*place, 2.0), 0.0, "up", 0.15) for i, place in enumerate(places)
    )
    plan = draw_plan(MarkerMap("map", "DICT_6X6_50", markers), "pdf")
    image = picture(plan.data)
    middle = np.array(image.shape[:2]) - [30 * MM, 0]
    for x_m, y_m in places:
        # The arrow is above the centre: below it there is the lower half of the square alone.
        away_mm = np.array([apart_m / 2 - y_m, x_m - apart_m / 2]) * 1000.0 / plan.scale
        row, col = (middle / 2 + away_mm * MM).astype(int)
        corner = image[row + 3 : row + 7, col - 6 : col + 7].astype(int)
        assert (np.abs(corner - VERMILION).sum(axis=2) < 250).any()
    text = draw_plan(MarkerMap("map", "DICT_6X6_50", markers), "svg").data.decode()
    assert "squares are drawn of 1.2 mm at least: these are not to scale<" in text
    assert "dot:" not in text
    near = draw_plan(one("up", 0.0), "svg").data.decode()
    assert "not to scale" not in near
    assert "1 marker of 0.2 m, DICT_6X6_50" in near
    assert "dot: its top left corner" in near


def test_every_id_is_on_the_plan() -> None:
    markers = tuple(
        Marker.from_yaw(i, (i % 20 * 1.2, i // 20 * 1.5, 3.0), 0.1 * i, "down", 0.2, 0.005)
        for i in range(200)
    )
    marker_map = MarkerMap("map", "DICT_6X6_1000", markers)
    plan = draw_plan(marker_map, "svg", title="hall.yaml")
    text = plan.data.decode()
    assert all(f">{i}</text>" in text for i in range(200))
    assert "hall.yaml: 200 markers of 0.2 m, DICT_6X6_1000, frame map" in text
    assert f"1 : {plan.scale}," in text
    assert plan.hidden == 0


@pytest.mark.parametrize(
    ("facing", "view", "line"),
    [
        ("down", "top", "seen from above: those facing down show their back, mirrored<"),
        ("up", "top", "seen from above<"),
        ("down", "front", "seen along y<"),
    ],
)
def test_backs_are_told_of_where_there_are_any(facing: Facing, view: View, line: str) -> None:
    text = draw_plan(one(facing, 0.0), "svg", PlanOptions(view=view)).data.decode()
    assert line in text


@pytest.mark.parametrize("kind", ["svg", "png", "pdf"])
def test_the_same_map_gives_the_same_file(kind: PlanFormat) -> None:
    truth = parse_truth(worlds.TRUTH_YAML, Path("truth.yaml"))
    first, second = (draw_plan(worlds.ceiling(), kind, truth=truth).data for _ in range(2))
    assert first == second


def test_the_truths_path_is_drawn() -> None:
    truth = parse_truth(worlds.TRUTH_YAML, Path("truth.yaml"))
    without, with_it = (
        picture(draw_plan(worlds.ceiling(), "pdf", truth=t).data) for t in (None, truth)
    )
    black = [int((image[: -int(30 * MM)].max(axis=2) < 20).sum()) for image in (without, with_it)]
    assert black[1] > black[0] + 300


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(map_group, [str(argument) for argument in arguments])


def test_from_the_command_line(tmp_path: Path) -> None:
    site = tmp_path / "map.yaml"
    stacked = tuple(Marker.from_yaw(i, (0, 0, i), 0.0, "down", 0.2) for i in range(3))
    site.write_bytes(map_yaml(MarkerMap("map", "DICT_6X6_50", stacked)))
    done = run("draw", site, "-o", tmp_path / "plan.svg")
    assert done.exit_code == 0, done.output
    assert "3 markers lie over each other in this view" in done.output
    done = run("draw", site, "-o", tmp_path / "side.png", "--view", "side", "--ids", "0,2")
    assert done.output.endswith("side.png: 2 markers, 1 : 10\n")
    for arguments, words in (
        (("-o", tmp_path / "plan.svg"), "--force"),
        (("-o", tmp_path / "plan.gif"), ".svg, .pdf or .png"),
        (("-o", tmp_path / "a.svg", "--ids", "7"), "ids 7"),
        (("-o", tmp_path / "a.svg", "--ids", "0,7"), "found none with 7"),
        (("-o", tmp_path / "a.svg", "--scale", "1", "--view", "side"), "at most 2000 mm"),
    ):
        failed = run("draw", site, *arguments)
        assert isinstance(failed.exception, InputError)
        assert words in str(failed.exception)
    assert not list(tmp_path.glob("a.*"))
