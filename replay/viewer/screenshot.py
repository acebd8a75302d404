"""Pictures of recordings without a screen, and what the viewer complains about."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from rerun.experimental import ViewerClient

from recorder.errors import InputError
from replay.viewer import style
from replay.viewer.program import has_graphics, viewer_program

_TIMEOUT_S = 90.0
_PAUSE_S = 0.5
_SETTLE_S = 10.0

# Said on every machine without a graphics card, and nothing about the recording.
_HARMLESS = re.compile(
    r"software rasterizer|poor performance|Failed to load examples|XDG_RUNTIME_DIR|Docker", re.I
)


def screenshot(
    rrd: Path, png: Path, *, at_frame: int | None = None, size: tuple[int, int] = (1600, 1000)
) -> list[str]:
    """Opens a recording in the headless viewer, saves a picture, and returns reported problems.

    Args:
        at_frame: the frame to show; None: the first.
        size: width and height of the picture in pixels.

    Raises:
        InputError: there is no graphics driver, or the viewer gives no steady picture.
    """
    if not has_graphics():
        raise InputError(
            rrd, "no Vulkan driver to draw it; on Debian: apt-get install mesa-vulkan-drivers"
        )
    deadline = time.monotonic() + _TIMEOUT_S
    with headless_viewer(size, deadline, rrd) as (viewer, _):
        viewer.open(str(rrd.resolve()))
        while viewer.get_state().loading:
            _pause(deadline, rrd)
        if at_frame is not None:
            viewer.set_time(style.FRAME, sequence=at_frame, play_state="paused")
        before, picture = b"", viewer.take_screenshot()
        # Translucent bands may come in another order each time: after a while any will do.
        settled = min(deadline, time.monotonic() + _SETTLE_S)
        while picture != before and time.monotonic() < settled:
            _pause(deadline, rrd)
            before, picture = picture, viewer.take_screenshot()
        png.write_bytes(picture)
        reports = [
            f"{view.name}: {report.severity}: {report.summary}"
            for view in viewer.get_state().views
            for report in view.reports
        ]
        logs = [
            f"{entry.level}: {entry.message}"
            for entry in viewer.get_logs()
            if entry.level in ("WARN", "ERROR") and not _HARMLESS.search(entry.message)
        ]
    return reports + logs


@contextmanager
def headless_viewer(
    size: tuple[int, int], deadline: float, rrd: Path
) -> Iterator[tuple[ViewerClient, int]]:
    """A viewer without a window and its free local port; it keeps nothing in the user's home.

    `deadline`: by `time.monotonic`; `rrd`: what errors are about.
    """
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [str(viewer_program()), "--headless", "--bind", "127.0.0.1", "--port", str(port)]
    command += ["--window-size", f"{size[0]}x{size[1]}", "--hide-welcome-screen"]
    with tempfile.TemporaryDirectory() as home:
        places = dict.fromkeys(("HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME"), home)
        # With CI set, the viewer sends no analytics.
        env = {**os.environ, **places, "XDG_RUNTIME_DIR": home, "CI": "true"}
        # `rerun` is a script that starts the viewer: a group of their own, to end them together.
        process = subprocess.Popen(
            command,
            env=env,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            yield _connect(port, process, deadline, rrd), port
        finally:
            _stop(process)


def _stop(process: subprocess.Popen[bytes]) -> None:
    """Ends a process and what it has started; the script may be gone before the viewer."""
    for sign in (signal.SIGTERM, signal.SIGKILL):
        with suppress(ProcessLookupError):
            os.killpg(process.pid, sign)
        with suppress(subprocess.TimeoutExpired):
            process.wait(5.0)


def _connect(
    port: int, process: subprocess.Popen[bytes], deadline: float, rrd: Path
) -> ViewerClient:
    while True:
        if process.poll() is not None:
            raise InputError(rrd, f"the headless viewer ended with code {process.returncode}")
        try:
            with socket.create_connection(("127.0.0.1", port), 1.0):
                return ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
        except OSError:
            _pause(deadline, rrd)


def _pause(deadline: float, rrd: Path) -> None:
    if time.monotonic() > deadline:
        raise InputError(rrd, f"the headless viewer gave no steady picture in {_TIMEOUT_S:.0f} s")
    time.sleep(_PAUSE_S)
