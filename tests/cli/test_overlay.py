"""`vbaa estimate --overlay` and `vbaa look`: pictures for every frame, whole or not at all, and a verdict in words."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from .conftest import PICTURES, Call, noise, repaint


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
    with contacts.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
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


def test_look_with_the_empty_scene_taken_off(vbaa: Call, session: Path, rig: Path, tmp_path: Path) -> None:
    image, clutter = session / PICTURES["noload"], tmp_path / "clutter.png"
    picture = cv2.imread(str(image), cv2.IMREAD_GRAYSCALE)
    stripes = np.zeros(picture.shape, np.int32)
    for row in range(4, len(stripes), 11):  # bars all along the antenna
        cv2.line(stripes, (0, row), (picture.shape[1], row + 6), 70, 2)
    cv2.imwrite(str(clutter), np.clip(stripes + 60, 0, 255).astype(np.uint8))
    cv2.imwrite(str(image), np.clip(stripes + picture, 0, 255).astype(np.uint8))
    bare = vbaa("look", image, "--rig", rig, "--json").result
    helped = vbaa("look", image, "--rig", rig, "--background", clutter, "--json").result
    assert helped["verdict"] == "ok"
    assert helped["seen"] > bare["seen"] + 0.1
