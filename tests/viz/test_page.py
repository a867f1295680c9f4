"""The page: whole, offline, with its legend."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from markupsafe import escape

from viz.parts.assemble import all_parts
from viz.render.page import _CLEAR, _ICON, write_page
from viz.scene.readable import MODES
from viz.scene.scene import Scene

ROOT = Path(__file__).parents[2]


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


def test_every_page_forbids_requests() -> None:
    """Templates of whole pages have a policy, before anything that could ask for something."""
    pages = [path for top in ("viz", "estimator") for path in (ROOT / top).rglob("*.html.j2")]
    whole = [text for path in pages if "<html" in (text := path.read_text(encoding="utf-8"))]
    assert len(whole) == 2
    for text in whole:
        head, _, rest = text.partition("Content-Security-Policy")
        assert rest.startswith("\" content=\"default-src 'none';")
        assert not any(tag in head for tag in ("<script", "<style", "<link", "<img"))
