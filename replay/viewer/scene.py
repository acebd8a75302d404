"""What every result of a log shares: markers, camera, image, truth and events."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
import numpy.typing as npt
import rerun as rr

from pipeline.camera import Camera
from pipeline.geometry import Array
from pipeline.markers import MarkerMap, load_dictionary
from recorder.files.truth_file import Truth, TruthPath
from replay.viewer import style

# Pixels of a marker's picture per bit; the viewer interpolates between them.
_PIXELS_PER_BIT = 8
# More numbers than this hide each other; they show when the pointer is over a marker.
_MAX_LABELS = 150

_MEDIA_TYPES = {"jpeg": "image/jpeg", "jpg": "image/jpeg", "png": "image/png", "webp": "image/webp"}
_LEVELS = {"WARNING": "WARN", "FATAL": "CRITICAL", "UNKNOWN": "INFO"}


def set_time(stream: rr.RecordingStream, time_ns: int, frame_index: int | None = None) -> None:
    """Moves the stream to a time since the log's first image, and to a frame where there is one."""
    stream.set_time(style.TIME, duration=np.timedelta64(time_ns, "ns"))
    if frame_index is None:
        stream.disable_timeline(style.FRAME)
    else:
        stream.set_time(style.FRAME, sequence=frame_index)


def log_map(stream: rr.RecordingStream, marker_map: MarkerMap) -> None:
    """The markers as they look when printed, and their ids."""
    stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    texture, texcoords = _atlas(marker_map)
    corners_m = np.concatenate([m.corners_m for m in marker_map.markers])
    first = 4 * np.arange(len(marker_map.markers))[:, None]
    triangles = (first[:, :, None] + np.array([[0, 3, 2], [0, 2, 1]])).reshape(-1, 3)
    stream.log(
        style.MARKERS,
        rr.Mesh3D(
            vertex_positions=corners_m,
            triangle_indices=triangles,
            vertex_texcoords=texcoords,
            albedo_texture=texture,
        ),
        static=True,
    )
    stream.log(
        style.MARKER_IDS,
        rr.Points3D(
            [m.centre_m for m in marker_map.markers],
            labels=[str(m.id) for m in marker_map.markers],
            show_labels=len(marker_map.markers) <= _MAX_LABELS,
            colors=style.LABEL_COLOUR,
            radii=-1.0,
        ),
        static=True,
    )


def _atlas(marker_map: MarkerMap) -> tuple[npt.NDArray[np.uint8], Array]:
    """One picture of all markers (H, W, 3), and their corners (4 N, 2) in it from 0 to 1."""
    dictionary = load_dictionary(marker_map.dictionary)
    side = (dictionary.markerSize + 2) * _PIXELS_PER_BIT
    columns = int(np.ceil(np.sqrt(len(marker_map.markers))))
    rows = -(-len(marker_map.markers) // columns)
    atlas = np.zeros((rows * side, columns * side), np.uint8)
    origins = np.empty((len(marker_map.markers), 1, 2))
    for i, marker in enumerate(marker_map.markers):
        row, column = divmod(i, columns)
        picture = cv2.aruco.generateImageMarker(dictionary, marker.id, side)
        picture = 255 - picture if marker_map.inverted else picture
        atlas[row * side : (row + 1) * side, column * side : (column + 1) * side] = picture
        origins[i] = (column * side, row * side)
    # Half a pixel inside, so that no neighbour bleeds in.
    square = np.array([[0.5, 0.5], [side - 0.5, 0.5], [side - 0.5, side - 0.5], [0.5, side - 0.5]])
    texcoords = (origins + square).reshape(-1, 2) / (columns * side, rows * side)
    return np.repeat(atlas[:, :, None], 3, axis=2), texcoords


def pinhole(camera: Camera, image_plane_distance_m: float, colour: style.Colour) -> rr.Pinhole:
    """The camera without its lens distortion, which Rerun does not know."""
    matrix = camera.camera_matrix.copy()
    matrix[:2, 2] = style.to_rerun_pixels(matrix[:2, 2])
    return rr.Pinhole(
        image_from_camera=matrix,
        resolution=camera.image_size,
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=image_plane_distance_m,
        color=colour,
        line_width=-0.75,
    )


def log_image(stream: rr.RecordingStream, data: bytes, image_format: str) -> None:
    """The bytes as the camera gave them."""
    media_type = _MEDIA_TYPES.get(image_format.lower())
    stream.log(style.IMAGE, rr.EncodedImage(contents=data, media_type=media_type))


def clear_image(stream: rr.RecordingStream) -> None:
    """Shows no image until the next."""
    # The viewer goes on showing the last image after a Clear.
    stream.log(style.IMAGE, rr.EncodedImage.cleared())


def log_event(stream: rr.RecordingStream, entity: str, message: str, level: str) -> None:
    level = level.upper()
    stream.log(entity, rr.TextLog(message, level=_LEVELS.get(level, level)))


def log_truth(stream: rr.RecordingStream, truth: Truth, height_m: float) -> None:
    """The hand-measured truth; what has no height of its own is drawn at `height_m`."""
    if truth.path is not None:
        _log_path(stream, truth.path, height_m)
    if truth.poses:
        xyz_m = [(p.x_m, p.y_m, height_m if p.z_m is None else p.z_m) for p in truth.poses]
        stream.log(
            f"{style.TRUTH}/poses",
            rr.Points3D(xyz_m, colors=style.PATH_COLOUR, radii=-5.0),
            static=True,
        )
    if truth.trajectory is not None:
        points_m = truth.trajectory.positions_m.copy()
        points_m[:, 2] = np.where(np.isnan(points_m[:, 2]), height_m, points_m[:, 2])
        log_line(stream, f"{style.TRUTH}/trajectory", points_m, style.TRUTH_COLOUR)


def log_line(
    stream: rr.RecordingStream,
    entity: str,
    points_m: Array,
    colour: style.Colour,
    width_px: float = 1.5,
) -> None:
    """A polyline (N, 3) that is there at all times."""
    strips = [points_m] if len(points_m) > 1 else []
    stream.log(entity, rr.LineStrips3D(strips, colors=colour, radii=-width_px / 2), static=True)


def _log_path(stream: rr.RecordingStream, path: TruthPath, height_m: float) -> None:
    points = np.vstack([path.points_m, path.points_m[:1]]) if path.closed else path.points_m
    height = np.full((len(points), 1), height_m)
    line = np.hstack([points, height])
    log_line(stream, f"{style.TRUTH}/path", line, style.PATH_COLOUR)
    left, right = band(path)
    if not len(left):
        return
    height = np.full((len(left), 1), height_m)
    first = 2 * np.arange(len(left) - 1)[:, None, None]
    triangles = first + np.array([[0, 1, 2], [2, 1, 3]])
    stream.log(
        f"{style.TRUTH}/band",
        rr.Mesh3D(
            vertex_positions=np.hstack([left, height, right, height]).reshape(-1, 3),
            triangle_indices=triangles.reshape(-1, 3),
            albedo_factor=(*style.PATH_COLOUR, 60),
        ),
        static=True,
    )


def band(path: TruthPath) -> tuple[Array, Array]:
    """The left and right edge (N, 2) of a path's ±std band, mitred at its corners."""
    points = [path.points_m[0]]
    points += [b for a, b in pairwise(path.points_m) if np.hypot(*(b - a)) > 1e-9]
    closed = path.closed and len(points) > 2
    if closed and np.hypot(*(points[-1] - points[0])) <= 1e-9:
        points.pop()
    if len(points) < 2:
        return np.empty((0, 2)), np.empty((0, 2))
    corners = np.array(points)
    ahead = np.roll(corners, -1, axis=0) - corners
    if not closed:
        ahead[-1] = ahead[-2]
    normals = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    before = np.roll(normals, 1, axis=0)
    if not closed:
        before[0] = normals[0]
    # A turn back would put the mitre at infinity.
    stretch = np.maximum(1.0 + np.sum(normals * before, axis=1, keepdims=True), 0.25)
    mitre = path.std_m * (normals + before) / stretch
    left, right = corners + mitre, corners - mitre
    if closed:
        left, right = np.vstack([left, left[:1]]), np.vstack([right, right[:1]])
    return left, right
