"""The verb `cameras`, and the options of a camera for verbs that record."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from recorder.sources.live.settings import CameraSettings

_Value = TypeVar("_Value")

_OPTIONS = (
    ("--size", "size", "WxH", "Of the camera's images, such as 1920x1080."),
    ("--rate", "rate", "RATE", "Frames a second of the camera, such as 30."),
    ("--exposure", "exposure", "TIME|auto", "Of the camera, such as 5ms."),
    ("--focus", "focus", "N|auto", "Of the camera, in its own numbers, mostly 0 for far."),
    ("--white-balance", "white_balance", "K|auto", "Of the camera, in kelvin, such as 4500."),
)


@click.command(
    epilog="""\b
Example:
  arucolog cameras --json
"""
)
@click.option("--json", "as_json", is_flag=True, help="Everything as JSON.")
def cameras(as_json: bool) -> None:
    """List the cameras of this machine with their modes and settings."""
    import json

    from recorder.sources.live.listing import found_cameras, listing_text

    found = found_cameras()
    if as_json:
        click.echo(json.dumps([camera.as_dict() for camera in found], indent=2))
    else:
        click.echo(listing_text(found))


def camera_options(command: Callable[..., None]) -> Callable[..., None]:
    """Adds the options that set a camera; the command gets them as `camera_settings`."""

    @wraps(command)
    def with_settings(**given: Any) -> None:
        texts = {key: given.pop(key) for _, key, _, _ in _OPTIONS}
        command(**given, camera_settings=_settings(**texts))

    for name, key, metavar, text in reversed(_OPTIONS):
        with_settings = click.option(name, key, metavar=metavar, help=text)(with_settings)
    return with_settings


def _settings(
    size: str | None,
    rate: str | None,
    exposure: str | None,
    focus: str | None,
    white_balance: str | None,
) -> CameraSettings:
    from recorder.sources.live import settings

    return settings.CameraSettings(
        _parsed("--size", settings.parse_size, size),
        _parsed("--rate", settings.parse_rate, rate),
        _parsed("--exposure", settings.parse_exposure, exposure),
        _parsed("--focus", settings.parse_number_or_auto, focus),
        _parsed("--white-balance", settings.parse_number_or_auto, white_balance),
    )


def _parsed(name: str, parse: Callable[[str], _Value], text: str | None) -> _Value | None:
    if text is None:
        return None
    try:
        return parse(text)
    except ValueError as error:
        raise click.BadParameter(str(error), param_hint=name) from error
