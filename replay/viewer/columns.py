"""Rows collected per entity and sent in batches, five times faster than one by one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import rerun as rr

from replay.viewer import style

ToColumns: TypeAlias = Callable[[list[Any]], rr.ComponentColumnList]

# A file lists every chunk, and keeps that list in memory until it is whole: no small chunks.
_CHUNK_FRAMES = 1024

# Half the height of the flat uncertainty ellipses.
_THIN_M = 1e-3

_NOWHERE = (float("nan"),) * 3
_UNTURNED = (0.0, 0.0, 0.0, 1.0)


@dataclass
class _Entity:
    to_columns: ToColumns
    times_ns: list[int] = field(default_factory=list)
    frames: list[int] = field(default_factory=list)
    rows: list[Any] = field(default_factory=list)


class ColumnBuffer:
    """Collects rows of entities at the current frame until `flush`."""

    def __init__(self, stream: rr.RecordingStream) -> None:
        self._stream = stream
        self._entities: dict[str, _Entity] = {}
        self._time_ns = 0
        self._frame_index = 0
        self._frames = 0

    def at(self, time_ns: int, frame_index: int) -> None:
        """Where the next rows belong; time since the log's first image. Called once a frame."""
        if self._frames == _CHUNK_FRAMES:
            self.flush()
        self._frames += 1
        self._time_ns, self._frame_index = time_ns, frame_index

    def add(self, entity: str, to_columns: ToColumns, row: object) -> None:
        """One row; `to_columns` turns the entity's rows into Rerun's columns."""
        buffer = self._entities.get(entity)
        if buffer is None:
            buffer = self._entities[entity] = _Entity(to_columns)
        buffer.times_ns.append(self._time_ns)
        buffer.frames.append(self._frame_index)
        buffer.rows.append(row)

    def flush(self) -> None:
        """Sends what was collected; `at` does so now and then."""
        self._frames = 0
        for entity, buffer in self._entities.items():
            if not buffer.rows:
                continue
            times = np.array(buffer.times_ns, dtype="timedelta64[ns]")
            self._stream.send_columns(
                entity,
                [
                    rr.TimeColumn(style.TIME, duration=times),
                    rr.TimeColumn(style.FRAME, sequence=buffer.frames),
                ],
                buffer.to_columns(buffer.rows),
            )
            buffer.times_ns, buffer.frames, buffer.rows = [], [], []


def scalars(rows: list[Any]) -> rr.ComponentColumnList:
    """Rows: numbers."""
    return rr.Scalars.columns(scalars=rows)


def measurements(rows: list[Any]) -> rr.ComponentColumnList:
    """Rows: (value, variance)."""
    values = np.array(rows, dtype=np.float64)
    return rr.Measurements.columns(values=values[:, 0], variances=values[:, 1])


def transforms(rows: list[Any]) -> rr.ComponentColumnList:
    """Rows: poses, or None where what is placed has no place and is not to be seen."""
    # A cleared transform is an error to the viewer; one to nowhere hides all below it.
    return rr.Transform3D.columns(
        translation=[_NOWHERE if pose is None else pose.translation for pose in rows],
        quaternion=[_UNTURNED if pose is None else pose.quat_xyzw for pose in rows],
    )


def points3d(rows: list[Any]) -> rr.ComponentColumnList:
    """Rows: one point (3,) each."""
    return rr.Points3D.columns(positions=rows)


def ellipsoids(rows: list[Any]) -> rr.ComponentColumnList:
    """Rows: one flat ellipse at 3σ each: centre (3,), covariance of x and y (2, 2)."""
    centres, covariances = zip(*rows, strict=True)
    values, vectors = np.linalg.eigh(np.array(covariances))
    half_sizes = np.full((len(rows), 3), _THIN_M)
    half_sizes[:, :2] = 3.0 * np.sqrt(np.maximum(values, 0.0))
    half = np.arctan2(vectors[:, 1, 0], vectors[:, 0, 0]) / 2.0
    zero = np.zeros(len(half))
    return rr.Ellipsoids3D.columns(
        centers=centres,
        half_sizes=half_sizes,
        quaternions=np.stack([zero, zero, np.sin(half), np.cos(half)], axis=1),
    )


def outlines(rows: list[Any]) -> rr.ComponentColumnList:
    """Rows: any number of markers each: corners (N, 4, 2), colours (N, 3)."""
    strips = [np.concatenate([c, c[:, :1]], axis=1) for c, _ in rows]
    return rr.LineStrips2D.columns(
        strips=[strip for frame in strips for strip in frame],
        colors=_stacked([colours for _, colours in rows]),
    ).partition([len(frame) for frame in strips])


def points2d(rows: list[Any]) -> rr.ComponentColumnList:
    """Rows: any number of points each: positions (N, 2), colours (N, 3)."""
    return rr.Points2D.columns(
        positions=np.concatenate([positions for positions, _ in rows]),
        colors=_stacked([colours for _, colours in rows]),
    ).partition([len(positions) for positions, _ in rows])


def labels2d(rows: list[Any]) -> rr.ComponentColumnList:
    """Rows: any number of labels each: positions (N, 2), colours (N, 3), texts (N)."""
    return rr.Points2D.columns(
        positions=np.concatenate([positions for positions, _, _ in rows]),
        colors=_stacked([colours for _, colours, _ in rows]),
        labels=[label for _, _, labels in rows for label in labels],
    ).partition([len(positions) for positions, _, _ in rows])


def _stacked(colours: Sequence[Any]) -> Any:
    return np.concatenate([np.asarray(c, dtype=np.uint8).reshape(-1, 3) for c in colours])
