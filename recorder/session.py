"""What a log says about the software and the machine that recorded it."""

from __future__ import annotations

import hashlib
import platform
import subprocess
from importlib import metadata
from pathlib import Path

import cv2

from recorder.log.topics import LOG_FORMAT
from recorder.sources.base import Source

_ROOT = Path(__file__).resolve().parents[1]


def session_metadata(source: Source) -> dict[str, str]:
    """Versions, host and source; nothing that differs when a file is recorded again."""
    build = hashlib.sha256(cv2.getBuildInformation().encode()).hexdigest()
    values = {
        "log_format": LOG_FORMAT,
        "software": f"arucolog {_version()}",
        "git": git_state(),
        "opencv": cv2.__version__,
        "opencv_build": build[:16],
        "python": platform.python_version(),
        "host": platform.node(),
        "platform": platform.platform(),
        "source": source.name,
    }
    return values | {f"source.{key}": value for key, value in source.describe().items()}


def git_state(root: Path = _ROOT) -> str:
    """The commit of the checkout this runs from, `+changes` where it was edited; else `none`."""
    # An installed copy may lie inside somebody else's repository.
    if not (root / ".git").exists():
        return "none"
    commit = _git(root, "rev-parse", "HEAD")
    if not commit:
        return "none"
    return f"{commit}+changes" if _git(root, "status", "--porcelain") else commit


def _git(root: Path, *arguments: str) -> str:
    try:
        done = subprocess.run(
            ["git", "-C", str(root), *arguments], capture_output=True, text=True, timeout=10
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def _version() -> str:
    try:
        return metadata.version("arucolog")
    except metadata.PackageNotFoundError:
        return "unknown"
