"""Logins of network cameras, against a server that computes by itself what RFC 2617 asks for."""

from __future__ import annotations

import base64
import hashlib
import http.server
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from urllib.request import parse_http_list, parse_keqv_list

import cv2
import numpy as np
import pytest

from recorder.errors import InputError
from recorder.sources.live.http_mjpeg import http_camera

REALM, NONCE, OPAQUE = "camera, ceiling", "dcd98b7102dd", "5ccc069c"
DIGEST = f'Digest realm="{REALM}", qop="auth", nonce="{NONCE}", opaque="{OPAQUE}"'
OLD_DIGEST = f'Digest realm="{REALM}", nonce="{NONCE}"'
BASIC = f'Basic realm="{REALM}"'
USER, PASSWORD = "me", "p@ss word"
IN_URL = "me:p%40ss%20word"


def md5(*values: str) -> str:
    return hashlib.md5(":".join(values).encode()).hexdigest()


def lets_in(header: str, target: str) -> bool:
    scheme, _, rest = header.partition(" ")
    if scheme == "Basic":
        return base64.b64decode(rest).decode() == f"{USER}:{PASSWORD}"
    given = parse_keqv_list(parse_http_list(rest))
    if (given["username"], given["realm"], given["nonce"]) != (USER, REALM, NONCE):
        return False
    counted = [given[key] for key in ("nc", "cnonce", "qop")] if "qop" in given else []
    proof = md5(md5(USER, REALM, PASSWORD), NONCE, *counted, md5("GET", target))
    return given["uri"] == target and given["response"] == proof


@contextmanager
def camera(*challenges: str) -> Iterator[tuple[str, list[str]]]:
    """An MJPEG camera behind a login: its place, and the logins that it was sent."""
    jpeg = cv2.imencode(".jpg", np.zeros((48, 64), np.uint8))[1].tobytes()
    logins: list[str] = []

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            login = self.headers.get("Authorization", "")
            logins.append(login)
            if not login or not lets_in(login, self.path):
                self.send_response(401)
                for challenge in challenges:
                    self.send_header("WWW-Authenticate", challenge)
                self.end_headers()
                return
            self.send_response(200)
            self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=b")
            self.end_headers()
            for _ in range(3):
                part = f"--b\r\nContent-Length: {len(jpeg)}\r\n\r\n".encode() + jpeg + b"\r\n"
                self.wfile.write(part)

        def log_message(self, *_: object) -> None: ...

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True)
        thread.start()
        yield f"127.0.0.1:{server.server_port}/video.cgi?fps=10&name=a%20b", logins
        server.shutdown()
        thread.join()


@pytest.mark.parametrize(
    ("challenges", "scheme"),
    [
        ([BASIC], "Basic"),
        ([DIGEST], "Digest"),
        ([OLD_DIGEST], "Digest"),
        ([BASIC, DIGEST], "Digest"),
        ([DIGEST, BASIC], "Digest"),
        ([f"{BASIC}, {DIGEST}"], "Digest"),
        ([f"{DIGEST}, {BASIC}"], "Digest"),
        ([f"{DIGEST}, algorithm=MD5", f"{DIGEST}, algorithm=SHA-256"], "Digest"),
        ([f"{DIGEST}, algorithm=SHA-256", f"Negotiate, {OLD_DIGEST}"], "Digest"),
        ([], "Basic"),
    ],
)
def test_a_camera_is_logged_in_to_as_it_asks(challenges: list[str], scheme: str) -> None:
    with camera(*challenges) as (place, logins):
        source = http_camera(f"http://{IN_URL}@{place}")
        source.stop()
    assert source.image_size == (64, 48)
    assert logins[0] == ""
    assert {login.split(" ")[0] for login in logins if login} == {scheme}


@pytest.mark.parametrize(
    ("challenges", "user", "words"),
    [
        ([BASIC], "", "expected to be let in, found 401: give http://USER:PASSWORD@HOST"),
        ([DIGEST], "me:other@", "expected user and password, found 401: not let in"),
        ([BASIC], "me:other@", "expected user and password, found 401: not let in"),
        (["Negotiate"], "me:other@", "expected a Digest or Basic login, found one by Negotiate"),
        ([DIGEST + ", algorithm=SHA-512-256"], "me:x@", "expected a Digest login by MD5, found"),
        ([f"{BASIC}, {DIGEST}, algorithm=SHA-256"], "me:x@", "expected a Digest login by MD5"),
        (["Digest"], "me:x@", "expected a Digest login with realm and nonce, found none"),
        (["Digest realm"], "me:x@", "expected a Digest login by MD5, found"),
    ],
)
def test_who_is_not_let_in_is_told_why(challenges: list[str], user: str, words: str) -> None:
    with camera(*challenges) as (place, _), pytest.raises(InputError, match=words) as error:
        http_camera(f"http://{user}{place}")
    assert "other" not in str(error.value)


def test_a_password_does_not_go_where_it_is_not_asked_for() -> None:
    sha = f"{BASIC}, {DIGEST}, algorithm=SHA-256"
    with camera(sha) as (place, logins), pytest.raises(InputError):
        http_camera(f"http://{IN_URL}@{place}")
    assert logins == [""]
