"""The page's HTTP server: on 127.0.0.1 only, one short thread per request, patient with nobody."""

from __future__ import annotations

import logging
import socket
import socketserver
import threading
import time
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from .routes import Response, Router, plain

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
