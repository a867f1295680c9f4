"""report.html: whole, standalone, readable, and true to the table."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from markupsafe import Markup, escape

from estimator.contact import overlay
from estimator.contact.estimate import ContactEstimator
from estimator.contact.overlay import _bent, _marks
from estimator.contact.recording import FrameContact, estimate_pictures
from estimator.table.contacts import COLUMNS, STATUSES, ContactRow, ContactTable
from estimator.table.files import write_contacts
from vbaa_calib.calibrate.check.assessment import assess
from vbaa_calib.calibrate.lens.models import LENS_MODELS, camera_of
from vbaa_calib.cli.main import main
from vbaa_calib.rig import Rig
from vbaa_calib.session import load_session, read_recording
from viz.pages.page import _prose
from viz.report.check import page as page_of_check
from viz.report.lens import _maps
from viz.report.make import Sources, make_report
from viz.report.recording import SYMBOLS, Report, page
from viz.report.words import _facts_of, origin
from viz.scene.truth import true_contacts

from ..calibrate.checked_rigs import QUALITY, rig_of, scene, unchanged
from ..small_scene import small_rig
from .estimates import object_estimate

VOID = {"meta", "img", "br", "link", "input"}


class Balanced(HTMLParser):
    """Fails on a tag that is not closed, or closed without being open."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: Any) -> None:
        pass

    def handle_endtag(self, tag: str) -> None:
        assert self.open
        assert self.open.pop() == tag


def text_of(html: str) -> str:
    """What stands on the page, without tags, pictures and style."""
    return re.sub(r"<[^>]*>", " ", re.sub(r"<(style|script)>.*?</\1>|<title>.*?</title>", " ", html, flags=re.DOTALL))


def whole(table: ContactTable, rig: Rig, truth: dict[str, Any], *, determined: bool = True) -> Report:
    """A report with everything in it."""
    estimate = object_estimate(table, determined=determined)
    return Report(
        title="T <1>",
        table=table,
        rig=rig,
        truth=true_contacts(table, truth),
        summary=[("contact point", 0.8, "mm", 1.5), ("force", 9.0, "%", 8.0), ("focal length", 0.1, "%", None)],
        pictures=[Markup("<p>there is none</p>")],
        origin=origin({"contacts": Path("contacts.csv")}, rig, ["vbaa", "report", "a b.csv"]),
        estimate=estimate,
        track=estimate.track,
        facts=_facts_of(estimate),
    )


def test_the_report_stands_alone_and_holds_everything(table: ContactTable, rig: Rig, truth: dict[str, Any]) -> None:
    html = page(whole(table, rig, truth))
    Balanced().feed(html)
    assert not re.search(r"""(src|href)\s*=\s*["'](https?:)?//|@import|url\((?!#)""", html)
    assert "<p>there is none</p>" in html
    assert "nan" not in text_of(html).lower().replace("nanm", "")
    for meaning in (*STATUSES.values(), *(COLUMNS[name].meaning for name in SYMBOLS)):
        assert str(escape(meaning)) in html, "all is explained as in docs/formats.md"
    goals = {
        row: re.findall(r">(met|missed)<", html.partition(f">{row}</td>")[2].partition("</tr>")[0])
        for row in ("contact point", "force", "focal length")
    }
    assert goals == {"contact point": ["met"], "force": ["missed"], "focal length": []}


def test_the_recordings_picture_shows_the_tables_contact(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its numbers, and the antenna as it bends by them: also those of a table that was refined, or of another zero."""
    root = small_rig()
    estimator = ContactEstimator(Rig.load(root / "rig.json"))
    items = list(estimate_pictures(estimator, read_recording(load_session(root / "session"))))
    rows = [ContactRow.of(item.frame, item.contact) for item in items]
    item = max(items, key=lambda item: np.nan_to_num(np.linalg.norm(item.contact.force_N)))

    def shape(by: ContactEstimator, one: FrameContact) -> np.ndarray:
        return _marks(by.rig, one, _bent(by, one)).shape

    fitted = shape(estimator, item)
    drawn: list[tuple[ContactEstimator, FrameContact]] = []
    monkeypatch.setattr(overlay, "frame_picture", lambda *given: drawn.append(given) or np.zeros((8, 8, 3), np.uint8))
    for times in (1.0, 1.5):
        changed = [
            replace(
                row,
                distance_m=row.distance_m - 0.02 * (times - 1.0),
                force_y_N=times * row.force_y_N,
                force_z_N=times * row.force_z_N,
                force_world_N=times * row.force_world_N,
            )
            for row in rows
        ]
        write_contacts(tmp_path / f"{times}.csv", changed)
        files = (tmp_path / f"{times}.csv", root / "rig.json", root / "session")
        joints = ("pan_rad", "tilt_rad")
        readings = {"frames": 4, "moment_Nm": 0, **dict.fromkeys(joints, 0), "assumed_rad": dict.fromkeys(joints, 0.0)}
        sources = Sources(*files, readings=readings)
        make_report(tmp_path / f"{times}.html", sources, title="")
        assert "oment: none; joints: none, taken as 0" in text_of((tmp_path / f"{times}.html").read_text())
    (same_by, same), (by, other) = drawn
    assert same.frame.frame == other.frame.frame == item.frame.frame
    for one, times in ((same, 1.0), (other, 1.5)):
        np.testing.assert_allclose(one.contact.force_N, times * item.contact.force_N, rtol=1e-6, atol=1e-9)
        assert one.contact.distance_m == pytest.approx(item.contact.distance_m - 0.02 * (times - 1.0))
        assert one.contact.reason == item.contact.reason
    np.testing.assert_allclose(shape(same_by, same), fitted, atol=0.3)
    assert np.abs(shape(by, other)[-1] - fitted[-1]).max() > 3.0


@pytest.fixture(scope="module")
def check_page(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
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


def test_the_check_page_stands_alone_and_holds_everything(check_page: SimpleNamespace) -> None:
    text = check_page.html
    assert not re.search(r"""(src|href)\s*=\s*["'](https?:)?//|@import|url\((?!#)""", text)
    assert not re.search(r"\bnan\b|\binf\b|None", re.sub(r"base64,[^\"]*", "", text))
    assert "This rig holds." in text
    for finding in [*check_page.document["findings"], *check_page.document["session_findings"]]:
        assert str(_prose(finding["question"])) in text
    # a gauge for each answer with a difference behind it, four figures of boards, three of the antenna, two maps
    assert text.count('class="gauge"') == sum(
        one["evidence"] is not None for one in check_page.document["session_findings"]
    )
    assert len(figures(text)) == 9
    assert "board_007.png" in text
    assert "opencv5" in text


def test_the_page_of_a_rig_alone_whatever_its_quality_section(check_page: SimpleNamespace) -> None:
    quality = {"lens": 3, "plane": [1], "stills": "x", "checks": {"<b>": "<i>"}}
    text = page_of_check(assess(check_page.rig).to_dict() | {"quality": quality})
    assert "Judged by rig.json alone" in text
    assert len(figures(text)) == 2
    assert "Is it still valid?" not in text
    assert "not recorded" in text
    assert "<i>" not in text


BARREL = np.array([460.0, 458.0, 318.0, 243.0, -0.28, 0.09, 7e-4, -5e-4])


@pytest.fixture(scope="module")
def lens_page(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, dict]:
    """The page, and camera.json."""
    folder, session = tmp_path_factory.mktemp("lens"), small_rig() / "session"
    out, html = folder / "camera.json", folder / "camera.html"
    call = ["intrinsics", str(session / "intrinsics"), "--board", str(session / "session.yaml"), "-o", str(out)]
    assert main([*call, "--html", str(folder / "camera.txt")]) == 2
    assert not out.exists()
    main([*call, "--html", str(html), "--lens-model", "opencv4"])
    return html.read_text(), json.loads(out.read_text())


def test_the_page_stands_alone_and_says_what_the_file_says(lens_page: tuple[str, dict]) -> None:
    text, document = lens_page
    assert not re.search(r"""(src|href)\s*=\s*["'](https?:)?//|@import|url\((?!#)""", text)
    assert not re.search(r"\bnan\b|\binf\b|None", re.sub(r"base64,[^\"]*", "", text))
    head = text.partition("</header>")[0]
    assert document["verdict"].partition(". ")[0] in head
    for one in document["diagnoses"]:
        assert one["words"] in head
    assert text.count('role="img"') == 6
    assert text.count("data:image/jpeg") == 2
    for view in document["views"]:
        assert view["name"] in text


def test_the_map_is_what_moved_lenses_do_to_points_on_a_plane() -> None:
    """One standard deviation of the focal length alone, a turn of the camera left out: by moving the lens."""
    camera = camera_of(LENS_MODELS["opencv4"], BARREL, (640, 480))
    std = np.zeros(8)
    std[:2] = 1e-3 * BARREL[:2]
    covariance = np.outer(std, std)
    plane, _ = _maps(type(camera)(camera.model, camera.image_size, camera.matrix, camera.distortion, covariance), 0.5)
    row, column = 12, 40
    pixel = np.array([plane["columns_px"][column], plane["rows_px"][row]])
    first, second = (one.unproject_normalized(pixel)[0] for one in (camera, camera.moved(std)))
    assert plane["std"][row, column] == pytest.approx(500.0 * float(np.linalg.norm(second - first)), rel=0.1)
