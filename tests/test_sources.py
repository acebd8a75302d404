"""Video files and folders of images as sources of frames."""

from __future__ import annotations

import io
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from recorder.errors import InputError
from recorder.files.yaml_file import read_bytes
from recorder.image_header import ImageHeader, read_header
from recorder.log.reader import LogReader
from recorder.log.records import LogEvent
from recorder.record import record
from recorder.sources.base import CapturedFrame, SourceEvent
from recorder.sources.images import ImagesSource
from recorder.sources.opening import SourceOptions, open_source, parse_start
from recorder.sources.video import VideoSource
from tests.log_helpers import write_log

GRAY = np.random.default_rng(3).integers(0, 256, (48, 64), dtype=np.uint8)


def encoded(suffix: str, image: np.typing.NDArray[np.generic] = GRAY) -> bytes:
    done, data = cv2.imencode(suffix, image)  # type: ignore[arg-type]
    assert done
    return data.tobytes()


def picture(i: int) -> np.typing.NDArray[np.uint8]:
    """A bright square that moves right, 8 px a frame."""
    image = np.full((96, 128, 3), 60, np.uint8)
    image[32:64, 8 * i : 8 * i + 32] = 220
    return image


def make_video(path: Path, codec: str, count: int = 8, **metadata: str) -> None:
    with av.open(str(path), "w") as container:
        container.metadata.update(metadata)
        stream = container.add_stream(codec, rate=Fraction(30000, 1001))
        stream.width, stream.height = 128, 96  # type: ignore[union-attr]
        stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"  # type: ignore[union-attr]
        for i in range(count):
            frame = av.VideoFrame.from_ndarray(picture(i), format="bgr24")
            frame.pts = i
            frame.time_base = Fraction(1001, 30000)
            container.mux(stream.encode(frame))  # type: ignore[union-attr,arg-type]
        container.mux(stream.encode(None))  # type: ignore[union-attr]


def frames_of(source: VideoSource | ImagesSource) -> list[CapturedFrame]:
    return [item for item in source.frames() if isinstance(item, CapturedFrame)]


def left_edge(frame: CapturedFrame) -> int:
    image = cv2.imdecode(np.frombuffer(frame.data, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    return int(np.argmax(image[48] > 140))


@pytest.mark.parametrize(
    ("suffix", "format"), [(".jpg", "jpeg"), (".png", "png"), (".webp", "webp")]
)
def test_header_is_that_of_the_decoder(suffix: str, format: str) -> None:
    assert read_header(encoded(suffix)) == ImageHeader(format, 64, 48)
    progressive = cv2.imencode(".jpg", GRAY, [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1].tobytes()
    assert read_header(progressive) == ImageHeader("jpeg", 64, 48)
    lossy = cv2.imencode(".webp", GRAY, [cv2.IMWRITE_WEBP_QUALITY, 50])[1].tobytes()
    assert read_header(lossy) == ImageHeader("webp", 64, 48)


def test_header_of_no_image_is_none() -> None:
    rng = np.random.default_rng(4)
    for start in (b"", b"\xff\xd8", b"\x89PNG\r\n\x1a\n", b"RIFF\0\0\0\0WEBPVP8X", b"BM"):
        for length in range(20):
            read_header(start + rng.bytes(length))
    assert read_header(b"") is None
    assert read_header(encoded(".jpg")[:20]) is None


def test_images_keep_their_bytes_and_come_in_natural_order(tmp_path: Path) -> None:
    names = ["frame10.png", "frame2.PNG", "frame1.jpg", "frame03.webp"]
    for name in names:
        (tmp_path / name).write_bytes(encoded(Path(name).suffix.lower()))
    (tmp_path / "notes.txt").write_text("no image")
    (tmp_path / ".hidden.png").write_bytes(b"no image")
    source = ImagesSource(tmp_path, fps=Fraction(3), start_ns=5)
    frames = frames_of(source)
    ordered = ["frame1.jpg", "frame2.PNG", "frame03.webp", "frame10.png"]
    assert [f.data for f in frames] == [(tmp_path / name).read_bytes() for name in ordered]
    assert [f.format for f in frames] == ["jpeg", "png", "webp", "png"]
    assert [f.frame_index for f in frames] == [0, 1, 2, 3]
    assert [f.timestamp_ns for f in frames] == [5, 333333338, 666666672, 1000000005]
    assert all(f.arrival_ns == f.timestamp_ns for f in frames)
    assert source.image_size == (64, 48)
    assert source.frame_count() == 4
    assert source.name == tmp_path.name


@pytest.mark.parametrize("suffix", [".bmp", ".tif", ".pgm"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_other_images_become_png_without_loss(
    tmp_path: Path, suffix: str, dtype: type[np.generic]
) -> None:
    if suffix == ".bmp" and dtype is np.uint16:
        pytest.skip("BMP has 8 bits")
    image = GRAY.astype(dtype) * (257 if dtype is np.uint16 else 1)
    (tmp_path / f"a{suffix}").write_bytes(encoded(suffix, image))
    (frame,) = frames_of(ImagesSource(tmp_path))
    assert frame.format == "png"
    assert read_header(frame.data) == ImageHeader("png", 64, 48)
    back = cv2.imdecode(np.frombuffer(frame.data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert back is not None
    np.testing.assert_array_equal(back if back.ndim == 2 else back[:, :, 0], image)


def test_images_that_do_not_fit_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"expected images .* found none"):
        ImagesSource(tmp_path)
    for name in ("drive.bag", "notes.txt", "x.md", "y.md"):
        (tmp_path / name).touch()
    with pytest.raises(InputError, match=r"found drive\.bag, notes\.txt, x\.md and 1 more"):
        ImagesSource(tmp_path)
    (tmp_path / "a.png").write_bytes(encoded(".png"))
    (tmp_path / "b.png").write_bytes(encoded(".png", GRAY[:40]))
    with pytest.raises(InputError, match=r"b\.png: expected the size of a\.png, 64x48.*64x40"):
        ImagesSource(tmp_path)
    (tmp_path / "a.png").write_bytes(b"")
    (tmp_path / "b.png").unlink()
    (tmp_path / "b.tif").write_bytes(b"no image")
    with pytest.raises(InputError, match=r"a\.png: expected a png image, found something else"):
        ImagesSource(tmp_path)
    (tmp_path / "c.tif").write_bytes(encoded(".tif", GRAY.astype(np.float32)))
    with pytest.raises(InputError, match=r"c\.tif: expected 8 or 16 bits a pixel, found float32"):
        ImagesSource(tmp_path)


def test_a_rate_that_nobody_gave_is_told(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(encoded(".png"))
    assert ImagesSource(tmp_path).preparation() is None
    (tmp_path / "b.png").write_bytes(encoded(".png"))
    assert "one a second (--fps" in (ImagesSource(tmp_path).preparation() or "")
    assert ImagesSource(tmp_path, fps=Fraction(1)).preparation() is None


def test_one_bad_image_does_not_refuse_a_folder(tmp_path: Path) -> None:
    """What needs no decoding is kept as it is; the rest is lost, and the log says both."""
    folder = tmp_path / "shots"
    folder.mkdir()
    contents = {
        "0.jpg": b"",
        "1.png": encoded(".png"),
        "2.jpg": encoded(".jpg")[:30],
        "3.bmp": b"no image",
        "4.bmp": encoded(".bmp"),
        "5.bmp": b"",
    }
    for name, data in contents.items():
        (folder / name).write_bytes(data)
    source = ImagesSource(folder)
    assert source.image_size == (64, 48)
    frames = frames_of(source)
    assert [(f.frame_index, f.format) for f in frames] == [
        (0, "jpeg"), (1, "png"), (2, "jpeg"), (4, "png"),
    ]  # fmt: skip
    assert [f.data for f in frames[:3]] == list(contents.values())[:3]
    assert source.frame_count() == 4
    summary = record(source, tmp_path / "log.mcap")
    assert (summary.frames_written, summary.frames_dropped) == (4, 2)
    with LogReader(tmp_path / "log.mcap") as log:
        events = [(r.level, r.message) for r in log.records() if isinstance(r, LogEvent)]
    assert events == [
        ("warning", "frame 0 is empty"),
        ("warning", "frame 2 is not a readable jpeg image"),
        ("warning", "frame 3 is lost: 3.bmp is not a readable image"),
        ("warning", "frame 5 is lost: 5.bmp is not a readable image"),
    ]


def test_sizes_are_read_from_the_first_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    png = encoded(".png")
    (tmp_path / "a.png").write_bytes(png + bytes(1_000_000))
    read = []

    def read_some(path: Path, limit: int = -1) -> bytes:
        read.append(len(data := read_bytes(path, limit)))
        return data

    monkeypatch.setattr("recorder.sources.images.read_bytes", read_some)
    ImagesSource(tmp_path)
    assert sum(read) <= 65536
    # A preview before the header.
    jpeg = encoded(".jpg")
    preview = b"\xff\xe1" + (60_002).to_bytes(2, "big") + bytes(60_000)
    (tmp_path / "a.png").unlink()
    (tmp_path / "b.jpg").write_bytes(jpeg[:2] + 2 * preview + jpeg[2:])
    assert ImagesSource(tmp_path).image_size == (64, 48)


def test_images_beyond_all_clocks_are_refused(tmp_path: Path) -> None:
    for name in ("a.png", "b.png"):
        (tmp_path / name).write_bytes(encoded(".png"))
    with pytest.raises(InputError, match=r"expected times before 2262.*--fps"):
        frames_of(ImagesSource(tmp_path, fps=Fraction("1e-10")))


@pytest.mark.parametrize("name", ["a.avi", "a.mkv", "a.mov"])
def test_jpeg_in_a_video_keeps_its_bytes(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    make_video(path, "mjpeg")
    with av.open(str(path)) as container:
        packets = [bytes(p) for p in container.demux(video=0) if p.size]
    source = VideoSource(path)
    frames = frames_of(source)
    assert [f.data for f in frames] == packets
    assert {f.format for f in frames} == {"jpeg"}
    assert read_header(frames[0].data) == ImageHeader("jpeg", 128, 96)
    assert [left_edge(f) for f in frames] == pytest.approx([8 * i for i in range(8)], abs=1)
    assert source.describe()["encoding"] == "as it is"


@pytest.mark.parametrize(("codec", "name"), [("mpeg4", "a.mp4"), ("libx264", "a.mkv")])
@pytest.mark.parametrize("encoding", ["jpeg", "png"])
def test_other_video_is_decoded_in_order(
    tmp_path: Path, codec: str, name: str, encoding: str
) -> None:
    if codec not in av.codecs_available:
        pytest.skip(f"no {codec} here")
    path = tmp_path / name
    make_video(path, codec)
    source = VideoSource(path, start_ns=10**18, encoding="png" if encoding == "png" else "jpeg")
    frames = frames_of(source)
    assert [f.frame_index for f in frames] == list(range(8))
    assert {f.format for f in frames} == {encoding}
    assert [left_edge(f) for f in frames] == pytest.approx([8 * i for i in range(8)], abs=1)
    tick_ns = 10**6 if name.endswith("mkv") else 10**5  # Matroska counts milliseconds
    expected = [10**18 + i * 1001 * 10**9 // 30000 for i in range(8)]
    assert [f.timestamp_ns for f in frames] == pytest.approx(expected, abs=tick_ns, rel=0)
    assert source.image_size == (128, 96)


def test_capture_is_exact_and_starts_where_it_is_told(tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    make_video(path, "mpeg4", creation_time="2025-06-01T12:00:00.000000Z")
    created_ns = 1748779200 * 10**9
    with av.open(str(path)) as container:
        base = container.streams.video[0].time_base
        pts = [p.pts for p in container.demux(video=0) if p.pts is not None]
    assert base is not None
    offsets = [round(p * base * 10**9) for p in pts]
    assert [f.timestamp_ns for f in frames_of(VideoSource(path))] == [
        created_ns + offset for offset in offsets
    ]
    assert [f.timestamp_ns for f in frames_of(VideoSource(path, start_ns=7))] == [
        7 + offset for offset in offsets
    ]
    plain = tmp_path / "b.mp4"
    make_video(plain, "mpeg4")
    assert frames_of(VideoSource(plain))[0].timestamp_ns == 0


def test_a_corrupt_part_of_a_video_is_not_silent(tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    make_video(path, "mpeg4", count=12)
    data = bytearray(path.read_bytes())
    with av.open(str(path)) as container:
        packets = [p for p in container.demux(video=0) if p.size]
    at, size = packets[5].pos or 0, packets[5].size
    # All of one packet, so that no decoder can do anything with it.
    data[at : at + size] = bytes(size)
    path.write_bytes(data)
    items = list(VideoSource(path).frames())
    frames = [i for i in items if isinstance(i, CapturedFrame)]
    events = [i for i in items if isinstance(i, SourceEvent)]
    assert len(frames) == 11
    assert sum(e.dropped for e in events) == 1


@pytest.mark.parametrize("codec", ["libx264", "mpeg4", "mjpeg"])
def test_a_trimmed_video_gives_what_it_shows(tmp_path: Path, codec: str) -> None:
    """Five frames are in the file for the sake of the others; its edit list leaves them out."""
    if codec not in av.codecs_available:
        pytest.skip(f"no {codec} here")
    whole, path = tmp_path / "whole.mp4", tmp_path / "trimmed.mp4"
    make_video(whole, codec, count=12)
    with av.open(str(whole)) as container, av.open(str(path), "w") as trimmed:
        stream = container.streams.video[0]
        target = trimmed.add_stream_from_template(stream)
        for packet in container.demux(stream):
            if packet.pts is None or packet.dts is None:
                continue
            shift = round(5 * Fraction(1001, 30000) / packet.time_base)
            packet.pts, packet.dts, packet.stream = packet.pts - shift, packet.dts - shift, target
            trimmed.mux(packet)
    source = VideoSource(path)
    items = list(source.frames())
    frames = [item for item in items if isinstance(item, CapturedFrame)]
    assert items == frames
    assert source.frame_count() == len(frames) == 7
    assert [f.frame_index for f in frames] == list(range(7))
    assert frames[0].timestamp_ns == 0
    assert [left_edge(f) for f in frames] == pytest.approx([8 * i for i in range(5, 12)], abs=1)


def test_a_video_that_was_cut_gives_its_first_frames(tmp_path: Path) -> None:
    path = tmp_path / "a.avi"
    make_video(path, "mjpeg", count=12)
    whole = frames_of(VideoSource(path))
    data = path.read_bytes()
    path.write_bytes(data[: data.index(whole[7].data) + 100])
    items = list(VideoSource(path).frames())
    frames = [i for i in items if isinstance(i, CapturedFrame)]
    assert [f.data for f in frames[:7]] == [f.data for f in whole[:7]]
    assert len(frames) <= 8


def test_a_source_is_chosen_by_what_it_is(tmp_path: Path) -> None:
    make_video(tmp_path / "a.mkv", "mjpeg")
    (tmp_path / "a.png").write_bytes(encoded(".png"))
    assert isinstance(open_source(str(tmp_path)), ImagesSource)
    assert isinstance(open_source(str(tmp_path / "a.png")), ImagesSource)
    assert isinstance(open_source(str(tmp_path / "a.mkv")), VideoSource)


@pytest.mark.parametrize(
    ("spec", "options", "words"),
    [
        ("none", SourceOptions(), "found nothing there"),
        ("/dev/video99", SourceOptions(), "expected a camera, found: no such file"),
        ("samples", SourceOptions(), r"scenes that come along: .*hard, .*sample"),
        ("x.mcap", SourceOptions(), "found a log"),
        ("y.mcap", SourceOptions(), "expected an MCAP, found a file that starts with"),
        ("x.txt", SourceOptions(), "expected a video, found something else"),
        ("a.mkv", SourceOptions(fps=Fraction(3)), "no --fps for a video"),
        (".", SourceOptions(encoding="png"), "no --encoding for images"),
    ],
)
def test_what_is_no_source_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spec: str, options: SourceOptions, words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    make_video(Path("a.mkv"), "mjpeg", 1)
    Path("a.png").write_bytes(encoded(".png"))
    write_log(Path("x.mcap"), 1)
    Path("y.mcap").write_bytes(b"log")
    Path("x.txt").write_bytes(b"text")
    with pytest.raises(InputError, match=words):
        list(open_source(spec, options).frames())


@pytest.mark.parametrize(
    ("text", "start_ns"),
    [
        ("0", 0),
        ("1700000000.123456789", 1_700_000_000_123_456_789),
        ("2025-06-01T12:00:00Z", 1_748_779_200 * 10**9),
        ("2025-06-01 12:00:00", 1_748_779_200 * 10**9),
        ("2025-06-01T14:00:00.25+02:00", 1_748_779_200_250_000_000),
    ],
)
def test_start_is_read_exactly(text: str, start_ns: int) -> None:
    assert parse_start(text) == start_ns


@pytest.mark.parametrize("text", ["", "noon", "-1", "nan", "1960-01-01", "1e30"])
def test_no_start_is_said(text: str) -> None:
    with pytest.raises(ValueError, match="expected"):
        parse_start(text)


def test_a_real_video(shared_data: Path) -> None:
    source = VideoSource(shared_data / "moving_board" / "cam_0" / "video.mp4")
    frames = frames_of(source)
    assert len(frames) == source.frame_count() == 57
    assert source.image_size == (1280, 720)
    assert all(read_header(f.data) == ImageHeader("jpeg", 1280, 720) for f in frames)
    assert [f.timestamp_ns for f in frames] == [round(i * 10**9 / Fraction(6)) for i in range(57)]


def test_real_images(shared_data: Path) -> None:
    folder = shared_data / "field_2023" / "images"
    frames = frames_of(ImagesSource(folder))
    assert [f.data for f in frames] == [p.read_bytes() for p in sorted(folder.iterdir())]
    assert io.BytesIO(frames[0].data).read(4) == b"\x89PNG"
