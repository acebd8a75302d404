"""How long the whole reproduction of the paper takes."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest

from analysis.paper.site import SEEDS
from tests.bench.page import report

pytestmark = pytest.mark.bench


def test_the_paper_in_ten_minutes(tmp_path: Path) -> None:
    started = time.perf_counter()
    page = tmp_path / "paper.md"
    subprocess.run([sys.executable, "-m", "analysis.paper", "-o", str(page)], check=True)
    seconds = time.perf_counter() - started
    report(
        "The paper's experiments",
        f"`make paper`, {SEEDS} seeds of both configurations: **{seconds:.0f} s** (at most 600).",
    )
    assert seconds < 600
