"""What is shown and what is sent back: strict JSON one way, small finite commands the other."""

from __future__ import annotations

import json
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from vbaa_calib.core.errors import InputError
from vbaa_calib.wizard.preview import Command, Snapshot
from vbaa_calib.wizard.preview.hub import BODY_LIMIT, COMMANDS_KEPT, PICTURES_KEPT, Hub, command_of
from vbaa_calib.wizard.preview.snapshot import encoded

from .preview_states import jpeg, state


def test_numpy_paths_and_what_is_not_finite_become_json() -> None:
    told = {
        "a": np.float64(0.5),
        "b": np.array([[1, 2]]),
        "c": [float("nan"), -np.inf, np.float32("nan")],
        "d": Path("x/y"),
        "e": (True, None, "é"),
    }
    told_back = {"a": 0.5, "b": [[1, 2]], "c": [None, None, None], "d": "x/y", "e": [True, None, "é"]}
    assert json.loads(encoded(told)) == told_back


def test_a_file_name_that_is_no_unicode_is_shown_all_the_same() -> None:
    assert json.loads(encoded({"log": ["a\udcff.png"]})) == {"log": ["a?.png"]}


@pytest.mark.parametrize("value", [object(), b"bytes", {1, 2}])
def test_what_has_no_form_is_told_where_it_is_shown(value: object) -> None:
    with pytest.raises(TypeError, match="no form"):
        Hub().publish(Snapshot({"session": value}))


@pytest.mark.parametrize("value", [0.125, -3, "120 g", True, None, ""])
def test_an_answer_comes_through_as_it_is(value: object) -> None:
    body = json.dumps({"kind": "answer", "value": {"loads.1.mass": value}, "seen": 7}).encode()
    assert command_of(body) == Command("answer", {"loads.1.mass": value}, 7)


@pytest.mark.parametrize("kind", ["take", "enough", "back", "redo", "drop", "quit"])
def test_commands_without_a_value(kind: str) -> None:
    assert command_of(json.dumps({"kind": kind}).encode()) == Command(kind)


WRONG = [
    b"",
    b"\xff\xfe",
    b"take",
    b"[]",
    b"null",
    b'"take"',
    b"{}",
    b'{"kind": "shout"}',
    b'{"kind": null}',
    b'{"kind": ["take"]}',
    b'{"kind": "take", "value": 1}',
    b'{"kind": "take", "extra": 1}',
    b'{"kind": "take", "seen": -1}',
    b'{"kind": "take", "seen": true}',
    b'{"kind": "take", "seen": 1.5}',
    b'{"kind": "answer"}',
    b'{"kind": "answer", "value": 1}',
    b'{"kind": "answer", "value": {}}',
    b'{"kind": "answer", "value": {"": 1}}',
    b'{"kind": "answer", "value": {"a": 1, "b": 2}}',
    b'{"kind": "answer", "value": {"a": NaN}}',
    b'{"kind": "answer", "value": {"a": Infinity}}',
    b'{"kind": "answer", "value": {"a": 1e999}}',
    b'{"kind": "answer", "value": {"a": 1e16}}',
    b'{"kind": "answer", "value": {"a": ' + b"9" * 400 + b"}}",
    b'{"kind": "answer", "value": {"a": ' + b"9" * 5000 + b"}}",
    b'{"kind": "answer", "value": {"a": [1]}}',
    b'{"kind": "answer", "value": {"a": {"b": 1}}}',
    b'{"kind": "answer", "value": {"a": "\\u001b[2J"}}',
    b'{"kind": "answer", "value": {"a": "two\\nlines"}}',
    b'{"kind": "answer", "value": {"a": "\\ud800"}}',
    b'{"kind": "answer", "value": {"\\u0000": 1}}',
    b'{"kind": "answer", "value": {"a": "' + b"x" * 2001 + b'"}}',
    b'{"kind": "answer", "value": {"' + b"x" * 101 + b'": 1}}',
    b"[" * BODY_LIMIT,
]


@pytest.mark.parametrize("body", WRONG, ids=[body[:48].decode("latin-1") for body in WRONG])
def test_what_is_no_command_is_refused(body: bytes) -> None:
    with pytest.raises(InputError):
        command_of(body)


def test_later_changes_of_a_state_do_not_reach_what_was_shown() -> None:
    hub, told = Hub(), state()
    hub.publish(Snapshot(told))
    told["log"].append("third")
    shown = hub.newest()
    assert shown is not None
    assert json.loads(shown.body)["state"]["log"] == ["first", "second"]


def test_waiting_ends_with_news_and_not_before() -> None:
    hub = Hub()
    first = hub.publish(Snapshot(state()))
    start = time.monotonic()
    assert hub.wait(first, 0.1) is None
    assert time.monotonic() - start >= 0.09
    timer = threading.Timer(0.1, hub.publish, [Snapshot(state(session="new"))])
    timer.start()
    shown = hub.wait(first, 30.0)
    assert shown is not None
    assert shown.number == first + 1
    assert json.loads(shown.body)["state"]["session"] == "new"


def test_closing_wakes_who_waits() -> None:
    hub = Hub()
    threading.Timer(0.05, hub.close).start()
    start = time.monotonic()
    assert hub.wait(0, 30.0) is None
    assert time.monotonic() - start < 10.0


def test_a_picture_keeps_its_number_while_it_is_the_same_and_is_kept_for_a_while() -> None:
    hub, same = Hub(), jpeg()
    numbers = [hub.publish(Snapshot(state(), picture)) for picture in (same, same, None, same)]
    assert numbers == [1, 2, 3, 4]
    shown = hub.newest()
    assert shown is not None
    assert json.loads(shown.body)["picture"] == 1
    for level in range(PICTURES_KEPT):
        hub.publish(Snapshot(state(), jpeg(level)))
    assert hub.picture(5) == jpeg(0)
    assert hub.picture(1) == jpeg(PICTURES_KEPT - 1), "no longer kept: the newest instead"
    assert Hub().picture(1) is None


def test_commands_are_handed_out_once_in_order_and_never_pile_up() -> None:
    hub = Hub()
    given = [hub.give(Command("take", seen=i)) for i in range(COMMANDS_KEPT + 5)]
    assert given == [True] * COMMANDS_KEPT + [False] * 5
    assert [command.seen for command in hub.take()] == list(range(COMMANDS_KEPT))
    assert hub.take() == []
