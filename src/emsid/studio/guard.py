"""What every request must satisfy before it is answered, and the headers of every answer.

Other programs and pages on the same machine can reach a loopback port. A request must therefore name the secret token
as the first part of its path, address this host and port (a foreign name that resolves to the loopback address is
refused), and come from this page, if it says where it comes from. A body is counted while it arrives.
"""

from __future__ import annotations

from secrets import compare_digest

from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

SMALL = 1 << 20
"""Most bytes of a request that is no file: drawn inputs of 10 000 samples fit."""
LARGE = 2 << 30
"""Most bytes of a file: ten times a record of two million rows."""
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = (
    (b"content-security-policy", POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
)


class TooLarge(Exception):
    """Raised while a body with more bytes than are allowed arrives; the application answers with status 413."""


class Guard:
    """Passes requests with the token, from this page and for this host on to an application.

    Args:
        app: what answers them; it sees the path without the token.
        token: the first part of every path.
        port: of this server.
    """

    def __init__(self, app: ASGIApp, token: str, port: int) -> None:
        self.app, self.token = app, token.encode()
        self.hosts = {f"{name}:{port}" for name in ("127.0.0.1", "localhost", "[::1]")}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        if scope["type"] != "http":
            return
        problem = self._problem(scope)
        if problem:
            await self._refuse(*problem, scope, receive, send)
            return
        most, count = self._most(scope), 0

        async def counted() -> Message:
            nonlocal count
            message = await receive()
            count += len(message.get("body", b""))
            if count > most:
                raise TooLarge
            return message

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                given = {name.lower() for name, _ in message["headers"]}
                message["headers"] = [*message["headers"], *(header for header in HEADERS if header[0] not in given)]
            await send(message)

        path = "/" + scope["path"].split("/", 2)[2]
        await self.app({**scope, "path": path, "raw_path": path.encode()}, counted, with_headers)

    @staticmethod
    def _most(scope: Scope) -> int:
        """Most bytes of the body of a request."""
        return LARGE if scope["path"].endswith("/api/files") else SMALL

    def _problem(self, scope: Scope) -> tuple[int, str] | None:
        """The status and the reason with which a request is refused."""
        headers = dict(scope["headers"])
        host = headers.get(b"host", b"").decode("latin-1")
        if host not in self.hosts:
            return 403, "this server answers requests to its own address only"
        if headers.get(b"origin", f"http://{host}".encode()) != f"http://{host}".encode():
            return 403, "this server answers its own page only"
        parts = scope["path"].split("/", 2)
        if len(parts) < 3 or not compare_digest(parts[1].encode(), self.token):
            return 403, "the address needs the token that `emsid studio` has printed"
        most = self._most(scope)
        length = headers.get(b"content-length", b"0")
        if not length.isdigit() or len(length) > 20 or int(length) > most:
            return 413, f"the request has more than {most:,} bytes"
        return None

    @staticmethod
    async def _refuse(status: int, why: str, scope: Scope, receive: Receive, send: Send) -> None:
        headers = {name.decode(): value.decode() for name, value in HEADERS} | {"connection": "close"}
        await PlainTextResponse(why, status, headers)(scope, receive, send)
