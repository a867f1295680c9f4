"""report.html: whole, standalone, and true to the table."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estimator.table import STATUSES, ContactTable
from vbaa_calib.errors import InputError
from viz.report import STATUS_COLOURS, write_report
from viz.svg import curve, runs, strip, ticks

PNG = b"\x89PNG\r\n\x1a\n rest"


def test_the_report_stands_alone_and_holds_everything(
    table: ContactTable, truth: dict[str, Any], tmp_path: Path
) -> None:
    (tmp_path / "scene.png").write_bytes(PNG)
    summary = [("contact point", 0.8, "mm", 1.5), ("force", 9.0, "%", 8.0), ("focal length", 0.1, "%", None)]
    write_report(tmp_path / "report.html", "T <1>", tmp_path / "scene.png", table, truth, summary)
    page = (tmp_path / "report.html").read_text()
    assert not re.search(r"""(src|href)\s*=\s*["'](https?:)?//|@import|url\(""", page)
    assert "data:image/png;base64,iVBORw0KGgo" in page
    assert "T &lt;1&gt;" in page
    assert "&lt;the fit&gt; did not converge" in page
    verdicts = {
        row: re.findall(r">(met|missed)<", page.partition(f">{row}<")[2].partition("</tr>")[0]) for row, *_ in summary
    }
    assert verdicts == {"contact point": ["met"], "force": ["missed"], "focal length": []}
    assert page.count("<svg") == 4
    assert page.count("<tr>") == 92 + 1 + 3 + 1
    assert "nan" not in re.sub(r"base64,[^\"]*", "", page).lower()
    assert "92 frames in 3.1 s, 90 with a located contact" in page


def test_a_report_without_picture_truth_and_summary(table: ContactTable, tmp_path: Path) -> None:
    write_report(tmp_path / "report.html", "bare", None, table)
    page = (tmp_path / "report.html").read_text()
    assert "<img" not in page
    assert ">truth<" not in page
    with pytest.raises(InputError, match="exists already"):
        write_report(tmp_path / "report.html", "bare", None, table)


def test_wrong_pictures_and_truths_are_refused(table: ContactTable, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        write_report(tmp_path / "report.html", "x", tmp_path / "none.png", table)
    (tmp_path / "scene.png").write_text("junk")
    with pytest.raises(InputError, match="is not a PNG"):
        write_report(tmp_path / "report.html", "x", tmp_path / "scene.png", table)
    with pytest.raises(InputError, match="frames are not as expected"):
        write_report(tmp_path / "report.html", "x", None, table, {"frames": [{"frame": 0}]})
    assert not (tmp_path / "report.html").exists()


def test_every_status_has_its_own_colour() -> None:
    assert set(STATUS_COLOURS) == set(STATUSES)
    assert len(set(STATUS_COLOURS.values())) == len(STATUSES)


def test_a_curve_puts_points_where_their_values_are() -> None:
    frame = np.arange(6)
    value = np.array([1.0, 2.0, np.nan, 4.0, np.nan, 3.0])
    picture = ElementTree.fromstring(curve("force", "mN", frame, value, np.full(6, 0.1), value + 0.05))
    circles = picture.findall("circle")
    x, y = (np.array([float(circle.get(key, "")) for circle in circles]) for key in ("cx", "cy"))
    np.testing.assert_allclose(np.corrcoef(y, [1, 2, 4, 3])[0, 1], -1.0, atol=1e-4)
    np.testing.assert_allclose(np.diff(x) / np.diff(x)[0], [1.0, 2.0, 2.0], atol=0.01)
    assert len(picture.findall("polygon")) == 3
    assert len(picture.findall("polyline")) == 3


@pytest.mark.parametrize("value", [np.full(4, np.nan), np.full(4, 3.0), np.zeros(4)])
def test_a_curve_of_nothing_or_of_one_value_is_still_a_picture(value: np.ndarray) -> None:
    picture = ElementTree.fromstring(curve("force", "mN", np.arange(4), value, np.full(4, np.nan)))
    assert len(picture.findall("circle")) == np.isfinite(value).sum()


def test_one_frame_is_enough() -> None:
    ElementTree.fromstring(curve("force", "mN", np.array([7]), np.array([1.0]), np.array([0.1])))
    ElementTree.fromstring(strip("status", np.array([7]), ["ok"], STATUS_COLOURS))


def test_the_strip_has_a_cell_per_frame() -> None:
    picture = ElementTree.fromstring(strip("status", np.array([0, 1, 5]), ["ok", "failed", "ok"], STATUS_COLOURS))
    cells = [cell for cell in picture.findall("rect") if cell.find("title") is not None]
    assert [cell.get("fill") for cell in cells] == [STATUS_COLOURS[s] for s in ("ok", "failed", "ok")]


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (-3e-4, 8e-4), (144.0, 168.0), (-75.0, 71.0)])
def test_ticks_are_round_and_inside(low: float, high: float) -> None:
    found = ticks(low, high)
    assert 2 <= len(found) <= 7
    assert min(found) >= low - 1e-12
    assert max(found) <= high + 1e-12
    assert all(float(f"{tick:.2g}") == pytest.approx(tick, abs=1e-12) for tick in np.diff(found))


def test_runs_are_the_unbroken_stretches() -> None:
    assert [run.tolist() for run in runs(np.array([1, 1, 0, 1, 0, 0, 1], bool))] == [[0, 1], [3], [6]]
    assert runs(np.zeros(3, bool)) == []
