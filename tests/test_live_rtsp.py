"""Cameras over RTSP, against a server that speaks it."""

from __future__ import annotations

import time
from itertools import pairwise

import av
import cv2
import numpy as np
import pytest

from recorder.errors import InputError
from recorder.image_header import ImageHeader, read_header
from recorder.sources.base import CapturedFrame
from recorder.sources.live.rtsp import rtsp_camera
from recorder.sources.opening import SourceOptions, open_source
from tests.live_helpers import Taker
from tests.rtsp_server import GOP, LOOP, RATE_HZ, RtspServer

pytestmark = pytest.mark.skipif("libx264" not in av.codecs_available, reason="no libx264 here")


def place(frame: CapturedFrame) -> int:
    """Which picture it is."""
    image = cv2.imdecode(np.frombuffer(frame.data, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    return round(int(np.argmax(image[48] > 140)) / 4)


@pytest.mark.parametrize("encoding", ["jpeg", "png"])
def test_h264_comes_in_order_with_the_senders_times(encoding: str) -> None:
    with RtspServer() as server:
        source = open_source(
            server.url, SourceOptions(encoding="png" if encoding == "png" else None)
        )
        about = source.describe()
        assert (about["codec"], about["encoding"]) == ("h264", encoding)
        assert about["clock"] == "sender (RTCP reports)"
        assert source.image_size == (320, 96)
        with Taker(source) as taken:  # type: ignore[arg-type]
            taken.wait_for(40)
    frames = taken.frames
    assert taken.stop_s < 1.0
    assert taken.events == []
    assert {read_header(f.data) for f in frames} == {ImageHeader(encoding, 320, 96)}
    assert place(frames[0]) % GOP == 0
    assert all((place(b) - place(a)) % LOOP == 1 for a, b in pairwise(frames))
    assert [f.frame_index for f in frames] == list(range(len(frames)))
    # As they were sent, whenever they came: only a report moves them a little.
    steps = {b.timestamp_ns - a.timestamp_ns for a, b in pairwise(frames)}
    assert max(abs(step - 10**9 // RATE_HZ) for step in steps) < 5_000_000
    sent_ns = np.array(server.sent_ns)
    nearest = [np.abs(sent_ns - f.timestamp_ns).min() for f in frames]
    assert np.median(nearest) < 5_000_000


@pytest.mark.parametrize("clock_shift_s", [None, -1000.0])
def test_without_a_clock_to_believe_it_is_the_arrival(clock_shift_s: float | None) -> None:
    reports = clock_shift_s is not None
    with RtspServer(reports=reports, clock_shift_s=clock_shift_s or 0.0) as server:
        source = rtsp_camera(server.url, "jpeg")
        assert source.describe()["clock"].startswith("arrival (system clock), after decoding")
        with Taker(source) as taken:
            taken.wait_for(5)
    assert all(f.arrival_ns == f.timestamp_ns for f in taken.frames)


def test_a_server_that_goes_comes_back() -> None:
    with RtspServer(close_after=50) as server, Taker(rtsp_camera(server.url, "jpeg")) as taken:
        taken.wait_for_message("connected again")
        taken.wait_for(len(taken.frames) + 5)
    frames = taken.frames
    assert [f.frame_index for f in frames] == list(range(len(frames)))
    lost, again = taken.messages[:2]
    assert lost.startswith("connection lost after frame ")
    assert again.startswith("connected again after ")


def test_a_pause_is_survived() -> None:
    """Longer than a read may take."""
    server = RtspServer(pause_at=40, pause_s=1.0)
    with server, Taker(rtsp_camera(server.url, "jpeg")) as taken:
        taken.wait_for(40)
    assert taken.events == []
    assert all((place(b) - place(a)) % LOOP == 1 for a, b in pairwise(taken.frames))


def test_stop_ends_it_while_nothing_comes() -> None:
    server = RtspServer(pause_at=40, pause_s=60)
    with server, Taker(rtsp_camera(server.url, "jpeg")) as taken:
        taken.wait_for(5)
        time.sleep(0.7)
    assert taken.stop_s < 1.0


def test_nobody_there_is_said_without_the_password() -> None:
    with pytest.raises(InputError, match=r"me:\*\*\*@127.0.0.1.*expected an RTSP stream") as caught:
        rtsp_camera("rtsp://me:secret@127.0.0.1:9/cam", "jpeg")
    assert "secret" not in str(caught.value)
