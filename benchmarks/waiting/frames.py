"""Frames as users have them: centrelines, and pictures in memory."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.estimator.scenes import Scenes, joined, push_for_deflection, rod_shapes, rolled, scenes
from benchmarks.estimator.setup import TOWARDS_CLAMP, Setup, drawn_truth
from benchmarks.vision.scenes import PLAIN, bare_studio
from estimator.table.contacts import FRICTION_RAD
from vbaa_calib.rig import Rig
from vbaa_calib.simulate.render.antenna import tube, tube_patches
from vbaa_calib.simulate.render.picture import LAMP_WORLD, digitise, expose
from vbaa_calib.simulate.scene.lens import Lens

REACH, DEFLECTION_M, ROLL_RAD = (0.3, 0.8), (0.004, 0.008), np.radians(60.0)
"""Contact distances over length, deflections there, and the largest roll of the deformation plane."""
JOINTS_RAD = 0.4
"""Pan and tilt lie within ± this."""
RUBBED = 0.5
"""Share of the frames with friction, where there is any."""
TRUE_RIGS = 20
SIZE, PICTURE_JOINTS_RAD = (1280, 720), (0.3, -0.25)
"""Of pictures, px; pan and tilt of all of them: weight bends the antenna along y and z."""


def population(rig: Rig, frames: int, seed: int, friction_rad: float = 0.0, points: int = 200) -> Scenes:
    """Noisy frames of the static rod, rolls evenly up to 60°, half of them with friction of that deviation.

    Of a rig that is not exactly known several true ones take part, each one draw of its covariance away.
    """
    rng, antenna, exact = np.random.default_rng((seed, points)), rig.antenna, not rig.covariance.any()
    distance = rng.uniform(*REACH, frames) * antenna.length_m
    size = push_for_deflection(rng.uniform(*DEFLECTION_M, frames), distance, antenna.stiffness_Nm2)
    size = np.nan_to_num(size) * rng.choice([-1.0, 1.0], frames)
    push = rolled(size, rng.uniform(-ROLL_RAD, ROLL_RAD, frames))
    friction = friction_rad * rng.normal(size=frames) * (rng.random(frames) < RUBBED)
    joints = rng.uniform(-JOINTS_RAD, JOINTS_RAD, (2, frames))

    def seen(truth: Rig, own: np.ndarray) -> Scenes:
        pan, tilt = joints[:, own]
        how: dict[str, Any] = {"made_by": rod_shapes, "sigma_px": rig.image.noise_px, "points": points, "given": rig}
        return scenes(truth, distance[own], push[own], friction[own], pan_rad=pan, tilt_rad=tilt, **how)

    parts = np.array_split(np.arange(frames), 1 if exact else min(TRUE_RIGS, frames))
    return joined([seen(rig if exact else drawn_truth(rig, rng), own).noisy(rng) for own in parts])


def photographed(count: int, seed: int) -> tuple[Rig, dict[str, np.ndarray]]:
    """The calibrated rig, and pictures in memory with what is read at the same time, each from a true rig of its own.

    Shapes are the static rod's, pictures the simulator's: in focus, light from one side and dark corners, nothing
    behind.
    """
    rng = np.random.default_rng([seed, *SIZE, False])
    setup = Setup(tilt_rad=np.radians(30.0), azimuth_rad=TOWARDS_CLAMP, image_size=SIZE, real=True, exact=False)
    images, moments = zip(*(_picture(drawn_truth(setup.rig(), rng), rng) for _ in range(count)), strict=True)
    pan, tilt = (np.full(count, angle) for angle in PICTURE_JOINTS_RAD)
    return setup.rig(), {"images": np.array(images), "moment_Nm": np.array(moments), "pan_rad": pan, "tilt_rad": tilt}


def _picture(rig: Rig, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """The picture (H, W) uint8 and the moment's reading, N·m, of one contact at random."""
    antenna, (pan, tilt) = rig.antenna, PICTURE_JOINTS_RAD
    distance = rng.uniform(*REACH, 1) * antenna.length_m
    size = push_for_deflection(rng.uniform(DEFLECTION_M[0], 0.010, 1), distance, antenna.stiffness_Nm2)
    push = rolled(size * rng.choice([-1.0, 1.0]), rng.uniform(-ROLL_RAD, ROLL_RAD))
    friction = np.clip(FRICTION_RAD * rng.normal(size=1), -1.0, 1.0)
    truth = scenes(rig, distance, push, friction, made_by=rod_shapes, pan_rad=pan, tilt_rad=tilt)
    at, to_camera = np.linspace(0.0, antenna.length_m, 161), rig.T_antenna_camera.inverse()
    lens = Lens(rig.camera.model, SIZE, rig.camera.matrix, rig.camera.distortion)
    lamp = to_camera.rotation @ rig.kinematics.T_world_antenna(pan, tilt).rotation.T @ LAMP_WORLD
    points = to_camera @ rod_shapes(rig, truth.touches, at).points_m[0]
    studio = bare_studio(lens, replace(PLAIN, vignette=0.3, gradient=0.3))
    seen = tube_patches(studio, tube(lens, at, points, antenna.diameter_m / 2, lamp), studio.spec.antenna)
    canvas = np.full(SIZE[::-1], studio.spec.background, np.float32)
    image = digitise(studio.spec, expose(studio, canvas, seen), rng)
    return image, float(truth.moment_Nm[0]) + rig.moment_sensor.std_Nm * rng.normal()
