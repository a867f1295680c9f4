"""One new picture of the board and one of the free antenna, with rig.json alone or with the session it came from."""

from __future__ import annotations

import hashlib
import json
import math
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from vbaa_calib.calibrate.check.assessment import Assessment, assess
from vbaa_calib.calibrate.check.finding import Finding
from vbaa_calib.calibrate.check.inputs import NewPictures
from vbaa_calib.cli.main import main
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


def test_a_session_only_says_what_board_and_jig_are(made: SimpleNamespace, tmp_path: Path) -> None:
    # its own pictures are not read: they show how the rig was, not how it is
    shutil.copytree(made.folder / "session", tmp_path / "session")
    (tmp_path / "session" / "plane").mkdir()
    (tmp_path / "session" / "plane" / "jig.png").write_bytes(b"rubbish")
    assert assess(made.old, tmp_path / "session", made.new).verdict == "holds"


def test_without_a_reading_the_sensor_is_left_open(made: SimpleNamespace) -> None:
    found = assess(made.rig, None, replace(made.new, moment_Nm=None))
    assert "--moment" in answer(found, "sensor_offset").words
    assert answers(found)["free_antenna"] == "holds"
    assert json.loads(json.dumps(found.to_dict(), allow_nan=False))["session"]["noload"][0]["moment_read_mNm"] is None


def test_a_rig_without_a_recorded_jig_leaves_the_camera_open(made: SimpleNamespace, tmp_path: Path) -> None:
    data = json.loads(made.rig.read_text())
    del data["quality"]["jig"]
    (tmp_path / "rig.json").write_text(json.dumps(data))
    found = assess(tmp_path / "rig.json", None, made.new)
    assert answer(found, "camera_pose").level == "not given"
    assert "does not record the jig" in answer(found, "camera_pose").words


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


@pytest.mark.parametrize(
    ("wrong", "line"),
    [
        ({"board": None, "free": None}, "no picture is given"),
        ({"pan_rad": 20.0}, "pan_rad is 20"),
        ({"tilt_rad": math.nan}, "tilt_rad is nan"),
        ({"moment_Nm": math.inf}, "moment_Nm is inf"),
    ],
)
def test_numbers_that_cannot_be_are_refused(made: SimpleNamespace, wrong: dict[str, Any], line: str) -> None:
    with pytest.raises(InputError, match=line):
        replace(made.new, **wrong)


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


@pytest.mark.parametrize(
    ("extra", "line"),
    [
        (["--moment", "0.001"], "--moment without --free"),
        (["--board", "board.png", "--tilt", "0.1"], "--tilt without --free"),
        (["--free", "free.png", "--pan", "30"], "pan_rad is 30"),
    ],
)
def test_readings_that_belong_to_no_picture_are_refused(
    made: SimpleNamespace, capsys: pytest.CaptureFixture[str], extra: list[str], line: str
) -> None:
    assert main(["check", str(made.rig), *extra]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert line in said.err


def test_the_command_with_new_pictures(
    made: SimpleNamespace, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    new, page = made.new, tmp_path / "free.html"
    words = ["--board", str(new.board), "--free", str(new.free), "--moment", str(new.moment_Nm)]
    assert main(["check", str(made.rig), *words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["verdict"] == "holds"
    assert main(["check", str(made.old), str(made.folder / "session"), "--board", str(new.board)]) == 0
    assert main(["check", str(made.old), "--board", str(new.board)]) == 2
    assert "name the session that the rig was calibrated from" in capsys.readouterr().err
    assert main(["check", str(made.rig), "--free", str(new.free), "--html", str(page)]) == 0
    assert "nan" not in page.read_text().split("<svg")[0]
