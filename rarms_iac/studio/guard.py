"""Who may talk to the studio: one browser, by a token that works once and a cookie from then on. Others get 403.

Loopback is no border between the users of a machine, and any page in the same browser can send requests to it. So each
request must name this server (`Host`, against DNS rebinding), come from its own page (`Origin`, `Sec-Fetch-Site`), and
carry the cookie. Cookies do not tell ports apart, so this one is bound to a path that cannot be guessed: another server
on this machine is never sent it.
"""

import secrets
from dataclasses import dataclass, field
from hmac import compare_digest
from typing import TYPE_CHECKING

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, Response

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

MOST_BYTES = 65_536
"""Of a request's body."""
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
    "403: this studio does not know this browser, and its first address works once.\n"
    "Go on in the browser in which it was opened. For another browser end rarms studio with Ctrl-C "
    "and start it again.\n"
)


def _secret() -> str:
    return secrets.token_urlsafe(32)


@dataclass(slots=True, kw_only=True)
class Keys:
    """What lets a browser in."""

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
        inner: what the browser reaches.
        port: of the loopback interface.
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
        """Return what the guard itself answers; None: the browser may pass."""
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
        """Whether it names this server, and no other page sent it."""
        origins = headers.getlist("origin")
        return headers.getlist("host") == [self._host] and origins in ([], [f"http://{self._host}"])

    def _has_cookie(self, headers: Headers) -> bool:
        """Whether any cookie of the name has the value: a server on another port may have set one for every path."""
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
        """Return a request that may change something comes from the page itself, as JSON of a length that is told."""
        if "origin" not in headers or headers.get("content-type") != "application/json":
            return _refused()
        length = headers.get("content-length", "")
        if not length.isdecimal() or "transfer-encoding" in headers:  # with both, chunks count and not the length
            return PlainTextResponse("The length of the body is not told.\n", 411)
        if int(length) > MOST_BYTES:
            return PlainTextResponse(f"A body has at most {MOST_BYTES} bytes.\n", 413)
        return None


def _refused() -> Response:
    return PlainTextResponse(_REFUSED, 403)
