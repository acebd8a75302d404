"""What the camera sees: flat things over a plane, through lens and light, in grey levels.

Light is linear: a grey level is proportional to the light on the pixel's square, so that the area
under the step across an edge gives the edge's exact place.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from statistics import NormalDist
from typing import TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.camera import Camera
from pipeline.geometry import Array, Pose
from recorder.simulation.compilation import is_kept
from recorder.simulation.image_kernel import digitize, draw_plane, expose
from recorder.simulation.lens import RayField
from recorder.simulation.optics import ImageSettings, Lamp, Surface
from recorder.simulation.quad_kernel import FloatImage, draw_quad
from recorder.simulation.quads import Quad, disc
from recorder.simulation.texture import texture

GrayImage: TypeAlias = npt.NDArray[np.uint8]
# T_map_camera at a time in seconds from mid-exposure.
Motion: TypeAlias = Callable[[float], Pose]

# Times within the exposure at which moving edges and the moving surface are looked at.
_INSTANTS_PER_PX = 2
_MAX_INSTANTS = 48
_MAX_SURFACE_INSTANTS = 4
_STILL_PX = 0.02

_WAVES = 4


class Renderer:
    """Renders what one camera sees of one scene.

    Args:
        quads: markers (`marker_quads`) and occluders (`rectangle`).
        surface: the ceiling or floor; None: plain mid-grey everywhere.
        seed: of texture, light and noise.
    """

    def __init__(
        self,
        camera: Camera,
        quads: Sequence[Quad],
        surface: Surface | None = None,
        lamps: Sequence[Lamp] = (),
        image: ImageSettings | None = None,
        seed: int = 0,
    ) -> None:
        self.camera = camera
        self.image = image or ImageSettings()
        self._surface = surface or Surface()
        self._lamps = tuple(lamps)
        self._seed = seed
        self._quads = (*quads, *(self._lamp_disc(lamp) for lamp in lamps))
        self._rays = RayField.of(camera)
        self._texture = texture(
            self._surface.texture, self._surface.contrast, self._surface.pattern_m, seed
        )
        rng = np.random.default_rng([seed, 2])
        # Columns: direction and wavelength as a wave vector (x, y), phase.
        angle, phase = rng.uniform(0, 2 * np.pi, (2, _WAVES))
        number = 2 * np.pi / rng.uniform(2.0, 6.0, _WAVES)
        self._waves = np.stack([number * np.cos(angle), number * np.sin(angle), phase], axis=1)

    def render(self, pose: Pose | Motion) -> FloatImage:
        """The image (H, W) in grey levels: not yet rounded, clipped or noisy.

        Args:
            pose: T_map_camera, or as a function of the time from mid-exposure (motion blur).
        """
        motion: Motion = pose if callable(pose) else lambda _: pose
        middle = motion(0.0).inverse()
        shift_px = self._shift_px(motion) if callable(pose) and self.image.exposure_s else 0.0
        count = min(1 + math.ceil(_INSTANTS_PER_PX * shift_px), _MAX_INSTANTS)
        instants = self._exposure(motion, 1 if shift_px < _STILL_PX else count)
        surface_count = min(max(1, math.ceil(shift_px)), _MAX_SURFACE_INSTANTS)
        image = np.empty((self.camera.height_px, self.camera.width_px), np.float32)
        self._draw_surface(image, self._exposure(motion, surface_count))
        for quad in self._visible(middle):
            self._draw(image, quad, middle, instants)
        if self.image.blur_px:
            cv2.GaussianBlur(
                image, (0, 0), self.image.blur_px, dst=image, borderType=cv2.BORDER_REPLICATE
            )
        expose(image, self._gain(middle), self._glare(middle))
        return image

    def capture(self, pose: Pose | Motion, frame_index: int = 0) -> GrayImage:
        """The 8-bit image of the sensor: `render`, then noise that `frame_index` seeds."""
        state = np.random.SeedSequence([self._seed, frame_index]).generate_state(1, np.uint64)
        return digitize(self.render(pose), self.image.noise_std, state[0], _quantiles())

    def _exposure(self, motion: Motion, count: int) -> list[Pose]:
        """T_camera_map at evenly spread times within the exposure."""
        times = ((np.arange(count) + 0.5) / count - 0.5) * self.image.exposure_s
        return [motion(float(t)).inverse() for t in times]

    def _visible(self, T_camera_map: Pose) -> list[Quad]:
        """Quads that show their face, the farther ones first."""

        def order(quad: Quad) -> tuple[int, float]:
            return quad.layer, -float(T_camera_map.apply(quad.T_map_quad.translation)[2])

        return sorted((q for q in self._quads if q.shows_face(T_camera_map)), key=order)

    def _draw(
        self, image: FloatImage, quad: Quad, T_camera_map: Pose, instants: list[Pose]
    ) -> None:
        middle = np.asarray(np.linalg.inv(quad.cell_frame(T_camera_map)), dtype=np.float64)
        frames = [quad.cell_frame(T) for T in instants if quad.shows_face(T)]
        if not frames:
            return
        moving = np.linalg.inv(np.stack(frames))
        reach = _reach(quad, middle, frames) if len(frames) > 1 else 0.0
        draw_quad(image, self._rays.corners, middle[None], moving, quad.cells, quad.margin, reach)

    def _draw_surface(self, image: FloatImage, instants: list[Pose]) -> None:
        grey, height = self._surface.grey, self._surface.height_m
        focal_px = float(self.camera.camera_matrix[0, 0])
        distance = max(abs(instants[0].inverse().translation[2] - height), 1e-3)
        texels = self._texture.at(distance / focal_px)
        frames = [_plane_frame(T, height, self._texture.period_m / len(texels)) for T in instants]
        # Within the plane nothing of it is seen.
        planes = [np.linalg.inv(f) for f in frames if abs(np.linalg.det(f)) > 1e-12]
        if not planes or self._surface.texture == "plain":
            image.fill(grey)
            image[np.isnan(self._rays.corners[1:, 1:, 0])] = 0.0
            return
        draw_plane(image, self._rays.corners, np.stack(planes), texels * grey, grey)

    def _gain(self, T_camera_map: Pose) -> FloatImage:
        """Grey level of white at the nodes: brightness, vignetting and uneven light."""
        nodes = self._rays.nodes
        cos4 = 1.0 / (1.0 + (nodes**2).sum(axis=-1)) ** 2
        gain = 255.0 * self.image.brightness * (1.0 - self.image.vignetting * (1.0 - cos4))
        if self.image.uneven_light:
            place = _hits(nodes, T_camera_map, self._surface.height_m)
            waves = np.cos(place @ self._waves[:, :2].T + self._waves[:, 2]).mean(axis=-1)
            gain *= 1.0 + self.image.uneven_light * np.nan_to_num(waves)
        return np.asarray(gain, dtype=np.float32)

    def _glare(self, T_camera_map: Pose) -> FloatImage:
        """Grey levels that the lamps' halos add at the nodes."""
        nodes = self._rays.nodes
        glare = np.zeros(nodes.shape[:2])
        for lamp in self._lamps:
            if not lamp.halo_m:
                continue
            place = _hits(nodes, T_camera_map, self._lamp_height(lamp))
            near = 1.0 - ((place - lamp.xy_m) ** 2).sum(axis=-1) / lamp.halo_m**2
            glare += 255.0 * lamp.halo * np.clip(np.nan_to_num(near), 0.0, None) ** 3
        return glare.astype(np.float32)

    def _shift_px(self, motion: Motion) -> float:
        """How far anything in view moves in the image during the exposure."""
        half = self.image.exposure_s / 2
        poses = [motion(t).inverse() for t in (-half, 0.0, half)]
        below = poses[1].inverse().translation
        identity = Pose.identity()
        points = [quad.outline() @ quad.cell_frame(identity).T for quad in self._quads]
        around = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        points.append(np.column_stack([below[:2] + around, np.full(4, self._surface.height_m)]))
        seen = [T.apply(np.concatenate(points)) for T in poses]
        front = np.all([p[:, 2] > 0.05 for p in seen], axis=0)
        if not front.any():
            return 0.0
        rays = np.stack([p[front, :2] / p[front, 2:] for p in seen])
        # What is far outside the view does not count.
        edge = 1.5 * np.nanmax(np.abs(self._rays.nodes), axis=(0, 1))
        inside = (np.abs(rays[1]) < edge).all(axis=1)
        if not inside.any():
            return 0.0
        moved = np.linalg.norm(np.diff(rays[:, inside], axis=0), axis=-1).sum(axis=0)
        return float(moved.max() * self.camera.camera_matrix[0, 0])

    def _lamp_height(self, lamp: Lamp) -> float:
        return self._surface.height_m if lamp.height_m is None else lamp.height_m

    def _lamp_disc(self, lamp: Lamp) -> Quad:
        centre = Pose(np.eye(3), np.array([*lamp.xy_m, self._lamp_height(lamp)]))
        return disc(centre, lamp.radius_m, lamp.intensity / self.image.brightness)


def is_compiled() -> bool:
    """Whether the first image will not have to wait for the compiler."""
    return all(is_kept(kernel) for kernel in (draw_quad, draw_plane, expose, digitize))


def _plane_frame(T_camera_map: Pose, height_m: float, scale: float) -> Array:
    """(3, 3) from (x / scale, y / scale, 1) on a horizontal plane to the camera frame."""
    rotation = T_camera_map.rotation
    origin = T_camera_map.apply(np.array([0.0, 0.0, height_m]))
    return np.stack([rotation[:, 0] * scale, rotation[:, 1] * scale, origin], axis=1)


def _hits(rays: Array, T_camera_map: Pose, height_m: float) -> Array:
    """(h, w, 2) map x, y where rays (h, w, 2) meet a horizontal plane; NaN where they miss it."""
    frame = _plane_frame(T_camera_map, height_m, 1.0)
    if abs(np.linalg.det(frame)) < 1e-12:
        return np.full(rays.shape, np.nan)
    homography = np.linalg.inv(frame)
    place = rays @ homography[:, :2].T + homography[:, 2]
    w = np.where(place[..., 2:] > 1e-3, place[..., 2:], np.nan)
    hits: Array = place[..., :2] / w
    return hits


def _reach(quad: Quad, middle: Array, frames: list[Array]) -> float:
    """How far, in cells, the quad's corners move from their place at mid-exposure."""
    outline = quad.outline()
    points = np.concatenate([outline @ frame.T for frame in frames])
    back = points @ middle.T
    if (points[:, 2] <= 0).any() or (back[:, 2] <= 0).any():
        return math.inf
    moved = np.abs(back[:, :2] / back[:, 2:] - np.tile(outline[:, :2], (len(frames), 1)))
    return 1.1 * float(moved.max()) + 1e-6


@lru_cache(maxsize=1)
def _quantiles() -> FloatImage:
    """65536 quantiles of the standard normal distribution."""
    inverse = NormalDist().inv_cdf
    return np.array([inverse((i + 0.5) / 65536) for i in range(65536)], dtype=np.float32)
