"""Logging in to a network camera as it asks for: Digest where it offers that, else Basic."""

from __future__ import annotations

import base64
import http.client
import re
from typing import NamedTuple
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

# Those that the standard library can compute.
_ALGORITHMS = ("MD5", "SHA")
_SCHEME = re.compile(r"([\w-]+)(?:\s+(.*))?", re.S)
_PARAMETER = re.compile(r"[\w-]+\s*=")


class _Challenge(NamedTuple):
    """One of the logins that a server offers.

    Attributes:
        scheme: as it is written there, such as Basic.
        parameters: as `name=value`.
    """

    scheme: str
    parameters: list[str]


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
    if address.username is None:
        raise InputError(spec, "expected to be let in, found 401: give http://USER:PASSWORD@HOST/…")
    user, password = unquote(address.username), unquote(address.password or "")
    offered = _challenges(refused.headers.get_all("WWW-Authenticate", []))
    schemes = {challenge.scheme.lower() for challenge in offered}
    if "digest" in schemes:
        digests = [c for c in offered if c.scheme.lower() == "digest"]
        return _digest(user, password, address, target, digests, spec)
    if "basic" in schemes or not offered:
        return f"Basic {base64.b64encode(f'{user}:{password}'.encode()).decode()}"
    wanted = " or ".join(challenge.scheme for challenge in offered)
    raise InputError(spec, f"expected a Digest or Basic login, found one by {wanted}")


def _challenges(headers: list[str]) -> list[_Challenge]:
    """All of them: a header may hold several."""
    found: list[_Challenge] = []
    for part in (part for header in headers for part in parse_http_list(header)):
        scheme = None if _PARAMETER.match(part) else _SCHEME.match(part)
        if scheme is not None:
            found.append(_Challenge(scheme[1], [scheme[2]] if scheme[2] else []))
        elif found:
            found[-1].parameters.append(part)
    return found


def _digest(
    user: str,
    password: str,
    address: SplitResult,
    target: str,
    challenges: list[_Challenge],
    spec: str,
) -> str:
    url = f"{address.scheme}://{address.netloc.rpartition('@')[2]}{target}"
    known = HTTPPasswordMgrWithDefaultRealm()
    known.add_password(None, url, user, password)
    try:
        offered = [parse_keqv_list(challenge.parameters) for challenge in challenges]
        usable = [values for values in offered if values.get("algorithm", "MD5") in _ALGORITHMS]
        # Where there is none, the first says what is not known.
        answer = AbstractDigestAuthHandler(known).get_authorization(
            Request(url), (usable or offered)[0]
        )
    except (ValueError, URLError) as error:
        raise InputError(spec, f"expected a Digest login by MD5, found: {error}") from error
    if answer is None:
        raise InputError(spec, "expected a Digest login with realm and nonce, found none")
    return f"Digest {answer}"
