"""From pictures of boards to camera.yaml and its report, as a person would."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner, Result

from arucolog import cli
from pipeline.camera import Camera
from pipeline.detection import GrayImage
from recorder.errors import InputError
from recorder.files.camera_file import parse_camera
from recorder.files.output_file import write_together
from recorder.log.reader import LogReader
from recorder.log.writer import LogWriter
from recorder.sources.base import CapturedFrame
from replay.calibration.board import Charuco, Chessboard
from replay.calibration.corners import CornerFinder, blur, charuco_layout
from replay.calibration.frames import Frames
from replay.calibration.views import gather
from tests.boards import CAMERA, board_poses, draw, pictures

CHESSBOARD = Chessboard(8, 6, 0.03)
CHARUCO = Charuco(8, 6, 0.03, 0.022, "DICT_4X4_50")


@pytest.fixture(scope="module")
def chessboards() -> list[GrayImage]:
    return draw(CHESSBOARD, 14, seed=1)


def save(images: Sequence[GrayImage], folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    for i, image in enumerate(images):
        cv2.imwrite(str(folder / f"{i:02}.png"), image)
    return folder


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(cli, ["calibrate", *map(str, arguments)])


def check(found: Camera, report: dict[str, object], tolerance_px: float = 0.4) -> None:
    """The lens that the pictures were drawn with, wherever the board was."""
    assert found.image_size == CAMERA.image_size
    grid = np.column_stack([axis.ravel() for axis in np.mgrid[-0.5:0.6:0.1, -0.4:0.5:0.1]])
    points = np.column_stack([grid, np.ones(len(grid))])
    shift = np.linalg.norm(found.project(points) - CAMERA.project(points), axis=1)
    matrix = found.camera_matrix
    print(
        f"rms {report['rms_px']:.3f} px, fx {matrix[0, 0]:.2f}, cx {matrix[0, 2]:.2f}; "
        f"projections differ by {shift.mean():.2f} px, at most {shift.max():.2f} px"
    )
    assert shift.max() < tolerance_px


def test_a_folder_of_chessboards(chessboards: list[GrayImage], tmp_path: Path) -> None:
    folder = save(chessboards, tmp_path / "pictures")
    out = tmp_path / "camera.yaml"
    done = run(folder, "--board", str(CHESSBOARD), "-o", out, "--name", "front", "--json")
    assert done.exit_code == 0, done.output
    report = json.loads(done.stdout)
    assert len(report["views"]) == 14
    assert report["rms_px"] < 0.1
    camera = parse_camera(out.read_bytes(), out)
    assert camera.name == "front"
    check(camera, report)
    page = (tmp_path / "camera.html").read_text()
    assert "data:image/png;base64," in page
    # A cell that wraps, however long the name.
    assert '<td class="text name">07.png</td>' in page
    assert "http" not in page

    # The same again gives the same files, and only when asked to.
    refused = run(folder, "--board", str(CHESSBOARD), "-o", out)
    assert isinstance(refused.exception, InputError)
    assert "--force" in str(refused.exception)
    before = out.read_bytes(), page
    again = run(folder, "--board", str(CHESSBOARD), "-o", out, "--name", "front", "--force")
    assert again.exit_code == 0
    assert (out.read_bytes(), (tmp_path / "camera.html").read_text()) == before
    assert {path.name for path in tmp_path.iterdir()} == {"pictures", "camera.yaml", "camera.html"}
    assert "without those set aside because they do not fit" in report["held_out"]["how"]


@pytest.mark.parametrize("there", [True, False])
@pytest.mark.parametrize("step", ["write_bytes", "replace"])
def test_files_that_belong_together(
    step: str, there: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the second cannot be written, both are as they were before."""
    page, out = tmp_path / "camera.html", tmp_path / "camera.yaml"
    if there:
        page.write_bytes(b"old page")
        out.write_bytes(b"old camera")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    plain = getattr(Path, step)

    def failing(path: Path, argument: object) -> object:
        if path.name.startswith(".camera.yaml"):
            raise OSError(28, "No space left on device", str(path))
        return plain(path, argument)

    with monkeypatch.context() as patch:
        patch.setattr(Path, step, failing)
        with pytest.raises(OSError, match="No space"):
            write_together({page: b"page", out: b"camera"}, force=True)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    write_together({page: b"page", out: b"camera"}, force=True)
    assert (page.read_bytes(), out.read_bytes()) == (b"page", b"camera")


@pytest.mark.slow
@pytest.mark.parametrize("model", ["rational_polynomial", "equidistant"])
def test_the_file_of_every_model_can_be_read(
    model: str, chessboards: list[GrayImage], tmp_path: Path
) -> None:
    out = tmp_path / "camera.yaml"
    folder = save(chessboards, tmp_path / "pictures")
    done = run(folder, "--board", str(CHESSBOARD), "--model", model, "-o", out)
    assert done.exit_code == 0, done.output
    assert parse_camera(out.read_bytes(), out).distortion_model == model


@pytest.mark.slow
def test_a_log_gives_what_its_images_give(chessboards: list[GrayImage], tmp_path: Path) -> None:
    folder = save(chessboards, tmp_path / "pictures")
    files = sorted(folder.iterdir())
    with LogWriter(tmp_path / "a.mcap", attachments={}, session={"source": "test"}) as writer:
        for i, file in enumerate(files):
            stamp = 10**18 + i * 10**8
            writer.write_frame(CapturedFrame(i, stamp, stamp, file.read_bytes(), "png"))
    board = str(CHESSBOARD)
    assert run(folder, "--board", board, "-o", tmp_path / "folder.yaml").exit_code == 0
    done = run(tmp_path / "a.mcap", "--board", board, "-o", tmp_path / "log.yaml", "--json")
    assert done.exit_code == 0, done.output
    assert (tmp_path / "log.yaml").read_bytes() == (tmp_path / "folder.yaml").read_bytes()
    assert json.loads(done.stdout)["views"][3]["name"] == "frame 3 (0.30 s)"
    with LogReader(tmp_path / "a.mcap") as reader:
        assert reader.image_count() == 14


@pytest.mark.parametrize("layout", [pytest.param("new", marks=pytest.mark.slow), "legacy"])
def test_both_charuco_layouts(layout: str, tmp_path: Path) -> None:
    board = CHARUCO.with_layout("legacy" if layout == "legacy" else "new")
    folder = save(draw(board, 12, seed=2), tmp_path / "pictures")
    out = tmp_path / "camera.yaml"
    done = run(folder, "--board", str(CHARUCO), "-o", out, "--json")
    assert done.exit_code == 0, done.output
    report = json.loads(done.stdout)
    assert report["board"] == f"{CHARUCO}:{layout}"
    assert len(report["views"]) == 12
    assert report["rms_px"] < 0.15
    check(parse_camera(out.read_bytes(), out), report)

    other = "new" if layout == "legacy" else "legacy"
    wrong = run(folder, "--board", f"{CHARUCO}:{other}", "-o", tmp_path / "b.yaml")
    assert f"expected the layout {other}, found the other: --board {CHARUCO}:{layout}" in str(
        wrong.exception
    )
    assert not (tmp_path / "b.yaml").exists()


def test_an_odd_number_of_rows_has_one_layout() -> None:
    board = Charuco(8, 5, 0.03, 0.022, "DICT_4X4_50")
    assert charuco_layout([], board) == "new"
    legacy = board.with_layout("legacy")
    for id, corners in board.marker_corners_m.items():
        np.testing.assert_array_equal(corners, legacy.marker_corners_m[id])


def test_part_of_a_charuco_board_is_enough(tmp_path: Path) -> None:
    board = CHARUCO.with_layout("new")
    image = draw(board, 1, seed=3)[0]
    whole = CornerFinder(board)(image)
    assert not isinstance(whole, str)
    half = image.copy()
    half[:, : int(np.median(whole.pixels[:, 0]))] = 128
    part = CornerFinder(board)(half)
    assert not isinstance(part, str)
    assert 8 <= len(part.ids) < len(whole.ids)
    shared = {int(id): pixel for id, pixel in zip(whole.ids, whole.pixels, strict=True)}
    shift = [np.abs(shared[int(id)] - p).max() for id, p in zip(part.ids, part.pixels, strict=True)]
    assert max(shift) < 0.1


def test_corners_are_where_they_were_drawn() -> None:
    for board in (CHESSBOARD, CHARUCO.with_layout("new"), CHARUCO.with_layout("legacy")):
        poses = board_poses(CAMERA, board, 5, seed=4)
        squares = []
        for image, pose in zip(pictures(CAMERA, board, poses), poses, strict=True):
            found = CornerFinder(board)(image)
            assert not isinstance(found, str)
            exact = CAMERA.project(pose.apply(board.points_m))
            # Turned by 180° a chessboard is the same: its corners may be counted from the end.
            errors = [found.pixels - exact[found.ids]]
            if isinstance(board, Chessboard):
                errors.append(found.pixels - exact[::-1][found.ids])
            squares.append(min(np.mean(np.sum(error**2, axis=1)) for error in errors))
        rms = float(np.sqrt(np.mean(squares)))
        print(f"{board}: corners {rms:.3f} px rms")
        assert rms < 0.08


def test_blur_is_measured(chessboards: list[GrayImage]) -> None:
    finder = CornerFinder(CHESSBOARD)
    found = finder(chessboards[0])
    assert not isinstance(found, str)
    cols = CHESSBOARD.corner_shape[0]
    sharp = blur(chessboards[0], found.ids, found.pixels, cols)
    softer = [
        blur(cv2.GaussianBlur(chessboards[0], (0, 0), sigma), found.ids, found.pixels, cols)  # type: ignore[arg-type]
        for sigma in (1.0, 1.5, 2.0)
    ]
    for sigma, measured in zip((1.0, 1.5, 2.0), softer, strict=True):
        assert measured == pytest.approx(np.hypot(sharp, sigma), rel=0.2)
    # Motion along one axis leaves edges along it sharp, and counts all the same.
    moved = cv2.blur(chessboards[0], (7, 1))
    assert blur(moved, found.ids, found.pixels, cols) > 1.7 * sharp  # type: ignore[arg-type]


def test_what_is_no_use_is_named(chessboards: list[GrayImage], tmp_path: Path) -> None:
    noise = np.random.default_rng(5).normal(0, 1, chessboards[0].shape)
    again = np.asarray(np.clip(np.roll(chessboards[3], 2, axis=1) + noise, 0, 255), np.uint8)
    images = [*chessboards[:12], again, np.full_like(again, 90)]
    images[5] = np.asarray(cv2.blur(images[5], (13, 1)), np.uint8)
    folder = save(images, tmp_path / "pictures")
    (folder / "20.png").write_bytes(b"no picture")
    gathered = gather(Frames(folder, 1000), CHESSBOARD)
    reasons = {one.name: one.reason for one in gathered.set_aside}
    assert gathered.looked_at == 15
    assert reasons["13.png"] == "the board was not found"
    assert reasons["20.png"] == "no readable image"
    # Of two alike the softer one goes.
    alike = {"03.png", "12.png"} & set(reasons)
    assert len(alike) == 1
    assert reasons[alike.pop()].startswith("like ")
    assert reasons["05.png"].startswith(("blurred: ", "the board was not found"))
    assert len(gathered.views) == 11


def test_a_long_source_is_thinned(chessboards: list[GrayImage], tmp_path: Path) -> None:
    folder = save(chessboards, tmp_path / "pictures")
    frames = Frames(folder, 5)
    assert (frames.total, frames.every, len(frames)) == (14, 3, 5)
    assert [frame.name for frame in frames] == ["00.png", "03.png", "06.png", "09.png", "12.png"]


def test_errors_are_one_line_and_leave_nothing(
    chessboards: list[GrayImage], tmp_path: Path
) -> None:
    folder = save(chessboards[:4], tmp_path / "pictures")
    out = tmp_path / "camera.yaml"
    done = run(folder, "--board", str(CHESSBOARD), "-o", out)
    text = str(done.exception)
    assert isinstance(done.exception, InputError)
    assert "found 4 in 4 images; take more with the board at the" in text
    assert "\n" not in text

    counted = run(folder, "--board", "chessboard:9x7:0.03", "-o", out)
    assert "--board chessboard:8x6:0.03" in str(counted.exception)
    none = run(folder, "--board", "charuco:8x6:0.03:0.02:DICT_5X5_50", "-o", out)
    assert "found none of DICT_5X5_50" in str(none.exception)
    nowhere = run(tmp_path / "nowhere", "--board", str(CHESSBOARD), "-o", out)
    assert "found nothing there" in str(nowhere.exception)
    live = run("rtsp://camera", "--board", str(CHESSBOARD), "-o", out)
    assert str(live.exception).startswith("rtsp://camera: expected a log")
    secret = run("http://me:secret@cam/video", "--board", str(CHESSBOARD), "-o", out)
    assert str(secret.exception).startswith("http://me:***@cam/video: expected a log")
    assert "record a live camera first" in str(secret.exception)
    assert run(folder, "--board", "chessboard:8x6", "-o", out).exit_code == 2
    assert run(folder, "--board", str(CHESSBOARD), "--zero", "k9", "-o", out).exit_code == 2
    assert [path.name for path in tmp_path.iterdir()] == ["pictures"]
