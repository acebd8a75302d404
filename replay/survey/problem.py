"""The bundle adjustment as numbers: parameters, residuals and their sparse Jacobian."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from pipeline.bundle import cross_matrices, inward_px, project_with_jacobian, rotations
from pipeline.camera import Camera
from pipeline.geometry import Array, Pose
from pipeline.markers import CORNER_SIGNS, Marker

IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Observations:
    """Markers seen in frames, one row each.

    Attributes:
        frame: (N,) position in the list of frames.
        marker: (N,) position in the list of markers.
        corners_px: (N, 4, 2).
    """

    frame: IntArray
    marker: IntArray
    corners_px: Array

    def __len__(self) -> int:
        return len(self.frame)

    def select(self, index: npt.ArrayLike) -> Observations:
        """The rows at `index` (positions or a mask)."""
        rows = np.asarray(index)
        return Observations(self.frame[rows], self.marker[rows], self.corners_px[rows])


@dataclass(frozen=True)
class EdgePrior:
    """How far inside the true ones a detector is expected to put edges, and how surely."""

    mean_px: float = 0.0
    std_px: float = 0.5


@dataclass(frozen=True)
class Prior:
    """How well the hand measurement knows a marker, one standard deviation per axis."""

    std_m: float
    std_rad: float


ANY_EDGES = EdgePrior()


class Problem:
    """Markers that move, frames, and the inset of all edges, against corners and priors.

    The parameters are, in one vector: for each free marker its shift (metres) and its turn
    (axis-angle) from the hand measurement, in map axes; by how many pixels the detector puts a
    marker's edges inside the true ones; for each frame the turn and shift of T_camera_map from its
    start, in camera axes. Residuals are in standard deviations.

    Args:
        markers: as measured by hand.
        fixed: for each marker, whether it is held exactly, with its corners as they were measured.
            A free one is an exact square: that is what is printed.
        priors: of each marker; of no meaning for fixed ones.
        starts: T_camera_map of each frame.
    """

    def __init__(
        self,
        camera: Camera,
        markers: Iterable[Marker],
        fixed: Iterable[bool],
        priors: Iterable[Prior],
        starts: Iterable[Pose],
        observations: Observations,
        edges: EdgePrior = ANY_EDGES,
    ) -> None:
        self.camera = camera
        self.markers = tuple(markers)
        self.starts = tuple(starts)
        self.observations = observations
        self.fixed = np.array(tuple(fixed), dtype=bool)
        priors = tuple(priors)
        free = np.flatnonzero(~self.fixed)
        self.free_count = len(free)
        # Column of each marker's six parameters; no meaning for fixed ones.
        self._slot = np.zeros(len(self.markers), dtype=np.int64)
        self._slot[free] = np.arange(len(free))
        self.edge_column = 6 * len(free)
        self.frame_start = self.edge_column + 1
        self.size = self.frame_start + 6 * len(self.starts)
        stds = [[priors[i].std_m] * 3 + [priors[i].std_rad] * 3 for i in free]
        self.prior_std = np.append(np.reshape(stds, -1), edges.std_px)
        self._prior_mean = np.append(np.zeros(6 * len(free)), edges.mean_px)
        rotation = np.stack([m.T_map_marker.rotation for m in self.markers])
        self._centres = np.stack([m.centre_m for m in self.markers])
        # Corners from each marker's centre, in map axes.
        self._arms = np.stack(
            [
                m.corners_m - m.centre_m if held else CORNER_SIGNS * (m.size_m / 2.0) @ turn.T
                for m, held, turn in zip(self.markers, self.fixed, rotation, strict=True)
            ]
        )
        self._frame_rotation = np.stack([pose.rotation for pose in self.starts])
        self._frame_translation = np.stack([pose.translation for pose in self.starts])
        self._inward = inward_px(observations.corners_px)
        self._indices, self._indptr, self._kept = self._structure()

    @property
    def start(self) -> Array:
        """The hand measurement, the frames where they start, the inset that is expected."""
        return np.append(self._prior_mean, np.zeros(6 * len(self.starts)))

    @property
    def corner_rows(self) -> int:
        """How many of the first residuals are corners; the others are priors."""
        return 8 * len(self.observations)

    def shifts(self, x: Array) -> Array:
        """(M, 6) shift and turn of every marker; zero for fixed ones."""
        moved = np.zeros((len(self.markers), 6))
        moved[~self.fixed] = x[: self.edge_column].reshape(-1, 6)
        return moved

    def poses(self, x: Array) -> tuple[Pose, ...]:
        """T_camera_map of every frame."""
        frames = x[self.frame_start :].reshape(-1, 6)
        turned, _ = rotations(frames[:, :3])
        moved = self._frame_translation + frames[:, 3:]
        return tuple(map(Pose, turned @ self._frame_rotation, moved))

    def corner_errors_px(self, x: Array) -> Array:
        """(N, 4, 2) predicted minus observed."""
        shifts = self.shifts(x)
        turned, _ = rotations(shifts[:, 3:])
        corners = self._centres[:, None] + shifts[:, None, :3] + self._arms @ turned.mT
        frames = x[self.frame_start :].reshape(-1, 6)
        turned, _ = rotations(frames[:, :3])
        f, m = self.observations.frame, self.observations.marker
        rotation = (turned @ self._frame_rotation)[f]
        translation = (self._frame_translation + frames[:, 3:])[f]
        points = corners[m] @ rotation.mT + translation[:, None]
        pixels, _ = project_with_jacobian(self.camera, points)
        shrunk = x[self.edge_column] * self._inward
        return np.asarray(pixels.reshape(-1, 4, 2) + shrunk - self.observations.corners_px)

    def residuals(self, x: Array, sigma_px: float) -> Array:
        """(8 N + priors,) everything over its standard deviation."""
        return np.concatenate(
            [
                self.corner_errors_px(x).ravel() / sigma_px,
                (x[: self.frame_start] - self._prior_mean) / self.prior_std,
            ]
        )

    def jacobian(self, x: Array, sigma_px: float) -> csr_array:
        """(8 N + priors, parameters) derivatives of `residuals`."""
        shifts = self.shifts(x)
        turned, left = rotations(shifts[:, 3:])
        arms = self._arms @ turned.mT
        corners = self._centres[:, None] + shifts[:, None, :3] + arms
        by_turn = -cross_matrices(arms) @ left[:, None]
        frames = x[self.frame_start :].reshape(-1, 6)
        frame_turned, frame_left = rotations(frames[:, :3])
        f, m = self.observations.frame, self.observations.marker
        rotation = (frame_turned @ self._frame_rotation)[f]
        translation = (self._frame_translation + frames[:, 3:])[f]
        turned_points = corners[m] @ rotation.mT
        points = turned_points + translation[:, None]
        _, by_point = project_with_jacobian(self.camera, points)
        by_point = by_point.reshape(-1, 4, 2, 3) / sigma_px

        rows = np.empty((len(f), 4, 2, 13))
        rows[..., 0:3] = by_point @ rotation[:, None]
        rows[..., 3:6] = rows[..., 0:3] @ by_turn[m]
        rows[..., 6:9] = by_point @ (-cross_matrices(turned_points) @ frame_left[f][:, None])
        rows[..., 9:12] = by_point
        rows[..., 12] = self._inward / sigma_px
        values = np.concatenate([rows.reshape(-1)[self._kept], 1.0 / self.prior_std])
        shape = (self.corner_rows + self.frame_start, self.size)
        return csr_array((values, self._indices, self._indptr), shape=shape)

    def _structure(self) -> tuple[IntArray, IntArray, npt.NDArray[np.bool_]]:
        """Column indices and row pointers, and which of 13 derivatives a row there are."""
        f, m = self.observations.frame, self.observations.marker
        six = np.arange(6)
        columns = np.empty((len(f), 8, 13), dtype=np.int64)
        columns[..., 0:6] = (6 * self._slot[m][:, None] + six)[:, None]
        columns[..., 6:12] = (self.frame_start + 6 * f[:, None] + six)[:, None]
        columns[..., 12] = self.edge_column
        kept = np.ones(columns.shape, dtype=bool)
        kept[..., 0:6] = ~self.fixed[m][:, None, None]
        per_row = kept.sum(axis=2).ravel()
        priors = np.arange(self.frame_start)
        indices = np.concatenate([columns[kept], priors])
        counts = np.concatenate([per_row, np.ones(len(priors), dtype=np.int64)])
        return indices, np.concatenate([[0], np.cumsum(counts)]), kept.reshape(-1)


def moved_marker(hand: Marker, shift: Array) -> Marker:
    """A marker after its six parameters' shift and turn: an exact square, as it was printed."""
    turn, _ = rotations(shift[None, 3:])
    pose = Pose(turn[0] @ hand.T_map_marker.rotation, hand.centre_m + shift[:3])
    return Marker.from_pose(hand.id, pose, hand.size_m, hand.std_m, hand.tags)
