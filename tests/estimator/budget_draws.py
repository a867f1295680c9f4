"""Rigs drawn from their joint covariance, what they would see, and how far the estimator's answers are off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estimator import ContactEstimator
from estimator.budget_touches import Touches
from vbaa_calib.bench.estimator_scenes import scenes
from vbaa_calib.bench.estimator_setup import ACROSS, RIG_STD, Setup, moved
from vbaa_calib.bench.estimator_shapes import rod_shapes
from vbaa_calib.geometry import Kinematics
from vbaa_calib.rig import RIG_PARAMETERS, Rig

LENS_STD = np.array([0.2, 0.2, 0.25, 0.25, 6e-4, 2e-3, 5e-5, 5e-5])
RIGID = RIG_STD * (np.array(RIG_PARAMETERS) != "clamp_give_m")
"""The simulated clamps are rigid."""
SIGMA_PX, POINTS, FRICTION_RAD = 0.05, 370, 0.1


def correlated_rig(seed: int = 0, lens: bool = True, axes: bool = False) -> Rig:
    """A leaning camera, weight, bow and a clamp that is off; everything is uncertain, and correlated."""
    rig = Setup("brown", 0.6, ACROSS, (640, 480), 0.1, real=True, exact=False).rig()
    std = np.concatenate([RIGID, LENS_STD]) if lens else RIGID
    mixed = np.eye(len(std)) + 0.25 * np.random.default_rng(seed).normal(size=(len(std), len(std)))
    rows = std[:, None] * mixed / np.linalg.norm(mixed, axis=1, keepdims=True)
    kinematics = Kinematics()
    if axes:
        by_pose = np.zeros((3, 6))
        by_pose[2, 1] = 0.8
        kinematics = Kinematics(axes_std=np.array([8e-4, 2e-4, 6e-4]), axes_by_pose=by_pose)
    image = replace(rig.image, noise_px=SIGMA_PX)
    return replace(rig, covariance=rows @ rows.T, kinematics=kinematics, image=image)


def moved_rig(rig: Rig, step: np.ndarray) -> Rig:
    """The rig off by (17,) or (17 + P,) in the order of its joint covariance."""
    other, lens, camera = moved(rig, step[:17]), step[17:], rig.camera
    if not len(lens):
        return other
    matrix = camera.matrix.copy()
    matrix[[0, 1, 0, 1], [0, 1, 2, 2]] += lens[:4]
    return replace(other, camera=replace(camera, matrix=matrix, distortion=camera.distortion + lens[4:]))


def errors(
    believed: Rig,
    steps: np.ndarray,
    touches: Touches,
    friction_rad: np.ndarray,
    rng: np.random.Generator | None = None,
    estimator_friction: float = FRICTION_RAD,
    axes: np.ndarray | None = None,
) -> np.ndarray:
    """(D, B, 6) errors of distance, f_y, f_z and world point where the true rigs are off by `steps` (D, 17 + P).

    `friction_rad` (D,), `axes` (D, 3) errors of the joint axes; with `rng` points and readings are noisy.
    """
    seen, truths = [], []
    for draw, step in enumerate(steps):
        true = moved_rig(believed, step)
        if axes is not None:
            skew, offset, zero = axes[draw]
            true = replace(
                true,
                kinematics=replace(true.kinematics, axis_skew_rad=skew, axis_offset_m=offset, tilt_zero_rad=zero),
            )
        made = scenes(
            true,
            touches.distance_m,
            touches.push_N,
            friction_rad[draw],
            made_by=rod_shapes,
            pan_rad=touches.pan_rad,
            tilt_rad=touches.tilt_rad,
            sigma_px=believed.image.noise_px,
            points=POINTS,
            given=believed,
        )
        seen.append(made if rng is None else made.noisy(rng))
        point = np.array(
            [
                [np.interp(distance, made.arclength_m, axis) for axis in shape.T]
                for distance, shape in zip(made.distance_m, made.shapes.points_m, strict=True)
            ]
        )
        world = true.kinematics.T_world_antenna(touches.pan_rad, touches.tilt_rad) @ point
        truths.append(np.concatenate([made.distance_m[:, None], made.force_N[:, 1:], world], axis=1))
    found = ContactEstimator(believed, "rod", friction=estimator_friction).estimate_batch(
        np.concatenate([made.points_px for made in seen]),
        np.concatenate([made.moment_Nm for made in seen]),
        np.concatenate([made.pan_rad for made in seen]),
        np.concatenate([made.tilt_rad for made in seen]),
        sigma_px=believed.image.noise_px,
    )
    answers = np.concatenate([found.distance_m[:, None], found.force_N[:, 1:], found.point_world_m], axis=1)
    return answers.reshape(len(steps), len(touches), 6) - np.array(truths)
