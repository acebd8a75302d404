"""Markers that are off the regular grid which nearly all others are on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.geometry import Array, wrap_angle
from pipeline.markers import Marker
from pipeline.pose import BoolArray
from recorder.maps.findings import Finding

_FEWEST = 8
_SHARE = 0.8
_ON_GRID_M = 0.02
# Places as they were planned; measured ones, of which a few may agree by chance.
_EXACT_M = 0.001
_MEASURED_M = 0.05
# Times the median: eight standard deviations of what the tape measure spreads.
_ODD = 12.0
# Within a closer grid, 2 cm are no surprise.
_LEAST_PITCH_M = 0.2
# Values nearer than this are of one row.
_ROW_M = 0.05
# Some grid is near any scattered places, but they do not fill it.
_FILLED = 0.4
# From where a marker should be; further away, `far` has it.
_REACH_PITCHES = 4.0
_SIGNS = ((-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0))


@dataclass(frozen=True)
class _Rows:
    """Equally spaced rows along one axis; without a pitch where there is but one."""

    first_m: float
    pitch_m: float | None

    def steps(self, values: Array) -> Array:
        if self.pitch_m is None:
            return np.zeros(len(values))
        steps: Array = np.round((values - self.first_m) / self.pitch_m)
        return steps

    def at_m(self, steps: Array) -> Array:
        return self.first_m + steps * (self.pitch_m or 0.0)


@dataclass(frozen=True)
class _Grid:
    """Rows along two axes that are turned against the map's.

    Attributes:
        axes: (2, 2), columns in map coordinates.
    """

    axes: Array
    rows: tuple[_Rows, _Rows]

    def steps(self, places_m: Array) -> Array:
        along = places_m @ self.axes
        return np.stack([row.steps(along[:, k]) for k, row in enumerate(self.rows)], axis=1)

    def off_m(self, places_m: Array) -> Array:
        """(N, 2) from the nearest node, along the grid's axes."""
        off: Array = (places_m - self.places_m(self.steps(places_m))) @ self.axes
        return off

    def places_m(self, steps: Array) -> Array:
        along = [row.at_m(steps[:, k]) for k, row in enumerate(self.rows)]
        places: Array = np.stack(along, axis=1) @ self.axes.T
        return places

    @property
    def pitches_m(self) -> tuple[float, ...]:
        return tuple(row.pitch_m for row in self.rows if row.pitch_m is not None)


def grid_findings(members: Sequence[Marker]) -> list[Finding]:
    """Of a floor or ceiling: a marker that is off its grid and has left a gap in it.

    A grid is along the map's axes or the usual yaw. Markers of an irregular map are on none;
    nothing is said of rows at another distance, nor of markers between those of a full grid.
    """
    places_m = np.array([marker.centre_m[:2] for marker in members])
    for turn_rad in (0.0, _usual_turn_rad(members)):
        grid = _grid(places_m, turn_rad)
        if grid is not None:
            return _off_grid(members, places_m, grid)
    return []


def _usual_turn_rad(members: Sequence[Marker]) -> float:
    """The most common yaw; quarter turns do not matter to a grid."""
    quarters = np.array([4.0 * marker.T_map_marker.yaw_rad for marker in members])
    near = np.abs(wrap_angle(quarters[:, None] - quarters)) < np.radians(4.0)
    usual = int(near.sum(axis=1).argmax())
    off = wrap_angle(quarters[near[usual]] - quarters[usual])
    return float(quarters[usual] + np.median(off)) / 4.0


def _grid(places_m: Array, turn_rad: float) -> _Grid | None:
    """The grid that most places are on and fill; None where there is none."""
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    axes = np.array([[cos, -sin], [sin, cos]])
    first, second = (_rows(values) for values in (places_m @ axes).T)
    if first is None or second is None:
        return None
    grid = _Grid(axes, (first, second))
    on = (np.abs(grid.off_m(places_m)) <= _ON_GRID_M).all(axis=1)
    if not grid.pitches_m or on.sum() < max(_FEWEST, _SHARE * len(places_m)):
        return None
    steps = grid.steps(places_m)[on]
    filled = len(np.unique(steps, axis=0)) / float(np.prod(np.ptp(steps, axis=0) + 1.0))
    return grid if filled >= _FILLED else None


def _rows(values: Array) -> _Rows | None:
    """The rows that most values are in; None where they are too close for any to be odd."""
    ordered = np.sort(values)
    groups = np.split(ordered, np.flatnonzero(np.diff(ordered) > _ROW_M) + 1)
    # What only one of many is in is no row.
    least = 0.5 * float(np.median([len(group) for group in groups]))
    middles = np.array([np.median(group) for group in groups if len(group) >= least])
    if len(middles) == 1:
        return _Rows(float(middles[0]), None)
    gaps = np.diff(middles)
    pitch_m = float(np.median(gaps))
    if pitch_m < _LEAST_PITCH_M:
        return None
    steps = np.concatenate([[0.0], np.cumsum(np.round(gaps / pitch_m))])
    # Theil & Sen: a row off its place does not move the others.
    i, j = np.triu_indices(len(middles), 1)
    apart = steps[j] - steps[i]
    slopes = (middles[j] - middles[i])[apart > 0] / apart[apart > 0]
    pitch_m = float(np.median(slopes))
    return _Rows(float(np.median(middles - steps * pitch_m)), pitch_m)


def _off_grid(members: Sequence[Marker], places_m: Array, grid: _Grid) -> list[Finding]:
    steps, off_m = grid.steps(places_m), np.abs(grid.off_m(places_m))
    usual_m = float(np.median(off_m, axis=0).max())
    limit_m = max(_ON_GRID_M if usual_m < _EXACT_M else _MEASURED_M, _ODD * usual_m)
    off: BoolArray = np.asarray((off_m > limit_m).any(axis=1))
    outside = ~off & _outside_of_the_others(steps, off)
    free_m = grid.places_m(_free(steps[~off & ~outside]))
    # Only in a grid that is full but for them does a gap tell of a sign.
    if outside.sum() + off.sum() < len(free_m):
        outside[:] = False
    found = []
    reach_m = _REACH_PITCHES * max(grid.pitches_m)
    size = " x ".join(f"{pitch_m:.3g}" for pitch_m in grid.pitches_m)
    for k in np.flatnonzero(off | outside).tolist():
        mirrored = [place for place in free_m if _is_mirrored(places_m[k], place, limit_m)]
        apart_m = np.linalg.norm(free_m - places_m[k], axis=1)
        if mirrored:
            end = f"{_at(mirrored[0])} is free; a wrong sign?"
        elif off[k] and apart_m.min(initial=np.inf) <= reach_m and not _in_a_row(k, off, off_m):
            nearest = int(apart_m.argmin())
            end = f"{apart_m[nearest]:.3f} m from its nearest free place, {_at(free_m[nearest])}"
        else:
            continue
        text = (
            f"marker {members[k].id} is off the grid of {size} m that "
            f"{int((~off & ~outside).sum())} others are on: {end}"
        )
        found.append(Finding("warning", "grid", (members[k].id,), text))
    return found


def _outside_of_the_others(steps: Array, off: BoolArray) -> BoolArray:
    """Each single marker without which the grid would end earlier."""
    single = np.zeros(len(steps), dtype=bool)
    on = steps[~off]
    for k in np.flatnonzero(~off):
        same = (on == steps[k]).sum(axis=0) == 1
        at_end = (steps[k] == on.min(axis=0)) | (steps[k] == on.max(axis=0))
        single[k] = bool((same & at_end).any())
    return single


def _free(steps: Array) -> Array:
    """(N, 2) nodes without a marker, as far as the others reach."""
    low, high = steps.min(axis=0), steps.max(axis=0)
    nodes = np.stack(np.meshgrid(*map(np.arange, low, high + 1.0)), axis=-1).reshape(-1, 2)
    taken = {tuple(node) for node in steps.tolist()}
    return np.array([node for node in nodes if tuple(node) not in taken]).reshape(-1, 2)


def _is_mirrored(place_m: Array, other_m: Array, limit_m: float) -> bool:
    return any(bool((np.abs(place_m * sign - other_m) <= limit_m).all()) for sign in _SIGNS)


def _in_a_row(k: int, off: BoolArray, off_m: Array) -> bool:
    """Whether others are off as it is: a row, or a part of the site, with a place of its own."""
    alike = off & (np.abs(off_m - off_m[k]) <= _ROW_M).all(axis=1)
    return bool(alike.sum() > 1)


def _at(place_m: Array) -> str:
    x, y = (round(float(value), 3) + 0.0 for value in place_m)
    return f"x {x:g} y {y:g} m"
