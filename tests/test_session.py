"""A session from outside: whatever is wrong with it is named by file and line or key, with a remedy."""

from __future__ import annotations

import copy
import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from vbaa_calib.core.errors import InputError
from vbaa_calib.session import (
    MomentSensor,
    OverBoard,
    Still,
    SweepPicture,
    check_pictures,
    has_over,
    has_sweep,
    load_session,
    read_centrelines,
    read_loads,
    read_noload,
    read_recording,
    read_sweep,
)


def pose() -> dict[str, Any]:
    """A turn about y by 2·atan(0.75), as a session.yaml gives it."""
    return {"translation_m": [0.1, 0.2, 0.3], "rotation_xyzw": [0.0, 0.6, 0.0, 0.8]}


GOOD: dict[str, Any] = {
    "schema": "vbaa.session/1",
    "board": {
        "type": "charuco",
        "squares_x": 9,
        "squares_y": 6,
        "square_m": 0.012,
        "marker_m": 0.009,
        "dictionary": "DICT_4X4_100",
        "legacy_pattern": False,
        "thickness_m": 0.002,
    },
    "antenna": {"length_m": 0.24, "diameter_m": 0.0008, "youngs_modulus_Pa": 193.0e9, "density_kg_m3": 7900.0},
    "jig": {"T_antenna_board": pose()},
    "kinematics": {"T_actuator_antenna": pose(), "position_world_m": [0.0, 0.0, 0.15]},
    "gravity_world": [0.0, 0.0, -9.80665],
    "moment_sensor": {"std_Nm": 2.0e-5},
}
SECOND = {"gain": -0.97, "offset_Nm": 1e-4, "std_Nm": 3e-5}
NOLOAD = "image,pan_rad,tilt_rad,moment_Nm\na.png,0.1,0.2,1e-3\nb.png,0,-0.2,0\n"
LOADS = (
    "image,pan_rad,tilt_rad,moment_Nm,distance_m,force_y_N,force_z_N\n"
    "a.png,0,0.1,1e-3,0.1,0.02,0\nb.png,0,0,0,0.24,0,-0.01\n"
)
RECORDING = "frame,time_s,image,pan_rad,tilt_rad,moment_Nm\n3,0.0,a.png,0.1,0.2,1e-3\n1,0.1,b.png,0,0,0\n"
SWEEP = "image,pan_rad,tilt_rad\na.png,0.1,0.2\nb.png,0,-0.2\n"
CENTRELINES = "frame,u_px,v_px,sigma_px\n1,10.5,20,0.1\n3,1,2,0.2\n1,11,21,0.3\n"


def changed(*keys: str | int, to: Any = None, drop: bool = False) -> dict[str, Any]:
    """session.yaml with one key set or left out."""
    data = copy.deepcopy(GOOD)
    place = data
    for key in keys[:-1]:
        place = place[key]
    if drop:
        del place[keys[-1]]
    else:
        place[keys[-1]] = to
    return data


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A session with two rows in every table; nothing is in the pictures."""
    tables = {"noload/noload.csv": NOLOAD, "loads/loads.csv": LOADS, "recording/recording.csv": RECORDING}
    for name, text in tables.items():
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_text(text)
        for picture in ("a.png", "b.png"):
            cv2.imwrite(str((tmp_path / name).with_name(picture)), np.zeros((8, 12), np.uint8))
    write(tmp_path, GOOD)
    return tmp_path


def write(root: Path, data: Any) -> Path:
    path = root / "session.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


def complaint(action: Callable[[], object], path: Path) -> str:
    """What is said: one line that begins with the file and ends in a remedy."""
    with pytest.raises(InputError) as caught:
        action()
    text = str(caught.value)
    assert text.startswith(str(path))
    assert "\n" not in text
    assert caught.value.remedy
    assert text.endswith(caught.value.remedy)
    return text


class TestSessionFile:
    def test_what_is_read(self, root: Path) -> None:
        session = load_session(root)
        assert session.board.squares_x == 9
        assert session.antenna.stiffness_Nm2 == pytest.approx(193e9 * math.pi * 0.0008**4 / 64, rel=1e-15)
        assert session.antenna.mass_per_length_kg_m == pytest.approx(7900 * math.pi * 0.0008**2 / 4, rel=1e-15)
        np.testing.assert_array_equal(session.gravity_world_m_s2, [0, 0, -9.80665])
        np.testing.assert_allclose(session.kinematics.T_actuator_antenna.translation_m, [0.1, 0.2, 0.3])
        np.testing.assert_array_equal(session.kinematics.position_world_m, [0, 0, 0.15])
        assert session.moment_std_Nm == 2e-5
        # the jig holds the back; the printed face is one thickness nearer, along the board's −z
        assert session.T_antenna_board is not None
        normal = session.T_antenna_board.rotation[:, 2]
        np.testing.assert_allclose(normal, [2 * 0.6 * 0.8, 0, 0.8**2 - 0.6**2], atol=1e-15)
        np.testing.assert_allclose(session.T_antenna_board.translation_m, [0.1, 0.2, 0.3] - 0.002 * normal)

    def test_a_second_moment_sensor(self, root: Path) -> None:
        assert load_session(root).second_moment_sensor is None
        write(root, changed("second_moment_sensor", to=SECOND))
        assert load_session(root).second_moment_sensor == MomentSensor(-0.97, 1e-4, 3e-5)
        write(root, changed("second_moment_sensor", to=None))
        assert load_session(root).second_moment_sensor is None

    @pytest.mark.parametrize("drop", [True, False])
    def test_what_may_be_missing_or_null(self, root: Path, drop: bool) -> None:
        write(root, changed("jig", drop=drop))
        assert load_session(root).T_antenna_board is None
        write(root, changed("kinematics", drop=drop))
        kinematics = load_session(root).kinematics
        np.testing.assert_array_equal(kinematics.T_actuator_antenna.matrix, np.eye(4))
        np.testing.assert_array_equal(kinematics.position_world_m, np.zeros(3))

    def test_what_has_a_default(self, root: Path) -> None:
        session = load_session(root)
        assert (session.jig_translation_std_m, session.jig_rotation_std_rad) == (0.0, 0.0)
        assert session.tilt_zero_std_rad == 0.01
        assert session.over is None
        kinematics = session.kinematics
        assert (kinematics.axis_skew_rad, kinematics.axis_offset_m, kinematics.tilt_zero_rad) == (0.0, 0.0, 0.0)
        write(root, changed("over", to={}))
        assert load_session(root).over == OverBoard(0.0, 1e-4, 0.0, 0.0)

    def test_what_is_known_of_jig_joints_and_board(self, root: Path) -> None:
        data = changed("over", to={"height_m": 0.002, "height_std_m": 2e-4, "pan_rad": 0.1, "tilt_rad": -1.5})
        data["jig"] |= {"translation_std_m": 2e-4, "rotation_std_rad": 1e-3}
        data["kinematics"] |= {
            "axis_skew_rad": 0.01,
            "axis_offset_m": -0.002,
            "tilt_zero_rad": 0.03,
            "tilt_zero_std_rad": 0,
        }
        write(root, data)
        session = load_session(root)
        assert (session.jig_translation_std_m, session.jig_rotation_std_rad) == (2e-4, 1e-3)
        kinematics = session.kinematics
        assert (kinematics.axis_skew_rad, kinematics.axis_offset_m, kinematics.tilt_zero_rad) == (0.01, -0.002, 0.03)
        assert session.tilt_zero_std_rad == 0.0
        assert session.over == OverBoard(0.002, 2e-4, 0.1, -1.5)

    def test_weightless(self, root: Path) -> None:
        write(root, changed("gravity_world"))
        session = load_session(root)
        np.testing.assert_array_equal(session.gravity_world_m_s2, np.zeros(3))
        np.testing.assert_array_equal(session.gravity_antenna([Still(None, 0.1, 0.2, 0.0)]), np.zeros((1, 3)))

    def test_gravity_turns_with_the_joints(self, root: Path) -> None:
        write(root, changed("kinematics"))
        session, angle = load_session(root), 0.3
        pulls = session.gravity_antenna([Still(None, 0.7, angle, 0.0), Still(None, 0.0, 0.0, 0.0)])
        expected = -9.80665 * np.array([math.sin(angle), 0.0, math.cos(angle)])
        np.testing.assert_allclose(pulls, [expected, [0, 0, -9.80665]], atol=1e-12)

    @pytest.mark.parametrize("extra", ["quality", "operator", "boards", "antenna_2", "sweep"])
    def test_more_keys_at_the_top_are_welcome(self, root: Path, extra: str) -> None:
        write(root, changed(extra, to={"anything": [1, 2]}))
        assert load_session(root).board.squares_x == 9

    @pytest.mark.parametrize(
        "keys",
        [
            ("schema",),
            ("board",),
            ("antenna",),
            ("gravity_world",),
            ("moment_sensor",),
            *(("board", key) for key in ("squares_x", "squares_y", "square_m", "marker_m")),
            *(("antenna", key) for key in GOOD["antenna"]),
            ("jig", "T_antenna_board"),
            ("jig", "T_antenna_board", "translation_m"),
            ("jig", "T_antenna_board", "rotation_xyzw"),
            ("kinematics", "T_actuator_antenna", "rotation_xyzw"),
            ("moment_sensor", "std_Nm"),
        ],
    )
    def test_every_missing_key_is_named(self, root: Path, keys: tuple[str, ...]) -> None:
        path = write(root, changed(*keys, drop=True))
        text = complaint(lambda: load_session(root), path)
        assert keys[-1] in text
        assert ".".join(keys[:-1]) in text

    @pytest.mark.parametrize(
        ("keys", "value", "words"),
        [
            (("board", "squares_x"), 9.0, "board.squares_x: 9.0 is not a whole number"),
            (("board", "square_m"), 12.0, "board.square_m: 12.0 is not between 0 and 10"),
            (("board", "marker_m"), 0.012, "board: marker_m is 0.012 and square_m 0.012: 0 < marker_m < square_m"),
            (("board", "legacy_pattern"), "no", "board.legacy_pattern: 'no' is not true or false"),
            (("board", "type"), "chessboard", "board.type: 'chessboard' is not 'charuco'"),
            (("board", "square_mm"), 12, "unknown key board.square_mm; is square_m meant?"),
            (("antenna", "youngs_modulus_Pa"), 193, "antenna.youngs_modulus_Pa: 193 is not between 100000 and 2e+12"),
            (("antenna", "length_mm"), 240, "unknown key antenna.length_mm; is length_m meant?"),
            (("jig",), [1], "jig: [1] is not a mapping"),
            (("jig", "T_board_antenna"), pose(), "unknown key jig.T_board_antenna; the keys here are T_antenna_board"),
            (("jig", "T_antenna_board", "rotation_xyzw"), [0, 0, 1, 1], "has length 1.41; a unit quaternion"),
            (("jig", "T_antenna_board", "rotation_xyzw"), [0, 0, 1], "rotation_xyzw: [0, 0, 1] is not 4 values"),
            (("jig", "T_antenna_board", "translation_m"), [0, "x", 0], "translation_m.1: 'x' is not a number"),
            (("jig", "T_antenna_board", "translation_m"), [0, 10**400, 0], "translation_m.1 is not a finite"),
            (("jig", "rotation_std_rad"), "1 deg", "jig.rotation_std_rad: '1 deg' is not a number"),
            (("kinematics", "tilt_zero_rad"), 90, "kinematics.tilt_zero_rad"),
            (("kinematics", "tilt_zero_std_rad"), -0.01, "kinematics.tilt_zero_std_rad"),
            (("over",), {"height_m": -0.002}, "over.height_m"),
            (("over",), {"height_std_m": 0}, "over.height_std_m"),
            (("over",), {"tilt_rad": -90}, "over.tilt_rad"),
            (("moment_sensor", "std"), 1e-5, "unknown key moment_sensor.std"),
            (("second_moment_sensor",), {"std_Nm": 1e-5}, "second_moment_sensor.gain is missing"),
            (("second_moment_sensor",), SECOND | {"gain": 0}, "second_moment_sensor.gain: 0 is not between"),
        ],
    )
    def test_every_wrong_value_is_named(self, root: Path, keys: tuple[str, ...], value: Any, words: str) -> None:
        path = write(root, changed(*keys, to=value))
        assert words in complaint(lambda: load_session(root), path)

    @pytest.mark.parametrize(
        ("wrong", "meant"), [("jigs", "jig"), ("kinematic", "kinematics"), ("Jig", "jig"), ("gravity", "gravity_world")]
    )
    def test_a_misspelt_key_is_not_a_further_one(self, root: Path, wrong: str, meant: str) -> None:
        data = changed(meant, drop=True)
        path = write(root, data | {wrong: GOOD[meant]})
        text = complaint(lambda: load_session(root), path)
        assert f"unknown key {wrong}; is {meant} meant?" in text

    @pytest.mark.parametrize("text", ["", "- 1\n", "schema: [\n", "schema: vbaa.session/1\nschema: vbaa.session/1\n"])
    def test_no_session_at_all(self, root: Path, text: str) -> None:
        path = root / "session.yaml"
        path.write_text(text)
        complaint(lambda: load_session(root), path)

    def test_no_folder(self, root: Path) -> None:
        assert "no such folder" in complaint(lambda: load_session(root / "none"), root / "none")
        assert "is not a folder" in complaint(lambda: load_session(root / "session.yaml"), root / "session.yaml")
        (root / "session.yaml").unlink()
        assert "no such file" in complaint(lambda: load_session(root), root / "session.yaml")


class TestStills:
    def test_what_is_read(self, root: Path) -> None:
        session = load_session(root)
        first, second = read_noload(session)
        assert first == Still(root / "noload" / "a.png", 0.1, 0.2, 1e-3)
        assert (second.image, second.tilt_rad) == (root / "noload" / "b.png", -0.2)
        load, last = read_loads(session)
        assert (load.distance_m, load.force_y_N, load.force_z_N) == (0.1, 0.02, 0.0)
        assert (last.distance_m, last.force_z_N) == (0.24, -0.01)

    @pytest.mark.parametrize("name", ["noload", "loads"])
    @pytest.mark.parametrize(
        ("old", "new", "words"),
        [
            ("a.png", "c.png", "line 2: the picture c.png is not there; put it at"),
            ("a.png", "", "line 2: image is empty"),
            ("a.png", ".", "line 2: the picture . is not there"),
            ("a.png", "c" * 300, "is not there"),
            ("b.png", "a.png", "line 3: the picture a.png stands in line 2, too"),
            ("1e-3", "nan", "line 2: moment_Nm is nan"),
            ("1e-3", "", "line 2: moment_Nm is ''"),
            ("b.png,0", "b.png,x", "line 3: pan_rad is 'x'"),
            ("b.png,0", "b.png,15", "line 3: pan_rad is 15, more than a turn; give radians"),
            ("image", "picture", "column image is missing"),
            ("pan_rad", "pan_deg", "column pan_rad is missing"),
            ("moment_Nm", "moment_Nmm", "column moment_Nm is missing"),
        ],
    )
    def test_every_wrong_row_is_named(self, root: Path, name: str, old: str, new: str, words: str) -> None:
        path, read = root / name / f"{name}.csv", {"noload": read_noload, "loads": read_loads}[name]
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new, 1))
        assert words in complaint(lambda: read(load_session(root)), path)

    @pytest.mark.parametrize(
        ("old", "new", "words"),
        [
            ("0.24", "0.25", "line 3: distance_m is 0.25, the antenna 0.24 m long; give metres"),
            ("0.24", "10", "line 3: distance_m is 10"),
            ("0.24", "0", "line 3: distance_m is 0"),
            ("0.24", "-0.1", "line 3: distance_m is -0.1"),
            ("0.24", "inf", "line 3: distance_m is inf"),
            ("-0.01", "0", "line 3: the force is zero; free frames belong into noload/"),
            ("-0.01", "nan", "line 3: force_z_N is nan"),
            ("distance_m", "distance_mm", "column distance_m is missing"),
            ("force_y_N", "force_y_g", "column force_y_N is missing"),
        ],
    )
    def test_every_wrong_load_is_named(self, root: Path, old: str, new: str, words: str) -> None:
        path = root / "loads" / "loads.csv"
        path.write_text(LOADS.replace(old, new, 1))
        assert words in complaint(lambda: read_loads(load_session(root)), path)

    @pytest.mark.parametrize("text", ["", "\n\n", "header only"])
    @pytest.mark.parametrize("name", ["noload", "loads"])
    def test_empty(self, root: Path, name: str, text: str) -> None:
        path, read = root / name / f"{name}.csv", {"noload": read_noload, "loads": read_loads}[name]
        path.write_text(path.read_text().partition("\n")[0] if text == "header only" else text)
        assert "at least one row" in (said := complaint(lambda: read(load_session(root)), path)) or "is empty" in said

    def test_missing(self, root: Path) -> None:
        for name, read, why in (
            ("noload", read_noload, "calibration needs the free antenna"),
            ("loads", read_loads, "calibration needs known loads"),
        ):
            path = root / name / f"{name}.csv"
            path.unlink()
            assert why in complaint(lambda read=read: read(load_session(root)), path)

    @pytest.mark.parametrize(("name", "read"), [("noload", read_noload), ("loads", read_loads)])
    def test_when_they_were_taken(self, root: Path, name: str, read: Callable[[Any], list[Still]]) -> None:
        path = root / name / f"{name}.csv"
        header, first, second = path.read_text().splitlines()
        assert [still.time_s for still in read(load_session(root))] == [None, None]
        path.write_text(f"{header},time_s\n{first},12.5\n{second},-3\n")
        assert [still.time_s for still in read(load_session(root))] == [12.5, -3.0]
        path.write_text(f"{header},time_s\n{first},12.5\n{second},\n")
        assert "line 3: time_s is ''" in complaint(lambda: read(load_session(root)), path)


@pytest.fixture
def sweep(root: Path) -> Path:
    """A sweep of two pictures."""
    path = root / "sweep" / "sweep.csv"
    path.parent.mkdir()
    path.write_text(SWEEP)
    for picture in ("a.png", "b.png"):
        path.with_name(picture).touch()
    return path


class TestSweep:
    def test_what_is_read(self, root: Path, sweep: Path) -> None:
        session = load_session(root)
        assert has_sweep(session)
        first, second = read_sweep(session)
        assert first == SweepPicture(sweep.with_name("a.png"), 0.1, 0.2)
        assert (second.image, second.pan_rad, second.tilt_rad) == (sweep.with_name("b.png"), 0.0, -0.2)

    def test_without(self, root: Path) -> None:
        assert not has_sweep(load_session(root))

    def test_pictures_without_their_angles(self, root: Path, sweep: Path) -> None:
        sweep.unlink()
        assert has_sweep(load_session(root))
        assert "no such file; it gives the joint angles" in complaint(lambda: read_sweep(load_session(root)), sweep)

    @pytest.mark.parametrize(
        ("old", "new", "words"),
        [
            ("a.png", "c.png", "line 2: the picture c.png is not there; put it at"),
            ("a.png", "", "line 2: image is empty"),
            ("b.png", "a.png", "line 3: the picture a.png stands in line 2, too"),
            ("0.1,0.2", "nan,0.2", "line 2: pan_rad is nan"),
            ("0.1,0.2", "0.1,inf", "line 2: tilt_rad is inf"),
            ("0.1,0.2", "0.1,", "line 2: tilt_rad is ''"),
            ("0.1,0.2", "0.1,20", "line 2: tilt_rad is 20, more than a turn; give radians"),
            ("0.1,0.2", "0.1", "line 2: has 2 cells, the header 3"),
            ("pan_rad", "pan_deg", "column pan_rad is missing"),
            (SWEEP, "image,pan_rad,tilt_rad\n", "no rows"),
            (SWEEP, "", "is empty"),
        ],
    )
    def test_every_wrong_row_is_named(self, root: Path, sweep: Path, old: str, new: str, words: str) -> None:
        assert old in SWEEP
        sweep.write_text(SWEEP.replace(old, new, 1))
        assert words in complaint(lambda: read_sweep(load_session(root)), sweep)


class TestOver:
    def test_pictures_and_height_belong_together(self, root: Path) -> None:
        assert not has_over(load_session(root))
        (root / "over").mkdir()
        text = complaint(lambda: has_over(load_session(root)), root / "session.yaml")
        assert "over is missing, but there is a folder over/; give over.height_m" in text
        write(root, changed("over", to={"height_m": 0.002}))
        assert has_over(load_session(root))
        (root / "over").rmdir()
        assert not has_over(load_session(root))


class TestRecording:
    def test_what_is_read(self, root: Path) -> None:
        first, second = read_recording(load_session(root))
        assert (first.frame, first.time_s, first.image) == (3, 0.0, root / "recording" / "a.png")
        assert (first.pan_rad, first.tilt_rad, first.moment_Nm) == (0.1, 0.2, 1e-3)
        assert (second.frame, second.time_s) == (1, 0.1)

    @pytest.mark.parametrize("cell", ["", "  "])
    def test_a_frame_without_its_moment_is_seen_but_not_felt(self, root: Path, cell: str) -> None:
        (root / "recording" / "recording.csv").write_text(RECORDING.replace("1e-3", cell))
        first, second = read_recording(load_session(root))
        assert math.isnan(first.moment_Nm)
        assert second.moment_Nm == 0.0

    def test_a_recording_without_moments(self, root: Path) -> None:
        lines = [line.rpartition(",")[0] for line in RECORDING.splitlines()]
        (root / "recording" / "recording.csv").write_text("\n".join(lines))
        assert all(math.isnan(frame.moment_Nm) for frame in read_recording(load_session(root)))

    def test_a_second_moment_axis(self, root: Path) -> None:
        path = root / "recording" / "recording.csv"
        assert all(math.isnan(frame.moment_z_Nm) for frame in read_recording(load_session(root)))
        path.write_text("frame,time_s,image,pan_rad,tilt_rad,moment_z_Nm\n3,0,a.png,0,0,2e-3\n4,1,b.png,0,0,\n")
        first, second = read_recording(load_session(root))
        assert first.moment_z_Nm == 2e-3
        assert math.isnan(first.moment_Nm)
        assert math.isnan(second.moment_z_Nm)

    @pytest.mark.parametrize("name", ["moment", "moment_mNm", "Moment_Nm", "moment_Nmm"])
    def test_a_moment_under_another_name_is_not_left_out_in_silence(self, root: Path, name: str) -> None:
        path = root / "recording" / "recording.csv"
        path.write_text(RECORDING.replace("moment_Nm", name))
        text = complaint(lambda: read_recording(load_session(root)), path)
        assert f"column moment_Nm is missing, but there is {name}; name it moment_Nm, in SI units" in text

    def test_further_columns_are_nobodys_business(self, root: Path) -> None:
        path = root / "recording" / "recording.csv"
        path.write_text(RECORDING.replace("\n", ",7\n").replace("moment_Nm,7", "moment_Nm,moment_raw_Nm"))
        assert [frame.moment_Nm for frame in read_recording(load_session(root))] == [1e-3, 0.0]

    def test_a_camera_slower_than_the_sensor(self, root: Path) -> None:
        path = root / "recording" / "recording.csv"
        path.write_text(RECORDING.replace("b.png", "a.png").replace("1,0.1", "1,0.0"))
        first, second = read_recording(load_session(root))
        assert first.image == second.image
        assert first.time_s == second.time_s

    @pytest.mark.parametrize(
        ("old", "new", "words"),
        [
            ("a.png", "c.png", "line 2: the picture c.png is not there"),
            ("a.png", "", "line 2: image is empty"),
            ("\n1,", "\n3,", "line 3: frame 3 stands twice; every frame needs its own number"),
            ("\n1,", "\n3.0,", "line 3: frame 3 stands twice"),
            ("\n1,", "\n1.5,", "line 3: frame is 1.5; a whole number from 0 on"),
            ("\n1,", "\n-1,", "line 3: frame is -1"),
            ("\n1,", "\n--1,", "line 3: frame is '--1'"),
            ("\n1,", "\n" + "9" * 5000 + ",", "line 3: frame is"),
            ("\n1,", "\n,", "line 3: frame is ''"),
            ("0.1,b.png", "-0.1,b.png", "line 3: the time runs backwards; sort"),
            ("0.1,b.png", "nan,b.png", "line 3: time_s is nan"),
            ("0.2,1e-3", "20,1e-3", "line 2: tilt_rad is 20, more than a turn"),
            ("0.2,1e-3", "0.2,inf", "line 2: moment_Nm is inf"),
            ("0.2,1e-3", "0.2,nan", "line 2: moment_Nm is nan"),
            ("0.2,1e-3", "0.2,1e-3 Nm", "line 2: moment_Nm is '1e-3 Nm'"),
            ("time_s", "time", "column time_s is missing"),
            ("image", "picture", "column image is missing"),
        ],
    )
    def test_every_wrong_row_is_named(self, root: Path, old: str, new: str, words: str) -> None:
        path = root / "recording" / "recording.csv"
        assert old in RECORDING
        path.write_text(RECORDING.replace(old, new, 1))
        assert words in complaint(lambda: read_recording(load_session(root)), path)

    def test_missing(self, root: Path) -> None:
        path = root / "recording" / "recording.csv"
        path.unlink()
        assert "it names the frames" in complaint(lambda: read_recording(load_session(root)), path)


class TestCentrelines:
    @pytest.fixture
    def path(self, root: Path) -> Path:
        path = root / "recording" / "centrelines.csv"
        path.write_text(CENTRELINES)
        for picture in ("a.png", "b.png"):
            (root / "recording" / picture).unlink()
        return path

    def test_what_is_read(self, root: Path, path: Path) -> None:
        lines = read_centrelines(load_session(root))
        assert sorted(lines) == [1, 3]
        np.testing.assert_array_equal(lines[1], [[10.5, 20, 0.1], [11, 21, 0.3]])
        np.testing.assert_array_equal(lines[3], [[1, 2, 0.2]])

    def test_without_deviations(self, root: Path, path: Path) -> None:
        path.write_text("v_px,frame,u_px\n1,2,3\n")
        np.testing.assert_array_equal(read_centrelines(load_session(root))[2], [[3, 1, np.nan]])

    def test_the_recording_then_needs_no_pictures(self, root: Path, path: Path) -> None:
        assert [frame.image for frame in read_recording(load_session(root))] == [None, None]
        table = root / "recording" / "recording.csv"
        table.write_text("frame,time_s,pan_rad,tilt_rad,moment_Nm\n3,0.0,0.1,0.2,1e-3\n")
        assert [frame.frame for frame in read_recording(load_session(root))] == [3]

    @pytest.mark.parametrize(
        ("old", "new", "words"),
        [
            ("0.2", "0", "line 3: sigma_px is not positive"),
            ("0.2", "-1", "line 3: sigma_px is not positive"),
            ("0.2", "nan", "line 3: sigma_px is nan"),
            ("10.5", "nan", "line 2: u_px is nan"),
            ("10.5", "", "line 2: u_px is ''"),
            ("\n3,", "\n3.5,", "line 3: frame is 3.5"),
            ("u_px", "u", "column u_px is missing"),
            (",0.3", "", "line 4: has 3 cells, the header 4"),
            (CENTRELINES, "", "is empty"),
            (CENTRELINES, "frame,u_px,v_px\n", "no rows"),
        ],
    )
    def test_every_wrong_row_is_named(self, root: Path, path: Path, old: str, new: str, words: str) -> None:
        assert old in CENTRELINES
        path.write_text(CENTRELINES.replace(old, new, 1))
        assert words in complaint(lambda: read_centrelines(load_session(root)), path)


def test_pictures_are_checked_before_the_work(root: Path) -> None:
    pictures = [root / "noload" / "a.png", root / "noload" / "b.png"]
    check_pictures(pictures, (12, 8), "the rig's camera has")
    what = complaint(lambda: check_pictures(pictures, (640, 480), "the rig's camera has"), pictures[0])
    assert "is 12x8 px, the rig's camera has 640x480 px" in what
    pictures[1].write_bytes(pictures[0].read_bytes()[:-9])
    assert "truncated" in complaint(lambda: check_pictures(pictures, (12, 8), "x"), pictures[1])


ODD = st.sampled_from(
    [None, True, -1, 0, 1e-300, 1e300, math.nan, math.inf, 10**400, "", "x", "\n", [], [1], {}, {"a": 1}, "2024-01-01"]
)


def nodes(data: Any, path: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """Paths to everything in a file, mappings and lists included."""
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    return [*([path] if path else []), *(found for key, value in items for found in nodes(value, (*path, key)))]


def attempt(action: Callable[[], Any]) -> tuple[Any, str]:
    """What came of it, or None and what was said. Only an InputError is let through."""
    try:
        return action(), ""
    except InputError as error:
        return None, str(error)


@settings(deadline=None)
@given(st.sampled_from(nodes(GOOD)), ODD)
def test_whatever_stands_in_a_session_it_is_read_or_refused(keys: tuple[str | int, ...], value: Any) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = write(Path(folder), changed(*keys, to=value))
        session, said = attempt(lambda: load_session(Path(folder)))
        assert session is None or np.isfinite([session.antenna.stiffness_Nm2, *session.gravity_world_m_s2]).all()
        assert session is not None or said.startswith(str(path))


@settings(deadline=None)
@given(st.binary(max_size=60), st.integers(0, len(LOADS)))
def test_whatever_stands_in_a_table_it_is_read_or_refused(content: bytes, position: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        session = load_session(write(root, GOOD).parent)
        for name, text, read in (
            ("noload/noload.csv", NOLOAD, read_noload),
            ("loads/loads.csv", LOADS, read_loads),
            ("sweep/sweep.csv", SWEEP, read_sweep),
            ("recording/recording.csv", RECORDING, read_recording),
            ("recording/centrelines.csv", CENTRELINES, read_centrelines),
        ):
            path = root / name
            path.parent.mkdir(exist_ok=True)
            for picture in ("a.png", "b.png"):
                path.with_name(picture).touch()
            path.write_bytes(text.encode()[:position] + content + text.encode()[position:])
            rows, said = attempt(lambda read=read: read(session))
            assert rows or said.startswith(str(path))
