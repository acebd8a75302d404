"""Results of a camera that stands still, made without images: detections go in as they are."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from pipeline.camera import Camera
from pipeline.detection import Detections
from pipeline.geometry import Array, Pose, rotation_z
from pipeline.localizer import Localizer, PipelineSettings
from pipeline.markers import Marker, MarkerMap
from recorder.files.camera_file import camera_yaml
from recorder.files.map_file import map_yaml
from replay.settings_file import settings_yaml
from replay.tables import TABLES_VERSION, TableWriter
from replay.truth import TruthRow, exact_row
from tests.worlds import FRAME_NS, START_NS, corners, with_noise
from tests.worlds import camera as world_camera

CAMERA = world_camera(ideal=True)

# T_map_camera of a level camera that looks up, 2 m below the markers.
PLACE = Pose(rotation_z(0.2), np.array([0.05, -0.03, 0.5]))


def ring_map(
    inner: int = 4, outer: int = 4, tags: bool = True, radii_m: tuple[float, float] = (0.3, 0.6)
) -> MarkerMap:
    """Two rings of markers on a ceiling at 2.5 m, tagged by ring and in turn as 90° and 45°."""
    markers = []
    for i in range(inner + outer):
        ring, n, of = ("inner", i, inner) if i < inner else ("outer", i - inner, outer)
        angle = 2 * np.pi * (n + 0.3) / of
        radius = radii_m[ring == "outer"]
        xyz = (radius * np.cos(angle), radius * np.sin(angle), 2.5)
        names = (ring, ("rot90", "rot45")[n % 2]) if tags else ()
        markers.append(Marker.from_yaw(i, xyz, 0.7 * i, "down", 0.15, tags=names))
    return MarkerMap("map", "DICT_6X6_1000", tuple(markers))


def shifted(marker_map: MarkerMap, shift_m: Mapping[int, Sequence[float]]) -> Detections:
    """What each marker alone says that the camera is at: off by its own x, y shift."""
    found = []
    for marker_id in marker_map.ids:
        offset = np.array([*shift_m.get(marker_id, (0.0, 0.0)), 0.0])
        pose = Pose(PLACE.rotation, PLACE.translation + offset)
        seen = corners(pose, CAMERA, marker_map)
        found.append(seen.corners_px[seen.ids == marker_id][0])
    return Detections(np.array(marker_map.ids, dtype=np.int64), np.array(found))


def noisy_frames(marker_map: MarkerMap, n: int, sigma_px: float = 0.3) -> list[Detections]:
    seen = corners(PLACE, CAMERA, marker_map)
    return [with_noise(seen, sigma_px, seed) for seed in range(n)]


def still_result(
    folder: Path,
    marker_map: MarkerMap,
    frames: Sequence[Detections],
    *,
    truth: str | None = "exact",
    places: Sequence[Pose] | None = None,
    camera: Camera = CAMERA,
) -> Path:
    """A result folder as a replay leaves it.

    Args:
        truth: `exact`, `measured` (without a heading) or None.
        places: true pose by frame; the same for all where it is not given.
    """
    folder.mkdir(parents=True)
    settings = PipelineSettings()
    (folder / "camera.yaml").write_bytes(camera_yaml(camera))
    (folder / "map.yaml").write_bytes(map_yaml(marker_map))
    (folder / "settings.yaml").write_bytes(settings_yaml(settings, {}))
    localizer = Localizer(settings, camera, marker_map, START_NS)
    with TableWriter(folder) as tables:
        for i, detections in enumerate(frames):
            stamp = START_NS + i * FRAME_NS
            tables.add(localizer.advance(i, stamp, detections))
            pose = places[i] if places is not None else PLACE
            if truth == "exact":
                tables.add_truth(exact_row(i, stamp, pose))
            elif truth == "measured":
                tables.add_truth(measured_row(i, stamp, pose.translation))
    summary = {
        "name": folder.name,
        "log": f"{folder.name}.mcap",
        "log_sha256": "0" * 64,
        "tables_version": TABLES_VERSION,
        "frames": len(frames),
    }
    (folder / "summary.json").write_text(json.dumps(summary))
    return folder


def measured_row(frame_index: int, timestamp_ns: int, position_m: Array) -> TruthRow:
    nan = float("nan")
    x, y, z = position_m.tolist()
    return TruthRow(
        frame_index, timestamp_ns, "measured", (x, y, z), (nan, nan, nan, nan), nan, 0.005
    )
