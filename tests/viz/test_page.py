"""The page: whole, offline, with its legend, and alive in a browser."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from markupsafe import escape

from viz.parts.assemble import all_parts
from viz.render.page import _CLEAR, _ICON, write_page
from viz.scene.readable import MODES
from viz.scene.scene import Scene

from ..wizard.browser import BROWSER, Browser

ROOT = Path(__file__).parents[2]

SOFTWARE = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
CAMERA = """(() => {
  const drawn = window.global.renderWindow.getRenderers().find((each) => each.getActors().length > 3);
  const camera = drawn.getActiveCamera();
  return [camera.getPosition(), camera.getFocalPoint(), camera.getViewUp(), [camera.getViewAngle()]];
})()"""


COVERED = """(() => {
  const bottom = document.getElementById('time').getBoundingClientRect().top;
  const panels = [...document.querySelectorAll('#legend, #measures, #seen')];
  return panels.filter((each) => each.getBoundingClientRect().bottom > bottom).map((each) => each.id);
})()"""


@pytest.fixture(scope="module")
def written(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "scene.html"
    write_page(scene, path, title="A & B <touch>")
    return path


def test_the_page_is_whole_offline_and_has_its_legend(scene: Scene, written: Path) -> None:
    text = written.read_text()
    assert "<title>A &amp; B &lt;touch&gt;</title>" in text
    assert not re.search(r"""(src|href)\s*=\s*["'](https?:)?//""", text)
    legend = text.partition('id="legend"')[2].partition('id="time"')[0]
    for part in all_parts(scene):
        assert str(escape(part.label)) in legend
    for words in ("90 contacts", "Friction &lt;is&gt; told.", "std of the surface, mm", *MODES):
        assert words in legend
    assert _CLEAR in text
    assert _ICON not in text
    head = text.partition("<script")[0]
    assert "default-src 'none'" in head
    assert "http" not in head.partition('content="default-src')[2].partition('"')[0]
    assert 1_200_000 < len(text) < 6_000_000


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no browser here")
@pytest.mark.parametrize(("moment", "colour"), [(3, "force"), (70, "uncertainty")])
def test_the_page_runs_in_a_browser(scene: Scene, written: Path, moment: int, colour: str) -> None:
    options = ["--headless", "--no-sandbox", *SOFTWARE]
    address = f"{written.as_uri()}#moment={moment}&colour={colour}&all=0"
    command = [str(BROWSER), *options, "--virtual-time-budget=15000", "--dump-dom", address]
    shown = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout
    assert scene.instants.words[moment] in shown.partition('id="words"')[2][:200]
    assert f"frame {scene.instants.frame[moment]}" in shown
    assert 'id="silent" hidden' in shown
    assert 'id="seen" hidden' not in shown


def rays(page: Browser, width: int, height: int, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Camera centre (3,) and unit directions (N, 3) of what is drawn at `pixels` (N, 2), by the pinhole model."""
    centre, focus, up, (angle_deg,) = (np.array(one) for one in page.value(CAMERA))
    ahead = (focus - centre) / np.linalg.norm(focus - centre)
    right = np.cross(ahead, up) / np.linalg.norm(np.cross(ahead, up))
    off = (pixels - [width / 2, height / 2]) * np.tan(np.radians(angle_deg / 2)) / (height / 2)
    directions = ahead + off[:, :1] * right - off[:, 1:] * np.cross(right, ahead)
    return centre, directions / np.linalg.norm(directions, axis=1, keepdims=True)


def places(page: Browser, width: int, height: int, points_m: np.ndarray) -> np.ndarray:
    """(N, 2) pixels at which points (N, 3) are drawn: where `rays` of the picture's axes meet them."""
    corners = np.array([[width / 2, height / 2], [width, height / 2], [width / 2, height]])
    centre, (ahead, right, down) = rays(page, width, height, corners)
    axes = np.stack([right / (right @ ahead) - ahead, down / (down @ ahead) - ahead])
    seen = (points_m - centre) @ np.linalg.pinv(axes) / ((points_m - centre) @ ahead)[:, None]
    return (1 + seen) * np.array([width, height]) / 2


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no browser here")
def test_a_click_takes_the_contact_that_is_drawn_there(scene: Scene, written: Path, tmp_path: Path) -> None:
    page = Browser(tmp_path / "profile", *SOFTWARE)
    points, clicked = scene.contacts.points_m, 0
    try:
        for width, height, dense, turned in ((1280, 860, 1, 0), (400, 500, 2, 0), (700, 400, 1, 140)):
            page.size(width, height, dense)
            if not clicked:
                page.open(f"{written.as_uri()}#view=1")
            page.until(f"document.querySelector('canvas')?.width === {dense * width} && window.global?.renderWindow")
            page.until("document.getElementById('clock').textContent")
            assert page.value(COVERED) == [], "no panel lies on another"
            page.value("document.getElementById('legend').open = false")
            if turned:
                page.drag((300, 200), (300 + turned // 2, 180), (300 + turned, 150))
            pixels = places(page, width, height, points)[::17]
            centre, directions = rays(page, width, height, pixels)
            away = points - centre
            along = directions @ away.T
            inside = scene.ball_m**2 - (away**2).sum(axis=1) + along**2
            front = np.where(inside >= 0, along - np.sqrt(np.maximum(inside, 0)), np.inf).argmin(axis=1)
            for pixel, contact in zip(pixels, front, strict=True):
                if page.value(f"document.elementFromPoint({pixel[0]}, {pixel[1]})?.tagName") != "CANVAS":
                    continue
                page.drag(pixel)
                assert page.text("#numbers") == scene.contacts.words[contact]
                clicked += 1
        assert page.complaints() == []
    finally:
        page.close()
    assert clicked > 10


def test_every_page_forbids_requests() -> None:
    """Templates of whole pages have a policy, before anything that could ask for something."""
    pages = [path for top in ("viz", "estimator") for path in (ROOT / top).rglob("*.html.j2")]
    whole = [text for path in pages if "<html" in (text := path.read_text(encoding="utf-8"))]
    assert len(whole) == 2
    for text in whole:
        head, _, rest = text.partition("Content-Security-Policy")
        assert rest.startswith("\" content=\"default-src 'none';")
        assert not any(tag in head for tag in ("<script", "<style", "<link", "<img"))
