"""The server of the studio: routes, messages to the pages, and the loopback socket.

What every request must satisfy before it is answered, and the headers of every answer.

Other programs and pages on the same machine can reach a loopback port. A request must therefore name the secret token
as the first part of its path, address this host and port (a foreign name that resolves to the loopback address is
refused), and come from this page, if it says where it comes from. A body is counted while it arrives.

HTTP connections that are closed where the head of a request does not arrive.
"""

from __future__ import annotations

import asyncio
import os
import socket
import webbrowser
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from secrets import compare_digest, token_urlsafe
from threading import Thread
from typing import Any
from urllib.parse import quote

import h11
import msgspec
import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from emsid.errors import DataError, EmsidError
from emsid.estimation.borders import LOG, InternalError
from emsid.findings import plain
from emsid.io import load
from emsid.io.files import NotWritten
from emsid.studio import uplot
from emsid.studio.data import packed
from emsid.studio.live import Live
from emsid.studio.runs import Runs
from emsid.studio.session import Conflict, Session, delete, held, in_session
from emsid.studio.studio import READ, Studio, as_comparison, catalogue, typed
from emsid.studio.use import archive, exported, made, played
from emsid.studio.views import drawn
from emsid.studio.words import said

PAGE = Path(__file__).parent / "page"
MOST_AT_ONCE = 150
"""Connections; more are refused with status 503."""
BACKLOG = 2 * MOST_AT_ONCE
"""Connections that wait to be accepted, so that the surplus gets an answer too."""
REPORT_POLICY = (
    b"sandbox allow-scripts allow-popups; default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
)
"""The report is a page of its own, whose script and style are in it. It has no origin, so it reaches nothing here."""


NOT_UNDERSTOOD = (msgspec.MsgspecError, RecursionError, LookupError, ValueError, TypeError, AttributeError)
"""What is raised for a request with other content than is expected."""


TOKEN = ".token"
"""The file with port and token of a session, for this user only, so that an open page finds a server that is back."""


@dataclass
class Messages:
    """Messages to every open page, as server-sent events."""

    queues: set[asyncio.Queue[bytes | None]] = field(default_factory=set)
    loop: asyncio.AbstractEventLoop | None = None

    def announce(self, message: Mapping[str, Any]) -> None:
        """Send a message; from any thread."""
        line = b"data: " + msgspec.json.encode(plain(message)) + b"\n\n"
        if self.loop is not None:
            with suppress(RuntimeError):  # the loop has ended
                self.loop.call_soon_threadsafe(self._put, line)

    def _put(self, line: bytes) -> None:
        for queue in self.queues:
            if queue.qsize() < 1000:  # a page that does not read misses progress, not results
                queue.put_nowait(line)

    def end(self) -> None:
        """End all streams; the server waits for them."""
        for queue in self.queues:
            queue.put_nowait(None)

    async def stream(self, request: Request) -> Response:
        """The messages from now on."""
        queue: asyncio.Queue[bytes | None] = asyncio.Queue()

        async def lines() -> AsyncIterator[bytes]:
            self.queues.add(queue)
            try:
                yield b"retry: 500\n\n"
                line: bytes | None = b""
                while line is not None:
                    yield line
                    try:
                        line = await asyncio.wait_for(queue.get(), 15)
                    except TimeoutError:
                        line = b": still here\n\n"
            finally:
                self.queues.discard(queue)

        return StreamingResponse(lines(), media_type="text/event-stream")


def made_on(request: Request) -> str | None:
    """The version of the state that a request was made on; None where it does not say."""
    return request.headers.get("if-match")


def refusal(problem: Exception, folder: Path | None = None) -> Response:
    """The answer in one line where a request could not be done."""
    LOG.debug("%s", problem, exc_info=problem)
    if isinstance(problem, NotWritten):
        return PlainTextResponse(str(problem), 507)
    if isinstance(problem, EmsidError):
        return PlainTextResponse(said(problem, folder), 409 if isinstance(problem, Conflict) else 400)
    if isinstance(problem, OSError):
        return PlainTextResponse(f"a file cannot be written ({(problem.strerror or str(problem)).lower()})", 507)
    if isinstance(problem, NOT_UNDERSTOOD):
        return PlainTextResponse(f"the request is not understood ({type(problem).__name__})", 400)
    return PlainTextResponse(str(InternalError("studio", problem)), 500)


def answer(work: Callable[[Request, Any], Any], folder: Path) -> Callable[[Request], Awaitable[Response]]:
    """A route that reads JSON, does some work in a thread, and answers with JSON, bytes or a response."""

    async def route(request: Request) -> Response:
        body = await request.body() if request.method == "POST" else b""
        try:
            content = msgspec.json.decode(body) if body else {}
            if not isinstance(content, dict):
                raise DataError("the request is no table")
            found = await run_in_threadpool(work, request, content)
            if isinstance(found, Response):
                return found
            if isinstance(found, bytes):
                return Response(found, media_type="application/octet-stream")
            return Response(msgspec.json.encode(plain(found)), media_type="application/json")
        except Exception as problem:
            return refusal(problem, folder)

    return route


class Routes:
    """The routes of a studio.

    Args:
        studio: what they show and change.
        messages: to the pages.
    """

    def __init__(self, studio: Studio, messages: Messages) -> None:
        self.studio, self.messages = studio, messages

    def all(self) -> list[Route]:
        """Every route."""
        studio, folder = self.studio, self.studio.session.folder
        posts: dict[str, Callable[[Request, Any], Any]] = {
            "edit": lambda request, content: studio.edit(content, made_on(request)),
            "undo": lambda request, content: studio.move(-1, made_on(request)),
            "redo": lambda request, content: studio.move(1, made_on(request)),
            "brush": lambda request, content: studio.brush(content, made_on(request)),
            "example": lambda request, content: studio.example(str(content["name"]), made_on(request)),
            "run": lambda request, content: studio.run(made_on(request)),
            "cancel": lambda request, content: studio.runs.cancel(str(content["run"])),
            "window": lambda request, content: self._window(content),
            "pairs": lambda request, content: studio.data.pairs(studio.session.step, content),
            "ranking": lambda request, content: studio.views.ranking(studio.session.step, content),
            "runs": lambda request, content: studio.views.window(studio.session.step, content),
            "view": lambda request, content: studio.views.view(studio.session.step, content),
            "play": lambda request, content: self._play(content),
            "program": lambda request, content: self._program(content),
            "export": lambda request, content: sent(
                exported(self._model(content), str(content["format"]), list(map(str, content.get("assume", ())))),
                f"{self._model(content).stem}-{content['format']}",
            ),
            "use": lambda request, content: self._use(content),
            "live": lambda request, content: studio.live.begin(content),
            "live/stop": lambda request, content: studio.live.stop(),
            "live/take": lambda request, content: studio.take(),
        }
        gets: dict[str, Callable[[Request, Any], Any]] = {
            "state": lambda request, content: studio.state(),
            "catalogue": lambda request, content: catalogue(),
            "data": lambda request, content: studio.data.described(studio.session.step, request.query_params["file"]),
            "about": lambda request, content: studio.views.about(request.query_params["model"]),
            "model": lambda request, content: sent(
                self._model(request.query_params).read_bytes(), self._model(request.query_params).stem, "json"
            ),
            "use/{number}": lambda request, content: sent(
                archive(self._made(request.path_params["number"])), f"made-{request.path_params['number']}"
            ),
            "runs/{run}/shown": self._shown,
            "runs/{run}/file/{name:path}": self._run_file,
        }
        return [
            Route("/", lambda request: FileResponse(PAGE / "index.html")),
            Route("/page/{name:path}", self._asset),
            Route("/api/events", self.messages.stream),
            Route("/api/files", self._upload, methods=["POST"]),
            Route("/api/models", self._upload, methods=["POST"]),
            *(Route(f"/api/{path}", answer(work, folder), methods=["POST"]) for path, work in posts.items()),
            *(Route(f"/api/{path}", answer(work, folder)) for path, work in gets.items()),
        ]

    @staticmethod
    async def _asset(request: Request) -> Response:
        path = in_session(PAGE, request.path_params["name"])
        return PlainTextResponse("there is no such file", 404) if path is None else FileResponse(path)

    async def _upload(self, request: Request) -> Response:
        """Write a dropped file of data or of a model into the session, block by block."""
        session, count = self.studio.session, 0
        place = "models" if request.url.path.endswith("/models") else "data"
        try:
            with session.adding(request.query_params.get("name", "file.csv"), place) as (name, incoming):
                with incoming.open("wb") as file:
                    async for block in request.stream():
                        count += len(block)
                        if count > LARGE:
                            raise TooLarge
                        file.write(block)
                if place == "models":
                    await run_in_threadpool(load, incoming)
                session.arrived(name, place)
                if place == "models":
                    self.messages.announce({"kind": "state"})
                else:
                    await run_in_threadpool(self.studio.add, name, request.query_params.get("kind", "files"))
        except (TooLarge, ClientDisconnect):
            return PlainTextResponse("the file is too large, or has not arrived", 413)
        except Exception as problem:
            return refusal(problem, session.folder)
        return Response(b"{}", media_type="application/json")

    def _folder(self, number: str) -> Path:
        found = self.studio.runs.folder(number)
        if found is None:
            raise DataError("there is no such run")
        return found

    def _model(self, content: Mapping[str, Any]) -> Path:
        return self.studio.views.path(str(content["model"]))

    def _made(self, number: str) -> Path:
        path = self.studio.session.folder / "use" / number
        if not number.isdigit() or not path.is_dir():
            raise DataError("there are no such files")
        return path

    def _window(self, content: Mapping[str, Any]) -> bytes:
        """A window of signals; an empty one with what is typed and cannot be used, or not yet."""
        try:
            given = typed(READ, content.get("given", {}))
            signals = self.studio.data.signals(self.studio.session.step, {**content, "given": given})
        except EmsidError:
            if "given" in content:
                return bytes(4)
            raise
        return packed(signals, float(content["from"]), float(content["to"]), int(content["width"]))

    def _shown(self, request: Request, content: Any) -> Response:
        path = in_session(self._folder(request.path_params["run"]), "shown.json")
        if path is None:
            raise DataError("this run has no result")
        return Response(path.read_bytes(), media_type="application/json")

    def _run_file(self, request: Request, content: Any) -> Response:
        path = in_session(self._folder(request.path_params["run"]), request.path_params["name"])
        if path is None:
            raise DataError("there is no such file")
        headers = {}
        if path.suffix == ".html":
            headers["content-security-policy"] = REPORT_POLICY.decode()
        elif path.suffix != ".svg":
            headers["content-disposition"] = "attachment"
        return FileResponse(path, headers=headers)

    def _play(self, content: Mapping[str, Any]) -> bytes:
        record = self.studio.views.record(self.studio.session.step, content["data"])
        signals = played(self._model(content), content.get("values", {}), content.get("input", {}), record)
        time = signals[0].time
        return np_ends(time) + packed(signals, float(time[0]), float(time[-1]), int(content.get("width", 1000)))

    def _program(self, content: Mapping[str, Any]) -> dict[str, str]:
        studio, file = self.studio, str(content["data"]["file"])
        models = [studio.views.path(str(name)) for name in content["models"]]
        reading = studio.data.reading(studio.session.step, file)
        return {"script": as_comparison(models, studio.session.path(file), reading)}

    def _use(self, content: Mapping[str, Any]) -> dict[str, Any]:
        """Make something of a model; what is said of it, and the number of its files."""
        folder = self.studio.session.new_folder("use")
        try:
            found = made(self._model(content), str(content["what"]), content.get("options", {}), folder)
        except BaseException:
            delete(folder)
            raise
        sections = [found.opening, *found.sections]
        tables = [
            {"caption": t.caption, "header": t.header, "rows": t.rows, "texts": t.text_columns, "note": t.note}
            for each in sections
            for t in each.tables
        ]
        files = [path.relative_to(folder).as_posix() for path in sorted(folder.rglob("*")) if path.is_file()]
        return {
            "number": folder.name,
            "files": files,
            "lines": [*found.summary, *(notice.text for notice in found.notices)],
            "tables": tables,
            "plots": drawn([figure for each in sections for figure in each.figures]),
        }


def sent(content: bytes, name: str, kind: str = "zip") -> Response:
    """A file to keep."""
    headers = {"content-disposition": f'attachment; filename="{quote(name)}.{kind}"'}
    return Response(content, media_type=f"application/{kind}", headers=headers)


def np_ends(time: Any) -> bytes:
    """The first and the last time as float64."""
    import numpy as np

    return np.array([time[0], time[-1]], "<f8").tobytes()


def application(studio: Studio, messages: Messages, token: str, port: int) -> Guard:
    """The application of a studio behind its guard."""

    async def remember() -> None:
        messages.loop = asyncio.get_running_loop()

    async def life(scope: Any, receive: Any, send: Any) -> None:
        if messages.loop is None or messages.loop.is_closed() or scope["type"] == "lifespan":
            await remember()
        await inner(scope, receive, send)

    async def too_large(request: Request, problem: Exception) -> Response:
        return PlainTextResponse("the request is too large", 413)

    inner = Starlette(routes=Routes(studio, messages).all(), exception_handlers={TooLarge: too_large})
    return Guard(life, token, port)


class Serving(uvicorn.Server):
    """A server that ends the streams of messages when it is told to end."""

    def __init__(self, config: uvicorn.Config, messages: Messages) -> None:
        super().__init__(config)
        self._messages = messages

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End."""
        self._messages.end()
        await super().shutdown(sockets)


def serve(
    folder: Path,
    files: list[Path],
    *,
    port: int = 0,
    browser: bool = True,
    command: Callable[[Mapping[str, Any], Path], str],
    track: Callable[[Mapping[str, Any], Path], list[str]],
    say: Callable[[str], None],
) -> None:
    """Serve a session until the process is told to end.

    Args:
        folder: of the session.
        files: to add to it.
        port: of the loopback interface; 0 for a free one.
        browser: whether to open the page.
        command: a task as a command line.
        track: the program that follows a live source.
        say: called with the address.

    Raises:
        FormatError: where the folder is no session, or uPlot is missing.
        DataError: where the port is in use.
    """
    with held(folder), socket.socket(socket.AF_INET, socket.SOCK_STREAM) as listening:
        messages = Messages()
        session = Session.at_folder(folder)
        studio = Studio(session, Runs(session, messages.announce), Live(session, messages.announce, track), command)
        studio.announce = messages.announce
        for path in files:
            studio.add(session.add(path))
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        before, token = last_door(session.folder)
        for wanted in (port,) if port else (before, 0):
            try:
                listening.bind(("127.0.0.1", wanted))
                break
            except OSError:
                if wanted == port:
                    raise DataError(f"port {port} is in use; choose another", arguments=("port",)) from None
        listening.listen(BACKLOG)  # before the address is said: who asks at once waits
        port = listening.getsockname()[1]
        private(session.folder / TOKEN, f"{port} {token}")
        config = uvicorn.Config(
            application(studio, messages, token, port),
            http=ImpatientProtocol,
            log_level="error",
            access_log=False,
            limit_concurrency=MOST_AT_ONCE,
            backlog=BACKLOG,
            timeout_graceful_shutdown=1,
            server_header=False,
            ws="none",
        )
        address = f"http://127.0.0.1:{port}/{token}/"
        say(address)
        Thread(target=studio.warm, daemon=True).start()
        door = session.folder / "open.html"
        if browser:
            write_door(door, address)
            Thread(target=webbrowser.open, args=(door.as_uri(),), daemon=True).start()
        try:
            Serving(config, messages).run(sockets=[listening])
        finally:
            door.unlink(missing_ok=True)
            studio.data.close()
            studio.runs.close()
            studio.live.stop()


def write_door(path: Path, address: str) -> None:
    """Write a page that leads to an address, for this user only.

    The command lines of all processes are visible to every user, so a browser is started with this page, not with the
    address, which has the token.
    """
    private(path, f'<!doctype html><title>emsid</title><meta http-equiv="refresh" content="0; url={address}">\n')


def private(path: Path, text: str) -> None:
    """Write a file that other users cannot read."""
    path.unlink(missing_ok=True)
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
        file.write(text)


def last_door(folder: Path) -> tuple[int, str]:
    """The port and the token that a session was served with last; any port and a new token where there are none."""
    with suppress(OSError, ValueError):
        port, token = (folder / TOKEN).read_text("utf-8").split()
        if 1024 <= int(port) < 65536 and len(token) >= 32:
            return int(port), token
    return 0, token_urlsafe(24)


__all__ = ["Messages", "application", "serve", "uplot"]


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
            return 403, "the address needs the token of this studio, as its window or its file open.html has it"
        most = self._most(scope)
        length = headers.get(b"content-length", b"0")
        if not length.isdigit() or len(length) > 20 or int(length) > most:
            return 413, f"the request has more than {most:,} bytes"
        return None

    @staticmethod
    async def _refuse(status: int, why: str, scope: Scope, receive: Receive, send: Send) -> None:
        headers = {name.decode(): value.decode() for name, value in HEADERS} | {"connection": "close"}
        await PlainTextResponse(why, status, headers)(scope, receive, send)


HEAD = 5.0
"""Seconds for the head of a request, which a browser sends at once; the time that an idle connection is kept, too."""


class ImpatientProtocol(H11Protocol):
    """Closes a connection whose request has not named its address, and so the token, after some seconds.

    Without this, anybody on this machine could hold all connections that the server accepts.
    """

    _closing: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait."""
        super().connection_made(transport)
        self._wait()

    def data_received(self, data: bytes) -> None:
        """Wait for the rest of a head, counted from its first byte."""
        super().data_received(data)
        self._wait()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop waiting."""
        super().connection_lost(exc)
        if self._closing is not None:
            self._closing.cancel()

    def _wait(self) -> None:
        if self.conn.their_state is not h11.IDLE:
            if self._closing is not None:
                self._closing.cancel()
            self._closing = None
        elif self._closing is None:
            self._closing = self.loop.call_later(HEAD, self._close)

    def _close(self) -> None:
        with suppress(RuntimeError):  # the loop has ended
            self.transport.close()
