"""Who may talk to the studio: one browser, by a token that works once and a cookie from then on. Others get 403.

Loopback does not separate the users of a machine, and any page in the same browser can send requests to it. So each
request must name this server (`Host`, against DNS rebinding), come from its own page (`Origin`, `Sec-Fetch-Site`), and
carry the cookie. Cookies do not tell ports apart, so this one is bound to a path that cannot be guessed: another server
on this machine is never sent it.

The loopback interface is open to all users of a machine, and each connection takes a descriptor of the process that
measures. So there are few of them; those that sent no request yet end first, and none waits for its first request for
long. What the guard refuses ends with its answer.
"""

import asyncio
import secrets
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from hmac import compare_digest
from typing import TYPE_CHECKING

import uvicorn
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from uvicorn.protocols.http.h11_impl import H11Protocol

from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.texts.messages import reason_of

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send


COOKIE_SECONDS = 7 * 24 * 3600
"""A browser keeps the cookie so long, also when it is closed: its user finds the run again. It ends with the server."""

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)

HEADERS = {
    "Content-Security-Policy": POLICY,
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}

# NOTE: no redirect. A browser that came from a file sends no strict cookie along a redirect; a page of ours leads on.
# With a token that was used, too, but with 403 and no cookie: the browser that has the cookie comes back so.
_ENTRANCE = (
    '<!doctype html><html lang="en"><head><meta charset="utf-8"><meta http-equiv="refresh" content="0; url={path}">'
    '<title>rarms studio</title></head><body><p><a href="{path}">rarms studio</a></p></body></html>'
)
_REFUSED = (
    "403: this browser is not allowed. The start address works only once.\nUse the browser in which "
    "it was opened. For another browser, end rarms studio with Ctrl-C and start it again.\n\n"
)


def _secret() -> str:
    return secrets.token_urlsafe(32)


@dataclass(slots=True, kw_only=True)
class Keys:
    """The secrets that let a browser in."""

    folder: str = field(default_factory=_secret)  # the path that the cookie is bound to
    cookie: str = field(default_factory=_secret)
    token: str = field(default_factory=_secret)  # of the first address; empty once it was used

    @property
    def path(self) -> str:
        """Where the page lies."""
        return f"/{self.folder}/"

    @property
    def entrance(self) -> str:
        """The path of the first address."""
        return f"{self.path}enter?token={self.token}"


class Guard:
    """An ASGI application that hands requests of the one browser on to another, below `Keys.path`.

    Args:
        keys: what lets the browser in.
    """

    def __init__(self, inner: "ASGIApp", port: int, keys: Keys) -> None:
        self._inner = inner
        self._host = f"127.0.0.1:{port}"
        self._keys = keys
        self._cookie = f"rarms-studio-{port}"

    async def __call__(self, scope: "Scope", receive: "Receive", send: "Send") -> None:
        """Answer a request, or hand it on."""
        if scope["type"] == "lifespan":
            await self._inner(scope, receive, send)
            return
        if scope["type"] != "http":
            await send({"type": "websocket.close", "code": 1008})
            return

        async def send_with_headers(event: "Message") -> None:
            if event["type"] == "http.response.start":
                MutableHeaders(scope=event).update(HEADERS if answer is None else {**HEADERS, "Connection": "close"})
            await send(event)

        answer = self._answer(Request(scope))
        await (answer or self._inner)(scope, receive, send_with_headers)

    def _answer(self, request: Request) -> Response | None:
        """Return the guard's own answer; None: the browser may pass."""
        if not self._is_addressed(request.headers):
            return _refused()
        path, method = request.url.path, request.method
        if path == f"{self._keys.path}enter" and method == "GET":
            return self._let_in(request.query_params.get("token", ""))
        if not path.startswith(self._keys.path) or not self._has_cookie(request.headers):
            return _refused()
        if request.headers.get("sec-fetch-site", "same-origin") not in {"same-origin", "none"}:
            return _refused()
        return None if method in {"GET", "HEAD"} else self._judge_post(request.headers)

    def _is_addressed(self, headers: Headers) -> bool:
        """Return whether the request names this server and no other page sent it."""
        origins = headers.getlist("origin")
        return headers.getlist("host") == [self._host] and origins in ([], [f"http://{self._host}"])

    def _has_cookie(self, headers: Headers) -> bool:
        """Look at every cookie of the name: a server on another port may have set one for every path."""
        pairs = (pair.strip().partition("=") for line in headers.getlist("cookie") for pair in line.split(";"))
        values = [value for name, _, value in pairs if name == self._cookie]
        return any(compare_digest(value.encode(), self._keys.cookie.encode()) for value in values)

    def _let_in(self, token: str) -> Response:
        expected = self._keys.token
        page = _ENTRANCE.format(path=self._keys.path)
        if not expected or not compare_digest(token.encode(), expected.encode()):
            return HTMLResponse(page, 403)
        self._keys.token = ""
        response = HTMLResponse(page)
        response.set_cookie(
            self._cookie, self._keys.cookie, COOKIE_SECONDS, path=self._keys.path, httponly=True, samesite="strict"
        )
        return response

    def _judge_post(self, headers: Headers) -> Response | None:
        """Refuse a request that may change something, unless the page itself sent it, as JSON."""
        is_of_page = "origin" in headers and headers.get("content-type") == "application/json"
        return None if is_of_page else _refused()


def _refused() -> Response:
    return PlainTextResponse(_REFUSED, 403)


LOOPBACK = "127.0.0.1"
MOST_CONNECTIONS = 32
"""A browser opens at most six to a server."""
MOST_ACCEPTED = 8
"""At once, before they are counted: the rest waits in the kernel, where it takes no descriptor."""
REQUEST_SECONDS = 10.0
"""For the head of the first request."""


class BoundedProtocol(H11Protocol):
    """HTTP/1.1 with a bound of connections, and a deadline for the first request of each.

    uvicorn 0.54 has no setting for either. Measured: 100 connections that send nothing stay open for good, and with
    `limit_concurrency=32` the owner's request gets 503; `timeout_keep_alive` begins only after the first answer.
    """

    _deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override] # as uvicorn has it
        """Take the connection; if there are too many, end the one that has been silent for longest."""
        super().connection_made(transport)
        self._deadline = self.loop.call_later(REQUEST_SECONDS, self._end_silence)
        living = [each for each in self.connections if not each.transport.is_closing()]
        if len(living) > MOST_CONNECTIONS:
            silent = [each for each in living if isinstance(each, BoundedProtocol) and each.is_silent]
            min(silent, key=lambda each: each.deadline).transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget it."""
        super().connection_lost(exc)
        if self._deadline is not None:
            self._deadline.cancel()

    @property
    def is_silent(self) -> bool:
        """Whether no request came yet."""
        return self.cycle is None

    @property
    def deadline(self) -> float:
        """When its first request must have come, by the loop's clock."""
        return self._deadline.when() if self._deadline else 0.0

    def _end_silence(self) -> None:
        if self.is_silent:
            self.transport.abort()


class StudioServer(uvicorn.Server):
    """uvicorn without signals of its own: the command line has them, and hands them over as a `StopSignal`."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Take none over.

        Yields:
            Once, with nothing.
        """
        yield


def bind(port: int) -> socket.socket:
    """Take a port of the loopback interface.

    Args:
        port: 0: any that is free.

    Returns:
        A socket that listens.

    Raises:
        RequestError: it is taken.
    """
    bound = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    if sys.platform == "win32":  # without it another process could take the same port
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
    else:  # without it a port stays taken for a minute after its last connection; on Windows it means something else
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        bound.bind((LOOPBACK, port))
        bound.listen(MOST_ACCEPTED)  # now: two sockets may be bound to a port as long as neither listens
    except OSError as error:
        bound.close()
        raise RequestError(f"Port {port} cannot be used: {reason_of(error)}. Choose another with --port.") from error
    return bound
