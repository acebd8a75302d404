"""Logging in to a network camera as it asks for: Digest where it offers that, else Basic."""

from __future__ import annotations

import base64
import http.client
from urllib.error import URLError
from urllib.parse import SplitResult, unquote
from urllib.request import (
    AbstractDigestAuthHandler,
    HTTPPasswordMgrWithDefaultRealm,
    Request,
    parse_http_list,
    parse_keqv_list,
)

from recorder.errors import InputError


def authorization(
    address: SplitResult, target: str, refused: http.client.HTTPResponse, spec: str
) -> str:
    """The header that answers a 401.

    The password is never sent in the clear where Digest is offered.

    Args:
        address: the URL with user and password.
        target: what is asked for: path and query, as sent.
        spec: the URL as it may be shown.

    Raises:
        InputError: there is no user in the URL, or the camera wants another login.
    """
    offered = {h.split(" ")[0].lower(): h for h in refused.headers.get_all("WWW-Authenticate", [])}
    if address.username is None:
        raise InputError(spec, "expected to be let in, found 401: give http://USER:PASSWORD@HOST/…")
    user, password = unquote(address.username), unquote(address.password or "")
    if "digest" in offered:
        return _digest(user, password, address, target, offered["digest"], spec)
    if "basic" in offered or not offered:
        return f"Basic {base64.b64encode(f'{user}:{password}'.encode()).decode()}"
    wanted = " or ".join(header.split(" ")[0] for header in offered.values())
    raise InputError(spec, f"expected a Digest or Basic login, found one by {wanted}")


def _digest(
    user: str, password: str, address: SplitResult, target: str, header: str, spec: str
) -> str:
    url = f"{address.scheme}://{address.netloc.rpartition('@')[2]}{target}"
    known = HTTPPasswordMgrWithDefaultRealm()
    known.add_password(None, url, user, password)
    try:
        challenge = parse_keqv_list(parse_http_list(header.partition(" ")[2]))
        answer = AbstractDigestAuthHandler(known).get_authorization(Request(url), challenge)
    except (ValueError, URLError) as error:
        raise InputError(spec, f"expected a Digest login by MD5, found: {error}") from error
    if answer is None:
        raise InputError(spec, "expected a Digest login with realm and nonce, found none")
    return f"Digest {answer}"
