"""The model of rig.json."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import ConfigDict, Field

from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError, Verdict
from vbaa_calib.core.models import FileModel, Number, WholeNumber, array_of, checked
from vbaa_calib.session import DRIFTS, FileDrift, MomentSensor, MovingClamp
from vbaa_calib.session.settings import (
    AnyLength,
    CameraName,
    Deviation,
    Diameter,
    FileKinematics,
    FilePose,
    FileProfile,
    FileStiffnessProfile,
    Gravity,
)

from .parts import SCHEMA, Antenna, AntennaImage, Tip
from .wrench_sensor import WrenchSensor

_Side = Annotated[WholeNumber, Field(ge=1, le=100_000)]
_Focal = Annotated[Number, Field(ge=1, le=1e7)]
_Centre = Annotated[Number, Field(ge=-1e6, le=1e6)]
_Covariance = list[list[Annotated[Number, Field(ge=-1e12, le=1e12)]]]


@dataclass(frozen=True)
class _RigCamera:
    version: Annotated[Literal["vbaa.camera/1"], Field(alias="schema")]
    model: Literal["opencv", "fisheye"]
    image_size: tuple[_Side, _Side]
    matrix: Annotated[
        tuple[tuple[_Focal, Number, _Centre], tuple[Number, _Focal, _Centre], tuple[Number, Number, Number]],
        Field(description="px: [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]"),
    ]
    distortion: Annotated[list[Annotated[Number, Field(ge=-1e9, le=1e9)]], Field(max_length=14)]
    covariance: Annotated[_Covariance | None, Field(description="of the parameters, in their order")] = None
    parameters: list[str] | None = None


def can_hold(camera: Camera) -> bool:
    """Whether a camera's numbers are within the bounds of rig.json."""
    try:
        checked(_RigCamera, camera.to_dict(), where=SCHEMA, remedy="")
    except InputError:
        return False
    return True


@dataclass(frozen=True, eq=False)
class _Noload:
    """The free antenna: position and angles at the clamp, and natural curvature."""

    clamp_offset_yz_m: Annotated[np.ndarray, array_of(2, ge=-1, le=1)]
    clamp_rotation_yz_rad: Annotated[np.ndarray, array_of(2, ge=-1.5, le=1.5)]
    bow_yz_per_m: Annotated[np.ndarray, array_of(2, ge=-1000, le=1000)]
    clamp_give_m: Annotated[
        Number, Field(ge=-1, le=1, description="length of antenna that would bend as much as the clamp gives way")
    ] = 0.0


@dataclass(frozen=True, eq=False)
class _RigAntenna:
    length_m: AnyLength
    diameter_m: Diameter
    stiffness_Nm2: Annotated[Number, Field(ge=1e-12, le=1e4, description="EI")]
    stiffness_std_Nm2: Deviation
    mass_per_length_kg_m: Annotated[Number, Field(ge=1e-9, le=100)]
    noload: _Noload
    mass_per_length_std_kg_m: Number | None = None
    profile: Annotated[FileProfile | None, Field(description="diameters along it, m; null: uniform")] = None
    stiffness_profile: FileStiffnessProfile = None
    tip: Tip | None = None
    parameters_std: Annotated[
        np.ndarray, array_of(9, ge=0, le=1e3), Field(description="of one of several, in the order of joint.parameters")
    ] = field(default_factory=lambda: np.zeros(9))

    def antenna(self) -> Antenna:
        free = self.noload
        parameters = [
            *free.clamp_offset_yz_m,
            *free.clamp_rotation_yz_rad,
            *free.bow_yz_per_m,
            np.log(self.stiffness_Nm2),
            np.log(self.mass_per_length_kg_m),
            free.clamp_give_m,
        ]
        return Antenna(self.length_m, self.diameter_m, np.array(parameters), self.profile, self.stiffness_profile)


@dataclass(frozen=True)
class _RigSensor(MomentSensor):
    gain_std: Deviation | None = None
    offset_std_Nm: Deviation | None = None


@dataclass(frozen=True, eq=False)
class _AxesUncertainty:
    """Uncertainty of axis_skew_rad, axis_offset_m and tilt_zero_rad."""

    std: Annotated[
        np.ndarray, array_of(3, ge=0, le=1), Field(description="standard deviations for a camera pose that is exact")
    ] = field(default_factory=lambda: np.zeros(3))
    by_pose: Annotated[
        np.ndarray,
        array_of(3, 6, ge=-1000, le=1000),
        Field(description="how much the three are off for a camera pose that is off by a unit of its tangent"),
    ] = field(default_factory=lambda: np.zeros((3, 6)))
    axes: list[Literal["axis_skew_rad", "axis_offset_m", "tilt_zero_rad"]] | None = None


@dataclass(frozen=True, eq=False)
class _RigKinematics(FileKinematics):
    axes_uncertainty: _AxesUncertainty = field(default_factory=_AxesUncertainty)


@dataclass(frozen=True)
class Joint:
    """The joint covariance of everything that was solved together."""

    parameters: list[str]
    covariance: _Covariance


class RigFile(FileModel):
    """rig.json: a calibrated rig."""

    model_config = ConfigDict(extra="ignore")
    VERSION = SCHEMA
    version: Literal["vbaa.rig/1"] = Field(alias="schema")
    camera: _RigCamera
    T_antenna_camera: FilePose
    antenna: _RigAntenna
    moment_sensor: Annotated[_RigSensor | None, Field(description="about y; null: a rig without")]
    second_moment_sensor: Annotated[
        MomentSensor | None, Field(description="of older files: about z, as a wrench_sensor of mz that counts as exact")
    ] = None
    wrench_sensor: WrenchSensor | None = None
    kinematics: _RigKinematics
    gravity_world: Gravity
    image: AntennaImage
    joint: Joint
    drift: Annotated[FileDrift, Field(description="what may change between calibration and recording")] = DRIFTS["lab"]
    clamp: Annotated[
        MovingClamp | None,
        Field(description="of antennas whose clamp moves and turns: what no picture shows; null: one that does not"),
    ] = None
    antennas: Annotated[
        dict[str, _RigAntenna], Field(description="by name, where several in the same picture differ")
    ] = Field(default_factory=dict)
    camera_name: Annotated[CameraName, Field(description="of camera, among cameras")] = "camera"
    cameras: Annotated[
        dict[CameraName, dict[str, Any]],
        Field(description="further ones by name: camera, T_antenna_camera, image, joint, and what else differs here"),
    ] = Field(default_factory=dict)
    verdict: Verdict = Field(default_factory=Verdict, description="of the calibration: as bad as its worst finding")
    inputs_sha256: dict[str, str] | None = None
    versions: dict[str, Any] | None = None
    command: list[str] | None = None
    quality: dict[str, Any] | None = None

    @property
    def wrench(self) -> WrenchSensor | None:
        """The wrench sensor, if there is one."""
        second = self.second_moment_sensor
        return self.wrench_sensor or (None if second is None else WrenchSensor.about_z(second))
