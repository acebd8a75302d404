"""Logs that were cut, damaged, interrupted or ran out of space."""

from __future__ import annotations

import errno
import os
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from recorder.errors import InputError
from recorder.log.log_file import DiskFullError, LogFile
from recorder.log.reader import LogReader
from recorder.log.writer import LogWriter
from recorder.sources.base import CapturedFrame
from tests.log_helpers import attachments, frame, images, same_image, write_log
from tests.small_disks import mounted

ROOT = Path(__file__).resolve().parents[1]


def frames_of(path: Path) -> tuple[list[CapturedFrame], bytes]:
    frames = write_log(path, 60, size=5000)
    return frames, path.read_bytes()


def assert_prefix(path: Path, frames: list[CapturedFrame], at_least: int = 0) -> LogReader:
    with LogReader(path) as log:
        found = images(log)
    assert at_least <= len(found) <= len(frames)
    assert all(map(same_image, found, frames))
    return log


def test_a_log_cut_anywhere_gives_its_first_frames(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    frames, data = frames_of(path)
    rng = np.random.default_rng(1)
    with LogReader(path) as log:
        list(log.messages())
        assert log.cut_short is None
    (index_at,) = struct.unpack_from("<Q", data, len(data) - 28)
    lengths = [0, 1, 7, 8, 9, 17, len(data) - 1, *rng.integers(0, len(data), 150).tolist()]
    for length in lengths:
        path.write_bytes(data[:length])
        if length < 8:
            with pytest.raises(InputError, match="expected an MCAP log"):
                LogReader(path)
            continue
        # A chunk holds half a second, five frames: no more are lost than the one that was open.
        log = assert_prefix(path, frames, int(60 * length / len(data)) - 7)
        # Behind the data there is only the index.
        assert (log.cut_short is not None) == (length < index_at)
        assert log.cut_short is None or f"after {len(images(log))} frame" in log.cut_short
        assert log.image_count() is None


def test_zeros_after_a_power_loss_end_the_log(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    frames, data = frames_of(path)
    half = len(data) // 2
    path.write_bytes(data[:half] + bytes(len(data) - half))
    log = assert_prefix(path, frames, 20)
    assert log.cut_short is not None
    assert log.attachments.keys() == attachments().keys()


def test_a_damaged_chunk_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    frames, data = frames_of(path)
    where = data.index(frames[33].data) + 2000
    path.write_bytes(data[:where] + bytes([data[where] ^ 1]) + data[where + 1 :])
    with LogReader(path) as log:
        found = images(log)
    # A chunk holds half a second, five frames.
    assert [image.frame_index for image in found] == [*range(30), *range(35, 60)]
    assert all(same_image(image, frames[image.frame_index]) for image in found)
    assert log.cut_short is None
    (damage,) = log.damage
    assert damage.reason == "a chunk's checksum is wrong"
    assert damage.after_frames == 30
    assert damage.offset < where < damage.offset + damage.size
    assert log.shortfall == f"damaged: {damage}"


def test_no_damage_breaks_the_reader(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    write_log(path, 3, size=100)
    data = bytearray(path.read_bytes())
    rng = np.random.default_rng(2)
    for _ in range(300):
        broken = data.copy()
        for at in rng.integers(8, len(data), rng.integers(1, 9)):
            broken[at] = rng.integers(0, 256)
        path.write_bytes(broken)
        try:
            with LogReader(path) as log:
                list(log.records())
                log.camera()
        except InputError as error:
            assert "\n" not in str(error)  # noqa: PT017


@pytest.mark.parametrize(
    ("data", "found"), [(b"", "an empty file"), (b"ROSBAG 2.0", "b'ROSBAG 2'"), (b"\x89MC", "MC")]
)
def test_what_is_no_log_is_said(tmp_path: Path, data: bytes, found: str) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(data)
    with pytest.raises(InputError, match="expected an MCAP log") as caught:
        LogReader(path)
    assert found in str(caught.value)
    with pytest.raises(InputError, match="found no file"):
        LogReader(tmp_path / "none.mcap")
    with pytest.raises(InputError, match="directory"):
        LogReader(tmp_path)


def test_a_log_without_images_is_read(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    write_log(path, 0)
    with LogReader(path) as log:
        assert (log.start_ns, log.image_count(), list(log.records())) == (None, 0, [])
        assert log.camera() is not None


class _OddError(Exception):
    pass


@pytest.mark.parametrize(
    ("error", "ended"),
    [(KeyboardInterrupt(), "interrupted"), (_OddError("no light"), "error: no light")],
)
def test_an_exception_leaves_a_whole_log(tmp_path: Path, error: BaseException, ended: str) -> None:
    path = tmp_path / "log.mcap"

    def run() -> None:
        with LogWriter(path, attachments=attachments(), session={}) as writer:
            for i in range(7):
                writer.write_frame(frame(i))
            raise error

    with pytest.raises(type(error)):
        run()
    with LogReader(path) as log:
        assert len(images(log)) == log.image_count() == 7
        assert log.cut_short is None
        assert log.metadata["session_end"]["ended"] == ended


@pytest.mark.parametrize(
    ("ended", "shortfall"),
    [
        ("complete", None),
        ("interrupted", None),
        ("disk_full", "cut short when it was recorded: the disk was full"),
        ("error: no light", "cut short when it was recorded: no light"),
        ("cut short after 3 frames: x", "cut short after 3 frames: x"),
    ],
)
def test_how_a_log_ended_is_known_without_its_index(
    tmp_path: Path, ended: str, shortfall: str | None
) -> None:
    path = tmp_path / "log.mcap"
    with LogWriter(path, attachments=attachments(), session={}) as writer:
        writer.write_frame(frame(0))
        writer.end_as(ended)
    data = path.read_bytes()
    (index_at,) = struct.unpack_from("<Q", data, len(data) - 28)
    for length in (len(data), index_at + 30):
        path.write_bytes(data[:length])
        with LogReader(path) as log:
            assert len(images(log)) == 1
            assert (log.cut_short, log.ending, log.shortfall) == (None, ended, shortfall)
    path.write_bytes(data[: index_at - 30])
    with LogReader(path) as log:
        list(log.messages())
        assert log.ending == log.shortfall == log.cut_short is not None


class SmallDisk:
    """A file on a disk that takes `capacity` bytes, and gives back what the reserve held."""

    def __init__(self, path: Path, capacity: int, *, partial: bool = True) -> None:
        self._file = path.open("xb", buffering=0)
        self._capacity = capacity
        self._partial = partial
        self.reserved = 0

    def write(self, data: memoryview, /) -> int | None:
        free = self._capacity - self.reserved - self._file.tell()
        if len(data) > free:
            if not self._partial or free <= 0:
                raise OSError(errno.ENOSPC, "No space left on device")
            data = data[:free]
        return self._file.write(data)

    def truncate(self, size: int, /) -> int:
        return self._file.truncate(size)

    def close(self) -> None:
        self._file.close()


@pytest.mark.parametrize("partial", [True, False])
@pytest.mark.parametrize("capacity", [3_000_000, 3_456_789, 4_999_999])
def test_a_full_disk_ends_the_log_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capacity: int, partial: bool
) -> None:
    path = tmp_path / "log.mcap"
    disks: list[SmallDisk] = []

    def open_raw(target: Path) -> SmallDisk:
        disks.append(SmallDisk(target, capacity, partial=partial))
        return disks[0]

    ensure, release = LogFile.ensure, LogFile.release

    def ensure_there(self: LogFile, size: int) -> None:
        ensure(self, size)
        disks[0].reserved = self._reserved

    def release_there(self: LogFile) -> None:
        release(self)
        disks[0].reserved = 0

    monkeypatch.setattr(LogFile, "ensure", ensure_there)
    monkeypatch.setattr(LogFile, "release", release_there)
    accepted: list[CapturedFrame] = []

    def run() -> None:
        with LogWriter(path, attachments=attachments(), session={}, open_raw=open_raw) as writer:
            for i in range(1000):
                accepted.append(frame(i, size=50_000))
                writer.write_frame(accepted[-1])

    with pytest.raises(DiskFullError):
        run()
    with LogReader(path) as log:
        found = images(log)
        assert log.cut_short is None
        assert log.metadata["session_end"]["ended"] == "disk_full"
        assert len(found) == log.image_count() == int(log.metadata["session_end"]["frames_written"])
    assert len(accepted) - 1 <= len(found) <= len(accepted)
    assert all(map(same_image, found, accepted))
    assert path.stat().st_size <= capacity


def test_a_reserve_that_someone_else_took_loses_the_open_chunk_only(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"

    def run() -> None:
        disk = SmallDisk
        with LogWriter(
            path, attachments={}, session={}, open_raw=lambda p: disk(p, 1_234_567)
        ) as writer:
            for i in range(1000):
                writer.write_frame(frame(i, size=50_000))

    with pytest.raises(DiskFullError):
        run()
    with LogReader(path) as log:
        found = images(log)
        assert log.cut_short is not None
    assert len(found) >= 15
    assert all(same_image(image, frame(i, size=50_000)) for i, image in enumerate(found))


def test_a_disk_without_space_for_a_start_gets_no_log(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with pytest.raises(InputError, match="full disk"):
        LogWriter(path, attachments={}, session={}, open_raw=lambda p: SmallDisk(p, 5))
    assert not path.exists()


def test_a_small_file_system_fills_up(tmp_path: Path) -> None:
    """The same on a real one, where it can be mounted."""
    with mounted(tmp_path / "small", 5) as folder:
        path = folder / "log.mcap"

        def run() -> None:
            with LogWriter(path, attachments=attachments(), session={}) as writer:
                for i in range(1000):
                    writer.write_frame(frame(i, size=50_000))

        with pytest.raises(DiskFullError):
            run()
        with LogReader(path) as log:
            found = images(log)
            assert len(found) == int(log.metadata["session_end"]["frames_written"]) > 30
            assert all(same_image(image, frame(i, size=50_000)) for i, image in enumerate(found))
            assert log.cut_short is None
            assert log.metadata["session_end"]["ended"] == "disk_full"
        assert [p.name for p in folder.iterdir()] == ["log.mcap"]


_ENDLESS = """\
import sys, time
from pathlib import Path
from recorder.log.writer import LogWriter
from tests.log_helpers import attachments, frame
with LogWriter(Path(sys.argv[1]), attachments=attachments(), session={}) as writer:
    for i in range(100000):
        writer.write_frame(frame(i))
        time.sleep(0.002)
"""


def endless_recording(path: Path) -> subprocess.Popen[bytes]:
    process = subprocess.Popen(
        [sys.executable, "-c", _ENDLESS, str(path)], cwd=ROOT, stderr=subprocess.DEVNULL
    )
    until = time.monotonic() + 20
    while (not path.exists() or path.stat().st_size < 60_000) and time.monotonic() < until:
        time.sleep(0.02)
    return process


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_a_recording_that_is_stopped_is_found_and_readable(
    tmp_path: Path, number: signal.Signals
) -> None:
    path = tmp_path / "log.mcap"
    process = endless_recording(path)
    process.send_signal(number)
    assert process.wait(20) != 0
    assert [p.name for p in tmp_path.iterdir()] == ["log.mcap"]
    with LogReader(path) as log:
        found = images(log)
        assert all(same_image(image, frame(i)) for i, image in enumerate(found))
        assert len(found) >= 10
        if number == signal.SIGKILL:
            assert log.cut_short is not None
        else:
            assert log.cut_short is None
            assert log.metadata["session_end"]["ended"] == "interrupted"
