"""A simulated rig and its session: the checked content of a scene file, in SI units and radians."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, GetPydanticSchema, Strict

from targets.board import BoardWithIds
from vbaa_calib.antenna.rod import TORSION_RATIO, Rod
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.models import Number, WholeNumber, array_of, read_as
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.session import MomentSensor, NominalAntenna
from vbaa_calib.session.settings import FilePose

from .lens import Lens
from .objects import TouchObject


def _radians(angle_deg: Any) -> Any:
    """degrees to radians, for a number or a pair."""
    if isinstance(angle_deg, tuple):
        return _radians(angle_deg[0]), _radians(angle_deg[1])
    return float(np.deg2rad(angle_deg))


def degrees(low: float, high: float) -> GetPydanticSchema:
    """Annotation of an angle that the scene file has in degrees, between `low` and `high`."""
    return read_as(Annotated[Number, Field(ge=low, le=high)], _radians)


def _range(low: float, high: float, convert: Callable[[Any], Any] = tuple) -> GetPydanticSchema:
    """Annotation of a pair of a smallest and a largest value, both between `low` and `high` in the file's units."""

    def rising(pair: tuple[float, float]) -> Any:
        if pair[0] > pair[1]:
            raise ValueError(f"falls from {pair[0]:g} to {pair[1]:g}", "give the smaller one first")
        return convert(pair)

    one = Annotated[Number, Field(ge=low, le=high)]
    return read_as(tuple[one, one], rising)


@dataclass(frozen=True, eq=False)
class TrueAntenna:
    """Differences of the simulated antenna from what session.yaml states.

    Attributes
    ----------
    stiffness_factor : true EI over nominal EI. tip_factor : true diameter at the tip over the nominal one, between it
        and the clamp's evenly; stiffness and weight follow.
    clamp_angle_rad : (2,) turn of the clamped tangent about the antenna frame's y and z axes.
    clamp_offset_m : (3,) the clamp in the antenna frame.
    natural_curvature_per_m : (2,) bow of the unloaded, weightless wire about its own y and z axes.
    holder_m : (2,) radius and length of the dark collet that holds the antenna; zeros for none.
    """

    stiffness_factor: Annotated[Number, Field(ge=0.1, le=10)] = 1.0
    tip_factor: Annotated[Number, Field(ge=0.05, le=20)] = 1.0
    clamp_angle_rad: Annotated[np.ndarray, array_of(2)] = field(default_factory=lambda: np.zeros(2))
    clamp_offset_m: Annotated[np.ndarray, array_of(3)] = field(default_factory=lambda: np.zeros(3))
    natural_curvature_per_m: Annotated[np.ndarray, array_of(2)] = field(default_factory=lambda: np.zeros(2))
    holder_m: Annotated[np.ndarray, array_of(2)] = field(default_factory=lambda: np.zeros(2))


@dataclass(frozen=True, eq=False)
class WrenchSpec:
    """A sensor of several axes: session.yaml's description, and its true parameters.

    Each component reads gain · component + offset + noise, right-handed, in the sensor's axes.

    Attributes
    ----------
    turn_rad : (3,) rotation vector, antenna frame, by which its axes are off those of T_antenna_sensor.
    offset_N, offset_Nm : of every force, and of every moment.
    """

    components: tuple[Literal["fx", "fy", "fz", "mx", "my", "mz"], ...] = ("fx", "fy", "fz", "mx", "my", "mz")
    std_N: Annotated[Number, Field(ge=1e-12, le=10)] = 3e-3
    std_Nm: Annotated[Number, Field(ge=1e-12, le=10)] = 2e-5
    T_antenna_sensor: FilePose = field(default_factory=Pose.identity)
    turn_rad: Annotated[np.ndarray, array_of(3, ge=-0.5, le=0.5)] = field(
        default_factory=lambda: np.array([0.02, -0.024, 0.015])
    )
    gain: Annotated[Number, Field(ge=0.1, le=10)] = 1.02
    offset_N: Number = 0.05
    offset_Nm: Number = 3e-4

    def true(self, force_N: np.ndarray, moment_Nm: np.ndarray) -> np.ndarray:
        """(B, C) true components, from forces and moments (B, 3) about the antenna frame's origin."""
        turned = Pose.from_rotvec(self.turn_rad, np.zeros(3)).rotation @ self.T_antenna_sensor.rotation
        about = moment_Nm - np.cross(self.T_antenna_sensor.translation_m, force_N)
        both = {"f": force_N @ turned, "m": about @ turned}
        return np.stack([both[name[0]][:, "xyz".index(name[1])] for name in self.components], axis=1)

    def read(self, true: np.ndarray, noise: np.random.Generator) -> np.ndarray:
        """(B, C) readings of true components."""
        forces = np.array([name.startswith("f") for name in self.components])
        std, offset = np.where(forces, self.std_N, self.std_Nm), np.where(forces, self.offset_N, self.offset_Nm)
        return np.asarray(self.gain * true + offset + std * noise.standard_normal(true.shape))


_Share = Annotated[Number, Field(ge=0, le=1)]


@dataclass(frozen=True)
class PictureSpec:
    """Exposure, noise and blur of the pictures.

    Attributes
    ----------
    blur_px : standard deviation of the Gaussian point spread function.
    read_noise : standard deviation, grey levels.
    electrons_per_grey : photo-electrons behind one grey level; shot noise has the variance grey / electrons_per_grey.
    vignette, gradient : how much darker the corners, and one side, are (0 = even light).
    background : mean brightness of the bench, 0 to 1.
    clutter : contrast of texture and soft shapes on the bench, 0 to 1.
    antenna, object : albedo of the antenna's paint and of the object, 0 to 1.
    shading_asymmetry : how much brighter one side of the tube is; it pulls the centroid of its picture off the axis.
    """

    blur_px: Annotated[Number, Field(ge=0, le=20)] = 0.7
    read_noise: Annotated[Number, Field(ge=0, le=100)] = 1.2
    electrons_per_grey: Annotated[Number, Field(ge=1e-3, le=1e9)] = 40.0
    vignette: Annotated[Number, Field(ge=0, le=0.9)] = 0.25
    gradient: Annotated[Number, Field(ge=0, le=0.9)] = 0.15
    background: _Share = 0.28
    clutter: _Share = 0.25
    antenna: _Share = 0.92
    object: _Share = 0.38
    shading_asymmetry: Annotated[Number, Field(ge=-1, le=1)] = 0.0


Material = Literal["steel", "paint", "nitinol", "nylon", "clear", "rubber", "none"]
_Colour = tuple[_Share, _Share, _Share]
Stretch = tuple[
    Annotated[Number, Field(ge=0)],
    Annotated[Number, Field(gt=0)],
    Material,
    _Colour | None,
    Annotated[Number, Field(ge=0, le=0.01)],
]
"""Of the antenna, where it looks different: first and last arc length, material, colour, and by how much its radius is
larger (m; labels have the bare antenna)."""


@dataclass(frozen=True)
class TraceSpec:
    """Properties of path-traced pictures in addition to those of all pictures.

    Attributes
    ----------
    material : of the antenna; none leaves the antenna away.
    colour : reflectance of paint in red, green and blue; None: grey, `picture.antenna`.
    stretches : where the antenna looks different; of two that overlap the later one is seen.
    bench, light : background and lighting.
    bench_below_m : how far the bench is below the joints.
    bench_roughness : None: matt; else of the gloss on it, 0.02 like a film of water.
    aperture_m : diameter of the lens's opening; 0: everything is sharp. focus_m : depth that is sharp, by default the
        middle of the straight antenna.
    shutter : how much of the time between two frames of a recording the picture is exposed, 0: an instant.
    readout : how much of that time passes from the first row to the last, 0: a global shutter.
    exposure : brightness of a white card that lies at the antenna.
    color : three channels. samples : light paths for each pixel.
    """

    material: Material = "steel"
    colour: _Colour | None = None
    stretches: Annotated[tuple[Stretch, ...], read_as(Annotated[list[Stretch], Strict()], tuple)] = ()
    bench: Literal["plain", "cluttered", "wood", "cloth", "patchwork"] = "plain"
    light: Literal["softboxes", "lamp", "side", "daylight"] = "softboxes"
    bench_below_m: Annotated[Number, Field(ge=0.02, le=2)] = 0.15
    bench_roughness: Annotated[Number, Field(ge=0.001, le=1)] | None = None
    aperture_m: Annotated[Number, Field(ge=0, le=0.05)] = 0.0
    focus_m: Annotated[Number, Field(ge=0.01, le=10)] | None = None
    shutter: _Share = 0.0
    readout: _Share = 0.0
    exposure: Annotated[Number, Field(ge=0.01, le=10)] = 0.8
    color: Annotated[bool, Strict()] = False
    samples: Annotated[WholeNumber, Field(ge=1, le=65536)] = 48


@dataclass(frozen=True)
class IntrinsicsSpec:
    """Pictures of the board in the hand: their number, and the ranges of distance and tilt."""

    pictures: Annotated[WholeNumber, Field(ge=1, le=1000)]
    distance_m: Annotated[tuple[float, float], _range(0.01, 10)]
    tilt_rad: Annotated[tuple[float, float], _range(0, 70, _radians), Field(alias="tilt_deg")]


@dataclass(frozen=True)
class Joints:
    """The two joint angles."""

    pan_rad: Annotated[float, degrees(-180, 180), Field(alias="pan_deg")]
    tilt_rad: Annotated[float, degrees(-89, 89), Field(alias="tilt_deg")]


@dataclass(frozen=True)
class KnownLoad(Joints):
    """A load that keeps its direction (a thread over a pulley): force components (y, z) in the antenna frame."""

    distance_m: Annotated[Number, Field(ge=1e-3)]
    force_y_N: Number
    force_z_N: Number


@dataclass(frozen=True)
class Sweep:
    """One stroke of a recording: the joint `press` moves towards the object, beyond first touch, while the other
    joint sweeps.

    Attributes
    ----------
    press : "pan" or "tilt".
    toward : +1 or −1, the way `press` turns when it approaches.
    frames : frames in contact.
    free_frames : frames before and after, backed off from first touch by `clearance_rad`.
    push_rad : smallest and largest push past first touch; it swells and ebbs between them `swells` times.
    sweep_rad : first and last angle of the other joint.
    """

    press: Annotated[str, read_as(Literal["pan", "tilt"], str)]
    toward: Annotated[int, read_as(Literal["positive", "negative"], {"positive": 1, "negative": -1}.__getitem__)]
    frames: Annotated[WholeNumber, Field(ge=1, le=100_000)]
    free_frames: Annotated[WholeNumber, Field(ge=1, le=1000, default=2)]
    clearance_rad: Annotated[float, degrees(0.01, 90), Field(alias="clearance_deg", default=_radians(2.0))]
    push_rad: Annotated[tuple[float, float], _range(0.1, 60, _radians), Field(alias="push_deg")]
    swells: Annotated[Number, Field(ge=0, le=100, default=1.0)]
    sweep_rad: Annotated[tuple[float, float], read_as(tuple[Number, Number], _radians), Field(alias="sweep_deg")]


@dataclass(frozen=True)
class PlannedStrokes:
    """Strokes along the object, one after the other, at one rate; `pause_s` passes between two strokes."""

    rate_hz: Annotated[Number, Field(ge=1e-3, le=1e5)]
    pause_s: Annotated[Number, Field(ge=0, le=3600, default=5.0)]
    sweeps: Annotated[tuple[Sweep, ...], read_as(Annotated[list[Sweep], Strict(), Field(min_length=1)], tuple)]


@dataclass(frozen=True)
class OverSpec:
    """Pose of the board under the antenna.

    Attributes
    ----------
    height_m : plane C above the printed face.
    center_m : the board's middle in plane C, antenna frame (x, y).
    turn_rad : of the board's x axis from the antenna's, seen by the viewer, clockwise.
    shadow : how much of the light the antenna's shadow takes, 0 for none. penumbra_m : its softness on the board.
    """

    height_m: Annotated[Number, Field(ge=0, le=0.5)]
    center_m: tuple[Number, Number]
    pictures: Annotated[WholeNumber, Field(ge=1, le=100)]
    turn_rad: Annotated[float, degrees(-360, 360), Field(alias="turn_deg")] = 0.0
    pan_rad: Annotated[float, degrees(-180, 180), Field(alias="pan_deg")] = 0.0
    tilt_rad: Annotated[float, degrees(-90, 90), Field(alias="tilt_deg")] = 0.0
    shadow: _Share = 0.35
    penumbra_m: Annotated[Number, Field(ge=0, le=0.1)] = 1.5e-3

    @property
    def joints(self) -> Joints:
        """The joint angles of that picture."""
        return Joints(self.pan_rad, self.tilt_rad)

    def T_antenna_board(self, spec: BoardWithIds) -> Pose:
        """Pose of the printed face, with z opposite to the antenna frame's."""
        cos, sin = np.cos(self.turn_rad), np.sin(self.turn_rad)
        rotation = np.array([[cos, -sin, 0.0], [-sin, -cos, 0.0], [0.0, 0.0, -1.0]])
        return Pose(
            rotation, np.array([*self.center_m, -self.height_m]) - rotation[:, :2] @ spec.outline_m.mean(axis=0)
        )


@dataclass(frozen=True, eq=False)
class SceneSpec:
    """The content of a whole scene file.

    Attributes
    ----------
    T_antenna_board : pose of the jig's board, back face, in the antenna frame.
    gravity_world_m_s2 : (3,).
    sweep : whether there are pictures of a board fixed in the world. over : of the free antenna over a board, if any.
    cameras : lens and T_antenna_camera by name, of several; lens and pose are those of the one called `camera`.
    """

    name: str
    seed: int
    lens: Lens
    T_antenna_camera: Pose
    board: BoardWithIds
    T_antenna_board: Pose
    jig_pictures: int
    antenna: NominalAntenna
    true: TrueAntenna
    moment: MomentSensor | None
    wrench: WrenchSpec | None
    kinematics: Kinematics
    gravity_world_m_s2: np.ndarray
    object: TouchObject
    picture: PictureSpec
    intrinsics: IntrinsicsSpec
    noload: tuple[Joints, ...]
    loads: tuple[KnownLoad, ...]
    recording: PlannedStrokes
    sweep: bool = False
    over: OverSpec | None = None
    traced: TraceSpec = field(default_factory=TraceSpec)
    cameras: Mapping[str, tuple[Lens, Pose]] = field(default_factory=dict)
    camera: str = ""

    def of_camera(self, name: str) -> SceneSpec:
        """The scene with one of its cameras as its only one."""
        lens, T_antenna_camera = self.cameras[name]
        return replace(self, lens=lens, T_antenna_camera=T_antenna_camera, camera=name)

    @property
    def T_antenna_face(self) -> Pose:
        """Pose of the jig board's printed face: one thickness in front of its back."""
        return self.T_antenna_board @ Pose(np.eye(3), np.array([0.0, 0.0, -self.board.thickness_m]))

    @property
    def radius_m(self) -> float:
        """Radius of the antenna, at its clamp."""
        return self.antenna.diameter_m / 2

    def T_world_antenna(self, joints: Joints) -> Pose:
        """Pose of the antenna frame at joint angles."""
        return self.kinematics.T_world_antenna(joints.pan_rad, joints.tilt_rad)

    def T_world_camera(self, joints: Joints) -> Pose:
        """Pose of the camera at joint angles."""
        return self.T_world_antenna(joints) @ self.T_antenna_camera


def true_rod(scene: SceneSpec) -> Rod:
    """The antenna with its true parameters. A round wire: GJ = EI / (1 + ν)."""
    stiffness = scene.antenna.stiffness_Nm2 * scene.true.stiffness_factor
    taper, tip = scene.antenna.taper, scene.true.tip_factor
    about_y, about_z = scene.true.clamp_angle_rad
    return Rod(
        length_m=scene.antenna.length_m,
        bending_stiffness_Nm2=stiffness,
        torsional_stiffness_Nm2=stiffness / TORSION_RATIO,
        mass_per_length_kg_m=scene.antenna.mass_per_length_kg_m,
        T_antenna_clamp=Pose.from_rotvec(np.array([0.0, about_y, about_z]), scene.true.clamp_offset_m),
        natural_curvature_per_m=scene.true.natural_curvature_per_m,
        taper=taper if tip == 1.0 else taper.thinned(float(np.log(tip))),
    )


def camera_pose(
    inclination_rad: float, azimuth_rad: float, roll_rad: float, distance_m: float, look_at_m: np.ndarray
) -> Pose:
    """T_antenna_camera of a camera that looks at a point from above.

    Its axis leans by `inclination_rad` from the antenna frame's z; seen from the point, the camera leans toward the
    direction `azimuth_rad` in plane C, counted from x to y. Without roll, the antenna's x axis runs to the right.
    """
    sin, cos = np.sin(inclination_rad), np.cos(inclination_rad)
    toward_camera = np.array([sin * np.cos(azimuth_rad), sin * np.sin(azimuth_rad), cos])
    forward = -toward_camera
    right = np.array([1.0, 0.0, 0.0]) - forward[0] * forward
    right /= np.linalg.norm(right)
    upright = np.stack([right, np.cross(forward, right), forward], axis=1)
    turn = Pose.from_rotvec(np.array([0.0, 0.0, roll_rad]), np.zeros(3)).rotation
    return Pose(upright @ turn, look_at_m + distance_m * toward_camera)


def bundled_scene(name: str) -> Path:
    """Path of a scene that comes with the package. Raises InputError when there is none of that name."""
    path = Path(__file__).parent / "scenes" / f"{name}.yaml"
    if name not in _bundled_names():
        remedy = f"the bundled ones are {', '.join(_bundled_names())}"
        raise InputError("is neither a file nor a bundled scene", where=name, remedy=remedy)
    return path


def _bundled_names() -> list[str]:
    """Names of the scenes that come with the package."""
    return sorted(path.stem for path in (Path(__file__).parent / "scenes").glob("*.yaml"))
