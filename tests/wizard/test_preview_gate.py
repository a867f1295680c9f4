"""The page's server answers to its own address and to who has the run's token; and to nobody else."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from vbaa_calib.wizard.preview import Command, Preview, Snapshot
from vbaa_calib.wizard.preview import server as routes

from .preview_client import ask, command, cookie, raw, status, token
from .preview_states import jpeg, state


@pytest.fixture(scope="module")
def preview() -> Iterator[Preview]:
    """One for all of them: nothing that is refused leaves a trace."""
    with Preview() as preview:
        yield preview


PATHS = ("/", "/page.js", "/picture.js", "/question.js", "/page.css", "/icon.svg", "/state", "/picture", "/report")


def test_the_address_gives_a_cookie_and_leads_to_an_address_without_the_token(preview: Preview) -> None:
    reply = ask(preview, "/?" + urlsplit(preview.url).query, {})
    assert (reply.status, reply.headers["Location"]) == (303, "/")
    name, _, rest = reply.headers["Set-Cookie"].partition("=")
    assert name == f"vbaa_wizard_{preview.port}"
    assert rest.split("; ") == [token(preview), "Path=/", "HttpOnly", "SameSite=Strict"]
    assert ask(preview, "/", {"Cookie": f"{name}={token(preview)}"}).status == 200


def test_each_run_has_its_own_long_token() -> None:
    first, second = Preview(), Preview()
    try:
        assert token(first) != token(second)
        assert len(token(first)) >= 43
    finally:
        first.close()
        second.close()


@pytest.mark.parametrize("path", PATHS)
def test_nothing_without_the_token(preview: Preview, path: str) -> None:
    preview.show(Snapshot(state(), jpeg()))
    wrong = token(preview)[:-1] + "?"
    for headers in (
        {},
        {"Cookie": f"vbaa_wizard_{preview.port}={wrong}"},
        {"Cookie": f"vbaa_wizard={token(preview)}"},
        {"Cookie": f"vbaa_wizard_{preview.port}="},
        {"Cookie": f"vbaa_wizard_{preview.port}={token(preview)}é".encode().decode("latin-1")},
        {"Authorization": f"Bearer {wrong}"},
        {"Authorization": f"Basic {token(preview)}"},
    ):
        reply = ask(preview, path, headers)
        assert reply.status == 403
        assert b"address that the wizard printed" in reply.body
        assert token(preview).encode() not in reply.body
    assert ask(preview, f"{path}?token={wrong}", {}).status == 403
    assert ask(preview, f"{path}?token={token(preview)}&token={wrong}", {}).status == 403
    if path != "/":
        assert ask(preview, f"{path}?token={token(preview)}", {}).status == 403, "in the first address only"


def test_commands_need_the_token(preview: Preview) -> None:
    assert command(preview, b'{"kind": "quit"}', Cookie=None).status == 403
    assert command(preview, b'{"kind": "quit"}', Cookie=None, Authorization="Bearer x").status == 403
    assert preview.take_commands() == []


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:{port}", "127.0.0.1", "127.0.0.1:1", "[::1]:{port}", ""]
)
def test_only_the_own_address(preview: Preview, host: str) -> None:
    told = host.format(port=preview.port)
    assert ask(preview, "/", {"Host": told, **cookie(preview)}).status == 421
    assert ask(preview, "/?" + urlsplit(preview.url).query, {"Host": told}).status == 421
    assert command(preview, b'{"kind": "quit"}', Host=told).status == 421
    assert preview.take_commands() == []


def test_no_host_or_two_are_refused(preview: Preview) -> None:
    line = f"Cookie: {cookie(preview)['Cookie']}\r\n".encode()
    own = f"Host: 127.0.0.1:{preview.port}\r\n".encode()
    assert status(raw(preview, b"GET / HTTP/1.1\r\n" + line + b"\r\n")) == 421
    assert status(raw(preview, b"GET / HTTP/1.1\r\n" + own + own + line + b"\r\n")) == 421
    assert status(raw(preview, b"GET / HTTP/1.1\r\n" + own + line + b"\r\n")) == 200


def test_localhost_is_the_own_address_too(preview: Preview) -> None:
    host = f"localhost:{preview.port}"
    assert ask(preview, "/", {"Host": host, **cookie(preview)}).status == 200
    assert command(preview, b'{"kind": "take"}', Host=host, Origin=f"http://{host}").status == 202
    assert preview.take_commands() == [Command("take")]


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "https://127.0.0.1:{port}", "http://127.0.0.1:1", "http://127.0.0.1", ""]
)
def test_commands_from_another_site_are_refused(preview: Preview, origin: str) -> None:
    assert command(preview, b'{"kind": "quit"}', Origin=origin.format(port=preview.port)).status == 403
    assert preview.take_commands() == []


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_pages_of_others_cannot_use_ours(preview: Preview, site: str) -> None:
    for path in PATHS:
        assert ask(preview, path, {"Sec-Fetch-Site": site, **cookie(preview)}).status == 403
    assert command(preview, b'{"kind": "quit"}', Sec_Fetch_Site=site).status == 403


def test_a_program_may_use_the_token_in_a_header(preview: Preview) -> None:
    headers = {"Authorization": f"Bearer {token(preview)}", "Content-Type": "application/json"}
    assert ask(preview, "/command", headers, "POST", b'{"kind": "take"}').status == 202
    assert preview.take_commands() == [Command("take")]


@pytest.mark.parametrize(
    "path",
    [
        "/../snapshot.py",
        "/%2e%2e/snapshot.py",
        "/..%2fsnapshot.py",
        "/page.js/../snapshot.py",
        "/snapshot.py",
        "/page.html",
        "//etc/passwd",
        "/etc/passwd",
        "/report/../../etc/passwd",
        "/report/",
        "/.",
        "/static/",
        "/page.js%00",
        "*",
        "//[",
    ],
)
def test_only_known_paths(preview: Preview, path: str) -> None:
    reply = ask(preview, path)
    assert reply.status in (400, 404)
    assert len(reply.body) < 60


def test_the_form_for_proxies_is_refused(preview: Preview) -> None:
    head = f" HTTP/1.1\r\nHost: 127.0.0.1:{preview.port}\r\nCookie: {cookie(preview)['Cookie']}\r\n\r\n".encode()
    assert status(raw(preview, b"GET http://evil.example/page.js" + head)) == 400
    assert status(raw(preview, b"GET /page.js" + head)) == 200


@pytest.mark.parametrize("method", ["HEAD", "PUT", "DELETE", "OPTIONS", "TRACE", "CONNECT", "PATCH", "SHOUT"])
def test_unknown_methods(preview: Preview, method: str) -> None:
    for path in ("/", "/command", "/state"):
        assert ask(preview, path, method=method).status == 405


def test_known_paths_in_a_wrong_way(preview: Preview) -> None:
    assert ask(preview, "/command").status == 405
    origin = {"Origin": f"http://127.0.0.1:{preview.port}", "Content-Type": "application/json", **cookie(preview)}
    assert ask(preview, "/state", origin, "POST", b"{}").status == 405
    for query in ("after=x", "after=-1", "after=1&after=2", "after=" + "9" * 40, "after=", "after=%D9%A3"):
        assert ask(preview, f"/state?{query}").status == 400
    assert ask(preview, "/picture?n=1.5").status == 400


@pytest.mark.parametrize(
    "data",
    [
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\r\n\r\n",
        b"nonsense\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
        b"GET " + b"/" * 70000 + b" HTTP/1.1\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 200 + b"\r\n",
        b"GET / HTTP/1.1\r\nA: " + b"b" * 70000 + b"\r\n\r\n",
        b"GET / HTTP/1.1\r\n\xff\xfe: \x00\r\n\r\n",
    ],
    ids=["TLS", "nonsense", "version", "long line", "many headers", "long header", "binary"],
)
def test_what_is_no_request_is_refused_quietly(
    preview: Preview, data: bytes, capfd: pytest.CaptureFixture[str]
) -> None:
    try:
        reply = raw(preview, data)
    except ConnectionResetError:
        reply = b""
    assert not reply or 400 <= status(reply) < 600
    assert ask(preview, "/").status == 200
    assert capfd.readouterr() == ("", "")


def test_every_answer_carries_the_policy(preview: Preview) -> None:
    preview.show(Snapshot(state(), jpeg()))
    replies = [ask(preview, path) for path in ("/", "/page.js", "/state", "/picture?n=1", "/nowhere", "/report")]
    replies += [ask(preview, "/", {}), ask(preview, "/", method="PUT"), command(preview, b"x")]
    for reply in replies:
        policy = reply.headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy
        assert "frame-ancestors 'none'" in policy
        assert "unsafe" not in policy
        assert reply.headers["X-Content-Type-Options"] == "nosniff"
        assert reply.headers["Cache-Control"] == "no-store"
        assert reply.headers["Referrer-Policy"] == "no-referrer"
        assert reply.headers["Server"] == "vbaa"
        assert "Access-Control-Allow-Origin" not in reply.headers


def test_the_page_s_files_hold_nothing_inline_and_nothing_from_elsewhere() -> None:
    here = Path(routes.__file__)
    html = here.with_name("page.html").read_text(encoding="utf-8")
    assert "style=" not in html
    assert not re.search(r"\son\w+\s*=|<script(?![^>]* src=)|<style", html)
    for name, _ in routes.FILES.values():
        text = here.with_name(name).read_text(encoding="utf-8")
        assert set(re.findall(r"\w+://[^\s\"']+", text)) <= {"http://www.w3.org/2000/svg"}
        for danger in ("innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval(", "Function("):
            assert danger not in text
