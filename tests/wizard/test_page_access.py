"""The page answers at its own address alone, and to who has the run's token; nothing in it comes from elsewhere."""

from __future__ import annotations

import re
from urllib.parse import urlsplit

import pytest

from vbaa_calib.wizard.server import FILES, STATIC, PageServer

from .page_client import ask, command, cookie, jpeg, state, token

PATHS = ("/", "/page.js", "/picture.js", "/question.js", "/page.css", "/icon.svg", "/state", "/picture", "/report")


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


def test_the_page_s_files_hold_nothing_inline_and_nothing_from_elsewhere() -> None:
    html = (STATIC / "page.html").read_text(encoding="utf-8")
    assert not re.search(r"\son\w+\s*=|<script(?![^>]* src=)|<style|style=", html)
    for name in FILES.values():
        text = (STATIC / name).read_text(encoding="utf-8")
        assert set(re.findall(r"\w+://[^\s\"']+", text)) <= {"http://www.w3.org/2000/svg"}
        for danger in ("innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval(", "Function("):
            assert danger not in text
