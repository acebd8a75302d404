"""scene.yaml: what the simulated camera sees, and what the log is told about it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeAlias, TypeVar

import numpy as np
import yaml
from pydantic import BeforeValidator, Field, model_validator

from pipeline.camera import Camera, DistortionModel
from pipeline.geometry import Pose
from pipeline.markers import MarkerMap, marker_rotation
from recorder.errors import InputError
from recorder.files.camera_file import camera_yaml, parse_camera
from recorder.files.map_file import parse_map
from recorder.files.truth_file import parse_truth
from recorder.files.yaml_file import FileModel, parse_yaml, read_bytes, shown, validate
from recorder.simulation.installation import InstallationErrors
from recorder.simulation.optics import ImageSettings, Lamp, Occluder, Positive, Print, Surface
from recorder.simulation.quads import Quad, exact_squares, marker_quads, rectangle
from recorder.simulation.trajectory import AnyTrajectory
from recorder.sources.base import SourceEvent

Parsed = TypeVar("Parsed")
# A path relative to the scene, or the content of such a file.
Given: TypeAlias = str | dict[str, Any]


def _file(name: str, *, optional: bool = False) -> BeforeValidator:
    """One message for what is neither a path nor a file's content; a union would give several."""

    def check(value: object) -> object:
        if isinstance(value, str) or (value is None and optional):
            return value
        if isinstance(value, dict) and all(isinstance(key, str) for key in value):
            return value
        raise ValueError(f"expected a path or the content of a {name}, found {shown(value)}")

    return BeforeValidator(check)


class ShortCamera(FileModel):
    """A camera in a few numbers; the principal point is the image's centre unless it is given."""

    width_px: Annotated[int, Field(ge=1)]
    height_px: Annotated[int, Field(ge=1)]
    f_px: Positive | None = None
    diagonal_fov_deg: Annotated[float | None, Field(gt=0, lt=180)] = None
    principal_point_px: Annotated[list[float], Field(min_length=2, max_length=2)] | None = None
    distortion_model: DistortionModel = "plumb_bob"
    dist_coeffs: list[float] | None = None
    name: str = "camera"

    @model_validator(mode="after")
    def _one_focal_length(self) -> Self:
        if (self.f_px is None) == (self.diagonal_fov_deg is None):
            raise ValueError("expected one of f_px and diagonal_fov_deg, found both or none")
        return self

    def camera(self) -> Camera:
        """As a calibration.

        Raises:
            ValueError: a wrong number of coefficients.
        """
        f_px = self.f_px
        if f_px is None:
            half = np.radians((self.diagonal_fov_deg or 0.0) / 2)
            f_px = float(np.hypot(self.width_px, self.height_px) / 2 / np.tan(half))
        cx, cy = self.principal_point_px or ((self.width_px - 1) / 2, (self.height_px - 1) / 2)
        length = 4 if self.distortion_model == "equidistant" else 8
        length = 5 if self.distortion_model == "plumb_bob" else length
        return Camera(
            self.width_px,
            self.height_px,
            np.array([[f_px, 0.0, cx], [0.0, f_px, cy], [0.0, 0.0, 1.0]]),
            self.distortion_model,
            np.array(self.dist_coeffs if self.dist_coeffs is not None else [0.0] * length),
            self.name,
        )


class SceneEvent(FileModel):
    """Something that happens on the way: a waypoint the operator marks, a camera's complaint."""

    t_s: Annotated[float, Field(ge=0, description="seconds of the log")]
    message: Annotated[str, Field(min_length=1)]
    level: Literal["info", "warning", "error"] = "info"


class SceneFile(FileModel):
    """The keys of a scene.yaml.

    `camera`, `map` and `truth` are what the log is told: a path relative to the scene, or the
    content of such a file (`camera` also as a `ShortCamera`). What is true follows from them by
    `errors`, or is given as `true_camera` and `true_map`.
    """

    seed: Annotated[int, Field(ge=0)] = 0
    rate_hz: Positive = 10.0
    frames: Annotated[int | None, Field(ge=1)] = None
    duration_s: Positive | None = None
    start: Annotated[
        int | str | datetime, Field(description="capture of the first frame: ns, or a UTC stamp")
    ] = 0
    camera: Annotated[Given, _file("camera.yaml")]
    map: Annotated[Given, _file("map.yaml")]
    truth: Annotated[Given | None, _file("truth.yaml", optional=True)] = None
    errors: InstallationErrors = InstallationErrors()
    true_camera: Annotated[Given | None, _file("camera.yaml", optional=True)] = None
    true_map: Annotated[Given | None, _file("map.yaml", optional=True)] = None
    trajectory: AnyTrajectory
    image: ImageSettings = ImageSettings()
    surface: Surface = Surface()
    print: Print = Print()
    lamps: list[Lamp] = Field(default=[])
    occluders: list[Occluder] = Field(default=[])
    events: list[SceneEvent] = Field(default=[])
    dropped_frames: list[Annotated[int, Field(ge=1)]] = Field(
        default=[], description="numbers of frames that the camera loses"
    )
    note: Annotated[str, Field(description="what the scene is for")] = ""

    @model_validator(mode="after")
    def _one_of_each(self) -> Self:
        if self.frames is not None and self.duration_s is not None:
            raise ValueError("expected frames or duration_s, found both")
        if self.true_camera is not None and self.errors.of_camera:
            raise ValueError("expected true_camera or errors of the camera, found both")
        if self.true_map is not None and self.errors.of_markers:
            raise ValueError("expected true_map or errors of the markers, found both")
        _ = self.start_ns
        return self

    @property
    def start_ns(self) -> int:
        return _stamp_ns(self.start)


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene, resolved.

    Attributes:
        sha256: of the scene file.
        camera, marker_map: what the log is told.
        true_camera, true_map: what is rendered.
        attachments: `camera.yaml`, `map.yaml` and, where given, `truth.yaml`, as told.
    """

    path: Path
    sha256: str
    file: SceneFile
    camera: Camera
    marker_map: MarkerMap
    true_camera: Camera
    true_map: MarkerMap
    attachments: dict[str, bytes]

    @property
    def frame_count(self) -> int:
        """`frames`, else as many as fit into `duration_s` or the trajectory's duration."""
        if self.file.frames is not None:
            return self.file.frames
        duration_s = self.file.duration_s or self.file.trajectory.duration_s
        return max(1, round((duration_s or 0.0) * self.file.rate_hz))

    def time_s(self, frame_index: int) -> float:
        """Mid-exposure of a frame, from mid-exposure of the first one."""
        return frame_index / self.file.rate_hz

    def timestamp_ns(self, frame_index: int) -> int:
        """Capture stamp of a frame: its mid-exposure."""
        return self.file.start_ns + round(frame_index * 1_000_000_000 / self.file.rate_hz)

    def events(self) -> list[SourceEvent]:
        """What happens on the way, in order."""
        start_ns = self.file.start_ns
        return [
            SourceEvent(start_ns + round(event.t_s * 1e9), event.level, event.message)
            for event in sorted(self.file.events, key=lambda event: event.t_s)
        ]

    def pose(self, t_s: float) -> Pose:
        """The exact T_map_camera."""
        return self.file.trajectory.pose(t_s)

    def quads(self) -> tuple[Quad, ...]:
        """Everything flat that is to be drawn."""
        printed = self.file.print
        markers = marker_quads(self.true_map, printed.quiet_zone_m, printed.paper, printed.ink)
        return markers + tuple(
            rectangle(
                Pose(marker_rotation(np.radians(o.yaw_deg), "up"), np.array(o.xyz_m)),
                o.size_m[0],
                o.size_m[1],
                o.grey,
            )
            for o in self.file.occluders
        )


def load_scene(path: Path) -> Scene:
    """The scene in a file, with the files it names.

    Raises:
        InputError: names the file and the key.
    """
    data = read_bytes(path)
    file = validate(SceneFile, parse_yaml(data, path), path)
    if file.frames is None and file.duration_s is None and file.trajectory.duration_s is None:
        raise InputError(path, "expected frames or duration_s for a static camera, found none")
    attachments = {
        "camera.yaml": _camera_bytes(file.camera, path, "camera"),
        "map.yaml": _bytes(file.map, path),
    }
    camera = _parse(parse_camera, attachments["camera.yaml"], file.camera, path, "camera")
    told_map = _parse(parse_map, attachments["map.yaml"], file.map, path, "map")
    if file.truth is not None:
        attachments["truth.yaml"] = _bytes(file.truth, path)
        _parse(parse_truth, attachments["truth.yaml"], file.truth, path, "truth")
    true_camera = file.errors.apply_to_camera(camera)
    true_map = file.errors.apply_to_map(told_map, file.seed)
    if file.true_camera is not None:
        true_bytes = _camera_bytes(file.true_camera, path, "true_camera")
        true_camera = _parse(parse_camera, true_bytes, file.true_camera, path, "true_camera")
        if true_camera.image_size != camera.image_size:
            width, height = true_camera.image_size
            problem = f"expected the image size of camera, found {width}x{height}"
            raise InputError(path, problem, "true_camera")
    if file.true_map is not None:
        true_bytes = _bytes(file.true_map, path)
        true_map = _parse(parse_map, true_bytes, file.true_map, path, "true_map")
    return Scene(
        path=path,
        sha256=sha256(data).hexdigest(),
        file=file,
        camera=camera,
        marker_map=told_map,
        true_camera=true_camera,
        true_map=exact_squares(true_map),
        attachments=attachments,
    )


def shipped_scenes() -> dict[str, Path]:
    """The scenes that come with the program, by name."""
    folder = Path(__file__).parent / "scenes"
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def _bytes(given: Given, scene: Path) -> bytes:
    """The bytes of the file that is named, or of the content that is given, as a file."""
    if isinstance(given, str):
        return read_bytes(scene.parent / given)
    text: str = yaml.safe_dump(given, sort_keys=False, default_flow_style=None, width=200)
    return text.encode()


def _camera_bytes(given: Given, scene: Path, key: str) -> bytes:
    if isinstance(given, str) or "image_width" in given or "camera_matrix" in given:
        return _bytes(given, scene)
    try:
        return camera_yaml(validate(ShortCamera, given, scene).camera())
    except InputError as error:
        raise _inside(error, scene, key) from error
    except ValueError as error:
        raise InputError(scene, str(error), key) from error


def _parse(
    parse: Callable[[bytes, Path], Parsed],
    data: bytes,
    given: Given,
    scene: Path,
    key: str,
) -> Parsed:
    if isinstance(given, str):
        return parse(data, scene.parent / given)
    try:
        return parse(data, scene)
    except InputError as error:
        raise _inside(error, scene, key) from error


def _inside(error: InputError, scene: Path, key: str) -> InputError:
    """The same error with the key of the scene in front."""
    where = error.where
    if where and not where.startswith("line "):
        return InputError(scene, error.problem, f"{key}.{where}")
    return InputError(scene, error.problem, key)


def _stamp_ns(start: int | str | datetime) -> int:
    """Nanoseconds since the Unix epoch; a time without a zone is UTC.

    Raises:
        ValueError: not a time.
    """
    if isinstance(start, int):
        return start
    if isinstance(start, str):
        try:
            start = datetime.fromisoformat(start)
        except ValueError as error:
            raise ValueError(
                f"expected start in nanoseconds or as 2025-01-31T12:00:00Z, found {start!r}"
            ) from error
    if start.tzinfo is None:
        start = start.replace(tzinfo=UTC)
    since = start - datetime(1970, 1, 1, tzinfo=UTC)
    return (since.days * 86_400 + since.seconds) * 1_000_000_000 + since.microseconds * 1_000
