"""The size of a ChArUco board's markers in its pictures, and boards that were named wrongly."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner, Result

from arucolog import cli
from pipeline.detection import GrayImage
from replay.calibration.board import Charuco, parse_board
from replay.calibration.corners import CornerFinder
from replay.calibration.marker_size import as_measured
from replay.calibration.views import kinds_of_reasons
from tests.boards import draw

# The print has 64 pixels a square: markers of whole cells, three quarters of a square.
BOARD = Charuco(8, 6, 0.032, 0.024, "DICT_4X4_50", "legacy")


def softer(image: GrayImage, sigma_px: float) -> GrayImage:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), np.uint8)


def darker(image: GrayImage) -> GrayImage:
    """Edges at half the contrast move into the white areas."""
    return np.asarray(255 * (image / 255) ** 2.5, np.uint8)


def shares(images: Sequence[GrayImage], board: Charuco) -> list[float]:
    finder = CornerFinder(board)
    found = [finder(image) for image in images]
    return [
        one.marker_share
        for one in found
        if not isinstance(one, str) and one.marker_share is not None
    ]


@pytest.mark.parametrize(
    ("marker_m", "dictionary"),
    [(0.016, "DICT_6X6_50"), (0.024, "DICT_4X4_50"), (0.028, "DICT_5X5_50")],
)
def test_the_share_is_that_of_the_print(marker_m: float, dictionary: str) -> None:
    board = Charuco(6, 5, 0.032, marker_m, dictionary, "new")
    images = draw(board, 4, seed=2)
    measured = shares(images, board)
    assert len(measured) >= 3
    np.testing.assert_allclose(measured, marker_m / 0.032, rtol=0.01)
    assert as_measured(board, measured) is None


@pytest.mark.parametrize("given_m", [0.014, 0.024, 0.03])
def test_the_share_does_not_depend_on_focus_light_or_what_was_given(given_m: float) -> None:
    images = draw(BOARD, 4, seed=2)
    named = parse_board(f"charuco:8x6:0.032:{given_m}:DICT_4X4_50:legacy")
    assert isinstance(named, Charuco)
    for seen in (
        images,
        [softer(image, 0.8) for image in images],
        [darker(image) for image in images],
    ):
        measured = shares(seen, named)
        assert len(measured) >= 3
        assert np.median(measured) == pytest.approx(0.75, rel=0.015)
        other = as_measured(named, measured)
        if given_m == 0.024:
            assert other is None
        else:
            assert other is not None
            assert other.marker_m == pytest.approx(0.024, rel=0.015)
            assert (other.cols, other.rows, other.square_m) == (8, 6, 0.032)


def test_a_gap_too_narrow_to_be_seen_says_nothing() -> None:
    board = Charuco(8, 6, 0.032, 0.031, "DICT_4X4_50", "new")
    assert shares([softer(image, 1) for image in draw(board, 2, seed=2)], board) == []


def test_one_or_two_views_are_not_enough_to_object() -> None:
    assert as_measured(BOARD, [0.5, None, 0.5]) is None
    assert as_measured(BOARD, [0.5, None, 0.5, 0.51]) is not None
    assert as_measured(BOARD, [0.74, 0.76, 0.5]) is None


def test_some_corners_of_a_board_are_set_aside() -> None:
    """Also fewer than the four that a homography needs."""
    image = draw(BOARD, 1, seed=2)[0]
    finder = CornerFinder(BOARD)
    whole = finder(image)
    assert not isinstance(whole, str)
    side = np.linalg.norm(whole.pixels[1] - whole.pixels[0])
    reasons = []
    for corner in whole.pixels[[9, 16, 17, 25]]:
        for squares in np.arange(1.0, 2.6, 0.25):
            left, top = np.maximum(corner - squares * side, 0).astype(int)
            right, bottom = (corner + squares * side).astype(int)
            part = np.full_like(image, 120)
            part[top:bottom, left:right] = image[top:bottom, left:right]
            found = finder(part)
            assert isinstance(found, str) or len(found.ids) >= 8
            if isinstance(found, str):
                reasons.append(found)
    kinds = kinds_of_reasons(reasons)
    assert kinds["too few corners of the board were found"] > 2
    assert any(reason.endswith((": 1", ": 2", ": 3")) for reason in reasons)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("boards") / "pictures"
    folder.mkdir()
    for i, image in enumerate(draw(BOARD, 12, seed=2)):
        cv2.imwrite(str(folder / f"{i:02}.png"), image)
    return folder


def run(folder: Path, board: str, out: Path) -> Result:
    return CliRunner().invoke(cli, ["calibrate", str(folder), "--board", board, "-o", str(out)])


def test_a_wrong_size_is_a_warning_and_moves_no_corner(folder: Path, tmp_path: Path) -> None:
    done = run(folder, "charuco:8x6:0.032:0.019:DICT_4X4_50", tmp_path / "camera.yaml")
    assert done.exit_code == 0, done.output
    (line,) = [line for line in done.stderr.splitlines() if "measure" in line]
    assert line.startswith("Warning: the markers measure 0.75 of the squares' side, about 0.024")
    assert "not 0.019 m" in line
    assert "--board charuco:8x6:0.032:0.024" in line
    assert "the markers measure 0.75" in (tmp_path / "camera.html").read_text()

    done = run(folder, str(BOARD), tmp_path / "right.yaml")
    assert done.exit_code == 0, done.output
    assert "measure" not in done.stderr
    # After the first line, which names the board.
    wrong, right = (
        (tmp_path / name).read_text().split("\n", 1)[1] for name in ("camera.yaml", "right.yaml")
    )
    assert wrong == right


@pytest.mark.parametrize(
    ("named", "code", "words"),
    [
        ("8x6:0.032:0.002:DICT_4X4_50", 1, "of about 0.02"),
        ("8x6:0.032:0.002:DICT_4X4_50:new", 1, ":DICT_4X4_50:legacy"),
        ("6x8:0.032:0.024:DICT_4X4_50", 1, "found one of 8x6: --board charuco:8x6:0.032:0.024"),
        ("8x6:0.032:0.024:DICT_4X4_50:new", 1, "expected the layout new, found the other"),
        ("8x6:0.032:0.024:DICT_6X6_50", 1, "found none of DICT_6X6_50"),
        ("7x5:0.032:0.024:DICT_4X4_50", 1, "found also 17"),
        ("8x6:0.024:0.032:DICT_4X4_50", 2, "smaller than the squares, found 0.032 in 0.024"),
        ("8x6:0.032:0.032:DICT_4X4_50", 2, "smaller than the squares"),
    ],
)
def test_a_board_that_is_another_is_one_line(
    named: str, code: int, words: str, folder: Path, tmp_path: Path
) -> None:
    done = run(folder, f"charuco:{named}", tmp_path / "camera.yaml")
    assert done.exit_code == code
    text = done.stderr.splitlines()[-1] if code == 2 else str(done.exception)
    assert words in text
    assert "\n" not in text
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["2024-05-07_lifecam_1280", "2024-05-07_lifecam_480"])
def test_the_share_on_real_boards(name: str, shared_data: Path) -> None:
    """19.05 mm in 25.4 mm, as published; every second picture."""
    files = sorted((shared_data / "charuco" / name).glob("*.jpg"))[::2]
    images = [cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in files]
    assert all(image is not None for image in images)
    right = Charuco(8, 8, 0.0254, 0.01905, "DICT_4X4_250", "new")
    wrong = Charuco(8, 8, 0.0254, 0.015, "DICT_4X4_250", "new")
    measured = shares([np.asarray(image, np.uint8) for image in images], right)
    assert len(measured) == len(files)
    np.testing.assert_allclose(measured, 0.75, rtol=0.02)
    assert np.median(measured) == pytest.approx(0.75, rel=0.01)
    assert as_measured(right, measured) is None
    other = as_measured(wrong, measured)
    assert other is not None
    assert other.marker_m == pytest.approx(0.01905, rel=0.01)
