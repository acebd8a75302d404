"""MJPEG over HTTP: one JPEG after another in a multipart response that does not end."""

from __future__ import annotations

import http.client
import re
import socket
import string
import time
from collections.abc import Mapping
from contextlib import suppress
from decimal import Decimal, InvalidOperation
from email.message import Message
from urllib.parse import SplitResult, quote, urlsplit

from recorder.errors import InputError
from recorder.sources.live import clock
from recorder.sources.live.http_login import authorization
from recorder.sources.live.multipart import CutError, Part, parts
from recorder.sources.live.stream import SILENCE_S, ConnectionLost, LiveCamera, Received

_CONNECT_S = 5.0
_HOST = re.compile(r"(\[.*\]|[^:]*)(:\d*)?")
# Cameras that take no header for it: ?user=admin&pwd=...
_SECRETS = re.compile(r"([?&][^=&#]*(?:pass|pwd|token|secret|auth|key)[^=&#]*=)[^&#]*", re.I)


def http_camera(url: str) -> LiveCamera:
    """The camera behind an `http://` or `https://` URL.

    Raises:
        InputError: there is no MJPEG stream.
    """
    about = {"kind": "http mjpeg", "url": without_password(url), "encoding": "as it is"}
    return LiveCamera(host_name(url), without_password(url), lambda: HttpConnection(url), about)


class HttpConnection:
    """One response, read part by part.

    Capture is what the part's X-Timestamp says (mjpg-streamer and others pass the kernel's stamp
    on), where that clock is near ours when the first frame comes; else the arrival of the part's
    headers.
    """

    def __init__(self, url: str) -> None:
        self._spec = without_password(url)
        self._address = _split(url, self._spec)
        self._connection = self._connected()
        # The connection gives its socket away with the response; it takes this to interrupt that.
        self._socket: socket.socket = self._connection.sock
        self._response: http.client.HTTPResponse | None = None
        try:
            self._response = response = self._answered()
            boundary = self._boundary(response)
        except BaseException:
            self.close()
            raise
        self._socket.settimeout(SILENCE_S)
        self._server = response.headers.get("Server", "")
        self._parts = parts(response, boundary)
        self._stamped: bool | None = None

    def receive(self) -> Received | None:
        try:
            part = next(self._parts)
        except StopIteration as end:
            raise ConnectionLost("the server ended the stream") from end
        except CutError as error:
            raise ConnectionLost(str(error), cut=True) from error
        except TimeoutError as error:
            raise ConnectionLost(f"nothing for {SILENCE_S:g} s") from error
        except (OSError, ValueError, http.client.HTTPException) as error:
            raise ConnectionLost(_reason(error)) from error
        arrival_ns = time.time_ns()
        timestamp_ns = self._stamp_ns(part, arrival_ns)
        note = f"{part.skipped} bytes belong to no frame" if part.skipped else None
        return Received(part.data, arrival_ns, timestamp_ns, note=note)

    def describe(self) -> Mapping[str, str]:
        name = "server (X-Timestamp of each part)" if self._stamped else clock.ARRIVAL
        return {"clock": name, "server": self._server}

    def interrupt(self) -> None:
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        self.interrupt()
        if self._response is not None:
            self._response.close()
        self._connection.close()

    def _connected(self) -> http.client.HTTPConnection:
        address = self._address
        secure = address.scheme == "https"
        kind = http.client.HTTPSConnection if secure else http.client.HTTPConnection
        connection = kind(address.hostname or "", address.port, timeout=_CONNECT_S)
        try:
            connection.connect()
        except OSError as error:
            connection.close()
            raise InputError(
                self._spec, f"expected a server, found none ({_reason(error)})"
            ) from error
        return connection

    def _answered(self) -> http.client.HTTPResponse:
        """The answer, after a login where the server asks for one."""
        target = self._address.path or "/"
        target += f"?{self._address.query}" if self._address.query else ""
        target = quote(target, safe=string.punctuation)
        response = self._asked(target, {})
        if response.status != 401:
            return response
        with response:
            login = authorization(self._address, target, response, self._spec)
        self._connection.close()
        self._connection = self._connected()
        self._socket = self._connection.sock
        response = self._asked(target, {"Authorization": login})
        if response.status == 401:
            response.close()
            raise InputError(self._spec, "expected user and password, found 401: not let in")
        return response

    def _asked(self, target: str, login: Mapping[str, str]) -> http.client.HTTPResponse:
        try:
            self._connection.request("GET", target, headers={"User-Agent": "arucolog", **login})
            return self._connection.getresponse()
        except (OSError, http.client.HTTPException) as error:
            raise InputError(
                self._spec, f"expected an answer, found none ({_reason(error)})"
            ) from error

    def _boundary(self, response: http.client.HTTPResponse) -> str:
        """What is between the parts of a response; everything that is no stream is refused."""
        if location := response.headers.get("Location"):
            raise InputError(self._spec, f"expected a stream, found a redirect to {location}")
        if response.status != 200:
            raise InputError(
                self._spec, f"expected a stream, found {response.status} {response.reason}"
            )
        boundary = response.headers.get_boundary()
        if response.headers.get_content_maintype() != "multipart" or not boundary:
            raise InputError(
                self._spec,
                "expected an MJPEG stream (multipart/x-mixed-replace), found "
                f"{_content_type(response.headers)}",
            )
        return boundary

    def _stamp_ns(self, part: Part, arrival_ns: int) -> int | None:
        try:
            stamp_ns = int(Decimal(part.headers.get("x-timestamp", "")) * 10**9)
        except (InvalidOperation, OverflowError, ValueError):
            stamp_ns = -1
        if self._stamped is None:
            self._stamped = clock.near(stamp_ns, arrival_ns)
        return stamp_ns if self._stamped and 0 < stamp_ns < 2**63 else part.begun_ns


def without_password(url: str) -> str:
    """The URL as it may be shown."""
    url = _SECRETS.sub(r"\1***", url)
    scheme, separator, rest = url.partition("://")
    place, slash, path = rest.partition("/")
    if "@" not in place and not _HOST.fullmatch(place):
        # A password with a slash in it, which is not to be shown either.
        place, slash, path = rest, "", ""
    user, at, host = place.rpartition("@")
    if not at:
        return url
    return f"{scheme}{separator}{user.partition(':')[0]}:***@{host}{slash}{path}"


def host_name(url: str) -> str:
    """The host in a URL, fit for the name of a file."""
    try:
        host = urlsplit(url).hostname or "camera"
    except ValueError:
        host = "camera"
    return "".join(c if c.isalnum() or c in ".-" else "-" for c in host)


def _split(url: str, spec: str) -> SplitResult:
    try:
        address = urlsplit(url)
        if address.hostname and (address.port is None or address.port > 0):
            return address
    except ValueError:
        pass
    hint = " (in a password / is %2F, @ is %40)" if "@" in url else ""
    raise InputError(spec, f"expected a URL such as http://HOST:PORT/PATH, found another one{hint}")


def _content_type(headers: Message) -> str:
    return headers.get_content_type() if "Content-Type" in headers else "no Content-Type"


def _reason(error: Exception) -> str:
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return text.lower() if text else type(error).__name__
