"""The page: whole, offline, with its legend, and alive in a browser."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from markupsafe import escape

from viz.parts.assemble import all_parts
from viz.render.page import _CLEAR, _ICON, write_page
from viz.scene.readable import MODES
from viz.scene.scene import Scene

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


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
    options = ["--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    address = f"{written.as_uri()}#moment={moment}&colour={colour}&all=0"
    command = [str(BROWSER), *options, "--virtual-time-budget=15000", "--dump-dom", address]
    shown = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout
    assert scene.instants.words[moment] in shown.partition('id="words"')[2][:200]
    assert f"frame {scene.instants.frame[moment]}" in shown
    assert 'id="silent" hidden' in shown
    assert 'id="seen" hidden' not in shown
