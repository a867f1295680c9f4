"""The page's HTTP server: on 127.0.0.1 only, one short thread per request, patient with nobody."""

from __future__ import annotations

import hmac
import json
import logging
import secrets
import socket
import socketserver
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from email.message import Message
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from vbaa_calib.core.errors import InputError

from .hub import BODY_LIMIT, Hub, command_of


@dataclass(frozen=True)
class Gate:
    """The rules of one run.

    Attributes
    ----------
    port : the port that the server listens on.
    token : the run's secret.
    """

    port: int
    token: str = field(default_factory=lambda: secrets.token_urlsafe(32), repr=False)

    @property
    def cookie(self) -> str:
        """The cookie's name; it holds the port, since a browser keeps one set of cookies for all ports."""
        return f"vbaa_wizard_{self.port}"

    @property
    def hosts(self) -> tuple[str, str]:
        """The two ways to write the own address."""
        return f"127.0.0.1:{self.port}", f"localhost:{self.port}"

    def fits(self, told: str) -> bool:
        """Whether this is the token, in a time that does not tell how much of it was right."""
        return hmac.compare_digest(told.encode("utf-8", "replace"), self.token.encode())

    def refusal(self, method: str, headers: Message, *, entering: bool = False) -> tuple[int, str] | None:
        """Why a request is refused, as a status and words; None: it may pass.

        `entering` : the request brings the token in its address, and is judged by that alone.
        """
        hosts = headers.get_all("Host", [])
        if len(hosts) != 1 or hosts[0].strip().lower() not in self.hosts:
            return 421, "this server answers only to its own address"
        if entering:
            return None
        if headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin"):
            return 403, "another site may not use this page"
        bearer = self._bearer(headers)
        if not (bearer or self._known(headers)):
            return 403, "open the address that the wizard printed in the terminal: it carries this run's token"
        if method == "POST" and not self._own_origin(headers, required=not bearer):
            return 403, "another site may not send commands"
        return None

    def _own_origin(self, headers: Message, *, required: bool) -> bool:
        """Browsers tell the origin of every POST; a program with the token in its header need not."""
        origins = headers.get_all("Origin", [])
        if not origins:
            return not required
        return len(origins) == 1 and origins[0] in {f"http://{host}" for host in self.hosts}

    def _bearer(self, headers: Message) -> bool:
        word, _, told = headers.get("Authorization", "").partition(" ")
        return word == "Bearer" and self.fits(told)

    def _known(self, headers: Message) -> bool:
        pairs = (pair.strip().partition("=") for line in headers.get_all("Cookie", []) for pair in line.split(";"))
        return any(name == self.cookie and self.fits(value) for name, _, value in pairs)


WAIT_S = 20.0
"""How long a question for something new is held open."""

REPORT_LIMIT = 200 * 1024 * 1024

FILES = {
    "/": ("page.html", "text/html; charset=utf-8"),
    "/icon.svg": ("icon.svg", "image/svg+xml"),
    "/page.css": ("page.css", "text/css; charset=utf-8"),
    "/page.js": ("page.js", "text/javascript; charset=utf-8"),
    "/picture.js": ("picture.js", "text/javascript; charset=utf-8"),
    "/question.js": ("question.js", "text/javascript; charset=utf-8"),
}
"""Path → file beside this module, and its type. There is no way from an address to any other file."""

REPORT_POLICY = (
    # a report stands alone: it may run its own scripts, but as a stranger to this server
    "sandbox allow-scripts allow-popups; default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' data: blob:; "
    "style-src 'unsafe-inline'; img-src data: blob:; font-src data:; connect-src data: blob:; worker-src blob:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


@dataclass(frozen=True, eq=False)
class Response:
    """A status, a body and its type, and what headers it has beyond the common ones."""

    status: int
    body: bytes = b""
    kind: str = "text/plain; charset=utf-8"
    headers: Mapping[str, str] = field(default_factory=dict)


def plain(status: int, words: str, **headers: str) -> Response:
    """A refusal, in words."""
    return Response(status, f"{words}\n".encode(), headers=headers)


class Router:
    """Answers requests to one run's page."""

    def __init__(self, gate: Gate, hub: Hub) -> None:
        self.gate, self.hub = gate, hub
        here = Path(__file__)
        self._files = {path: (here.with_name(name).read_bytes(), kind) for path, (name, kind) in FILES.items()}

    def answer(self, method: str, target: str, headers: Message, read: Callable[[int], bytes]) -> Response:
        """The answer to a request; `read(size)` gives that many bytes of its body, and is called at most once."""
        try:
            if not target.startswith("/"):
                raise ValueError("the form for proxies, which would name a host of its own")
            parts = urlsplit(target)
            query = parse_qs(parts.query, keep_blank_values=True, max_num_fields=8)
        except ValueError:
            return plain(400, "this is no address")
        entering = method == "GET" and parts.path == "/" and "token" in query
        refused = self.gate.refusal(method, headers, entering=entering)
        if refused is not None:
            return plain(*refused)
        if entering:
            return self._entrance(query["token"])
        if method == "POST":
            return self._command(headers, read) if parts.path == "/command" else self._unknown(parts.path)
        if parts.path in self._files:
            return Response(200, *self._files[parts.path])
        if parts.path == "/state":
            return self._state(query.get("after", ["0"]))
        if parts.path == "/picture":
            return self._picture(query.get("n", ["0"]))
        if parts.path == "/report":
            return self._report()
        return self._unknown(parts.path)

    def _unknown(self, path: str) -> Response:
        known = {*FILES, "/state", "/picture", "/report", "/command"}
        if path in known:
            return plain(405, "not in this way", Allow="POST" if path == "/command" else "GET")
        return plain(404, "there is no such page")

    def _entrance(self, told: list[str]) -> Response:
        """From the address with the token to the one without, the token kept in a cookie."""
        if len(told) != 1 or not self.gate.fits(told[0]):
            return plain(403, "the token in this address is not this run's: open the address that the wizard printed")
        cookie = f"{self.gate.cookie}={self.gate.token}; Path=/; HttpOnly; SameSite=Strict"
        return Response(303, headers={"Location": "/", "Set-Cookie": cookie})

    def _state(self, told: list[str]) -> Response:
        after = _counter(told)
        if after is None:
            return plain(400, "after is the number of a snapshot")
        shown = self.hub.wait(after, WAIT_S)
        return Response(204) if shown is None else Response(200, shown.body, "application/json")

    def _picture(self, told: list[str]) -> Response:
        number = _counter(told)
        if number is None:
            return plain(400, "n is the number of a picture")
        jpeg = self.hub.picture(number)
        return plain(404, "there is no picture") if jpeg is None else Response(200, jpeg, "image/jpeg")

    def _report(self) -> Response:
        shown = self.hub.newest()
        path = None if shown is None else shown.report
        try:
            if path is None or path.suffix.lower() not in (".html", ".htm") or path.stat().st_size > REPORT_LIMIT:
                return plain(404, "there is no report yet")
            body = path.read_bytes()
        except (OSError, ValueError):
            return plain(404, "the report cannot be read")
        return Response(200, body, "text/html; charset=utf-8", {"Content-Security-Policy": REPORT_POLICY})

    def _command(self, headers: Message, read: Callable[[int], bytes]) -> Response:
        if headers.get_content_type() != "application/json" or "Content-Type" not in headers:
            return plain(415, "a command is JSON")
        length = _counter(headers.get_all("Content-Length", []))
        if length is None or "Transfer-Encoding" in headers:
            return plain(411, "a command says how long it is")
        if length > BODY_LIMIT:
            return plain(413, f"a command has at most {BODY_LIMIT} bytes")
        try:
            command = command_of(read(length))
        except InputError as error:
            return plain(400, str(error))
        if not self.hub.give(command):
            return plain(503, "the wizard has not yet taken the commands before", **{"Retry-After": "1"})
        return Response(202, json.dumps({"accepted": command.kind}).encode(), "application/json")


def _counter(told: list[str]) -> int | None:
    """A whole number that was told once, in at most 15 digits; None: it is none."""
    if len(told) != 1 or not (told[0].isascii() and told[0].isdigit() and len(told[0]) <= 15):
        return None
    return int(told[0])


REQUEST_S = 10.0
"""A request must have arrived within this time, however its bytes trickle; so must each answer have left."""

CONNECTIONS = 64
"""Connections at once; what comes beyond is closed at once."""

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}

_log = logging.getLogger(__name__)


class Handler(BaseHTTPRequestHandler):
    """Reads one request, gives it to the router, sends what it says, closes."""

    protocol_version = "HTTP/1.1"
    server_version, sys_version = "vbaa", ""
    timeout = REQUEST_S
    server: Server

    def do_GET(self) -> None:
        """Pages, state, picture, report."""
        self._answer()

    def do_POST(self) -> None:
        """Commands."""
        self._answer()

    def _answer(self) -> None:
        try:
            response = self.server.router.answer(self.command, self.path, self.headers, self._read)
        except OSError:
            raise
        except Exception:
            _log.debug("the preview's server failed", exc_info=True)
            response = plain(500, "the page's server failed; the wizard goes on in the terminal")
        self._send(response)

    def parse_request(self) -> bool:
        """As the base class; a request without a body has arrived with its headers."""
        arrived = super().parse_request()
        if arrived and self.command != "POST":
            self.server.arrived(self.connection)
        return arrived

    def _read(self, size: int) -> bytes:
        body = self.rfile.read(size)
        self.server.arrived(self.connection)
        if len(body) < size:
            raise ConnectionAbortedError("the body ended early")
        return body

    def _send(self, response: Response) -> None:
        self.send_response(response.status)
        for name, value in {**HEADERS, **response.headers}.items():
            self.send_header(name, value)
        if response.status != HTTPStatus.NO_CONTENT:
            self.send_header("Content-Type", response.kind)
            self.send_header("Content-Length", str(len(response.body)))
        self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(response.body)

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """What the base class refuses, without what the other side sent."""
        self.request_version = self.protocol_version  # which may be what was wrong: the answer has a head all the same
        if code == HTTPStatus.NOT_IMPLEMENTED:
            self._send(plain(405, "not in this way", Allow="GET, POST"))
        else:
            self._send(plain(code, HTTPStatus(code).phrase.lower()))

    def version_string(self) -> str:
        """No more than that."""
        return self.server_version

    def log_message(self, format: str, *args: Any) -> None:
        """The terminal is the wizard's."""


class Server(ThreadingHTTPServer):
    """Bound to 127.0.0.1; closes who is slow, refuses who is too many, says nothing to the terminal."""

    daemon_threads = True
    request_queue_size = 64
    router: Router

    def __init__(self, port: int) -> None:
        self._lock = threading.Lock()
        self._arriving: dict[socket.socket, float] = {}
        self._open = 0
        super().__init__(("127.0.0.1", port), Handler)

    def server_bind(self) -> None:
        """As the base class, without asking a name server for the own name."""
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = "127.0.0.1", self.server_address[1]

    def process_request(self, request: Any, client_address: Any) -> None:
        """In a thread of its own, if there are not too many."""
        with self._lock:
            room = self._open < CONNECTIONS
            if room:
                self._open += 1
                self._arriving[request] = time.monotonic() + REQUEST_S
        if not room:
            self.shutdown_request(request)
            return
        try:
            super().process_request(request, client_address)
        except RuntimeError:  # no more threads
            self._left(request)
            raise

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """As the base class, and counted."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._left(request)

    def _left(self, request: socket.socket) -> None:
        with self._lock:
            self._open -= 1
            self._arriving.pop(request, None)

    def arrived(self, request: socket.socket) -> None:
        """The whole request is here: the time it took no longer counts."""
        with self._lock:
            self._arriving.pop(request, None)

    def service_actions(self) -> None:
        """Between requests: hang up on those that have not arrived in time."""
        now = time.monotonic()
        with self._lock:
            late = [request for request, deadline in self._arriving.items() if deadline < now]
            for request in late:
                del self._arriving[request]
        for request in late:
            try:
                request.shutdown(socket.SHUT_RDWR)
            except OSError:
                _log.debug("already closed")

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Browsers come and go; that is no news."""
        _log.debug("a connection to the preview failed", exc_info=True)
