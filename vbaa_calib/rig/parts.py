"""The parts of a rig, each with the way to and from its place in rig.json, which the schema has checked before."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.session import read_pose

JOINT_AXES = ("axis_skew_rad", "axis_offset_m", "tilt_zero_rad")
"""What a sweep finds of the joints, in the order of `Kinematics`."""
NEAREST_M = 1e-3
"""What comes nearer to the camera's plane counts as not in front of it."""


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

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> Antenna:
        """From the mapping `antenna` of rig.json."""
        noload = data["noload"]
        parameters = [
            *noload["clamp_offset_yz_m"],
            *noload["clamp_rotation_yz_rad"],
            *noload["bow_yz_per_m"],
            np.log(data["stiffness_Nm2"]),
            np.log(data["mass_per_length_kg_m"]),
            noload.get("clamp_give_m", 0.0),
        ]
        return Antenna(float(data["length_m"]), float(data["diameter_m"]), np.array(parameters, float))

    def to_dict(self, std: Callable[[str], float]) -> dict[str, Any]:
        """The mapping `antenna` of rig.json; `std` gives the standard deviation of a parameter by its name."""
        return {
            "length_m": self.length_m,
            "diameter_m": self.diameter_m,
            "stiffness_Nm2": self.stiffness_Nm2,
            "stiffness_std_Nm2": self.stiffness_Nm2 * std("log_stiffness_Nm2"),
            "mass_per_length_kg_m": self.mass_per_length_kg_m,
            "mass_per_length_std_kg_m": self.mass_per_length_kg_m * std("log_mass_per_length_kg_m"),
            "noload": {
                "clamp_offset_yz_m": self.parameters[0:2].tolist(),
                "clamp_rotation_yz_rad": self.parameters[2:4].tolist(),
                "bow_yz_per_m": self.parameters[4:6].tolist(),
                "clamp_give_m": float(self.parameters[8]),
            },
        }


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

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> AntennaImage:
        """From the mapping `image` of rig.json."""
        weights, height = data.get("weights_bgr"), data.get("height")
        return AntennaImage(
            float(data["noise_px"]),
            float(data["noise_scale"]),
            bool(data["bright"]),
            None if weights is None else (float(weights[0]), float(weights[1]), float(weights[2])),
            None if height is None else float(height),
        )

    def to_dict(self) -> dict[str, Any]:
        """The mapping `image` of rig.json."""
        return {
            "noise_px": self.noise_px,
            "noise_scale": self.noise_scale,
            "bright": self.bright,
            "weights_bgr": None if self.weights is None else list(self.weights),
            "height": self.height,
        }


def kinematics_from_dict(data: Mapping[str, Any], where: object) -> Kinematics:
    """From the mapping `kinematics` of rig.json. Raises InputError when a quaternion is none."""
    mount, uncertain = data.get("T_actuator_antenna"), data.get("axes_uncertainty", {})
    return Kinematics(
        Pose.identity() if mount is None else read_pose(mount, where, "kinematics.T_actuator_antenna"),
        np.asarray(data.get("position_world_m", (0.0, 0.0, 0.0)), float),
        **{name: float(data.get(name, 0.0)) for name in JOINT_AXES},
        axes_std=np.asarray(uncertain.get("std", np.zeros(3)), float),
        axes_by_pose=np.asarray(uncertain.get("by_pose", np.zeros((3, 6))), float),
    )


def kinematics_to_dict(kinematics: Kinematics) -> dict[str, Any]:
    """The mapping `kinematics` of rig.json."""
    return {
        "T_actuator_antenna": kinematics.T_actuator_antenna.to_dict(),
        "position_world_m": kinematics.position_world_m.tolist(),
        **{name: getattr(kinematics, name) for name in JOINT_AXES},
        "axes_uncertainty": {
            "axes": list(JOINT_AXES),
            "std": kinematics.axes_std.tolist(),
            "by_pose": kinematics.axes_by_pose.tolist(),
        },
    }


def camera_from_dict(data: Mapping[str, Any], where: object) -> Camera:
    """From the mapping `camera` of rig.json. Raises InputError naming what is wrong with it."""
    try:
        return Camera.from_dict(data)
    except InputError as error:
        raise InputError(f"camera: {error.what}", where=where, remedy=error.remedy) from None


def check_view(T_antenna_camera: Pose, length_m: float, where: object) -> None:
    """Raises InputError when the undeformed antenna is nowhere in front of the camera, where no picture shows it."""
    along = np.linspace(0.0, length_m, 9)[:, None] * [1.0, 0.0, 0.0]
    depth_m = (T_antenna_camera.inverse() @ along)[:, 2]
    if depth_m.max() < NEAREST_M:
        raise InputError(
            f"T_antenna_camera: the antenna is nowhere {1e3 * NEAREST_M:g} mm or more in front of the camera",
            where=where,
            remedy="it is the pose of the camera in the antenna frame, the camera's z forward",
        )
