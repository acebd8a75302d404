"""The cameras of this machine."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from recorder.sources.live.device import ONLY_PLANES, controls, devices
from recorder.sources.live.v4l2 import Device, Ioctl, Mode


@dataclass(frozen=True)
class FoundCamera:
    """A device that gives images.

    Attributes:
        controls: what can be set and is: `exposure`, `focus`, `white_balance`.
        problem: why nothing more is known.
    """

    device: str
    name: str
    bus: str
    driver: str
    modes: tuple[Mode, ...]
    controls: dict[str, str]
    problem: str | None = None

    def as_dict(self) -> dict[str, Any]:
        return asdict(self)


def found_cameras(
    paths: Iterable[Path] | None = None, ioctl: Ioctl | None = None
) -> list[FoundCamera]:
    """Every device that gives images, also one that cannot be opened."""
    found = []
    for path in devices() if paths is None else paths:
        try:
            with Device(path, ioctl) as device:
                names = (device.card, device.bus, device.driver)
                if device.captures:
                    modes = tuple(device.modes())
                    found.append(FoundCamera(str(path), *names, modes, controls(device)))
                elif device.only_planes:
                    found.append(FoundCamera(str(path), *names, (), {}, ONLY_PLANES))
        except OSError as error:
            problem = (error.strerror or str(error)).lower()
            found.append(FoundCamera(str(path), "", "", "", (), {}, problem))
    return found


def listing_text(found: Sequence[FoundCamera]) -> str:
    """For people."""
    if not found:
        return "no camera found: /dev has no video device that gives images"
    return "\n".join(line for camera in found for line in _lines(camera))


def _lines(camera: FoundCamera) -> Iterable[str]:
    if camera.problem:
        yield f"{camera.device}: {camera.problem}"
        return
    yield f"{camera.device}: {camera.name} ({camera.driver}, {camera.bus})"
    width = max((len(mode.pixel_format) for mode in camera.modes), default=0)
    for mode in camera.modes:
        rates = ", ".join(f"{rate:g}" for rate in mode.rates_hz)
        size = f"{mode.width_px}x{mode.height_px}"
        yield f"  {mode.pixel_format:<{width}} {size:>9}" + (
            f"  at {rates} frames/s" if rates else ""
        )
    for name, value in camera.controls.items():
        yield f"  {name.replace('_', ' ')}: {value}"
