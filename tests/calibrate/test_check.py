"""A rig against new pictures: what has changed is named, what has not is left alone, and how often either is found."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

from vbaa_calib.calibrate.check.assessment import Assessment, _plane_map, assess
from vbaa_calib.calibrate.check.finding import Finding
from vbaa_calib.core.files import sha256
from vbaa_calib.geometry import Pose
from vbaa_calib.rig import Rig
from vbaa_calib.simulate.scene.scene import SceneSpec
from vbaa_calib.simulate.write import _session_yaml

from ..csv_files import read_rows, write_rows
from .checked_rigs import (
    QUALITY,
    answers,
    changed_answers,
    month_later,
    one_picture_each,
    only,
    rig_document,
    rig_of,
    scene,
    unchanged,
    with_camera_moved,
    with_clamp_turned,
    with_lens,
    with_sensor,
    with_stiffness,
    with_wire_bent,
)

MONTH = ("plane", "noload")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """A rig that is right, its file, and the session of an unchanged rig."""
    folder = tmp_path_factory.mktemp("checked")
    (folder / "rig.json").write_text(json.dumps(rig_of(scene()).to_dict() | {"quality": QUALITY}))
    return SimpleNamespace(rig=folder / "rig.json", session=unchanged())


def test_a_rig_that_is_right_holds(made: SimpleNamespace) -> None:
    found = assess(made.rig, made.session)
    assert found.verdict == "holds", found.words
    assert set(answers(found).values()) <= {"holds", "not given"}
    distances = [one.evidence.distance_std for one in found.session_findings if one.evidence and one.name != "lens_fit"]
    assert len(distances) == 6
    # not only below the limit: of the size that chance gives
    assert np.mean(np.square(distances)) < 8


def test_pictures_of_the_calibration_are_named_as_such(made: SimpleNamespace, tmp_path: Path) -> None:
    """They fit whatever has happened since; one picture that is new makes it a check."""
    session = only(made.session, tmp_path / "own", MONTH)
    used = {path.name: sha256(path) for part in MONTH for path in (session / part).iterdir()}
    rig = tmp_path / "rig.json"
    for recorded, own in ((used, True), (dict(list(used.items())[1:]), False)):
        rig.write_text(json.dumps(json.loads(made.rig.read_text()) | {"inputs_sha256": recorded}))
        found = assess(rig, session)
        assert found.to_dict()["own_pictures"] is own
        assert ("own" in found.words) is own


def number_in(found: Assessment, question: str) -> float:
    """The first number with a sign in an answer's words."""
    words = next(one.words for one in found.session_findings if one.name == question)
    return float(re.findall(r"[+-][\d.]+", words)[0])


MOVED = np.array([0.0, np.radians(0.3), 0.0, 5e-4, 0.0, 0.0])
_FAR = np.array([np.radians(1.0), 0.0, 0.0, 0.0, 0.0, 0.0])
SENSED = ("plane", "noload", "loads")
CHANGES: dict[str, tuple[Callable[[SceneSpec], SceneSpec], tuple[str, ...], set[str]]] = {
    "camera": (lambda old: with_camera_moved(old, MOVED), MONTH, {"camera_pose"}),
    "bent wire": (lambda old: with_wire_bent(old, 0.05), MONTH, {"free_antenna"}),
    "slipped clamp": (lambda old: with_clamp_turned(old, 0.004), MONTH, {"free_antenna"}),
    "no board": (lambda old: with_camera_moved(old, np.array([0, 0, 0.005, 0, 0, 0])), ("noload",), {"free_antenna"}),
    # by a degree: the antenna leaves its clamp well beside where it should
    "far, no board": (lambda old: with_camera_moved(old, _FAR), ("noload",), {"free_antenna"}),
    "refocus": (lambda old: with_lens(old, 1.005), ("intrinsics", "plane"), {"lens_focus", "camera_pose"}),
    "refocus, one board": (lambda old: with_lens(old, 1.005), ("plane",), {"camera_pose"}),
    "offset": (lambda old: with_sensor(old, offset_Nm=2e-4), SENSED, {"sensor_offset"}),
    "gain": (lambda old: with_sensor(old, gain=1.05), SENSED, {"sensor_gain"}),
    "stiffness": (lambda old: with_stiffness(old, 1.03), SENSED, {"stiffness"}),
}
"""What changed, which pictures there are, and the questions whose answers are bad."""
CAUSES = {
    "bent wire": ("free_antenna", "bent wire"),
    "slipped clamp": ("free_antenna", "clamp that turned"),
    "no board": ("free_antenna", "the camera may have moved instead"),
    "far, no board": ("free_antenna", "the camera may have moved instead"),
    "refocus": ("camera_pose", "mend the lens first"),
    "refocus, one board": ("camera_pose", "refocus"),
}
SIZES: dict[str, tuple[Callable[[Any], Any], Any, float]] = {
    "camera": (
        lambda found: 1e-3 * np.concatenate([found.session["camera_pose"][of] for of in ("turn_mrad", "shift_mm")]),
        MOVED,
        2e-3,
    ),
    "refocus": (lambda found: number_in(found, "lens_focus") / 100, 0.005, 1.5e-3),
    "offset": (lambda found: number_in(found, "sensor_offset") / 1e3, 2e-4, 6e-5),
    "gain": (lambda found: number_in(found, "sensor_gain") / scene().moment.gain, 0.05, 0.01),
    "stiffness": (lambda found: number_in(found, "stiffness") / 100, np.log(1.03), 2e-3),
}
"""What the check measures of a change, what it is, and how near the two are."""


@pytest.mark.parametrize("name", CHANGES)
def test_a_change_is_found_and_nothing_else_is_blamed(made: SimpleNamespace, tmp_path: Path, name: str) -> None:
    change, parts, expected = CHANGES[name]
    found = assess(made.rig, month_later(change(scene()), tmp_path / "month", parts))
    bad = changed_answers(found)
    if name in ("gain", "stiffness", "refocus"):
        assert expected <= bad
    else:
        assert bad == expected
    if parts != SENSED:
        assert found.verdict == "does not hold"
    if name in CAUSES:
        question, cause = CAUSES[name]
        answer = next(one for one in found.session_findings if one.name == question)
        assert cause in f"{answer.words} {answer.remedy}"
    if name in SIZES:
        measured, size, near = SIZES[name]
        np.testing.assert_allclose(measured(found), size, atol=near)
    if name == "camera":
        recorded = found.session["camera_pose"]["T_antenna_camera"]
        moved = Pose.from_dict(recorded).tangent_from(scene().T_antenna_camera)
        np.testing.assert_allclose(moved, MOVED, atol=1e-3)


def test_a_camera_that_moved_is_found_where_everything_shares_errors(tmp_path: Path) -> None:
    """Lens, pose, antenna and its end, as calibrations leave them: the new pose shares the lens's errors alone."""
    document = rig_document(scene())
    std = np.sqrt(np.diag(document["joint"]["covariance"]))
    document["joint"]["covariance"] = (0.1 * np.diag(std**2) + 0.9 * np.outer(std, std)).tolist()
    document["antenna"]["tip"] = {"offset_m": 0.0, "std_m": 3e-4, "covariance": (0.9 * 3e-4 * std).tolist()}
    (tmp_path / "rig.json").write_text(json.dumps(document))
    found = assess(tmp_path / "rig.json", month_later(with_camera_moved(scene(), MOVED), tmp_path / "month", MONTH))
    assert answers(found)["camera_pose"] == "does not hold"


def with_loads(session: Path, change: Callable[[int, dict[str, str]], dict[str, str]]) -> None:
    """Change cells of a session's loads.csv, by row."""
    path = session / "loads" / "loads.csv"
    write_rows(path, [row | change(index, row) for index, row in enumerate(read_rows(path))])


def test_a_load_noted_wrong_is_named(made: SimpleNamespace, tmp_path: Path) -> None:
    session = only(made.session, tmp_path / "loads", ("noload", "loads"))
    with_loads(session, lambda index, row: {"force_y_N": str((1.2, 1.0)[index] * float(row["force_y_N"]))})
    table = assess(made.rig, session).to_dict()["session"]["loads"]
    assert [row["look_at"] for row in table] == [True, False]
    # a fifth less force than noted bends a fifth less
    assert table[0]["seen_deflection_mm"] / table[0]["predicted_deflection_mm"] == pytest.approx(1 / 1.2, rel=0.04)


def test_the_uncertainty_of_a_ruler_is_not_blamed_on_the_antenna(made: SimpleNamespace, tmp_path: Path) -> None:
    """0.7 mm further out than noted: an antenna of another EI where the places count as exact, else nothing."""
    session = only(made.session, tmp_path / "loads", ("noload", "loads"))
    with_loads(session, lambda _, row: {"distance_m": str(float(row["distance_m"]) + 7e-4)})
    assert "stiffness" in changed_answers(assess(made.rig, session))
    settings = yaml.safe_load((session / "session.yaml").read_text(encoding="utf-8"))
    del settings["load_readings"]
    (session / "session.yaml").write_text(yaml.safe_dump(settings), encoding="utf-8")
    found = assess(made.rig, session)
    assert "stiffness" not in changed_answers(found)
    assert [row["look_at"] for row in found.to_dict()["session"]["loads"]] == [False, False]


@pytest.fixture(scope="module")
def made_pictures(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """A rig.json that records board and jig, one that does not, session.yaml, and two pictures of an unchanged rig."""
    folder = tmp_path_factory.mktemp("pictures")
    (folder / "rig.json").write_text(json.dumps(rig_document(scene())))
    (folder / "old.json").write_text(json.dumps(rig_of(scene()).to_dict() | {"quality": QUALITY}))
    (folder / "session").mkdir()
    (folder / "session" / "session.yaml").write_text(_session_yaml(scene()))
    new = one_picture_each(scene(), folder)
    return SimpleNamespace(folder=folder, rig=folder / "rig.json", old=folder / "old.json", new=new)


def answer(found: Assessment, name: str) -> Finding:
    return next(one for one in found.session_findings if one.name == name)


def test_rig_json_alone_says_which_board_and_which_jig(made_pictures: SimpleNamespace) -> None:
    found = assess(made_pictures.rig, None, *made_pictures.new)
    assert found.verdict == "holds", found.words
    levels = answers(found)
    assert levels["camera_pose"] == levels["free_antenna"] == levels["sensor_offset"] == "holds"
    assert levels["stiffness"] == levels["sensor_gain"] == "not given"
    assert json.loads(json.dumps(found.to_dict(), allow_nan=False))["session"]["given"] == ["plane", "noload"]


def test_the_map_on_plane_c_is_what_sampling_gives() -> None:
    """Rigs drawn from the joint covariance: points on plane C scatter as the map says."""
    rig = rig_of(scene())
    rng, pixels = np.random.default_rng(0), np.array([[200.0, 300.0], [480.0, 360.0], [800.0, 600.0]])
    covariance = rig.plane_covariance()
    draws = rng.multivariate_normal(np.zeros(len(covariance)), covariance, size=200, method="eigh")
    found = np.array([moved(rig, draw).camera_on_plane().project(pixels)[0] for draw in draws])
    worst_std = [np.sqrt(np.linalg.eigvalsh(np.cov(found[:, index].T))[-1]) for index in range(3)]
    jacobian = rig.camera_on_plane().calibration_jacobian(pixels)
    own = jacobian @ covariance @ np.swapaxes(jacobian, -1, -2)
    np.testing.assert_allclose(worst_std, np.sqrt(np.linalg.eigvalsh(own)[:, -1]), rtol=0.12)
    grid_px, std_mm = _plane_map(rig)
    row, column = 18, 24
    again = rig.camera_on_plane().calibration_jacobian(grid_px[row, column][None])[0]
    expected = 1e3 * np.sqrt(np.linalg.eigvalsh(again @ covariance @ again.T)[-1])
    assert std_mm[row, column] == pytest.approx(expected)


def moved(rig: Rig, draw: np.ndarray) -> Rig:
    """Lens and camera pose off by one draw."""
    return replace(rig, camera=rig.camera.moved(draw[:-6]), T_antenna_camera=rig.T_antenna_camera.retract(draw[-6:]))
