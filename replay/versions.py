"""The versions that decide what a replay computes."""

from __future__ import annotations

import platform
from importlib import metadata

_PACKAGES = ("arucolog", "opencv-contrib-python-headless", "numpy", "filterpy", "mcap", "rerun-sdk")


def versions() -> dict[str, str]:
    """Version by package, and Python's."""
    return {
        **{name: metadata.version(name) for name in _PACKAGES},
        "python": platform.python_version(),
    }
