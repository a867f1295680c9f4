"""Rigs unlike each other, by a simulator of their own: the static rod, seen through OpenCV's lens, and calibrated.

A `World` is a rig as it is. What a person or a part gets wrong changes the world, or what is noted of it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.boards import noisy_view
from targets.board import BoardSpec, corner_points
from vbaa_calib.antenna.rod import Rod, RodShape, sample_shape, solve_rod
from vbaa_calib.antenna.taper import UNIFORM, Taper
from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment
from vbaa_calib.calibrate.antenna.inputs import Observation, Prior, reading_keys
from vbaa_calib.calibrate.antenna.session_rig import make_rig, nominal_parameters, prior, solve_antenna
from vbaa_calib.calibrate.lens.intrinsics import solve_intrinsics
from vbaa_calib.calibrate.pose.board_pose import jig_estimate, solve_board_pose
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.rig import Rig
from vbaa_calib.session import DRIFTS, Drift, Load, LoadReadings, NominalAntenna, NominalTip, Session, Still
from vbaa_calib.simulate.plan import _board_poses as board_poses
from vbaa_calib.simulate.scene.lens import Lens, project
from vbaa_calib.simulate.scene.scene import IntrinsicsSpec, camera_pose

GRAVITY_WORLD_M_S2 = np.array([0.0, 0.0, -9.80665])
STEEL, NITINOL = (193e9, 7900.0), (60e9, 6450.0)
"""Young's modulus, Pa, and density, kg/m³."""


@dataclass(frozen=True)
class Kind:
    """What somebody built.

    Attributes
    ----------
    length_m, diameter_m, material : of the antenna; Young's modulus and density.
    focal_px, image_size, distortion : of the camera.
    incline_rad, azimuth_rad : where it leans to. share : of the picture's width that the antenna takes.
    sigma_px : standard deviation of a centreline point. along : correlation of neighbouring points' errors.
    tip : whether the antenna's end is measured.
    """

    name: str
    length_m: float
    diameter_m: float
    material: tuple[float, float]
    focal_px: float
    image_size: tuple[int, int]
    incline_rad: float = 0.0
    azimuth_rad: float = 1.2
    distortion: tuple[float, ...] = (-0.12, 0.04, 4e-4, -3e-4, 0.0)
    share: float = 0.6
    sigma_px: float = 0.08
    along: float = 0.3
    tip: bool = True

    @property
    def antenna(self) -> NominalAntenna:
        """As session.yaml has it."""
        return NominalAntenna(self.length_m, self.diameter_m, *self.material, NominalTip())

    @property
    def moment_std_Nm(self) -> float:
        """The sensor's noise: a few thousandths of what bends the antenna by a tenth of a radian."""
        return float(f"{1.3e-3 * self.antenna.stiffness_Nm2 / self.length_m:.2g}")

    @property
    def distance_m(self) -> float:
        """From the camera to the antenna's middle."""
        return self.focal_px * self.length_m / (self.share * self.image_size[0])

    @property
    def board(self) -> BoardSpec:
        """One that fills most of a picture from there."""
        square = round(0.055 * self.image_size[0] / self.focal_px * self.distance_m, 4)
        return BoardSpec(squares_x=11, squares_y=8, square_m=square, marker_m=round(0.73 * square, 4))


KINDS = (
    Kind("240 mm, 1,000 px, 30°", 0.24, 8e-4, STEEL, 1002.0, (960, 720), 0.52, 2.6),
    Kind("60 mm, 300 px, 60°", 0.06, 3e-4, STEEL, 300.0, (640, 480), 1.05, 1.2, (-0.15, 0.03, 4e-4, -3e-4, 0.0), 0.5),
    Kind("500 mm, 2,000 px, upright, nitinol", 0.5, 2e-3, NITINOL, 2000.0, (2048, 1536), 0.0),
)
"""The demo's, a short one before a wide lens, and a long one of nitinol under an upright camera."""


def drawn_kind(rng: np.random.Generator) -> Kind:
    """A rig unlike the others: 60 to 500 mm, 300 to 2,000 px, upright or inclined to 60°, steel or nitinol."""
    length = float(np.exp(rng.uniform(np.log(0.06), np.log(0.5))))
    focal = float(np.exp(rng.uniform(np.log(300.0), np.log(2000.0))))
    sizes = [(640, 480), (960, 720), (1280, 720), (1280, 960), (2048, 1536)]
    wide = [size for size in sizes if 0.9 < focal / size[0] < 2.5] or [sizes[0 if focal < 600 else -1]]
    size = wide[rng.integers(len(wide))]
    steel = rng.uniform() < 0.5
    slender = float(np.exp(rng.uniform(np.log(230.0), np.log(330.0)))) * (1.0 if length < 0.25 else 0.25 / length)
    incline = 0.0 if rng.uniform() < 0.3 else float(rng.uniform(0.0, 1.05))
    bend = (-0.15 if focal / size[0] < 0.7 else -0.1, 0.03, 4e-4, -3e-4, 0.0)
    name = f"{1e3 * length:.0f} mm, {focal:.0f} px, {np.degrees(incline):.0f}°, {'steel' if steel else 'nitinol'}"
    return Kind(
        *(name, round(length, 3), round(length / slender, 5), STEEL if steel else NITINOL, focal, size),
        *(incline, float(rng.uniform(-np.pi, np.pi)), bend, 0.5 if incline > 0.7 else 0.6),
        *(float(rng.uniform(0.03, 0.15)), float(rng.choice([0.0, 0.3])), bool(rng.uniform() < 0.6)),
    )


@dataclass(frozen=True, eq=False)
class World:
    """A rig as it is.

    Attributes
    ----------
    parameters : (9,) of the antenna, as `nominal_parameters`. gain, offset_Nm : of the sensor.
    length_m : of the antenna. tip_m : how far beyond it its visible end lies.
    light_px : (3,) by how much lines are off in all pictures: offset, slope and curvature.
    kink : a sharp bend: its arc length in m, and its angles about y and z in rad. taper : of its diameter.
    """

    kind: Kind
    lens: Lens
    T_antenna_camera: Pose
    parameters: np.ndarray
    gain: float
    offset_Nm: float
    length_m: float
    tip_m: float
    light_px: np.ndarray
    kink: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gravity_world_m_s2: np.ndarray = field(default_factory=lambda: GRAVITY_WORLD_M_S2)
    taper: Taper = UNIFORM
    softer_z: float = 0.0

    @property
    def rod(self) -> Rod:
        """The antenna, a wire with ν = 0.3."""
        y, z, about_y, about_z, bow_y, bow_z, log_stiffness, log_mass = self.parameters[:8]
        stiffness = np.exp(log_stiffness)
        clamp = Pose(Rotation.from_rotvec([0.0, about_y, about_z]).as_matrix(), np.array([0.0, y, z]))
        bow = np.array([bow_y, bow_z])
        return Rod(self.length_m, stiffness, stiffness / 1.3, np.exp(log_mass), clamp, bow, taper=self.taper)

    def gravity(self, pan_rad: np.ndarray, tilt_rad: np.ndarray) -> np.ndarray:
        """(F, 3) in the antenna frame."""
        rotation, _ = Kinematics().world_antenna(pan_rad, tilt_rad)
        return np.einsum("fji,j->fi", rotation, self.gravity_world_m_s2)

    def with_parameters(self, **changes: float) -> World:
        """With numbers added to parameters by their index: p6=0.1."""
        parameters = self.parameters.copy()
        for name, change in changes.items():
            parameters[int(name[1:])] += change
        return replace(self, parameters=parameters)

    def camera_moved(self, turn_rad: np.ndarray, shift_m: np.ndarray) -> World:
        """With its camera turned and shifted, in the camera's frame."""
        return replace(self, T_antenna_camera=self.T_antenna_camera.retract(np.concatenate([turn_rad, shift_m])))

    def lens_moved(self, scale: float = 1.0, shift_px: np.ndarray | None = None) -> World:
        """With its lens refocused, and its picture shifted on the sensor."""
        matrix = self.lens.matrix.copy()
        matrix[[0, 1], [0, 1]] *= scale
        matrix[:2, 2] += 0.0 if shift_px is None else shift_px
        return replace(self, lens=replace(self.lens, matrix=matrix))


@dataclass(frozen=True, eq=False)
class Bent:
    """F antennas of a world under weight and one force each.

    Attributes
    ----------
    turned : how far the clamp gives way. readings_Nm : (F, 2) about y and z, without noise.
    contact_m : (F, 3) where the force acts, antenna frame.
    """

    world: World
    shape: RodShape
    turned: Rotation
    readings_Nm: np.ndarray
    contact_m: np.ndarray

    @staticmethod
    def of(world: World, gravity: np.ndarray, distance_m: np.ndarray, force_N: np.ndarray) -> Bent:
        """Under gravity (F, 3) and forces (F, 3) at arc lengths (F,), antenna frame."""
        parameters, rod = world.parameters, world.rod
        # to the softer side everything pulls harder, but for the sensor
        softer = np.array([1.0, 1.0, 1.0 + world.softer_z])
        gravity, force_N = gravity * softer, force_N * softer
        moment = solve_rod(rod, gravity, distance_m, force_N).clamp_moment_Nm
        turned = Rotation.from_rotvec(parameters[8] / np.exp(parameters[6]) * moment * [0.0, 1.0, 1.0])
        # the clamp turns: as if weight and force turned the other way, and then all that is seen with the clamp
        shape = solve_rod(rod, turned.inv().apply(gravity), distance_m, turned.inv().apply(force_N))
        moment = turned.apply(shape.clamp_moment_Nm)
        readings = np.column_stack([world.offset_Nm - world.gain * moment[:, 1] / softer[2], moment[:, 2]])
        bent = Bent(world, shape, turned, readings, np.zeros((len(gravity), 3)))
        return replace(bent, contact_m=bent.points(distance_m[:, None])[:, 0])

    def points(self, arclength_m: np.ndarray) -> np.ndarray:
        """(F, N, 3) antenna frame, at arc lengths (F, N) or (1, N)."""
        count = len(self.readings_Nm)
        at = np.broadcast_to(arclength_m, (count, arclength_m.shape[1]))
        points = sample_shape(self.shape, at)[0]
        kink_m, about_y, about_z = self.world.kink
        beyond = np.clip(at - kink_m, 0.0, None)
        points = points + np.stack([0.0 * beyond, about_z * beyond, -about_y * beyond], axis=-1)
        clamp = np.append(0.0, self.world.parameters[:2])
        return clamp + np.einsum("fij,fnj->fni", self.turned.as_matrix(), points - clamp)

    def pixels(self, arclength_m: np.ndarray) -> np.ndarray:
        """(F, N, 2) of points at arc lengths."""
        return project(self.world.lens, self.world.T_antenna_camera.inverse() @ self.points(arclength_m))


@dataclass(frozen=True)
class Line:
    """What a picture shows of an antenna: points (N, 2) with standard deviations (N,), and the tip (3,) or NaN."""

    points_px: np.ndarray
    sigma_px: np.ndarray
    tip_px: np.ndarray


TIP_PX = 0.1


def seen(bent: Bent, line_px: float, rng: np.random.Generator) -> list[Line]:
    """Lines of all frames with errors that neighbours share, and those of light; the part inside the picture."""
    world, kind = bent.world, bent.world.kind
    count = int(rng.integers(90, 160))
    at = np.linspace(0.01, 1.0, count) * world.length_m
    exact = bent.pixels(at[None])
    before, end = np.moveaxis(bent.pixels(np.array([[world.length_m - 1e-3, world.length_m]])), 1, 0)
    ends = end + 1e3 * world.tip_m * (end - before) + TIP_PX * rng.normal(size=end.shape)
    along = np.gradient(exact, axis=1)
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1) / np.linalg.norm(along, axis=2, keepdims=True)
    off = world.light_px + line_px * rng.normal(size=(len(exact), 3))
    aside = np.polynomial.legendre.legval(np.linspace(-1.0, 1.0, count), off.T)
    noise = rng.normal(size=exact.shape)
    for n in range(1, count):
        noise[:, n] = kind.along * noise[:, n - 1] + np.sqrt(1.0 - kind.along**2) * noise[:, n]
    # so that the mean of many is as exact as their standard deviations say
    noise *= kind.sigma_px * np.sqrt((1.0 - kind.along) / (1.0 + kind.along))
    lines, size = [], np.array(world.lens.image_size)
    for points, tip in zip(exact + aside[..., None] * across + noise, ends, strict=True):
        inside = ((points > 1) & (points < size - 2)).all(axis=1)
        whole = kind.tip and inside[-1] and ((tip > 1) & (tip < size - 2)).all()
        tip_px = np.array([*tip, TIP_PX]) if whole else np.full(3, np.nan)
        lines.append(Line(points[inside], np.full(inside.sum(), kind.sigma_px), tip_px))
    return lines


# --- a session on it, and the rig that comes out


READINGS = LoadReadings(5e-4, 5e-3)
_TILTS = (0.0, 0.5, -0.4, 0.9, -0.8)
_HANGING = ((0.50, 0.0, 0.09), (0.62, 0.5, -0.07), (0.75, -0.4, 0.05), (0.88, 0.9, -0.04), (0.96, -0.8, 0.03))
"""Known loads: distance from the clamp in lengths, tilt rad, and force at 240 mm of 0.8 mm steel, N."""
LINE_PX = DRIFTS["lab"].line_px


def drawn_world(kind: Kind, rng: np.random.Generator) -> World:
    """One rig of a kind: a careful builder's."""
    std = np.array(
        [1.5e-3 * kind.length_m / 0.24] * 2 + [0.02] * 2 + [min(0.05 / kind.length_m, 0.25)] * 2 + [0.05, 0.03, 5e-4]
    )
    parameters = nominal_parameters(kind.antenna) + std * rng.normal(size=9).clip(-2, 2)
    focal, (width, height) = kind.focal_px, kind.image_size
    centre = 0.5 * np.array([width, height]) + 0.004 * width * rng.normal(size=2)
    matrix = np.array([[focal, 0.0, centre[0]], [0.0, focal * 1.001, centre[1]], [0.0, 0.0, 1.0]])
    middle = np.array([0.5 * kind.length_m, 0.0, 0.0])
    pose = camera_pose(kind.incline_rad, kind.azimuth_rad, 0.03 * rng.normal(), kind.distance_m, middle)
    return World(
        *(kind, Lens("opencv", kind.image_size, matrix, np.array(kind.distortion)), pose, parameters),
        *(1 + 0.05 * rng.normal(), 20.0 * kind.moment_std_Nm * rng.normal(), kind.length_m),
        tip_m=(kind.antenna.tip_std_m or 0.0) * rng.normal(),
        light_px=0.015 * rng.normal(size=3),
    )


def drifted(world: World, draw: np.ndarray, drift: Drift = DRIFTS["lab"]) -> World:
    """What a rig is some days later: changed by so many (19,) of the deviations that are expected."""
    changed = world.with_parameters(
        p2=drift.clamp_turn_rad * draw[0],
        p3=drift.clamp_turn_rad * draw[1],
        p4=drift.bow_per_m * draw[2],
        p5=drift.bow_per_m * draw[3],
        p6=drift.stiffness * draw[4],
    )
    changed = changed.camera_moved(drift.camera_turn_rad * draw[5:8], drift.camera_shift_m * draw[8:11])
    changed = changed.lens_moved(1.0 + drift.picture_scale * draw[11], drift.picture_shift_px * draw[12:14])
    return replace(
        changed,
        gain=world.gain * (1.0 + drift.moment_gain * draw[14]),
        offset_Nm=world.offset_Nm + drift.moment_zero * world.kind.moment_std_Nm * draw[15],
        light_px=world.light_px + drift.light_px * draw[16:19],
    )


def session_of(kind: Kind) -> Session:
    """A session with nothing on disk."""
    return Session(
        *(Path("."), kind.board, kind.antenna, None, Kinematics(), GRAVITY_WORLD_M_S2, kind.moment_std_Nm),
        load_readings=READINGS,
        drift=DRIFTS["lab"],
    )


def stills_of(kind: Kind) -> list[Still]:
    """Rows of noload.csv and loads.csv; the readings are still to come."""
    found: list[Still] = [Still(Path(f"noload_{i:03d}.png"), 0.0, tilt, 0.0) for i, tilt in enumerate(_TILTS)]
    scale = kind.antenna.stiffness_Nm2 / 3.88e-3 * (0.24 / kind.length_m) ** 2
    for distance, tilt, force in _HANGING:
        for y, z in ((force, 0.0), (0.0, force)):
            name = Path(f"loads_{len(found) - len(_TILTS):03d}.png")
            at = round(distance * kind.length_m, 4)
            found.append(Load(name, 0.0, tilt, 0.0, at, float(f"{scale * y:.3g}"), float(f"{scale * z:.3g}")))
    return found


def observed(worlds: list[World], stills: list[Still], rng: np.random.Generator) -> list[Observation]:
    """What camera and sensor see of stills, each in the world as it is then."""
    found, errors = [], dict[tuple[str, str], float]()
    for world, still in zip(worlds, stills, strict=True):
        gravity = world.gravity(np.array([still.pan_rad]), np.array([still.tilt_rad]))
        distance, force = np.array([0.5 * world.length_m]), np.zeros((1, 3))
        if isinstance(still, Load):
            ruler, balance = (errors.setdefault(key, rng.normal()) for key in reading_keys(still))
            distance[:] = min(still.distance_m + READINGS.distance_std_m * ruler, world.length_m)
            weight = np.exp(READINGS.force_std_relative * balance)
            force[0, 1:] = weight * still.force_y_N, weight * still.force_z_N
        bent = Bent.of(world, gravity, distance, force)
        line = seen(bent, LINE_PX, rng)[0]
        read = float(bent.readings_Nm[0, 0] + world.kind.moment_std_Nm * rng.normal())
        noted = replace(still, moment_Nm=read)
        # as the session's own gravity has it, whatever the world's is
        pull = GRAVITY_WORLD_M_S2 @ Kinematics().world_antenna(still.pan_rad, still.tilt_rad)[0]
        tip_px, tip_std_px = line.tip_px[:2], float(line.tip_px[2])
        found.append(Observation(noted, line.points_px, line.sigma_px, pull, tip_px=tip_px, tip_std_px=tip_std_px))
    return found


def board_views(world: World, rng: np.random.Generator) -> tuple[list[BoardView], list[BoardView], Pose]:
    """Views of the board by hand and in the jig, and where the jig has it in the antenna frame."""
    kind, lens, board = world.kind, world.lens, world.kind.board
    points, size = corner_points(board), board.square_m * np.array([board.squares_x, board.squares_y])
    near = kind.distance_m * np.array([0.7, 1.3])
    poses = board_poses(lens, board, IntrinsicsSpec(20, (float(near[0]), float(near[1])), (0.2, 0.7)), rng)
    origin = np.array([0.5 * kind.length_m - 0.5 * size[0], 0.5 * size[1], -0.004 * kind.length_m / 0.24])
    T_antenna_jig = Pose.from_rotvec(np.array([3.1, 0.03, 0.02]), origin)

    def view(name: str, pose: Pose) -> BoardView:
        pixels = project(lens, pose @ points)
        ids = np.flatnonzero(((pixels > 1) & (pixels < np.array(lens.image_size) - 2)).all(axis=1))
        return noisy_view(name, ids, pixels[ids], lens.image_size, 0.0, rng)[0]

    views = [view(f"{index:02d}.png", pose) for index, pose in enumerate(poses)]
    in_jig = world.T_antenna_camera.inverse() @ T_antenna_jig
    return (
        [one for one in views if len(one.ids) >= 12],
        [view(f"jig_{index}.png", in_jig) for index in range(4)],
        T_antenna_jig,
    )


@dataclass(frozen=True, eq=False)
class Calibrated:
    """A rig as it is, what a calibration made of it, and what that came from."""

    world: World
    session: Session
    before: Prior
    joint: BundleAdjustment
    rig: Rig


def before_loads(world: World, rng: np.random.Generator) -> Prior:
    """What is known of a rig before its antenna's pictures: the lens by a board, plane C by a jig."""
    views, in_jig, T_antenna_jig = board_views(world, rng)
    lens = solve_intrinsics(views, world.kind.board, model="opencv5")
    jig = jig_estimate(solve_board_pose(in_jig, lens.board_shape, lens.camera), T_antenna_jig)
    return prior(world.kind.antenna, lens.camera, [jig], readings=READINGS, drift=DRIFTS["lab"])


def calibrated_rig(kind: Kind, seed: int) -> Calibrated:
    """A rig of a kind, calibrated: the lens by a board, plane C by a jig, the rest by known loads."""
    rng = np.random.default_rng((51, seed))
    world = drawn_world(kind, rng)
    before, session, stills = before_loads(world, rng), session_of(kind), stills_of(kind)
    observations = observed([world] * len(stills), stills, rng)
    joint = solve_antenna(session, observations, before)
    return Calibrated(world, session, before, joint, make_rig(session, Kinematics(), joint, observations))


known_rig = cache(calibrated_rig)
"""The same, once a process."""
