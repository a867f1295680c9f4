"""session.yaml: what is known of a rig before it is calibrated, and which ways to plane C the folder offers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from targets.board import BoardSpec
from vbaa_calib import schemas
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_yaml
from vbaa_calib.geometry import Kinematics, Pose

from .rows import Still


@dataclass(frozen=True)
class MomentSensor:
    """reading = gain · moment + offset + noise of standard deviation std."""

    gain: float
    offset_Nm: float
    std_Nm: float

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> MomentSensor:
        """From a mapping that the schema has checked."""
        return MomentSensor(float(data["gain"]), float(data["offset_Nm"]), float(data["std_Nm"]))

    def to_dict(self) -> dict[str, float]:
        """The mapping that `from_dict` takes."""
        return {"gain": self.gain, "offset_Nm": self.offset_Nm, "std_Nm": self.std_Nm}


SCHEMA = "vbaa.session/1"
TILT_ZERO_STD_RAD = 0.01
OVER_HEIGHT_STD_M = 1e-4
RULER_STD_M, WEIGHT_STD_RELATIVE = 5e-4, 5e-3
"""How well a load's place and weight are known where session.yaml does not say: a ruler, and weights as they are sold.
"""
CLAMP_STD_PX = 20.0


@dataclass(frozen=True)
class NominalAntenna:
    """What the user says of the antenna; stiffness and no-load shape are solved for."""

    length_m: float
    diameter_m: float
    youngs_modulus_Pa: float
    density_kg_m3: float

    @property
    def stiffness_Nm2(self) -> float:
        """E·πd⁴/64."""
        return float(self.youngs_modulus_Pa * np.pi * self.diameter_m**4 / 64)

    @property
    def mass_per_length_kg_m(self) -> float:
        """ρ·πd²/4."""
        return float(self.density_kg_m3 * np.pi * self.diameter_m**2 / 4)


@dataclass(frozen=True)
class OverBoard:
    """How the free antenna is held over a board that lies parallel to plane C, in the pictures of over/.

    Attributes
    ----------
    height_m : of the antenna's axis over the printed face, towards the viewer. height_std_m : how well it is known.
    pan_rad, tilt_rad : the joints' readings in these pictures.
    clamp_px, clamp_std_px : where the clamp's edge shows, and how well that is known; roughly will do to tell the ends.
    """

    height_m: float = 0.0
    height_std_m: float = OVER_HEIGHT_STD_M
    pan_rad: float = 0.0
    tilt_rad: float = 0.0
    clamp_px: tuple[float, float] | None = None
    clamp_std_px: float = CLAMP_STD_PX


@dataclass(frozen=True)
class LoadReadings:
    """How well the known loads are known, as standard deviations; 0: exactly.

    Attributes
    ----------
    distance_std_m : of a load's place along the antenna. force_std_relative : of its force, relative.
    """

    distance_std_m: float = 0.0
    force_std_relative: float = 0.0


@dataclass(frozen=True, eq=False)
class Session:
    """session.yaml, checked.

    Attributes
    ----------
    T_antenna_board : pose of the board's printed face in the jig, or None without a jig.
    gravity_world_m_s2 : (3,), zero when weightless.
    moment_std_Nm : the moment sensor's noise.
    jig_translation_std_m, jig_rotation_std_rad : how well the jig's place on the base is known, per axis; 0: exactly.
    tilt_zero_std_rad : how well the tilt encoder's zero is known before calibration.
    print_scale_std : relative standard deviation of the board's printed size, as far as it was measured; 0: exact.
    load_readings : how well places and forces of the known loads are known.
    over : how the antenna is held over the board in over/, or None where session.yaml does not say.
    second_moment_sensor : about z, calibrated elsewhere; None where there is none.
    """

    root: Path
    board: BoardSpec
    antenna: NominalAntenna
    T_antenna_board: Pose | None
    kinematics: Kinematics
    gravity_world_m_s2: np.ndarray
    moment_std_Nm: float
    jig_translation_std_m: float = 0.0
    jig_rotation_std_rad: float = 0.0
    tilt_zero_std_rad: float = TILT_ZERO_STD_RAD
    print_scale_std: float = 0.0
    load_readings: LoadReadings = LoadReadings()
    over: OverBoard | None = None
    second_moment_sensor: MomentSensor | None = None

    def gravity_antenna(self, frames: Sequence[Still]) -> np.ndarray:
        """(B, 3) gravity in the antenna frame at each frame's joint angles."""
        return gravity_antenna(self.kinematics, self.gravity_world_m_s2, frames)


def gravity_antenna(kinematics: Kinematics, gravity_world_m_s2: np.ndarray, frames: Sequence[Still]) -> np.ndarray:
    """(B, 3) gravity in the antenna frame at each frame's joint angles."""
    turns = [kinematics.T_world_antenna(frame.pan_rad, frame.tilt_rad).rotation for frame in frames]
    return np.array([turn.T @ gravity_world_m_s2 for turn in turns]).reshape(-1, 3)


def load_session(root: Path) -> Session:
    """Read and check session.yaml. Raises InputError naming the key that is wrong."""
    root = Path(root)
    if not root.is_dir():
        problem = "is not a folder" if root.exists() else "no such folder"
        raise InputError(problem, where=root, remedy="name a session folder (docs/formats.md)")
    path = root / "session.yaml"
    return session_from(read_yaml(path), root, path)


def session_from(data: Mapping[str, Any], root: Path, path: object) -> Session:
    """What session.yaml holds, checked. Raises InputError naming `path` and the key that is wrong."""
    schemas.check(data, "session", path)
    try:
        board = BoardSpec.from_dict(data["board"])
    except ValueError as error:
        raise InputError(f"board: {error}", where=path, remedy="describe the board that was printed") from None
    jig, kinematics, over = data.get("jig"), data.get("kinematics") or {}, data.get("over")
    second = data.get("second_moment_sensor")
    T_antenna_board = None
    if jig:
        # The jig holds the board's back; the printed face lies one thickness nearer to the viewer, along −z.
        face = Pose(np.eye(3), np.array([0.0, 0.0, -board.thickness_m]))
        T_antenna_board = read_pose(jig["T_antenna_board"], path, "jig.T_antenna_board") @ face
    return Session(
        root=root,
        board=board,
        antenna=NominalAntenna(**{key: float(value) for key, value in data["antenna"].items()}),
        T_antenna_board=T_antenna_board,
        kinematics=_kinematics(kinematics, path),
        gravity_world_m_s2=np.asarray(data["gravity_world"] or (0.0, 0.0, 0.0), float),
        moment_std_Nm=float(data["moment_sensor"]["std_Nm"]),
        jig_translation_std_m=float((jig or {}).get("translation_std_m", 0.0)),
        jig_rotation_std_rad=float((jig or {}).get("rotation_std_rad", 0.0)),
        tilt_zero_std_rad=float(kinematics.get("tilt_zero_std_rad", TILT_ZERO_STD_RAD)),
        load_readings=_load_readings(data.get("load_readings") or {}),
        print_scale_std=float(data.get("print_scale_std", 0.0)),
        over=None if over is None else _over(over),
        second_moment_sensor=None if second is None else MomentSensor.from_dict(second),
    )


def _load_readings(data: Mapping[str, Any]) -> LoadReadings:
    return LoadReadings(
        float(data.get("distance_std_m", RULER_STD_M)), float(data.get("force_std_relative", WEIGHT_STD_RELATIVE))
    )


def _over(data: Mapping[str, Any]) -> OverBoard:
    numbers = {key: float(value) for key, value in data.items() if key != "clamp_px"}
    mark = data.get("clamp_px")
    return OverBoard(**numbers, clamp_px=None if mark is None else (float(mark[0]), float(mark[1])))


def _kinematics(data: Mapping[str, Any], where: object) -> Kinematics:
    mount = data.get("T_actuator_antenna")
    return Kinematics(
        read_pose(mount, where, "kinematics.T_actuator_antenna") if mount else Pose.identity(),
        np.asarray(data.get("position_world_m", (0.0, 0.0, 0.0)), float),
        axis_skew_rad=float(data.get("axis_skew_rad", 0.0)),
        axis_offset_m=float(data.get("axis_offset_m", 0.0)),
        tilt_zero_rad=float(data.get("tilt_zero_rad", 0.0)),
    )


def read_pose(data: Mapping[str, Any], where: object, key: str) -> Pose:
    """A pose out of a checked file. Raises InputError when the quaternion is not one."""
    length = math.hypot(*data["rotation_xyzw"])
    if not 0.99 < length < 1.01:
        raise InputError(
            f"{key}.rotation_xyzw has length {length:.3g}", where=where, remedy="a unit quaternion x, y, z, w is needed"
        )
    return Pose(Rotation.from_quat(data["rotation_xyzw"]).as_matrix(), np.asarray(data["translation_m"], float))


def has_sweep(session: Session) -> bool:
    """Whether there is a folder sweep/ with pictures of a board fixed in the world."""
    return (session.root / "sweep").is_dir()


def has_over(session: Session) -> bool:
    """Whether there is a folder over/ with pictures of the free antenna over a board.

    Raises InputError when session.yaml says nothing of it: without the height the pictures are worth nothing.
    """
    if not (session.root / "over").is_dir():
        return False
    if session.over is None:
        raise InputError(
            "over is missing, but there is a folder over/",
            where=session.root / "session.yaml",
            remedy="give over.height_m, the height of the antenna's axis over the board's printed face",
        )
    return True
