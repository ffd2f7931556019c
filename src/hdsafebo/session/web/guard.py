"""Who may talk to the page: this computer only, or whoever holds the token."""

from __future__ import annotations

import hmac
import ipaddress
import re
from urllib.parse import parse_qs

from starlette.requests import Request
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

COOKIE = "hdsafebo_session"
PAGE_HEADER = "x-session-page"  # another site's form or script cannot set it without being asked first (CORS)
_HOST = re.compile(r"(?P<name>\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9.-]+)(:\d{1,5})?", re.ASCII)
_SECURITY = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data:; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}


def is_loopback(host: str) -> bool:
    """Whether a host name or address is this computer."""
    name = host.strip("[]")
    if name == "localhost":
        return True
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


def _asked_host(request: Request) -> str:
    """The name under which a browser found this program; empty unless exactly one is given, and readable.

    Not that of `request.url`, which takes a name that it cannot read for the server's own: `a"b.example`
    would be this computer.
    """
    given = request.headers.getlist("host")
    found = _HOST.fullmatch(given[0]) if len(given) == 1 else None
    return "" if found is None else found["name"].lower()


class Guard:
    """ASGI middleware.

    Without a token only requests to a loopback name pass (a foreign name that resolves to this computer does
    not). With one, every request needs it, in the address once and in a cookie from then on. Requests that
    change something need the page's own header as well.

    Args:
        app: the page.
        token: None on loopback.
    """

    def __init__(self, app: ASGIApp, token: str | None) -> None:
        self._app = app
        self._token = token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        refusal = self._refusal(Request(scope))
        if refusal is not None:
            await refusal(scope, receive, send)
            return

        async def send_secured(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [
                    *message["headers"],
                    *((k.lower().encode(), v.encode()) for k, v in _SECURITY.items()),
                ]
            await send(message)

        await self._app(scope, receive, send_secured)

    def _refusal(self, request: Request) -> Response | None:
        """The answer to a request that may not pass; None when it may."""
        if not request.scope["query_string"].isascii():
            return PlainTextResponse("the address is malformed", 400)
        if self._token is None:
            if not is_loopback(_asked_host(request)):
                return PlainTextResponse("this page answers to this computer's own names only", 403)
        else:
            query = request.scope["query_string"].decode("latin-1")
            given = parse_qs(query).get("token", [""])[0]
            if given and self._matches(given):
                answer = RedirectResponse("/" + request.scope["path"].lstrip("/"), 303)  # never another host
                answer.set_cookie(COOKIE, self._token, httponly=True, samesite="strict")
                return answer
            if not self._matches(request.cookies.get(COOKIE, "")):
                return PlainTextResponse("open the address with the token that was printed at the start", 401)
        if request.method not in ("GET", "HEAD") and PAGE_HEADER not in request.headers:
            return PlainTextResponse(f"the header {PAGE_HEADER} is missing", 403)
        return None

    def _matches(self, given: str) -> bool:
        assert self._token is not None
        return hmac.compare_digest(given.encode(), self._token.encode())
