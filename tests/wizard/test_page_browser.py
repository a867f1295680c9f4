"""The page in a real browser: what the wizard shows is seen, what is done there arrives."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import pytest

from vbaa_calib.wizard.server import PageServer, _PageCommand

from .browser import BROWSER, Browser
from .page_client import LIVE, STATE, jpeg, state

pytestmark = pytest.mark.skipif(BROWSER is None, reason="no browser here")


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    browser = Browser(tmp_path_factory.mktemp("profile"))
    yield browser
    browser.close()


@pytest.fixture
def server(browser: Browser) -> Iterator[PageServer]:
    browser.told.clear()
    browser.size(1280, 860)
    server = PageServer()
    yield server
    browser.open("about:blank")
    server.close()


def opened(browser: Browser, server: PageServer, **changed: Any) -> Browser:
    """The page, once it shows a state with these entries."""
    server.show(state(**changed), jpeg() if changed.get("live") else None)
    browser.open(server.url)
    browser.until("document.getElementById('main')?.hidden === false")
    return browser


def given(server: PageServer) -> _PageCommand:
    """The next command, and that it is the only one."""
    end = time.monotonic() + 10.0
    while not (commands := server.take_commands()):
        assert time.monotonic() < end, "no command came"
        time.sleep(0.02)
    assert len(commands) == 1
    return commands[0]


def test_it_shows_the_state_as_text_and_follows_it(browser: Browser, server: PageServer) -> None:
    hostile = "<img src=x onerror=\"document.title='taken'\">.png"
    page = opened(browser, server, log=[hostile], session=hostile)
    assert page.value("location.search") == ""
    assert page.text("#title") == STATE["step"]["title"]
    assert page.text("#session") == hostile
    assert hostile in page.text("#log")
    assert page.value("document.querySelectorAll('main img').length") == 2
    assert "not yet" in page.text("#numbers")
    before = "['picture', 'cells'].map(id => document.getElementById(id).getBoundingClientRect().width)"
    assert page.value(before) == [0, 0], "neither a broken picture nor a lone box before the first one"
    assert page.value("document.querySelector('[aria-current=step] .name').textContent") == "Lens (now)"
    assert page.text("#missing") == "the lower right"
    step = {**STATE["step"], "title": "Now something else", "enough": True}
    server.show(state(step=step, steps=[]))
    page.until("document.getElementById('title').textContent === 'Now something else'")
    assert page.value("document.title") == f"Now something else · {STATE['session']}"
    assert page.text("#enough") == "✓ Enough: you can go on."
    assert page.complaints() == []


def test_what_is_clicked_arrives(browser: Browser, server: PageServer) -> None:
    page = opened(browser, server, live=LIVE)
    for kind in ("take", "enough", "drop", "back"):
        page.value(f"document.querySelector('[data-kind={kind}]').click()")
        assert given(server) == _PageCommand(kind=kind, seen=1)
    assert page.complaints() == []
