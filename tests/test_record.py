"""Recording, attaching, telling what is in a log, and the files to start from."""

from __future__ import annotations

import json
import os
import signal
import tracemalloc
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from recorder.attach import attach
from recorder.attachments import merge_attachments, read_attachments
from recorder.capture.outages import Outages
from recorder.cli import commands
from recorder.errors import InputError
from recorder.files.camera_file import camera_yaml, parse_camera
from recorder.files.map_file import parse_map
from recorder.files.truth_file import parse_truth
from recorder.info import ImageCounter, log_info
from recorder.info_text import info_text
from recorder.log.reader import LogReader
from recorder.log.records import ExactPose, LogEvent, LogImage
from recorder.log.writer import LogWriter
from recorder.record import record
from recorder.record_text import ending_text
from recorder.session import git_state
from recorder.sources.base import CapturedFrame, SourceEvent
from recorder.sources.opening import open_source
from recorder.templates import CeilingGrid, write_templates
from replay.cli import commands as replay_commands
from tests.log_helpers import (
    TRUTH_YAML,
    attachments,
    camera,
    frame,
    images,
    png,
    same_image,
    write_log,
)
from tests.test_log import foreign_log
from tests.test_log_broken import SmallDisk

Item = CapturedFrame | SourceEvent | BaseException


class ScriptedSource:
    """Gives what it was given; raises what is an exception."""

    name = "scripted"
    note: str | None = None

    def __init__(self, items: list[Item], files: Mapping[str, bytes] | None = None) -> None:
        self._items = items
        self._files = files or {}

    def describe(self) -> dict[str, str]:
        return {"kind": "script"}

    @property
    def attachments(self) -> Mapping[str, bytes]:
        return self._files

    @property
    def image_size(self) -> tuple[int, int]:
        return (64, 48)

    def frame_count(self) -> int | None:
        return None

    def preparation(self) -> str | None:
        return self.note

    def frames(self) -> Iterator[CapturedFrame | SourceEvent]:
        for item in self._items:
            if isinstance(item, BaseException):
                raise item
            yield item


def images_of(path: Path) -> list[LogImage]:
    with LogReader(path) as log:
        return images(log)


def run(*arguments: str | Path) -> Result:
    command = {c.name: c for c in commands()}[str(arguments[0])]
    return CliRunner().invoke(command, [str(a) for a in arguments[1:]], standalone_mode=False)


def test_frames_events_and_files_go_into_the_log(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    frames = [frame(i) for i in (0, 1, 3)]
    lost = SourceEvent(frames[1].timestamp_ns, "warning", "frame 2 is corrupt", dropped=1)
    seen: list[CapturedFrame] = []
    summary = record(
        ScriptedSource([*frames[:2], lost, frames[2]], attachments()),
        path,
        attachments={"truth.csv": b"frame_index,x_m,y_m,z_m,qx,qy,qz,qw\n0,1,2,3,0,0,0,1\n"},
        sinks=[seen.append],
    )
    assert seen == frames
    assert (summary.frames_written, summary.frames_dropped, summary.ended) == (3, 1, "complete")
    assert summary.duration_s == pytest.approx(0.3)
    assert summary.bytes_written == path.stat().st_size
    assert summary.missing == ()
    with LogReader(path) as log:
        assert all(map(same_image, images(log), frames))
        assert sum(isinstance(r, ExactPose) for r in log.records()) == 3
        assert [r.message for r in log.records() if isinstance(r, LogEvent)] == [lost.message]
        # There is one truth: the one that was given.
        assert set(log.attachments) == {"camera.yaml", "map.yaml", "truth.csv"}
        assert log.metadata["session"]["source.kind"] == "script"
        assert log.metadata["session"]["log_format"] == "1"


def test_a_log_need_not_name_the_machine(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    session = {"host": "-", "platform": "-", "git": "-", "operator": "A. B."}
    record(ScriptedSource([frame(0)]), path, session=session)
    with LogReader(path) as log:
        found = log.metadata["session"]
    assert found.items() >= session.items()
    assert found["source"] == "scripted"
    assert found["opencv"]


def test_an_interrupted_recording_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    summary = record(ScriptedSource([frame(0), frame(1), KeyboardInterrupt()]), path)
    assert (summary.ended, summary.frames_written) == ("interrupted", 2)
    assert summary.missing == ("camera.yaml", "map.yaml")
    assert log_info(path).ended == "interrupted"


def test_a_full_disk_ends_a_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    small = partial(LogWriter, open_raw=lambda path: SmallDisk(path, 3_000_000))
    monkeypatch.setattr("recorder.record.LogWriter", small)
    path = tmp_path / "log.mcap"
    summary = record(ScriptedSource([frame(i, size=50_000) for i in range(100)]), path)
    assert summary.ended == "disk_full"
    assert "the disk is full" in (ending_text(summary) or "")
    with LogReader(path) as log:
        assert 30 < len(images(log)) <= summary.frames_written < 70


def test_a_request_to_terminate_is_an_interruption(tmp_path: Path) -> None:
    class Endless(ScriptedSource):
        def frames(self) -> Iterator[CapturedFrame | SourceEvent]:
            return (frame(i) for i in range(10**6))

    def terminate(_: CapturedFrame) -> None:
        os.kill(os.getpid(), signal.SIGTERM)

    path = tmp_path / "log.mcap"
    summary = record(Endless([]), path, sinks=[terminate])
    assert summary.ended == "interrupted"
    assert len(images_of(path)) == summary.frames_written
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


@pytest.mark.parametrize(
    "items",
    [
        [frame(0), InputError("a.png", "expected an image")],
        [frame(0), CapturedFrame(1, 0, 0, png(10, 10), "png")],
        [],
        [KeyboardInterrupt()],
    ],
)
def test_a_failed_recording_leaves_nothing(tmp_path: Path, items: list[Item]) -> None:
    path = tmp_path / "log.mcap"
    if items and isinstance(items[0], KeyboardInterrupt):
        assert record(ScriptedSource(items), path).frames_written == 0
    else:
        with pytest.raises(InputError):
            record(ScriptedSource(items), path)
    assert list(tmp_path.iterdir()) == []


def test_a_failed_recording_keeps_the_log_it_would_replace(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    write_log(path, 2)
    before = path.read_bytes()
    with pytest.raises(InputError):
        record(ScriptedSource([frame(0), InputError("a", "b")]), path, force=True)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_calibration_for_another_size_is_refused_at_once(tmp_path: Path) -> None:
    files = {"camera.yaml": camera_yaml(camera(48, 64))}
    with pytest.raises(InputError, match=r"for 64x48.*found one for 48x64"):
        record(ScriptedSource([frame(0)]), tmp_path / "log.mcap", attachments=files)
    assert list(tmp_path.iterdir()) == []


def test_a_real_video_twice_gives_the_same_log(tmp_path: Path, shared_data: Path) -> None:
    folder = shared_data / "moving_board" / "cam_0"
    given = read_attachments(folder / "camera.yaml", folder / "map.yaml", folder / "truth.csv")
    logs = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
    for path in logs:
        summary = record(open_source(str(folder / "video.mp4")), path, attachments=given)
    assert logs[0].read_bytes() == logs[1].read_bytes()
    assert summary.frames_written == 57
    info = log_info(logs[0])
    assert (info.images.count, info.images.missing, info.images.gaps) == (57, 0, ())
    assert (info.images.width_px, info.images.height_px) == (1280, 720)
    assert info.images.rate_hz == pytest.approx(6.0)
    assert info.map is not None
    assert (info.map.markers, info.map.frame, info.map.sizes_m) == (10, "board", (0.0405,))
    assert info.truth is not None
    assert info.truth.trajectory_poses == 57
    with LogReader(logs[0]) as log:
        assert dict(log.attachments) == {
            "camera.yaml": (folder / "camera.yaml").read_bytes(),
            "map.yaml": (folder / "map.yaml").read_bytes(),
            "truth.csv": (folder / "truth.csv").read_bytes(),
        }
        shown = [c.topic for _, c, _ in log.messages() if c.topic == "/truth/pose"]
        assert len(shown) == 57


def test_a_folder_of_real_images(tmp_path: Path, shared_data: Path) -> None:
    folder = shared_data / "field_2023"
    path = tmp_path / "log.mcap"
    given = read_attachments(folder / "camera.yaml", folder / "map.yaml", None)
    record(open_source(str(folder / "images")), path, attachments=given)
    with LogReader(path) as log:
        found = images(log)
    assert [i.data for i in found] == [
        p.read_bytes() for p in sorted((folder / "images").iterdir())
    ]
    assert [i.timestamp_ns for i in found] == [i * 10**9 for i in range(5)]


def test_attach_changes_the_files_and_nothing_else(tmp_path: Path) -> None:
    path, copy = tmp_path / "a.mcap", tmp_path / "b.mcap"
    write_log(path, 30)
    other = TRUTH_YAML.replace(b"from_s: 2, to_s: 3", b"from_s: 1, to_s: 2")
    attach(path, copy, {"truth.yaml": other})

    def content(log: LogReader) -> list[tuple[str, int, int, int, bytes]]:
        return [
            (c.topic, m.sequence, m.publish_time, m.log_time, m.data)
            for _, c, m in log.messages()
            if not c.topic.startswith("/truth/p")
        ]

    with LogReader(path) as old, LogReader(copy) as new:
        assert content(new) == content(old)
        assert new.metadata["session"] == old.metadata["session"]
        assert new.metadata["session_end"] == old.metadata["session_end"]
        assert new.metadata["attached"]["to_sha256"] == old.sha256()
        assert dict(new.attachments) == {**old.attachments, "truth.yaml": other}
        shown = [m.publish_time for _, c, m in new.messages() if c.topic == "/truth/pose"]
        assert new.start_ns is not None
        assert shown == [new.start_ns, new.start_ns + 10**9]


def test_attach_to_a_log_of_another_make_makes_it_replayable(tmp_path: Path) -> None:
    path, copy = tmp_path / "a.mcap", tmp_path / "b.mcap"
    foreign_log(path)
    attach(path, copy, attachments())
    with LogReader(copy) as log:
        assert [i.frame_index for i in images(log)] == [0, 1, 2]
        assert log.marker_map() is not None
        topics = [c.topic for _, c, _ in log.messages()]
    assert topics.count("/camera/calibration") == 1
    assert topics.index("/tf") < topics.index("/camera/image")


def test_attach_to_a_cut_log_says_that_it_was_cut(tmp_path: Path) -> None:
    path, copy = tmp_path / "a.mcap", tmp_path / "b.mcap"
    write_log(path, 30)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    attach(path, copy, {"truth.yaml": TRUTH_YAML})
    ended = log_info(copy).ended
    assert ended == log_info(path).ended
    assert ended.startswith("cut short after 1")
    with LogReader(copy) as log:
        list(log.messages())
        assert log.cut_short is None
        assert log.shortfall == ended
    assert log_info(copy).as_dict()["shortfall"] == ended


@pytest.mark.parametrize("ended", ["complete", "interrupted", "disk_full"])
def test_a_copy_ends_as_its_original_did(tmp_path: Path, ended: str) -> None:
    """Also where the original has lost its index."""
    path, copy = tmp_path / "a.mcap", tmp_path / "b.mcap"
    with LogWriter(path, attachments=attachments(), session={}) as writer:
        writer.write_frame(frame(0))
        writer.write_frame(frame(2))
        writer.end_as(ended)
    path.write_bytes(path.read_bytes()[:-60])
    attach(path, copy, {"truth.yaml": TRUTH_YAML})
    with LogReader(copy) as log:
        assert log.ending == ended
        assert (log.shortfall is None) == (ended != "disk_full")
        assert log.metadata["session_end"]["frames_dropped"] == "1"


def test_a_copy_keeps_what_the_original_says_of_its_end(tmp_path: Path) -> None:
    """Lost connections, and what a later version may add; what the copy has it counts itself."""
    path, copy = tmp_path / "a.mcap", tmp_path / "b.mcap"
    with LogWriter(path, attachments=attachments(), session={}) as writer:
        writer.write_frame(frame(0))
        writer.write_event(frame(0).timestamp_ns, "error", "connection lost")
        lost = Outages(3, 12.5, at_end=True).as_metadata()
        writer.end_as("interrupted", display_dropped="7", later="more", **lost)
    attach(path, copy, {"truth.yaml": TRUTH_YAML})
    with LogReader(path) as log, LogReader(copy) as attached:
        assert attached.metadata["session_end"] == log.metadata["session_end"]
    recorded = log_info(copy).recorded
    assert recorded == log_info(path).recorded
    assert (recorded["connection_lost"], recorded["connection_lost_s"]) == (3, 12.5)


def test_attach_refuses_what_does_not_fit(tmp_path: Path) -> None:
    path, copy = tmp_path / "a.mcap", tmp_path / "b.mcap"
    write_log(path, 3)
    before = path.read_bytes()
    with pytest.raises(InputError, match="expected a calibration for 64x48"):
        attach(path, copy, {"camera.yaml": camera_yaml(camera(48, 64))})
    with pytest.raises(InputError, match="expected the map's frame"):
        attach(path, copy, {"truth.yaml": TRUTH_YAML.replace(b"frame: map", b"frame: hall")})
    with pytest.raises(InputError, match="expected a new file"):
        attach(path, path, {"truth.yaml": TRUTH_YAML})
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_bytes() == before
    attach(path, path, {"truth.yaml": TRUTH_YAML + b"# more\n"}, force=True)
    with LogReader(path) as log:
        assert log.attachments["truth.yaml"].endswith(b"# more\n")
        assert len(images(log)) == 3


def test_there_is_one_truth() -> None:
    base = {"camera.yaml": b"c", "truth.yaml": b"t", "notes.txt": b"n"}
    assert merge_attachments(base, {"truth.tum": b"u"}) == {
        "camera.yaml": b"c",
        "notes.txt": b"n",
        "truth.tum": b"u",
    }
    assert merge_attachments(base, {}) == base


def test_given_files_are_named_in_messages(tmp_path: Path) -> None:
    path = tmp_path / "my-map.yaml"
    path.write_text("dictionary: DICT_6X6_1000\nmarkers: []\n")
    with pytest.raises(InputError, match=r"my-map\.yaml: markers: expected at least 1"):
        read_attachments(None, path, None)


def test_info_finds_gaps(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    times = [0, 1, 2, 3, 5, 6, 9]  # tenths of a second: a pause without loss, then a loss
    indices = [0, 1, 2, 3, 4, 5, 8]
    frames: list[Item] = [
        CapturedFrame(i, t * 10**8, t * 10**8, png(), "png")
        for i, t in zip(indices, times, strict=True)
    ]
    record(ScriptedSource(frames, attachments()), path)
    info = log_info(path)
    assert info.images.missing == 2
    assert [(g.after_frame, g.at_s, g.missing) for g in info.images.gaps] == [
        (3, 0.3, 0),
        (5, 0.6, 2),
    ]
    assert [g.pause_s for g in info.images.gaps] == pytest.approx([0.2, 0.3])
    assert info.images.duration_s == pytest.approx(0.9)
    assert info.events_by_level == {"warning": 1}
    assert info.truth is not None
    assert (info.truth.path_points, info.truth.stood_poses, info.truth.exact_poses) == (3, 2, 0)
    assert info.session["source"] == "scripted"


def test_counting_images_takes_16_bytes_for_each() -> None:
    counter = ImageCounter(0)
    image = LogImage(0, 0, 0, b"", "png")
    counter.add(image)
    tracemalloc.start()
    for i in range(1, 20_000):
        counter.add(replace(image, frame_index=i, timestamp_ns=1_700_000_000_000_000_000 + i))
    size, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert size < 25 * 20_000
    assert counter.info().count == 20_000


def test_info_counts_one_thing_as_one(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    one = "poses:\n  - {from_s: 0, to_s: 1, x_m: 0.1, y_m: 0.2, std_m: 0.005}\n"
    with LogWriter(path, attachments={"truth.yaml": one.encode()}, session={}) as writer:
        writer.write_frame(frame(0))
        writer.write_frame(frame(2))
    text = info_text(log_info(path))
    assert "1 pose stood at, 2 exact poses" in text
    assert ", 1 frame missing" in text


def test_info_on_a_log_with_a_bad_file_says_so_and_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    write_log(path, 3)
    data = path.read_bytes()
    broken = data.replace(b"size_m: 0.15", b"size_n: 0.15")
    assert broken != data
    # The attachment's checksum is wrong now: it is left out.
    path.write_bytes(broken)
    ended = log_info(path).ended
    assert ended.startswith("damaged: an attachment's checksum is wrong after 0 frames")


def test_the_templates_are_valid_as_they_are(tmp_path: Path) -> None:
    grid = CeilingGrid(rows=2, cols=3, pitch_m=0.8, height_m=2.6, size_m=0.2)
    paths = write_templates(tmp_path / "new" / "hall", grid)
    assert [p.name for p in paths] == ["camera.yaml", "map.yaml", "truth.yaml", "settings.yaml"]
    camera_path, map_path, truth_path, settings_path = paths
    assert parse_camera(camera_path.read_bytes(), camera_path).image_size == (1920, 1080)
    marker_map = parse_map(map_path.read_bytes(), map_path)
    expected = [[0.8 * c, 0.8 * r, 2.6] for r in range(2) for c in range(3)]
    np.testing.assert_allclose([m.centre_m for m in marker_map.markers], expected, atol=1e-9)
    assert all(m.size_m == 0.2 for m in marker_map.markers)
    np.testing.assert_allclose([m.normal for m in marker_map.markers], [[0, 0, -1]] * 6)
    truth = parse_truth(truth_path.read_bytes(), truth_path)
    assert truth.frame == marker_map.frame
    from pipeline.localizer import PipelineSettings
    from recorder.files.yaml_file import load_yaml, validate

    # The file shows the defaults.
    assert validate(PipelineSettings, load_yaml(settings_path), settings_path) == PipelineSettings()


def test_templates_do_not_replace_files(tmp_path: Path) -> None:
    (tmp_path / "truth.yaml").write_text("mine")
    with pytest.raises(InputError, match=r"truth\.yaml: expected no such file yet"):
        write_templates(tmp_path, CeilingGrid())
    assert [p.name for p in tmp_path.iterdir()] == ["truth.yaml"]
    write_templates(tmp_path, CeilingGrid(), force=True)
    assert (tmp_path / "truth.yaml").read_text() != "mine"


def test_a_grid_that_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="1 to 50 markers"):
        CeilingGrid(rows=6, cols=9, dictionary="DICT_4X4_50")
    with pytest.raises(ValueError, match="expected finite lengths"):
        CeilingGrid(height_m=float("inf"))
    with pytest.raises(ValueError, match="smaller than their pitch"):
        CeilingGrid(pitch_m=0.1, size_m=0.1)


def test_git_state_is_that_of_this_checkout_only(tmp_path: Path) -> None:
    assert git_state(tmp_path) == "none"
    (tmp_path / ".git").write_text("nonsense")
    assert git_state(tmp_path) == "none"


def image_folder(folder: Path, count: int = 3) -> Path:
    folder.mkdir()
    for i in range(count):
        (folder / f"{i}.png").write_bytes(png())
    return folder


def test_record_and_info_commands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    image_folder(tmp_path / "shots")
    for name, data in attachments().items():
        (tmp_path / name).write_bytes(data)
    given = ["--camera", "camera.yaml", "--map", "map.yaml", "--truth", "truth.yaml"]
    done = run("record", "shots", *given, "--fps", "2", "--start", "2025-06-01T12:00:00Z")
    assert done.exception is None
    (path,) = (tmp_path / "logs").iterdir()
    assert path.name.startswith("shots-20")
    assert f"logs/{path.name}: 3 frames, 1.000 s" in done.output
    told = run("info", path, "--json")
    info = json.loads(told.output)
    assert info["images"]["count"] == 3
    assert info["images"]["first_timestamp_ns"] == 1748779200 * 10**9
    assert info["camera"]["fx_px"] == 50.0
    text = run("info", path).output
    assert "3 64x48 png" in text
    assert "4 markers of 0.15 m" in text
    done = run("attach", path, "--truth", "truth.yaml", "-o", "copy.mcap")
    assert "copy.mcap: truth.yaml attached" in done.output


def test_record_says_what_a_replay_will_ask_for(tmp_path: Path) -> None:
    done = run("record", image_folder(tmp_path / "shots"), "-o", tmp_path / "a.mcap")
    assert "without camera.yaml and map.yaml: replay needs --camera and --map" in done.output


def test_what_takes_long_is_said_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = ScriptedSource([frame(0)])
    monkeypatch.setattr("recorder.sources.opening.open_source", lambda spec, options: source)
    assert run("record", "camera", "-o", tmp_path / "a.mcap").stderr.strip() == ""
    source.note = "warming up"
    assert run("record", "camera", "-o", tmp_path / "b.mcap").stderr.strip() == "warming up"


def test_an_interrupted_command_exits_with_130(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.mcap"
    items: list[Item] = [frame(0), KeyboardInterrupt()]
    monkeypatch.setattr(
        "recorder.sources.opening.open_source", lambda spec, options: ScriptedSource(items)
    )
    done = run("record", "camera", "-o", path)
    assert done.return_value == 130
    assert "Interrupted. The log is complete up to here." in done.output
    assert log_info(path).images.count == 1


def test_messages_name_the_file_that_was_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    image_folder(tmp_path / "shots")
    (tmp_path / "left.yaml").write_bytes(camera_yaml(camera(48, 64)))
    write_log(tmp_path / "a.mcap", 1)
    hall = tmp_path / "hall.yaml"
    hall.write_bytes(TRUTH_YAML.replace(b"frame: map", b"frame: hall"))
    for arguments, message in (
        (("record", "shots", "--camera", "left.yaml"), "left.yaml: expected a calibration for 64"),
        (("attach", "a.mcap", "--camera", "left.yaml", "-o", "b.mcap"), "left.yaml: expected a ca"),
        (("attach", "a.mcap", "--truth", hall, "-o", "b.mcap"), f"{hall}: frame: expected the map"),
    ):
        assert str(run(*arguments).exception).startswith(message)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("init", "--height-m", "inf"), "--height-m': expected a finite number, found 'inf'"),
        (("init", "--height-m", "nan"), "--height-m': expected a finite number, found 'nan'"),
        (("init", "--height-m", "-1"), "--height-m': expected a number above 0, found '-1'"),
        (("init", "--pitch-m", "nan"), "--pitch-m': expected a finite number"),
        (("init", "--size-m", "0"), "--size-m': expected a number above 0"),
        (("init", "--size-m", "wide"), "--size-m': 'wide' is not a valid float"),
        (("record", "x.mp4", "--fps", "nan"), "--fps: expected a rate above 0, found 'nan'"),
        (("record", "x.mp4", "--fps", "inf"), "--fps: expected a rate above 0, found 'inf'"),
        (("replay", "x.mcap", "--from", "nan"), "--from': expected a finite number, found 'nan'"),
        (("replay", "x.mcap", "--to", "-inf"), "--to': expected a finite number, found '-inf'"),
    ],
)
def test_a_number_that_cannot_be_is_wrong_usage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    command = {c.name: c for c in [*commands(), *replay_commands()]}[arguments[0]]
    done = CliRunner().invoke(command, arguments[1:])
    assert done.exit_code == 2
    assert [line for line in done.output.splitlines() if message in line]
    assert list(tmp_path.iterdir()) == []


def test_a_failed_command_leaves_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    image_folder(tmp_path / "shots")
    (tmp_path / "camera.yaml").write_bytes(camera_yaml(camera(48, 64)))
    done = run("record", "shots", "--camera", "camera.yaml")
    assert isinstance(done.exception, InputError)
    assert not (tmp_path / "logs").exists()


@pytest.mark.parametrize("command", commands(), ids=lambda c: str(c.name))
def test_help_ends_in_a_worked_example(command: object) -> None:
    name = str(command.name)  # type: ignore[attr-defined]
    lines = run(name, "--help").output.rstrip().splitlines()
    assert lines[-1].strip().startswith(f"arucolog {name} ")
    assert lines[-2].strip() == "Example:"


def test_images_are_counted_in_both_ways(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    write_log(path, 12)
    with LogReader(path) as log:
        assert sum(isinstance(r, LogImage) for r in log.records()) == log.image_count() == 12
