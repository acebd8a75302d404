"""ROS bags as sources: both versions, every storage, every kind of image."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from recorder.errors import InputError
from recorder.files.camera_file import parse_camera
from recorder.image_header import ImageHeader, read_header
from recorder.log.messages import to_image
from recorder.log.reader import LogReader
from recorder.record import record
from recorder.sources.bags.source import BagSource
from recorder.sources.base import CapturedFrame, Source, SourceEvent
from recorder.sources.live.settings import CameraSettings
from recorder.sources.opening import SourceOptions, open_source
from tests.log_helpers import images, write_log
from tests.test_log import foreign_log
from tests.test_sources import encoded, picture

START_NS = 1_700_000_000_123_456_789
STEP_NS = 40_000_000
LATE_NS = 7_000_000

KINDS = ["ros1", "mcap", "sqlite3"]
IMAGE = "/cam/image_raw"
JPEGS = "/cam/image_raw/compressed"
INFO = "/cam/camera_info"

Messages = Mapping[str, list[tuple[int, Any]]]


class Ros:
    """Messages of either version."""

    def __init__(self, kind: str) -> None:
        self.one = kind == "ros1"
        self.kind = kind
        self.store = get_typestore(Stores.ROS1_NOETIC if self.one else Stores.ROS2_JAZZY)

    def header(self, stamp_ns: int) -> Any:
        stamp = self.store.types["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9)
        values: dict[str, Any] = {"stamp": stamp, "frame_id": "optical"}
        values |= {"seq": 0} if self.one else {}
        return self.store.types["std_msgs/msg/Header"](**values)

    def compressed(self, stamp_ns: int, data: bytes, format: str = "jpeg") -> Any:
        kind = self.store.types["sensor_msgs/msg/CompressedImage"]
        return kind(self.header(stamp_ns), format, np.frombuffer(data, np.uint8))

    def image(
        self, stamp_ns: int, pixels: np.typing.NDArray[Any], encoding: str, padding: int = 0
    ) -> Any:
        rows = np.ascontiguousarray(pixels).reshape(len(pixels), -1).view(np.uint8)
        rows = np.pad(rows, ((0, 0), (0, padding)))
        kind = self.store.types["sensor_msgs/msg/Image"]
        big = int(pixels.dtype.byteorder == ">")
        height, width = pixels.shape[:2]
        return kind(
            self.header(stamp_ns), height, width, encoding, big, rows.shape[1], rows.ravel()
        )

    def info(self, model: str, coefficients: list[float], **more: Any) -> Any:
        region = self.store.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
        k = np.array([100.0, 0, 63.5, 0, 101.0, 47.5, 0, 0, 1])
        p = np.array([90.0, 0, 60, 0, 0, 91.0, 40, 0, 0, 0, 1, 0])
        values = {"d": np.array(coefficients), "k": k, "r": np.eye(3).ravel(), "p": p}
        if self.one:
            values = {key.upper(): value for key, value in values.items()}
        kind = self.store.types["sensor_msgs/msg/CameraInfo"]
        fields = {"height": 96, "width": 128, "distortion_model": model, **values}
        fields |= {"header": self.header(START_NS), "binning_x": 0, "binning_y": 0, "roi": region}
        return kind(**{**fields, **more})

    def write(self, folder: Path, messages: Messages) -> Path:
        """A bag of the messages and their receive times by topic."""
        path = folder / ("a.bag" if self.one else "a")
        writer: Any
        if self.one:
            writer = Writer1(path)
        else:
            plugin = StoragePlugin.MCAP if self.kind == "mcap" else StoragePlugin.SQLITE3
            writer = Writer2(path, version=9, storage_plugin=plugin)
        with writer:
            for topic, entries in messages.items():
                kind = entries[0][1].__msgtype__
                connection = writer.add_connection(topic, kind, typestore=self.store)
                for arrival_ns, message in entries:
                    serialize = self.store.serialize_ros1 if self.one else self.store.serialize_cdr
                    writer.write(connection, arrival_ns, serialize(message, kind))
        return path


@pytest.fixture(params=KINDS)
def ros(request: pytest.FixtureRequest) -> Ros:
    return Ros(request.param)


def stamps(count: int) -> Iterator[tuple[int, int, int]]:
    for i in range(count):
        yield i, START_NS + i * STEP_NS, START_NS + i * STEP_NS + LATE_NS


def jpeg_entries(ros: Ros, count: int = 6) -> list[tuple[int, Any]]:
    return [
        (late, ros.compressed(at, encoded(".jpg", picture(i)))) for i, at, late in stamps(count)
    ]


def frames_of(source: Source) -> list[CapturedFrame]:
    return [item for item in source.frames() if isinstance(item, CapturedFrame)]


def events_of(source: Source) -> list[SourceEvent]:
    return [item for item in source.frames() if isinstance(item, SourceEvent)]


def test_compressed_images_keep_bytes_and_times(tmp_path: Path, ros: Ros) -> None:
    entries = jpeg_entries(ros)
    entries[3] = (entries[3][0], ros.compressed(START_NS + 3 * STEP_NS, encoded(".png", picture(3)),
                                                "bgr8; png compressed bgr8"))  # fmt: skip
    path = ros.write(
        tmp_path, {JPEGS: entries, INFO: [(START_NS, ros.info("plumb_bob", [0.0] * 5))]}
    )
    source = open_source(str(path))
    assert isinstance(source, BagSource)
    assert source.image_size == (128, 96)
    assert source.frame_count() == 6
    assert source.name == "a"
    frames = frames_of(source)
    assert [f.data for f in frames] == [message.data.tobytes() for _, message in entries]
    assert [f.frame_index for f in frames] == list(range(6))
    assert [f.timestamp_ns for f in frames] == [at for _, at, _ in stamps(6)]
    assert [f.arrival_ns for f in frames] == [late for _, _, late in stamps(6)]
    assert [f.format for f in frames] == ["jpeg"] * 3 + ["png"] + ["jpeg"] * 2
    about = source.describe()
    assert about["bag"] == {"ros1": "ROS 1", "mcap": "ROS 2, mcap"}.get(ros.kind, "ROS 2, sqlite3")
    assert (about["topic"], about["encoding"]) == (JPEGS, "as it is")
    assert events_of(source) == []


def test_a_storage_file_alone_is_a_bag(tmp_path: Path) -> None:
    for kind, suffix in (("mcap", ".mcap"), ("sqlite3", ".db3")):
        ros = Ros(kind)
        (tmp_path / kind).mkdir()
        folder = ros.write(tmp_path / kind, {JPEGS: jpeg_entries(ros)})
        (file,) = folder.glob(f"*{suffix}")
        assert len(frames_of(open_source(str(file)))) == 6
        (folder / "metadata.yaml").unlink()
        with pytest.raises(InputError, match=r"its metadata.yaml, found none \(ros2 bag reindex"):
            open_source(str(folder))


@pytest.mark.parametrize(
    ("model", "coefficients", "expected"),
    [
        ("plumb_bob", [-0.2, 0.03, 0.001, -0.002, 0.004], "plumb_bob"),
        ("rational_polynomial", [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8], "rational_polynomial"),
        ("equidistant", [0.01, 0.02, 0.03, 0.04], "equidistant"),
        ("fisheye", [0.01, 0.02, 0.03, 0.04], "equidistant"),
    ],
)
def test_camera_info_becomes_the_calibration(
    tmp_path: Path, ros: Ros, model: str, coefficients: list[float], expected: str
) -> None:
    info = ros.info(model, coefficients)
    path = ros.write(tmp_path, {JPEGS: jpeg_entries(ros), INFO: [(START_NS, info)]})
    source = BagSource(path)
    camera = parse_camera(source.attachments["camera.yaml"], path)
    assert camera.distortion_model == expected
    np.testing.assert_array_equal(camera.dist_coeffs, coefficients)
    np.testing.assert_array_equal(camera.camera_matrix, [[100, 0, 63.5], [0, 101, 47.5], [0, 0, 1]])
    assert camera.image_size == (128, 96)
    assert camera.name == "optical"
    assert source.describe()["calibration"] == INFO


def test_rectified_images_have_the_rectified_camera(tmp_path: Path, ros: Ros) -> None:
    info = ros.info("plumb_bob", [-0.2, 0.03, 0.001, -0.002, 0.004])
    messages = {"/cam/image_rect/compressed": jpeg_entries(ros), INFO: [(START_NS, info)]}
    camera = parse_camera(
        BagSource(ros.write(tmp_path, messages)).attachments["camera.yaml"], tmp_path
    )
    np.testing.assert_array_equal(camera.camera_matrix, [[90, 0, 60], [0, 91, 40], [0, 0, 1]])
    assert not camera.dist_coeffs.any()


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"k": np.zeros(9)}, "expected a calibrated camera, found zeros"),
        ({"width": 64, "height": 48}, "it is for 64x48, the images are 128x96"),
        ({"distortion_model": "weird"}, "expected a distortion model of"),
        ({"binning_x": 2}, "unbinned"),
    ],
)
def test_a_calibration_that_will_not_do_is_left_out_with_a_word(
    tmp_path: Path, more: dict[str, Any], words: str
) -> None:
    ros = Ros("mcap")
    info = ros.info("plumb_bob", [0.0] * 5, **more)
    source = BagSource(ros.write(tmp_path, {JPEGS: jpeg_entries(ros), INFO: [(START_NS, info)]}))
    assert source.attachments == {}
    assert source.describe()["calibration"] == "none"
    (event,) = events_of(source)
    assert event.message.startswith(f"no calibration from {INFO}: ")
    assert words in event.message


BGR = np.random.default_rng(5).integers(0, 256, (12, 20, 3), dtype=np.uint8)
DEEP = np.random.default_rng(6).integers(0, 65536, (12, 20), dtype=np.uint16)


@pytest.mark.parametrize(
    ("encoding", "pixels", "expected"),
    [
        ("mono8", BGR[:, :, 0], BGR[:, :, 0]),
        ("8UC1", BGR[:, :, 0], BGR[:, :, 0]),
        ("bgr8", BGR, BGR),
        ("rgb8", BGR[:, :, ::-1], BGR),
        ("bgra8", np.dstack([BGR, BGR[:, :, 0]]), BGR),
        ("rgba8", np.dstack([BGR[:, :, ::-1], BGR[:, :, 0]]), BGR),
        ("mono16", DEEP, DEEP),
        ("16UC1", DEEP.astype(">u2"), DEEP),
    ],
)
def test_uncompressed_images_become_png_without_loss(
    tmp_path: Path, ros: Ros, encoding: str, pixels: Any, expected: Any
) -> None:
    entries = [(late, ros.image(at, pixels, encoding, padding=4)) for _, at, late in stamps(3)]
    source = BagSource(ros.write(tmp_path, {IMAGE: entries}))
    assert source.describe()["encoding"] == f"png of {encoding}"
    frames = frames_of(source)
    assert [read_header(f.data) for f in frames] == [ImageHeader("png", 20, 12)] * 3
    back = cv2.imdecode(np.frombuffer(frames[0].data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert back is not None
    np.testing.assert_array_equal(back, expected)


@pytest.mark.parametrize("order", ["rggb", "bggr", "gbrg", "grbg"])
def test_bayer_patterns_become_their_colours(tmp_path: Path, order: str) -> None:
    """A surface of one colour has that colour, whichever pixel the pattern begins with."""
    colour = {"b": 40, "g": 120, "r": 220}
    mosaic = np.zeros((12, 20), np.uint8)
    for k, letter in enumerate(order):
        mosaic[k // 2 :: 2, k % 2 :: 2] = colour[letter]
    ros = Ros("mcap")
    source = BagSource(
        ros.write(tmp_path, {IMAGE: [(START_NS, ros.image(START_NS, mosaic, f"bayer_{order}8"))]})
    )
    (frame,) = frames_of(source)
    back = cv2.imdecode(np.frombuffer(frame.data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert back is not None
    assert (back.reshape(-1, 3) == [40, 120, 220]).all()


@pytest.mark.parametrize("encoding", ["yuv422", "yuv422_yuy2"])
def test_yuv_of_grey_is_grey(tmp_path: Path, encoding: str) -> None:
    luma = np.full((12, 20), 130, np.uint8)
    chroma = np.full((12, 20), 128, np.uint8)
    pair = [chroma, luma] if encoding == "yuv422" else [luma, chroma]
    ros = Ros("mcap")
    entry = (START_NS, ros.image(START_NS, np.dstack(pair), encoding))
    (frame,) = frames_of(BagSource(ros.write(tmp_path, {IMAGE: [entry]})))
    back = cv2.imdecode(np.frombuffer(frame.data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert back is not None
    # The colour space has 16 to 235 for black to white.
    assert np.abs(back.astype(int) - round((130 - 16) * 255 / 219)).max() <= 1


def test_jpeg_is_made_where_it_is_asked_for(tmp_path: Path) -> None:
    ros = Ros("sqlite3")
    entries = [(late, ros.image(at, picture(i), "bgr8")) for i, at, late in stamps(2)]
    path = ros.write(tmp_path, {IMAGE: entries})
    source = open_source(str(path), SourceOptions(encoding="jpeg"))
    assert {f.format for f in frames_of(source)} == {"jpeg"}
    assert source.describe()["encoding"] == "jpeg of bgr8"


def test_the_topic_is_chosen(tmp_path: Path, ros: Ros) -> None:
    raw = [(late, ros.image(at, picture(i), "bgr8")) for i, at, late in stamps(2)]
    depth = [(START_NS, ros.compressed(START_NS, b"depth", "16UC1; compressedDepth"))]
    messages = {JPEGS: jpeg_entries(ros), IMAGE: raw, "/cam/image_raw/compressedDepth": depth}
    path = ros.write(tmp_path, messages)
    with pytest.raises(InputError, match=f"expected --topic, one of: {IMAGE}, {JPEGS}$"):
        open_source(str(path))
    assert len(frames_of(open_source(str(path), SourceOptions(topic=IMAGE)))) == 2
    assert len(frames_of(open_source(str(path), SourceOptions(topic=JPEGS)))) == 6
    with pytest.raises(InputError, match=f"expected images on /x, found them on: {IMAGE}"):
        open_source(str(path), SourceOptions(topic="/x"))


def test_a_bag_without_images_is_said(tmp_path: Path, ros: Ros) -> None:
    path = ros.write(tmp_path, {INFO: [(START_NS, ros.info("plumb_bob", [0.0] * 5))]})
    with pytest.raises(InputError, match=r"a topic with images, found none .*CameraInfo"):
        open_source(str(path))


def test_bad_images_are_lost_frames(tmp_path: Path, ros: Ros) -> None:
    entries = [(late, ros.image(at, picture(i), "bgr8")) for i, at, late in stamps(6)]
    entries[1][1].data = entries[1][1].data[:100]
    entries[2][1].encoding = "unheard_of"
    entries[3] = (entries[3][0], ros.image(START_NS, np.zeros((5, 5), np.uint8), "mono8"))
    source = BagSource(ros.write(tmp_path, {IMAGE: entries}))
    assert [f.frame_index for f in frames_of(source)] == [0, 4, 5]
    events = events_of(source)
    assert [e.dropped for e in events] == [1, 1, 1]
    for event, words in zip(
        events, ("frame 1 is no image", "'unheard_of'", "is 5x5, not as the first"), strict=True
    ):
        assert words in event.message


def test_an_empty_jpeg_is_a_corrupt_frame_as_of_a_camera(tmp_path: Path, ros: Ros) -> None:
    entries = jpeg_entries(ros)
    entries[2] = (entries[2][0], ros.compressed(START_NS, b""))
    summary = record(BagSource(ros.write(tmp_path, {JPEGS: entries})), tmp_path / "log.mcap")
    assert (summary.frames_written, summary.counts.corrupt, summary.frames_dropped) == (6, 1, 0)


def test_times_that_jump_back_and_times_that_are_missing(tmp_path: Path) -> None:
    ros = Ros("mcap")
    entries = jpeg_entries(ros)
    entries[3][1].header.stamp.sec -= 1
    entries[5] = (entries[5][0], ros.compressed(0, encoded(".jpg", picture(5))))
    source = BagSource(ros.write(tmp_path, {JPEGS: entries}))
    frames = frames_of(source)
    assert frames[3].timestamp_ns == START_NS + 3 * STEP_NS - 10**9
    assert frames[5].timestamp_ns == entries[5][0]
    assert events_of(source) == []


def test_a_bag_becomes_a_log(tmp_path: Path, ros: Ros) -> None:
    info = ros.info("plumb_bob", [-0.2, 0.03, 0.001, -0.002, 0.004])
    path = ros.write(tmp_path, {JPEGS: jpeg_entries(ros), INFO: [(START_NS, info)]})
    summary = record(open_source(str(path)), tmp_path / "log.mcap")
    assert summary.frames_written == 6
    with LogReader(tmp_path / "log.mcap") as log:
        assert [i.timestamp_ns for i in images(log)] == [at for _, at, _ in stamps(6)]
        assert parse_camera(log.attachments["camera.yaml"], path).camera_matrix[0, 0] == 100
    with pytest.raises(InputError, match="found a log"):
        open_source(str(tmp_path / "log.mcap"))


def test_own_logs_are_no_bags(tmp_path: Path) -> None:
    write_log(tmp_path / "a.mcap", 3)
    with pytest.raises(InputError, match=r"found a log \(replay it\)"):
        open_source(str(tmp_path / "a.mcap"))
    (tmp_path / "1.png").write_bytes(encoded(".png"))
    assert open_source(str(tmp_path)).describe()["kind"] == "images"
    (tmp_path / "metadata.yaml").write_text("of: something else")
    assert open_source(str(tmp_path)).describe()["kind"] == "images"


def test_an_mcap_of_neither_kind_is_told_what_is_taken(tmp_path: Path) -> None:
    foreign_log(tmp_path / "a.mcap")
    with pytest.raises(InputError, match=r"an MCAP of ROS 2 .* is a log: replay it"):
        open_source(str(tmp_path / "a.mcap"))


@pytest.mark.parametrize("name", ["a.bag", "a.mcap", "a.db3", "a/metadata.yaml"])
@pytest.mark.parametrize("data", [b"", b"rosbag2_bagfile_information: [", b"\x89MCAP0\r\n" * 9])
def test_what_is_no_bag_is_said_in_a_line(tmp_path: Path, name: str, data: bytes) -> None:
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(data)
    with pytest.raises(InputError) as caught:
        open_source(str(path if path.parent == tmp_path else path.parent))
    assert "\n" not in str(caught.value)
    assert "expected" in str(caught.value)


def test_a_bag_that_is_damaged_says_so(tmp_path: Path, ros: Ros) -> None:
    """Wherever bytes are missing: an error in a line, or frames, and a word on the rest."""
    path = ros.write(tmp_path, {JPEGS: jpeg_entries(ros, 40)})
    whole = {f.frame_index: f.data for f in frames_of(BagSource(path))}
    file = path if path.is_file() else next(f for f in path.iterdir() if f.suffix != ".yaml")
    data = file.read_bytes()
    rng = np.random.default_rng(7)
    refusals = []
    for _ in range(12):
        broken = bytearray(data)
        at = int(rng.integers(len(data)))
        if rng.random() < 0.5:
            del broken[at:]
        else:
            broken[at : at + 200] = rng.bytes(len(broken[at : at + 200]))
        file.write_bytes(broken)
        try:
            source = BagSource(path)
            items = list(source.frames())
        except InputError as error:
            refusals.append(str(error))
            continue
        frames = [i for i in items if isinstance(i, CapturedFrame)]
        lost = sum(i.dropped for i in items if isinstance(i, SourceEvent))
        damaged = sum(whole.get(f.frame_index) != f.data for f in frames)
        assert len(frames) + lost >= (source.frame_count() or 0) or damaged
    assert all("\n" not in text for text in refusals)


def storage_of(path: Path) -> Path:
    return path if path.is_file() else next(f for f in path.iterdir() if f.suffix != ".yaml")


MENDED_BY = {
    "ros1": "expected a ROS 1 bag with its index, found one without (cut short?): `rosbag reindex",
    "mcap": "expected an MCAP with its end, found one without (cut short?): `mcap recover",
    "sqlite3": r".recover | sqlite3 NEW.db3` saves what is there",
}


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_a_cut_bag_names_the_file_and_what_mends_it(tmp_path: Path, ros: Ros, share: float) -> None:
    path = ros.write(tmp_path, {JPEGS: jpeg_entries(ros, 40)})
    file = storage_of(path)
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])
    for spec in (path, file):
        with pytest.raises(InputError) as caught:
            open_source(str(spec))
        assert str(caught.value).startswith(f"{file}: ")
        assert MENDED_BY[ros.kind] in str(caught.value)
        assert str(file) in str(caught.value).partition("`")[2]
    if ros.kind == "sqlite3":
        assert f"expected an SQLite database of {len(data)} bytes" in str(caught.value)


def test_the_first_bytes_alone_are_no_bag_to_mend(tmp_path: Path, ros: Ros) -> None:
    file = storage_of(ros.write(tmp_path, {JPEGS: jpeg_entries(ros, 2)}))
    data = file.read_bytes()
    for size in (1, 8, 40):
        file.write_bytes(data[:size])
        with pytest.raises(InputError, match=f"found one cut short after {size} bytes$"):
            open_source(str(file))
    file.write_bytes(b"")
    with pytest.raises(InputError, match=r"found an empty file$"):
        open_source(str(file))
    file.write_bytes(b"something else")
    with pytest.raises(InputError, match=r"found a file that starts with b'somethin'$"):
        open_source(str(file))


def test_a_bag_that_was_never_closed(tmp_path: Path) -> None:
    """As `rosbag record` leaves it: another name, and no place of an index in its header."""
    ros = Ros("ros1")
    path = ros.write(tmp_path, {JPEGS: jpeg_entries(ros, 3)})
    data = path.read_bytes()
    at = data.index(b"index_pos=") + len(b"index_pos=")
    path.write_bytes(data[:at] + bytes(8) + data[at + 8 :])
    active = path.rename(tmp_path / "b.bag.active")
    with pytest.raises(InputError, match=f"`rosbag reindex {active}`"):
        open_source(str(active))
    with pytest.raises(InputError, match=r"`rosbag reindex "):
        open_source(str(active.rename(tmp_path / "c.bag")))


def test_a_bag_where_a_log_belongs_is_named_as_one(tmp_path: Path, ros: Ros) -> None:
    file = storage_of(ros.write(tmp_path, {JPEGS: jpeg_entries(ros, 40)}))
    expected = rf"expected a log, found a ROS bag: `arucolog record {file} -o LOG.mcap`"
    with pytest.raises(InputError, match=expected):
        LogReader(file)
    data = file.read_bytes()
    file.write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match=expected):
        LogReader(file)


def test_a_log_is_no_bag_whatever_else_is_in_it(tmp_path: Path) -> None:
    """Converters keep the profile of the bag that they put our images beside."""
    path = tmp_path / "a.mcap"
    image = to_image(0, encoded(".png"), "png")
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start(profile="ros2", library="a converter")
        schema = writer.register_schema("foxglove.CompressedImage", "protobuf", b"")
        channel = writer.register_channel("/camera/image", "protobuf", schema)
        writer.add_message(channel, 0, image.SerializeToString(), 0)
        writer.finish()  # type: ignore[no-untyped-call]
    with LogReader(path) as log:
        assert len(images(log)) == 1


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (SourceOptions(start_ns=3), "no --start for a ROS bag"),
        (SourceOptions(camera=CameraSettings(focus=0)), "no --focus for a ROS bag"),
        (SourceOptions(encoding="png"), "no --encoding for compressed images"),
    ],
)
def test_options_that_do_not_apply_are_refused(
    tmp_path: Path, options: SourceOptions, words: str
) -> None:
    ros = Ros("mcap")
    path = ros.write(tmp_path, {JPEGS: jpeg_entries(ros)})
    with pytest.raises(InputError, match=words):
        open_source(str(path), options)
