"""Projection against the distortion formulas written out, and its inverse."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.camera import Camera, DistortionModel
from pipeline.geometry import Array
from tests import worlds

MODELS: tuple[DistortionModel, ...] = ("plumb_bob", "rational_polynomial", "equidistant")


def written_out(camera: Camera, point: Array) -> Array:
    """OpenCV's documented formulas, for one point."""
    x, y = point[0] / point[2], point[1] / point[2]
    d = camera.dist_coeffs
    r2 = x * x + y * y
    if camera.distortion_model == "equidistant":
        r = np.sqrt(r2)
        theta = np.arctan(r)
        bent = theta * (1 + d[0] * theta**2 + d[1] * theta**4 + d[2] * theta**6 + d[3] * theta**8)
        u, v = (x * bent / r, y * bent / r) if r > 0 else (x, y)
    else:
        k1, k2, p1, p2, k3 = d[:5]
        k4, k5, k6 = d[5:8] if len(d) >= 8 else (0.0, 0.0, 0.0)
        radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
        u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.array((camera.camera_matrix @ (u, v, 1.0))[:2])


@pytest.mark.parametrize("model", MODELS)
def test_projection_is_the_written_out_formula(model: DistortionModel) -> None:
    camera = worlds.camera(model)
    points = np.random.default_rng(1).uniform((-1, -0.6, 1.5), (1, 0.6, 4), (50, 3))
    expected = [written_out(camera, point) for point in points]
    np.testing.assert_allclose(camera.project(points), expected, atol=1e-9)


@pytest.mark.parametrize("model", MODELS)
def test_undistort_inverts_projection_over_the_whole_image(model: DistortionModel) -> None:
    camera = worlds.camera(model)
    u, v = np.meshgrid(np.linspace(0, 1279, 40), np.linspace(0, 719, 30))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    rays = np.column_stack([camera.undistort(pixels), np.ones(len(pixels))])
    np.testing.assert_allclose(camera.project(rays), pixels, atol=1e-5)


def test_points_behind_the_camera_have_no_pixel() -> None:
    pixels = worlds.camera().project([[0, 0, -1], [0, 0, 0], [0, 0, 1]])
    assert np.isnan(pixels[:2]).all()
    assert np.isfinite(pixels[2]).all()


def test_no_points_are_no_pixels() -> None:
    camera = worlds.camera()
    assert camera.project(np.empty((0, 3))).shape == (0, 2)
    assert camera.undistort(np.empty((0, 2))).shape == (0, 2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"distortion_model": "fisheye62"}, "fisheye62"),
        ({"dist_coeffs": np.zeros(3)}, "4 or 5 coefficients"),
        ({"camera_matrix": np.eye(2)}, "shape"),
        ({"camera_matrix": np.diag([-1.0, 1.0, 1.0])}, "positive fx"),
        ({"width_px": 0}, "image size"),
        ({"dist_coeffs": np.full(5, np.nan)}, "finite"),
    ],
)
def test_a_calibration_that_cannot_be_is_refused(change: dict[str, object], message: str) -> None:
    good = {
        "width_px": 640,
        "height_px": 480,
        "camera_matrix": np.diag([500.0, 500.0, 1.0]),
        "distortion_model": "plumb_bob",
        "dist_coeffs": np.zeros(5),
    }
    with pytest.raises(ValueError, match=message):
        Camera(**{**good, **change})  # type: ignore[arg-type]


def test_a_fisheye_pixel_beyond_90_degrees_has_no_ray() -> None:
    matrix = np.array([[300.0, 0, 639.5], [0, 300.0, 359.5], [0, 0, 1]])
    camera = Camera(1280, 720, matrix, "equidistant", np.zeros(4))
    # An ideal fisheye: the distance from the centre is f times the angle.
    degrees = np.array([0.0, 45.0, 80.0, 95.0, 120.0])
    pixels = np.column_stack([639.5 + 300.0 * np.radians(degrees), np.full(5, 359.5)])
    rays = camera.undistort(pixels)
    np.testing.assert_allclose(rays[:3, 0], np.tan(np.radians(degrees[:3])), rtol=1e-6, atol=1e-9)
    assert np.isnan(rays[3:]).all()
