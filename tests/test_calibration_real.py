"""Calibrations from real pictures, held against what was published."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.camera import DistortionModel
from replay.calibration.board import parse_board
from replay.calibration.findings import warnings
from replay.calibration.lens import Lens
from replay.calibration.session import Session, calibrate_source


def run(folder: Path, board: str, model: DistortionModel = "plumb_bob") -> Session:
    session = calibrate_source(folder, parse_board(board), Lens(model), progress=False)
    calibration = session.calibration
    values = dict(zip(calibration.lens.names, calibration.fit.values, strict=True))
    print(
        f"{folder.name}, {calibration.board}, {model}: {len(calibration.views)} of "
        f"{session.images} views, rms {calibration.fit.rms_px:.3f} px, "
        f"held out {calibration.held_out.rms_px:.3f} px, "
        f"fx {values['fx']:.2f} ± {calibration.std[0]:.2f} "
        f"(by views {calibration.std_by_views[0]:.2f})"
    )
    for warning in warnings(calibration):
        print(f"  {warning}")
    return session


def test_chessboard(shared_data: Path) -> None:
    """13 pictures of a 9x6 board; published: fx 535.9 with fx = fy."""
    calibration = run(shared_data / "chessboard", "chessboard:9x6:0.025").calibration
    assert len(calibration.views) >= 12
    assert calibration.fit.rms_px <= 0.20
    assert calibration.held_out.rms_px <= 0.20
    assert calibration.fit.values[0] == pytest.approx(535.9, rel=0.01)
    # None of them is like another or blurred.
    assert len(calibration.views) + len(calibration.set_aside) == 13


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "count", "size"),
    [("2024-05-07_lifecam_1280", 16, (1280, 720)), ("2024-05-07_lifecam_480", 17, (640, 480))],
)
def test_charuco(name: str, count: int, size: tuple[int, int], shared_data: Path) -> None:
    """Two sets of a webcam; every image shows enough of the board, and every one is used."""
    board = "charuco:8x8:0.0254:0.01905:DICT_4X4_250"
    calibration = run(shared_data / "charuco" / name, board).calibration
    assert str(calibration.board) == f"{board}:new"
    assert calibration.camera.image_size == size
    assert calibration.set_aside == ()
    assert len(calibration.views) == count
    assert calibration.fit.rms_px <= 0.30
    assert calibration.held_out.rms_px <= 0.30


@pytest.mark.slow
@pytest.mark.parametrize("model", ["rational_polynomial", "equidistant"])
def test_the_other_models(model: DistortionModel, shared_data: Path) -> None:
    calibration = run(shared_data / "chessboard", "chessboard:9x6:0.025", model).calibration
    assert len(calibration.views) == 13
    assert calibration.fit.rms_px <= 0.20
    assert calibration.fit.values[0] == pytest.approx(535.9, rel=0.01)
