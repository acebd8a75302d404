"""What goes into a log comes out of it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.writer import Writer as ProtobufWriter

from pipeline.camera import Camera
from pipeline.geometry import Pose
from recorder.errors import InputError
from recorder.log import messages
from recorder.log.reader import LogReader
from recorder.log.records import ExactPose, LogEvent, LogImage
from recorder.log.writer import LogWriter
from recorder.sources.base import CapturedFrame
from tests.log_helpers import (
    TRUTH_YAML,
    attachments,
    camera,
    frame,
    images,
    marker_map,
    png,
    same_image,
    write_log,
)

STAMPS = st.integers(0, 2**62)
POSES = st.builds(
    Pose.from_quat,
    st.tuples(*[st.floats(-1e3, 1e3)] * 3),
    st.tuples(*[st.floats(-1, 1)] * 3, st.floats(0.1, 1)),
)
FRAMES = st.lists(
    st.tuples(
        st.integers(1, 1000), STAMPS, STAMPS, st.binary(max_size=300), st.none() | POSES
    ),
    max_size=12,
)  # fmt: skip


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
@given(
    content=FRAMES,
    session=st.dictionaries(st.text(max_size=9), st.text(max_size=9), max_size=3),
    extra=st.dictionaries(st.text(min_size=1, max_size=9), st.binary(max_size=50), max_size=3),
)
def test_round_trip(
    tmp_path: Path,
    content: list[tuple[int, int, int, bytes, Pose | None]],
    session: dict[str, str],
    extra: dict[str, bytes],
) -> None:
    frames = []
    index = -1
    for step, capture, arrival, payload, pose in content:
        index += step
        frames.append(CapturedFrame(index, capture, arrival, png(payload=payload), "png", pose))
    files = {**extra, **attachments()}
    path = tmp_path / "log.mcap"
    path.unlink(missing_ok=True)
    with LogWriter(path, attachments=files, session=session) as writer:
        for item in frames:
            writer.write_frame(item)
    with LogReader(path) as log:
        records = list(log.records())
        assert log.cut_short is None
        assert dict(log.attachments) == files
        assert log.metadata["session"].items() >= session.items()
        assert log.start_ns == (frames[0].timestamp_ns if frames else None)
        assert log.image_count() == len(frames)
    found = [r for r in records if isinstance(r, LogImage)]
    assert len(found) == len(frames)
    assert all(map(same_image, found, frames))
    exact = [r for r in records if isinstance(r, ExactPose)]
    known = [f for f in frames if f.T_map_camera is not None]
    assert [(e.frame_index, e.timestamp_ns) for e in exact] == [
        (f.frame_index, f.timestamp_ns) for f in known
    ]
    for e, f in zip(exact, known, strict=True):
        assert f.T_map_camera is not None
        np.testing.assert_array_equal(e.T_map_camera.translation, f.T_map_camera.translation)
        np.testing.assert_allclose(
            e.T_map_camera.rotation, f.T_map_camera.rotation, rtol=0, atol=1e-14
        )


@given(STAMPS)
def test_times_survive_both_ways(timestamp_ns: int) -> None:
    assert messages.from_timestamp(messages.to_timestamp(timestamp_ns)) == timestamp_ns


@pytest.mark.parametrize(
    ("model", "count", "theirs"),
    [
        ("plumb_bob", 5, "plumb_bob"),
        ("rational_polynomial", 8, "rational_polynomial"),
        ("equidistant", 4, "kannala_brandt"),
    ],
)
def test_calibration_message_round_trips(model: str, count: int, theirs: str) -> None:
    ours = Camera(64, 48, camera().camera_matrix, model, np.arange(count) / 100)  # type: ignore[arg-type]
    message = messages.to_calibration(5, ours)
    assert message.distortion_model == theirs
    back = messages.from_calibration(message)
    assert (back.distortion_model, back.image_size) == (model, (64, 48))
    np.testing.assert_array_equal(back.camera_matrix, ours.camera_matrix)
    np.testing.assert_array_equal(back.dist_coeffs, ours.dist_coeffs)


def test_the_log_follows_its_format(tmp_path: Path) -> None:
    """Order of the records, topics, stamps and sequence, seen by mcap's own reader."""
    path = tmp_path / "log.mcap"
    frames = write_log(path)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        counts = {
            summary.channels[channel].topic: count
            for channel, count in summary.statistics.channel_message_counts.items()  # type: ignore[union-attr]
        }
        assert counts == {
            "/camera/image": 30,
            "/camera/calibration": 1,
            "/tf": 1,
            "/truth/path": 1,
            "/truth/pose": 2,
            "/truth/exact": 30,
        }
        found = list(reader.iter_messages(log_time_order=False))
    # Everything that holds for the whole log comes before the first image.
    first = [channel.topic for _, channel, _ in found].index("/camera/image")
    assert {channel.topic for _, channel, _ in found[:first]} == {
        "/camera/calibration",
        "/tf",
        "/truth/path",
        "/truth/pose",
    }
    images_found = [m for _, channel, m in found if channel.topic == "/camera/image"]
    assert [(m.sequence, m.publish_time, m.log_time) for m in images_found] == [
        (f.frame_index, f.timestamp_ns, f.arrival_ns) for f in frames
    ]
    assert all(chunk.compression == "" for chunk in summary.chunk_indexes)
    spans = [c.message_end_time - c.message_start_time for c in summary.chunk_indexes]
    assert max(spans) < 500_000_000
    offsets = [c.chunk_start_offset for c in summary.chunk_indexes]
    assert all(a.offset < min(offsets) for a in summary.attachment_indexes)


def test_chunks_close_at_one_mebibyte(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    write_log(path, 40, step_ns=1000, size=100_000)
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    sizes = [chunk.uncompressed_size for chunk in summary.chunk_indexes]
    assert max(sizes) < (1 << 20) + 110_000
    assert min(sizes[:-1]) > 1 << 20


def test_what_the_files_say_is_read_back(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    write_log(path, 3)
    with LogReader(path) as log:
        found_camera, found_map, truth = log.camera(), log.marker_map(), log.truth()
        assert log.attachments["truth.yaml"] == TRUTH_YAML
        assert log.metadata["session_end"]["ended"] == "complete"
        assert log.metadata["session_end"]["frames_written"] == "3"
    assert found_camera is not None
    np.testing.assert_array_equal(found_camera.camera_matrix, camera().camera_matrix)
    assert found_map is not None
    assert found_map.ids == marker_map().ids
    assert truth is not None
    assert len(truth.poses) == 2


def test_measured_poses_are_shown_when_the_log_reaches_them(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    frames = write_log(path, 30)
    start_ns = frames[0].timestamp_ns
    with LogReader(path) as log:
        shown = [m.publish_time for _, c, m in log.messages() if c.topic == "/truth/pose"]
    assert shown == [start_ns, start_ns + 2 * 10**9]


def test_a_span_of_the_log_is_half_open(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    write_log(path, 30)
    with LogReader(path) as log:
        records = list(log.records(from_s=0.5, to_s=1.0))
        assert {r.frame_index for r in records if not isinstance(r, LogEvent)} == {5, 6, 7, 8, 9}
        # A second pass starts again, from the beginning.
        assert len(images(log)) == 30


def test_lost_frames_are_counted_and_noted(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with LogWriter(path, attachments={}, session={}) as writer:
        for index in (3, 4, 8):
            writer.write_frame(frame(index))
        # One that is announced and then shows as a gap counts once.
        writer.write_event(frame(9).timestamp_ns, "warning", "frame 9 is corrupt", dropped=1)
        writer.write_frame(frame(10))
        writer.write_event(frame(11).timestamp_ns, "error", "gone", name="camera", dropped=1)
    with LogReader(path) as log:
        events = [r for r in log.records() if isinstance(r, LogEvent)]
        end = log.metadata["session_end"]
    assert end.items() >= {"frames_written": "4", "frames_dropped": "5", "events": "3"}.items()
    assert [(e.level, e.message, e.name) for e in events] == [
        ("warning", "3 frames lost before frame 8", "recorder"),
        ("warning", "frame 9 is corrupt", "recorder"),
        ("error", "gone", "camera"),
    ]


def test_images_of_another_size_than_the_calibration_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    odd = CapturedFrame(0, 0, 0, png(48, 64), "png")
    with (
        pytest.raises(InputError, match=r"frame 0: expected images of 64x48.*found 48x64"),
        LogWriter(path, attachments=attachments(), session={}) as writer,
    ):
        writer.write_frame(odd)
    with LogWriter(tmp_path / "b.mcap", attachments={}, session={}) as writer:
        writer.write_frame(frame(0))
        with pytest.raises(InputError, match="as the frames before"):
            writer.write_frame(CapturedFrame(1, 0, 0, png(48, 64), "png"))


def test_an_unreadable_image_is_kept_and_noted(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with LogWriter(path, attachments=attachments(), session={}) as writer:
        writer.write_frame(CapturedFrame(0, 0, 0, b"garbage", "jpeg"))
    with LogReader(path) as log:
        event, image = log.records()
    assert isinstance(image, LogImage)
    assert image.data == b"garbage"
    assert isinstance(event, LogEvent)
    assert event.message == "frame 0 is not a readable jpeg image"


@pytest.mark.parametrize("item", [frame(4), CapturedFrame(9, -1, 0, png(), "png")])
def test_frames_that_cannot_be_are_refused(tmp_path: Path, item: CapturedFrame) -> None:
    with LogWriter(tmp_path / "log.mcap", attachments={}, session={}) as writer:
        writer.write_frame(frame(4))
        with pytest.raises(ValueError, match="expected a frame number"):
            writer.write_frame(item)


def test_a_log_that_exists_is_kept_until_the_new_one_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    write_log(path, 2)
    old = path.read_bytes()
    with pytest.raises(InputError, match="expected a new file"):
        LogWriter(path, attachments={}, session={})
    with LogWriter(path, attachments={}, session={}, force=True) as writer:
        writer.write_frame(frame(0))
        assert path.read_bytes() == old
    assert [p.name for p in tmp_path.iterdir()] == ["log.mcap"]
    with LogReader(path) as log:
        assert len(images(log)) == 1


def test_a_malformed_attachment_leaves_no_log(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"map\.yaml"):
        LogWriter(tmp_path / "log.mcap", attachments={"map.yaml": b"a: 1"}, session={})
    assert list(tmp_path.iterdir()) == []


def foreign_log(path: Path, *, calibrated: bool = True) -> None:
    """As another tool writes it: no attachments, no sequence, compressed chunks."""
    with path.open("wb") as file, ProtobufWriter(file) as writer:
        if calibrated:
            calibration = messages.to_calibration(0, camera())
            writer.write_message("/camera/calibration", calibration, 0, 0)
        for i in range(3):
            image = messages.to_image(i * 10**8, png(), "png")
            writer.write_message("/camera/image", image, i * 10**8 + 1, i * 10**8)


def test_a_log_of_another_make_is_read(tmp_path: Path) -> None:
    path = tmp_path / "other.mcap"
    foreign_log(path)
    with LogReader(path) as log:
        found = log.camera()
        assert [i.frame_index for i in images(log)] == [0, 1, 2]
        assert log.marker_map() is None
        assert log.truth() is None
        assert log.start_ns == 0
    assert found is not None
    np.testing.assert_array_equal(found.dist_coeffs, camera().dist_coeffs)
    foreign_log(path, calibrated=False)
    with LogReader(path) as log:
        assert log.camera() is None


def test_a_time_that_no_clock_gives_is_said(tmp_path: Path) -> None:
    path = tmp_path / "other.mcap"
    with path.open("wb") as file, ProtobufWriter(file) as writer:
        writer.write_message("/camera/image", messages.to_image(0, png(), "png"), 0, 2**63)
    with LogReader(path) as log, pytest.raises(InputError, match=r"expected a time before 2262"):
        list(log.records())


def test_a_topic_with_another_schema_is_named(tmp_path: Path) -> None:
    path = tmp_path / "other.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("sensor_msgs/Image", "ros1msg", b"")
        channel = writer.register_channel("/camera/image", "ros1", schema)
        writer.add_message(channel, 0, b"x", 0)
        writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(InputError, match=r"/camera/image: expected foxglove.CompressedImage"):
        LogReader(path)


def test_the_image_message_is_what_other_tools_expect() -> None:
    message = messages.to_image(1_500_000_000, b"bytes", "jpeg")
    back = CompressedImage.FromString(message.SerializeToString())
    assert (back.timestamp.seconds, back.timestamp.nanos) == (1, 500_000_000)
    assert (back.frame_id, back.format, back.data) == ("camera", "jpeg", b"bytes")


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="no peak memory to be read")
def test_memory_stays_small_on_a_long_log(tmp_path: Path) -> None:
    """200 MB are read with less than 30 MB above what an import takes."""
    path = tmp_path / "log.mcap"
    with LogWriter(path, attachments=attachments(), session={}) as writer:
        data = png(payload=bytes(1_000_000))
        for i in range(200):
            writer.write_frame(CapturedFrame(i, i * 10**8, i * 10**8, data, "png"))
    script = (
        "import re, sys\n"
        "from pathlib import Path\n"
        "from recorder.log.reader import LogReader\n"
        "def used():\n"
        "    status = Path('/proc/self/status').read_text()\n"
        "    return int(re.search(r'VmHWM:\\s+(\\d+)', status)[1])\n"
        "before = used()\n"
        "n = sum(1 for _ in LogReader(Path(sys.argv[1])).records())\n"
        "print(n, used() - before)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(path)],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).resolve().parents[1],
    )
    count, kilobytes = map(int, done.stdout.split())
    assert count == 200
    assert kilobytes < 30_000


def test_the_log_opens_in_rerun_by_itself(tmp_path: Path) -> None:
    chunk = pytest.importorskip("rerun.chunk")
    path, rrd = tmp_path / "log.mcap", tmp_path / "log.rrd"
    write_log(path, 6)
    command = [str(Path(sys.executable).with_name("rerun")), "mcap", "convert"]
    subprocess.run([*command, str(path), "-o", str(rrd)], check=True, capture_output=True)
    found: dict[str, set[str]] = {}
    rows: dict[str, int] = {}
    for item in chunk.RrdReader(str(rrd)).stream():
        batch = item.to_record_batch()
        names = {name.split(":")[0] for name in batch.schema.names}
        found.setdefault(item.entity_path, set()).update(names)
        if "Transform3D" in names:
            rows[item.entity_path] = rows.get(item.entity_path, 0) + batch.num_rows
    assert "EncodedImage" in found["/camera/image"]
    assert "Pinhole" in found["/camera/calibration"]
    assert "InstancePoses3D" in found["/truth/path"]
    assert rows["/tf"] == len(marker_map().markers)
