"""The headless viewer opens what we write, draws it, and complains about nothing."""

from __future__ import annotations

import subprocess
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import cv2
import pytest

from pipeline.localizer import PipelineSettings
from replay.run import ReplayOptions, replay
from replay.viewer import scene
from replay.viewer.layout import eye_on, log_layout
from replay.viewer.open import view
from replay.viewer.output import RecordingFile
from replay.viewer.program import has_graphics
from replay.viewer.screenshot import screenshot
from tests import worlds

pytestmark = pytest.mark.skipif(not has_graphics(), reason="no Vulkan driver")

SETTINGS = PipelineSettings.model_validate(
    {
        "trackers": {
            "adaptive": {"variance": {"kind": "table"}},
            "max": {"variance": {"kind": "static", "statistic": "max"}},
        }
    }
)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A log alone, one result, and two results over each other."""
    folder = tmp_path_factory.mktemp("pictures")
    log = worlds.small_log(folder / "drive.mcap")
    two = SETTINGS.model_copy(update={"pose": SETTINGS.pose.model_copy(update={"max_markers": 2})})
    options = ReplayOptions(settings=SETTINGS, progress=False)
    replay(log, folder / "all", "all", options)
    replay(log, folder / "two", "two", ReplayOptions(settings=two, progress=False))
    view([log], save=folder / "log.rrd")
    view([folder / "all", folder / "two"], save=folder / "overlay.rrd")
    return {
        "log": folder / "log.rrd",
        "result": folder / "all" / "replay.rrd",
        "overlay": folder / "overlay.rrd",
    }


@pytest.mark.parametrize("kind", ["log", "result", "overlay"])
def test_the_viewer_draws_it_without_complaint(
    recordings: dict[str, Path], kind: str, tmp_path: Path
) -> None:
    picture = tmp_path / "picture.png"
    problems = screenshot(recordings[kind], picture, at_frame=8, size=(1280, 800))
    assert problems == []
    image = cv2.imread(str(picture))
    assert image is not None
    assert image.shape == (800, 1280, 3)
    # The drawn camera image is bright and takes a good part of an otherwise dark window.
    assert 0.03 < (image.min(axis=2) > 200).mean() < 0.5


def test_a_broken_image_is_a_complaint(tmp_path: Path) -> None:
    file = RecordingFile(tmp_path / "broken.rrd", "id", "broken")
    scene.set_time(file.stream, 0, 0)
    scene.log_image(file.stream, b"\xff\xd8 and nothing more", "jpeg")
    file.stream.send_blueprint(log_layout(eye_on(aspect=1.0), has_pose=False, has_scene=False))
    file.close()
    assert screenshot(tmp_path / "broken.rrd", tmp_path / "picture.png") != []


def _session_lives(session: int) -> bool:
    """Whether a process of a session runs, where the system lists processes as files."""
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            state, _, _, its_session = path.read_text().rpartition(")")[2].split()[:4]
            if int(its_session) == session and state not in "ZX":
                return True
    return False


def test_no_viewer_stays_behind(
    recordings: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[subprocess.Popen[bytes]] = []

    class Popen(subprocess.Popen[bytes]):
        def __init__(self, *args: Any, **more: Any) -> None:
            super().__init__(*args, **more)
            started.append(self)

    monkeypatch.setattr(subprocess, "Popen", Popen)
    screenshot(recordings["log"], tmp_path / "picture.png")
    (viewer,) = started
    deadline = time.monotonic() + 5.0
    while _session_lives(viewer.pid) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not _session_lives(viewer.pid)
