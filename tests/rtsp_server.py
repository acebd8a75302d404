"""An RTSP camera on loopback: H.264 over interleaved TCP, with sender reports."""

from __future__ import annotations

import base64
import socket
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from fractions import Fraction

import av
import numpy as np
import numpy.typing as npt

_NTP_S = 2_208_988_800
_MTU = 1400
RATE_HZ = 50
GOP = 10
LOOP = 50


class RtspServer:
    """Serves pictures `picture(i)` to one client after another, each from a key frame on.

    Args:
        pause_at: nothing for `pause_s` after this many frames of a connection.
        close_after: frames until the connection is closed.
        reports: RTCP sender reports with our clock, moved by `clock_shift_s`.
    """

    def __init__(
        self,
        *,
        reports: bool = True,
        clock_shift_s: float = 0.0,
        close_after: int | None = None,
        pause_at: int | None = None,
        pause_s: float = 0.0,
    ) -> None:
        self._reports, self._shift_s = reports, clock_shift_s
        self._close_after, self._pause_at, self._pause_s = close_after, pause_at, pause_s
        self._stopped = threading.Event()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.settimeout(0.1)
        self.url = f"rtsp://127.0.0.1:{self._listener.getsockname()[1]}/cam"
        self.sent_ns: list[int] = []
        self._units = [list(units) for units in _encoded(LOOP)]
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def __enter__(self) -> RtspServer:
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._thread.join(5)
        self._listener.close()

    def _run(self) -> None:
        while not self._stopped.is_set():
            with suppress(TimeoutError):
                client, _ = self._listener.accept()
                with client, suppress(OSError):
                    client.settimeout(5)
                    self._answer(client)

    def _answer(self, client: socket.socket) -> None:
        sps, pps = (next(u for u in self._units[0] if u[0] & 31 == kind) for kind in (7, 8))
        sets = ",".join(base64.b64encode(u).decode() for u in (sps, pps))
        sdp = (
            "v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=cam\r\nc=IN IP4 0.0.0.0\r\nt=0 0\r\n"
            "m=video 0 RTP/AVP 96\r\na=rtpmap:96 H264/90000\r\na=control:track\r\n"
            f"a=fmtp:96 packetization-mode=1;sprop-parameter-sets={sets}\r\n"
        )
        while True:
            request = b""
            while b"\r\n\r\n" not in request:
                if not (data := client.recv(4096)):
                    return
                request += data
            method = request.split()[0].decode()
            number = request.lower().split(b"cseq:")[1].split()[0].decode()
            head = f"RTSP/1.0 200 OK\r\nCSeq: {number}\r\nSession: 1\r\n"
            body = ""
            if method == "OPTIONS":
                head += "Public: OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN\r\n"
            elif method == "DESCRIBE":
                body = sdp
                head += f"Content-Type: application/sdp\r\nContent-Length: {len(body)}\r\n"
            elif method == "SETUP":
                head += "Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\n"
            client.sendall(f"{head}\r\n{body}".encode())
            if method == "PLAY":
                self._play(client)
                return

    def _play(self, client: socket.socket) -> None:
        started_s, started_ns = time.monotonic(), time.time_ns()
        sequence = 0
        for i in range(self._close_after or 10**9):
            paused_s = self._pause_s if self._pause_at is not None and i >= self._pause_at else 0.0
            due_s = i / RATE_HZ + paused_s
            if self._stopped.wait(max(0.0, started_s + due_s - time.monotonic())):
                return
            stamp = round(90_000 * due_s)
            # When it was due: this machine may be slow, a camera's clock is not.
            now_ns = started_ns + round(due_s * 1e9)
            if self._reports and i % RATE_HZ == 0:
                client.sendall(_framed(1, self._report(now_ns, stamp)))
            self.sent_ns.append(now_ns)
            units = self._units[i % len(self._units)]
            for k, payload in enumerate(packets := [p for u in units for p in _payloads(u)]):
                last = k == len(packets) - 1
                head = struct.pack(">BBHII", 0x80, 96 | last << 7, sequence % 65536, stamp, 7)
                client.sendall(_framed(0, head + payload))
                sequence += 1

    def _report(self, now_ns: int, stamp: int) -> bytes:
        seconds = Fraction(now_ns, 10**9) + Fraction(self._shift_s) + _NTP_S
        ntp = int(seconds * 2**32)
        return struct.pack(">BBHIQIII", 0x80, 200, 6, 7, ntp, stamp, 0, 0)


def picture(i: int) -> npt.NDArray[np.uint8]:
    """A bright square that moves right, 4 px a frame."""
    image = np.full((96, 320, 3), 60, np.uint8)
    image[32:64, 4 * i : 4 * i + 32] = 220
    return image


def _encoded(count: int) -> Iterator[list[bytes]]:
    """NAL units by frame, without B frames; the first is a key frame."""
    context = av.CodecContext.create("libx264", "w")
    assert isinstance(context, av.VideoCodecContext)
    context.width, context.height, context.pix_fmt = 320, 96, "yuv420p"
    context.time_base = Fraction(1, RATE_HZ)
    context.gop_size = GOP
    context.options = {"tune": "zerolatency", "preset": "veryfast"}
    for i in range(count):
        frame = av.VideoFrame.from_ndarray(picture(i), format="bgr24")
        frame.pts = i
        for packet in context.encode(frame):
            data = bytes(packet).replace(b"\0\0\0\1", b"\0\0\1")
            yield [unit for unit in data.split(b"\0\0\1") if unit]


def _payloads(unit: bytes) -> list[bytes]:
    """One unit as RTP payloads (RFC 6184: single, or FU-A)."""
    if len(unit) <= _MTU:
        return [unit]
    pieces = [unit[1:][at : at + _MTU] for at in range(0, len(unit) - 1, _MTU)]
    ends = {0: 0x80, len(pieces) - 1: 0x40}
    return [
        bytes([unit[0] & 0x60 | 28, ends.get(k, 0) | unit[0] & 31]) + piece
        for k, piece in enumerate(pieces)
    ]


def _framed(channel: int, data: bytes) -> bytes:
    return struct.pack(">cBH", b"$", channel, len(data)) + data
