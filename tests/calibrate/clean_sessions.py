"""Sessions without a fault, of rigs, loads and noise drawn widely: whatever is said of them is a false alarm.

The camera looks from straight above plane C or leans to any side; loads pull in every direction, along the line of
sight among them, are tiny or large, hang at the tip, or twice; readings, light and sensor are off as session.yaml says.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from vbaa_calib.calibrate.antenna.inputs import Observation, Prior
from vbaa_calib.calibrate.antenna.session_rig import make_rig, prior, solve_antenna
from vbaa_calib.calibrate.check.antenna import check_antenna, check_stills
from vbaa_calib.calibrate.doubts import _row_doubts as row_doubts
from vbaa_calib.calibrate.doubts import prior_doubts
from vbaa_calib.calibrate.pose.fusion import PoseEstimate
from vbaa_calib.camera import Camera
from vbaa_calib.diagnose.session import static_frame_diagnoses
from vbaa_calib.geometry import Kinematics
from vbaa_calib.rig import MomentSensor, Rig
from vbaa_calib.session import DRIFTS, Drift, Load, LoadReadings, Session, Still

from ..rod_scenes import BROWN, LENGTH_M, MATRIX, STIFFNESS_NM2, World, camera_pose
from .checked_rigs import LENS_STD
from .still_faults import NOMINAL, SIZE, WEIGHED, Faults, observed, session


@dataclass(frozen=True, eq=False)
class CleanSession:
    """A session, what was seen of its stills, and what was known before; the rig as it is, and errors that are none."""

    session: Session
    observations: Sequence[Observation]
    before: Prior
    world: World
    errors: Faults


def clean_session(seed: int) -> CleanSession:
    """One draw; the same seed gives the same."""
    rng = np.random.default_rng((20, seed))
    upright = rng.uniform() < 0.4
    view = camera_pose(0.0 if upright else rng.uniform(0.0, 1.0), rng.uniform(0, 2 * np.pi), rng.uniform(0.32, 0.5))
    world = _careful_world(World(view), rng)
    line_px = float(rng.choice([0.0, 0.003, 0.01, 0.03]))
    told = replace(
        session(),
        load_readings=WEIGHED,
        moment_std_Nm=world.sensor.std_Nm,
        drift=replace(DRIFTS["lab"], line_px=line_px),
    )
    stills = [*_free(rng, int(rng.integers(2, 7))), *_loads(rng, view.rotation[:, 2], int(rng.integers(2, 13)))]
    before, sigma_px, light_px = _before(world, rng, told.drift), rng.uniform(0.03, 0.15), 0.015 * rng.normal(size=3)
    tip_m = (NOMINAL.tip_std_m or 0.0) * rng.normal()
    errors = Faults(points=0, sigma_px=sigma_px, line_px=line_px, light_px=light_px, tip_m=tip_m)
    return CleanSession(told, observed(world, stills, rng, errors), before, world, errors)


def _careful_world(world: World, rng: np.random.Generator) -> World:
    """A rig as the priors expect it, its sensor far less exact than they do."""
    std = np.array([1.5e-3] * 2 + [0.035] * 2 + [0.3] * 2 + [0.04, 0.03, 5e-4])
    parameters = world.parameters.copy()
    parameters[:6] = 0.0
    parameters += rng.choice([0.3, 1.0]) * std * rng.normal(size=9)
    sensor = MomentSensor(1 + 0.05 * rng.normal(), 5e-4 * rng.normal(), float(rng.choice([1e-5, 2e-5, 1e-4])))
    return World(world.T_antenna_camera, parameters, sensor)


def _free(rng: np.random.Generator, count: int) -> list[Still]:
    tilts = np.append(0.0, rng.uniform(-0.6, 0.6, count - 1))
    return [Still(Path(f"noload_{i:03d}.png"), rng.uniform(-1, 1), t, 0.0) for i, t in enumerate(tilts.tolist())]


def _loads(rng: np.random.Generator, sight: np.ndarray, count: int) -> list[Load]:
    """Over pulleys to all sides, along the axes, along the camera's line of sight, or hanging straight down."""
    found: list[Load] = []
    along_sight = float(np.arctan2(sight[2], sight[1]))
    for index in range(count):
        if found and rng.uniform() < 0.15:
            # hung once more, or the other way
            y, z = np.array([found[-1].force_y_N, found[-1].force_z_N]) * rng.choice([-1.0, 1.0])
            found.append(
                replace(found[-1], image=Path(f"loads_{index:03d}.png"), force_y_N=float(y), force_z_N=float(z))
            )
            continue
        kind = rng.integers(4)
        turn = [rng.uniform(0, 2 * np.pi), rng.integers(4) * np.pi / 2, along_sight, -np.pi / 2][kind]
        tilt = 0.0 if kind == 3 else float(rng.choice([0.0, rng.uniform(-0.6, 0.6)]))
        distance = LENGTH_M if rng.uniform() < 0.1 else round(rng.uniform(0.04, LENGTH_M), 3)
        slope = np.exp(rng.uniform(np.log(0.004), np.log(0.35)))
        force = float(f"{2 * STIFFNESS_NM2 * slope / distance**2:.2g}")
        y, z = force * np.cos(turn), force * np.sin(turn)
        pan = rng.uniform(-1, 1)
        found.append(Load(Path(f"loads_{index:03d}.png"), pan, tilt, 0.0, distance, float(y), float(z)))
    return found


def _before(world: World, rng: np.random.Generator, drift: Drift) -> Prior:
    """A lens and a pose of the camera as the board's pictures may have given them."""
    std = float(rng.choice([0.2, 1.0])) * np.array([3e-4] * 3 + [2e-4] * 3)
    start = world.T_antenna_camera.retract(std * rng.normal(size=6))
    matrix, distortion, covariance = MATRIX.copy(), BROWN, None
    if rng.uniform() < 0.6:
        off = LENS_STD[:8] * rng.normal(size=8)
        matrix[[0, 1, 0, 1], [0, 1, 2, 2]] += off[:4]
        distortion, covariance = BROWN + off[4:], np.diag(LENS_STD[:8] ** 2)
    camera = Camera("opencv", SIZE, matrix, distortion, covariance)
    estimate = PoseEstimate("jig", start, np.diag(std**2), np.zeros((6, 8)))
    return prior(NOMINAL, camera, [estimate], readings=WEIGHED, drift=drift)


def again(drawn: CleanSession, seed: int) -> list[Observation]:
    """The same rig a month later, unchanged: new stills, noise and readings."""
    rng = np.random.default_rng((21, seed))
    sight = drawn.world.T_antenna_camera.rotation[:, 2]
    return observed(drawn.world, [*_free(rng, 3), *_loads(rng, sight, 6)], rng, drawn.errors)


def said(drawn: CleanSession) -> tuple[list[str], Rig]:
    """What `vbaa calibrate` says of the stills, its diagnoses first, and the rig."""
    joint = solve_antenna(drawn.session, drawn.observations, drawn.before)
    rig = make_rig(drawn.session, Kinematics(), joint, drawn.observations)
    diagnoses = static_frame_diagnoses(drawn.session, Kinematics(), joint)
    found = diagnoses + prior_doubts(joint, diagnoses) + row_doubts(joint, ())
    # a gain of its own is no fault of a sensor
    return [f"{one.name}: {one}" for one in found if one.severity != "note"], rig


def checked(rig: Rig, observations: Sequence[Observation], readings: LoadReadings = WEIGHED) -> list[str]:
    """What `vbaa check` answers to stills of an unchanged rig, where it is not "holds"."""
    answers = check_antenna(rig, check_stills(rig, observations, readings), camera_known=True)[0]
    return [f"{one.name}: {one.level}, {one.words}" for one in answers if one.is_bad]
