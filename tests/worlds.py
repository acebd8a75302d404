"""Small worlds with exact answers: cameras, maps, and the corners that a pose would give."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from pipeline.camera import Camera, DistortionModel
from pipeline.detection import Detections, GrayImage
from pipeline.geometry import Array, Pose, rotation_z
from pipeline.markers import Marker, MarkerMap, load_dictionary
from recorder.files.camera_file import camera_yaml
from recorder.files.map_file import map_yaml
from recorder.log.writer import LogWriter
from recorder.sources.base import CapturedFrame

COEFFICIENTS: dict[DistortionModel, tuple[float, ...]] = {
    "plumb_bob": (-0.28, 0.09, 0.0008, -0.0011, -0.01),
    "rational_polynomial": (0.4, -0.2, 0.0007, -0.0009, 0.05, 0.7, -0.15, 0.02),
    "equidistant": (-0.01, 0.004, -0.002, 0.0005),
}


def camera(model: DistortionModel = "plumb_bob", *, ideal: bool = False) -> Camera:
    """A 1280x720 camera with a wide lens."""
    coefficients = np.zeros(len(COEFFICIENTS[model])) if ideal else COEFFICIENTS[model]
    matrix = [[900.0, 0.0, 632.5], [0.0, 905.0, 365.2], [0.0, 0.0, 1.0]]
    return Camera(1280, 720, np.array(matrix), model, np.array(coefficients))


def ceiling(rows: int = 3, cols: int = 4, height_m: float = 2.5, pitch_m: float = 0.5) -> MarkerMap:
    """A grid of 15 cm markers that face down, each turned differently."""
    markers = []
    for i in range(rows * cols):
        row, col = divmod(i, cols)
        xyz = ((col - (cols - 1) / 2) * pitch_m, (row - (rows - 1) / 2) * pitch_m, height_m)
        markers.append(Marker.from_yaw(i, xyz, 0.4 * i, "down", 0.15))
    return MarkerMap("map", "DICT_6X6_1000", tuple(markers))


def looking_up(x_m: float = 0.0, y_m: float = 0.0, z_m: float = 0.3, yaw_rad: float = 0.0) -> Pose:
    """T_map_camera of a level camera that looks up; its x axis has heading `yaw_rad`."""
    return Pose(rotation_z(yaw_rad), np.array([x_m, y_m, z_m]))


def corners(T_map_camera: Pose, camera: Camera, marker_map: MarkerMap) -> Detections:
    """What a perfect detector gives: every marker wholly in the image, facing the camera."""
    T_camera_map = T_map_camera.inverse()
    ids, pixels = [], []
    for marker in marker_map.markers:
        if marker.normal @ (T_map_camera.translation - marker.centre_m) <= 0:
            continue
        projected = camera.project(T_camera_map.apply(marker.corners_m))
        inside = (projected >= 0).all() and (projected < camera.image_size).all()
        if inside:
            ids.append(marker.id)
            pixels.append(projected)
    return Detections(np.array(ids, dtype=np.int64), np.array(pixels).reshape(-1, 4, 2))


def with_noise(detections: Detections, sigma_px: float, seed: int) -> Detections:
    """The same with Gaussian corner noise."""
    noise: Array = np.random.default_rng(seed).normal(0, sigma_px, detections.corners_px.shape)
    return Detections(detections.ids, detections.corners_px + noise)


def draw(T_map_camera: Pose, camera: Camera, marker_map: MarkerMap) -> GrayImage:
    """A picture of the markers through an ideal lens, good to about a tenth of a pixel."""
    seen = corners(T_map_camera, camera, marker_map)
    size = camera.image_size
    image = np.full(size[::-1], 220, np.uint8)
    side = 200
    # Pixel centres are integers: the print's outline is half a pixel outside its outer pixels.
    outline = (np.array([[0, 0], [side, 0], [side, side], [0, side]]) - 0.5).astype(np.float32)
    dictionary = load_dictionary(marker_map.dictionary)
    for marker_id, quad in zip(seen.ids, seen.corners_px, strict=True):
        print_ = cv2.aruco.generateImageMarker(dictionary, int(marker_id), side)
        warp = cv2.getPerspectiveTransform(outline, quad.astype(np.float32))
        mask = cv2.warpPerspective(np.full((side, side), 255, np.uint8), warp, size)
        image[mask > 127] = cv2.warpPerspective(print_, warp, size)[mask > 127]
    return image


def drive(n_frames: int) -> list[Pose]:
    """A slightly tilted camera on its way along x, 2 cm a frame."""
    tilt = Pose.from_rvec_tvec((0.03, -0.05, 0.0), (0, 0, 0))
    return [looking_up(-0.3 + 0.02 * i, 0.1, 0.3, 0.3) @ tilt for i in range(n_frames)]


START_NS = 1_700_000_000_000_000_000
FRAME_NS = 100_000_000

TRUTH_YAML = b"""\
frame: map
method: drawn
path: {points_m: [[-0.3, 0.1], [0.3, 0.1]], closed: false, std_m: 0.05}
poses:
  - {from_s: 0, to_s: 0.05, x_m: -0.3, y_m: 0.1, z_m: 0.3, yaw_deg: 17.0, std_m: 0.005}
"""


def small_log(
    path: Path,
    n_frames: int = 12,
    *,
    exact: bool = True,
    moving: bool = True,
    damaged: tuple[int, ...] = (),
    attachments: tuple[str, ...] = ("camera.yaml", "map.yaml", "truth.yaml"),
) -> Path:
    """Records a drive through drawn images at 10 frames/s; frames in `damaged` are no JPEGs."""
    lens, marker_map = camera(ideal=True), ceiling()
    files = {
        "camera.yaml": camera_yaml(lens),
        "map.yaml": map_yaml(marker_map),
        "truth.yaml": TRUTH_YAML,
    }
    given = {name: files[name] for name in attachments}
    with LogWriter(path, attachments=given, session={"source": "test"}) as writer:
        for i, pose in enumerate(drive(n_frames)):
            pose = pose if moving else drive(1)[0]
            stamp = START_NS + i * FRAME_NS
            data = cv2.imencode(".jpg", draw(pose, lens, marker_map))[1].tobytes()
            if i in damaged:
                # The header stays, so that the recorder takes it; nothing behind it does.
                data = data[:700]
            writer.write_frame(
                CapturedFrame(i, stamp, stamp, data, "jpeg", pose if exact else None)
            )
    return path
