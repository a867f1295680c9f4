"""The page's server: commands in, states, pictures and the report out; nobody slow, many or broken disturbs it."""

from __future__ import annotations

import http.client
import json
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from vbaa_calib.core.errors import InputError
from vbaa_calib.wizard.preview import Command, Preview, Snapshot, server
from vbaa_calib.wizard.preview import server as routes
from vbaa_calib.wizard.preview.hub import BODY_LIMIT

from .preview_client import ask, command, cookie, raw, status
from .preview_states import jpeg, state


@pytest.fixture
def preview() -> Iterator[Preview]:
    with Preview() as preview:
        yield preview


def test_commands_arrive_in_order(preview: Preview) -> None:
    for number in range(5):
        told = {"kind": "answer", "value": {"a": number}, "seen": number}
        assert command(preview, json.dumps(told).encode()).status == 202
    assert preview.take_commands() == [Command("answer", {"a": i}, i) for i in range(5)]


def test_what_is_no_command_is_refused(preview: Preview) -> None:
    fine = b'{"kind": "take"}'
    for kind in (
        None,
        "",
        "text/plain",
        "application/x-www-form-urlencoded",
        "multipart/form-data",
        "application/jsonp",
    ):
        assert command(preview, fine, Content_Type=kind).status == 415
    assert command(preview, b"not json").status == 400
    assert command(preview, b'{"kind": "shout"}').status == 400
    assert command(preview, b" " * (BODY_LIMIT + 1)).status == 413
    assert command(preview, iter([fine]), Transfer_Encoding="chunked").status == 411
    for length in ("-1", "1e3", "12, 13", "9" * 30, "٣"):
        assert command(preview, fine, Content_Length=length.encode().decode("latin-1")).status == 411
    assert preview.take_commands() == []


def test_a_huge_body_is_not_even_read(preview: Preview) -> None:
    head = (
        f"POST /command HTTP/1.1\r\nHost: 127.0.0.1:{preview.port}\r\nCookie: {cookie(preview)['Cookie']}\r\n"
        f"Origin: http://127.0.0.1:{preview.port}\r\nContent-Type: application/json\r\n"
        "Content-Length: 9000000000\r\n\r\n"
    )
    assert status(raw(preview, head.encode())) == 413


def test_too_many_commands_wait_their_turn(preview: Preview) -> None:
    for _ in range(100):
        preview._hub.give(Command("take"))
    assert command(preview, b'{"kind": "take"}').status == 503
    assert len(preview.take_commands()) == 100
    assert command(preview, b'{"kind": "take"}').status == 202


def test_state_is_held_until_there_is_news(preview: Preview) -> None:
    number = preview.show(Snapshot(state()))
    assert json.loads(ask(preview, "/state?after=0").body)["n"] == number
    threading.Timer(0.2, preview.show, [Snapshot(state(session="later"))]).start()
    start = time.monotonic()
    told = json.loads(ask(preview, f"/state?after={number}").body)
    assert time.monotonic() - start > 0.15
    assert (told["n"], told["state"]["session"]) == (number + 1, "later")


def test_no_news_is_no_content(preview: Preview, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(routes, "WAIT_S", 0.05)
    reply = ask(preview, "/state?after=0")
    assert (reply.status, reply.body) == (204, b"")


def test_the_picture_belongs_to_the_state(preview: Preview) -> None:
    assert ask(preview, "/picture?n=1").status == 404
    for level in (10, 200):
        preview.show(Snapshot(state(), jpeg(level)))
    told = json.loads(ask(preview, "/state?after=0").body)
    reply = ask(preview, f"/picture?n={told['picture']}")
    assert (reply.body, reply.headers["Content-Type"]) == (jpeg(200), "image/jpeg")
    assert ask(preview, "/picture?n=1").body == jpeg(10)


def test_the_report_and_no_other_file(preview: Preview, tmp_path: Path) -> None:
    report = tmp_path / "report é.html"
    report.write_text("<h1>all well</h1>", encoding="utf-8")
    (tmp_path / "other.html").write_text("other")
    preview.show(Snapshot(state()))
    assert ask(preview, "/report").status == 404
    preview.show(Snapshot(state(report=str(report))))
    reply = ask(preview, "/report")
    assert (reply.status, reply.body) == (200, b"<h1>all well</h1>")
    policy = reply.headers["Content-Security-Policy"]
    assert policy.startswith("sandbox allow-scripts")
    assert "allow-same-origin" not in policy
    assert ask(preview, "/other.html").status == 404
    assert ask(preview, "/report?file=other.html").body == reply.body
    for named in (tmp_path / "gone.html", tmp_path, tmp_path / "rig.json", "/etc/passwd", "a\0.html"):
        preview.show(Snapshot(state(report=str(named))))
        assert ask(preview, "/report").status == 404


def test_slow_requests_are_hung_up_however_their_bytes_trickle(
    preview: Preview, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "REQUEST_S", 0.3)
    start = time.monotonic()
    with socket.create_connection(("127.0.0.1", preview.port), timeout=10) as slow:
        slow.settimeout(0.05)
        slow.sendall(b"GET / HTTP/1.1\r\n")
        ended = False
        while not ended and time.monotonic() - start < 8.0:
            try:
                slow.sendall(b"a")
                ended = slow.recv(1) == b""
            except TimeoutError:
                pass
            except OSError:
                ended = True
    assert ended
    assert 0.25 < time.monotonic() - start < 5.0


def test_too_many_connections_are_refused_and_leave_room_again(
    preview: Preview, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "REQUEST_S", 1.0)
    with ExitStack() as stack:
        for _ in range(server.CONNECTIONS + 20):
            stack.enter_context(socket.create_connection(("127.0.0.1", preview.port), timeout=10))
        start = time.monotonic()
        preview.show(Snapshot(state()))
        assert time.monotonic() - start < 0.5, "the wizard does not wait for them"
    end = time.monotonic() + 8.0
    while True:
        try:
            assert ask(preview, "/").status == 200
            break
        except (OSError, http.client.HTTPException):
            assert time.monotonic() < end
            time.sleep(0.1)


def test_many_clients_at_once_all_get_the_news(preview: Preview) -> None:
    number = preview.show(Snapshot(state()))
    got: list[int] = []
    clients = [
        threading.Thread(target=lambda: got.append(json.loads(ask(preview, f"/state?after={number}").body)["n"]))
        for _ in range(30)
    ]
    for client in clients:
        client.start()
    end = time.monotonic() + 8.0
    while preview._server._open < 30 and time.monotonic() < end:
        time.sleep(0.02)
    preview.show(Snapshot(state(session="news")))
    for client in clients:
        client.join(10)
    assert got == [number + 1] * 30


def test_showing_never_waits_for_a_client_that_does_not_read(preview: Preview) -> None:
    big = b"\xff\xd8" + b"x" * 5_000_000
    preview.show(Snapshot(state(), big))
    with ExitStack() as stack:
        for _ in range(4):
            client = stack.enter_context(socket.create_connection(("127.0.0.1", preview.port), timeout=10))
            client.sendall(
                f"GET /picture?n=1 HTTP/1.1\r\nHost: 127.0.0.1:{preview.port}\r\n"
                f"Cookie: {cookie(preview)['Cookie']}\r\n\r\n".encode()
            )
            client.recv(10)
        start = time.monotonic()
        for _ in range(50):
            preview.show(Snapshot(state(), big))
            preview.take_commands()
        assert time.monotonic() - start < 1.0


def test_a_failure_inside_is_an_answer_and_not_a_traceback(
    preview: Preview, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def broken(number: int) -> bytes:
        raise RuntimeError("secret place")

    monkeypatch.setattr(preview._hub, "picture", broken)
    reply = ask(preview, "/picture?n=1")
    assert reply.status == 500
    assert b"secret" not in reply.body
    assert capfd.readouterr() == ("", "")


def test_a_port_that_is_taken_is_said(preview: Preview) -> None:
    with pytest.raises(InputError, match=f"port {preview.port}"):
        Preview(preview.port)
    with pytest.raises(InputError, match="port 70000"):
        Preview(70000)


def test_it_listens_on_this_machine_only(preview: Preview) -> None:
    assert preview._server.socket.getsockname() == ("127.0.0.1", preview.port)


def test_closing_ends_it_also_twice_and_with_clients_waiting() -> None:
    preview = Preview()
    preview.start()
    number = preview.show(Snapshot(state()))
    waiting = threading.Thread(target=lambda: ask(preview, f"/state?after={number}"))
    waiting.start()
    time.sleep(0.1)
    start = time.monotonic()
    preview.close()
    preview.close()
    waiting.join(5)
    assert not waiting.is_alive()
    assert time.monotonic() - start < 5.0
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.1", preview.port), timeout=2)


def test_closing_without_ever_starting() -> None:
    Preview().close()
