"""Input that is odd and may be used, rigs that may not, and pictures of what was seen; refusals: tests/hostile."""

from __future__ import annotations

import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from vbaa_calib.core.errors import Diagnosis, Verdict
from vbaa_calib.rig import Rig

from ..csv_files import read_rows, write_rows
from .conftest import PICTURES, Call, grey, noise, refused, repaint


def test_vision_alone(vbaa: Call, session: Path, rig: Path, tmp_path: Path) -> None:
    """Without the moments, by the option or in the table, the contacts are the same."""
    told, silent = tmp_path / "told.csv", tmp_path / "silent.csv"
    call = ("estimate", session, "--rig", rig, "--no-report", "-o")
    said = vbaa(*call, told, "--no-moment")
    assert said.code == 0
    assert "moment reading" not in said.err
    path = session / "recording" / "recording.csv"
    path.write_text("".join(line.rpartition(",")[0] + "\n" for line in path.read_text().splitlines()))
    said = vbaa(*call, silent)
    assert said.code == 0
    assert "4 of 4 frames have no moment reading: vision alone there" in said.err
    assert told.read_text() == silent.read_text()
    rows = read_rows(told)
    assert len(rows) == 4
    assert not any(row["moment_residual_Nm"] for row in rows)


def test_a_background_is_taken_off_every_picture(vbaa: Call, session: Path, rig: Path, tmp_path: Path) -> None:
    """Bars lie across the antenna; the picture without it shows them too."""
    usual = cv2.imread(str(next((session / "recording").glob("*.png"))), cv2.IMREAD_GRAYSCALE)
    bars = np.zeros_like(usual)
    for row in range(20, len(usual), 37):
        cv2.line(bars, (0, row), (usual.shape[1], row + 15), 40, 3)
    repaint("recording/*.png", lambda picture: cv2.add(picture, bars))(session)
    cv2.imwrite(str(tmp_path / "empty.png"), bars + np.uint8(np.median(usual)))
    contacts = tmp_path / "contacts.csv"
    call = ("estimate", session, "--rig", rig, "--no-report", "-o", contacts, "--force", "--background")
    assert vbaa(*call, tmp_path / "empty.png").code == 0
    statuses = [row["status"] for row in read_rows(contacts)]
    assert statuses == ["no_contact", "ok", "ok", "no_contact"]
    cv2.imwrite(str(tmp_path / "small.png"), bars[::2, ::2])
    said = vbaa(*call, tmp_path / "small.png")
    assert said.code == 2
    assert "use the resolution of the calibration" in said.err


def test_a_frame_without_an_antenna_stays_in_the_table(vbaa: Call, session: Path, rig: Path, tmp_path: Path) -> None:
    repaint("recording/frame_0001.png", grey)(session)
    repaint("recording/frame_0002.png", noise)(session)
    contacts = tmp_path / "contacts.csv"
    assert vbaa("estimate", session, "--rig", rig, "--no-report", "-o", contacts).code == 0
    rows = read_rows(contacts)
    assert [row["frame"] for row in rows] == ["0", "1", "2", "3"]
    assert [row["status"] for row in rows] == ["no_contact", "no_antenna", "no_antenna", "no_contact"]
    assert all(row["reason"] for row in rows)
    said = vbaa("reconstruct", contacts, "--rig", rig, "-o", tmp_path / "object.vtp")
    refused(said, "contacts.csv")
    assert not (tmp_path / "object.vtp").exists()


VERBS = {
    "estimate": ("estimate", "SESSION", "--rig", "RIG", "-o", "OUT", "--report", "PAGE"),
    "live": ("live", "RIG", "SESSION/recording/recording.csv", "--output", "OUT"),
    "batch": ("batch", "SESSION", "--rig", "RIG", "-o", "OUT"),
    "export": ("export", "RIG", "--to", "json", "-o", "OUT"),
    "refine": ("refine", "CONTACTS", "--rig", "RIG", "--session", "SESSION", "-o", "OUT"),
}
"""The calls that use a rig to measure."""


def rewritten(path: Path, **factors: float) -> None:
    """A table with columns multiplied."""
    rows = read_rows(path)
    write_rows(path, [row | {name: float(row[name]) * by for name, by in factors.items()} for row in rows])


def test_a_wrong_calibration_says_so_everywhere(vbaa: Call, session: Path, rig: Path, tmp_path: Path) -> None:
    """Loads ten times too large: terminal, --json, rig.json, check and exit code agree, and the files are there."""
    rewritten(session / "loads" / "loads.csv", force_y_N=10.0, force_z_N=10.0)
    wrong = tmp_path / "wrong.json"
    said = vbaa("calibrate", session, "-o", wrong, "--json")
    verdict = json.loads(wrong.read_text())["verdict"]
    assert said.code == 1
    assert verdict["severity"] == "wrong"
    assert said.result["verdict"] == verdict
    assert verdict["findings"][0]["severity"] == "wrong"
    assert f"wrong      {verdict['findings'][0]['words']}" in said.err
    assert Rig.load(wrong).verdict.to_dict() == verdict
    assert vbaa("check", wrong).code == 1
    refused(vbaa("estimate", session, "--rig", wrong, "-o", tmp_path / "c.csv"), "wrong.json", "--accept-rig")
    assert not (tmp_path / "c.csv").exists()
    sound = json.loads(rig.read_text())["verdict"]
    assert sound["severity"] != "wrong"


@pytest.mark.parametrize("verb", VERBS)
def test_a_wrong_rig_is_refused_unless_accepted(
    verb: str, vbaa: Call, session: Path, rig: Path, tmp_path: Path
) -> None:
    contacts, out = tmp_path / "contacts.csv", tmp_path / "out"
    if verb == "refine":
        assert vbaa("estimate", session, "--rig", rig, "-o", contacts, "--no-report").code == 0
    finding = Diagnosis("joints", "pan and tilt were exchanged", "exchange the columns", "wrong")
    document = json.loads(rig.read_text()) | {"verdict": Verdict.of([finding]).to_dict()}
    rig.write_text(json.dumps(document))
    suffix = {"batch": ""}.get(verb, ".csv")
    named = {
        "SESSION": session,
        "RIG": rig,
        "CONTACTS": contacts,
        "OUT": out.with_suffix(suffix),
        "PAGE": tmp_path / "page.html",
    }
    call = [str(named.get(word, word)).replace("SESSION", str(session)) for word in VERBS[verb]]
    refused(vbaa(*call), "rig.json", "pan and tilt were exchanged", "exchange the columns", "--accept-rig")
    assert not named["OUT"].exists()
    if verb != "batch":  # processes of its own
        accepted = vbaa(*call, "--accept-rig")
        assert accepted.code == 0, accepted.err
        assert "pan and tilt were exchanged" in accepted.err
    if verb == "estimate":
        assert "pan and tilt were exchanged" in named["PAGE"].read_text()


def left(folder: Path) -> set[str]:
    """What is in a folder, hidden files too."""
    return {path.name for path in folder.iterdir()}


@pytest.fixture
def drawn(vbaa: Call, session: Path, rig: Path, tmp_path: Path) -> Call:
    """`vbaa estimate` of the session to contacts.csv with an overlay."""
    call = ("estimate", session, "--rig", rig, "--no-report", "-o", tmp_path / "contacts.csv", "--overlay")
    return lambda *more: vbaa(*call, *more)


def test_every_frame_has_its_picture_and_its_place_on_the_page(
    vbaa: Call, drawn: Call, session: Path, rig: Path, tmp_path: Path
) -> None:
    repaint(PICTURES["recording"], noise)(session)
    target, contacts, plain = tmp_path / "seen", tmp_path / "contacts.csv", tmp_path / "plain.csv"
    said = drawn(target, "--json")
    assert said.code == 0, said.err
    assert vbaa("estimate", session, "--rig", rig, "--no-report", "-o", plain).code == 0
    assert plain.read_bytes() == contacts.read_bytes()
    assert said.result["overlay"] == str(target)
    rows = read_rows(contacts)
    expected = [f"frame_{int(row['frame']):06d}_{row['status']}.jpg" for row in rows]
    assert {row["status"] for row in rows} >= {"ok", "no_antenna"}
    assert left(target) == {*expected, "thumbnails", "index.html"}
    assert left(target / "thumbnails") == set(expected)
    assert all(cv2.imread(str(target / name)).shape[1] == 960 for name in expected)
    page = (target / "index.html").read_text()
    assert re.findall(r'href="([^"]+)"', page) == expected
    assert set(re.findall(r'(?:src|href)="([^"]+)"', page)) == {*expected, *(f"thumbnails/{name}" for name in expected)}
    assert not re.search(r"<script|https?:|url\(|@import", page)
    for status in {row["status"] for row in rows}:
        assert f"#only-{status}:checked ~ .frames a:not(.{status})" in page
        assert f'<input type="radio" name="status" id="only-{status}"' in page


def test_look_says_what_is_seen(vbaa: Call, session: Path, rig: Path, tmp_path: Path) -> None:
    image = session / PICTURES["noload"]
    said = vbaa("look", image, "--rig", rig, "-o", tmp_path / "look.png", "--json")
    assert said.code == 0, said.err
    result = said.result
    assert (result["verdict"], result["end"], result["bright"]) == ("ok", "tip", True)
    assert result["seen"] > 0.8
    assert 0.005 < result["sigma_median_px"] < 0.2
    assert "verdict  ok" in said.err
    assert "of its length seen" in said.err
    assert "brighter than its surroundings" in said.err
    drawn = cv2.imread(str(tmp_path / "look.png"))
    end = np.rint(2 * np.array(result["end_px"])).astype(int)
    ring = drawn[end[1] - 8 : end[1] + 9, end[0] - 8 : end[0] + 9]
    assert (ring.min(axis=-1) > 200).sum() > 20
