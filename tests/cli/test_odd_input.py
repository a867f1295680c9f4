"""Input that is odd and may be used, and that what is wrong is refused early; what is refused: tests/hostile."""

from __future__ import annotations

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest

from vbaa_calib.rig import Rig

from .conftest import Call, grey, noise, refused, repaint


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
    rows = list(csv.DictReader(told.read_text().splitlines()))
    assert len(rows) == 4
    assert not any(row["moment_residual_Nm"] for row in rows)


def greened(picture: np.ndarray) -> np.ndarray:
    """What is bright turns green, and as light as the rest: its grey level tells it no more."""
    share = np.clip((picture.astype(float) - 60.0) / 150.0, 0.0, 1.0)[..., None]
    colours = np.array([120.0, 110.0, 115.0]) * (1.0 - share) + np.array([60.0, 130.0, 80.0]) * share
    noise = np.random.default_rng(0).normal(0.0, 2.0, colours.shape)
    return np.clip(np.rint(colours + noise), 0, 255).astype(np.uint8)


def test_an_antenna_that_differs_in_colour_alone_is_learnt_from_the_noload_frames(
    vbaa: Call, made: Path, session: Path, tmp_path: Path
) -> None:
    for name in ("noload", "loads", "recording"):
        repaint(f"{name}/*.png", greened)(session)
    rig = tmp_path / "rig.json"
    assert vbaa("calibrate", session, "-o", rig).code == 0
    assert Rig.load(rig).image.bright is None
    one, other = Rig.load(rig).antenna, Rig.load(made / "rig.json").antenna
    assert one.stiffness_Nm2 == pytest.approx(other.stiffness_Nm2, rel=5e-3)
    assert vbaa("estimate", session, "--rig", rig, "--no-report", "-o", tmp_path / "contacts.csv").code == 0
    rows = list(csv.DictReader((tmp_path / "contacts.csv").read_text().splitlines()))
    assert [row["status"] for row in rows] == ["no_contact", "ok", "ok", "no_contact"]


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
    statuses = [row["status"] for row in csv.DictReader(contacts.read_text().splitlines())]
    assert statuses == ["no_contact", "ok", "ok", "no_contact"]
    cv2.imwrite(str(tmp_path / "small.png"), bars[::2, ::2])
    said = vbaa(*call, tmp_path / "small.png")
    assert said.code == 2
    assert "use the resolution of the calibration" in said.err


def test_a_background_that_cannot_be_learnt_is_left_alone(vbaa: Call, session: Path, rig: Path) -> None:
    """The bench turns with the joints; bars that are carried along with the camera hide behind a resting antenna."""
    call = ("estimate", session, "--rig", rig, "--no-report", "--background", "auto", "--json", "--force", "-o")
    out = session.parent / "contacts.csv"
    plain = vbaa(*call, out)
    assert "background: nothing is taken off: " in plain.err
    bars = np.zeros(Rig.load(rig).camera.image_size[::-1], np.uint8)
    for row in range(20, len(bars), 37):
        cv2.line(bars, (0, row), (bars.shape[1], row + 15), 40, 3)
    for name in ("noload", "recording"):
        repaint(f"{name}/*.png", lambda picture: cv2.add(picture, bars))(session)
    barred = vbaa(*call, out)
    assert "the antenna hardly moves" in barred.result["background"]
    for said in (plain, barred):
        assert said.code == 0, said.err
        assert said.result["status"] == {"no_contact": 2, "ok": 2}


def test_a_frame_without_an_antenna_stays_in_the_table(vbaa: Call, session: Path, rig: Path, tmp_path: Path) -> None:
    repaint("recording/frame_0001.png", grey)(session)
    repaint("recording/frame_0002.png", noise)(session)
    contacts = tmp_path / "contacts.csv"
    assert vbaa("estimate", session, "--rig", rig, "--no-report", "-o", contacts).code == 0
    rows = list(csv.DictReader(contacts.read_text().splitlines()))
    assert [row["frame"] for row in rows] == ["0", "1", "2", "3"]
    assert [row["status"] for row in rows] == ["no_contact", "no_antenna", "no_antenna", "no_contact"]
    assert all(row["reason"] for row in rows)
    said = vbaa("reconstruct", contacts, "--rig", rig, "-o", tmp_path / "object.vtp")
    refused(said, "contacts.csv")
    assert not (tmp_path / "object.vtp").exists()
