"""A session's files: what is read of session.yaml, tables, jig and materials; what is refused: tests/hostile."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vbaa_calib.antenna.materials import MATERIALS, _materials_near
from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import Pose
from vbaa_calib.session import (
    Still,
    check_pictures,
    load_session,
    read_loads,
    read_noload,
    read_recording,
    recording_of,
    tables,
    without_moments,
)
from vbaa_calib.session.jig import jig_alternatives
from vbaa_calib.session.tables import _FrameColumns, numbers_of

from .files import changed, complaint, write


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
        normal = session.T_antenna_board.rotation[:, 2]
        np.testing.assert_allclose(normal, [2 * 0.6 * 0.8, 0, 0.8**2 - 0.6**2], atol=1e-15)
        np.testing.assert_allclose(session.T_antenna_board.translation_m, [0.1, 0.2, 0.3] - 0.002 * normal)

    def test_gravity_turns_with_the_joints(self, root: Path) -> None:
        write(root, changed("kinematics"))
        session, angle = load_session(root), 0.3
        pulls = session.gravity_antenna([Still(None, 0.7, angle, 0.0), Still(None, 0.0, 0.0, 0.0)])
        expected = -9.80665 * np.array([math.sin(angle), 0.0, math.cos(angle)])
        np.testing.assert_allclose(pulls, [expected, [0, 0, -9.80665]], atol=1e-12)


SIZE_M = (0.108, 0.072)
FACING = np.diag([1.0, -1.0, -1.0])


def jigs(count: int) -> list[Pose]:
    """Boards that face a camera on the +z side, in any of four turns, nearly square, 20 to 150 mm from the clamp."""
    rng = np.random.default_rng(11)
    found = []
    for _ in range(count):
        turn = Rotation.from_euler("z", 90 * rng.integers(4), degrees=True).as_matrix() @ FACING
        shake = Rotation.from_rotvec(rng.normal(0.0, 0.02, 3)).as_matrix()
        found.append(Pose(shake @ turn, rng.choice([-1, 1], 3) * rng.uniform(0.02, 0.09, 3)))
    return found


SLIPS: dict[str, Callable[[Pose], Pose]] = {
    "sign of x": lambda jig: Pose(jig.rotation, jig.translation_m * [-1, 1, 1]),
    "sign of y": lambda jig: Pose(jig.rotation, jig.translation_m * [1, -1, 1]),
    "sign of z": lambda jig: Pose(jig.rotation, jig.translation_m * [1, 1, -1]),
    "x and y": lambda jig: Pose(jig.rotation, jig.translation_m[[1, 0, 2]]),
    "y and z": lambda jig: Pose(jig.rotation, jig.translation_m[[0, 2, 1]]),
    "cm as mm": lambda jig: Pose(jig.rotation, 0.1 * jig.translation_m),
    "inches as mm": lambda jig: Pose(jig.rotation, jig.translation_m / 25.4),
    "cm as m": lambda jig: Pose(jig.rotation, 100.0 * jig.translation_m),
    "mm as m": lambda jig: Pose(jig.rotation, 1000.0 * jig.translation_m),
    "half a turn": lambda jig: jig @ Pose(np.diag([-1.0, -1.0, 1.0]), np.zeros(3)),
    "other corner": lambda jig: jig @ Pose(np.diag([-1.0, -1.0, 1.0]), np.array([*SIZE_M, 0.0])),
    "a quarter turn": lambda jig: jig @ Pose(Rotation.from_euler("z", 90, degrees=True).as_matrix(), np.zeros(3)),
    "board's y": lambda jig: jig @ Pose(FACING, np.zeros(3)),
    "inverse": Pose.inverse,
    "all signs": lambda jig: Pose(jig.rotation, -jig.translation_m),
}


@pytest.mark.parametrize("slip", SLIPS)
@pytest.mark.parametrize("thickness_m", [0.0, 0.003])
def test_every_slip_is_taken_back_by_an_alternative(slip: str, thickness_m: float) -> None:
    """The jig describes the board's back; what is wrong with that is found with the thickness on the right side."""
    face = Pose(np.eye(3), np.array([0.0, 0.0, -thickness_m]))
    for right in jigs(20):
        entered = SLIPS[slip](right) @ face
        alternatives = jig_alternatives(entered, SIZE_M, thickness_m)
        assert sum(np.abs(pose.matrix - (right @ face).matrix).max() < 1e-9 for _, pose in alternatives) == 1


@pytest.mark.parametrize("name", MATERIALS)
def test_a_material_is_named_first_by_its_usual_numbers(name: str) -> None:
    one = MATERIALS[name]
    assert _materials_near(one.youngs_modulus_Pa)[0] == name
    assert one.has_modulus(one.youngs_modulus_Pa)
    assert one.has_density(one.density_kg_m3)


@pytest.mark.parametrize(("typed", "meant"), [("stainless steel", "nitinol"), ("stainless steel", "nylon")])
def test_materials_that_are_taken_for_each_other_share_no_modulus(typed: str, meant: str) -> None:
    low, high = MATERIALS[meant].modulus_range_Pa
    assert not {typed} & {name for modulus in np.geomspace(low, high, 20) for name in _materials_near(modulus)}


@pytest.mark.parametrize("name", MATERIALS)
def test_a_session_that_names_its_material_needs_no_numbers(root: Path, name: str) -> None:
    """Typed numbers win, and only what the material cannot be is doubted, with a material that can."""
    one = MATERIALS[name]
    size = {"length_m": 0.24, "diameter_m": 0.0008}
    write(root, changed("antenna", to=size | {"material": name.upper()}))
    antenna = load_session(root).antenna
    assert (antenna.youngs_modulus_Pa, antenna.density_kg_m3) == (one.youngs_modulus_Pa, one.density_kg_m3)
    assert antenna.material_doubts == []
    low, high = one.modulus_range_Pa
    for modulus_Pa, doubts in ((0.9 * low, 1), (1.02 * low, 0), (0.98 * high, 0), (1.1 * high, 1)):
        write(root, changed("antenna", to=size | {"material": name, "youngs_modulus_Pa": modulus_Pa}))
        antenna = load_session(root).antenna
        assert antenna.youngs_modulus_Pa == modulus_Pa
        found = antenna.material_doubts
        assert len(found) == doubts
        assert all(other in found[0].remedy for other in _materials_near(modulus_Pa)[:3] if found)


class TestStills:
    @pytest.mark.parametrize(("name", "read"), [("noload", read_noload), ("loads", read_loads)])
    def test_when_they_were_taken(self, root: Path, name: str, read: Callable[[Any], list[Still]]) -> None:
        path = root / name / f"{name}.csv"
        header, first, second = path.read_text().splitlines()
        assert [still.time_s for still in read(load_session(root))] == [None, None]
        path.write_text(f"{header},time_s\n{first},12.5\n{second},-3\n")
        assert [still.time_s for still in read(load_session(root))] == [12.5, -3.0]
        path.write_text(f"{header},time_s\n{first},12.5\n{second},\n")
        assert "line 3: time_s is ''" in complaint(lambda: read(load_session(root)), path)


class TestRecording:
    def test_a_second_moment_axis(self, root: Path) -> None:
        path = root / "recording" / "recording.csv"
        assert all(math.isnan(frame.moment_z_Nm) for frame in read_recording(load_session(root)))
        path.write_text("frame,time_s,image,pan_rad,tilt_rad,moment_z_Nm\n3,0,a.png,0,0,2e-3\n4,1,b.png,0,0,\n")
        first, second = read_recording(load_session(root))
        assert first.moment_z_Nm == 2e-3
        assert math.isnan(first.moment_Nm)
        assert math.isnan(second.moment_z_Nm)

    @pytest.mark.parametrize("seed", range(60))
    def test_read_by_columns_as_by_rows(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
        rng = np.random.default_rng(seed)
        header = ["frame", "time_s", "pan_rad", "tilt_rad", "moment_Nm", *["moment_z_Nm"] * int(rng.integers(2))]
        table = np.round(rng.normal(0.0, 1.0, (9, len(header))), 6)
        table[:, 0], table[:, 1] = rng.permutation(9), np.arange(9)
        cells = [list(map(repr, row)) for row in table.tolist()]
        for _ in range(seed % 3):
            cells[rng.integers(9)][rng.integers(len(header))] = str(rng.choice(ODD))
        path = tmp_path / "recording.csv"
        path.write_text(
            "\n".join(",".join(row) for row in [header, *cells]) + str(rng.choice(["", "\n", "\r\n", "\n\n"]))
        )
        first = _frames_or_complaint(path)
        monkeypatch.setattr(tables, "plain_columns", lambda *_: None)
        assert first == _frames_or_complaint(path)

    def test_columns_are_frames(self, tmp_path: Path) -> None:
        path = tmp_path / "recording.csv"
        path.write_text("frame,time_s,pan_rad,tilt_rad,moment_Nm\n7,0,0.1,0.2,1e-3\n4,0.5,0,0,-2e-3\n9,1,0,0,0\n")
        frames = recording_of(path, with_images=False)
        assert isinstance(frames, _FrameColumns)
        assert [str(frame) for frame in frames] == [str(frames[at]) for at in range(3)]
        assert (frames[-1].frame, len(frames[1:]), frames[1:][0].moment_Nm) == (9, 2, -2e-3)
        assert list(numbers_of(frames)) == list(numbers_of(list(frames))) == [7, 4, 9]
        assert all(math.isnan(frame.moment_Nm) for frame in without_moments(frames))


ODD = ["", " 3", "1 2", "1,2", "'1'", '"2"', "nan", "inf", "1_0", "0x10", "-1", "1e400", "1e-3", "7", "2.5", "+4"]
ODD += [".5", "5.", "1e5", "x", "1d3", "٣", "9e15", "-0"]


def _frames_or_complaint(path: Path) -> str:
    """As text: moments may be NaN."""
    try:
        return str(list(recording_of(path, with_images=False)))
    except InputError as error:
        return str(error)


def test_pictures_are_checked_before_the_work(root: Path) -> None:
    pictures = [root / "noload" / "a.png", root / "noload" / "b.png"]
    check_pictures(pictures, (12, 8), "the rig's camera has")
    what = complaint(lambda: check_pictures(pictures, (640, 480), "the rig's camera has"), pictures[0])
    assert "is 12x8 px, the rig's camera has 640x480 px" in what
    pictures[1].write_bytes(pictures[0].read_bytes()[:-9])
    assert "truncated" in complaint(lambda: check_pictures(pictures, (12, 8), "x"), pictures[1])
