"""The check report: whole, standalone, true to check.json; and the command around it."""

from __future__ import annotations

import copy
import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from vbaa_calib.calibrate.check.assessment import assess
from vbaa_calib.cli.main import main
from viz.check.page import page
from viz.check.pictures import arrows, coverage, heat_map
from viz.check.plots import LEVEL_COLOURS, gauge
from viz.check.tables import fixed, listing, number, records, scaled, with_std
from viz.plots.contours import contour, levels
from viz.plots.svg import Axes, span
from viz.scene.markup import prose

from ..calibrate.checked_rigs import QUALITY, month_later, rig_of, scene


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """A rig.json, a whole session, and what the check says of them."""
    folder = tmp_path_factory.mktemp("check")
    (folder / "rig.json").write_text(json.dumps(rig_of(scene()).to_dict() | {"quality": QUALITY}))
    session = month_later(scene(), folder / "session")
    document = assess(folder / "rig.json", session).to_dict()
    return SimpleNamespace(folder=folder, rig=folder / "rig.json", session=session, document=document)


def pictures(text: str) -> list[ElementTree.Element]:
    """Every SVG of a page, parsed: each must be well formed by itself."""
    return [ElementTree.fromstring(found) for found in re.findall(r"<svg.*?</svg>", text, re.S)]


def test_the_page_stands_alone_and_holds_everything(made: SimpleNamespace) -> None:
    text = page(made.document)
    assert not re.search(r"""(src|href)\s*=\s*["'](https?:)?//|@import|url\(|<script""", text)
    assert not re.search(r"\bnan\b|\binf\b|None", re.sub(r"base64,[^\"]*", "", text))
    assert "This rig holds." in text
    for finding in [*made.document["findings"], *made.document["session_findings"]]:
        assert prose(finding["question"]) in text
    drawn = pictures(text)
    # a gauge for each answer with a difference behind it, four figures of boards, three of the antenna, two maps
    gauges = [one for one in drawn if one.get("class") == "gauge"]
    assert len(gauges) == sum(one["evidence"] is not None for one in made.document["session_findings"])
    assert len(drawn) - len(gauges) == 9
    titles = " ".join(one.get("aria-label") or "" for one in drawn)
    assert "px" in titles
    assert "mm" in titles
    assert "board_007.png" in text
    assert "opencv5" in text


def test_the_page_of_a_rig_alone(made: SimpleNamespace) -> None:
    text = page(assess(made.rig).to_dict())
    assert "Judged by rig.json alone" in text
    assert len(pictures(text)) == 2
    assert "Is it still right?" not in text


def test_the_verdict_and_its_remedy_come_first(made: SimpleNamespace) -> None:
    document = copy.deepcopy(made.document)
    document["session_findings"][2] |= {"level": "does not hold", "remedy": "run `vbaa calibrate` <now>"}
    document |= {"verdict": "does not hold", "headline": "This rig does not hold."}
    head = page(document).partition("</header>")[0]
    assert "This rig does not hold." in head
    assert "run <code>vbaa calibrate</code> &lt;now&gt;" in head
    assert LEVEL_COLOURS["does not hold"] in head


def test_parts_that_were_not_given_say_so(made: SimpleNamespace) -> None:
    document = copy.deepcopy(made.document)
    document["session"] |= {"boards": [], "camera_pose": None, "noload": [], "loads": []}
    text = page(document)
    assert text.count("not given: ") == 4
    assert len(pictures(text)) == 2 + sum(one["evidence"] is not None for one in document["session_findings"])


@pytest.mark.parametrize("quality", [{}, {"lens": 3, "plane": [1], "stills": "x", "checks": {"<b>": "<i>"}}])
def test_a_page_of_any_quality_section(made: SimpleNamespace, quality: dict[str, Any]) -> None:
    text = page(made.document | {"quality": quality})
    assert "not recorded" in text
    assert "<i>" not in text


def test_the_command_writes_what_it_prints(
    made: SimpleNamespace, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    html, out = tmp_path / "report.html", tmp_path / "check.json"
    argv = ["check", str(made.rig), str(made.session), "--html", str(html), "-o", str(out), "--json"]
    assert main(argv) == 0
    said = capsys.readouterr()
    assert json.loads(said.out) == json.loads(out.read_text())
    assert json.loads(said.out)["verdict"] == "holds"
    assert "verdict        holds" in said.err
    assert html.read_text() == page(json.loads(out.read_text()))
    assert main(argv) == 2
    assert "exists already" in capsys.readouterr().err


def test_a_rig_that_does_not_hold_is_no_error(made: SimpleNamespace, tmp_path: Path) -> None:
    data = json.loads(made.rig.read_text())
    data["moment_sensor"]["gain"] = -1.0
    (tmp_path / "rig.json").write_text(json.dumps(data))
    assert main(["check", str(tmp_path / "rig.json")]) == 0
    assert assess(tmp_path / "rig.json").verdict == "does not hold"


WRONG = [
    (["{folder}/nowhere.json"], "no such file"),
    (["{folder}"], "is a folder"),
    (["{folder}/broken.json"], "is not valid JSON"),
    (["{folder}/empty.json"], "schema is None"),
    (["{folder}/list.json"], "must be a JSON object"),
    (["{folder}/short.json"], "antenna is missing"),
    (["{rig}", "{folder}/nowhere"], "no such folder"),
    (["{rig}", "{folder}/session/session.yaml"], "is not a folder"),
    (["{rig}", "{folder}/bare"], "no such file"),
    (["{rig}", "{folder}/noparts"], "has none of intrinsics, plane, noload, loads"),
    (["{rig}", "{folder}/nopictures"], "holds no pictures"),
    (["{rig}", "{folder}/notable"], "noload.csv: no such file"),
    (["{rig}", "--html", "{folder}/report.txt"], "is not a .html"),
    (["{rig}", "-o", "{folder}/check.yaml"], "is not a .json"),
    (["{rig}", "-o", "{folder}/nowhere/check.json"], "its folder does not exist"),
    ([], "required: rig"),
]


@pytest.mark.parametrize(("argv", "line"), WRONG, ids=[line for _, line in WRONG])
def test_what_is_wrong_ends_in_one_line(
    made: SimpleNamespace, capsys: pytest.CaptureFixture[str], argv: list[str], line: str
) -> None:
    folder, good = made.folder, json.loads(made.rig.read_text())
    (folder / "broken.json").write_text("{")
    (folder / "empty.json").write_text("{}")
    (folder / "list.json").write_text("[]")
    (folder / "short.json").write_text(json.dumps({key: good[key] for key in good if key != "antenna"}))
    for name in ("bare", "noparts", "nopictures/plane", "notable/noload"):
        (folder / name).mkdir(parents=True, exist_ok=True)
        if name != "bare":
            settings = (made.session / "session.yaml").read_text()
            (folder / name.partition("/")[0] / "session.yaml").write_text(settings)
    assert main(["check", *(part.format(folder=folder, rig=made.rig) for part in argv)]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert line in said.err.splitlines()[-1]
    assert "Traceback" not in said.err


def test_contours_lie_where_the_value_is() -> None:
    x, y = np.linspace(-2, 2, 41), np.linspace(-1.5, 1.5, 31)
    values = np.hypot(*np.meshgrid(x, y))
    pieces = contour(x, y, values, 1.0)
    np.testing.assert_allclose(np.linalg.norm(pieces, axis=-1), 1.0, atol=2e-3)
    # together they are the whole circle
    assert np.linalg.norm(pieces[:, 0] - pieces[:, 1], axis=-1).sum() == pytest.approx(2 * np.pi, rel=0.01)
    values[:, :20] = np.nan
    assert (contour(x, y, values, 1.0)[..., 0] >= 0.0).all()
    assert contour(x, y, values, 99.0).shape == (0, 2, 2)


@pytest.mark.parametrize(("low", "high"), [(0.065, 0.091), (0.005, 0.07), (1e-3, 40.0), (0.5, 0.5), (0.0, 1.0)])
def test_levels_are_few_and_inside(low: float, high: float) -> None:
    found = levels(low, high)
    assert all(low < level < high for level in found)
    assert len(found) <= 7
    assert bool(found) == (0 < low < high)


def test_a_map_of_nothing_is_still_a_picture() -> None:
    data = {"columns_px": [0, 1, 2], "rows_px": [0, 1], "unit": "mm", "has_ray": [[True, False, True]] * 2}
    empty = heat_map("m", data | {"std": [[None] * 3] * 2}, (3, 2))
    assert "stroke-dasharray" in empty
    ElementTree.fromstring(empty)
    ElementTree.fromstring(heat_map("m", data | {"std": [[1.0] * 3] * 2}, (3, 2)))


def test_arrows_point_from_predicted_to_seen_enlarged() -> None:
    board = {"folder": "plane", "corners_px": [[100.0, 50.0]], "residuals_px": [[0.2, -0.1]], "good": [True]}
    drawn = ElementTree.fromstring(arrows([board], (400, 300)))
    factor = float(re.findall(r"([\d.]+) times", drawn.get("aria-label") or "")[0])
    path = next(one.get("d", "") for one in drawn.findall("path"))
    x0, y0, x1, y1 = map(float, re.findall(r"[\d.]+", path))
    scale = 420 / 400
    assert x1 - x0 == pytest.approx(scale * factor * 0.2, abs=0.11)
    assert y1 - y0 == pytest.approx(-scale * factor * 0.1, abs=0.11)


def test_the_coverage_counts_every_corner() -> None:
    points = np.random.default_rng(0).uniform(0, 1, (500, 2)) * [399, 299]
    drawn = ElementTree.fromstring(coverage(points, (400, 300)))
    fields = [one for one in drawn.findall("rect") if one.find("title") is not None]
    counts = [int(one.findtext("title", "").split()[0]) for one in fields]
    assert len(counts) == 48
    assert sum(counts) == 500


@pytest.mark.parametrize("distance", [0.0, 3.5, 1e6])
def test_the_gauge_stays_in_its_frame(distance: float) -> None:
    drawn = ElementTree.fromstring(gauge({"distance_std": distance, "look_from_std": 3.0, "fails_from_std": 5.0}))
    line = drawn.find("line")
    assert line is not None
    assert float(line.get("x1", "")) == pytest.approx(200 * min(distance, 7.5) / 7.5, abs=0.06)


def test_axes_place_what_their_ticks_say() -> None:
    up, down = Axes((0.0, 10.0), (0.0, 5.0)), Axes((0.0, 10.0), (0.0, 5.0), downward=True)
    assert up.down(0.0) > up.down(5.0)
    assert down.down(0.0) < down.down(5.0)
    drawn = ElementTree.fromstring(up.drawing(up.frame("t", "x, mm", "y, px"), "t"))
    at = {one.text: float(one.get("x", "")) for one in drawn.findall("text") if one.get("text-anchor") == "middle"}
    assert at["4"] == pytest.approx(float(up.across(4.0)), abs=0.06)
    low, high = span(np.array([np.nan, 2.0, 2.0]))
    assert low < 2.0 < high
    assert span(np.array([])) == (-0.08, 1.08)


def test_numbers_as_a_person_writes_them() -> None:
    assert with_std(-3.76434e-3, 5.2e-7, 1e3) == "−3.76434 <small>± 0.00052</small>"
    assert with_std(12.3456, 3.0) == "12.3 <small>± 3.0</small>"
    assert with_std(2.5, None) == "2.5"
    assert number(None) == number(float("nan")) == "–"
    assert number(-0.00012345) == "−0.0001234"
    rows = records([{"a": "<x>", "b": 1.25}, 7, {"a": None}], (("a", "A", None), ("b", "B", 1)))
    assert "&lt;x&gt;" in rows
    assert rows.count("<tr>") == 3
    told = listing({"shift_m": 1e-3, "deep": {"turn_rad": [1e-3, 2e-3]}, "way": "jig", "cov": [[1.0]]})
    assert re.search(r"shift</td><td class=\"\">1</td><td class=\"\">mm<", told)
    assert re.search(r"deep · turn</td><td class=\"\">1, 2</td><td class=\"\">mrad<", told)
    assert "cov" not in told
    told = listing({"drift_Nm_per_row": {"value": 2e-6}, "mass_kg_m": {"std": 1e-3}})
    assert re.search(r"drift · value</td><td class=\"\">2</td><td class=\"\">µN·m per row<", told)
    assert re.search(r"mass · std</td><td class=\"\">1</td><td class=\"\">g/m<", told)
    assert fixed(-0.0004, 2) == "0.00"
    assert scaled([{"a": 2.0}, {"a": "x"}, 3], "a", 10.0) == [{"a": 20.0}, {"a": "x"}]
