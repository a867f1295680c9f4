"""The session folder as the wizard's memory: what it says it has is on the disk, and nothing is ever deleted."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import sha256
from vbaa_calib.wizard.sources.picture import Picture
from vbaa_calib.wizard.state.journal import Journal
from vbaa_calib.wizard.state.store import Store

IMAGE = np.zeros((2, 3), np.uint8)


def picture(name: str, content: bytes | None = None, suffix: str = ".png") -> Picture:
    return Picture(name, IMAGE, suffix, name.encode() if content is None else content)


def on_disk(store: Store) -> Journal:
    return Journal.read(store.root / "wizard.json")


@pytest.fixture
def store(tmp_path: Path) -> Store:
    with Store(tmp_path / "session") as store:
        return store


def test_a_taken_picture_is_on_the_disk_byte_by_byte_before_it_is_said(store: Store) -> None:
    first = store.take("lens", picture("IMG 1.JPG", b"\xff\xd8", ".JPG"), {})
    second = store.take("noload", picture("a.png"), {"pan_rad": 0.1, "tilt_rad": 0.2, "moment_Nm": 0.1 + 0.2})
    assert (first.file, second.file) == ("intrinsics/0001.jpg", "noload/0001.png")
    assert store.path(first).read_bytes() == b"\xff\xd8"
    assert first.sha256 == hashlib.sha256(b"\xff\xd8").hexdigest() == sha256(store.path(first))
    assert on_disk(store).to_dict() == store.journal.to_dict()
    assert on_disk(store).of("noload").taken[0].readings["moment_Nm"] == 0.1 + 0.2


def test_names_never_meet(store: Store) -> None:
    """Neither a picture that somebody put there nor one that was dropped is ever written over."""
    (store.root / "intrinsics").mkdir()
    (store.root / "intrinsics" / "0001.jpg").write_bytes(b"mine")
    files = [store.take("lens", picture(name), {}).file for name in ("a", "b", "c")]
    assert files == [f"intrinsics/000{number}.png" for number in (2, 3, 4)]
    store.drop("lens", store.journal.of("lens").taken[0])
    assert store.take("lens", picture("d"), {}).file == "intrinsics/0005.png"
    assert (store.root / "intrinsics" / "0001.jpg").read_bytes() == b"mine"


def test_a_dropped_picture_is_kept_and_not_offered_again(store: Store) -> None:
    store.take("lens", picture("a"), {})
    store.close("lens", "enough")
    place = store.drop("lens", store.journal.of("lens").taken[0])
    assert place.read_bytes() == b"a"
    record = on_disk(store).of("lens")
    assert (record.taken, record.closed, record.judged) == ((), "", {"a"})


def test_redo_keeps_the_old_with_its_readings(store: Store) -> None:
    readings = {"pan_rad": 0.0, "tilt_rad": 0.5, "moment_Nm": 1.0}
    for name in ("a", "b"):
        store.take("noload", picture(name), readings)
    store.answer({"gravity": "x", "antenna_diameter_mm": 1.0})
    place = store.redo("noload", forget=["gravity"])
    assert place is not None
    assert sorted(path.read_bytes() for path in place.glob("*.png")) == [b"a", b"b"]
    assert json.loads((place / "was.json").read_text())["taken"][0]["readings"] == readings
    assert on_disk(store).of("noload").judged == frozenset()
    assert on_disk(store).answers == {"antenna_diameter_mm": 1.0}
    store.take("noload", picture("c"), readings)
    again = store.redo("noload")
    assert again not in (None, place)
    assert store.redo("noload") is None
    assert on_disk(store).redone == ("noload", "noload", "noload")


def test_missing_and_changed_pictures(store: Store) -> None:
    gone, changed, whole = (store.take("lens", picture(name), {}) for name in "abc")
    store.close("lens", "enough")
    store.path(gone).unlink()
    store.path(changed).write_bytes(b"x")
    assert store.lost() == [gone, changed]
    store.forget([gone, changed])
    assert on_disk(store).of("lens").taken == (whole,)
    assert on_disk(store).of("lens").closed == ""
    assert store.unlisted() == [store.path(changed)]


def test_ways_that_were_not_chosen_are_unlisted(store: Store) -> None:
    """But for those that came with a session."""
    for way in ("plane", "sweep", "over"):
        (store.root / way).mkdir()
    store.answer({"plane_way": "sweep"})
    assert {path.name for path in store.unlisted()} == {"plane", "over"}
    store.answer({"jig_given": True})
    assert store.unlisted() == []


def test_what_is_put_aside_is_never_written_over(store: Store) -> None:
    for content in (b"1", b"2"):
        (store.root / "intrinsics").mkdir(exist_ok=True)
        (store.root / "intrinsics" / "x.png").write_bytes(content)
        store.set_aside(store.unlisted(), "found")
    found = [path.read_bytes() for path in sorted((store.root / "aside").rglob("x.png"))]
    assert sorted(found) == [b"1", b"2"]


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


def test_one_at_a_time(tmp_path: Path) -> None:
    words = "another wizard works on this session"
    with Store(tmp_path), pytest.raises(InputError, match=words), Store(tmp_path):
        pass
    with Store(tmp_path):
        pass
