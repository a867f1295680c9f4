"""The session folder as the wizard's memory: what it says it has is on the disk, and nothing is ever deleted."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from vbaa_calib.sources.files import Picture
from vbaa_calib.wizard.store import Store, _Journal

IMAGE = np.zeros((2, 3), np.uint8)


def picture(name: str, content: bytes | None = None, suffix: str = ".png") -> Picture:
    return Picture(name, IMAGE, suffix, name.encode() if content is None else content)


def on_disk(store: Store) -> _Journal:
    return _Journal.read(store.root / "wizard.json")


@pytest.fixture
def store(tmp_path: Path) -> Store:
    with Store(tmp_path / "session") as store:
        return store


def test_names_never_meet(store: Store) -> None:
    """Neither a picture that somebody put there nor one that was dropped is ever written over."""
    (store.root / "intrinsics").mkdir()
    (store.root / "intrinsics" / "0001.jpg").write_bytes(b"mine")
    files = [store.take("lens", picture(name), {}).file for name in ("a", "b", "c")]
    assert files == [f"intrinsics/000{number}.png" for number in (2, 3, 4)]
    store.drop("lens", store.journal.of("lens").taken[0])
    assert store.take("lens", picture("d"), {}).file == "intrinsics/0005.png"
    assert (store.root / "intrinsics" / "0001.jpg").read_bytes() == b"mine"


def test_redo_keeps_the_old_with_its_readings(store: Store) -> None:
    readings = {"pan_rad": 0.0, "tilt_rad": 0.5, "moment_Nm": 1.0}
    for name in ("a", "b"):
        store.take("noload", picture(name), readings)
    store.answer({"gravity": "x", "antenna_diameter_mm": 1.0})
    place = store.redo("noload", forget=["gravity"])
    assert sorted(path.read_bytes() for path in place.glob("*.png")) == [b"a", b"b"]
    assert json.loads((place / "was.json").read_text())["taken"][0]["readings"] == readings
    assert on_disk(store).of("noload").judged == frozenset()
    assert on_disk(store).answers == {"antenna_diameter_mm": 1.0}
    store.take("noload", picture("c"), readings)
    again = store.redo("noload")
    assert again not in (None, place)
    assert store.redo("noload") is None


def test_only_what_is_half_written_is_swept_up(tmp_path: Path) -> None:
    """Names as the wizard's own writes leave them; a user's hidden files are none."""
    (tmp_path / "intrinsics").mkdir()
    half = [".wizard-ab12cd_9.json", "intrinsics/.0001-abcdefgh.png"]
    kept = [".rig-old.json", ".session-backup.yaml", ".0001-x.png", "intrinsics/.mine.png", ".notes-abcdefgh.txt"]
    for name in (*half, *kept):
        (tmp_path / name).write_text("x")
    with Store(tmp_path):
        pass
    there = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob(".*")} - {".wizard-lock"}
    assert there == set(kept)
