"""Recordings in several logs, read and replayed as one."""

from __future__ import annotations

import errno
import json
import os
import threading
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
from click.testing import CliRunner
from mcap.writer import MCAP0_MAGIC

from recorder.capture.parts import SplitLimit
from recorder.cli import commands
from recorder.errors import InputError
from recorder.info import log_info
from recorder.info_text import info_text
from recorder.log.mcap_output import McapOutput
from recorder.log.parts import PartsReader, group_parts, open_log, whole_path
from recorder.log.reader import LogReader
from recorder.log.records import LogEvent, LogImage
from recorder.quantities import parse_duration, parse_size
from recorder.record import record
from recorder.record_text import summary_text
from recorder.sources.base import CapturedFrame, SourceEvent
from replay.cli import commands as replay_commands
from tests import worlds
from tests.live_sources import LiveScript, now_frames
from tests.log_helpers import attachments, frame, images, same_image
from tests.test_record import Item, ScriptedSource


def split_log(folder: Path, limit: str = "1s", count: int = 35) -> tuple[list[Path], list[Item]]:
    """35 frames at 10 frames/s, two of them lost, and an event; parts of a second."""
    items: list[Item] = [frame(i) for i in range(count) if i not in (10, 11)]
    items.insert(5, SourceEvent(frame(4).timestamp_ns, "info", "here"))
    source = ScriptedSource(items, attachments())
    summary = record(source, folder / "drive.mcap", split=SplitLimit.parse(limit))
    return list(summary.parts), items


def test_each_part_is_whole_in_itself(tmp_path: Path) -> None:
    paths, items = split_log(tmp_path)
    assert [p.name for p in paths] == [f"drive-00{k}.mcap" for k in (1, 2, 3, 4)]
    assert sorted(tmp_path.iterdir()) == paths
    found: list[LogImage] = []
    recordings = set()
    for k, path in enumerate(paths):
        with LogReader(path) as log:
            part = images(log)
            found += part
            session, end = log.metadata["session"], log.metadata["session_end"]
            assert log.attachments == attachments()
            assert log.cut_short is None
            assert log.camera() is not None
            assert log.image_count() == len(part) == int(end["frames_written"])
            shown = {c.topic for _, c, _ in log.messages()}
            assert shown >= {"/camera/calibration", "/tf", "/truth/path", "/truth/exact"}
            # Seconds count from the recording's first image in every part.
            assert log.start_ns == frame(0).timestamp_ns
            assert session["part"] == str(k + 1)
            recordings.add(session["recording"])
            last = k == len(paths) - 1
            assert end["ended"] == (
                "complete" if last else f"split: goes on in drive-00{k + 2}.mcap"
            )
    assert len(recordings) == 1
    given = [item for item in items if isinstance(item, CapturedFrame)]
    assert all(map(same_image, found, given))
    assert len(found) == len(given)
    # The two that are lost between the parts are counted in the second one.
    dropped = [LogReader(path).metadata["session_end"]["frames_dropped"] for path in paths]
    assert dropped == ["0", "2", "0", "0"]
    text = info_text(log_info(paths[1]))
    assert "goes on in drive-003.mcap" in text
    assert "part" in text


def test_what_is_lost_before_a_part_is_counted_once(tmp_path: Path) -> None:
    items: list[Item] = [frame(i) for i in range(20) if i not in (8, 9)]
    lost = SourceEvent(frame(7).timestamp_ns, "warning", "2 frames dropped: too fast", dropped=2)
    items.insert(8, lost)
    limit = SplitLimit(seconds=1)
    summary = record(ScriptedSource(items), tmp_path / "drive.mcap", split=limit)
    assert len(summary.parts) == 2
    assert (summary.frames_written, summary.frames_dropped) == (18, 2)
    said = [LogReader(path).metadata["session_end"]["frames_dropped"] for path in summary.parts]
    assert said == ["0", "2"]


def test_a_split_by_size_keeps_every_part_below_it(tmp_path: Path) -> None:
    frames = [frame(i, size=100_000) for i in range(60)]
    source = ScriptedSource([*frames], attachments())
    summary = record(source, tmp_path / "drive.mcap", split=SplitLimit.parse("1.5MB"))
    sizes = [path.stat().st_size for path in summary.parts]
    assert len(sizes) == 5
    assert all(size <= 1_500_000 for size in sizes)
    assert all(size > 1_250_000 for size in sizes[:-1])
    assert sum(sizes) == summary.bytes_written
    assert "drive-001.mcap to drive-005.mcap: 60 frames" in summary_text(summary)
    with open_log(summary.parts) as log:
        assert all(map(same_image, images(log), frames))
        assert log.image_count() == 60


def test_the_same_source_gives_the_same_parts(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
    first, _ = split_log(tmp_path / "a")
    second, _ = split_log(tmp_path / "b")
    assert [p.read_bytes() for p in first] == [p.read_bytes() for p in second]


def test_two_live_recordings_are_two(tmp_path: Path) -> None:
    for name in ("a", "b"):
        source = LiveScript(now_frames(30), rate_hz=100)
        record(source, tmp_path / f"{name}.mcap", split=SplitLimit(seconds=0.1))
    groups = group_parts(sorted(tmp_path.iterdir()))
    assert [len(group) > 1 for group in groups] == [True, True]
    for group in groups:
        with open_log(group) as log:
            assert [image.frame_index for image in images(log)] == list(range(30))
            assert log.shortfall is None


def test_parts_in_any_order_are_read_as_one(tmp_path: Path) -> None:
    paths, items = split_log(tmp_path)
    record(ScriptedSource(items, attachments()), tmp_path / "whole.mcap")
    others = tmp_path / "other.mcap"
    record(ScriptedSource([frame(0)]), others)
    groups = group_parts([paths[2], others, paths[0], paths[3], paths[1]])
    assert groups == [tuple(paths), (others,)]
    with open_log(groups[0]) as parts, LogReader(tmp_path / "whole.mcap") as whole:
        assert isinstance(parts, PartsReader)
        found, expected = list(parts.records()), list(whole.records())
        assert [type(r) for r in found] == [type(r) for r in expected]
        for a, b in zip(found, expected, strict=True):
            if isinstance(a, LogEvent):
                assert a == b
        later = [r.frame_index for r in parts.records(1.5, 2.5) if isinstance(r, LogImage)]
        assert later == list(range(15, 25))
        assert parts.image_count() == whole.image_count()
        assert parts.start_ns == whole.start_ns
        assert parts.ending == "complete"
        assert parts.shortfall is None
        assert len(parts.sha256()) == 64
    with pytest.raises(InputError, match=r"expected each part once, found part 2"):
        group_parts([paths[1], paths[1]])


def test_parts_that_are_missing_are_said(tmp_path: Path) -> None:
    paths, _ = split_log(tmp_path)
    for given, said in (
        (paths[:1], "one part of a recording that goes on in drive-002.mcap"),
        (paths[:2], "one part of a recording that goes on in drive-003.mcap"),
        (paths[3:], "part 4 of a recording, without those before it"),
        ([paths[0], paths[3]], "without part 2, 3 of the recording"),
    ):
        with open_log(given) as log:
            list(log.messages())
            assert log.shortfall == said


def test_a_part_that_was_cut_does_not_hide_the_next(tmp_path: Path) -> None:
    paths, _ = split_log(tmp_path)
    data = paths[1].read_bytes()
    paths[1].write_bytes(data[: len(data) // 2])
    with open_log(paths) as log:
        found = [image.frame_index for image in images(log)]
        assert log.shortfall is not None
        assert "drive-002.mcap is cut short" in log.shortfall
    assert found[-1] == 34
    assert set(range(10)) < set(found)


@pytest.mark.parametrize("content", [b"", MCAP0_MAGIC[:5], MCAP0_MAGIC])
def test_a_part_that_was_not_begun_is_left_out(tmp_path: Path, content: bytes) -> None:
    paths, _ = split_log(tmp_path)
    unbegun = tmp_path / "drive-005.mcap"
    unbegun.write_bytes(content)
    told: list[str] = []
    assert group_parts([*paths, unbegun], told.append) == [tuple(paths)]
    assert told == [f"{unbegun}: left out, a part of a recording with nothing in it"]
    verb = {c.name: c for c in commands()}["verify"]
    done = CliRunner().invoke(verb, [*map(str, paths), str(unbegun), "--quick"])
    assert f"Warning: {told[0]}" in done.stderr
    # Alone, or beside other recordings, it is what was asked for.
    other = tmp_path / "other.mcap"
    record(ScriptedSource([frame(0)]), other)
    if len(content) < 8:
        with pytest.raises(InputError, match="expected an MCAP log"):
            group_parts([unbegun, other])
    else:
        assert group_parts([unbegun, other]) == [(unbegun,), (other,)]


def test_a_clock_that_is_set_back_makes_no_part_longer(tmp_path: Path) -> None:
    hour_ns = 3600 * 10**9
    later = (
        replace(f, timestamp_ns=f.timestamp_ns - hour_ns, arrival_ns=f.arrival_ns - hour_ns)
        if f.frame_index > 5
        else f
        for f in now_frames(40)
    )
    source = LiveScript(later, rate_hz=100)
    summary = record(source, tmp_path / "drive.mcap", split=SplitLimit(seconds=0.1))
    assert len(summary.parts) >= 3


def test_parts_are_never_replaced(tmp_path: Path) -> None:
    paths, _ = split_log(tmp_path)
    before = [path.read_bytes() for path in paths]
    for force in (False, True):
        with pytest.raises(InputError, match=r"parts do not exist, found drive-001\.mcap"):
            record(
                ScriptedSource([frame(0)]),
                tmp_path / "drive.mcap",
                split=SplitLimit(seconds=1),
                force=force,
            )
    assert [path.read_bytes() for path in paths] == before


def test_a_failed_recording_leaves_no_part(tmp_path: Path) -> None:
    items: list[Item] = [*(frame(i) for i in range(25)), InputError("a.png", "expected an image")]
    with pytest.raises(InputError):
        record(ScriptedSource(items), tmp_path / "drive.mcap", split=SplitLimit(seconds=1))
    assert list(tmp_path.iterdir()) == []


def test_where_no_further_part_can_be_made_the_last_one_goes_on(tmp_path: Path) -> None:
    def occupy(item: CapturedFrame) -> None:
        if item.frame_index == 0:
            (tmp_path / "drive-002.mcap").mkdir()

    source = LiveScript(now_frames(30), rate_hz=100, on_frame=occupy)
    summary = record(source, tmp_path / "drive.mcap", split=SplitLimit(seconds=0.1))
    assert [path.name for path in summary.parts] == ["drive-001.mcap"]
    with LogReader(summary.path) as log:
        records = list(log.records())
    assert sum(isinstance(r, LogImage) for r in records) == 30
    told = [r.message for r in records if isinstance(r, LogEvent)]
    assert sum(text.startswith("no further part can be made") for text in told) == 1


@pytest.mark.parametrize("at_its_end", [False, True])
def test_a_disk_that_fails_between_two_parts_leaves_no_stub(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at_its_end: bool
) -> None:
    """Before the part has its end, which then tells, or once it has."""
    sync, synced = McapOutput.sync, [0]

    def fail(self: McapOutput) -> None:
        if threading.current_thread().name == "log":
            synced[0] += 1
            if synced[0] == 1 + at_its_end:
                raise OSError(errno.EIO, os.strerror(errno.EIO))
        sync(self)

    monkeypatch.setattr(McapOutput, "sync", fail)
    source = LiveScript(now_frames(80), rate_hz=80)
    summary = record(source, tmp_path / "drive.mcap", split=SplitLimit(seconds=0.3))
    first = tmp_path / "drive-001.mcap"
    assert summary.ended == "failed"
    assert summary.parts == (first,)
    assert list(tmp_path.iterdir()) == [first]
    counts = summary.counts
    with LogReader(first) as log:
        assert [i.frame_index for i in images(log)] == list(range(counts.written))
        end = log.metadata["session_end"]
    # The one that the next part was for was taken, those after it perhaps.
    assert counts.dropped >= 1
    assert source.given - 1 <= counts.written + counts.dropped <= source.given
    if not at_its_end:
        assert end.items() >= counts.as_metadata().items()
        assert end["ended"].startswith("error: ")


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One recorded whole, `whole.mcap`, and in parts of half a second."""
    folder = tmp_path_factory.mktemp("drive")
    with LogReader(worlds.small_log(folder / "drawn.mcap")) as log:
        files = dict(log.attachments)
        exact = {r.frame_index: r for r in log.records() if not isinstance(r, LogImage | LogEvent)}
        frames = [
            CapturedFrame(
                i.frame_index,
                i.timestamp_ns,
                i.arrival_ns,
                i.data,
                i.format,
                exact[i.frame_index].T_map_camera,
            )
            for i in images(log)
        ]

    class Drive(ScriptedSource):
        image_size = (1280, 720)

    record(Drive([*frames], files), folder / "whole.mcap")
    record(Drive([*frames], files), folder / "drive.mcap", split=SplitLimit(seconds=0.5))
    return folder


def replay(*arguments: str | Path) -> None:
    command = {c.name: c for c in replay_commands()}["replay"]
    done = CliRunner().invoke(command, [str(a) for a in arguments], standalone_mode=False)
    if done.exception is not None:
        raise done.exception


def test_parts_replay_to_the_tables_of_the_whole_log(drive: Path, tmp_path: Path) -> None:
    parts = sorted(drive.glob("drive-*.mcap"))
    assert len(parts) == 3
    replay(drive / "whole.mcap", "--no-rrd", "-o", tmp_path / "whole")
    replay(*reversed(parts), "--no-rrd", "-o", tmp_path / "parts")
    for table in ("detections", "poses", "tracks", "truth"):
        a, b = (pd.read_parquet(tmp_path / n / f"{table}.parquet") for n in ("whole", "parts"))
        pd.testing.assert_frame_equal(a, b, check_exact=True)
    summary = json.loads((tmp_path / "parts/summary.json").read_text())
    assert summary["log_parts"] == [part.name for part in parts]
    assert summary["log_cut_short"] is None


def test_the_result_of_parts_is_named_after_the_recording(drive: Path) -> None:
    parts = sorted(drive.glob("drive-*.mcap"))
    replay(*parts, "--no-rrd", "--name", "all")
    assert (drive / "drive.results/all/summary.json").exists()
    # One part alone is a log of its own, at its place in the recording's time.
    replay(parts[1], "--no-rrd", "--name", "second")
    alone = pd.read_parquet(drive / "drive-002.results/second/truth.parquet")
    assert set(alone["frame_index"]) == set(range(5, 10))
    # It was measured while the first part was recorded.
    assert set(alone["kind"]) == {"exact"}
    summary = json.loads((drive / "drive-002.results/second/summary.json").read_text())
    assert "goes on in drive-003.mcap" in summary["log_cut_short"]


def test_names_of_parts() -> None:
    assert whole_path(Path("a/drive-012.mcap")) == Path("a/drive.mcap")
    assert whole_path(Path("a/drive-x.mcap")) == Path("a/drive-x.mcap")


@pytest.mark.parametrize(
    ("text", "limit"),
    [
        ("1GB", SplitLimit(bytes=10**9)),
        ("10 MiB", SplitLimit(bytes=10 * 2**20)),
        ("10min", SplitLimit(seconds=600)),
        ("1.5h", SplitLimit(seconds=5400)),
    ],
)
def test_what_a_limit_means(text: str, limit: SplitLimit) -> None:
    assert SplitLimit.parse(text) == limit


@pytest.mark.parametrize("text", ["10", "GB", "1 parsec", "10kB", "0s", "-1s", "nan s"])
def test_limits_that_are_none(text: str) -> None:
    with pytest.raises(ValueError, match="expected a size from 1MB or a duration such as 10min"):
        SplitLimit.parse(text)


def test_quantities() -> None:
    assert parse_size("200MB") == 200_000_000
    assert parse_size("0B") == 0
    assert parse_duration("90s") == 90
    for bad in ("90", "ten s", ""):
        with pytest.raises(ValueError, match="expected a duration"):
            parse_duration(bad)


@pytest.mark.parametrize(
    "option", [("--split", "big"), ("--duration", "10"), ("--min-free", "some")]
)
def test_wrong_quantities_are_wrong_usage(option: tuple[str, str]) -> None:
    command = {c.name: c for c in commands()}["record"]
    done = CliRunner().invoke(command, ["sample", *option])
    assert done.exit_code == 2
    assert option[0] in done.output
