"""What every request must pass before it is looked at (DESIGN section 10): its host, its token, its size, its rate.

The server listens on 127.0.0.1, where every page of every site in the browser of the same machine can reach it. So the
Host header must be ours (against names that are rebound to 127.0.0.1), writing needs a token that no other page knows,
and answers say that nobody else may show or read them. Refusals are one line of JSON.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import time
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

from fractal_farm.errors import FarmError, InputError

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Application = Callable[[Scope, Receive, Send], Awaitable[None]]

MOST_BODY_BYTES = 64 * 1024
MOST_AT_ONCE = 64
_BODY_SECONDS = 10.0
_WRITES_A_SECOND = 100.0
_WRITES_AT_ONCE = 200.0

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; media-src 'self' blob:; "
    "connect-src 'self' blob: data:; worker-src 'self' blob:; font-src 'self'; manifest-src 'self'; base-uri 'none'; "
    "form-action 'none'; frame-src 'self'; frame-ancestors 'self'"
)
"""Pages take nothing from elsewhere, and run no script that stands in a page."""
_HEADERS = (
    (b"content-security-policy", POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"permissions-policy", b"camera=(), geolocation=(), microphone=()"),
)


class Refused(Exception):  # noqa: N818 - it is an answer
    """A request that gets an answer of one line and this status."""

    def __init__(self, status: int, line: str) -> None:
        super().__init__(status, line)
        self.status, self.line = status, line


class Guard:
    """The application behind its door.

    Args:
        application: what answers.
        hosts: values of the Host header that are ours.
        token: what writing needs.
    """

    def __init__(self, application: Application, hosts: frozenset[str], token: str) -> None:
        self._application, self._hosts, self._token = application, hosts, token.encode()
        self._inside = 0
        self._allowance, self._counted = _WRITES_AT_ONCE, time.monotonic()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""
        if scope["type"] != "http":
            await self._application(scope, receive, send)
            return
        begun = False

        async def sending(message: Message) -> None:
            nonlocal begun
            if message["type"] == "http.response.start":
                begun = True
                known = {name.lower() for name, _ in message["headers"]}
                message["headers"] = [*message["headers"], *(pair for pair in _HEADERS if pair[0] not in known)]
            await send(message)

        self._inside += 1
        try:
            self._check(scope)
            await self._application(scope, _limited(scope, receive), sending)
        except asyncio.CancelledError:
            raise
        except Exception as error:
            if begun:  # too late for another answer: the connection is dropped
                raise
            await _refuse(sending, scope, *answer_to(error))
        finally:
            self._inside -= 1

    def _check(self, scope: Scope) -> None:
        headers = scope["headers"]
        if self._inside > MOST_AT_ONCE:
            raise Refused(503, "too many requests at once; try again in a moment")
        hosts = [value.decode("latin-1").lower() for name, value in headers if name == b"host"]
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            raise Refused(403, "this studio answers on 127.0.0.1 only")
        fetched = {name: value for name, value in headers if name.startswith(b"sec-fetch-")}
        if fetched.get(b"sec-fetch-site") == b"cross-site" and fetched.get(b"sec-fetch-mode") != b"navigate":
            raise Refused(403, "pages of other sites get nothing here")
        if scope["method"] not in ("GET", "HEAD", "POST"):
            raise Refused(405, f"method {scope['method'][:16]}: GET and POST are understood")
        given = next((value for name, value in headers if name == b"content-length"), b"0")
        if not given.isdigit() or len(given) > 18 or int(given) > MOST_BODY_BYTES:
            raise Refused(413, f"the body is too large; at most {MOST_BODY_BYTES} bytes")
        if scope["method"] != "POST":
            return
        token = next((value for name, value in headers if name == b"x-farm-token"), b"")
        if not hmac.compare_digest(token, self._token):
            raise Refused(403, "wrong or missing token; open the studio by the address that it printed")
        now = time.monotonic()
        self._allowance = min(_WRITES_AT_ONCE, self._allowance + (now - self._counted) * _WRITES_A_SECOND)
        self._counted = now
        if self._allowance < 1.0:
            raise Refused(429, "too many requests a second; try again in a moment")
        self._allowance -= 1.0


def answer_to(error: Exception) -> tuple[int, str]:
    """Status and line for what went wrong."""
    if isinstance(error, Refused):
        return error.status, error.line
    if isinstance(error, FarmError):
        return (400 if isinstance(error, InputError) else 500), " ".join(str(error).split())
    if isinstance(error, OSError):
        return 500, f"the file system failed: {error.strerror or type(error).__name__}"
    return 500, f"unexpected {type(error).__name__}; see the log of the studio"


def _limited(scope: Scope, receive: Receive) -> Receive:
    """`receive` that refuses a body that is too large, told or not, or too slow."""
    seen = 0

    async def receiving() -> Message:
        nonlocal seen
        if scope["method"] != "POST":  # who waits here waits for the client to go
            return await receive()
        try:
            message = await asyncio.wait_for(receive(), _BODY_SECONDS if seen >= 0 else None)
        except TimeoutError:
            raise Refused(408, "the body did not come in time") from None
        if message["type"] == "http.request":
            seen += len(message.get("body", b""))
            if seen > MOST_BODY_BYTES:
                raise Refused(413, f"the body is too large; at most {MOST_BODY_BYTES} bytes")
            if not message.get("more_body", False):
                seen = -1 << 62  # what comes after it is the end of the connection, whenever that is
        return message

    return receiving


async def _refuse(send: Send, scope: Scope, status: int, line: str) -> None:
    content = json.dumps({"error": line}).encode()
    headers = [
        (b"content-type", b"application/json"),
        (b"content-length", str(len(content)).encode()),
        (b"cache-control", b"no-store"),
    ]
    if status in (408, 413):
        headers.append((b"connection", b"close"))
    if status in (429, 503):
        headers.append((b"retry-after", b"1"))
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": b"" if scope["method"] == "HEAD" else content})
