"""camera.yaml: a calibration in the form of ROS camera_info."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from pipeline.camera import Camera
from recorder.errors import InputError
from recorder.files.yaml_file import FileModel, inline_yaml, parse_yaml, validate


def _number_as_text(value: object) -> object:
    """Cameras are often called 0."""
    return str(value) if isinstance(value, int | float) else value


class _Matrix(FileModel):
    rows: Annotated[int, Field(ge=1)]
    cols: Annotated[int, Field(ge=1)]
    data: list[float]


class _Region(FileModel):
    x_offset: int = 0
    y_offset: int = 0
    height: int = 0
    width: int = 0
    do_rectify: bool = False


class _CameraFile(FileModel):
    image_width: Annotated[int, Field(ge=1)]
    image_height: Annotated[int, Field(ge=1)]
    camera_name: Annotated[str, BeforeValidator(_number_as_text)] = "camera"
    camera_matrix: _Matrix
    distortion_model: str
    distortion_coefficients: _Matrix
    # Written by every ROS tool; a single camera needs neither.
    rectification_matrix: _Matrix | None = None
    projection_matrix: _Matrix | None = None
    binning_x: int = 0
    binning_y: int = 0
    roi: _Region = _Region()
    # What calibration tools note down.
    frame_id: str | None = None
    header: dict[str, Any] | None = None
    calibration_date: Any = None
    avg_reprojection_error: float | None = None


def parse_camera(data: bytes, path: Path) -> Camera:
    """The camera in the bytes of a camera.yaml.

    Args:
        path: where the bytes come from, for the message.

    Raises:
        InputError: not a full-resolution calibration of a known distortion model.
    """
    file = validate(_CameraFile, parse_yaml(data, path), path)
    shapes = (
        ("camera_matrix", file.camera_matrix, (3, 3)),
        ("rectification_matrix", file.rectification_matrix, (3, 3)),
        ("projection_matrix", file.projection_matrix, (3, 4)),
        ("distortion_coefficients", file.distortion_coefficients, None),
    )
    for key, matrix, shape in shapes:
        if matrix is not None:
            _check_shape(matrix, shape, key, path)
    for key, binning in (("binning_x", file.binning_x), ("binning_y", file.binning_y)):
        if binning not in (0, 1):
            raise InputError(
                path, f"expected a calibration of the unbinned image, found {binning}", key
            )
    region = file.roi
    if region.x_offset or region.y_offset or (region.width, region.height) not in (
        (0, 0),
        (file.image_width, file.image_height),
    ):  # fmt: skip
        raise InputError(path, "expected a calibration of the whole image, found a region", "roi")
    try:
        return Camera(
            width_px=file.image_width,
            height_px=file.image_height,
            camera_matrix=np.array(file.camera_matrix.data).reshape(3, 3),
            distortion_model=file.distortion_model,  # type: ignore[arg-type]  # Camera checks it
            dist_coeffs=np.array(file.distortion_coefficients.data),
            name=file.camera_name,
        )
    except ValueError as error:
        raise InputError(path, str(error)) from error


def camera_yaml(camera: Camera) -> bytes:
    """A camera.yaml that `parse_camera` reads back, number for number."""
    k = camera.camera_matrix
    content: dict[str, Any] = {
        "image_width": camera.width_px,
        "image_height": camera.height_px,
        "camera_name": camera.name,
        "camera_matrix": _matrix(k),
        "distortion_model": camera.distortion_model,
        "distortion_coefficients": _matrix(camera.dist_coeffs[None, :]),
        "rectification_matrix": _matrix(np.eye(3)),
        "projection_matrix": _matrix(np.hstack([k, np.zeros((3, 1))])),
    }
    lines = []
    for key, value in content.items():
        if isinstance(value, dict):
            lines += [f"{key}:", *(f"  {inner}: {inline_yaml(v)}" for inner, v in value.items())]
        else:
            lines.append(f"{key}: {inline_yaml(value)}")
    return ("\n".join(lines) + "\n").encode()


def _matrix(values: np.typing.NDArray[np.float64]) -> dict[str, Any]:
    rows, cols = values.shape
    return {"rows": rows, "cols": cols, "data": values.ravel().tolist()}


def _check_shape(matrix: _Matrix, shape: tuple[int, int] | None, key: str, path: Path) -> None:
    if shape is not None and (matrix.rows, matrix.cols) != shape:
        raise InputError(
            path, f"expected {shape[0]}x{shape[1]}, found {matrix.rows}x{matrix.cols}", key
        )
    if len(matrix.data) != matrix.rows * matrix.cols:
        raise InputError(
            path,
            f"expected {matrix.rows * matrix.cols} numbers for {matrix.rows}x{matrix.cols}, "
            f"found {len(matrix.data)}",
            f"{key}.data",
        )
