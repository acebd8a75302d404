"""The paper's site in simulation: what is told, what is true for a seed, and the corners' noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.paper.corner_noise import CornerNoise, NoisyCorners, jittered, measure
from pipeline.camera import Camera
from pipeline.detection import ArucoDetection
from pipeline.geometry import Pose
from pipeline.markers import MarkerMap
from recorder.simulation.installation import InstallationErrors
from recorder.simulation.scene_file import Scene, load_scene, shipped_scenes
from recorder.simulation.source import SceneSource

# Fixed before the first run, as the paper's site may well have had them.
MARKER_POSITION_STD_M = 0.002
MARKER_YAW_STD_DEG = 0.5
FOCAL_ERROR = 0.003
PRINCIPAL_POINT_ERROR_PX = 3.0
SEEDS = 20

# Rendered for the noise of the corners. On a drive few markers are in view at once.
STANDING_FRAMES = 30
DRIVING_FRAMES = 120


@dataclass(frozen=True, eq=False)
class Site:
    """One configuration as it is told, and the noise measured on renderings of it."""

    scene: Scene
    camera: Camera
    marker_map: MarkerMap
    noise: CornerNoise

    def true(self, seed: int) -> NoisyCorners:
        """The corners that the detector would find at the true site of a seed."""
        rng = np.random.default_rng([seed, 21])
        direction = rng.uniform(0.0, 2.0 * np.pi)
        offset = PRINCIPAL_POINT_ERROR_PX * np.array([np.cos(direction), np.sin(direction)])
        errors = InstallationErrors(
            marker_position_std_m=MARKER_POSITION_STD_M,
            marker_yaw_std_deg=MARKER_YAW_STD_DEG,
            focal=float(rng.choice([-FOCAL_ERROR, FOCAL_ERROR])),
            principal_point_px=offset.tolist(),
        )
        return NoisyCorners(
            errors.apply_to_camera(self.camera),
            errors.apply_to_map(self.marker_map, seed),
            self.noise,
        )


def open_site(name: str) -> Site:
    """A shipped scene, with the noise of the paper's detector measured on some frames of it.

    Frames are from up to 2 cm around a camera that stands still, or from all along the way of one
    that drives: a camera that moved exactly along the pixel rows would cut edges always alike.
    """
    scene = load_scene(shipped_scenes()[name])
    renderer = SceneSource(shipped_scenes()[name]).renderer()
    if _stands_still(scene):
        poses = [scene.pose(0.0)] * STANDING_FRAMES
    else:
        times = np.linspace(0.0, scene.time_s(scene.frame_count - 1), DRIVING_FRAMES)
        poses = [scene.pose(float(t)) for t in times]
    poses = jittered(poses, seed=1, spread_m=0.02)
    noise = measure(renderer, scene.true_camera, scene.true_map, poses, ArucoDetection())
    return Site(scene, scene.camera, scene.marker_map, noise)


def _stands_still(scene: Scene) -> bool:
    first, later = scene.pose(0.0), scene.pose(scene.time_s(scene.frame_count - 1) / 2.0)
    return _distance_m(first, later) < 1e-9


def _distance_m(a: Pose, b: Pose) -> float:
    return float(np.linalg.norm(a.translation - b.translation))
