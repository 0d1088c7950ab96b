"""Who may ask: this machine's browser with the token, for this page, in requests of bounded size; and where pages may reach."""

import hmac
from collections.abc import Awaitable, Callable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qsl, quote, urlencode

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Message, Receive, Send], Awaitable[None]]

#: Pages load from and talk to the server that they came from, and to nothing else. NiceGUI builds its pages in the browser,
#: which needs inline scripts and `eval`.
POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self'; object-src 'none'; base-uri 'self'; "
    "form-action 'self'; frame-ancestors 'self'"
)

#: A report is a page by itself: its scripts run, and reach nothing, not even the studio.
REPORT_POLICY = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval'; style-src 'unsafe-inline'; "
    "img-src data: blob:; font-src data:; frame-ancestors 'self'"
)

_CLOSED_BY_POLICY = 1008  # code of a WebSocket that is refused, RFC 6455


class Gate:
    """ASGI application before another one.

    The first address that is opened has the token; it is exchanged for a cookie of this server's port, so that it stands in no
    later address. Requests for another host (a name that was bent to point here) or from another page are refused.
    """

    def __init__(self, app: App, token: str, port: int, most_bytes: int) -> None:
        self._app, self._token, self._most_bytes = app, token, most_bytes
        self._hosts = {f"{name}:{port}" for name in ("127.0.0.1", "localhost")}
        self._cookie = f"wsp_studio_{port}"

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Answer a request, or hand it on."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
        if refusal := self._foreign(scope, headers):
            await _refuse(scope, send, 403, refusal)
            return
        given = dict(parse_qsl(scope["query_string"].decode("latin-1")))
        if scope["type"] == "http" and self._is_token(given.pop("token", "")):
            await self._welcome(scope["path"], given, send)
            return
        if not self._is_token(self._carried(headers.get("cookie", ""))):
            await _refuse(scope, send, 403, "This page needs its token: open the address that `wsp studio` printed.")
            return
        if refusal := self._too_large(scope, headers):
            await _refuse(scope, send, 413, refusal)
            return
        await self._app(scope, receive, lambda message: send(_with_policy(message)))

    def _foreign(self, scope: Message, headers: dict[str, str]) -> str:
        if headers.get("host", "") not in self._hosts:
            return "This server answers to 127.0.0.1 and localhost only."
        asks_to_change = scope["type"] == "websocket" or scope.get("method") not in ("GET", "HEAD")
        origin = headers.get("origin")
        if asks_to_change and origin is not None and origin.partition("://")[2] not in self._hosts:
            return "This server answers to its own pages only."
        return ""

    def _too_large(self, scope: Message, headers: dict[str, str]) -> str:
        """Say why a body is refused before any of it is read; the server holds a body to the length it states."""
        if scope["type"] != "http" or scope["method"] in ("GET", "HEAD"):
            return ""
        length = headers.get("content-length", "")
        if not length.isdecimal():
            return "A request must state its length."
        return "" if int(length) <= self._most_bytes else f"A file may have {self._most_bytes / 1e6:.0f} MB at most."

    async def _welcome(self, path: str, rest: dict[str, str], send: Send) -> None:
        place = quote(f"/{path.lstrip('/')}") + (f"?{urlencode(rest)}" if rest else "")  # "//host" would be another server's
        cookie = f"{self._cookie}={self._token}; Path=/; HttpOnly; SameSite=Strict"
        headers = [(b"location", place.encode()), (b"set-cookie", cookie.encode()), (b"cache-control", b"no-store")]
        await send({"type": "http.response.start", "status": 303, "headers": headers})
        await send({"type": "http.response.body", "body": b""})

    def _carried(self, cookies: str) -> str:
        jar: SimpleCookie = SimpleCookie()
        try:
            jar.load(cookies)
        except CookieError:
            return ""
        return jar[self._cookie].value if self._cookie in jar else ""

    def _is_token(self, given: str) -> bool:
        return hmac.compare_digest(given.encode(), self._token.encode())


def _with_policy(message: Message) -> Message:
    if message["type"] != "http.response.start":
        return message
    headers = list(message.get("headers", ()))
    if not any(name.lower() == b"content-security-policy" for name, _ in headers):
        headers.append((b"content-security-policy", POLICY.encode()))
    headers += [(b"x-content-type-options", b"nosniff"), (b"referrer-policy", b"no-referrer")]
    return {**message, "headers": headers}


async def _refuse(scope: Message, send: Send, status: int, why: str) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": _CLOSED_BY_POLICY, "reason": why})
        return
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"connection", b"close")]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": f"{why}\n".encode()})
