"""A scene file to a `Scene`. Degrees only where the key says `_deg`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from targets.board import BoardSpec
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_yaml
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.session import NominalAntenna

from .bumps import Bump
from .fields import Section
from .lens import Lens, invertible
from .objects import LINES, SHAPES, WEDGES, TouchObject
from .scene import (
    IntrinsicsSpec,
    Joints,
    KnownLoad,
    MomentSensor,
    OverSpec,
    PictureSpec,
    Recording,
    Scene,
    Sweep,
    TrueAntenna,
    camera_pose,
)


def read_object(section: Section) -> TouchObject:
    """From the section `object`. Raises InputError naming the key that is wrong."""
    section.only(
        *("shape", "center_world_m", "axis_world", "wedge_world", "radius_m", "half_length_m", "stiffness_N_m"),
        *("friction", "bumps"),
    )
    shape = section.choice("shape", SHAPES)
    axis = section.direction("axis_world") if shape in LINES else np.array([0.0, 0.0, 1.0])
    rigid = not section.has("stiffness_N_m")
    if section.has("bumps") and shape != "freeform":
        raise section.wrong("bumps", f"do not go with a {shape}", "take the shape freeform")
    return TouchObject(
        shape=shape,
        center_world_m=section.array("center_world_m", (3,)),
        axis_world=axis,
        radius_m=section.number("radius_m", 1e-6, 1.0),
        half_length_m=section.number("half_length_m", 1e-3, 10.0, 0.1),
        stiffness_N_m=float("inf") if rigid else section.number("stiffness_N_m", 1e-3, 1e12),
        friction=section.number("friction", 0.0, 2.0, 0.0),
        wedge_world=_wedge(section, axis) if shape in WEDGES else np.array([1.0, 0.0, 0.0]),
        bumps=tuple(_bump(entry) for entry in section.sections("bumps")) if shape == "freeform" else (),
    )


def _wedge(section: Section, axis: np.ndarray) -> np.ndarray:
    wedge = section.direction("wedge_world")
    wedge = wedge - axis * (axis @ wedge)
    if np.linalg.norm(wedge) < 0.1:
        raise section.wrong("wedge_world", "runs along the edge", "a direction from the edge into the body is needed")
    return np.asarray(wedge / np.linalg.norm(wedge))


def _bump(section: Section) -> Bump:
    section.only("direction_world", "height_m", "width_m")
    height = section.number("height_m", -0.5, 0.5)
    try:
        return Bump(section.direction("direction_world"), height, section.number("width_m", 1e-4, 1.0))
    except InputError as error:
        raise section.wrong("height_m", f"does not fit: {error.what}", error.remedy or "make it flatter") from None


SCHEMA = "vbaa.scene/1"
_DISTORTION_LENGTHS = {"opencv": (0, 4, 5, 8, 12, 14), "fisheye": (4,)}


def load_scene(path: Path) -> Scene:
    """Read and check a scene file. Raises InputError naming the file and the key."""
    path = Path(path)
    top = Section(read_yaml(path), path)
    top.choice("schema", (SCHEMA,))
    top.only(
        *("schema", "name", "seed", "camera", "board", "jig", "antenna", "moment_sensor", "kinematics"),
        *("gravity_world", "object", "picture", "intrinsics", "noload", "loads", "recording", "sweep", "over"),
    )
    antenna = top.section("antenna")
    nominal, true = _antenna(antenna)
    jig = top.section("jig").only("T_antenna_board", "pictures")
    lens, T_antenna_camera = _camera(top.section("camera"))
    return Scene(
        name=str(top.get("name")),
        seed=top.whole("seed", 0, 2**63),
        lens=lens,
        T_antenna_camera=T_antenna_camera,
        board=_board(top),
        T_antenna_board=jig.pose("T_antenna_board"),
        jig_pictures=jig.whole("pictures", 1, 1000),
        antenna=nominal,
        true=true,
        moment=_moment(top.section("moment_sensor")),
        kinematics=_kinematics(top.section("kinematics", required=False)),
        gravity_world_m_s2=top.array("gravity_world", (3,)),
        object=read_object(top.section("object")),
        picture=_picture(top.section("picture", required=False)),
        intrinsics=_intrinsics(top.section("intrinsics")),
        noload=tuple(_joints(entry.only("pan_deg", "tilt_deg")) for entry in top.sections("noload")),
        loads=tuple(_load(entry, nominal.length_m) for entry in top.sections("loads")),
        recording=_recording(top.section("recording")),
        sweep=top.flag("sweep", False),
        over=_over(top.section("over")) if top.has("over") else None,
    )


def _angle(section: Section, key: str, low_deg: float, high_deg: float, default_deg: float | None = None) -> float:
    return float(np.deg2rad(section.number(key, low_deg, high_deg, default_deg)))


def _angles(section: Section, key: str, low_deg: float, high_deg: float) -> tuple[float, float]:
    first, last = np.deg2rad(section.span(key, low_deg, high_deg))
    return float(first), float(last)


def _camera(section: Section) -> tuple[Lens, Pose]:
    section.only("model", "image_size", "matrix", "distortion", "pose", "T_antenna_camera")
    model = section.choice("model", tuple(_DISTORTION_LENGTHS), "opencv")
    size = section.array("image_size", (2,))
    if not ((size == np.round(size)) & (size >= 16) & (size <= 20000)).all():
        raise section.wrong("image_size", f"is {size.tolist()}", "width and height in whole pixels are needed")
    matrix = section.array("matrix", (3, 3))
    free = np.array([[1, 0, 1], [0, 1, 1], [0, 0, 0]], bool)
    if (
        not np.array_equal(np.where(free, 0.0, matrix), np.diag([0.0, 0.0, 1.0]))
        or min(matrix[0, 0], matrix[1, 1]) <= 0
    ):
        raise section.wrong("matrix", "is not a camera matrix", "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]] is needed")
    distortion = section.array("distortion", (-1,), [])
    if len(distortion) not in _DISTORTION_LENGTHS[model]:
        lengths = ", ".join(map(str, _DISTORTION_LENGTHS[model]))
        raise section.wrong("distortion", f"has {len(distortion)} numbers", f"{lengths} are possible for {model}")
    lens = Lens(model, (int(size[0]), int(size[1])), matrix, distortion)
    if not invertible(lens):
        raise section.wrong("distortion", "folds back or has a pole inside the picture", "distort less")
    if section.has("T_antenna_camera") == section.has("pose"):
        raise section.wrong("pose", "and T_antenna_camera: exactly one is needed", "give one of the two")
    return lens, section.pose("T_antenna_camera") if section.has("T_antenna_camera") else _look_at(
        section.section("pose")
    )


def _look_at(section: Section) -> Pose:
    section.only("inclination_deg", "azimuth_deg", "roll_deg", "distance_m", "look_at_m")
    return camera_pose(
        _angle(section, "inclination_deg", 0.0, 80.0),
        _angle(section, "azimuth_deg", -360.0, 360.0, 180.0),
        _angle(section, "roll_deg", -180.0, 180.0, 0.0),
        section.number("distance_m", 0.01, 10.0),
        section.array("look_at_m", (3,)),
    )


def _board(top: Section) -> BoardSpec:
    try:
        return BoardSpec.from_dict(top.section("board").values)
    except ValueError as error:
        raise top.wrong("board", f"is wrong: {error}", "describe a ChArUco board") from None


def _antenna(section: Section) -> tuple[NominalAntenna, TrueAntenna]:
    nominal = ("length_m", "diameter_m", "youngs_modulus_Pa", "density_kg_m3")
    section.only(*nominal, "actual")
    true = section.section("actual", required=False).only(
        "stiffness_factor", "clamp_angle_rad", "clamp_offset_m", "natural_curvature_per_m", "holder_m"
    )
    antenna = NominalAntenna(
        length_m=section.number("length_m", 1e-3, 10.0),
        diameter_m=section.number("diameter_m", 1e-6, 0.1),
        youngs_modulus_Pa=section.number("youngs_modulus_Pa", 1e5, 2e12),
        density_kg_m3=section.number("density_kg_m3", 0.0, 3e4),
    )
    return antenna, TrueAntenna(
        stiffness_factor=true.number("stiffness_factor", 0.1, 10.0, 1.0),
        clamp_angle_rad=true.array("clamp_angle_rad", (2,), [0.0, 0.0]),
        clamp_offset_m=true.array("clamp_offset_m", (3,), [0.0, 0.0, 0.0]),
        natural_curvature_per_m=true.array("natural_curvature_per_m", (2,), [0.0, 0.0]),
        holder_m=true.array("holder_m", (2,), [0.0, 0.0]),
    )


def _moment(section: Section) -> MomentSensor:
    section.only("std_Nm", "gain", "offset_Nm")
    return MomentSensor(
        std_Nm=section.number("std_Nm", 1e-12, 10.0),
        gain=section.number("gain", 0.1, 10.0, 1.0),
        offset_Nm=section.number("offset_Nm", default=0.0),
    )


def _kinematics(section: Section) -> Kinematics:
    section.only("T_actuator_antenna", "position_world_m", "axis_skew_deg", "axis_offset_m", "tilt_zero_deg")
    mount = section.pose("T_actuator_antenna") if section.has("T_actuator_antenna") else Pose.identity()
    return Kinematics(
        mount,
        section.array("position_world_m", (3,), [0.0, 0.0, 0.0]),
        _angle(section, "axis_skew_deg", -20.0, 20.0, 0.0),
        section.number("axis_offset_m", -0.5, 0.5, 0.0),
        _angle(section, "tilt_zero_deg", -20.0, 20.0, 0.0),
    )


def _over(section: Section) -> OverSpec:
    section.only("height_m", "center_m", "turn_deg", "pictures", "pan_deg", "tilt_deg")
    x, y = section.array("center_m", (2,))
    return OverSpec(
        section.number("height_m", 0.0, 0.5),
        (float(x), float(y)),
        _angle(section, "turn_deg", -360.0, 360.0, 0.0),
        section.whole("pictures", 1, 100),
        Joints(_angle(section, "pan_deg", -180.0, 180.0, 0.0), _angle(section, "tilt_deg", -90.0, 90.0, 0.0)),
    )


def _picture(section: Section) -> PictureSpec:
    section.only(*PictureSpec.__dataclass_fields__)
    return PictureSpec(
        blur_px=section.number("blur_px", 0.0, 20.0, 0.7),
        read_noise=section.number("read_noise", 0.0, 100.0, 1.2),
        electrons_per_grey=section.number("electrons_per_grey", 1e-3, 1e9, 40.0),
        vignette=section.number("vignette", 0.0, 0.9, 0.25),
        gradient=section.number("gradient", 0.0, 0.9, 0.15),
        background=section.number("background", 0.0, 1.0, 0.28),
        clutter=section.number("clutter", 0.0, 1.0, 0.25),
        antenna=section.number("antenna", 0.0, 1.0, 0.92),
        object=section.number("object", 0.0, 1.0, 0.38),
        shading_asymmetry=section.number("shading_asymmetry", -1.0, 1.0, 0.0),
    )


def _intrinsics(section: Section) -> IntrinsicsSpec:
    section.only("pictures", "distance_m", "tilt_deg")
    distances = section.span("distance_m", 0.01, 10.0)
    return IntrinsicsSpec(section.whole("pictures", 1, 1000), distances, _angles(section, "tilt_deg", 0.0, 70.0))


def _joints(section: Section) -> Joints:
    return Joints(_angle(section, "pan_deg", -180.0, 180.0), _angle(section, "tilt_deg", -89.0, 89.0))


def _load(section: Section, length_m: float) -> KnownLoad:
    section.only("pan_deg", "tilt_deg", "distance_m", "force_y_N", "force_z_N")
    return KnownLoad(
        joints=_joints(section),
        distance_m=section.number("distance_m", 1e-3, length_m),
        force_y_N=section.number("force_y_N"),
        force_z_N=section.number("force_z_N"),
    )


def _recording(section: Section) -> Recording:
    section.only("rate_hz", "pause_s", "sweeps")
    return Recording(
        rate_hz=section.number("rate_hz", 1e-3, 1e5),
        pause_s=section.number("pause_s", 0.0, 3600.0, 5.0),
        sweeps=tuple(_sweep(entry) for entry in section.sections("sweeps")),
    )


def _sweep(section: Section) -> Sweep:
    section.only(*("press", "toward", "frames", "free_frames", "clearance_deg", "push_deg", "swells", "sweep_deg"))
    first, last = np.deg2rad(section.array("sweep_deg", (2,)))
    return Sweep(
        press=section.choice("press", ("pan", "tilt")),
        toward=1 if section.choice("toward", ("positive", "negative")) == "positive" else -1,
        frames=section.whole("frames", 1, 100000),
        free_frames=section.whole("free_frames", 1, 1000, 2),
        clearance_rad=_angle(section, "clearance_deg", 0.01, 90.0, 2.0),
        push_rad=_angles(section, "push_deg", 0.1, 60.0),
        swells=section.number("swells", 0.0, 100.0, 1.0),
        sweep_rad=(float(first), float(last)),
    )
