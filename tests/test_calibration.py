"""The least squares behind a calibration: exact worlds, honest uncertainties, sound judgements."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.camera import Camera, DistortionModel
from pipeline.geometry import Array, Pose
from recorder.errors import InputError
from replay.calibration.board import Charuco, Chessboard, parse_board
from replay.calibration.calibrate import Calibration, calibrate
from replay.calibration.findings import warnings
from replay.calibration.fit import fit_lens, fit_pose
from replay.calibration.heldout import held_out
from replay.calibration.lens import Lens
from replay.calibration.outliers import without_outliers
from replay.calibration.start import first_fit, start_pose
from replay.calibration.uncertainty import projection_std_px
from replay.calibration.views import View
from tests.boards import board_poses, exact_views, gathered
from tests.worlds import camera

MODELS: tuple[DistortionModel, ...] = ("plumb_bob", "rational_polynomial", "equidistant")
BOARD = Chessboard(9, 6, 0.03)
SOURCE = Path("pictures")


def values_of(lens: Camera) -> Array:
    k = lens.camera_matrix
    return np.array([k[0, 0], k[1, 1], k[0, 2], k[1, 2], *lens.dist_coeffs])


def as_rows(poses: list[Pose]) -> Array:
    return np.stack([np.concatenate([pose.rvec, pose.translation]) for pose in poses])


def told_apart(model: DistortionModel) -> Camera:
    """A lens whose coefficients all show; those of a weaker rational one trade without end."""
    if model != "rational_polynomial":
        return camera(model)
    matrix = [[600.0, 0.0, 640.0], [0.0, 603.0, 360.0], [0.0, 0.0, 1.0]]
    coefficients = [0.5, -2.6, 0.0006, -0.0003, 1.5, 0.4, -2.4, 1.4]
    return Camera(1280, 720, np.array(matrix), model, np.array(coefficients))


def run(views: list[View], true: Camera, model: DistortionModel = "plumb_bob") -> Calibration:
    return calibrate(gathered(true, views), BOARD, Lens(model), SOURCE)


@pytest.mark.parametrize("model", MODELS)
def test_exact_corners_give_the_exact_lens(model: DistortionModel) -> None:
    true = camera(model)
    views = exact_views(true, BOARD, board_poses(true, BOARD, 20, seed=1))
    found = first_fit(Lens(model), views, true.image_size)
    assert found is not None
    fit, kept = found
    assert len(kept) == 20
    assert fit.rms_px < 1e-6
    # A rational lens is the same with other coefficients: it is compared by what it does.
    grid = np.column_stack([axis.ravel() for axis in np.mgrid[-0.55:0.56:0.1, -0.3:0.31:0.1]])
    points = np.column_stack([grid, np.ones(len(grid))])
    again = Lens(model).camera(fit.values, true.image_size).project(points)
    assert np.abs(again - true.project(points)).max() < 0.01
    if model != "rational_polynomial":
        np.testing.assert_allclose(fit.values, values_of(true), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("model", MODELS)
def test_standard_deviations_are_honest(model: DistortionModel) -> None:
    """Over many seeds the errors are as large as was said, also by leaving views out."""
    true, lens, seeds = told_apart(model), Lens(model), 40
    poses = board_poses(true, BOARD, 16, seed=2)
    truth = values_of(true)
    pulls, pulls_by_views, sigmas = [], [], []
    for seed in range(seeds):
        views = exact_views(true, BOARD, poses, sigma_px=0.1, seed=seed)
        fit = fit_lens(lens, views, truth, as_rows(poses))
        errors = fit.values - truth
        pulls.append(errors / np.sqrt(np.diag(fit.covariance)))
        pulls_by_views.append(errors / np.sqrt(np.diag(fit.covariance_by_views)))
        sigmas.append(fit.sigma_px)
    assert np.mean(sigmas) == pytest.approx(0.1, rel=0.01)
    mean_square = np.mean(np.square(pulls), axis=0)
    print(f"{model}: mean squared pulls {mean_square.round(2)}")
    # 1 in the mean; over 40 seeds it scatters by sqrt(2 / 40) = 0.22.
    assert (mean_square > 0.35).all()
    assert (mean_square < 1.7).all()
    by_views = np.mean(np.square(pulls_by_views), axis=0)
    print(f"{model}: by views {by_views.round(2)}")
    assert (by_views > 0.25).all()
    assert (by_views < 1.8).all()


@pytest.mark.parametrize("model", ["plumb_bob", "rational_polynomial"])
def test_the_minimum_is_that_of_opencv(model: DistortionModel) -> None:
    true = told_apart(model)
    poses = board_poses(true, BOARD, 12, seed=3)
    views = exact_views(true, BOARD, poses, sigma_px=0.3)
    found = first_fit(Lens(model), views, true.image_size)
    assert found is not None
    flags = cv2.CALIB_RATIONAL_MODEL if model == "rational_polynomial" else 0
    rms, matrix, _, _, _, std, *_ = cv2.calibrateCameraExtended(
        [view.points_m.astype(np.float32) for view in views],
        [view.pixels.astype(np.float32) for view in views],
        true.image_size,
        np.eye(3),
        np.zeros(8 if flags else 5),
        flags=flags,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-14),
    )
    fit = found[0]
    assert fit.rms_px == pytest.approx(rms, rel=1e-4)
    own_std = np.sqrt(np.diag(fit.covariance))
    own = fit.values[:4]
    assert (np.abs(own - matrix[[0, 1, 0, 1], [0, 1, 2, 2]]) < 0.05 * own_std[:4]).all()
    np.testing.assert_allclose(own_std, np.ravel(std)[: len(own_std)], rtol=0.02)


def test_jacobians_are_those_of_differences() -> None:
    pose = np.array([0.2, -0.3, 0.4, -0.1, -0.1, 0.5])
    for model in MODELS:
        values = values_of(camera(model))
        lens = Lens(model)
        projected = lens.project(values, pose, BOARD.points_m)
        assert projected is not None
        _, by_values, by_pose = projected

        def at(values: Array, pose: Array, lens: Lens = lens) -> Array:
            found = lens.project(values, pose, BOARD.points_m)
            assert found is not None
            return found[0].ravel()

        for i, step in enumerate(1e-6 * np.eye(len(values))):
            difference = (at(values + step, pose) - at(values - step, pose)) / 2e-6
            np.testing.assert_allclose(by_values[:, i], difference, rtol=1e-4, atol=1e-4)
        for i, step in enumerate(1e-6 * np.eye(6)):
            difference = (at(values, pose + step) - at(values, pose - step)) / 2e-6
            np.testing.assert_allclose(by_pose[:, i], difference, rtol=1e-4, atol=1e-4)


def test_a_point_behind_the_camera_has_no_projection() -> None:
    for model in MODELS:
        behind = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -0.5])
        assert Lens(model).project(values_of(camera(model)), behind, BOARD.points_m) is None


def test_a_view_that_does_not_fit_is_named_and_the_others_stay() -> None:
    true = camera()
    views = exact_views(true, BOARD, board_poses(true, BOARD, 16, seed=4), sigma_px=0.15)
    bent = views[5].pixels + np.random.default_rng(0).normal(0, 2.0, views[5].pixels.shape)
    views[5] = View("bent.png", views[5].points_m, bent, 1.0, views[5].outline_px)
    # As if two rows of corners had been mixed up.
    swapped = views[9].pixels.copy()
    swapped[:18] = swapped[[*range(9, 18), *range(9)]]
    views[9] = View("swapped.png", views[9].points_m, swapped, 1.0, views[9].outline_px)
    calibration = run(views, true)
    out = {one.name: one.reason for one in calibration.set_aside}
    assert set(out) == {"bent.png", "swapped.png"}
    assert "times the median" in out["bent.png"]
    assert len(calibration.views) == 14
    assert np.abs(calibration.fit.values[:4] - values_of(true)[:4]).max() < 5 * max(
        calibration.std[:4]
    )


def test_noise_alone_removes_no_view() -> None:
    true = camera()
    for seed in range(3):
        views = exact_views(
            true, BOARD, board_poses(true, BOARD, 12, seed=seed), sigma_px=0.3, seed=seed
        )
        fitted = without_outliers(Lens("plumb_bob"), views, true.image_size)
        assert fitted is not None
        assert fitted[1:] == (list(range(12)), [])


def test_held_out_errors_are_those_of_fits_without_the_view() -> None:
    true, lens = camera(), Lens("plumb_bob")
    views = exact_views(true, BOARD, board_poses(true, BOARD, 10, seed=5), sigma_px=0.2)
    found = first_fit(lens, views, true.image_size)
    assert found is not None
    held = held_out(found[0], views)
    assert held.folds == 10
    others = first_fit(lens, views[:3] + views[4:], true.image_size)
    assert others is not None
    start = start_pose(lens, others[0].values, views[3].points_m, views[3].pixels)
    assert start is not None
    pose = fit_pose(lens, others[0].values, views[3], start)
    assert pose is not None
    projected = lens.project(others[0].values, pose, views[3].points_m)
    assert projected is not None
    error = np.sqrt(np.mean(np.sum((projected[0] - views[3].pixels) ** 2, axis=1)))
    assert held.view_rms_px[3] == pytest.approx(error, rel=1e-5)
    assert held.rms_px > found[0].rms_px


def test_projection_uncertainty_is_what_calibrations_scatter_by() -> None:
    true, lens = camera(), Lens("plumb_bob")
    poses = board_poses(true, BOARD, 14, seed=6)
    truth = values_of(true)
    grid = np.array([[100.0, 80.0], [640.0, 360.0], [1180.0, 640.0], [300.0, 600.0]])
    # The cells of the map nearest to them.
    rows, cols = 18, 32
    at = np.round(grid / (1279, 719) * (cols - 1, rows - 1)).astype(int)
    pixels = at * (1279 / (cols - 1), 719 / (rows - 1))
    v, u = np.meshgrid(np.linspace(0, 719, rows), np.linspace(0, 1279, cols), indexing="ij")
    everywhere = np.column_stack([u.ravel(), v.ravel()])
    rays = np.column_stack([true.undistort(everywhere), np.ones(rows * cols)])
    moved, said = [], None
    for seed in range(40):
        views = exact_views(true, BOARD, poses, sigma_px=0.2, seed=seed)
        fit = fit_lens(lens, views, truth, as_rows(poses))
        if said is None:
            said = projection_std_px(lens, fit.values, fit.covariance, true.image_size)
            assert said.shape == (rows, cols)
        found = lens.camera(fit.values, true.image_size)
        _, _, turn = lens.project(truth, np.zeros(6), rays) or (None, None, np.zeros((0, 6)))
        error = (found.project(rays) - everywhere).ravel()
        error -= turn[:, :3] @ np.linalg.lstsq(turn[:, :3], error, rcond=None)[0]
        chosen = [row * cols + col for col, row in at]
        moved.append(error.reshape(-1, 2)[chosen])
    assert said is not None
    scatter = np.sqrt(np.mean(np.sum(np.square(moved), axis=2), axis=0))
    expected = said[at[:, 1], at[:, 0]]
    print(f"at {pixels.round(0).tolist()}: said {expected.round(2)}, scatter {scatter.round(2)}")
    np.testing.assert_allclose(expected, scatter, rtol=0.35)


def test_corners_that_no_view_was_in_do_not_blur_the_middle() -> None:
    """Where the board was the lens is known, however wild it may be beyond."""
    matrix = np.array([[533.0, 0.0, 342.0], [0.0, 533.0, 234.0], [0.0, 0.0, 1.0]])
    true = Camera(640, 480, matrix, "plumb_bob", np.array([-0.28, 0.05, 0.001, 0.0, 0.1]))
    lens, truth, board = Lens("plumb_bob"), values_of(true), Chessboard(9, 6, 0.02)
    poses = board_poses(true, board, 400, seed=1)
    seen = [
        (view, pose)
        for view, pose in zip(exact_views(true, board, poses, sigma_px=0.2), poses, strict=True)
        if (np.abs(view.pixels - (320, 240)) < (190, 150)).all()
    ]
    views, kept = [view for view, _ in seen], [pose for _, pose in seen]
    covariance = fit_lens(lens, views, truth, as_rows(kept)).covariance
    said = projection_std_px(lens, truth, covariance, true.image_size)
    assert said[0, 0] > 5.0
    # Lenses as they may be by that, each turned to what fits best where the board was.
    v, u = np.mgrid[120.0:361.0:24.0, 160.0:481.0:32.0]
    middle = np.column_stack([u.ravel(), v.ravel()])
    rays = np.column_stack([true.undistort(middle), np.ones(len(middle))])
    _, _, by_pose = lens.project(truth, np.zeros(6), rays) or (None, None, np.zeros((0, 6)))
    errors = []
    for values in np.random.default_rng(2).multivariate_normal(truth, covariance, 200):
        error = (lens.camera(values, true.image_size).project(rays) - middle).ravel()
        turn = np.linalg.lstsq(by_pose[:, :3], error, rcond=None)[0]
        errors.append(error - by_pose[:, :3] @ turn)
    scatter = float(np.sqrt(2 * np.mean(np.square(errors))))
    rows, cols = said.shape
    inside = said[rows // 4 : -(rows // 4), cols // 4 : -(cols // 4)]
    print(f"middle: said {np.sqrt(np.mean(inside**2)):.3f} px, scatter {scatter:.3f} px")
    assert float(np.sqrt(np.mean(inside**2))) == pytest.approx(scatter, rel=0.3)


@pytest.mark.slow
def test_warns_of_frontal_views_and_of_half_an_image() -> None:
    true = camera()
    frontal = exact_views(
        true, BOARD, board_poses(true, BOARD, 12, seed=7, most_tilt_deg=6.0), sigma_px=0.2
    )
    text = "\n".join(warnings(run(frontal, true)))
    assert "tilted to the left or right and up or down" in text
    assert "uncertain: fx" in text
    poses = board_poses(true, BOARD, 80, seed=8)
    right = [
        view
        for view in exact_views(true, BOARD, poses, sigma_px=0.2)
        if view.pixels[:, 0].min() > 500
    ]
    assert len(right) >= 10
    text = "\n".join(warnings(run(right, true)))
    assert "the top left, left and bottom left of the image" in text
    assert "tilted" not in text


def test_warns_of_parameters_that_no_view_needs() -> None:
    straight = Camera(
        1280, 720, camera().camera_matrix, "plumb_bob", np.array([-0.2, 0.05, 0.001, 0.0005, 0.0])
    )
    views = exact_views(straight, BOARD, board_poses(straight, BOARD, 20, seed=9), sigma_px=0.2)
    text = "\n".join(warnings(run(views, straight, "rational_polynomial")))
    assert "does as well on held-out views" in text
    assert "--model plumb_bob --zero k3" in text


@pytest.mark.slow
def test_warns_of_a_lens_of_another_kind() -> None:
    matrix = [[380.0, 0, 640], [0, 380.0, 360], [0, 0, 1]]
    fisheye = Camera(1280, 720, np.array(matrix), "equidistant", np.array([0.05, -0.01, 0, 0]))
    views = exact_views(fisheye, BOARD, board_poses(fisheye, BOARD, 20, seed=10), sigma_px=0.1)
    text = "\n".join(warnings(run(views, fisheye)))
    assert "equidistant does better" in text or "rational_polynomial does better" in text
    right = "\n".join(warnings(run(views, fisheye, "equidistant")))
    assert "does better" not in right
    # The image's sides show more than a half space: no fault of the lens.
    assert "no ray" not in right


@pytest.mark.slow
def test_a_good_calibration_has_nothing_against_it() -> None:
    true = told_apart("rational_polynomial")
    views = exact_views(true, BOARD, board_poses(true, BOARD, 40, seed=11), sigma_px=0.1)
    assert warnings(run(views, true, "rational_polynomial")) == []


@pytest.mark.slow
def test_of_many_views_those_that_differ_are_used() -> None:
    true = camera()
    views = exact_views(true, BOARD, board_poses(true, BOARD, 24, seed=12), sigma_px=0.2)
    few = calibrate(gathered(true, views), BOARD, Lens("plumb_bob"), SOURCE, most_views=12)
    assert len(few.views) == 12
    assert {one.reason for one in few.set_aside} == {"not needed beside 12 that differ more"}
    # Chosen, twelve cover nearly as much as all; the first twelve do not.
    every = run(views, true)
    first = run(views[:12], true)
    assert few.coverage.share > 0.8 * every.coverage.share
    assert few.coverage.share > first.coverage.share
    assert few.std[0] < first.std[0]


def test_too_few_views_say_what_is_missing() -> None:
    true = camera()
    views = exact_views(true, BOARD, board_poses(true, BOARD, 80, seed=13, most_tilt_deg=8))
    left = [view for view in views if view.pixels[:, 0].max() < 800][:6]
    with pytest.raises(InputError) as raised:
        run(left, true)
    text = str(raised.value)
    assert text.startswith("pictures: expected at least 10 usable views of chessboard:9x6:0.03")
    assert "found 6 in 6 images" in text
    assert "right" in text
    assert "tilted" in text
    assert "\n" not in text


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("chess:9x6:0.025", "expected chessboard:"),
        ("chessboard:9x6", "expected chessboard:"),
        ("chessboard:9:0.025", "COLSxROWS"),
        ("chessboard:9x2:0.025", "3 to 200 inner corners"),
        ("chessboard:9x6:25mm", "in metres"),
        ("chessboard:9x6:25", "in metres, at most 1, found '25'"),
        ("chessboard:9x6:nan", "in metres"),
        ("chessboard:9x6:-1", "in metres"),
        ("charuco:8x8:0.02:0.03:DICT_4X4_250", "smaller than the squares"),
        ("charuco:8x8:0.03:0.02:DICT_4X4", "dictionary of cv2.aruco"),
        ("charuco:12x12:0.03:0.02:DICT_4X4_50", "at least 72 markers"),
        ("charuco:8x8:0.03:0.02:DICT_4X4_250:old", "new or legacy"),
    ],
)
def test_board_names_that_make_no_sense(text: str, problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        parse_board(text)


@pytest.mark.parametrize(
    "text",
    [
        "chessboard:9x6:0.025",
        "charuco:8x8:0.0254:0.01905:DICT_4X4_250",
        "charuco:8x8:0.0254:0.01905:DICT_4X4_250:legacy",
    ],
)
def test_a_board_says_its_name(text: str) -> None:
    board = parse_board(text)
    assert str(board) == text
    assert parse_board(str(board)) == board


def test_charuco_corners_are_those_of_opencv() -> None:
    board = Charuco(7, 5, 0.03, 0.02, "DICT_4X4_50")
    np.testing.assert_allclose(
        board.points_m, np.asarray(board.opencv.getChessboardCorners()), atol=1e-7
    )


def test_a_lens_knows_its_coefficients() -> None:
    assert Lens("plumb_bob", frozenset({"k3"})).free.sum() == 8
    with pytest.raises(ValueError, match="expected a coefficient of equidistant"):
        Lens("equidistant", frozenset({"p1"}))
