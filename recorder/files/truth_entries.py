"""The shape of a truth.yaml, key by key, and writing one."""

from __future__ import annotations

import math
import re
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field, model_validator

from recorder.bench.floor import Floor
from recorder.files.yaml_file import FileModel, inline_yaml

Positive = Annotated[float, Field(gt=0)]
Point = Annotated[list[float], Field(min_length=2, max_length=2)]

# One word, as it is typed at the keys and stands in the log's events.
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,19}")


def check_name(name: object) -> str:
    """A waypoint's name as text.

    Raises:
        ValueError: neither a whole number nor one word.
    """
    if isinstance(name, bool | float) or not _NAME.fullmatch(str(name)):
        raise ValueError(
            "expected a whole number or one word of letters, digits and _ . - as the name, "
            f"found {name!r}"
        )
    return str(name)


Name = Annotated[str, BeforeValidator(check_name)]


class FloorEntry(FileModel):
    """`floor:`, for waypoints that are given by row and column."""

    square_m: Positive
    origin_m: Point = Field(default=[0.0, 0.0])
    yaw_deg: float = 0.0
    z_m: float | None = None

    def floor(self) -> Floor:
        x_m, y_m = self.origin_m
        return Floor(self.square_m, (x_m, y_m), math.radians(self.yaw_deg), self.z_m)


class PathEntry(FileModel):
    """`path:`, driven and not timed."""

    points_m: Annotated[list[Point], Field(min_length=2)]
    closed: bool = False
    std_m: Positive


class PoseEntry(FileModel):
    """One of `poses:`, stood at from one second of the log to another."""

    name: Name | None = None
    from_s: Annotated[float, Field(ge=0)]
    to_s: float
    x_m: float
    y_m: float
    z_m: float | None = None
    yaw_deg: float | None = None
    std_m: Positive

    @model_validator(mode="after")
    def _span(self) -> Self:
        if self.to_s <= self.from_s:
            raise ValueError(f"expected to_s after from_s ({self.from_s}), found {self.to_s}")
        return self


class WaypointEntry(FileModel):
    """One of `waypoints:`, in metres of the map or in rows and columns of the floor."""

    name: Name
    x_m: float | None = None
    y_m: float | None = None
    yaw_deg: float | None = None
    row: float | None = None
    col: float | None = None
    heading_deg: float | None = None
    z_m: float | None = None
    std_m: Positive

    @property
    def on_floor(self) -> bool:
        return self.row is not None

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        keys = ("x_m", "y_m", "yaw_deg", "row", "col", "heading_deg")
        found = {key for key in keys if getattr(self, key) is not None}
        if found - {"yaw_deg"} != {"x_m", "y_m"} and found - {"heading_deg"} != {"row", "col"}:
            raise ValueError(
                "expected x_m, y_m and perhaps yaw_deg, or row, col and perhaps heading_deg, "
                f"found {', '.join(key for key in keys if key in found) or 'none of them'}"
            )
        return self


class TruthFile(FileModel):
    """A whole truth.yaml."""

    frame: Annotated[str, Field(min_length=1)] = "map"
    method: str = ""
    path: PathEntry | None = None
    poses: list[PoseEntry] = Field(default=[])
    floor: FloorEntry | None = None
    waypoints: list[WaypointEntry] = Field(default=[])


def truth_yaml(file: TruthFile, comment: str = "") -> bytes:
    """A truth.yaml with what is set, one pose or waypoint a line."""
    lines = [f"# {line}" for line in comment.splitlines()]
    lines += [f"frame: {inline_yaml(file.frame)}", f"method: {inline_yaml(file.method)}"]
    for key in ("path", "floor"):
        entry: FileModel | None = getattr(file, key)
        if entry is not None:
            lines.append(f"{key}: {inline_yaml(_set_values(entry))}")
    entries: dict[str, list[PoseEntry] | list[WaypointEntry]] = {
        "poses": file.poses,
        "waypoints": file.waypoints,
    }
    for key, values in entries.items():
        if values:
            lines.append(f"{key}:")
            lines += [f"  - {inline_yaml(_set_values(value))}" for value in values]
    return ("\n".join(lines) + "\n").encode()


def _set_values(entry: FileModel) -> dict[str, Any]:
    values = entry.model_dump(exclude_none=True)
    name = values.get("name", "")
    # A number looks better than a number in quotes; 007 is another name than 7.
    return values | ({"name": int(name)} if name.isdecimal() and str(int(name)) == name else {})
