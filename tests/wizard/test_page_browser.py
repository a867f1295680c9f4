"""The page in a real browser, with real clicks and keys: what the wizard shows is seen, what is done there arrives."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from vbaa_calib.wizard.questions import STEPS
from vbaa_calib.wizard.server import PageServer, _PageCommand

from .browser import BROWSER, Browser
from .page_client import LIVE, QUESTION, STATE, jpeg, state

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


def test_every_step_has_its_drawing(browser: Browser, server: PageServer) -> None:
    for name in STEPS[:-1]:
        page = opened(browser, server, step={**STATE["step"], "name": name})
        page.until("document.querySelector('#drawing img').naturalWidth > 100")
        assert page.value("document.querySelector('#drawing').getAttribute('href')") == f"/step_{name}.svg"
    page = opened(browser, server, step={**STATE["step"], "name": "verdict"})
    assert page.value("document.querySelector('#drawing').hidden")
    assert page.complaints() == []


def test_picture_corners_outline_coverage_and_hints(browser: Browser, server: PageServer) -> None:
    page = opened(browser, server, live=LIVE)
    page.until("document.getElementById('picture').naturalWidth === 320")
    page.until("document.querySelectorAll('#marks .cell').length === 12")
    assert page.value("document.querySelectorAll('#marks .empty').length") == 8
    assert page.value("document.getElementById('marks').getAttribute('viewBox')") == "-0.5 -0.5 320 240"
    box = page.value("(r => [r.x, r.y, r.width, r.height])(document.getElementById('frame').getBoundingClientRect())")
    corner = "document.querySelector('#marks .corner.line').getBBox()"
    left, right = page.value(f"(b => [b.x, b.x + b.width])({corner})")
    assert (left, right) == (40.0, 120.0)
    assert box[2] / box[3] == pytest.approx(320 / 240, rel=1e-3)
    page.until("document.getElementById('suggestion').textContent === 'further right, nearer'")
    assert page.value("document.getElementById('hold').getAttribute('aria-valuenow')") == "25"
    page.until("document.getElementById('hints').textContent.includes('the picture is blurred → hold still')")
    assert "4 of 12 fields" in page.text("#covered")
    page.click("#cells")
    page.until("document.querySelectorAll('#marks .cell').length === 0")
    server.show(state(live={**LIVE, "corners_px": [], "suggested_px": None, "hold": 1.0}), jpeg(20))
    page.until("document.getElementById('held').textContent === '✓ still'")
    assert page.value("document.querySelectorAll('#marks .corner, #marks .wanted, #marks .top').length") == 0
    page.click("#cells")
    assert page.complaints() == []


@pytest.mark.parametrize(("typed", "value"), [("0,125", 0.125), ("120 g", "120 g")])
def test_a_number_is_typed_and_entered(browser: Browser, server: PageServer, typed: str, value: object) -> None:
    page = opened(browser, server, question=QUESTION)
    page.until("document.activeElement.id === 'field'")
    page.press("Enter", 13)
    page.until("document.getElementById('problem').textContent === 'A number is needed.'")
    page.type(typed)
    server.show(state(question=QUESTION, log=["a frame came meanwhile"]))
    page.until("document.getElementById('log').textContent.includes('meanwhile')")
    page.press("Enter", 13)
    assert given(server) == _PageCommand(kind="answer", value={"loads.1.mass": value}, seen=2)
    page.until("document.getElementById('sent').textContent.startsWith('sent: ')")
    server.show(state(question={**QUESTION, "problem": "too heavy"}))
    page.until("document.getElementById('problem').textContent === 'too heavy'")
    assert page.value("document.getElementById('field').value") == typed
    assert page.complaints() == []


def test_choices_yes_and_no_and_texts(browser: Browser, server: PageServer) -> None:
    paper = {**QUESTION, "key": "paper", "kind": "choice", "choices": ["A4", "A3", "<b>"], "default": "A3"}
    page = opened(browser, server, question=paper)
    page.press("Enter", 13)
    assert given(server).value == {"paper": "A3"}
    page.click("#asked label:nth-of-type(3) input")
    page.click("#answer")
    assert given(server).value == {"paper": "<b>"}
    server.show(state(question={**QUESTION, "key": "sure", "kind": "yesno"}))
    page.until("document.querySelectorAll('#asked input').length === 2")
    page.click("#answer")
    page.until("document.getElementById('problem').textContent === 'Choose one.'")
    page.click("#asked label:nth-of-type(2)")
    page.click("#answer")
    assert given(server).value == {"sure": False}
    server.show(state(question={**QUESTION, "key": "name", "kind": "text", "default": "rig"}))
    page.until("document.getElementById('field')?.value === 'rig'")
    page.type("rig <b>")
    page.press("Enter", 13)
    assert given(server).value == {"name": "rig <b>"}
    assert page.complaints() == []


def test_buttons_and_the_space_key(browser: Browser, server: PageServer) -> None:
    page = opened(browser, server, live=LIVE)
    for kind in ("take", "enough", "drop", "back"):
        page.click(f"[data-kind={kind}]")
        assert given(server) == _PageCommand(kind=kind, seen=1)
    page.press(" ", 32)
    assert given(server).kind == "take", "and not once more what was clicked before"
    for kind in ("redo", "quit"):
        page.click(f"[data-kind={kind}]")
        page.until("document.getElementById('sure').open")
        page.click("#no")
        page.until("!document.getElementById('sure').open")
        page.click(f"[data-kind={kind}]")
        page.until("document.getElementById('sure').open")
        page.click("#yes")
        assert given(server).kind == kind
    server.show(state(live=LIVE, question=QUESTION, can=["enough"]), jpeg())
    page.until("document.activeElement.id === 'field'")
    page.press(" ", 32)
    assert page.value("document.getElementById('field').value") == " "
    shown = "[...document.querySelectorAll('#buttons button')].filter(b => !b.hidden).map(b => b.dataset.kind)"
    assert page.value(shown) == ["enough"]
    assert server.take_commands() == []
    assert page.complaints() == []


def test_the_end_has_a_verdict_and_a_report(browser: Browser, server: PageServer, tmp_path: Path) -> None:
    report = tmp_path / "report.html"
    report.write_text(
        "<!doctype html><title>r</title><p id=p>no</p><script>document.getElementById('p').textContent = 'alive';"
        "fetch('/state?after=0').then(r => r.text()).catch(() => 'refused').then(t => { document.title = t; })</script>"
    )
    verdict = {"level": "holds", "words": "This rig can be trusted", "found": []}
    page = opened(browser, server, finished=True, verdict=verdict, report=str(report))
    assert page.text("#ended") == "This rig can be trusted"
    assert page.text("#level") == "✓ holds"
    assert page.value("document.getElementById('task').hidden")
    page.open(page.value("document.getElementById('open').href"))
    page.until("document.title === 'refused'")
    assert page.text("#p") == "alive"
