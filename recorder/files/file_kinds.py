"""Which of the files that people write a file is, where it is given in place of another."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from recorder.errors import InputError


@dataclass(frozen=True)
class _Kind:
    """A kind of file.

    Attributes:
        keys: that no other kind has; known to the model that reads it.
        belongs: where it is given.
    """

    name: str
    keys: frozenset[str]
    belongs: str


_CAMERA = _Kind(
    "a camera calibration",
    frozenset({"image_width", "image_height", "camera_matrix", "distortion_coefficients"}),
    "which belongs to --camera",
)
_KINDS = (
    _CAMERA,
    _Kind("a marker map", frozenset({"dictionary", "markers"}), "which belongs to --map"),
    _Kind(
        "a ground truth",
        frozenset({"method", "path", "poses", "floor", "waypoints"}),
        "which belongs to --truth",
    ),
    _Kind(
        "settings of a replay",
        frozenset({"detector", "pose", "trackers"}),
        "which belong to --settings",
    ),
    _Kind(
        "a scene",
        frozenset({"trajectory", "surface", "rate_hz", "lamps", "occluders"}),
        "which `arucolog record` takes as its source",
    ),
)
# Calibrations in other forms.
_FOREIGN = (
    _Kind(
        "a CameraInfo message",
        frozenset({"d", "k", "D", "K"}),
        "which `arucolog record` reads from a bag itself; `arucolog init` writes a camera.yaml to "
        "put its numbers into",
    ),
    _Kind(
        "a calibration of Kalibr's",
        frozenset({"cam0", "cam1"}),
        "of another form; `arucolog init` writes a camera.yaml to put its numbers into",
    ),
)


def other_kind(data: Any, known: Iterable[str], path: Path) -> InputError | None:
    """The mistake, where `data` is another kind of file than the one that is expected.

    Args:
        data: the content of a file that is not as expected.
        known: all keys of the kind that is expected.
    """
    own = next((kind for kind in _KINDS if kind.keys <= set(known)), None)
    if own is None or not isinstance(data, dict) or own.keys & data.keys():
        return None
    kinds = _KINDS + (_FOREIGN if own is _CAMERA else ())
    likely = max(kinds, key=lambda kind: len(kind.keys & data.keys()))
    if not (found := [key for key in data if key in likely.keys]):
        return None
    return InputError(
        path,
        f"expected {own.name}, found {likely.name} ({', '.join(found[:2])}), {likely.belongs}",
    )
