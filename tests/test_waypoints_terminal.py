"""Waypoint keys in a real terminal: what comes into the log, and the terminal afterwards."""

from __future__ import annotations

import io
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from recorder.bench import keyboard
from recorder.bench.session import waypoint_keys
from recorder.log.reader import LogReader
from recorder.log.records import LogEvent
from recorder.sources.live.http_mjpeg import http_camera
from tests.conftest import ROOT
from tests.log_helpers import png
from tests.mjpeg_server import MjpegServer, Script
from tests.terminals import Terminal

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no terminals of this kind")

RATE_HZ = 40.0
TRUTH = (
    "waypoints:\n"
    "  - {name: 1, x_m: 0, y_m: 0, std_m: 0.01}\n"
    "  - {name: A2, x_m: 1, y_m: 0, std_m: 0.01}\n"
)


@contextmanager
def recording(tmp_path: Path, *options: str, columns: int = 120) -> Iterator[Terminal]:
    """`record` in a terminal, with the first images there."""
    (tmp_path / "truth.yaml").write_text(TRUTH)
    with MjpegServer(Script(rate_hz=RATE_HZ)) as server:
        log = ["-o", str(tmp_path / "x.mcap"), "--truth", str(tmp_path / "truth.yaml")]
        command = ["-m", "arucolog", "record", server.url, *log, "--min-free", "1MB", *options]
        with Terminal(command, columns=columns) as terminal:
            terminal.wait_for("record [0-9:]+, [1-9][0-9]* at")
            yield terminal


def events(tmp_path: Path) -> list[LogEvent]:
    with LogReader(tmp_path / "x.mcap") as log:
        return [r for r in log.records() if isinstance(r, LogEvent) and r.name == "operator"]


def test_keys_come_into_the_log_and_ctrl_c_gives_the_terminal_back(tmp_path: Path) -> None:
    with recording(tmp_path) as terminal:
        assert not terminal.echoes
        terminal.wait_for("no waypoint yet")
        begun_ns = time.time_ns()
        terminal.press("12\x7f\r")
        terminal.wait_for("arrived at 1 at")
        arrived_ns = time.time_ns()
        terminal.press("s")
        terminal.wait_for("standing still at 1 from")
        time.sleep(0.3)
        terminal.press("s")
        terminal.wait_for(r"standing still at 1 from [0-9.]+ to")
        terminal.press("n")
        terminal.wait_for("arrived at A2")
        terminal.press("u")
        terminal.wait_for("undone: arrived at A2")
        terminal.press("tdoor\x1b")
        terminal.press("[A open\r")
        terminal.wait_for("note: door open")
        terminal.wait_for("at 1, last mark standing still at 1")
        terminal.press("\x03")
        assert terminal.wait() == 0
        assert terminal.modes == terminal.before
        assert terminal.echoes
    found = events(tmp_path)
    texts = [event.message for event in found]
    start, end = texts[1].rpartition(" ")[2], texts[2].rpartition(" ")[2]
    undone_at = texts[4].rpartition(" ")[2]
    assert texts == [
        "arrived at 1",
        f"standing still at 1 from {start}",
        f"standing still at 1 from {start} to {end}",
        "arrived at A2",
        f"undone: arrived at A2 at {undone_at}",
        "note: door open",
    ]
    assert 0.3 <= float(end) - float(start) < 2.0
    # The server's frames have no stamps: capture is arrival, by the clock of the keys.
    assert begun_ns < found[0].timestamp_ns < arrived_ns
    with LogReader(tmp_path / "x.mcap") as log:
        assert log.start_ns is not None
        assert f"{(found[3].timestamp_ns - log.start_ns) / 1e9:.3f}" == undone_at


def test_a_request_to_terminate_gives_the_terminal_back_and_ends_the_standing(
    tmp_path: Path,
) -> None:
    with recording(tmp_path) as terminal:
        terminal.press("n")
        terminal.wait_for("arrived at 1 at")
        terminal.press("s")
        terminal.wait_for("standing still at 1")
        time.sleep(0.2)
        terminal.signal(signal.SIGTERM)
        terminal.wait()
        assert terminal.modes == terminal.before
    last = events(tmp_path)[-1]
    with LogReader(tmp_path / "x.mcap") as log:
        stamps = [r.timestamp_ns for r in log.records() if not isinstance(r, LogEvent)]
        end_s = (stamps[-1] - stamps[0]) / 1e9
    assert last.message.startswith("standing still at 1 from ")
    assert float(last.message.rpartition(" to ")[2]) == pytest.approx(end_s, abs=1.5 / RATE_HZ)


@pytest.mark.parametrize("columns", [80, 0])
def test_what_is_counted_has_room(tmp_path: Path, columns: int) -> None:
    """Also where a terminal does not tell how wide it is."""
    with recording(tmp_path, "--live", "127.0.0.1:9", columns=columns) as terminal:
        terminal.wait_for(r"dropped 0, late \d+, corrupt 0, not shown [1-9]\d*")
        terminal.press("\x03")
        assert terminal.wait() == 0


def test_stopped_before_its_time_is_a_failure(tmp_path: Path) -> None:
    with recording(tmp_path, "--no-keys", "--duration", "1h") as terminal:
        terminal.press("\x03")
        assert terminal.wait() == 130
        assert "Interrupted. The log is complete up to here." in terminal.text


def test_without_keys_the_terminal_stays_as_it_is(tmp_path: Path) -> None:
    with recording(tmp_path, "--no-keys", columns=60) as terminal:
        assert terminal.echoes
        terminal.press("3\n")
        time.sleep(0.3)
        terminal.press("\x03")
        assert terminal.wait() == 0
        assert "keys:" not in terminal.text
        assert terminal.modes == terminal.before
    assert events(tmp_path) == []


def test_an_exception_gives_the_terminal_back() -> None:
    program = (
        "import time\n"
        "from recorder.bench.keyboard import Keyboard\n"
        "with Keyboard(lambda text, at: None):\n"
        "    print('reading', flush=True)\n"
        "    time.sleep(0.5)\n"
        "    raise RuntimeError('lost')\n"
    )
    with Terminal(["-c", program]) as terminal:
        terminal.wait_for("reading")
        assert not terminal.echoes
        assert terminal.wait() == 1
        assert terminal.modes == terminal.before


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_at_any_other_moment_gives_the_terminal_back(number: signal.Signals) -> None:
    program = (
        "import time\n"
        "from recorder.bench.keyboard import Keyboard\n"
        "with Keyboard(lambda text, at: None):\n"
        "    print('reading', flush=True)\n"
        "    time.sleep(30)\n"
    )
    with Terminal(["-c", program]) as terminal:
        terminal.wait_for("reading")
        terminal.signal(number)
        assert terminal.wait() == -number
        assert terminal.modes == terminal.before


def test_after_a_stop_the_keys_are_there_again() -> None:
    program = (
        "import time\n"
        "from recorder.bench.keyboard import Keyboard\n"
        "with Keyboard(lambda text, at: print('got', text, flush=True)):\n"
        "    print('reading', flush=True)\n"
        "    time.sleep(30)\n"
    )
    with Terminal(["-c", program]) as terminal:
        terminal.wait_for("reading")
        # As a shell does that takes the terminal while a job is stopped.
        terminal.set_modes(terminal.before)
        assert terminal.echoes
        until_s = time.monotonic() + 10
        while terminal.echoes:
            assert time.monotonic() < until_s
            time.sleep(0.01)
        terminal.press("5")
        terminal.wait_for("got 5")


def test_input_that_is_no_terminal_is_not_read(tmp_path: Path) -> None:
    options = ["-o", str(tmp_path / "x.mcap"), "--duration", "1s", "--min-free", "1MB"]
    with MjpegServer(Script(rate_hz=RATE_HZ)) as server:
        done = subprocess.run(
            [sys.executable, "-m", "arucolog", "record", server.url, *options],
            input="3\nn",
            capture_output=True,
            text=True,
            timeout=60,
            cwd=ROOT,
        )
    assert done.returncode == 0, done.stderr
    assert "keys" not in done.stderr
    assert events(tmp_path) == []


def test_where_there_is_no_termios_nothing_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(keyboard, "termios", None)
    assert not keyboard.has_keyboard()
    monkeypatch.undo()
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    assert not keyboard.has_keyboard()
    with MjpegServer(Script()) as server:
        camera = http_camera(server.url)
        with waypoint_keys(camera, {}, wanted=True) as bench:
            assert bench.source is camera
            assert bench.notes is None
            bench.refresh()


def test_a_file_has_no_keys_and_says_so_where_waypoints_wait(tmp_path: Path) -> None:
    (tmp_path / "truth.yaml").write_text(TRUTH)
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "1.png").write_bytes(png())
    files = [str(tmp_path / name) for name in ("images", "truth.yaml", "x.mcap")]
    command = ["record", files[0], "--truth", files[1], "-o", files[2], "--min-free", "1MB"]
    with Terminal(["-m", "arucolog", *command]) as terminal:
        terminal.wait_for("truth.yaml has waypoints; keys mark them only while a live camera")
        assert terminal.wait(60) == 0
        assert "keys:" not in terminal.text
        assert terminal.modes == terminal.before
