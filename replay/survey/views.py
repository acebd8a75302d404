"""The markers that frames see, as arrays, and which markers hang together."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pipeline.geometry import Array, Pose
from replay.survey.problem import IntArray
from replay.survey.sightings import Sighting


@dataclass(frozen=True, eq=False)
class Views:
    """Markers in frames, one row each.

    Attributes:
        frame: (N,) position in `poses`.
        ids: (N,) of the markers.
        corners_px: (N, 4, 2).
        poses: T_camera_map of each frame, to start from.
    """

    frame: IntArray
    ids: IntArray
    corners_px: Array
    poses: tuple[Pose, ...]

    @classmethod
    def of(cls, sightings: Sequence[Sighting]) -> Views:
        if not sightings:
            return cls(np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 4, 2)), ())
        counts = [len(sighting.detections) for sighting in sightings]
        return cls(
            np.repeat(np.arange(len(sightings)), counts),
            np.concatenate([sighting.detections.ids for sighting in sightings]),
            np.concatenate([sighting.detections.corners_px for sighting in sightings]),
            tuple(sighting.T_map_camera.inverse() for sighting in sightings),
        )

    def moved(self, poses: tuple[Pose, ...]) -> Views:
        """The same from other poses."""
        return replace(self, poses=poses)

    def select(self, rows: npt.NDArray[np.bool_]) -> Views:
        """The rows of a mask; all frames stay."""
        return replace(
            self, frame=self.frame[rows], ids=self.ids[rows], corners_px=self.corners_px[rows]
        )

    def informative(self, fixed: Collection[int]) -> Views:
        """Only frames that say something of a marker that may move: they see another beside it."""
        count = len(self.poses)
        seen = np.bincount(self.frame, minlength=count)
        free = ~np.isin(self.ids, sorted(fixed))
        useful = (seen >= 2) & (np.bincount(self.frame[free], minlength=count) >= 1)
        left = self.select(useful[self.frame])
        number = np.cumsum(useful) - 1
        poses = tuple(pose for pose, kept in zip(self.poses, useful, strict=True) if kept)
        return replace(left, frame=number[left.frame], poses=poses)

    def groups(self) -> tuple[tuple[int, ...], ...]:
        """Ids of the markers that frames tie together, directly or by others; largest first."""
        ids, column = np.unique(self.ids, return_inverse=True)
        frames = len(self.poses)
        size = frames + len(ids)
        edges = coo_array((np.ones(len(column)), (self.frame, frames + column)), shape=(size, size))
        _, label = connected_components(edges, directed=False)
        of_marker = label[frames:]
        groups = [tuple(int(i) for i in ids[of_marker == k]) for k in np.unique(of_marker)]
        return tuple(sorted(groups, key=lambda group: (-len(group), group)))
