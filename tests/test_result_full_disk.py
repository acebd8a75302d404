"""A disk too full for a Rerun file: one line within seconds, and no table lost."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import BinaryIO

import pandas as pd
import pytest

from recorder.errors import InputError
from recorder.log.reader import LogReader
from recorder.sources.base import CapturedFrame
from recorder.verify.run import verify
from replay.live.rrd import complete_rrd
from replay.live.track import TrackOptions, track
from replay.result import open_result
from replay.run import ReplayOptions, replay
from replay.viewer import output, scene, style
from replay.viewer.open import view
from replay.viewer.output import NotWrittenError, RecordingFile
from tests.log_helpers import images
from tests.picture_server import ATTACHMENTS, pictures
from tests.rrd_files import rows
from tests.small_disks import mounted
from tests.test_track import Camera

ROOT = Path(__file__).resolve().parents[1]
SAMPLE = ROOT / "logs" / "sample.mcap"
TABLES = ("detections", "poses", "tracks", "truth")
FULL = "No space left on device"


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """About 2 MB are free."""
    with mounted(tmp_path / "small", 6) as folder:
        (folder / "fill").write_bytes(bytes(3_900_000))
        yield folder


@pytest.fixture
def full_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """There is no room for more than the first 100 kB of a recording."""

    def space(fd: int) -> SimpleNamespace:
        left = output._RESERVE_BYTES + (1 << 20) + 100_000 - os.fstat(fd).st_size
        return SimpleNamespace(f_blocks=1 << 30, f_bavail=max(left, 0), f_frsize=1)

    monkeypatch.setattr(os, "fstatvfs", space)


@pytest.fixture(scope="module")
def on_a_large_disk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("large") / "result"
    replay(SAMPLE, folder, "x", ReplayOptions(rrd=False, progress=False))
    return folder


# The disk is full between the last image and the flush: Rerun alone waits there for ever.
WRITE_MORE_THAN_FITS = """
import os, sys
from pathlib import Path
from replay.viewer import scene
from replay.viewer.output import RecordingFile
file = RecordingFile(Path(sys.argv[1]), "id", "a")
for i, data in enumerate([os.urandom(60_000) for _ in range(80)]):
    scene.set_time(file.stream, i, i)
    scene.log_image(file.stream, data, "jpeg")
try:
    file.close()
except OSError as error:
    print(error)
"""


def arucolog(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "arucolog", *map(str, arguments)]
    return subprocess.run(
        command, cwd=ROOT, timeout=60, capture_output=True, text=True, check=False
    )


def assert_same_tables(folder: Path, expected: Path) -> None:
    result, other = open_result(folder), open_result(expected)
    for table in TABLES:
        pd.testing.assert_frame_equal(result.table(table), other.table(table))


def test_a_full_disk_ends_a_recording(small_disk: Path) -> None:
    rrd = small_disk / "a.rrd"
    command = [sys.executable, "-c", WRITE_MORE_THAN_FITS, str(rrd)]
    done = subprocess.run(
        command, cwd=ROOT, timeout=30, capture_output=True, text=True, check=False
    )
    assert (done.stdout, done.stderr) == (f"{rrd}: could not be written: {FULL}\n", "")
    assert [p.name for p in small_disk.iterdir()] == ["fill"]


def test_replay_keeps_its_tables(small_disk: Path, on_a_large_disk: Path) -> None:
    done = arucolog("replay", SAMPLE, "-o", small_disk / "x")
    assert done.returncode == 1
    rrd = small_disk / "x" / "replay.rrd"
    lines = [line for line in done.stderr.splitlines() if "frame" not in line]
    assert lines == [f"Error: {rrd}: could not be written: {FULL}; the tables are complete"]
    assert_same_tables(small_disk / "x", on_a_large_disk)
    assert sorted(p.name for p in small_disk.iterdir()) == ["fill", "x"]
    assert not list((small_disk / "x").glob("*.rrd*"))


def test_replay_whose_tables_have_no_room_leaves_nothing(small_disk: Path) -> None:
    (small_disk / "more").write_bytes(bytes(2_330_000))
    done = arucolog("replay", SAMPLE, "-o", small_disk / "x")
    assert done.returncode == 1
    error = f"Error: {small_disk / 'x'}: could not be written: {FULL}"
    assert done.stderr.splitlines()[-1] == error
    assert sorted(p.name for p in small_disk.iterdir()) == ["fill", "more"]


def test_view_names_the_file_to_save(small_disk: Path, tmp_path: Path) -> None:
    save = small_disk / "v.rrd"
    replay(SAMPLE, tmp_path / "result", "x", ReplayOptions(progress=False))
    for shown in ([SAMPLE], [tmp_path / "result"], [tmp_path / "result"] * 2):
        done = arucolog("view", *shown, "--save", save)
        assert done.returncode == 1
        (line,) = done.stderr.splitlines()
        assert line.startswith(f"Error: {save}: ")
        assert line.endswith(f"could not be written: {FULL}")
        assert [p.name for p in small_disk.iterdir()] == ["fill"]


def test_track_keeps_log_and_tables(small_disk: Path, tmp_path: Path) -> None:
    folder, log = tmp_path / "pictures", tmp_path / "log.mcap"
    folder.mkdir()
    for k in range(120):
        (folder / f"{k:04}.jpg").write_bytes(pictures()[k % len(pictures())])
    files: list[str | Path] = []
    for option, name in (("--camera", "camera.yaml"), ("--map", "map.yaml")):
        (tmp_path / name).write_bytes(ATTACHMENTS[name])
        files += [option, tmp_path / name]
    result = small_disk / "x"
    done = arucolog("track", folder, *files, "-o", log, "--result", result)
    assert done.returncode == 1
    assert f"{log}: 120 frames" in done.stdout
    error = f"Error: {result / 'replay.rrd'}: could not be written: {FULL}; the tables are complete"
    assert [line for line in done.stderr.splitlines() if "Error" in line] == [error]
    assert open_result(result).summary["frames"] == 120
    assert sorted(p.name for p in small_disk.iterdir()) == ["fill", "x"]
    assert not list(result.glob("*.rrd*"))
    assert {verdict.level for verdict in verify([log]).rules if verdict.rule == "end"} == {"ok"}


@pytest.mark.usefixtures("full_disk")
def test_a_full_disk_that_needs_no_permission(tmp_path: Path, on_a_large_disk: Path) -> None:
    with pytest.raises(InputError, match=rf"x/replay\.rrd: could not .*{FULL}; the tables are"):
        replay(SAMPLE, tmp_path / "x", "x", ReplayOptions(progress=False))
    assert_same_tables(tmp_path / "x", on_a_large_disk)
    with pytest.raises(InputError, match=rf"v\.rrd: the recording could not be written: {FULL}"):
        view([SAMPLE], save=tmp_path / "v.rrd")
    assert [p.name for p in tmp_path.iterdir()] == ["x"]


@pytest.mark.parametrize("fails", ["while frames come", "at the end"])
def test_a_tracked_camera_keeps_log_and_tables(
    fails: str, tmp_path: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    if fails == "at the end":

        def complete(*_: object) -> None:
            request.getfixturevalue("full_disk")
            complete_rrd(*_)  # type: ignore[arg-type]

        monkeypatch.setattr("replay.live.track.complete_rrd", complete)
    else:
        request.getfixturevalue("full_disk")
    log, folder = tmp_path / "log.mcap", tmp_path / "live"
    done = track(Camera(40, rate_hz=60), log, folder, "live", TrackOptions(jobs=2))
    assert (done.recorded.ended, done.problem, done.rrd_problem) == ("complete", None, FULL)
    assert done.summary == open_result(folder).summary
    with LogReader(log) as reader:
        assert (
            len(images(reader)) == done.summary["frames"] == len(open_result(folder).table("poses"))
        )
    assert not list(folder.glob("*.rrd*"))


def test_tables_that_have_no_room_leave_the_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_room(*_: object) -> None:
        raise OSError(errno.ENOSPC, FULL, "settings.yaml")

    monkeypatch.setattr("replay.live.track.write_inputs", no_room)
    log, folder = tmp_path / "log.mcap", tmp_path / "live"
    done = track(Camera(10, rate_hz=60), log, folder, "live", TrackOptions(jobs=2))
    assert (done.recorded.ended, done.summary) == ("complete", None)
    assert done.problem == f"{folder}: could not be written: {FULL}"
    assert [p.name for p in tmp_path.iterdir()] == ["log.mcap"]


def test_a_disk_that_is_full_when_the_tables_are_closed_leaves_the_log(
    small_disk: Path, tmp_path: Path
) -> None:
    """Tables of a short recording are written only then."""

    def fill(frame: CapturedFrame, _: object) -> None:
        if frame.frame_index == 5:
            with suppress(OSError), (small_disk / "rest").open("wb", buffering=0) as file:
                while True:
                    file.write(bytes(4096))

    log, folder = tmp_path / "log.mcap", small_disk / "live"
    options = TrackOptions(jobs=2, rrd=False)
    done = track(Camera(40, rate_hz=60), log, folder, "live", options, on_result=fill)
    assert (done.recorded.ended, done.summary) == ("complete", None)
    assert (done.problem or "").startswith(f"{folder}: could not be written: ")
    with LogReader(log) as reader:
        assert len(images(reader)) + done.recorded.counts.dropped == 40
    assert {p.name for p in small_disk.iterdir()} == {"fill", "rest"}


def test_a_slow_disk_is_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write = output._Writer._write

    def slow(self: output._Writer, data: bytes) -> None:
        time.sleep(0.1)
        write(self, data)

    monkeypatch.setattr(output._Writer, "_write", slow)
    monkeypatch.setattr(output, "_FLUSH_S", 0.02)
    file = RecordingFile(tmp_path / "a.rrd", "id", "a")
    for i in range(60):
        scene.set_time(file.stream, i, i)
        scene.log_image(file.stream, os.urandom(1 << 18), "jpeg")
    file.close()
    assert len(rows(tmp_path / "a.rrd", style.IMAGE, "EncodedImage:blob")) == 60
    assert [p.name for p in tmp_path.iterdir()] == ["a.rrd"]


class PulledOut:
    """A file on a stick that is gone."""

    def __init__(self, file: BinaryIO) -> None:
        self.fileno, self.close = file.fileno, file.close

    def write(self, _: bytes) -> int:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    def truncate(self, _: int) -> int:
        raise OSError(errno.EIO, os.strerror(errno.EIO))


def test_a_disk_that_is_gone_is_named(tmp_path: Path) -> None:
    file = RecordingFile(tmp_path / "a.rrd", "id", "a")
    file._writer._file = PulledOut(file._writer._file)  # type: ignore[assignment]
    for i in range(60):
        scene.set_time(file.stream, i, i)
        scene.log_image(file.stream, os.urandom(1 << 18), "jpeg")
    with pytest.raises(NotWrittenError) as raised:
        file.close()
    assert raised.value.reason == os.strerror(errno.EIO)
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_does_not_tell_its_size_is_not_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    silent = SimpleNamespace(f_blocks=0, f_bavail=0, f_frsize=0)
    monkeypatch.setattr(os, "fstatvfs", lambda fd: silent)
    file = RecordingFile(tmp_path / "a.rrd", "id", "a")
    scene.set_time(file.stream, 0, 0)
    scene.log_image(file.stream, os.urandom(1 << 18), "jpeg")
    file.close()
    assert len(rows(tmp_path / "a.rrd", style.IMAGE, "EncodedImage:blob")) == 1


def test_ctrl_c_does_not_wait_for_a_slow_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(output._Writer, "_write", lambda self, data: time.sleep(1))
    file = RecordingFile(tmp_path / "a.rrd", "id", "a")
    for i in range(60):
        scene.set_time(file.stream, i, i)
        scene.log_image(file.stream, os.urandom(1 << 18), "jpeg")
    begun = time.monotonic()
    threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        file.close()
    assert time.monotonic() - begun < 5
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("full_disk")
def test_the_space_of_a_recording_that_does_not_fit_is_given_back_at_once(tmp_path: Path) -> None:
    file = RecordingFile(tmp_path / "a.rrd", "id", "a")
    for i in range(60):
        scene.set_time(file.stream, i, i)
        scene.log_image(file.stream, os.urandom(1 << 18), "jpeg")
    file._flush()
    assert (tmp_path / "a.rrd.part").stat().st_size == 0
    with pytest.raises(NotWrittenError, match=FULL):
        file.close()
    assert list(tmp_path.iterdir()) == []
