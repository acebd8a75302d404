"""What can be saved of a log that was cut or damaged."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from mcap.reader import make_reader
from mcap.writer import Writer

from recorder.cli import commands
from recorder.errors import InputError
from recorder.log.reader import LogReader
from recorder.log.records import ExactPose, LogEvent
from recorder.log.writer import LogWriter
from recorder.recover import recover
from recorder.sources.base import CapturedFrame
from recorder.verify.run import verify
from tests.log_helpers import attachments, frame, images, same_image, write_log
from tests.test_log import foreign_log


def logged(path: Path, count: int = 60) -> tuple[list[CapturedFrame], bytes]:
    frames = write_log(path, count, size=5000)
    return frames, path.read_bytes()


def chunks_of(data: bytes) -> list[tuple[int, int]]:
    """Offset and size of each chunk."""
    found, at = [], 8
    while at < len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, at)
        if opcode == 6:
            found.append((at, 9 + length))
        if opcode == 15:
            break
        at += 9 + length
    return found


def assert_whole(path: Path) -> list[int]:
    """The log has all that a log has; returns its frame numbers."""
    with LogReader(path) as log:
        found = images(log)
        assert log.cut_short is None
        assert not log.damage
        assert log.image_count() == len(found)
        assert log.metadata["session_end"]["frames_written"] == str(len(found))
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert sum(c.topic == "/camera/image" for _, c, _ in reader.iter_messages()) == len(found)
    return [image.frame_index for image in found]


def test_a_cut_log_gets_its_end(tmp_path: Path) -> None:
    path, out = tmp_path / "log.mcap", tmp_path / "out.mcap"
    frames, data = logged(path)
    rng = np.random.default_rng(4)
    for length in rng.integers(20_000, len(data) - 3000, 20).tolist():
        path.write_bytes(data[:length])
        with LogReader(path) as log:
            before = images(log)
        saved = recover(path, out, force=True)
        assert path.read_bytes() == data[:length]
        found = assert_whole(out)
        assert found == [image.frame_index for image in before] == list(range(len(before)))
        assert saved.counts.written == len(found)
        assert saved.problem is not None
        with LogReader(out) as log:
            assert all(map(same_image, images(log), frames))
            assert log.attachments == attachments()
            end = log.metadata["session_end"]
            assert end["ended"] == f"recovered: {saved.problem}"
            assert "cut short after" in (log.shortfall or "")
            assert sum(isinstance(r, ExactPose) for r in log.records()) == len(found)
            # What viewers are shown is there once.
            topics = [c.topic for _, c, _ in log.messages()]
            assert topics.count("/camera/calibration") == topics.count("/tf") == 1
            assert log.metadata["recovered"]["from"] == "log.mcap"


@pytest.mark.parametrize("with_index", [True, False])
@pytest.mark.parametrize("chunk", [0, 3, 11])
def test_a_bit_that_flipped_costs_one_chunk(tmp_path: Path, chunk: int, with_index: bool) -> None:
    path, out = tmp_path / "log.mcap", tmp_path / "out.mcap"
    frames, data = logged(path)
    at, size = chunks_of(data)[chunk]
    broken = bytearray(data[: None if with_index else -3000])
    broken[at + size // 2] ^= 1
    path.write_bytes(broken)
    saved = recover(path, out)
    found = assert_whole(out)
    lost = set(range(5 * chunk, 5 * chunk + 5))
    if chunk == 0 and not with_index:
        # The channels were in there, and nothing else says what they are.
        assert found == []
        return
    assert found == [i for i in range(60) if i not in lost]
    assert saved.damage[0].offset == at
    assert saved.damage[0].size == size
    with LogReader(out) as log:
        assert all(same_image(image, frames[image.frame_index]) for image in images(log))
        assert "a chunk's checksum is wrong" in log.metadata["session_end"]["ended"]


@pytest.mark.parametrize("byte", range(9))
def test_a_chunk_whose_length_is_damaged_is_stepped_over(tmp_path: Path, byte: int) -> None:
    path, out = tmp_path / "log.mcap", tmp_path / "out.mcap"
    _, data = logged(path)
    at, _ = chunks_of(data)[4]
    broken = bytearray(data)
    broken[at + byte] ^= 0x15
    path.write_bytes(broken)
    saved = recover(path, out)
    found = assert_whole(out)
    assert found == [i for i in range(60) if not 20 <= i < 25]
    assert saved.counts.dropped == 5
    assert saved.damage


def test_zeros_in_the_middle_are_stepped_over(tmp_path: Path) -> None:
    """A file system that lost power may have put the end on the disk, and not the middle."""
    path, out = tmp_path / "log.mcap", tmp_path / "out.mcap"
    _, data = logged(path)
    chunks = chunks_of(data)
    first, last = chunks[3][0] + 500, chunks[6][0] + 500
    path.write_bytes(data[:first] + bytes(last - first) + data[last:-3000])
    recover(path, out)
    assert assert_whole(out) == [*range(15), *range(35, 60)]


def test_a_whole_log_is_copied_as_it_is(tmp_path: Path) -> None:
    path, out = tmp_path / "log.mcap", tmp_path / "out.mcap"
    frames, _ = logged(path, 40)
    saved = recover(path, out)
    assert saved.problem is None
    assert assert_whole(out) == list(range(40))
    with LogReader(path) as before, LogReader(out) as after:
        assert after.metadata["session_end"] == before.metadata["session_end"]
        assert all(map(same_image, images(after), frames))
    assert verify([out], decode=False).level == "ok"


def test_a_lost_index_is_made_again(tmp_path: Path) -> None:
    path, out = tmp_path / "log.mcap", tmp_path / "out.mcap"
    _, data = logged(path, 12)
    path.write_bytes(data[:-50])
    assert recover(path, out).problem == "without its index"
    assert assert_whole(out) == list(range(12))


def test_counts_are_made_again(tmp_path: Path) -> None:
    path, out = tmp_path / "log.mcap", tmp_path / "out.mcap"
    with LogWriter(path, attachments={}, session={"live": "yes"}, live=True) as writer:
        for i in range(40):
            if i in (7, 8):
                continue
            item = frame(i, size=50 if i == 12 else 2000)
            data = b"" if i == 12 else item.data
            back_ns = 10**9 if i >= 20 else 0
            late_ns = 10**9 if i >= 30 else 0
            writer.write_frame(
                CapturedFrame(
                    i, item.timestamp_ns - back_ns, item.arrival_ns + late_ns, data, "png"
                )
            )
        written = writer.counts
    assert (written.dropped, written.corrupt, written.stamped_back, written.late) == (2, 1, 1, 1)
    path.write_bytes(path.read_bytes()[:-5000])
    saved = recover(path, out)
    counts = saved.counts
    assert (counts.dropped, counts.corrupt, counts.stamped_back, counts.late) == (2, 1, 1, 1)
    with LogReader(out) as log:
        assert log.metadata["session_end"].items() >= counts.as_metadata().items()
        events = sum(isinstance(r, LogEvent) for r in log.records())
        assert log.metadata["session_end"]["events"] == str(events) == "4"


def test_the_log_itself_is_never_written(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    _, data = logged(path, 12)
    path.write_bytes(data[:-3000])
    (tmp_path / "link.mcap").hardlink_to(path)
    for out in (path, tmp_path / "link.mcap"):
        with pytest.raises(InputError, match="expected another file than the log"):
            recover(path, out, force=True)
    assert path.read_bytes() == data[:-3000]
    (tmp_path / "there.mcap").write_bytes(b"")
    with pytest.raises(InputError, match="--force replaces it"):
        recover(path, tmp_path / "there.mcap")


def test_a_log_of_another_make_is_recovered(tmp_path: Path) -> None:
    path, out = tmp_path / "log.mcap", tmp_path / "out.mcap"
    foreign_log(path)
    recover(path, out)
    with LogReader(out) as log:
        assert [image.frame_index for image in images(log)] == [0, 1, 2]


def test_a_log_of_another_make_with_other_bytes_is_said(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("foxglove.CompressedImage", "protobuf", b"")
        channel = writer.register_channel("/camera/image", "protobuf", schema)
        writer.add_message(channel, 0, b"\x0a\xff", 0)
        writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(InputError, match=r"expected foxglove.CompressedImage, found other bytes"):
        recover(path, tmp_path / "out.mcap")
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("length", [8, 9, 30, 60])
def test_a_log_of_which_nothing_is_left_is_an_error(tmp_path: Path, length: int) -> None:
    path, out = tmp_path / "log.mcap", tmp_path / "out.mcap"
    _, data = logged(path, 3)
    path.write_bytes(data[:length])
    with pytest.raises(InputError, match=r"expected something to save, found: cut short"):
        recover(path, out)
    assert list(tmp_path.iterdir()) == [path]
    out.write_bytes(b"another")
    with pytest.raises(InputError, match=r"expected something to save"):
        recover(path, out, force=True)
    assert sorted(tmp_path.iterdir()) == [path, out]
    assert out.read_bytes() == b"another"


def test_files_without_images_are_saved_with_a_word(tmp_path: Path) -> None:
    """What was given to the recorder is there before the first image is."""
    path, out = tmp_path / "log.mcap", tmp_path / "out.mcap"
    _, data = logged(path, 3)
    path.write_bytes(data[: chunks_of(data)[0][0]])
    command = {c.name: c for c in commands()}["recover"]
    done = CliRunner().invoke(command, [str(path), "-o", str(out)])
    assert done.exit_code == 0
    assert "no images could be read: what is saved is camera.yaml" in done.stderr
    with LogReader(out) as log:
        assert log.attachments == attachments()


def test_a_log_that_was_killed_before_its_first_frame_gets_its_end(tmp_path: Path) -> None:
    path, out = tmp_path / "log.mcap", tmp_path / "out.mcap"
    with LogWriter(path, attachments={}, session={"host": "robot"}) as writer:
        start = writer.bytes_written
    path.write_bytes(path.read_bytes()[:start])
    saved = recover(path, out)
    assert saved.counts.written == 0
    with LogReader(out) as log:
        assert log.metadata["session"]["host"] == "robot"
        assert log.cut_short is None


def test_the_command(tmp_path: Path) -> None:
    path, out = tmp_path / "log.mcap", tmp_path / "out.mcap"
    _, data = logged(path)
    at, size = chunks_of(data)[3]
    path.write_bytes(data[:at] + bytes(size) + data[at + size :])
    command = {c.name: c for c in commands()}["recover"]
    done = CliRunner().invoke(command, [str(path), "-o", str(out), "--json"])
    told = json.loads(done.output)
    assert told["frames_written"] == 55
    assert told["damage"][0]["offset"] == at
    done = CliRunner().invoke(command, [str(path), "-o", str(out), "--force"])
    assert done.output.startswith(f"{out}: 55 frames, 5.900 s, 5 missing\nleft out: zeros")
