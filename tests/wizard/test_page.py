"""The page of a wizard that runs: what it shows, who may ask its server, and that nobody disturbs it."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest

from vbaa_calib.sources.files import frame_picture
from vbaa_calib.wizard import server as module
from vbaa_calib.wizard.server import FILES, SERVER, PageServer
from vbaa_calib.wizard.store import Store

from .page_client import ask, command, cookie, jpeg, raw, state, token


def taken(store: Store) -> None:
    """A picture of the lens."""
    store.take("lens", frame_picture("frame 1", np.zeros((4, 4), np.uint8), 0.0), {})


@pytest.fixture(scope="module")
def server() -> Iterator[PageServer]:
    """One for all that is refused: it leaves no trace."""
    server = PageServer()
    yield server
    server.close()


@pytest.fixture
def fresh() -> Iterator[PageServer]:
    server = PageServer()
    yield server
    server.close()


PATHS = (*FILES, "/state", "/picture", "/report")


def test_the_address_gives_a_cookie_and_leads_to_an_address_without_the_token(server: PageServer) -> None:
    reply = ask(server, "/?" + urlsplit(server.url).query, {})
    assert (reply.status, reply.headers["Location"]) == (303, "/")
    name, _, rest = reply.headers["Set-Cookie"].partition("=")
    assert name == f"vbaa_wizard_{server.port}"
    assert rest.split("; ") == [token(server), "Path=/", "HttpOnly", "SameSite=Strict"]
    assert ask(server, "/", {"Cookie": f"{name}={token(server)}"}).status == 200


@pytest.mark.parametrize("path", PATHS)
def test_nothing_without_the_token(server: PageServer, path: str) -> None:
    server.show(state(), jpeg())
    wrong = token(server)[:-1] + "?"
    for headers in (
        {},
        {"Cookie": f"vbaa_wizard_{server.port}={wrong}"},
        {"Cookie": f"vbaa_wizard={token(server)}"},
        {"Cookie": f"vbaa_wizard_{server.port}="},
        {"Cookie": f"vbaa_wizard_{server.port}={token(server)}é".encode().decode("latin-1")},
        {"Authorization": f"Bearer {wrong}"},
        {"Authorization": f"Basic {token(server)}"},
    ):
        reply = ask(server, path, headers)
        assert reply.status == 403
        assert token(server).encode() not in reply.body
    assert ask(server, f"{path}?token={wrong}", {}).status == 403
    assert ask(server, f"{path}?token={token(server)}&token={wrong}", {}).status == 403
    if path != "/":
        assert ask(server, f"{path}?token={token(server)}", {}).status == 403, "in the first address only"


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:{port}", "127.0.0.1", "127.0.0.1:1", "[::1]:{port}", ""]
)
def test_only_the_own_address(server: PageServer, host: str) -> None:
    named = host.format(port=server.port)
    assert ask(server, "/", {"Host": named, **cookie(server)}).status == 421
    assert ask(server, "/?" + urlsplit(server.url).query, {"Host": named}).status == 421
    assert command(server, b'{"kind": "quit"}', Host=named).status == 421
    assert server.take_commands() == []


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "https://127.0.0.1:{port}", "http://127.0.0.1:1", "http://127.0.0.1", ""]
)
def test_commands_from_another_site_are_refused(server: PageServer, origin: str) -> None:
    assert command(server, b'{"kind": "quit"}', Origin=origin.format(port=server.port)).status == 403
    assert command(server, b'{"kind": "quit"}', Origin=None).status == 403
    assert server.take_commands() == []


@pytest.mark.parametrize(
    "path",
    ["/../server.py", "/%2e%2e/server.py", "/..%2fserver.py", "/page.js/../server.py", "/page.html", "//etc/passwd",
     "/report/../../etc/passwd", "/report/", "/.", "/static/", "/page.js%00", "*", "//["],
)  # fmt: skip
def test_only_known_paths(server: PageServer, path: str) -> None:
    reply = ask(server, path)
    assert reply.status in (400, 404)
    assert len(reply.body) < 60


def test_every_answer_carries_the_policy(server: PageServer) -> None:
    server.show(state(), jpeg())
    replies = [ask(server, path) for path in ("/", "/page.js", "/state", "/picture?n=1", "/nowhere", "/report")]
    replies += [ask(server, "/", {}), ask(server, "/", method="PUT"), command(server, b"x")]
    for reply in replies:
        policy = reply.headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy
        assert "frame-ancestors 'none'" in policy
        assert "unsafe" not in policy
        assert reply.headers["X-Content-Type-Options"] == "nosniff"
        assert reply.headers["Cache-Control"] == "no-store"
        assert reply.headers["Referrer-Policy"] == "no-referrer"
        assert "Server" not in reply.headers
        assert "Access-Control-Allow-Origin" not in reply.headers


WRONG = [
    "", "\xff\xfe", "take", "[]", "null", '"take"', "{}", '{"kind": "shout"}', '{"kind": null}', '{"kind": ["take"]}',
    '{"kind": "take", "value": 1}', '{"kind": "take", "extra": 1}', '{"kind": "take", "seen": -1}',
    '{"kind": "take", "seen": true}', '{"kind": "take", "seen": 1.5}', '{"kind": "answer"}',
    '{"kind": "answer", "value": 1}', '{"kind": "answer", "value": {}}', '{"kind": "answer", "value": {"": 1}}',
    '{"kind": "answer", "value": {"a": 1, "b": 2}}',
    *(f'{{"kind": "answer", "value": {{"a": {value}}}}}' for value in (
        "NaN", "Infinity", "1e999", "1e16", "9" * 400, "9" * 5000, "[1]", '{"b": 1}', '"\\u001b[2J"', '"two\\nlines"',
        '"\\ud800"', '"' + "x" * 2001 + '"')),
    '{"kind": "answer", "value": {"\\u0000": 1}}', '{"kind": "answer", "value": {"' + "x" * 101 + '": 1}}',
    "[" * SERVER.body_bytes,
]  # fmt: skip


@pytest.mark.parametrize("body", WRONG, ids=[body[:48] for body in WRONG])
def test_what_is_no_command_is_refused(server: PageServer, body: str) -> None:
    assert command(server, body.encode("latin-1")).status == 400
    assert server.take_commands() == []


def test_a_command_is_small_and_json(server: PageServer) -> None:
    fine = b'{"kind": "take"}'
    for kind in (
        None,
        "",
        "text/plain",
        "application/x-www-form-urlencoded",
        "multipart/form-data",
        "application/jsonp",
    ):
        assert command(server, fine, Content_Type=kind).status == 415
    assert command(server, b" " * (SERVER.body_bytes + 1)).status == 413
    head = (
        f"POST /command HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nCookie: {cookie(server)['Cookie']}\r\n"
        f"Origin: http://127.0.0.1:{server.port}\r\nContent-Type: application/json\r\n"
    )
    chunk = f"{SERVER.body_bytes + 1:x}\r\n{' ' * (SERVER.body_bytes + 1)}\r\n0\r\n\r\n"
    assert raw(server, f"{head}Transfer-Encoding: chunked\r\n\r\n{chunk}".encode()) == 413
    for length in ("-1", "1e3", "12, 13", "9" * 30):
        assert raw(server, f"{head}Content-Length: {length}\r\n\r\n".encode()) == 400
    assert raw(server, f"{head}Content-Length: 9000000000\r\n\r\n".encode()) == 413, "and not even read"
    assert server.take_commands() == []


def test_the_report_and_no_other_file(fresh: PageServer, tmp_path: Path) -> None:
    report = tmp_path / "report é.html"
    report.write_text("<h1>all well</h1>", encoding="utf-8")
    (tmp_path / "other.html").write_text("other")
    fresh.show(state())
    assert ask(fresh, "/report").status == 404
    fresh.show(state(report=str(report)))
    reply = ask(fresh, "/report")
    assert (reply.status, reply.body) == (200, b"<h1>all well</h1>")
    assert reply.headers["Content-Security-Policy"].startswith("sandbox allow-scripts")
    assert "allow-same-origin" not in reply.headers["Content-Security-Policy"]
    assert ask(fresh, "/other.html").status == 404
    assert ask(fresh, "/report?file=other.html").body == reply.body
    for named in (tmp_path / "gone.html", tmp_path, tmp_path / "rig.json", "/etc/passwd", "a\0.html"):
        fresh.show(state(report=str(named)))
        assert ask(fresh, "/report").status == 404


def test_slow_requests_are_cut_however_their_bytes_trickle(fresh: PageServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "SERVER", replace(SERVER, connection_s=0.3))
    with socket.create_connection(("127.0.0.1", fresh.port), timeout=30) as slow:
        slow.settimeout(0.05)
        slow.sendall(b"GET / HTTP/1.1\r\n")
        while True:
            try:
                slow.sendall(b"a")
                if slow.recv(1) == b"":
                    break
            except TimeoutError:
                continue
            except OSError:
                break


def test_too_many_connections_are_refused_and_leave_room_again(
    fresh: PageServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "SERVER", replace(SERVER, connection_s=1.0))
    with ExitStack() as stack:
        for _ in range(SERVER.connections + 20):
            stack.enter_context(socket.create_connection(("127.0.0.1", fresh.port), timeout=30))
        fresh.show(state())
        while ask(fresh, "/").status != 200:
            time.sleep(0.1)
