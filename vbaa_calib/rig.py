"""Everything that is known about one rig, and how well: rig.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from . import schemas
from .antenna.shape import PARAMETERS as ANTENNA_PARAMETERS
from .camera import Camera, CameraOnPlane
from .errors import InputError
from .files import read_json
from .geometry import PLANE_C, Kinematics, Plane, Pose
from .session import read_pose

SCHEMA = "vbaa.rig/1"

POSE_PARAMETERS = (
    "camera_about_x_rad",
    "camera_about_y_rad",
    "camera_about_z_rad",
    "camera_x_m",
    "camera_y_m",
    "camera_z_m",
)
SENSOR_PARAMETERS = ("moment_gain", "moment_offset_Nm")
RIG_PARAMETERS = POSE_PARAMETERS + ANTENNA_PARAMETERS + SENSOR_PARAMETERS
"""Order of the joint covariance, before the lens. The pose's six are the tangent of `T_antenna_camera.retract`."""
RIG_STEPS = np.array([1e-5] * 6 + [1e-5] * 2 + [1e-4] * 2 + [1e-3] * 4 + [1e-4])
"""Finite-difference steps of pose and antenna: small against the curvature of the model, large against its rounding."""
JOINT_AXES = ("axis_skew_rad", "axis_offset_m", "tilt_zero_rad")
"""What a sweep finds of the joints, in the order of `Kinematics`."""


@dataclass(frozen=True, eq=False)
class Antenna:
    """The antenna as calibrated: `parameters` (9,) in the order of `antenna.shape.PARAMETERS`."""

    length_m: float
    diameter_m: float
    parameters: np.ndarray

    @property
    def stiffness_Nm2(self) -> float:
        """EI."""
        return float(np.exp(self.parameters[6]))

    @property
    def mass_per_length_kg_m(self) -> float:
        """ρA."""
        return float(np.exp(self.parameters[7]))


@dataclass(frozen=True)
class MomentSensor:
    """reading = gain · moment + offset + noise of standard deviation std."""

    gain: float
    offset_Nm: float
    std_Nm: float


@dataclass(frozen=True)
class AntennaImage:
    """What the antenna looks like in this rig's pictures.

    Attributes
    ----------
    noise_px : typical standard deviation of one centreline point.
    noise_scale : spread of the no-load points about the solved shape over the spread that their profiles predict.
    bright : brighter than the background.
    weights : (b, g, r) that make the plane of a colour picture on which it stands out; None for the grey level.
    height : of the free antenna's line above its background, grey levels on that plane; None where not measured.
    """

    noise_px: float
    noise_scale: float
    bright: bool
    weights: tuple[float, float, float] | None = None
    height: float | None = None


@dataclass(frozen=True, eq=False)
class Rig:
    """A calibrated rig.

    Attributes
    ----------
    T_antenna_camera : pose of the camera in the antenna frame.
    gravity_world_m_s2 : (3,).
    covariance : (17 + P, 17 + P) joint covariance of `RIG_PARAMETERS` and the P parameters of the lens, in
        `parameter_names` order; (17, 17) where the lens counts as exact.
    """

    camera: Camera
    T_antenna_camera: Pose
    antenna: Antenna
    moment_sensor: MomentSensor
    kinematics: Kinematics
    gravity_world_m_s2: np.ndarray
    image: AntennaImage
    covariance: np.ndarray

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
        antenna, noload, sensor = data["antenna"], data["antenna"]["noload"], data["moment_sensor"]
        parameters = [
            *noload["clamp_offset_yz_m"],
            *noload["clamp_rotation_yz_rad"],
            *noload["bow_yz_per_m"],
            np.log(antenna["stiffness_Nm2"]),
            np.log(antenna["mass_per_length_kg_m"]),
            noload.get("clamp_give_m", 0.0),
        ]
        image, camera = data["image"], _camera(data["camera"], where)
        covariance = _joint_covariance(data["joint"], camera.parameter_names, where)
        if len(covariance) > len(RIG_PARAMETERS):
            lens = slice(len(RIG_PARAMETERS), None)
            camera = replace(camera, covariance=covariance[lens, lens])
        return Rig(
            camera=camera,
            T_antenna_camera=read_pose(data["T_antenna_camera"], where, "T_antenna_camera"),
            antenna=Antenna(float(antenna["length_m"]), float(antenna["diameter_m"]), np.array(parameters, float)),
            moment_sensor=MomentSensor(float(sensor["gain"]), float(sensor["offset_Nm"]), float(sensor["std_Nm"])),
            kinematics=_kinematics(data["kinematics"], where),
            gravity_world_m_s2=np.asarray(data["gravity_world"], float),
            image=_image(image),
            covariance=covariance,
        )

    def to_dict(self) -> dict[str, Any]:
        """The part of rig.json that describes the rig; the provenance is added by who writes it."""
        antenna, sensor = self.antenna, self.moment_sensor
        return {
            "schema": SCHEMA,
            "camera": self.camera.to_dict(),
            "T_antenna_camera": self.T_antenna_camera.to_dict(),
            "antenna": {
                "length_m": antenna.length_m,
                "diameter_m": antenna.diameter_m,
                "stiffness_Nm2": antenna.stiffness_Nm2,
                "stiffness_std_Nm2": antenna.stiffness_Nm2 * self.std("log_stiffness_Nm2"),
                "mass_per_length_kg_m": antenna.mass_per_length_kg_m,
                "mass_per_length_std_kg_m": antenna.mass_per_length_kg_m * self.std("log_mass_per_length_kg_m"),
                "noload": {
                    "clamp_offset_yz_m": antenna.parameters[0:2].tolist(),
                    "clamp_rotation_yz_rad": antenna.parameters[2:4].tolist(),
                    "bow_yz_per_m": antenna.parameters[4:6].tolist(),
                    "clamp_give_m": float(antenna.parameters[8]),
                },
            },
            "moment_sensor": {
                "gain": sensor.gain,
                "gain_std": self.std("moment_gain"),
                "offset_Nm": sensor.offset_Nm,
                "offset_std_Nm": self.std("moment_offset_Nm"),
                "std_Nm": sensor.std_Nm,
            },
            "kinematics": {
                "T_actuator_antenna": self.kinematics.T_actuator_antenna.to_dict(),
                "position_world_m": self.kinematics.position_world_m.tolist(),
                **{name: getattr(self.kinematics, name) for name in JOINT_AXES},
            },
            "gravity_world": self.gravity_world_m_s2.tolist(),
            "image": {
                "noise_px": self.image.noise_px,
                "noise_scale": self.image.noise_scale,
                "bright": self.image.bright,
                "weights_bgr": None if self.image.weights is None else list(self.image.weights),
                "height": self.image.height,
            },
            "joint": {"parameters": list(self.parameter_names), "covariance": self.covariance.tolist()},
        }


def _kinematics(data: Mapping[str, Any], where: object) -> Kinematics:
    mount = data.get("T_actuator_antenna")
    return Kinematics(
        Pose.identity() if mount is None else read_pose(mount, where, "kinematics.T_actuator_antenna"),
        np.asarray(data.get("position_world_m", (0.0, 0.0, 0.0)), float),
        *(float(data.get(name, 0.0)) for name in JOINT_AXES),
    )


def _image(data: Mapping[str, Any]) -> AntennaImage:
    weights, height = data.get("weights_bgr"), data.get("height")
    return AntennaImage(
        float(data["noise_px"]),
        float(data["noise_scale"]),
        bool(data["bright"]),
        None if weights is None else (float(weights[0]), float(weights[1]), float(weights[2])),
        None if height is None else float(height),
    )


def _camera(data: Mapping[str, Any], where: object) -> Camera:
    try:
        return Camera.from_dict(data)
    except InputError as error:
        raise InputError(f"camera: {error.what}", where=where, remedy=error.remedy) from None


def _joint_covariance(joint: Mapping[str, Any], lens: tuple[str, ...], where: object) -> np.ndarray:
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
