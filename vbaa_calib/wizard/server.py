"""The HTTP server of the wizard's page: on 127.0.0.1, only for clients that have this run's token."""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import json
import logging
import queue
import secrets
import socket
import threading
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import uvicorn
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import to_jsonable_python
from starlette.applications import Starlette
from starlette.datastructures import MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route
from starlette.types import Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from vbaa_calib.core.errors import InputError


@dataclass(frozen=True)
class _ServerSettings:
    """Limits of the page's server: sizes in bytes, times in s."""

    body_bytes: int = 16 * 1024  # of a request
    report_bytes: int = 200 * 1024 * 1024  # of a report
    text_letters: int = 2000  # of an answer
    news_s: float = 20.0  # after which a request for the next state is answered without news
    connection_s: float = 30.0  # after which a connection is cut, whatever it does
    connections: int = 64  # at a time
    silent: int = 32  # connections without a request: beyond, the oldest is cut, so that slow clients block nobody
    pictures: int = 8  # kept: a slow browser still gets the picture that belongs to the corners it draws
    commands: int = 100  # kept


SERVER = _ServerSettings()


FILES = {
    "/": "page.html",
    **{f"/{name}": name for name in ("icon.svg", "page.css", "page.js", "dom.js", "picture.js", "question.js")},
    **{f"/step_{step}.svg": f"step_{step}.svg" for step in ("board", "lens", "plane", "noload", "loads", "sensor")},
}
_TYPES = {".html": "text/html", ".svg": "image/svg+xml", ".css": "text/css", ".js": "text/javascript"}
_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
    "Connection": "close",
}
_log = logging.getLogger(__name__)


def _printable(text: str) -> str:
    """Raises for text with control characters, because it is printed to a terminal."""
    if not text.isprintable():
        raise ValueError("not printable")
    return text


_Key = Annotated[str, Field(min_length=1, max_length=100), AfterValidator(_printable)]
_Text = Annotated[str, Field(max_length=SERVER.text_letters), AfterValidator(_printable)]
_Number = Annotated[float, Field(ge=-1e15, le=1e15)]


class _PageCommand(BaseModel):
    """A click, or an answer as {key: value}; `seen` is the number of the state that the page showed."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)
    kind: Literal["answer", "take", "enough", "back", "redo", "drop", "quit"]
    value: dict[_Key, bool | _Number | _Text | None] | None = None
    seen: Annotated[int, Field(ge=0, lt=10**15)] | None = None

    @model_validator(mode="after")
    def _has_the_right_value(self) -> _PageCommand:
        if (None if self.value is None else len(self.value)) != (1 if self.kind == "answer" else None):
            raise ValueError("an answer is one key with its value, another command has none")
        return self


class _Connection(H11Protocol):
    silent = True
    """No complete request so far."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._end = self.loop.call_later(SERVER.connection_s, transport.abort)
        silent = [one for one in self.connections if isinstance(one, _Connection) and one.silent]
        if len(silent) > SERVER.silent:
            oldest = min(silent, key=lambda one: one._end.when())
            oldest.silent = False
            oldest.transport.abort()

    def handle_events(self) -> None:
        super().handle_events()
        self.silent = self.silent and self.cycle is None

    def connection_lost(self, exc: Exception | None) -> None:
        self._end.cancel()
        super().connection_lost(exc)


class PageServer:
    """Serves the page at 127.0.0.1 in a thread; port 0 takes any free one. No method waits for a browser.

    Raises InputError if the port is not available.
    """

    def __init__(self, port: int = 0) -> None:
        try:
            self._socket = socket.create_server(("127.0.0.1", port))
        except (OSError, OverflowError) as error:
            what = f"the page cannot listen on port {port}: {getattr(error, 'strerror', None) or error}"
            raise InputError(what, remedy="give another port, or 0 for any") from error
        self.port: int = self._socket.getsockname()[1]
        self._token = secrets.token_urlsafe(32)
        # a browser keeps one set of cookies for all ports
        self._cookie = f"vbaa_wizard_{self.port}"
        self._hosts = (f"127.0.0.1:{self.port}", f"localhost:{self.port}")
        self._lock = threading.Lock()
        self._number, self._body, self._report = 0, b"", ""
        self._pictures: deque[tuple[int, bytes]] = deque(maxlen=SERVER.pictures)
        self._commands: queue.Queue[_PageCommand] = queue.Queue(SERVER.commands)
        self._changed = asyncio.Event()
        self._app = Starlette(
            routes=[
                *(Route(path, self._file) for path in FILES),
                Route("/state", self._state),
                Route("/picture", self._picture),
                Route("/report", self._report_page),
                Route("/command", self._command, methods=["POST"]),
            ]
        )
        self._app.router.redirect_slashes = False
        config = uvicorn.Config(
            self._guarded,
            interface="asgi3",
            http=_Connection,
            ws="none",
            lifespan="off",
            log_config=None,
            log_level="critical",
            server_header=False,
            limit_concurrency=SERVER.connections,
            timeout_graceful_shutdown=1,
        )
        self._server = uvicorn.Server(config)
        self._loop = asyncio.new_event_loop()
        # errors of connections do not belong in the terminal
        self._loop.set_exception_handler(lambda _, context: _log.debug("the page's server: %s", context))
        self._thread = threading.Thread(target=self._serve, name="page", daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        self._loop.run_until_complete(self._server.serve(sockets=[self._socket]))
        self._loop.close()

    @property
    def url(self) -> str:
        """The address, with this run's token: whoever has it can see the page and send commands."""
        return f"http://127.0.0.1:{self.port}/?token={self._token}"

    def show(self, state: Mapping[str, Any], jpeg: bytes | None = None) -> int:
        """Publish a state of the page. Returns its number, to which commands refer. NaN becomes null."""
        with self._lock:
            self._number += 1
            if jpeg is not None and (not self._pictures or self._pictures[-1][1] is not jpeg):
                self._pictures.append((self._number, jpeg))
            picture = None if jpeg is None else self._pictures[-1][0]
            sent = {"n": self._number, "picture": picture, "state": state}
            plain = to_jsonable_python(sent, inf_nan_mode="null", fallback=lambda array: array.tolist())
            self._body = json.dumps(plain).encode()
            self._report = str(state.get("report") or "")
        self._wake()
        return self._number

    def take_commands(self) -> list[_PageCommand]:
        """The commands since the last call, in order."""
        return [self._commands.get_nowait() for _ in range(self._commands.qsize())]

    def close(self) -> None:
        """Stop the server, after at most a second for responses in progress. May be called twice."""
        self._server.should_exit = True
        self._wake()
        self._thread.join()
        self._socket.close()

    def _wake(self) -> None:
        def renew() -> None:
            self._changed.set()
            self._changed = asyncio.Event()

        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(renew)

    async def _guarded(self, scope: Scope, receive: Receive, send: Send) -> None:
        """The application behind the access checks; every response carries the security headers."""

        async def with_policy(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(raw=message["headers"])
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        await (self._refusal(Request(scope)) or self._app)(scope, receive, with_policy)

    def _refusal(self, request: Request) -> Response | None:
        """The response to a request that is refused, or that has the token in its address (a redirect); None for all
        others."""
        headers, tokens = request.headers, request.query_params.getlist("token")
        if len(headers.getlist("host")) != 1 or headers["host"].lower() not in self._hosts:
            return PlainTextResponse("this server answers only to its own address\n", 421)
        if tokens and request.scope["path"] == "/" and request.method == "GET":
            # move the token from the address into a cookie
            if len(tokens) == 1 and self._is_token(tokens[0]):
                cookie = f"{self._cookie}={self._token}; Path=/; HttpOnly; SameSite=Strict"
                return Response(status_code=303, headers={"Location": "/", "Set-Cookie": cookie})
            words = "the token in this address is not this run's: open the address that the wizard printed\n"
            return PlainTextResponse(words, 403)
        if headers.get("sec-fetch-site", "none") not in ("none", "same-origin"):
            return PlainTextResponse("another site may not use this page\n", 403)
        word, _, bearer = headers.get("authorization", "").partition(" ")
        by_header = word == "Bearer" and self._is_token(bearer)
        if not by_header and not self._is_token(request.cookies.get(self._cookie, "")):
            words = "open the address that the wizard printed in the terminal: it carries this run's token\n"
            return PlainTextResponse(words, 403)
        if request.method == "POST":
            # browsers send the origin with every POST; a program with the token in its header need not
            origins = headers.getlist("origin")
            if origins not in [[f"http://{host}"] for host in self._hosts] and not (by_header and not origins):
                return PlainTextResponse("another site may not send commands\n", 403)
        return None

    def _is_token(self, text: str) -> bool:
        return hmac.compare_digest(text.encode("utf-8", "replace"), self._token.encode())

    async def _file(self, request: Request) -> Response:
        path = Path(__file__).with_name("static") / FILES[request.scope["path"]]
        return Response(path.read_bytes(), media_type=_TYPES[path.suffix])

    async def _state(self, request: Request) -> Response:
        after = _number_in(request, "after")
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(SERVER.news_s):
                while self._number == after and not self._server.should_exit:
                    await self._changed.wait()
        with self._lock:
            if self._number == after:
                return Response(status_code=204)
            return Response(self._body, media_type="application/json")

    async def _picture(self, request: Request) -> Response:
        number = _number_in(request, "n")
        with self._lock:
            kept = dict(self._pictures)
        if not kept:
            raise HTTPException(404, "there is no picture")
        return Response(kept.get(number, kept[max(kept)]), media_type="image/jpeg")

    async def _report_page(self, request: Request) -> Response:
        path = Path(self._report)
        try:
            if path.suffix.lower() not in (".html", ".htm") or path.stat().st_size > SERVER.report_bytes:
                raise HTTPException(404, "there is no report yet")
            body = path.read_bytes()
        except (OSError, ValueError):
            raise HTTPException(404, "the report cannot be read") from None
        # its own scripts may run, but without access to this server
        policy = (
            "sandbox allow-scripts allow-popups; default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' "
            "data: blob:; style-src 'unsafe-inline'; img-src data: blob:; font-src data:; connect-src data: blob:; "
            "worker-src blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        )
        return Response(body, media_type="text/html", headers={"Content-Security-Policy": policy})

    async def _command(self, request: Request) -> Response:
        if request.headers.get("content-type", "").partition(";")[0].strip().lower() != "application/json":
            raise HTTPException(415, "a command is JSON")
        body, length = b"", int(request.headers.get("content-length", "0"))
        if length <= SERVER.body_bytes:
            async for part in request.stream():
                body += part
                if len(body) > SERVER.body_bytes:
                    break
        if max(length, len(body)) > SERVER.body_bytes:
            raise HTTPException(413, f"a command has at most {SERVER.body_bytes} bytes")
        try:
            command = _PageCommand.model_validate_json(body)
            self._commands.put_nowait(command)
        except ValidationError as error:
            raise HTTPException(400, f"that is no command: {error.errors()[0]['msg']}") from None
        except queue.Full:
            raise HTTPException(503, "the wizard has not yet taken the commands before") from None
        return JSONResponse({"accepted": command.kind}, 202)


def _number_in(request: Request, name: str) -> int:
    tokens = request.query_params.getlist(name) or ["0"]
    if len(tokens) != 1 or not (tokens[0].isascii() and tokens[0].isdigit() and len(tokens[0]) <= 15):
        raise HTTPException(400, f"{name} is a whole number")
    return int(tokens[0])
