"""session.yaml: the rig as known before its calibration, and the optional folders of a session."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, GetPydanticSchema
from pydantic.json_schema import JsonSchemaValue

from targets.board import BoardWithIds, FileBoard
from vbaa_calib.antenna.materials import MATERIALS, Material, round_wire
from vbaa_calib.antenna.taper import Taper
from vbaa_calib.core.arrays import real_gravity, validate_arguments
from vbaa_calib.core.errors import Diagnosis, InputError, about
from vbaa_calib.core.files import read_yaml
from vbaa_calib.core.models import FileModel, Number, array_of, checked, read_as
from vbaa_calib.detect.board.board_file import with_ids
from vbaa_calib.geometry import Kinematics, Pose

from .drift import DRIFTS, Drift
from .moment_sensor import READINGS, MomentSensor

if TYPE_CHECKING:
    from .tables import Still

SCHEMA = "vbaa.session/1"
STANDARD_GRAVITY_M_S2 = 9.80665

Deviation = Annotated[Number, Field(ge=0)]
AnyLength = Annotated[Number, Field(ge=1e-3, le=10)]
Diameter = Annotated[Number, Field(ge=1e-6, le=0.1)]
FileProfile = tuple[tuple[Annotated[Number, Field(ge=0, le=10)], Annotated[Number, Field(ge=0, le=1e6)]], ...]
"""Rows of arc length from the clamp, m, and a value there, as our files write them."""
FileStiffnessProfile = Annotated[
    FileProfile | None, Field(description="EI along it, relative, where it does not follow the diameter's fourth power")
]


@dataclass(frozen=True)
class NominalTip:
    """Uncertainty of the visible end's position at `length_m`, which determines the camera's distance."""

    length_std_m: Annotated[Number, Field(ge=0, le=0.1, description="standard deviation of length_m")] = 3e-4
    shape_std_m: Annotated[
        Annotated[Number, Field(ge=0, le=0.1)] | None,
        Field(description="what cutting and rounding leave open of where the end shows; null: a seventh of diameter_m"),
    ] = None


def _with_material(antenna: Any) -> Any:
    """session.yaml's `antenna`, with modulus and density of its named material where they are missing, and with the
    diameter that its profile has at the clamp."""
    if not isinstance(antenna, Mapping):
        return antenna
    profile = antenna.get("profile")
    if "diameter_m" not in antenna and isinstance(profile, list) and profile and isinstance(profile[0], list):
        antenna = {"diameter_m": profile[0][-1], **antenna}
    if (known := Material.named(antenna.get("material"))) is None:
        return antenna
    return {"youngs_modulus_Pa": known.youngs_modulus_Pa, "density_kg_m3": known.density_kg_m3, **antenna}


def _or_material(schema: dict[str, Any]) -> None:
    """The JSON Schema in which modulus and density may be missing where a known material is named, and the diameter
    where there is a profile."""
    schema["required"] = ["length_m"]
    schema["allOf"] = [{"anyOf": [{"required": [key]} for key in ("diameter_m", "profile")]}]
    known = {"required": ["material"], "properties": {"material": {"enum": list(MATERIALS)}}}
    schema["anyOf"] = [{"required": ["youngs_modulus_Pa", "density_kg_m3"]}, known]


@dataclass(frozen=True)
class NominalAntenna:
    """The antenna's nominal properties; stiffness and no-load shape are solved for.

    tip : None where the visible end cannot be used: a ball, a sheath, or a tip outside every picture.
    material : a name of `materials.MATERIALS`, or any other word; None: not known.
    """

    __pydantic_config__ = ConfigDict(extra="forbid", json_schema_extra=_or_material)

    length_m: AnyLength
    diameter_m: Diameter
    youngs_modulus_Pa: Annotated[Number, Field(ge=1e5, le=2e12)]
    density_kg_m3: Annotated[Number, Field(ge=10, le=3e4)]
    tip: NominalTip | None = NominalTip()
    material: Annotated[
        Annotated[str, Field(min_length=1, max_length=60)] | None,
        Field(description="by it youngs_modulus_Pa and density_kg_m3 are known where they are missing"),
    ] = None
    profile: Annotated[
        FileProfile | None,
        Field(description="diameters along it, m, linear between; two rows at one place are a step. null: uniform"),
    ] = None
    stiffness_profile: FileStiffnessProfile = None
    diameter_std_m: Annotated[
        Number, Field(ge=0, le=0.01, description="how well the profile's diameters are known, each; 0: exactly")
    ] = 5e-6

    def __post_init__(self) -> None:
        """Raises InputError for a profile that does not fit this antenna."""
        _ = self.taper
        if self.profile and not math.isclose(self.profile[0][1], self.diameter_m, rel_tol=0.01):
            raise InputError(
                f"antenna.diameter_m is {self.diameter_m:g}, antenna.profile begins with {self.profile[0][1]:g}",
                remedy="give the clamp's diameter, or leave diameter_m out",
            )

    @property
    def taper(self) -> Taper:
        """The stated taper from clamp to tip."""
        return Taper.of(self.profile, self.stiffness_profile, self.length_m)

    @property
    def log_tip_std(self) -> float:
        """Standard deviation of the logarithm of the tip's diameter over the clamp's; 0 for a uniform antenna."""
        if not self.taper:
            return 0.0
        tip_m = self.diameter_m * float(self.taper.diameter(np.ones(1))[0])
        return math.hypot(self.diameter_std_m / self.diameter_m, self.diameter_std_m / tip_m)

    @property
    def material_doubts(self) -> list[Diagnosis]:
        """Doubts whether the material can have this modulus and density; empty for an unknown material."""
        known = Material.named(self.material)
        return [] if known is None else known.doubts(self.youngs_modulus_Pa, self.density_kg_m3)

    @property
    def tip_std_m(self) -> float | None:
        """Standard deviation of the visible end's position along the antenna; None where it is not used."""
        if self.tip is None:
            return None
        shape_m = (
            self.diameter_m * float(self.taper.diameter(np.ones(1))[0]) / 7.0
            if self.tip.shape_std_m is None
            else self.tip.shape_std_m
        )
        return max(math.hypot(self.tip.length_std_m, shape_m), 1e-6)

    @property
    def stiffness_Nm2(self) -> float:
        """E·πd⁴/64, at the clamp."""
        return round_wire(self.youngs_modulus_Pa, self.density_kg_m3, self.diameter_m)[0]

    @property
    def mass_per_length_kg_m(self) -> float:
        """ρ·πd²/4, at the clamp."""
        return round_wire(self.youngs_modulus_Pa, self.density_kg_m3, self.diameter_m)[1]


Gravity = Annotated[np.ndarray, array_of(3), AfterValidator(real_gravity)]
"""m/s², world frame; zero: weightless."""
_JointReading = Annotated[Number, Field(ge=-6.3, le=6.3)]
_Pixel = Annotated[Number, Field(ge=-1e5, le=1e5)]


@dataclass(frozen=True)
class OverBoard:
    """The free antenna over a board parallel to plane C, in the pictures of over/."""

    height_m: Annotated[
        Number, Field(ge=0, le=0.5, description="of the antenna's axis over the printed face, towards the viewer")
    ] = 0.0
    height_std_m: Annotated[Number, Field(gt=0, le=0.1)] = 1e-4
    pan_rad: _JointReading = 0.0
    tilt_rad: _JointReading = 0.0
    clamp_px: Annotated[
        tuple[_Pixel, _Pixel] | None,
        Field(
            description="where the clamp's edge shows in the pictures; needed where neither jig nor sweep shows which "
            "end is clamped"
        ),
    ] = None
    clamp_std_px: Annotated[Number, Field(gt=0, le=1e4, description="how well that is known along the antenna")] = 20.0


@dataclass(frozen=True)
class LoadReadings:
    """Standard deviations of a known load's distance along the antenna, and of its force, relative; 0: exact."""

    distance_std_m: Annotated[Number, Field(ge=0, le=0.05)] = 5e-4
    force_std_relative: Annotated[Number, Field(ge=0, le=0.5)] = 5e-3


def _unit(rotation_xyzw: np.ndarray) -> np.ndarray:
    length = math.hypot(*rotation_xyzw)
    if not 0.99 < length < 1.01:
        raise ValueError(f"has length {length:.3g}", "a unit quaternion x, y, z, w is needed")
    return rotation_xyzw


@dataclass(frozen=True, eq=False)
class _PoseInFile:
    # of rigs, not of rooms: twelve millimetres written as 12 are refused
    translation_m: Annotated[np.ndarray, array_of(3, ge=-10, le=10)]
    rotation_xyzw: Annotated[np.ndarray, array_of(4), AfterValidator(_unit)]


def _pose(read: _PoseInFile) -> Pose:
    return Pose.from_quaternion(read.rotation_xyzw, read.translation_m)


FilePose = Annotated[Pose, read_as(_PoseInFile, _pose)]
"""A pose as our files write it."""


@dataclass(frozen=True, eq=False)
class FileKinematics:
    """The joints' entry in session.yaml and rig.json."""

    T_actuator_antenna: FilePose = field(default_factory=Pose.identity)
    position_world_m: Annotated[np.ndarray, array_of(3, ge=-1e6, le=1e6)] = field(default_factory=lambda: np.zeros(3))
    axis_skew_rad: Annotated[
        Number, Field(ge=-0.5, le=0.5, description="lean of the tilt axis from the right angle with the pan axis")
    ] = 0.0
    axis_offset_m: Annotated[
        Number, Field(ge=-1, le=1, description="from the pan axis to the tilt axis along the panned x")
    ] = 0.0
    tilt_zero_rad: Annotated[
        Number, Field(ge=-3.2, le=3.2, description="the true tilt where the encoder reads zero")
    ] = 0.0

    def kinematics(self) -> Kinematics:
        """The joints in the solver's form."""
        axes = self.axis_skew_rad, self.axis_offset_m, self.tilt_zero_rad
        return Kinematics(self.T_actuator_antenna, self.position_world_m, *axes)


@dataclass(frozen=True, eq=False)
class _SessionKinematics(FileKinematics):
    # as large as a hall: nothing in the pictures contradicts a position in millimetres
    position_world_m: Annotated[np.ndarray, array_of(3, ge=-100, le=100)] = field(default_factory=lambda: np.zeros(3))
    tilt_zero_std_rad: Annotated[
        Number, Field(ge=0, le=3.2, description="how well the encoder's zero is known before calibration")
    ] = 0.01


@dataclass(frozen=True, eq=False)
class _Jig:
    T_antenna_board: FilePose
    translation_std_m: Annotated[
        Number, Field(ge=0, le=0.1, description="how well the board's place in the jig is known, per axis; 0: exactly")
    ] = 0.0
    rotation_std_rad: Annotated[
        Number, Field(ge=0, le=0.5, description="how well the board's turn in the jig is known, per axis; 0: exactly")
    ] = 0.0


@dataclass(frozen=True)
class _SensorNoise:
    std_Nm: Annotated[Number, Field(ge=1e-12, le=1e6)]


_Component = Literal["fx", "fy", "fz", "mx", "my", "mz", "-fx", "-fy", "-fz", "-mx", "-my", "-mz"]


@dataclass(frozen=True, eq=False)
class NominalWrenchSensor:
    """A sensor of several axes between base and clamp, such as a two-axis strain gauge or a six-axis force sensor."""

    components: Annotated[
        list[_Component],
        Field(
            description="what it reads of force (fx, fy, fz) and moment (mx, my, mz) that act on the antenna, in its "
            "own right-handed axes; -my where a channel reads with the other sign"
        ),
    ]
    std_N: Annotated[Annotated[Number, Field(ge=1e-12, le=1e6)] | None, Field(description="noise of the forces")] = None
    std_Nm: Annotated[Annotated[Number, Field(ge=1e-12, le=1e6)] | None, Field(description="of the moments")] = None
    T_antenna_sensor: Annotated[
        FilePose, Field(description="its origin and axes; the turn is solved for, the place counts as exact")
    ] = field(default_factory=Pose.identity)
    rotation_std_rad: Annotated[
        Number, Field(ge=0, le=0.5, description="how well its axes are known before the calibration, per axis")
    ] = 0.035

    def __post_init__(self) -> None:
        names = [name.removeprefix("-") for name in self.components]
        if not names:
            raise InputError("wrench_sensor.components is empty", remedy="name those that it reads, such as my and mz")
        if len({*names}) < len(names):
            raise InputError("components of wrench_sensor name one twice", remedy="name each of them once")
        for kind, std, key in (("f", self.std_N, "std_N"), ("m", self.std_Nm, "std_Nm")):
            if std is None and any(name.startswith(kind) for name in names):
                own = ", ".join(name for name in names if name[0] == kind)
                what = f"wrench_sensor: {key} is missing, the noise of {own}"
                raise InputError(
                    what, remedy=f"give {key} as the sensor's data sheet has it, or as it scatters at rest"
                )

    @property
    def signs(self) -> dict[str, float]:
        """1 or −1 for each component, in the order of `READINGS`."""
        known = {name.removeprefix("-"): -1.0 if name.startswith("-") else 1.0 for name in self.components}
        return {name: known[name] for name in READINGS if name in known}

    def std(self, name: str) -> float:
        """Standard deviation of the noise of a component's readings."""
        std = self.std_N if name.startswith("f") else self.std_Nm
        return math.inf if std is None else std


@dataclass(frozen=True)
class Shutter:
    """Exposure and readout of the recording's camera."""

    exposure_s: Annotated[Number, Field(ge=0, le=10, description="how long it is exposed; 0: not known")] = 0.0
    readout_s: Annotated[
        Number, Field(ge=0, le=10, description="from the first row to the last of a rolling shutter; 0: a global one")
    ] = 0.0


def _drift(value: Any) -> Any:
    if isinstance(value, str):
        if value not in DRIFTS:
            raise ValueError(f"is {value!r}", f"one of {', '.join(DRIFTS)}, or a mapping of deviations, is needed")
        return DRIFTS[value]
    return {**asdict(DRIFTS["lab"]), **value} if isinstance(value, Mapping) else value


def _or(names: JsonSchemaValue) -> GetPydanticSchema:
    """Annotation of a value for which a file may have one of several names. names : their JSON Schema."""
    return GetPydanticSchema(None, lambda schema, handler: {"anyOf": [handler(schema), names]})


FileDrift = Annotated[Drift, BeforeValidator(_drift), _or({"enum": list(DRIFTS)})]
"""A drift as our files give it: a name, or a mapping, of which `lab` says what it leaves out."""


def _direction(values: np.ndarray) -> np.ndarray:
    length = float(np.linalg.norm(values))
    if length < 1e-9:
        raise ValueError("has no length", "three numbers, not all zero, are needed")
    return values / length


@dataclass(frozen=True, eq=False)
class KnownObject:
    """A straight pin or edge at a measured place in the world, on which the recording's contacts lie."""

    shape: Literal["pin", "edge"]
    position_m: Annotated[np.ndarray, array_of(3, ge=-100, le=100)]
    direction: Annotated[np.ndarray, array_of(3, ge=-1e6, le=1e6), AfterValidator(_direction)]
    std_m: Annotated[
        Number, Field(gt=0, le=0.1, description="how well its place is known, per axis; the same error in all frames")
    ]
    radius_m: Annotated[Number, Field(ge=0, le=1, description="of the pin, or of the edge's rounding; 0: sharp")] = 0.0


CameraName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$")]


class SessionFile(FileModel):
    """The content of session.yaml: the rig as known before its calibration."""

    VERSION = SCHEMA
    version: Literal["vbaa.session/1"] = Field(alias="schema")
    board: Annotated[FileBoard, _or({"type": "string", "description": "a file beside this one that describes it"})]
    antenna: Annotated[NominalAntenna, BeforeValidator(_with_material)]
    jig: _Jig | None = None
    kinematics: _SessionKinematics | None = None
    gravity_world: Annotated[Gravity | None, Field(description="m/s²; null: weightless")]
    moment_sensor: Annotated[
        _SensorNoise | None,
        Field(description="about y; null, or left out: a rig without, calibrated by its pictures alone"),
    ] = None
    second_moment_sensor: Annotated[
        MomentSensor | None,
        Field(description="about z: reads gain · (x·f_y − y·f_x of force and weight) + offset; counts as exact"),
    ] = None
    wrench_sensor: Annotated[
        NominalWrenchSensor | None, Field(description="in place of moment_sensor: a sensor of more axes")
    ] = None
    load_readings: LoadReadings | None = None
    print_scale_std: Annotated[
        Number, Field(ge=0, le=0.05, description="how well the board's printed size is known, relative; 0: exactly")
    ] = 0.0
    over: OverBoard | None = None
    drift: Annotated[
        FileDrift | None, Field(description="what may change between calibration and recording; null: as rig.json says")
    ] = None
    camera: Shutter | None = None
    cameras: Annotated[
        dict[CameraName, Shutter | None],
        Field(
            description="several by name, in place of camera; each one's pictures in intrinsics/NAME, plane/NAME, "
            "columns image_NAME"
        ),
    ] = Field(default_factory=dict)
    known_object: Annotated[
        KnownObject | None, Field(description="what the recording touches, if its place is known; for `vbaa refine`")
    ] = None


@dataclass(frozen=True, eq=False)
class Session:
    """A checked session.yaml; the standard deviation of anything known exactly is 0.

    T_antenna_board : pose of the board's printed face in the jig, or None without a jig.
    gravity_world_m_s2 : (3,), zero when weightless.
    print_scale_std : relative, of the board's printed size, as far as it was measured.
    over : how the antenna is mounted over the board in over/, or None where session.yaml does not say.
    moment_std_Nm : noise of the moment sensor, infinite where there is none.
    sensor_stated : whether session.yaml says that there is a sensor, or none.
    wrench_sensor : of several axes; then moment_std_Nm is that of its moment about y.
    second_moment_sensor : about z, calibrated elsewhere; None where there is none.
    drift : what may change between calibration and recording; None where session.yaml does not say.
    shutter : of the recording's camera, as far as session.yaml says it.
    known_object : what the recording touches, where its place is known.
    cameras : shutters by name, of several; `camera` is the one that took this session's pictures (`of_camera`).
    """

    root: Path
    board: BoardWithIds
    antenna: NominalAntenna
    T_antenna_board: Pose | None
    kinematics: Kinematics
    gravity_world_m_s2: np.ndarray
    moment_std_Nm: float
    jig_translation_std_m: float = 0.0
    jig_rotation_std_rad: float = 0.0
    tilt_zero_std_rad: float = 0.01
    print_scale_std: float = 0.0
    load_readings: LoadReadings = LoadReadings(0.0, 0.0)
    over: OverBoard | None = None
    second_moment_sensor: MomentSensor | None = None
    drift: Drift | None = None
    shutter: Shutter = Shutter()
    known_object: KnownObject | None = None
    sensor_stated: bool = True
    wrench_sensor: NominalWrenchSensor | None = None
    cameras: Mapping[str, Shutter] = field(default_factory=dict)
    camera: str = ""

    def of_camera(self, name: str) -> Session:
        """The session with only one of its cameras."""
        return replace(self, camera=name, shutter=self.cameras[name])

    @property
    def in_turn(self) -> tuple[str, ...]:
        """The names of its cameras, this session's first; empty where there is one camera."""
        return (self.camera, *(name for name in self.cameras if name != self.camera)) if self.cameras else ()

    def folder(self, name: str) -> Path:
        """The folder of its camera's pictures, such as intrinsics or plane."""
        return self.root / name / self.camera

    @property
    def image_column(self) -> str:
        """The column that names its camera's pictures in tables."""
        return f"image_{self.camera}" if self.camera else "image"

    @property
    def with_sensor(self) -> bool:
        """Whether the moment about y is read."""
        return math.isfinite(self.moment_std_Nm)

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns of its sensors' readings, which noload.csv and loads.csv must have."""
        names = ["my"] * self.with_sensor if self.wrench_sensor is None else self.wrench_sensor.signs
        return tuple(READINGS[name] for name in names)

    @property
    def possible_drift(self) -> Drift:
        """The changes to expect between calibration and recording; `lab` unless session.yaml states others."""
        return DRIFTS["lab"] if self.drift is None else self.drift

    def gravity_antenna(self, frames: Sequence[Still]) -> np.ndarray:
        """(B, 3) gravity in the antenna frame at each frame's joint angles."""
        return gravity_antenna(self.kinematics, self.gravity_world_m_s2, frames)


def gravity_antenna(kinematics: Kinematics, gravity_world_m_s2: np.ndarray, frames: Sequence[Still]) -> np.ndarray:
    """(B, 3) gravity in the antenna frame at each frame's joint angles."""
    turns = [kinematics.world_antenna(frame.pan_rad, frame.tilt_rad)[0] for frame in frames]
    return np.array([turn.T @ gravity_world_m_s2 for turn in turns]).reshape(-1, 3)


@validate_arguments
def load_session(root: Path) -> Session:
    """Read and check session.yaml. Raises InputError naming the key that is wrong."""
    root = Path(root)
    remedy = "name a session folder (docs/formats.md); pictures alone: `vbaa estimate` takes a table of them"
    if not root.is_dir():
        raise InputError("is not a folder" if root.exists() else "no such folder", where=root, remedy=remedy)
    path = root / "session.yaml"
    if not os.path.lexists(path):
        if (root / "recording.csv").is_file():
            remedy = "name the session folder that it is in; `vbaa estimate` takes recording.csv itself, too"
        raise InputError("no such file", where=path, remedy=remedy)
    return session_from(read_yaml(path), root, path)


def session_from(data: Mapping[str, Any], root: Path, path: object) -> Session:
    """A session from the content of session.yaml. Raises InputError naming `path` and the wrong key."""
    board = data.get("board")
    if isinstance(board, str) or (isinstance(board, Mapping) and "target_type" in board):
        data = {**data, "board": with_ids(board, path, "board").to_dict()}
    with about(path):
        read = checked(SessionFile, data, path, "`vbaa schema session` prints what is expected")
    several = read.wrench_sensor
    if several is not None and (read.moment_sensor is not None or read.second_moment_sensor is not None):
        other = "moment_sensor" if read.moment_sensor is not None else "second_moment_sensor"
        what = f"wrench_sensor and {other} are both there: one sensor of several axes, or one of the moment about y"
        raise InputError(what, where=path, remedy=f"leave {other} out, or wrench_sensor")
    moment_std_Nm = (read.moment_sensor or MomentSensor.none()).std_Nm
    if several is not None and "my" in several.signs:
        moment_std_Nm = several.std("my")
    kinematics, jig = read.kinematics or _SessionKinematics(), read.jig
    # The jig holds the board's back; the printed face lies one thickness nearer to the viewer, along −z.
    face = Pose(np.eye(3), np.array([0.0, 0.0, -read.board.thickness_m]))
    session = Session(
        root=root,
        board=read.board,
        antenna=read.antenna,
        T_antenna_board=jig.T_antenna_board @ face if jig else None,
        kinematics=kinematics.kinematics(),
        gravity_world_m_s2=np.zeros(3) if read.gravity_world is None else read.gravity_world,
        moment_std_Nm=moment_std_Nm,
        jig_translation_std_m=jig.translation_std_m if jig else 0.0,
        jig_rotation_std_rad=jig.rotation_std_rad if jig else 0.0,
        tilt_zero_std_rad=kinematics.tilt_zero_std_rad,
        load_readings=read.load_readings or LoadReadings(),
        print_scale_std=read.print_scale_std,
        over=read.over,
        second_moment_sensor=read.second_moment_sensor,
        drift=read.drift,
        shutter=read.camera or Shutter(),
        known_object=read.known_object,
        sensor_stated="moment_sensor" in data or several is not None,
        wrench_sensor=several,
    )
    if not read.cameras:
        return session
    if read.camera is not None:
        raise InputError("camera and cameras are both there", where=path, remedy="leave camera out")
    cameras = {name: shutter or Shutter() for name, shutter in read.cameras.items()}
    return replace(session, cameras=cameras).of_camera(next(iter(cameras)))


def read_pose(data: Any, where: object, key: str) -> Pose:
    """A pose out of a file. Raises InputError naming what is wrong with it."""
    remedy = "give translation_m, and rotation_xyzw as a unit quaternion"
    return checked(FilePose, data, where, remedy, key)


def has_sweep(session: Session) -> bool:
    """Whether there is a folder sweep/ with pictures of a board fixed in the world."""
    return (session.root / "sweep").is_dir()


def has_over(session: Session) -> bool:
    """Whether there is a folder over/ with pictures of the free antenna over a board.

    Raises InputError when session.yaml says nothing of it: without the height the pictures are useless.
    """
    if not (session.root / "over").is_dir():
        return False
    if session.over is None:
        remedy = "give over.height_m, the height of the antenna's axis over the board's printed face"
        what = "over is missing, but there is a folder over/"
        raise InputError(what, where=session.root / "session.yaml", remedy=remedy)
    return True
