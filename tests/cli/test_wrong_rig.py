"""A calibration whose verdict is wrong ends with exit code 1, and no verb uses its rig unless the user accepts it."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from vbaa_calib.core.errors import Diagnosis, SolveError, Verdict
from vbaa_calib.core.files import write_json
from vbaa_calib.rig import Rig

from .conftest import Call, refused

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
    rows = list(csv.DictReader(path.open()))
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(row | {name: float(row[name]) * factor for name, factor in factors.items()} for row in rows)


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


def test_other_verbs_use_a_wrong_rig_and_say_so(vbaa: Call, session: Path, rig: Path) -> None:
    finding = Diagnosis("joints", "pan and tilt were exchanged", "exchange the columns", "wrong")
    rig.write_text(json.dumps(json.loads(rig.read_text()) | {"verdict": Verdict.of([finding]).to_dict()}))
    seen = vbaa("look", session / "noload" / "noload_001.png", "--rig", rig)
    assert seen.code == 0
    assert "pan and tilt were exchanged" in seen.err


def test_the_verdict_survives_reading_and_writing(rig: Path) -> None:
    """And a rig.json of an older version, without one, has none."""
    findings = [Diagnosis("a", "b", "c"), Diagnosis("d", "e", "f", "note"), Diagnosis("g", "h", "i", "wrong")]
    verdict = Verdict.of(findings)
    assert (verdict.severity, verdict.findings[0].name) == ("wrong", "g")
    document = json.loads(rig.read_text())
    assert Rig.from_dict(document | {"verdict": verdict.to_dict()}).verdict == verdict
    del document["verdict"]
    assert Rig.from_dict(document).verdict == Verdict()


def test_nothing_is_written_that_cannot_be_read_again(rig: Path, tmp_path: Path) -> None:
    document, out = json.loads(rig.read_text()), tmp_path / "out.json"
    document["joint"]["covariance"][0][0] = 1e13
    with pytest.raises(SolveError, match="not written"):
        write_json(out, document, readable_as=Rig.from_dict)
    assert not out.exists()
