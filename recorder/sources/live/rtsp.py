"""A network camera over RTSP."""

from __future__ import annotations

import struct
import time

from recorder.sources.encoding import Encoding
from recorder.sources.live import clock
from recorder.sources.live.container import AvPacket, ContainerConnection, opened
from recorder.sources.live.http_mjpeg import host_name, without_password
from recorder.sources.live.stream import LiveCamera

_OPEN_S = 10.0


class SenderStamps:
    """Capture times from the sender's RTCP reports, where its clock is near ours.

    FFmpeg puts the time that the reports give a packet beside it; before the first report there is
    none.
    """

    def __init__(self) -> None:
        self.name = clock.ARRIVAL
        self._usable: bool | None = None
        self._last_ns: int | None = None
        self._offset_ns: int | None = None

    def learn(self, packet: AvPacket) -> None:
        if not packet.has_sidedata("prft") or self._usable is False:
            return
        (wall_us,) = struct.unpack_from("=q", bytes(packet.get_sidedata("prft")))
        if self._usable is None:
            self._usable = clock.near(wall_us * 1000, time.time_ns())
        if self._usable:
            self.name = "sender (RTCP reports)"
            self._last_ns = wall_us * 1000
            if packet.pts is not None:
                in_stream_ns = round(packet.pts * packet.time_base * 10**9)
                self._offset_ns = self._last_ns - in_stream_ns

    def capture_ns(self, time_ns: int | None) -> int | None:
        if time_ns is None or self._offset_ns is None:
            return self._last_ns
        return time_ns + self._offset_ns


def rtsp_camera(url: str, encoding: Encoding) -> LiveCamera:
    """The camera behind an `rtsp://` URL; over TCP, which loses nothing on the way.

    Raises:
        InputError: there is no stream with images.
    """
    shown = without_password(url)
    # Not long to look at the stream, and nothing kept of that: its arrival would be wrong.
    options = {
        "rtsp_transport": "tcp",
        "fflags": "nobuffer",
        "fpsprobesize": "0",
        "analyzeduration": "500000",
    }

    def connect() -> ContainerConnection:
        container = opened(url, shown, "an RTSP stream", _OPEN_S, **options)
        return ContainerConnection(container, SenderStamps(), encoding)

    about = {"kind": "rtsp", "url": shown, "transport": "tcp"}
    return LiveCamera(host_name(url), shown, connect, about)
