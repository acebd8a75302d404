"""Of all who want to write a log of one name, one does, and nothing that is whole is lost."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from io import FileIO
from pathlib import Path
from threading import Barrier
from typing import Any

import pytest

from pipeline.geometry import Pose
from recorder.attach import attach
from recorder.capture.parts import SplitLimit
from recorder.errors import InputError
from recorder.log import target
from recorder.log.reader import LogReader
from recorder.log.target import DisplacedError
from recorder.log.trajectory_writer import TimedPose, write_trajectories
from recorder.log.writer import LogWriter
from recorder.record import record
from recorder.record_text import ending_text, summary_text
from recorder.recover import recover
from recorder.sources.base import CapturedFrame
from tests.capture_helpers import indices_of
from tests.live_sources import LiveScript, now_frames
from tests.log_helpers import TRUTH_YAML, frame, write_log


def begun(path: Path, count: int, *, force: bool = False) -> LogWriter:
    """A log that is being written."""
    writer = LogWriter(path, attachments={}, session={}, force=force)
    for index in range(count):
        writer.write_frame(frame(index))
    return writer


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def again(other: Path, path: Path) -> None:
    record(LiveScript(now_frames(3)), path, force=True)


def recovered(other: Path, path: Path) -> None:
    recover(other, path, force=True)


def recovered_from_what_is_written(other: Path, path: Path) -> None:
    recover(path.with_name("log[1].mcap.part"), path, force=True)


def attached(other: Path, path: Path) -> None:
    attach(other, path, {"truth.yaml": TRUTH_YAML}, force=True)


def attached_in_place(other: Path, path: Path) -> None:
    attach(path, path, {"truth.yaml": TRUTH_YAML}, force=True)


@pytest.mark.parametrize(
    "intrude",
    [again, recovered, recovered_from_what_is_written, attached, attached_in_place],
)
def test_a_log_that_is_being_replaced_is_not_replaced_by_others(
    tmp_path: Path, intrude: Callable[[Path, Path], None]
) -> None:
    pytest.importorskip("fcntl")
    path, other = tmp_path / "log[1].mcap", tmp_path / "other.mcap"
    write_log(path, 2)
    write_log(other, 4)
    with begun(path, 9, force=True) as first:
        first.flush()
        with pytest.raises(InputError) as refused:
            intrude(other, path)
    assert str(refused.value) == (
        f"{path}: expected a log that nobody else writes, found log[1].mcap.part, which is being "
        "recorded to take its place"
    )
    assert indices_of(path) == list(range(9))
    assert names(tmp_path) == ["log[1].mcap", "other.mcap"]
    if intrude is not recovered_from_what_is_written:
        intrude(other, path)
        assert names(tmp_path) == ["log[1].mcap", "other.mcap"]


@pytest.mark.parametrize("split", [None, SplitLimit(seconds=1)])
def test_a_place_that_is_taken_is_taken_also_when_it_is_empty(
    tmp_path: Path, split: SplitLimit | None
) -> None:
    """Somebody removed the old log while the new one was written."""
    pytest.importorskip("fcntl")
    given = tmp_path / "log.mcap"
    path = tmp_path / "log-001.mcap" if split else given
    write_log(path, 2)
    with begun(path, 5, force=True):
        path.unlink()
        with pytest.raises(InputError, match=r"nobody else writes, found log.*\.mcap\.part, which"):
            record(LiveScript(now_frames(3)), given, split=split)
    assert indices_of(path) == list(range(5))
    assert names(tmp_path) == [path.name]


@pytest.mark.parametrize("exists", [True, False])
def test_of_those_that_begin_together_one_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, exists: bool
) -> None:
    pytest.importorskip("fcntl")

    class Slow(FileIO):
        """Long there before it is locked."""

        def __init__(self, *args: Any) -> None:
            super().__init__(*args)
            time.sleep(0.05)

    monkeypatch.setattr(target, "FileIO", Slow)
    path = tmp_path / "log.mcap"
    if exists:
        write_log(path, 2)
    barrier = Barrier(4)

    def start(count: int) -> tuple[int, LogWriter | str]:
        barrier.wait()
        try:
            return count, begun(path, count, force=exists)
        except InputError as error:
            return count, str(error)

    with ThreadPoolExecutor(4) as pool:
        started = list(pool.map(start, range(3, 7)))
    (count, writer), *more = [pair for pair in started if isinstance(pair[1], LogWriter)]
    assert not more
    said = "which is being recorded to take its place" if exists else "found one that exists"
    assert all(said in text for _, text in started if isinstance(text, str))
    assert isinstance(writer, LogWriter)
    writer.close()
    assert indices_of(path) == list(range(count))
    assert names(tmp_path) == ["log.mcap"]


def test_a_folder_that_others_hold_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("fcntl")
    monkeypatch.setattr(target, "_PATIENCE_S", 0.05)
    with target._alone_in(tmp_path):
        begun(tmp_path / "log.mcap", 3).close()
    assert indices_of(tmp_path / "log.mcap") == [0, 1, 2]


@pytest.fixture
def without_locks(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on Windows, and on some network drives."""
    monkeypatch.setattr(target, "fcntl", None)


@pytest.mark.usefixtures("without_locks")
@pytest.mark.parametrize("first_replaces", [True, False])
def test_what_came_meanwhile_is_kept(tmp_path: Path, first_replaces: bool) -> None:
    """Without locks two may write; the second to end finds that the place is taken."""
    path = tmp_path / "log.mcap"
    if first_replaces:
        write_log(path, 2)
    first = begun(path, 9, force=first_replaces)
    second = begun(path, 3, force=True)
    assert first.written_to != second.written_to
    first.close()
    with pytest.raises(DisplacedError) as displaced:
        second.close()
    assert str(displaced.value) == (
        f"{path}: expected the log that was to be replaced, found that it has changed since; it "
        f"stays, the new one is {second.written_to}"
    )
    assert indices_of(path) == list(range(9))
    assert indices_of(second.written_to) == list(range(3))


def test_a_recording_that_finds_its_place_taken_says_where_it_is(tmp_path: Path) -> None:
    path, part, other = (tmp_path / name for name in ("log.mcap", "log.mcap.part", "other.mcap"))
    write_log(path, 2)
    write_log(other, 7)

    def intrude(item: CapturedFrame) -> None:
        if item.frame_index == 3:
            other.replace(path)

    source = LiveScript(now_frames(5), on_frame=intrude)
    summary = record(source, path, force=True)
    assert (summary.ended, summary.path, summary.parts) == ("failed", part, (part,))
    assert summary_text(summary).startswith(f"{part}: 5 frames, ")
    said = ending_text(summary)
    assert said is not None
    assert said.startswith(f"Error: {path}: expected the log that was to be replaced")
    assert said.endswith(f"the new one is {part}")
    assert indices_of(path) == list(range(7))
    assert indices_of(part) == list(range(5))
    with LogReader(part) as log:
        assert log.ending == "complete"


def test_a_recording_that_fails_beside_the_old_log_says_where_it_is(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    write_log(path, 2)
    gone = InputError("camera", "expected frames, found none")
    summary = record(LiveScript([*now_frames(4), gone]), path, force=True)
    assert summary.path == tmp_path / "log.mcap.part"
    assert summary_text(summary).startswith(f"{path}.part: 4 frames")


@pytest.mark.parametrize("verb", ["attach", "recover"])
def test_a_copy_of_a_log_that_failed_takes_its_place(tmp_path: Path, verb: str) -> None:
    """It is as whole as its original."""
    path, copy = tmp_path / "log.mcap", tmp_path / "copy.mcap"
    gone = InputError("camera", "expected frames, found none")
    record(LiveScript([*now_frames(4), gone]), path)
    write_log(copy, 2)
    if verb == "attach":
        attach(path, copy, {"truth.yaml": TRUTH_YAML}, force=True)
    else:
        recover(path, copy, force=True)
    assert indices_of(copy) == [0, 1, 2, 3]
    assert names(tmp_path) == ["copy.mcap", "log.mcap"]
    with LogReader(copy) as log:
        assert log.ending == f"error: {gone}"


@pytest.mark.usefixtures("without_locks")
def test_a_file_that_was_taken_away_replaces_nothing(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    write_log(path, 2)
    writer = begun(path, 3, force=True)
    writer.written_to.unlink()
    with pytest.raises(InputError, match=r"log\.mcap\.part: expected the log that was written"):
        writer.close()
    assert indices_of(path) == [0, 1]


def test_trajectories_leave_what_a_killed_recording_left(tmp_path: Path) -> None:
    path, part = tmp_path / "log.mcap", tmp_path / "log.mcap.part"
    part.write_bytes(b"only copy")
    poses = [TimedPose(0, 0, Pose.identity())]
    write_trajectories(path, {"/fix": poses}, camera_topic="/fix", attachments={}, metadata={})
    assert part.read_bytes() == b"only copy"
    assert names(tmp_path) == ["log.mcap", "log.mcap.part"]
