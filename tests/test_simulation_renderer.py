"""The renderer against an independent measurement of its images."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from pipeline.camera import Camera, DistortionModel
from pipeline.geometry import Array, Pose, rotation_z
from pipeline.markers import Marker, MarkerMap, marker_rotation
from recorder.simulation.optics import ImageSettings, Lamp, Surface
from recorder.simulation.quads import INK, PAPER, marker_quads, rectangle
from recorder.simulation.renderer import Renderer
from recorder.simulation.trajectory import camera_rotation

DARK, BRIGHT = 255 * INK, 255 * PAPER
SIZE_M = 0.16

LENSES: dict[str, tuple[DistortionModel, float, list[float]]] = {
    "plumb_bob": ("plumb_bob", 520.0, [-0.25, 0.08, 0.001, -0.0015, 0.01]),
    "rational_polynomial": (
        "rational_polynomial",
        500.0,
        [0.35, 0.02, 0.0006, -0.0008, 0.001, 0.5, 0.05, 0.002],
    ),
    "equidistant": ("equidistant", 430.0, [0.03, -0.01, 0.002, 0.0]),
    "none": ("plumb_bob", 520.0, [0.0] * 5),
}


def lens(name: str, width_px: int = 640, height_px: int = 480) -> Camera:
    model, f_px, coefficients = LENSES[name]
    matrix = [[f_px, 0, width_px / 2 + 1.3], [0, 1.01 * f_px, height_px / 2 - 0.7], [0, 0, 1]]
    return Camera(width_px, height_px, np.array(matrix), model, np.array(coefficients))


def pinhole(
    f_px: float = 500.0, centre: tuple[float, float] = (319.5, 239.5), height_px: int = 480
) -> Camera:
    matrix = np.array([[f_px, 0, centre[0]], [0, f_px, centre[1]], [0, 0, 1]])
    return Camera(640, height_px, matrix, "plumb_bob", np.zeros(5))


def ceiling(yaws_deg: Sequence[float], spacing_m: float = 0.32, columns: int = 3) -> MarkerMap:
    rows = len(yaws_deg) // columns
    markers = [
        Marker.from_yaw(
            i,
            (
                spacing_m * (i % columns - (columns - 1) / 2),
                spacing_m * (i // columns - (rows - 1) / 2),
                1.0,
            ),
            np.radians(yaw_deg),
            "down",
            SIZE_M,
        )
        for i, yaw_deg in enumerate(yaws_deg)
    ]
    return MarkerMap("map", "DICT_6X6_1000", tuple(markers))


def looking_up(
    xyz_m: tuple[float, float, float] = (0, 0, 0), yaw: float = 0, roll: float = 0, pitch: float = 0
) -> Pose:
    yaw, roll, pitch = np.radians([yaw, roll, pitch])
    return Pose(camera_rotation("up", yaw, roll, pitch), np.array(xyz_m))


def edge_errors_px(
    image: npt.NDArray[np.float32],
    camera: Camera,
    T_map_camera: Pose,
    marker: Marker,
    dark_grey: float = DARK,
    bright_grey: float = BRIGHT,
) -> Iterator[float]:
    """Mean distance of each side of the black square in the image from its projection.

    Across a step, the sum of the pixels of a column (or row) is the place of the edge there: every
    pixel is the mean over its square. No ray, homography or polygon is involved.
    """
    corners = T_map_camera.inverse().apply(marker.corners_m)
    share = np.linspace(0.15, 0.85, 201)[:, None]
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge = camera.project(a + share * (b - a))
        centre = camera.project(corners).mean(axis=0)
        if not np.isfinite(edge).all() or (edge < 8).any():
            continue
        if (edge > np.array(camera.image_size) - 9).any():
            continue
        along, across = (0, 1) if np.ptp(edge[:, 0]) > np.ptp(edge[:, 1]) else (1, 0)
        edge = edge[np.argsort(edge[:, along])]
        grid = image if along == 0 else image.T
        dark_above = centre[across] < edge[:, across].mean()
        slope = np.ptp(edge[:, across]) / np.ptp(edge[:, along])
        errors = []
        for at in range(int(np.ceil(edge[0, along])), int(edge[-1, along]) + 1):
            expected = np.interp(at, edge[:, along], edge[:, across])
            first = round(expected) - 4
            profile = grid[first : first + 9, at].astype(np.float64)
            dark = float(((bright_grey - profile) / (bright_grey - dark_grey)).sum())
            found = first - 0.5 + (dark if dark_above else 9 - dark)
            errors.append(found - expected)
        yield float(np.mean(errors)) / np.hypot(1.0, slope)


def all_edge_errors(camera: Camera, marker_map: MarkerMap, T_map_camera: Pose) -> Array:
    image = Renderer(camera, marker_quads(marker_map)).render(T_map_camera)
    return np.array(
        [e for m in marker_map.markers for e in edge_errors_px(image, camera, T_map_camera, m)]
    )


@pytest.mark.parametrize("name", LENSES)
@pytest.mark.parametrize(
    "pose",
    [
        looking_up(),
        looking_up(yaw=33),
        looking_up((0.05, -0.03, 0.1), yaw=-100, roll=18, pitch=-14),
        looking_up((-0.1, 0.1, -0.1), yaw=4, roll=-25, pitch=20),
    ],
    ids=["straight", "turned", "tilted", "steep"],
)
def test_edges_are_where_they_project_to(name: str, pose: Pose) -> None:
    errors = all_edge_errors(lens(name), ceiling([0, 10, 45, 90, 22.5, 180, 63, 1, 30]), pose)
    assert len(errors) >= 10
    print(f"{name}: worst edge {np.abs(errors).max():.5f} px of {len(errors)}")
    assert np.abs(errors).max() < 0.005, f"worst edge {np.abs(errors).max():.4f} px"


@pytest.mark.parametrize("offset_px", [0.0, 0.13, 0.25, 0.37, 0.5, 0.61, 0.75, 0.99])
def test_edges_along_pixel_rows_are_exact_at_any_offset(offset_px: float) -> None:
    camera = pinhole()
    pose = looking_up((offset_px / 500.0, 1.7 * offset_px / 500.0, 0))
    errors = all_edge_errors(camera, ceiling([0, 90, 180, 270, 0, 90]), pose)
    assert len(errors) == 24
    assert np.abs(errors).max() < 0.001


def test_eight_bits_keep_edges_within_a_hundredth_of_a_pixel() -> None:
    camera = lens("plumb_bob")
    marker_map = ceiling([0, 10, 45, 90, 22.5, 180])
    pose = looking_up((0.013, 0.007, 0), yaw=1.0)
    image = Renderer(camera, marker_quads(marker_map)).capture(pose).astype(np.float32)
    greys = round(DARK), round(BRIGHT)
    errors = [e for m in marker_map.markers for e in edge_errors_px(image, camera, pose, m, *greys)]
    assert np.abs(errors).max() < 0.01


def test_pixel_centres_are_at_integers() -> None:
    # 80 px wide, edges at 279.5 and 359.5: between pixels, so that no pixel is mixed.
    image = Renderer(pinhole(), marker_quads(ceiling([0], columns=1))).render(looking_up())
    np.testing.assert_allclose(image[200:280, 279], BRIGHT, rtol=1e-4)
    np.testing.assert_allclose(image[200:280, 280], DARK, rtol=1e-4)
    np.testing.assert_allclose(image[200:280, 359], DARK, rtol=1e-4)
    np.testing.assert_allclose(image[200:280, 360], BRIGHT, rtol=1e-4)
    square = image[200:280, 280:360]
    assert np.minimum(np.abs(square - DARK), np.abs(square - BRIGHT)).max() < 0.1


@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize("looking", ["up", "down"])
def test_marker_is_drawn_as_opencv_draws_it(looking: str, inverted: bool) -> None:
    facing = "down" if looking == "up" else "up"
    marker = Marker.from_yaw(17, (0, 0, 0), 0.0, facing, SIZE_M)  # type: ignore[arg-type]
    marker_map = MarkerMap("map", "DICT_6X6_1000", (marker,), inverted)
    z_m = -1.0 if looking == "up" else 1.0
    rotation = camera_rotation(looking, 0.0)  # type: ignore[arg-type]
    image = Renderer(pinhole(), marker_quads(marker_map)).capture(
        Pose(rotation, np.array([0, 0, z_m]))
    )
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_6X6_1000)
    drawn = cv2.aruco.generateImageMarker(dictionary, 17, 80)
    expected = np.where((drawn > 0) != inverted, round(BRIGHT), round(DARK))
    # The corners say which way round it is: top left first, as the camera sees them.
    corners = pinhole().project(
        Pose(rotation, np.array([0, 0, z_m])).inverse().apply(marker.corners_m)
    )
    turned = np.rot90(expected, _quarter_turns(corners))
    assert np.abs(image[200:280, 280:360].astype(int) - turned).max() <= 1


def _quarter_turns(corners_px: Array) -> int:
    right = corners_px[1] - corners_px[0]
    return round(float(np.degrees(np.arctan2(-right[1], right[0]))) / 90) % 4


def test_motion_blur_is_as_long_as_the_way_during_the_exposure() -> None:
    camera = pinhole()
    exposure_s, speed_mps = 0.02, 0.6
    blur_px = speed_mps * exposure_s * 500.0  # 1 m away
    quads = marker_quads(ceiling([0], columns=1))
    renderer = Renderer(camera, quads, image=ImageSettings(exposure_s=exposure_s))
    sharp = renderer.render(looking_up())
    still = renderer.render(lambda _: looking_up())
    np.testing.assert_array_equal(sharp, still)
    moving = renderer.render(lambda dt_s: looking_up((speed_mps * dt_s, 0, 0)))
    # The left edge, at 279.5: its spread as a distribution over the columns.
    profile = moving[240, 273:287].astype(np.float64)
    step = -np.diff(profile) / (BRIGHT - DARK)
    at = np.arange(273, 286) + 0.5
    assert step.sum() == pytest.approx(1.0, abs=1e-3)
    mean = (step * at).sum()
    assert mean == pytest.approx(279.5, abs=0.01)
    # Even over the way, seen by pixels of width 1 (twice 1/12).
    assert (step * (at - mean) ** 2).sum() == pytest.approx(blur_px**2 / 12 + 1 / 6, rel=0.01)
    assert profile[279 - 273 - round(blur_px / 2) - 1] == pytest.approx(BRIGHT, abs=0.5)
    assert profile[280 - 273 + round(blur_px / 2) + 1] == pytest.approx(DARK, abs=0.5)
    # Along the motion nothing is blurred.
    np.testing.assert_allclose(moving[199, 300:340], BRIGHT, rtol=1e-4)
    np.testing.assert_allclose(moving[200, 300:340], DARK, rtol=1e-4)


def test_a_marker_is_invisible_from_behind() -> None:
    quads = marker_quads(ceiling([0, 20, 40]))
    above = Pose(marker_rotation(0.0, "down"), np.array([0, 0, 2.0]))
    image = Renderer(pinhole(), quads).render(above)
    assert np.ptp(image) == 0.0


def test_folding_distortion_shows_nothing_twice() -> None:
    # Projected forwards, this lens folds points far outside its view back into the image.
    matrix = np.array([[600.0, 0, 319.5], [0, 600.0, 239.5], [0, 0, 1]])
    camera = Camera(640, 480, matrix, "plumb_bob", np.array([-0.4, 0.0, 0.0, 0.0, 0.0]))
    marker = Marker.from_yaw(0, (1.45, 0, 1.0), 0.0, "down", SIZE_M)
    folded = camera.project(looking_up().inverse().apply(marker.corners_m))
    assert (np.abs(folded - (319.5, 239.5)) < (320, 240)).all()
    marker_map = MarkerMap("map", "DICT_6X6_1000", (marker,))
    image = Renderer(camera, marker_quads(marker_map)).render(looking_up())
    # Nothing but the surface, and black corners where there is no ray.
    np.testing.assert_allclose(image[image > 0], 127.5, rtol=1e-5)
    assert (image > 0).mean() > 0.9


def test_outside_the_image_circle_it_is_black() -> None:
    matrix = np.array([[300.0, 0, 319.5], [0, 300.0, 239.5], [0, 0, 1]])
    camera = Camera(640, 480, matrix, "plumb_bob", np.array([-0.4, 0.0, 0.0, 0.0, 0.0]))
    for surface in (Surface(height_m=1.0), Surface(height_m=1.0, texture="plaster")):
        image = Renderer(camera, (), surface).render(looking_up())
        assert image[0, 0] == image[-1, -1] == 0.0
        assert image[240, 320] > 100
        assert np.isfinite(image).all()


def test_a_wall_partly_behind_the_camera_is_seen_in_front_of_it() -> None:
    # A wall to the right, from 5 m behind the camera to 5 m in front of it.
    rotation = np.array([[0.0, 0, -1], [1, 0, 0], [0, -1, 0]])
    wall = rectangle(Pose(rotation, np.array([1.0, 0, 0])), 20.0, 10.0, 0.9)
    image = Renderer(pinhole(height_px=240), (wall,)).render(looking_up())
    edge_px = 319.5 + 500.0 / 5.0
    covered = image[120] > 0.7 * 255
    assert not covered[: int(edge_px) - 1].any()
    assert covered[int(edge_px) + 2 :].all()
    moved = Renderer(pinhole(height_px=240), (wall,), image=ImageSettings(exposure_s=0.01)).render(
        lambda dt_s: looking_up((dt_s, 0, dt_s))
    )
    assert np.isfinite(moved).all()


def test_nearer_things_hide_farther_ones_whatever_their_order() -> None:
    near = rectangle(Pose(np.eye(3), np.array([0.05, 0, 0.5])), 0.1, 0.1, 0.3)
    far = rectangle(Pose(np.eye(3), np.array([0.0, 0, 1.0])), 0.4, 0.4, 0.9)
    images = [Renderer(pinhole(), q).render(looking_up()) for q in ((near, far), (far, near))]
    np.testing.assert_array_equal(images[0], images[1])
    assert images[0][240, 370] == pytest.approx(0.3 * 255, rel=1e-4)
    assert images[0][240, 300] == pytest.approx(0.9 * 255, rel=1e-4)


def correlation(a: Array, b: Array) -> float:
    return float(((a - a.mean()) * (b - b.mean())).mean() / (a.std() * b.std()))


def test_noise_has_its_size_and_differs_between_frames_and_seeds() -> None:
    image = ImageSettings(noise_std=3.0)
    renderer = Renderer(pinhole(), (), image=image, seed=5)
    first, second = (renderer.capture(looking_up(), i).astype(float) for i in (0, 1))
    clean = 0.5 * 255
    # Rounding adds 1/12.
    assert (first - clean).std() == pytest.approx(np.sqrt(9 + 1 / 12), rel=0.01)
    assert (first - clean).mean() == pytest.approx(0.0, abs=0.03)
    residuals = [a.ravel() - clean for a in (first, second)]
    assert abs(correlation(*residuals)) < 0.01
    for shift in (1, 2, 3, 4, 640):
        assert abs(correlation(residuals[0][shift:], residuals[0][:-shift])) < 0.01
    again = Renderer(pinhole(), (), image=image, seed=5).capture(looking_up(), 0)
    np.testing.assert_array_equal(first, again)
    other = Renderer(pinhole(), (), image=image, seed=6).capture(looking_up(), 0)
    assert (first != other).mean() > 0.5


def test_light_falls_off_and_lamps_glare() -> None:
    image = ImageSettings(vignetting=1.0, brightness=0.5)
    plain = Renderer(pinhole(), (), Surface(height_m=1.0), image=image).render(looking_up())
    assert plain[239, 319] == pytest.approx(0.5 * 0.5 * 255, rel=1e-3)
    ray = np.array([0 - 319.5, 0 - 239.5]) / 500.0
    assert plain[0, 0] == pytest.approx(plain[239, 319] / (1 + ray @ ray) ** 2, rel=0.01)
    lamp = Lamp(xy_m=[0.1, 0.0], radius_m=0.05, intensity=2.0, halo_m=0.3, halo=0.2)
    lit = Renderer(pinhole(), (), Surface(height_m=1.0), (lamp,), image).render(looking_up())
    assert lit[240, 370] > 255
    added = lit - plain
    assert added[240, 410] > added[240, 440] > 0
    np.testing.assert_allclose(added[:, :200], 0.0, atol=1e-3)


def test_texture_stays_on_the_surface_when_the_camera_moves() -> None:
    surface = Surface(height_m=1.0, texture="plaster", contrast=0.2)
    renderer = Renderer(pinhole(), (), surface)
    at_rest = renderer.render(looking_up())
    moved = renderer.render(looking_up((20 / 500.0, 0, 0)))
    np.testing.assert_allclose(moved[:, :-20], at_rest[:, 20:], atol=0.05)
    assert at_rest.std() > 5


def test_blur_keeps_the_mean_and_softens_edges() -> None:
    quads = marker_quads(ceiling([0], columns=1))
    sharp = Renderer(pinhole(), quads).render(looking_up())
    soft = Renderer(pinhole(), quads, image=ImageSettings(blur_px=1.0)).render(looking_up())
    assert soft.mean() == pytest.approx(float(sharp.mean()), rel=1e-4)
    step = -np.diff(soft[240, 274:286].astype(float)) / (BRIGHT - DARK)
    at = np.arange(274, 285) + 0.5
    assert (step * (at - 279.5) ** 2).sum() == pytest.approx(1.0, rel=0.05)


@pytest.mark.bench
def test_speed_at_1080p_with_24_markers() -> None:
    matrix = np.array([[1360.2, 0, 959.5], [0, 1360.2, 539.5], [0, 0, 1]])
    camera = Camera(1920, 1080, matrix, "plumb_bob", np.array([-0.05, 0.01, 0, 0, 0]))
    marker_map = ceiling([15 * i for i in range(24)], spacing_m=0.22, columns=6)
    renderer = Renderer(
        camera,
        marker_quads(marker_map),
        Surface(height_m=1.0, texture="plaster"),
        image=ImageSettings(noise_std=2.0, blur_px=0.6, vignetting=0.4, uneven_light=0.2),
    )
    pose = Pose(rotation_z(0.1), np.array([0, 0, -0.4]))
    renderer.capture(pose)
    times = []
    for i in range(5):
        begin = time.perf_counter()
        cv2.imencode(".jpg", renderer.capture(pose, i), [cv2.IMWRITE_JPEG_QUALITY, 90])
        times.append(time.perf_counter() - begin)
    print(f"\none thread, 1080p, 24 markers: {1 / np.median(times):.1f} frames/s")
    assert np.median(times) < 1.0
