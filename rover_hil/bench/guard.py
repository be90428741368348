"""Refuses requests from other sites, under foreign names and without the token of the page's address.

It also forbids pages to load from elsewhere.
"""

import hmac
from urllib.parse import parse_qs, urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LOCAL_NAMES = frozenset(("localhost", "127.0.0.1", "::1"))
HEADERS = {
    "Content-Security-Policy": (
        "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; connect-src 'self'; "
        "frame-ancestors 'none'; form-action 'self'; base-uri 'self'"
    ),
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
}
REFUSED = "refused: this page answers only to itself, opened as http://localhost\n"
QUERY_KEY = "token"
READ_ONLY = ("/static/", "/_nicegui/", "/stream", "/camera/", "/report/")
"""Beginnings of paths that need no token: what they answer to GET drives nothing."""
ADDRESS_REFUSED = (
    "refused: this address lacks the token of the running bench: open the address that `rover-hil bench` "
    "printed when it started (only POST /stop needs no token)\n"
)


class Guard:
    """Lets only requests of the page itself through.

    The name of the host must be one of this computer, whatever the port, so that it also works through an ssh
    tunnel, and so that no foreign name can be made to point here. A request with an origin must come from the
    same host and port. What can drive also needs the token; the emergency stop does not, whoever sends it.

    Args:
        app: The application behind.
        token: Part of the address of the page.
    """

    def __init__(self, app: ASGIApp, token: str) -> None:
        self._app = app
        self._token = token.encode()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request or WebSocket."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        refusal = REFUSED
        if is_allowed(Headers(scope=scope)):
            refusal = "" if needs_no_token(scope) or self._has_token(scope) else ADDRESS_REFUSED
        if not refusal:
            await self._app(scope, receive, _with_headers(send))
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            await PlainTextResponse(refusal, 403)(scope, receive, send)

    def _has_token(self, scope: Scope) -> bool:
        given = parse_qs(scope["query_string"].decode("latin-1")).get(QUERY_KEY, [])
        return len(given) == 1 and hmac.compare_digest(given[0].encode(), self._token)


def is_allowed(headers: Headers) -> bool:
    """Return whether a request comes from the page itself, or from no page at all."""
    host, origin = headers.get("host", ""), headers.get("origin")
    try:
        name = urlsplit(f"//{host}").hostname
    except ValueError:
        return False
    return name in LOCAL_NAMES and (origin is None or origin in (f"http://{host}", f"https://{host}"))


def needs_no_token(scope: Scope) -> bool:
    """Return whether a request can drive nothing: the emergency stop, and what is only read."""
    if scope["type"] != "http":
        return False
    if scope["method"] == "POST":
        return bool(scope["path"] == "/stop")
    return scope["method"] in ("GET", "HEAD") and scope["path"].startswith(READ_ONLY)


def _with_headers(send: Send) -> Send:
    async def send_with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in HEADERS.items():
                headers[name] = value
        await send(message)

    return send_with_headers
