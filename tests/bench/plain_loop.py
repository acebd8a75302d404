"""What OpenCV alone takes for the frames that a replay or live tracking has."""

from __future__ import annotations

import time
from pathlib import Path

import cv2
import numpy as np

from recorder.files.camera_file import parse_camera
from recorder.files.map_file import parse_map
from recorder.sources.base import CapturedFrame


def plain_loop(files: dict[str, bytes], frames: list[CapturedFrame], times: int) -> float:
    """Seconds to decode, detect and solve with OpenCV alone."""
    camera = parse_camera(files["camera.yaml"], Path("camera.yaml"))
    marker_map = parse_map(files["map.yaml"], Path("map.yaml"))
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, marker_map.dictionary))
    detector = cv2.aruco.ArucoDetector(dictionary, parameters)
    matrix, coefficients = np.array(camera.camera_matrix), np.array(camera.dist_coeffs)
    started = time.perf_counter()
    for _ in range(times):
        for frame in frames:
            image = cv2.imdecode(np.frombuffer(frame.data, np.uint8), cv2.IMREAD_GRAYSCALE)
            assert image is not None
            corners, ids, _ = detector.detectMarkers(image)
            if ids is None:
                continue
            known = [i for i, marker_id in enumerate(ids.ravel()) if marker_id in marker_map.by_id]
            object_points = marker_map.corners_m(int(ids.ravel()[i]) for i in known)
            pixels = np.concatenate([corners[i].reshape(4, 2) for i in known])
            cv2.solvePnPRansac(
                object_points, pixels, matrix, coefficients, flags=cv2.SOLVEPNP_ITERATIVE
            )
    return time.perf_counter() - started
