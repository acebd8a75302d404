"""Which frames of a long log a survey uses: few, from many places, with every marker in enough."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.markers import MarkerMap
from replay.survey.problem import IntArray
from replay.survey.sightings import Sighting

# A view from this far away (share of the distance to the markers, or radians of turn) is as good
# as half a new one.
_HALF_NEW = 0.1


def choose(sightings: Sequence[Sighting], marker_map: MarkerMap, limit: int) -> IntArray:
    """Positions of at most `limit` sightings, in order.

    One by one, that which is farthest from those chosen and sees markers that they see least.
    """
    count = len(sightings)
    if count <= limit:
        return np.arange(count)
    column = {marker_id: i for i, marker_id in enumerate(marker_map.ids)}
    sees = np.zeros((count, len(column)))
    distance_m = np.empty(count)
    for i, sighting in enumerate(sightings):
        ids = [int(k) for k in sighting.detections.ids]
        sees[i, [column[k] for k in ids]] = 1.0
        centres = np.array([marker_map.by_id[k].centre_m for k in ids])
        arms = centres - sighting.T_map_camera.translation
        distance_m[i] = np.linalg.norm(arms, axis=1).mean()
    position = np.array([s.T_map_camera.translation for s in sightings])
    rotation = np.array([s.T_map_camera.rotation for s in sightings])

    chosen = np.zeros(count, dtype=bool)
    seen = np.zeros(len(column))
    nearest = np.full(count, 1e9)
    for _ in range(limit):
        # Where all views are the same, still one after the other.
        new = nearest / (nearest + _HALF_NEW) + 1e-6
        gain = new * (sees @ (1.0 / (1.0 + seen)))
        gain[chosen] = -1.0
        best = int(np.argmax(gain))
        chosen[best] = True
        seen += sees[best]
        moved = np.linalg.norm(position - position[best], axis=1) / distance_m
        # trace(RᵀS) = 1 + 2 cos(angle)
        cosine = (np.einsum("nij,ij->n", rotation, rotation[best]) - 1.0) / 2.0
        nearest = np.minimum(nearest, np.hypot(moved, np.arccos(np.clip(cosine, -1.0, 1.0))))
    return np.flatnonzero(chosen)
