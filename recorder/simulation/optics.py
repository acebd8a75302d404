"""What the picture looks like: the settings of sensor, light and surroundings in a scene."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from recorder.files.yaml_file import FileModel
from recorder.simulation.quads import INK, PAPER
from recorder.simulation.texture import TextureKind

NotNegative = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
Share = Annotated[float, Field(ge=0, le=1)]
Vector2 = Annotated[list[float], Field(min_length=2, max_length=2)]
Vector3 = Annotated[list[float], Field(min_length=3, max_length=3)]


class ImageSettings(FileModel):
    """Lens, sensor and compression."""

    exposure_s: NotNegative = 0.0
    blur_px: Annotated[float, Field(ge=0, le=50, description="sigma of the optical blur")] = 0.0
    noise_std: Annotated[float, Field(ge=0, le=128, description="grey levels")] = 0.0
    brightness: Annotated[float, Field(gt=0, description="grey level of white over 255")] = 1.0
    vignetting: Annotated[Share, Field(description="share of the cos^4 law")] = 0.0
    uneven_light: Annotated[Share, Field(description="share by which the light varies")] = 0.0
    encoding: Literal["jpeg", "png"] = "jpeg"
    jpeg_quality: Annotated[int, Field(ge=1, le=100)] = 90


class Surface(FileModel):
    """The ceiling or floor: a horizontal plane in the map."""

    height_m: float = 0.0
    grey: Annotated[Share, Field(description="mean reflectance")] = 0.5
    texture: TextureKind = "plain"
    contrast: Share = 0.05
    pattern_m: Annotated[float, Field(ge=0.02, le=10, description="side of a tile or square")] = 0.6


class Lamp(FileModel):
    """A round light on the surface, with the glare it spreads in the lens."""

    xy_m: Vector2
    height_m: Annotated[float | None, Field(description="default: the surface's")] = None
    radius_m: Positive = 0.1
    intensity: Annotated[float, Field(gt=0, description="1 just saturates")] = 3.0
    halo_m: NotNegative = 0.5
    halo: Annotated[NotNegative, Field(description="light added at the lamp; 1 saturates")] = 0.3


class Occluder(FileModel):
    """A grey horizontal rectangle that hides what is behind it: a beam, a pipe, a leaf."""

    xyz_m: Vector3
    size_m: Annotated[list[Positive], Field(min_length=2, max_length=2)]
    yaw_deg: float = 0.0
    grey: Share = 0.3


class Print(FileModel):
    """How the markers are printed."""

    quiet_zone_m: Annotated[
        NotNegative | None, Field(description="paper around the square; default: one cell")
    ] = None
    paper: Annotated[Share, Field(description="reflectance")] = PAPER
    ink: Share = INK
