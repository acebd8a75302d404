"""The Rerun viewer of this environment."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

from recorder.errors import InputError

# Where Vulkan's loader looks for drivers on Linux.
_DRIVER_FOLDERS = ("/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d", "/usr/local/share/vulkan/icd.d")


def viewer_program() -> Path:
    """The viewer's executable.

    Raises:
        InputError: it is not there.
    """
    name = "rerun.exe" if sys.platform == "win32" else "rerun"
    beside = Path(sys.executable).parent / name
    found = str(beside) if beside.exists() else shutil.which(name)
    if found is None:
        raise InputError(beside, "expected the Rerun viewer, found none; pip install rerun-sdk")
    return Path(found)


def has_display() -> bool:
    """Whether a window can open here."""
    if not sys.platform.startswith("linux"):
        return True
    return any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def has_graphics() -> bool:
    """Whether the headless viewer can draw here; on Linux it needs a Vulkan driver."""
    if not sys.platform.startswith("linux"):
        return True
    return any(any(Path(folder).glob("*.json")) for folder in _DRIVER_FOLDERS)
