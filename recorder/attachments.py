"""The files that go into a log beside the frames."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from recorder.errors import InputError
from recorder.files.camera_file import parse_camera
from recorder.files.map_file import parse_map
from recorder.files.truth_file import check_frame, parse_truth, truth_kind
from recorder.files.yaml_file import read_bytes
from recorder.log import topics


def read_attachments(
    camera: Path | None, marker_map: Path | None, truth: Path | None
) -> dict[str, bytes]:
    """The files that a person gives, checked, by their names in a log.

    Raises:
        InputError: one cannot be read or is malformed, or truth and map are in different frames.
    """
    files: dict[str, bytes] = {}
    if camera is not None:
        files[topics.CAMERA_FILE] = read_bytes(camera)
        parse_camera(files[topics.CAMERA_FILE], camera)
    placed = None
    if marker_map is not None:
        files[topics.MAP_FILE] = read_bytes(marker_map)
        placed = parse_map(files[topics.MAP_FILE], marker_map)
    if truth is not None:
        data = read_bytes(truth)
        measured = parse_truth(data, truth)
        if placed is not None:
            check_frame(measured, placed, truth)
        files[f"truth.{truth_kind(data, truth)}"] = data
    return files


@contextmanager
def named_as_given(
    camera: Path | None, marker_map: Path | None, truth: Path | None
) -> Iterator[None]:
    """Errors inside call a file by the path it was given by, not by its name in a log."""
    paths = {topics.CAMERA_FILE: camera, topics.MAP_FILE: marker_map}
    paths |= dict.fromkeys(topics.TRUTH_FILES, truth)
    try:
        yield
    except InputError as error:
        path = paths.get(error.path)
        if path is None:
            raise
        raise InputError(path, error.problem, error.where) from error


def merge_attachments(base: Mapping[str, bytes], given: Mapping[str, bytes]) -> dict[str, bytes]:
    """`base` with what is `given` in its place; there is one truth, whatever its form."""
    replaced = set(given)
    if replaced & set(topics.TRUTH_FILES):
        replaced |= set(topics.TRUTH_FILES)
    kept = {name: data for name, data in base.items() if name not in replaced}
    return {**kept, **given}


def check_image_size(camera_data: bytes, image_size: tuple[int, int], of: str) -> None:
    """A calibration holds for one image size.

    Raises:
        InputError: the images (`of` says whose) have another.
    """
    camera = parse_camera(camera_data, Path(topics.CAMERA_FILE))
    if camera.image_size != image_size:
        raise InputError(
            topics.CAMERA_FILE,
            f"expected a calibration for {image_size[0]}x{image_size[1]}, the images of {of}, "
            f"found one for {camera.width_px}x{camera.height_px}",
        )
