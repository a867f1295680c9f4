"""States of the wizard, and requests to its page's server as browsers, programs and other people's pages send them."""

from __future__ import annotations

import copy
import http.client
import socket
from typing import Any
from urllib.parse import urlsplit

import cv2
import numpy as np

from vbaa_calib.wizard.server import PageServer

STATE: dict[str, Any] = {
    "session": "rig <b>",
    "steps": [
        {"name": "board", "title": "Print the board", "status": "done", "note": "29.96 mm"},
        {"name": "lens", "title": "Lens", "status": "now", "note": ""},
        {"name": "loads", "title": "Loads", "status": "todo", "note": ""},
    ],
    "step": {
        "name": "lens",
        "title": "Photograph the board",
        "what": "Hold the board at the outline.",
        "why": "Each pose teaches the lens.",
        "seen": ["11 pictures"],
        "missing": ["the lower right"],
        "next": "the board in the lower right",
        "enough": False,
        "numbers": [{"label": "position on plane C", "value": "0.14 mm", "goal": "0.10 mm", "met": False}],
    },
    "question": None,
    "live": None,
    "log": ["first", "second"],
    "finished": False,
    "report": None,
}
LIVE: dict[str, Any] = {
    "image_size": [320, 240],
    "corners_px": [[40.0, 50.0], [80.5, 52.25], [120.0, 54.0]],
    "coverage": {"columns": 4, "rows": 3, "counts": [[0, 1, 2, 0], [0, 3, 1, 0], [0, 0, 0, 0]]},
    "suggested_px": [[100.0, 60.0], [260.0, 70.0], [250.0, 180.0], [110.0, 170.0]],
    "suggestion": "further right, nearer",
    "closeness": 0.5,
    "hold": 0.25,
    "hints": [],
}


def state(**changed: Any) -> dict[str, Any]:
    """A state of its own, with some entries changed."""
    return {**copy.deepcopy(STATE), **changed}


def jpeg(level: int = 128) -> bytes:
    """A small grey picture."""
    return cv2.imencode(".jpg", np.full((240, 320), level, np.uint8))[1].tobytes()


def token(server: PageServer) -> str:
    return urlsplit(server.url).query.removeprefix("token=")


def cookie(server: PageServer) -> dict[str, str]:
    return {"Cookie": f"other=1; vbaa_wizard_{server.port}={token(server)}"}


class Reply:
    def __init__(self, answer: http.client.HTTPResponse) -> None:
        self.status, self.headers, self.body = answer.status, answer.headers, answer.read()


def ask(
    server: PageServer, path: str, headers: dict[str, str] | None = None, method: str = "GET", body: Any = None
) -> Reply:
    """One request, with exactly these headers beside Host and Content-Length; with the cookie if none are given."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=30)
    try:
        connection.request(method, path, body, cookie(server) if headers is None else headers)
        return Reply(connection.getresponse())
    finally:
        connection.close()


def command(server: PageServer, body: Any, **headers: str | None) -> Reply:
    """A command as the page sends it, with some headers changed, or left out where None."""
    usual = {"Origin": f"http://127.0.0.1:{server.port}", "Content-Type": "application/json", **cookie(server)}
    given = {name.replace("_", "-"): value for name, value in headers.items()}
    sent = {name: value for name, value in {**usual, **given}.items() if value is not None}
    return ask(server, "/command", sent, "POST", body)


def raw(server: PageServer, data: bytes) -> int:
    """The status that comes back for these bytes; 0 if the server only hangs up."""
    with socket.create_connection(("127.0.0.1", server.port), timeout=30) as connection:
        connection.sendall(data)
        got = b""
        try:
            while more := connection.recv(65536):
                got += more
        except ConnectionResetError:
            pass
    return int(got.split(b" ", 2)[1]) if got else 0
