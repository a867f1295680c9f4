"""What the page's server answers to which request."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from email.message import Message
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

from vbaa_calib.errors import InputError

from .gate import Gate
from .hub import Hub
from .messages import BODY_LIMIT, command_of

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
