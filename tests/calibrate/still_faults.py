"""Stills of a session without pictures: what the static rod does, seen through OpenCV, and rows that say otherwise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from targets.board import BoardSpec
from vbaa_calib.antenna.rod import RodShape, solve_rod
from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment, adjust_bundle
from vbaa_calib.calibrate.antenna.inputs import Observation, Prior, reading_keys
from vbaa_calib.calibrate.antenna.session_rig import prior
from vbaa_calib.calibrate.pose.fusion import PoseEstimate
from vbaa_calib.camera import Camera
from vbaa_calib.geometry import Kinematics
from vbaa_calib.session import Load, LoadReadings, NominalAntenna, Session, Still, gravity_antenna

from ..rod_scenes import BROWN, GRAVITY_WORLD, LENGTH_M, MATRIX, TIP_PX, World, along, camera_pose, seen

SIZE = (960, 720)
NOMINAL = NominalAntenna(LENGTH_M, 0.8e-3, 193e9, 7900.0)
POSE_COVARIANCE = np.diag([3e-4**2] * 3 + [1e-4**2] * 3)
WEIGHED = LoadReadings(5e-4, 5e-3)
"""As a session has them that does not say."""
TILTS = (0.0, 0.35, -0.35)
HUNG = ((0.10, 0.08), (0.15, 0.06), (0.20, 0.035), (0.21, 0.02), (0.16, 0.03))


def free_stills(tilts: Sequence[float] = TILTS) -> list[Still]:
    """No-load frames."""
    return [Still(Path(f"noload_{i:03d}.png"), 0.0, tilt, 0.0) for i, tilt in enumerate(tilts)]


def hung_loads(rng: np.random.Generator, count: int = 5) -> list[Load]:
    """Loads at drawn distances, over pulleys to all sides."""
    found = []
    for index in range(count):
        distance, force = HUNG[index % len(HUNG)]
        distance, force = distance + rng.uniform(-0.012, 0.012), force * rng.uniform(0.7, 1.1)
        turn = rng.uniform(0, 2 * np.pi)
        y, z = force * np.cos(turn), force * np.sin(turn)
        found.append(Load(Path(f"loads_{index:03d}.png"), 0.0, 0.0, 0.0, round(distance, 3), float(y), float(z)))
    return found


@dataclass(frozen=True, eq=False)
class Faults:
    """What is wrong.

    world : the rig as it is in a still, by its index; the same for all where nothing moves.
    ruler_std_m, balance_std : of every load's readings.
    kink : (3,) a sharp bend: its arc length in m, and its angles about y and about z in rad.
    points, sigma_px : of a line (0: drawn), and its noise; deviations are `claimed` times the true ones.
    line_px, light_px : deviations of the smooth curves by which each line is off, and all alike, or (3,) that curve.
    softer_to_z : loads to z act so many times as strongly on the shape as they do on the sensor.
    tip_m : how far beyond its length the antenna's end is seen; None: it is not seen.
    """

    world: Callable[[int, World], World] = field(default=lambda index, world: world)
    ruler_std_m: float = 5e-4
    balance_std: float = 5e-3
    kink: tuple[float, float, float] = (0.0, 0.0, 0.0)
    points: int = 120
    sigma_px: float = 0.05
    claimed: float = 1.0
    line_px: float = 0.0
    light_px: float | np.ndarray = 0.0
    softer_to_z: float = 1.0
    tip_m: float | None = None


def drawn_world(rng: np.random.Generator) -> World:
    """A rig like a careful builder's, seen from somewhere above plane C."""
    world = World(camera_pose(rng.uniform(0.2, 0.8), rng.uniform(0, 2 * np.pi)))
    step = np.concatenate([3e-4 * rng.normal(size=2), 0.01 * rng.normal(size=2), 0.08 * rng.normal(size=2)])
    parameters = world.parameters.copy()
    parameters[:6] = step
    parameters[6] += 0.05 * rng.normal()
    parameters[7] += 0.01 * rng.normal()
    return replace(world, parameters=parameters)


def turned(world: World, about_y_rad: float, about_z_rad: float) -> World:
    """The same rig with its clamp turned."""
    parameters = world.parameters.copy()
    parameters[2:4] += (about_y_rad, about_z_rad)
    return replace(world, parameters=parameters)


def observed(
    world: World, stills: Sequence[Still], rng: np.random.Generator, faults: Faults = Faults()
) -> list[Observation]:
    """What the camera and the sensor see of the stills, under the rows that were noted."""
    pulls, errors, found = gravity_antenna(Kinematics(), GRAVITY_WORLD, stills), dict[tuple[str, str], float](), []
    light_px = faults.light_px if np.ndim(faults.light_px) else faults.light_px * rng.normal(size=3)
    distances, forces = np.full((len(stills), 1), 0.1), np.zeros((len(stills), 3))
    for still, distance, force in zip(stills, distances, forces, strict=True):
        if isinstance(still, Load):
            ruler, balance = (errors.setdefault(key, rng.normal()) for key in reading_keys(still))
            distance[:] = min(still.distance_m + faults.ruler_std_m * ruler, LENGTH_M)
            force[1:] = np.exp(faults.balance_std * balance) * np.array([still.force_y_N, still.force_z_N])
    s = np.linspace(0.01, 1.0, faults.points or int(rng.integers(80, 400))) * LENGTH_M
    for index, (still, pull, distance, force) in enumerate(zip(stills, pulls, distances, forces, strict=True)):
        now = faults.world(index, world)
        give = now.parameters[8] / np.exp(now.parameters[6])

        def bent(load: np.ndarray) -> tuple[RodShape, Rotation]:
            """Under a load: the clamp gives way to its moment, as if the rod and its loads were turned."""
            moment = solve_rod(now.rod, pull[None], distance, load[None]).clamp_moment_Nm[0]  # noqa: B023
            turn = Rotation.from_rotvec(give * moment * [0.0, 1.0, 1.0])  # noqa: B023
            turned = turn.inv().apply([pull, load])[:, None]  # noqa: B023
            return solve_rod(now.rod, turned[0], distance, turned[1]), turn  # noqa: B023

        (felt, turn), (shape, way) = bent(force), bent(force * [1.0, 1.0, faults.softer_to_z])
        clamp, (at_m, about_y, about_z) = np.append(0.0, now.parameters[:2]), faults.kink
        beyond = np.clip(s - at_m, 0.0, None)
        points = along(shape, s) + np.column_stack([0.0 * s, about_z * beyond, -about_y * beyond])
        pixels = seen(now.T_antenna_camera, clamp + way.apply(points - clamp))
        onward = np.gradient(pixels, axis=0)
        px_per_m = np.linalg.norm(onward[-1]) / (s[-1] - s[-2])
        onward /= np.linalg.norm(onward, axis=1, keepdims=True)
        off = light_px + faults.line_px * rng.normal(size=3)
        line = np.polynomial.legendre.legval(np.linspace(-1.0, 1.0, len(s)), off)[:, None]
        end = pixels[-1] + (faults.tip_m or 0.0) * px_per_m * onward[-1] + rng.normal(0.0, TIP_PX, 2)
        noisy = pixels + line * onward[:, ::-1] * [-1.0, 1.0] + rng.normal(0.0, faults.sigma_px, pixels.shape)
        inside = ((noisy > 1) & (noisy < np.array(SIZE) - 2)).all(axis=1)
        tip = {"tip_px": end, "tip_std_px": TIP_PX} if faults.tip_m is not None and inside[-1] else {}
        moment = -turn.apply(felt.clamp_moment_Nm[0])[1]
        read = now.sensor.gain * moment + now.sensor.offset_Nm + rng.normal(0.0, now.sensor.std_Nm)
        noted = replace(still, moment_Nm=float(read))
        sigma_px = np.full(inside.sum(), faults.claimed * faults.sigma_px)
        found.append(Observation(noted, noisy[inside], sigma_px, pull, **tip))
    return found


def before(world: World, rng: np.random.Generator, readings: LoadReadings = WEIGHED) -> Prior:
    """What the jig says of the camera's pose, and how well ruler and balance are known."""
    start = world.T_antenna_camera.retract(np.sqrt(np.diag(POSE_COVARIANCE)) * rng.normal(size=6))
    camera = Camera("opencv", SIZE, MATRIX, BROWN)
    return prior(NOMINAL, camera, [PoseEstimate("jig", start, POSE_COVARIANCE, np.zeros((6, 8)))], readings=readings)


def solved(observations: Sequence[Observation], known: Prior) -> BundleAdjustment:
    """The joint solve."""
    return adjust_bundle(observations, known, LENGTH_M, 2e-5)


def session(gravity_world_m_s2: np.ndarray = GRAVITY_WORLD) -> Session:
    """A session with nothing on disk."""
    board = BoardSpec(
        **{"type": "charuco", "squares_x": 9, "squares_y": 6, "square_m": 0.012, "marker_m": 0.009}
        | {"dictionary": "DICT_4X4_100", "legacy_pattern": False, "thickness_m": 0.0}
    )
    return Session(Path("."), board, NOMINAL, None, Kinematics(), gravity_world_m_s2, 2e-5)
