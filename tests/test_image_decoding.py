"""Damage inside images: found where it is, and not where a camera merely pads its data."""

from __future__ import annotations

import re
import tracemalloc
from collections.abc import Callable

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from recorder.image_decoding import decode_gray, flaw
from recorder.image_header import image_fault

SAMPLINGS = {
    "4:2:0": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420,
    "4:2:2": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_422,
    "4:4:4": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
}
END = b"\xff\xd9"


def jpeg(
    *, sampling: str = "4:2:2", quality: int = 85, progressive: bool = False, restart: int = 0
) -> bytes:
    """480x360 with something to see everywhere."""
    pixels = np.random.default_rng(3).integers(0, 256, (360, 480, 3), np.uint8)
    options = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_PROGRESSIVE, int(progressive)]
    options += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, SAMPLINGS[sampling]]
    options += [cv2.IMWRITE_JPEG_RST_INTERVAL, restart]
    return cv2.imencode(".jpg", cv2.GaussianBlur(pixels, (5, 5), 2), options)[1].tobytes()


def of_opencv(data: bytes) -> NDArray[np.uint8]:
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    return np.asarray(image, np.uint8)


def without_tables(data: bytes) -> bytes:
    """As many a webcam's: the Huffman tables are left out, being always the same."""
    kept, at = data[:2], 2
    while data[at + 1] != 0xDA:
        end = at + 2 + int.from_bytes(data[at + 2 : at + 4])
        kept += b"" if data[at + 1] == 0xC4 else data[at:end]
        at = end
    return kept + data[at:]


def padded(data: bytes, padding: bytes) -> bytes:
    """With bytes of no use before each restart marker and the end, as webcams give it."""
    start = data.index(b"\xff\xda")
    scan = re.sub(rb"\xff[\xd0-\xd7\xd9]", lambda found: padding + found[0], data[start:])
    return data[:start] + scan


@pytest.mark.parametrize("sampling", SAMPLINGS)
@pytest.mark.parametrize("progressive", [False, True])
@pytest.mark.parametrize("restart", [0, 7])
def test_pixels_are_those_of_opencv(sampling: str, progressive: bool, restart: int) -> None:
    data = jpeg(sampling=sampling, progressive=progressive, restart=restart)
    found = decode_gray(data)
    assert found is not None
    np.testing.assert_array_equal(found, of_opencv(data))
    assert flaw(data, "jpeg") is None


@pytest.mark.parametrize(
    "change",
    [
        without_tables,
        lambda d: d + bytes(700),
        # The rest of the buffer, also with what was in it before.
        lambda d: d + bytes(100_000),
        lambda d: d + d[5000:],
        # Before the end marker, and behind it.
        lambda d: d[:-2] + bytes(9) + END + bytes(5000),
        lambda d: d[:2] + b"\xff" * 500 + d[2:],
    ],
)
def test_habits_of_cameras_are_no_damage(change: Callable[[bytes], bytes]) -> None:
    data = jpeg()
    found = decode_gray(change(data))
    assert found is not None
    np.testing.assert_array_equal(found, of_opencv(data))
    assert flaw(change(data), "jpeg") is None


@pytest.mark.parametrize("restart", [0, 30])
@pytest.mark.parametrize("padding", [b"\0", b"\0\0\0", b"\x3f\x20\x11\x07"])
def test_padding_is_no_damage(
    restart: int, padding: bytes, capfd: pytest.CaptureFixture[str]
) -> None:
    data = jpeg(restart=restart)
    found = decode_gray(padded(data, padding))
    assert found is not None
    np.testing.assert_array_equal(found, of_opencv(data))
    assert flaw(padded(data, padding), "jpeg") is None
    # OpenCV would print a line for each.
    assert capfd.readouterr().err == ""


def header_segments(data: bytes) -> list[int]:
    """Where the segments of the header begin, behind the first."""
    found, at = [], 2
    while data[at + 1] != 0xDA:
        at += 2 + int.from_bytes(data[at + 2 : at + 4])
        found.append(at)
    return found


def test_padding_in_the_header_is_no_damage() -> None:
    """As a Logitech C270 has it: https://github.com/opencv/opencv/issues/21373."""
    data = jpeg()
    for at in header_segments(data):
        odd = data[:at] + b"\0" + data[at:]
        found = decode_gray(odd)
        assert found is not None, at
        np.testing.assert_array_equal(found, of_opencv(data))
        assert flaw(odd, "jpeg") is None


@given(data=st.data(), progressive=st.booleans(), restart=st.sampled_from([0, 30]))
@settings(max_examples=60, deadline=None)
def test_pixels_behind_a_padded_header_are_those_of_opencv(
    data: st.DataObject, progressive: bool, restart: int
) -> None:
    whole = jpeg(progressive=progressive, restart=restart)
    padding = st.binary(max_size=16).map(lambda b: b.replace(b"\xff", b""))
    odd, kept = b"", 0
    for at in header_segments(whole):
        odd += whole[kept:at] + data.draw(padding)
        kept = at
    odd += padded(whole[kept:], data.draw(padding.filter(lambda b: len(b) < 9)))
    found = decode_gray(odd)
    assert found is not None
    np.testing.assert_array_equal(found, of_opencv(odd))
    assert (image_fault(odd, "jpeg"), flaw(odd, "jpeg")) == (None, None)


def test_nothing_is_printed_of_a_padded_header(capfd: pytest.CaptureFixture[str]) -> None:
    """Thousands of lines in a replay, and through the status line while recording."""
    whole = jpeg()
    for at in header_segments(whole):
        odd = whole[:at] + bytes(5) + whole[at:]
        assert decode_gray(odd) is not None
        assert flaw(odd, "jpeg") is None
    assert capfd.readouterr().err == ""


def with_thumbnail(data: bytes) -> bytes:
    """As many cameras': another JPEG, with an end of its own, in the header."""
    small = cv2.imencode(".jpg", np.full((16, 16), 80, np.uint8))[1].tobytes()
    return data[:2] + b"\xff\xe1" + (len(small) + 2).to_bytes(2) + small + data[2:]


def judged(data: bytes, format: str = "jpeg") -> bool:
    """Whether it is whole, as recorder, `verify` and replay say together."""
    outside, inside = image_fault(data, format), flaw(data, format)
    assert outside in (None, inside)
    assert (inside is None) == (decode_gray(data) is not None), (outside, inside)
    return inside is None


@pytest.mark.parametrize("rest", [b"", bytes(10), bytes(6000)])
@pytest.mark.parametrize("format", ["jpeg", "png"])
def test_an_image_cut_anywhere_is_cut_for_all(rest: bytes, format: str) -> None:
    """A decoder fills up what is missing; also of one that lacks a single byte."""
    pixels = of_opencv(jpeg())[:40, :56]
    data = cv2.imencode(f".{format}", pixels)[1].tobytes()
    data = with_thumbnail(data) if format == "jpeg" else data
    assert judged(data, format)
    assert judged(data + rest, format)
    assert not any(judged(data[:end] + rest, format) for end in range(len(data)))


DAMAGES: dict[str, Callable[[bytes, int, np.random.Generator], bytes]] = {
    "cut": lambda d, at, rng: d[:at],
    "cut in a buffer": lambda d, at, rng: d[:at] + bytes(int(rng.integers(10_000))),
    "cut over what was there": lambda d, at, rng: d[:at] + d[at - 100 :],
    "ended": lambda d, at, rng: d[:at] + END,
    "without a piece": lambda d, at, rng: d[:at] + d[at + int(rng.integers(1, 600)) :],
    "blank": lambda d, at, rng: d[:at] + bytes(64) + d[at + 64 :],
    "more": lambda d, at, rng: d[:at] + rng.bytes(int(rng.integers(1, 40))) + d[at:],
    "padded": lambda d, at, rng: d[:at] + bytes(int(rng.integers(1, 20))) + d[at:],
    "filled": lambda d, at, rng: d[:at] + b"\xff" * int(rng.integers(1, 20)) + d[at:],
    "twice": lambda d, at, rng: d[:at] + d,
    "appended": lambda d, at, rng: d + d[:at],
}


@given(
    damage=st.sampled_from(sorted(DAMAGES)),
    seed=st.integers(0, 2**32),
    progressive=st.booleans(),
    restart=st.sampled_from([0, 20]),
    header=st.booleans(),
)
@settings(max_examples=400, deadline=None)
def test_recorder_verify_and_replay_judge_alike(
    damage: str, seed: int, progressive: bool, restart: int, header: bool
) -> None:
    rng = np.random.default_rng(seed)
    data = with_thumbnail(jpeg(quality=40, progressive=progressive, restart=restart))
    at = int(rng.integers(1, 1200 if header else len(data)))
    whole = judged(DAMAGES[damage](data, at, rng))
    if damage == "cut":
        assert not whole
    if damage == "appended":
        assert whole


@given(seed=st.integers(0, 2**32), flips=st.integers(1, 20), header=st.booleans())
@settings(max_examples=300, deadline=None)
def test_whatever_the_bytes_are_the_answer_is_the_same(seed: int, flips: int, header: bool) -> None:
    rng = np.random.default_rng(seed)
    data = bytearray(jpeg(quality=40, restart=int(rng.integers(0, 3)) * 20))
    for at in rng.integers(2, 650 if header else len(data), flips):
        data[at] = rng.integers(256)
    judged(bytes(data))


@pytest.mark.parametrize("size", [(65500, 65500), (40000, 7000), (65500, 1)])
def test_a_damaged_size_costs_nothing(size: tuple[int, int]) -> None:
    data = jpeg()
    at = data.index(b"\xff\xc0") + 5
    odd = data[:at] + size[1].to_bytes(2) + size[0].to_bytes(2) + data[at + 4 :]
    tracemalloc.start()
    try:
        assert decode_gray(odd) is None
        assert decode_gray(odd, (480, 360)) is None
        assert flaw(odd, "jpeg") is not None
        assert tracemalloc.get_traced_memory()[1] < 10**7
    finally:
        tracemalloc.stop()


def test_an_image_of_another_size_is_none() -> None:
    assert decode_gray(jpeg(), (480, 360)) is not None
    assert decode_gray(jpeg(), (360, 480)) is None


def cut_out(data: bytes, at: int, rng: np.random.Generator) -> bytes:
    return data[:at] + data[at + 512 :]


def garbled(data: bytes, at: int, rng: np.random.Generator) -> bytes:
    return data[:at] + rng.bytes(2048) + data[at + 2048 :]


def blank(data: bytes, at: int, rng: np.random.Generator) -> bytes:
    return data[:at] + bytes(512) + data[at + 512 :]


def ends_early(data: bytes, at: int, rng: np.random.Generator) -> bytes:
    return data[:at] + END


@pytest.mark.parametrize("damage", [cut_out, garbled, blank, ends_early])
@pytest.mark.parametrize("habit", [lambda d: d, lambda d: padded(d, b"\0\0")])
def test_damage_inside_is_found(
    damage: Callable[[bytes, int, np.random.Generator], bytes],
    habit: Callable[[bytes], bytes],
    capfd: pytest.CaptureFixture[str],
) -> None:
    rng = np.random.default_rng(8)
    data = habit(jpeg(quality=75))
    missed = 0
    for at in rng.integers(len(data) // 10, len(data) - 2500, 60):
        broken = damage(data, int(at), rng)
        assert (decode_gray(broken) is None) == (flaw(broken, "jpeg") is not None)
        missed += decode_gray(broken) is not None
    # The rest of the data may read as another picture, once in a while.
    assert missed <= 1
    assert capfd.readouterr().err == ""


def test_what_is_no_image() -> None:
    png = cv2.imencode(".png", of_opencv(jpeg()))[1].tobytes()
    found = decode_gray(png)
    assert found is not None
    np.testing.assert_array_equal(found, of_opencv(jpeg()))
    middle = len(png) // 2
    broken = png[:middle] + bytes([png[middle] ^ 1]) + png[middle + 1 :]
    for data in (b"", b"no image", END, b"\xff\xd8", jpeg()[:200], broken):
        assert decode_gray(data) is None
    assert flaw(broken, "png") == "no png image that can be decoded"
    assert flaw(b"\xff\xd8", "jpeg") == "not a readable jpeg image"
