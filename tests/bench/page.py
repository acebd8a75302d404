"""docs/benchmarks.md, written by the benchmarks themselves."""

from __future__ import annotations

import os
import platform
import re
from importlib import metadata
from pathlib import Path

PAGE = Path(__file__).resolve().parents[2] / "docs" / "benchmarks.md"
_HEAD = """\
# Benchmarks

Written by `make bench`; ratios within one run say more than times, which depend on the machine.
"""


def report(title: str, text: str) -> None:
    """Replaces the section `title` of the page, and prints it."""
    print(f"\n{text}")
    page = PAGE.read_text() if PAGE.exists() else _HEAD
    machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    versions = f"OpenCV {metadata.version('opencv-contrib-python-headless')}"
    section = f"## {title}\n\n{text.strip()}\n\n({machine}, {versions})\n"
    pattern = rf"## {re.escape(title)}\n.*?(?=\n## |\Z)"
    if re.search(pattern, page, flags=re.S):
        page = re.sub(pattern, lambda _: section, page, flags=re.S)
    else:
        page = f"{page.rstrip()}\n\n{section}"
    PAGE.write_text(page)
