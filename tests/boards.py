"""Calibration boards before cameras: poses, exact corners, and pictures through the lens."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.camera import Camera
from pipeline.detection import GrayImage
from pipeline.geometry import Array, Pose
from replay.calibration.board import Board, Charuco, Chessboard
from replay.calibration.views import Gathered, View

# Between a plain lens and a fisheye; small, so that drawing is quick.
CAMERA = Camera(
    640,
    480,
    np.array([[420.0, 0.0, 322.5], [0.0, 421.5, 236.0], [0.0, 0.0, 1.0]]),
    "plumb_bob",
    np.array([-0.2, 0.05, 0.0005, -0.0008, 0.0]),
)

# White around the print, in squares.
_MARGIN = 1


def board_poses(
    camera: Camera, board: Board, count: int, seed: int, *, most_tilt_deg: float = 40.0
) -> list[Pose]:
    """Random T_camera_board with the whole board in the image, near and far, tilted every way."""
    random = np.random.default_rng(seed)
    points = board.points_m
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    length = float(np.linalg.norm(points.max(axis=0) - points.min(axis=0)))
    found: list[Pose] = []
    while len(found) < count:
        pixel = random.uniform((0, 0), camera.image_size)
        ray = np.append(camera.undistort(pixel[None])[0], 1.0)
        if not np.isfinite(ray).all():
            continue
        tilt = np.radians(random.uniform(-most_tilt_deg, most_tilt_deg, 2))
        turn = random.uniform(-0.6, 0.6)
        rotation = (
            Pose.from_rvec_tvec((tilt[0], 0, 0), (0, 0, 0))
            @ Pose.from_rvec_tvec((0, tilt[1], 0), (0, 0, 0))
            @ Pose.from_rvec_tvec((0, 0, turn), (0, 0, 0))
        ).rotation
        distance = length * random.uniform(0.8, 1.6)
        pose = Pose(rotation, ray / np.linalg.norm(ray) * distance - rotation @ middle)
        pixels = camera.project(pose.apply(points))
        if (pixels >= 3).all() and (pixels < np.array(camera.image_size) - 3).all():
            found.append(pose)
    return found


def exact_views(
    camera: Camera, board: Board, poses: Sequence[Pose], *, sigma_px: float = 0.0, seed: int = 0
) -> list[View]:
    """What a perfect detector finds, with Gaussian noise on it."""
    random = np.random.default_rng(seed)
    cols, rows = board.corner_shape
    outer = [0, cols - 1, cols * rows - 1, cols * (rows - 1)]
    views = []
    for i, pose in enumerate(poses):
        pixels = camera.project(pose.apply(board.points_m))
        pixels = pixels + random.normal(0, sigma_px, pixels.shape)
        views.append(View(f"{i}.png", board.points_m, pixels, 1.0, pixels[outer]))
    return views


def gathered(camera: Camera, views: Sequence[View]) -> Gathered:
    return Gathered(camera.image_size, tuple(views), ())


def draw(board: Board, count: int, seed: int) -> list[GrayImage]:
    """Noisy pictures by `CAMERA`."""
    noise = np.random.default_rng(seed)
    images = pictures(CAMERA, board, board_poses(CAMERA, board, count, seed))
    return [
        np.asarray(np.clip(image + noise.normal(0, 2, image.shape), 0, 255), np.uint8)
        for image in images
    ]


def pictures(camera: Camera, board: Board, poses: Sequence[Pose]) -> list[GrayImage]:
    """The board as the camera sees it, four samples a pixel, before a grey wall."""
    texture, m_per_px, origin_m = _print(board)
    width, height = camera.image_size
    rays = _rays(camera)
    texture_of_board = np.array(
        [[1, 0, -origin_m[0]], [0, 1, -origin_m[1]], [0, 0, m_per_px]], dtype=np.float64
    )
    images = []
    for pose in poses:
        # The board's plane is seen under a homography of the rays (x, y, 1).
        rays_of_board = np.column_stack([pose.rotation[:, :2], pose.translation])
        texture_of_rays = texture_of_board @ np.linalg.inv(rays_of_board)
        at = cv2.perspectiveTransform(rays, texture_of_rays)[0] - 0.5
        fine = cv2.remap(
            texture,
            at[:, 0].reshape(2 * height, 2 * width),
            at[:, 1].reshape(2 * height, 2 * width),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=(120,),
        )
        images.append(
            np.asarray(cv2.resize(fine, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
        )
    return images


@lru_cache
def _rays(camera: Camera) -> npt.NDArray[np.float32]:
    """(1, N, 2) of four samples in each pixel, row by row."""
    v, u = np.mgrid[0 : 2 * camera.height_px, 0 : 2 * camera.width_px]
    rays = camera.undistort(np.column_stack([u.ravel(), v.ravel()]) / 2 - 0.25)
    return np.nan_to_num(rays).astype(np.float32)[None]


def _print(board: Board, square_px: int = 64) -> tuple[GrayImage, float, Array]:
    """The board's print, metres a pixel, and where its outer corner is in the board's frame."""
    if isinstance(board, Charuco):
        squares = board.cols, board.rows
        image = board.opencv.generateImage((squares[0] * square_px, squares[1] * square_px))
        first_m = 0.0
    else:
        assert isinstance(board, Chessboard)
        squares = board.cols + 1, board.rows + 1
        y, x = np.indices((squares[1] * square_px, squares[0] * square_px)) // square_px
        image = np.asarray(np.where((x + y) % 2 == 0, 0, 255), np.uint8)
        first_m = -board.square_m
    margin = _MARGIN * square_px
    framed = cv2.copyMakeBorder(
        np.asarray(image, np.uint8), margin, margin, margin, margin, cv2.BORDER_CONSTANT, value=255
    )
    # Soft like ink, so that the samples see no stairs; and not pure black on pure white.
    soft = cv2.convertScaleAbs(cv2.GaussianBlur(framed, (0, 0), 1.5), alpha=0.75, beta=25)
    first_m -= _MARGIN * board.square_m
    return np.asarray(soft, np.uint8), board.square_m / square_px, np.array([first_m, first_m])
