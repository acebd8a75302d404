"""The result tables: their columns, and a writer of bounded memory."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.geometry import Pose
from pipeline.localizer import FrameResult
from replay.truth import TruthRow

# Bumped when a column of the contract changes its meaning.
TABLES_VERSION = 1

_FRAME = [("frame_index", pa.int64()), ("timestamp_ns", pa.int64())]
_XYZ = [(name, pa.float64()) for name in ("x_m", "y_m", "z_m")]
_QUATERNION = [(name, pa.float64()) for name in ("qx", "qy", "qz", "qw")]

SCHEMAS: dict[str, pa.Schema] = {
    "detections": pa.schema(
        [
            *_FRAME,
            ("marker_id", pa.int64()),
            ("corner", pa.int8()),
            ("u_px", pa.float64()),
            ("v_px", pa.float64()),
        ]
    ),
    "poses": pa.schema(
        [
            *_FRAME,
            ("status", pa.string()),
            ("n_detected", pa.int64()),
            ("n_used", pa.int64()),
            ("n_explained", pa.int64()),
            *_XYZ,
            *_QUATERNION,
            ("yaw_rad", pa.float64()),
            ("reprojection_rms_px", pa.float64()),
            ("reprojection_rms_used_px", pa.float64()),
            ("fallback", pa.bool_()),
        ]
    ),
    "tracks": pa.schema(
        [
            *_FRAME,
            ("tracker", pa.string()),
            ("updated", pa.bool_()),
            *(
                (name, pa.float64())
                for name in (
                    "x_m",
                    "vx_mps",
                    "y_m",
                    "vy_mps",
                    "var_x_m2",
                    "var_y_m2",
                    "r_x_m2",
                    "r_y_m2",
                    "innovation_x_m",
                    "innovation_y_m",
                    "nis",
                    "innovation_var_x_m2",
                    "innovation_var_y_m2",
                )
            ),
        ]
    ),
    "truth": pa.schema(
        [
            *_FRAME,
            ("kind", pa.string()),
            *_XYZ,
            *_QUATERNION,
            ("yaw_rad", pa.float64()),
            ("std_m", pa.float64()),
        ]
    ),
}

_NO_POSE = (np.nan,) * 8


def pose_columns(T_map_camera: Pose | None) -> tuple[float, ...]:
    """x_m, y_m, z_m, qx, qy, qz, qw, yaw_rad; NaN without a finite pose."""
    if T_map_camera is None or not T_map_camera.is_finite():
        return _NO_POSE
    return (
        *T_map_camera.translation.tolist(),
        *T_map_camera.quat_xyzw.tolist(),
        T_map_camera.yaw_rad,
    )


class _Table:
    """One parquet file, written a row group at a time."""

    def __init__(self, path: Path, schema: pa.Schema) -> None:
        self._schema = schema
        # Arrow does not close a file of its own that it cannot write to.
        self._file = path.open("wb")
        self._writer = pq.ParquetWriter(self._file, schema, compression="zstd")
        self._rows: list[tuple[Any, ...]] = []

    def add(self, row: tuple[Any, ...]) -> None:
        self._rows.append(row)

    def flush(self) -> None:
        if self._rows:
            columns = zip(*self._rows, strict=True)
            arrays = [
                pa.array(values, field.type)
                for values, field in zip(columns, self._schema, strict=True)
            ]
            self._writer.write_table(pa.Table.from_arrays(arrays, schema=self._schema))
            self._rows.clear()

    def close(self) -> None:
        with self._file:
            try:
                self.flush()
            finally:
                self._writer.close()


class TableWriter:
    """Writes the tables of one replay into a folder; `truth` only where there is any."""

    # Frames in a row group: enough to compress well, little enough to stay small in memory.
    FRAMES_PER_GROUP = 1000

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._tables = {name: self._open(name) for name in ("detections", "poses", "tracks")}
        self._frames = 0

    def _open(self, name: str) -> _Table:
        return _Table(self._folder / f"{name}.parquet", SCHEMAS[name])

    def add(self, result: FrameResult) -> None:
        """One frame's rows."""
        frame = (result.frame_index, result.timestamp_ns)
        add = self._tables["detections"].add
        for marker_id, corners in zip(
            result.detections.ids.tolist(), result.detections.corners_px.tolist(), strict=True
        ):
            for corner, (u_px, v_px) in enumerate(corners):
                add((*frame, marker_id, corner, u_px, v_px))
        fix = result.fix
        self._tables["poses"].add(
            (
                *frame,
                fix.status,
                fix.n_detected,
                fix.n_used,
                fix.n_explained,
                *pose_columns(fix.T_map_camera),
                fix.reprojection_rms_px,
                fix.reprojection_rms_used_px,
                fix.fallback,
            )
        )
        for name, track in result.tracks.items():
            variances = track.P.diagonal().tolist()
            self._tables["tracks"].add(
                (
                    *frame,
                    name,
                    track.updated,
                    *track.x.tolist(),
                    variances[0],
                    variances[2],
                    *track.r_m2.tolist(),
                    *track.innovation_m.tolist(),
                    track.nis,
                    *track.innovation_var_m2.tolist(),
                )
            )
        self._frames += 1
        if self._frames % self.FRAMES_PER_GROUP == 0:
            for table in self._tables.values():
                table.flush()

    def add_truth(self, row: TruthRow) -> None:
        """One row of the truth table."""
        if "truth" not in self._tables:
            self._tables["truth"] = self._open("truth")
        self._tables["truth"].add(
            (row.frame_index, row.timestamp_ns, row.kind, *row.pose_columns(), row.std_m)
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with ExitStack() as stack:
            for table in self._tables.values():
                stack.callback(table.close)
