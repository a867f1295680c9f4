"""Raw requests to the page's server, as its page, other programs and other people's pages would send them."""

from __future__ import annotations

import http.client
import socket
from typing import Any
from urllib.parse import urlsplit

from vbaa_calib.wizard.preview import Preview


def token(preview: Preview) -> str:
    return urlsplit(preview.url).query.removeprefix("token=")


def cookie(preview: Preview) -> dict[str, str]:
    return {"Cookie": f"other=1; vbaa_wizard_{preview.port}={token(preview)}"}


class Reply:
    def __init__(self, answer: http.client.HTTPResponse) -> None:
        self.status, self.headers, self.body = answer.status, answer.headers, answer.read()


def ask(
    preview: Preview, path: str, headers: dict[str, str] | None = None, method: str = "GET", body: Any = None
) -> Reply:
    """One request, with exactly these headers beside Host and Content-Length; with the cookie if none are given."""
    connection = http.client.HTTPConnection("127.0.0.1", preview.port, timeout=10)
    try:
        connection.request(method, path, body, cookie(preview) if headers is None else headers)
        return Reply(connection.getresponse())
    finally:
        connection.close()


def command(preview: Preview, body: Any, **headers: str | None) -> Reply:
    """A command as the page sends it, with some headers changed, or left out where None."""
    usual = {"Origin": f"http://127.0.0.1:{preview.port}", "Content-Type": "application/json", **cookie(preview)}
    given = {name.replace("_", "-"): value for name, value in headers.items()}
    sent = {name: value for name, value in {**usual, **given}.items() if value is not None}
    return ask(preview, "/command", sent, "POST", body)


def raw(preview: Preview, data: bytes) -> bytes:
    """What comes back for these bytes, until the server hangs up."""
    with socket.create_connection(("127.0.0.1", preview.port), timeout=10) as connection:
        connection.sendall(data)
        got = b""
        while more := connection.recv(65536):
            got += more
        return got


def status(reply: bytes) -> int:
    return int(reply.split(b" ", 2)[1])
