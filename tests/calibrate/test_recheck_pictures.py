"""One new picture of the board and one of the free antenna, with rig.json alone or with the session it came from."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from vbaa_calib.calibrate.check.assessment import Assessment, NewPictures, assess
from vbaa_calib.calibrate.check.finding import Finding
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.images import read_gray
from vbaa_calib.simulate.write import session_yaml

from .checked_rigs import QUALITY, answers, month_later, one_picture_each, rig_document, rig_of, scene


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """A rig.json that records board and jig, one that does not, session.yaml, and two pictures of an unchanged rig."""
    folder = tmp_path_factory.mktemp("pictures")
    (folder / "rig.json").write_text(json.dumps(rig_document(scene())))
    (folder / "old.json").write_text(json.dumps(rig_of(scene()).to_dict() | {"quality": QUALITY}))
    (folder / "session").mkdir()
    (folder / "session" / "session.yaml").write_text(session_yaml(scene()))
    new = one_picture_each(scene(), folder)
    return SimpleNamespace(folder=folder, rig=folder / "rig.json", old=folder / "old.json", new=new)


def answer(found: Assessment, name: str) -> Finding:
    assert found.session is not None
    return next(one for one in found.session.findings if one.name == name)


def test_rig_json_alone_says_which_board_and_which_jig(made: SimpleNamespace) -> None:
    found = assess(made.rig, None, made.new)
    assert found.verdict == "holds", found.words
    levels = answers(found)
    assert levels["camera_pose"] == levels["free_antenna"] == levels["sensor_offset"] == "holds"
    assert levels["stiffness"] == levels["sensor_gain"] == "not given"
    assert json.loads(json.dumps(found.to_dict(), allow_nan=False))["session"]["given"] == ["plane", "noload"]


def test_the_answers_are_those_of_a_session_folder(made: SimpleNamespace, tmp_path: Path) -> None:
    session = month_later(scene(), tmp_path / "month", ("plane", "noload"))
    whole = assess(made.old, session)
    new = NewPictures(
        next((session / "plane").glob("*.png")), next((session / "noload").glob("*.png")), 0.0, 0.0, made.new.moment_Nm
    )
    for path, root in ((made.rig, None), (made.old, made.folder / "session")):
        found = assess(path, root, new)
        assert found.session is not None
        assert whole.session is not None
        assert [one.words for one in found.session.findings] == [one.words for one in whole.session.findings]


def test_a_picture_of_the_calibration_proves_nothing(made: SimpleNamespace, tmp_path: Path) -> None:
    digest = hashlib.sha256(made.new.board.read_bytes()).hexdigest()
    data = json.loads(made.rig.read_text()) | {"inputs_sha256": {"plane/jig_000.png": digest}}
    (tmp_path / "rig.json").write_text(json.dumps(data))
    with pytest.raises(InputError, match=r"board.png: is one of the pictures that .*rig.json was calibrated from"):
        assess(tmp_path / "rig.json", None, made.new)


BROKEN = [
    (lambda quality: quality.pop("lens"), "quality.lens.board is not recorded"),
    (lambda quality: quality.update(lens=3), "quality.lens.board is not recorded"),
    (lambda quality: quality["lens"].update(board=[1]), "quality.lens.board"),
    (lambda quality: quality["lens"]["board"].update(square_m=-1), "quality.lens.board.square_m: -1"),
    (lambda quality: quality.update(jig=7), "quality.jig.T_antenna_board: None"),
    (lambda quality: quality["jig"]["T_antenna_board"].update(translation_m=[1, "a", 2]), "translation_m.1: 'a'"),
    (lambda quality: quality["jig"]["T_antenna_board"].update(rotation_xyzw=[0, 0, 0, 0]), "has length 0"),
]


@pytest.mark.parametrize(("spoil", "line"), BROKEN, ids=[line for _, line in BROKEN])
def test_a_broken_record_is_refused(made: SimpleNamespace, tmp_path: Path, spoil: Any, line: str) -> None:
    data = json.loads(made.rig.read_text())
    spoil(data["quality"])
    (tmp_path / "rig.json").write_text(json.dumps(data))
    with pytest.raises(InputError) as refused:
        assess(tmp_path / "rig.json", None, made.new)
    assert line in str(refused.value)


def test_pictures_that_are_none_are_refused_by_name(made: SimpleNamespace, tmp_path: Path) -> None:
    small, empty, grey = tmp_path / "small.png", tmp_path / "empty.png", tmp_path / "grey.png"
    cv2.imwrite(str(small), read_gray(made.new.board)[::2, ::2])
    empty.write_bytes(b"")
    cv2.imwrite(str(grey), np.full((720, 960), 90, np.uint8))
    for part in ("board", "free"):
        for path in (small, empty, grey, tmp_path, tmp_path / "nowhere.png"):
            with pytest.raises(InputError) as refused:
                assess(made.rig, None, replace(made.new, **{part: path}))
            assert path.name in str(refused.value)
    # exchanged: the board is not in the one, and hides the wire in the other
    with pytest.raises(InputError, match="no board is found"):
        assess(made.rig, None, replace(made.new, board=made.new.free, free=None, moment_Nm=None))
