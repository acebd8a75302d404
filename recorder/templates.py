"""Commented files to start from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from pipeline.markers import load_dictionary
from recorder.errors import InputError
from recorder.files.output_file import write_whole
from recorder.files.yaml_file import read_bytes

_FOLDER = Path(__file__).resolve().parent / "template_files"

_MAP_HEAD = """\
# Where the markers are: {rows} x {cols} on a ceiling, {pitch} m apart. Measure yours and edit.
frame: map                     # x, y in the floor plane, z up, metres
dictionary: {dictionary}
size_m: {size}{pad}# side of the black square; a marker may override it
inverted: false                # true: printed white on black

# Each marker is placed in one of three ways:
#   {{id: 0, xyz_m: [1.0, 0.5, 2.5], yaw_deg: 0, facing: down}}     flat on a ceiling; up: a floor
#   {{id: 1, xyz_m: [1.0, 0.5, 1.2], quat_xyzw: [0.5, 0.5, 0.5, 0.5]}}               in any pose
#   {{id: 2, corners_m: [[x, y, z], [x, y, z], [x, y, z], [x, y, z]]}}       by its four corners:
#     top left, top right, bottom right, bottom left of the print
# A marker's own frame: x to its right, y up, z out of the print. yaw_deg is the angle of its x axis
# in the map's xy plane. Optional on any marker: size_m; std_m, the uncertainty of its position;
# tags: [inner, rot90], groups for analysis.
markers:
"""


@dataclass(frozen=True)
class CeilingGrid:
    """Markers in rows along map x, ids counted row by row, all with yaw 0."""

    rows: int = 3
    cols: int = 4
    pitch_m: float = 1.0
    height_m: float = 2.5
    size_m: float = 0.15
    dictionary: str = "DICT_6X6_1000"

    def __post_init__(self) -> None:
        """ValueError where it cannot be built."""
        available = len(load_dictionary(self.dictionary).bytesList)
        if not 0 < self.rows * self.cols <= available:
            raise ValueError(
                f"expected 1 to {available} markers of {self.dictionary}, "
                f"found {self.rows} x {self.cols}"
            )
        if not all(map(math.isfinite, (self.pitch_m, self.height_m, self.size_m))):
            raise ValueError("expected finite lengths, found an infinite one or NaN")
        if not 0 < self.size_m < self.pitch_m:
            raise ValueError(
                f"expected markers smaller than their pitch {self.pitch_m:g} m, "
                f"found {self.size_m:g} m"
            )

    def yaml(self) -> bytes:
        """A commented map.yaml."""
        size = f"{self.size_m:g}"
        head = _MAP_HEAD.format(
            rows=self.rows,
            cols=self.cols,
            pitch=f"{self.pitch_m:g}",
            dictionary=self.dictionary,
            size=size,
            pad=" " * max(1, 23 - len(size)),
        )
        lines = []
        for i in range(self.rows * self.cols):
            row, col = divmod(i, self.cols)
            xyz_m = [col * self.pitch_m, row * self.pitch_m, self.height_m]
            xyz = ", ".join(repr(round(value, 6)) for value in xyz_m)
            lines.append(f"  - {{id: {i}, xyz_m: [{xyz}], yaw_deg: 0, facing: down}}\n")
        return (head + "".join(lines)).encode()


def write_templates(folder: Path, grid: CeilingGrid, *, force: bool = False) -> list[Path]:
    """camera.yaml, map.yaml, truth.yaml and settings.yaml; all of them or none.

    Raises:
        InputError: one exists already and `force` is not given.
    """
    contents = {
        folder / "camera.yaml": read_bytes(_FOLDER / "camera.yaml"),
        folder / "map.yaml": grid.yaml(),
        folder / "truth.yaml": read_bytes(_FOLDER / "truth.yaml"),
        folder / "settings.yaml": read_bytes(_FOLDER / "settings.yaml"),
    }
    for path in contents:
        if path.exists() and not force:
            raise InputError(path, "expected no such file yet, found one (--force replaces it)")
    if folder.exists() and not folder.is_dir():
        raise InputError(folder, "expected a folder, found a file")
    folder.mkdir(parents=True, exist_ok=True)
    for path, data in contents.items():
        write_whole(path, data)
    return list(contents)
