"""A calibrated rig, read from rig.json and written to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from vbaa_calib import schemas
from vbaa_calib.camera import Camera, CameraOnPlane
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_json
from vbaa_calib.geometry import PLANE_C, Kinematics, Plane, Pose
from vbaa_calib.session import MomentSensor, read_pose

from .parameters import POSE_PARAMETERS, RIG_PARAMETERS
from .parts import Antenna, AntennaImage, camera_from_dict, check_view, kinematics_from_dict, kinematics_to_dict


def _joint_covariance(joint: Mapping[str, Any], lens: tuple[str, ...], where: object) -> np.ndarray:
    """(17, 17), or (17 + P, 17 + P) with the P parameters of the lens, from the mapping `joint`.

    Raises InputError for other parameters, another shape, or a matrix that is no covariance.
    """
    rows, names = joint["covariance"], tuple(joint["parameters"])
    if names not in (RIG_PARAMETERS, RIG_PARAMETERS + lens) or {len(rows), *map(len, rows)} != {len(names)}:
        raise InputError(
            f"joint must give the covariance of {', '.join(RIG_PARAMETERS)}, and then of the lens ({', '.join(lens)})",
            where=where,
            remedy="run vbaa calibrate again",
        )
    covariance = np.array(rows, float)
    if not _is_covariance(covariance):
        raise InputError("joint.covariance is not a covariance", where=where, remedy="run vbaa calibrate again")
    return covariance


def _is_covariance(matrix: np.ndarray) -> bool:
    """Symmetric and positive semidefinite, whatever the units of its rows."""
    variance = np.diag(matrix)
    if (variance < 0).any():
        return False
    deviation = np.sqrt(np.where(variance > 0, variance, 1.0))
    with np.errstate(over="ignore"):
        correlation = matrix / deviation / deviation[:, None]
    if np.abs(correlation).max() > 1 + 1e-6 or np.abs(correlation - correlation.T).max() > 1e-6:
        return False
    return bool(np.linalg.eigvalsh(correlation).min() > -1e-6)


SCHEMA = "vbaa.rig/1"


@dataclass(frozen=True, eq=False)
class Rig:
    """A calibrated rig.

    Attributes
    ----------
    T_antenna_camera : pose of the camera in the antenna frame.
    gravity_world_m_s2 : (3,).
    covariance : (17 + P, 17 + P) joint covariance of `RIG_PARAMETERS` and the P parameters of the lens, in
        `parameter_names` order; (17, 17) where the lens counts as exact.
    second_moment_sensor : about z, of x·f_y − y·f_x of force and weight (antenna frame); None where a rig has none. Its
        gain and offset count as exact.
    """

    camera: Camera
    T_antenna_camera: Pose
    antenna: Antenna
    moment_sensor: MomentSensor
    kinematics: Kinematics
    gravity_world_m_s2: np.ndarray
    image: AntennaImage
    covariance: np.ndarray
    second_moment_sensor: MomentSensor | None = None

    def camera_on_plane(self, plane: Plane = PLANE_C) -> CameraOnPlane:
        """The metric layer: pixels to metric coordinates on a plane of the antenna frame, plane C by default."""
        return CameraOnPlane(self.camera, self.T_antenna_camera, plane)

    @property
    def with_lens(self) -> bool:
        """Whether the joint covariance holds the lens."""
        return len(self.covariance) > len(RIG_PARAMETERS)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """What the rows of the joint covariance are."""
        return RIG_PARAMETERS + (self.camera.parameter_names if self.with_lens else ())

    def plane_covariance(self) -> np.ndarray:
        """(P + 6, P + 6) covariance of lens and camera pose in the order of `CameraOnPlane.parameter_names`.

        Without the lens in the joint covariance its own stands beside the pose's, as if they were independent.
        """
        lens, pose = len(self.camera.parameter_names), len(POSE_PARAMETERS)
        whole = np.zeros((lens + pose, lens + pose))
        if self.with_lens:
            order = np.r_[len(RIG_PARAMETERS) : len(self.covariance), :pose]
            return self.covariance[np.ix_(order, order)]
        if self.camera.covariance is not None:
            whole[:lens, :lens] = self.camera.covariance
        whole[lens:, lens:] = self.covariance[:pose, :pose]
        return whole

    def std(self, parameter: str) -> float:
        """Standard deviation of one of `parameter_names`."""
        index = self.parameter_names.index(parameter)
        return float(np.sqrt(self.covariance[index, index]))

    @staticmethod
    def load(path: str | Path) -> Rig:
        """Read rig.json. Raises InputError naming what is wrong in it."""
        path = Path(path)
        return Rig.from_dict(read_json(path), path)

    @staticmethod
    def from_dict(data: Mapping[str, Any], where: object = "rig") -> Rig:
        """From the mapping that `to_dict` makes. Raises InputError naming the key that is wrong."""
        schemas.check(data, "rig", where)
        camera = camera_from_dict(data["camera"], where)
        covariance = _joint_covariance(data["joint"], camera.parameter_names, where)
        if len(covariance) > len(RIG_PARAMETERS):
            lens = slice(len(RIG_PARAMETERS), None)
            camera = replace(camera, covariance=covariance[lens, lens])
        antenna, second = Antenna.from_dict(data["antenna"]), data.get("second_moment_sensor")
        T_antenna_camera = read_pose(data["T_antenna_camera"], where, "T_antenna_camera")
        check_view(T_antenna_camera, antenna.length_m, where)
        return Rig(
            camera=camera,
            T_antenna_camera=T_antenna_camera,
            antenna=antenna,
            moment_sensor=MomentSensor.from_dict(data["moment_sensor"]),
            kinematics=kinematics_from_dict(data["kinematics"], where),
            gravity_world_m_s2=np.asarray(data["gravity_world"], float),
            image=AntennaImage.from_dict(data["image"]),
            covariance=covariance,
            second_moment_sensor=None if second is None else MomentSensor.from_dict(second),
        )

    def to_dict(self) -> dict[str, Any]:
        """The part of rig.json that describes the rig; the provenance is added by who writes it."""
        second = self.second_moment_sensor
        return {
            "schema": SCHEMA,
            "camera": self.camera.to_dict(),
            "T_antenna_camera": self.T_antenna_camera.to_dict(),
            "antenna": self.antenna.to_dict(self.std),
            "moment_sensor": {
                **self.moment_sensor.to_dict(),
                "gain_std": self.std("moment_gain"),
                "offset_std_Nm": self.std("moment_offset_Nm"),
            },
            **({} if second is None else {"second_moment_sensor": second.to_dict()}),
            "kinematics": kinematics_to_dict(self.kinematics),
            "gravity_world": self.gravity_world_m_s2.tolist(),
            "image": self.image.to_dict(),
            "joint": {"parameters": list(self.parameter_names), "covariance": self.covariance.tolist()},
        }
