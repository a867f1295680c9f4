"""The check report: whole, standalone, true to check.json; and the command around it."""

from __future__ import annotations

import json
import re
from types import SimpleNamespace

import pytest

from vbaa_calib.calibrate.check.assessment import assess
from vbaa_calib.cli.main import main
from viz.pages.page import prose
from viz.report.check import page

from ..calibrate.checked_rigs import QUALITY, rig_of, scene, unchanged


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """A rig.json, a whole session, and what the command says of them."""
    folder = tmp_path_factory.mktemp("check")
    rig, html, out = (folder / name for name in ("rig.json", "report.html", "check.json"))
    rig.write_text(json.dumps(rig_of(scene()).to_dict() | {"quality": QUALITY}))
    argv = ["check", str(rig), str(unchanged()), "--html", str(html), "-o", str(out)]
    assert main(argv) == 0
    return SimpleNamespace(argv=argv, rig=rig, html=html.read_text(), document=json.loads(out.read_text()))


def figures(text: str) -> list[str]:
    """The names of all figures of a page, gauges apart."""
    return re.findall(r'<svg (?!class="gauge")[^>]*aria-label="([^"]*)"', text)


def test_the_page_stands_alone_and_holds_everything(made: SimpleNamespace) -> None:
    text = made.html
    assert not re.search(r"""(src|href)\s*=\s*["'](https?:)?//|@import|url\((?!#)""", text)
    assert not re.search(r"\bnan\b|\binf\b|None", re.sub(r"base64,[^\"]*", "", text))
    assert "This rig holds." in text
    for finding in [*made.document["findings"], *made.document["session_findings"]]:
        assert str(prose(finding["question"])) in text
    # a gauge for each answer with a difference behind it, four figures of boards, three of the antenna, two maps
    assert text.count('class="gauge"') == sum(one["evidence"] is not None for one in made.document["session_findings"])
    assert len(figures(text)) == 9
    assert "board_007.png" in text
    assert "opencv5" in text


def test_the_page_of_a_rig_alone_whatever_its_quality_section(made: SimpleNamespace) -> None:
    quality = {"lens": 3, "plane": [1], "stills": "x", "checks": {"<b>": "<i>"}}
    text = page(assess(made.rig).to_dict() | {"quality": quality})
    assert "Judged by rig.json alone" in text
    assert len(figures(text)) == 2
    assert "Is it still valid?" not in text
    assert "not recorded" in text
    assert "<i>" not in text
