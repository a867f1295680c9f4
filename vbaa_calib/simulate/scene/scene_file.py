"""Reads a scene file. Angles are in degrees where the key ends in `_deg`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, Strict

from targets.board import FileBoard
from vbaa_calib.core.errors import InputError, about
from vbaa_calib.core.files import read_yaml
from vbaa_calib.core.models import FileModel, Number, WholeNumber, array_of, checked, read_as
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.session import MomentSensor, NominalAntenna
from vbaa_calib.session.settings import AnyLength, CameraName, Diameter, FilePose, FileProfile, Gravity

from .lens import Lens, invertible
from .objects import LINES, WEDGES, TouchObject
from .scene import (
    IntrinsicsSpec,
    Joints,
    KnownLoad,
    OverSpec,
    PictureSpec,
    PlannedStrokes,
    SceneSpec,
    TraceSpec,
    TrueAntenna,
    WrenchSpec,
    camera_pose,
    degrees,
)

_Side = Annotated[WholeNumber, Field(ge=16, le=20_000)]


@dataclass(frozen=True, eq=False)
class _LookAt:
    inclination_rad: Annotated[float, degrees(0, 80), Field(alias="inclination_deg")]
    distance_m: Annotated[Number, Field(ge=0.01, le=10)]
    look_at_m: Annotated[np.ndarray, array_of(3)]
    azimuth_rad: Annotated[float, degrees(-360, 360), Field(alias="azimuth_deg")] = np.pi
    roll_rad: Annotated[float, degrees(-180, 180), Field(alias="roll_deg")] = 0.0


def _camera_matrix(matrix: np.ndarray) -> np.ndarray:
    free = np.array([[1, 0, 1], [0, 1, 1], [0, 0, 0]], bool)
    fixed = np.where(free, 0.0, matrix)
    if not np.array_equal(fixed, np.diag([0.0, 0.0, 1.0])) or min(matrix[0, 0], matrix[1, 1]) <= 0:
        raise ValueError("is not a camera matrix", "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]] is needed")
    return matrix


@dataclass(frozen=True, eq=False)
class _SceneCamera:
    image_size: tuple[_Side, _Side]
    matrix: Annotated[np.ndarray, read_as(Annotated[np.ndarray, array_of(3, 3)], _camera_matrix)]
    distortion: Annotated[list[Number], Strict()] = field(default_factory=list)
    model: Literal["opencv", "fisheye"] = "opencv"
    pose: Annotated[Pose, read_as(_LookAt, lambda read: camera_pose(**vars(read)))] | None = None
    T_antenna_camera: FilePose | None = None


def _lens_and_pose(read: _SceneCamera) -> tuple[Lens, Pose]:
    lengths = {"opencv": (0, 4, 5, 8, 12, 14), "fisheye": (4,)}[read.model]
    if len(read.distortion) not in lengths:
        possible = f"{', '.join(map(str, lengths))} are possible for {read.model}"
        raise ValueError(f"has {len(read.distortion)} numbers", possible, "distortion")
    lens = Lens(read.model, read.image_size, read.matrix, np.array(read.distortion, float))
    if not invertible(lens):
        raise ValueError("folds back or has a pole inside the picture", "distort less", "distortion")
    if (read.pose is None) == (read.T_antenna_camera is None):
        raise ValueError("and T_antenna_camera: exactly one is needed", "give one of the two", "pose")
    pose = read.pose or read.T_antenna_camera
    assert pose is not None
    return lens, pose


def _touch_object(read: TouchObject) -> TouchObject:
    edge, wedge = read.axis_world, read.wedge_world
    missing = {"axis_world": edge is None and read.shape in LINES}
    missing |= {"wedge_world": not wedge.any() and read.shape in WEDGES}
    missing |= {"bumps": not read.bumps and read.shape == "freeform"}
    for name in (name for name, is_missing in missing.items() if is_missing):
        raise ValueError("is missing", f"a {read.shape} needs it", name)
    if read.bumps and read.shape != "freeform":
        raise ValueError(f"do not go with a {read.shape}", "take the shape freeform", "bumps")
    axis = edge if read.shape in LINES else np.array([0.0, 0.0, 1.0])
    if read.shape not in WEDGES:
        return replace(read, axis_world=axis, wedge_world=np.array([1.0, 0.0, 0.0]))
    wedge = wedge - axis * (axis @ wedge)
    if np.linalg.norm(wedge) < 0.1:
        raise ValueError("runs along the edge", "a direction from the edge into the body is needed", "wedge_world")
    return replace(read, axis_world=axis, wedge_world=wedge / np.linalg.norm(wedge))


FileObject = Annotated[TouchObject, AfterValidator(_touch_object)]
"""The object as scene files and truth.json hold it."""


@dataclass(frozen=True)
class _SceneAntenna:
    length_m: AnyLength
    diameter_m: Diameter
    youngs_modulus_Pa: Annotated[Number, Field(ge=1e5, le=2e12)]
    density_kg_m3: Annotated[Number, Field(ge=0, le=3e4)]
    profile: FileProfile | None = None
    stiffness_profile: FileProfile | None = None
    actual: TrueAntenna = field(default_factory=TrueAntenna)


def _nominal_and_true(read: _SceneAntenna) -> tuple[NominalAntenna, TrueAntenna]:
    nominal = NominalAntenna(
        read.length_m,
        read.diameter_m,
        read.youngs_modulus_Pa,
        read.density_kg_m3,
        profile=read.profile,
        stiffness_profile=read.stiffness_profile,
    )
    return nominal, read.actual


def _with_gain(sensor: Any) -> Any:
    """A scene's `moment_sensor` with gain 1 and offset 0 where these are not stated."""
    return {"gain": 1.0, "offset_Nm": 0.0, **sensor} if isinstance(sensor, Mapping) else sensor


@dataclass(frozen=True, eq=False)
class _SceneJig:
    T_antenna_board: FilePose
    pictures: Annotated[WholeNumber, Field(ge=1, le=1000)]


@dataclass(frozen=True, eq=False)
class _SceneKinematics:
    T_actuator_antenna: FilePose = field(default_factory=Pose.identity)
    position_world_m: Annotated[np.ndarray, array_of(3)] = field(default_factory=lambda: np.zeros(3))
    axis_skew_rad: Annotated[float, degrees(-20, 20), Field(alias="axis_skew_deg")] = 0.0
    axis_offset_m: Annotated[Number, Field(ge=-0.5, le=0.5)] = 0.0
    tilt_zero_rad: Annotated[float, degrees(-20, 20), Field(alias="tilt_zero_deg")] = 0.0


class _SceneFile(FileModel):
    """A scene file: the parts of a simulated rig, and its session."""

    VERSION = "vbaa.scene/1"
    FURTHER_KEYS = False
    version: Literal["vbaa.scene/1"] = Field(alias="schema")
    name: Annotated[str, BeforeValidator(str)]
    seed: Annotated[WholeNumber, Field(ge=0, le=2**63)]
    camera: Annotated[tuple[Lens, Pose], read_as(_SceneCamera, _lens_and_pose)] | None = None
    cameras: dict[CameraName, Annotated[tuple[Lens, Pose], read_as(_SceneCamera, _lens_and_pose)]] = Field(
        default_factory=dict
    )
    board: FileBoard
    jig: _SceneJig
    antenna: Annotated[tuple[NominalAntenna, TrueAntenna], read_as(_SceneAntenna, _nominal_and_true)]
    moment_sensor: Annotated[MomentSensor, BeforeValidator(_with_gain)] | None = None
    wrench_sensor: WrenchSpec | None = None
    kinematics: Annotated[Kinematics, read_as(_SceneKinematics, lambda read: Kinematics(**vars(read)))] = Field(
        default_factory=Kinematics
    )
    gravity_world: Gravity
    object: FileObject
    picture: PictureSpec = Field(default_factory=PictureSpec)
    intrinsics: IntrinsicsSpec
    noload: Annotated[tuple[Joints, ...], read_as(Annotated[list[Joints], Strict(), Field(min_length=1)], tuple)]
    loads: Annotated[tuple[KnownLoad, ...], read_as(Annotated[list[KnownLoad], Strict(), Field(min_length=1)], tuple)]
    recording: PlannedStrokes
    sweep: Annotated[bool, Strict()] = False
    over: OverSpec | None = None
    traced: TraceSpec = Field(default_factory=TraceSpec)


def load_scene(path: Path) -> SceneSpec:
    """Read and check a scene file. Raises InputError naming the file and the key."""
    path = Path(path)
    with about(path):
        read = checked(_SceneFile, _without_nulls(read_yaml(path)), path, "the bundled scene demo shows every key")
    if (read.camera is None) == (not read.cameras):
        raise InputError("camera and cameras: exactly one is needed", where=path, remedy="give one of the two")
    if len(read.cameras) > 0 and (read.sweep or read.over is not None):
        what = f"{'sweep' if read.sweep else 'over'} does not go with cameras"
        raise InputError(what, where=path, remedy="leave it out, or give one camera")
    first = next(iter(read.cameras), "")
    one = read.cameras[first] if read.camera is None else read.camera
    (lens, T_antenna_camera), (nominal, true) = one, read.antenna
    for number, load in enumerate(read.loads):
        if load.distance_m > nominal.length_m:
            what = f"loads.{number}.distance_m: {load.distance_m:g} is beyond the antenna's {nominal.length_m:g} m"
            raise InputError(what, where=path, remedy="give metres from the clamp along the antenna")
    same = {name: getattr(read, name) for name in _SceneFile.model_fields if name in SceneSpec.__dataclass_fields__}
    made = {
        "lens": lens,
        "camera": first,
        "T_antenna_camera": T_antenna_camera,
        "T_antenna_board": read.jig.T_antenna_board,
        "jig_pictures": read.jig.pictures,
        "antenna": nominal,
        "true": true,
        "moment": None if read.wrench_sensor else read.moment_sensor,
        "wrench": read.wrench_sensor,
        "gravity_world_m_s2": read.gravity_world,
    }
    return SceneSpec(**same | made)


def _without_nulls(data: Any) -> Any:
    """A key without a value counts as missing."""
    if isinstance(data, Mapping):
        return {key: _without_nulls(value) for key, value in data.items() if value is not None}
    return [_without_nulls(value) for value in data] if isinstance(data, list) else data
