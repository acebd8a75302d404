"""Solved subsets on disk, so that a run that was stopped goes on where it was."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt

from analysis.static.view import StillView
from pipeline.detection import Detections
from pipeline.geometry import Array
from recorder.files.output_file import write_whole
from replay.versions import versions

FOLDER = "subsets"

Progress = Callable[[int], object]


@dataclass(frozen=True, eq=False)
class Piece:
    """Some subsets' poses: (M, 3) camera position, (M,) the others."""

    positions_m: Array
    yaw_rad: Array
    reprojection_rms_px: Array
    converged: npt.NDArray[np.bool_]


class Store:
    """Solves pieces of subsets, or reads them back where they were solved before.

    A piece's file is named by the SHA-256 of all that decides its content: corners, subsets, map,
    camera, solver, versions and the solver's code.
    """

    def __init__(self, folder: Path | None, view: StillView, solver: str) -> None:
        """`folder` None: nothing is kept."""
        self._folder = folder / FOLDER if folder is not None else None
        self._view = view
        self._solver = solver
        self._base = self._fixed_part() if folder is not None else b""

    def solve(self, seen: Detections, members: npt.NDArray[np.int64], progress: Progress) -> Piece:
        """The poses of the subsets `members` (M, size) of positions in `seen`.

        Args:
            progress: called with how many more of them are done.
        """
        if self._folder is None:
            return self._compute(seen, members, progress)
        key = hashlib.sha256(self._base)
        for array in (seen.ids, seen.corners_px, np.array(members.shape), members):
            key.update(np.ascontiguousarray(array).tobytes())
        path = self._folder / f"{members.shape[1]}-{key.hexdigest()[:24]}.npz"
        found = _read(path, len(members))
        if found is not None:
            progress(len(members))
            return found
        found = self._compute(seen, members, progress)
        self._folder.mkdir(parents=True, exist_ok=True)
        content = io.BytesIO()
        np.savez(content, **vars(found))
        write_whole(path, content.getvalue())
        return found

    def _compute(
        self, seen: Detections, members: npt.NDArray[np.int64], progress: Progress
    ) -> Piece:
        from pipeline import batch_pose

        camera, marker_map = self._view.camera, self._view.marker_map
        if self._solver == "opencv":
            poses = batch_pose.solve_subsets_opencv(
                seen, camera, marker_map, members, progress=progress
            )
        else:
            poses = batch_pose.solve_subsets(seen, camera, marker_map, members, progress=progress)
        return Piece(poses.positions_m, poses.yaw_rad, poses.reprojection_rms_px, poses.converged)

    def _fixed_part(self) -> bytes:
        from pipeline import batch_pose

        camera, marker_map = self._view.camera, self._view.marker_map
        key = hashlib.sha256(self._solver.encode())
        key.update(repr(sorted(versions().items())).encode())
        key.update(repr((camera.image_size, camera.distortion_model)).encode())
        key.update(camera.camera_matrix.tobytes() + camera.dist_coeffs.tobytes())
        for marker_id in marker_map.ids:
            key.update(marker_id.to_bytes(8, "little"))
            key.update(marker_map.by_id[marker_id].corners_m.tobytes())
        code = Path(batch_pose.__file__)
        for file in (code, *sorted((code.parent / "batch").glob("*.py"))):
            key.update(file.read_bytes())
        return key.digest()


def _read(path: Path, count: int) -> Piece | None:
    """A piece as it was written; None where there is none, or it is damaged."""
    try:
        with path.open("rb") as file, np.load(file) as arrays:
            piece = Piece(*(arrays[name] for name in Piece.__dataclass_fields__))
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        return None
    return piece if len(piece.yaw_rad) == count else None
