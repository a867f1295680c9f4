"""Rigs drawn from their joint covariance, what they would see, and how far the estimator's answers are off."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from benchmarks.estimator.scenes import Scenes, Shapes, ShapesOf, scenes
from benchmarks.estimator.scenes import Touches as SeenTouches
from benchmarks.estimator.setup import ACROSS, RIG_STD, Setup
from estimator import ContactEstimator
from estimator.budget.budget import BudgetContacts, _ErrorSpace, _Linearization, _linearize
from estimator.solver.rig_arrays import RigArrays
from vbaa_calib.antenna.nodes import CONTACT
from vbaa_calib.antenna.rungs import curves
from vbaa_calib.geometry import Kinematics
from vbaa_calib.rig import RIG_PARAMETERS, Rig

LENS_STD = np.array([0.2, 0.2, 0.25, 0.25, 6e-4, 2e-3, 5e-5, 5e-5])
RIGID = RIG_STD * (np.array(RIG_PARAMETERS) != "clamp_give_m")
"""The simulated clamps are rigid."""
SIGMA_PX, POINTS, FRICTION_RAD = 0.05, 360, 0.1


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


def three_touches(rig: Rig) -> BudgetContacts:
    """Away from the camera's line of sight, so that first order is enough."""
    distance = np.array([0.35, 0.6, 0.85]) * rig.antenna.length_m
    size = 2.0 * rig.antenna.stiffness_Nm2 * np.radians(14.0) / distance**2
    angle = np.array([0.0, 2.6, -1.2])
    return BudgetContacts(distance, size[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1), 0.2, 0.3)


def rung_shapes(rig: Rig, touches: SeenTouches, arclength_m: np.ndarray) -> Shapes:
    """By the library's highest rung: much faster than the rod by shooting, from which it differs by less than 1 µm."""
    made = curves(
        "rod",
        np.tile(rig.antenna.parameters, (len(touches), 1)),
        rig.antenna.length_m,
        touches.gravity_m_s2,
        touches.distance_m,
        touches.push_N,
        touches.friction_rad,
    )
    points = [
        CubicHermiteSpline(arc, curve, tangent)(arclength_m)
        for arc, curve, tangent in zip(made.arclength_m, made.points_m, made.tangents, strict=True)
    ]
    return Shapes(np.array(points), made.contact_m, made.force_N, made.moment_Nm, made.tangents[:, CONTACT])


def seen_of(
    rig: Rig, touches: BudgetContacts, made_by: ShapesOf = rung_shapes, friction_rad: float = 0.0, **changes: Any
) -> Scenes:
    """Frames of the contacts, without noise, about a point a pixel."""
    given = {"pan_rad": touches.pan_rad, "tilt_rad": touches.tilt_rad, "sigma_px": SIGMA_PX, "points": POINTS}
    return scenes(rig, touches.distance_m, touches.push_N, friction_rad, made_by=made_by, **(given | changes))


def errors(
    believed: Rig,
    steps: np.ndarray,
    touches: BudgetContacts,
    friction_rad: np.ndarray,
    rng: np.random.Generator | None = None,
    estimator_friction: float = FRICTION_RAD,
    made_by: ShapesOf = rung_shapes,
) -> np.ndarray:
    """(D, B, 6) errors of distance, f_y, f_z and world point where the true rigs are off by `steps` (D, 17 + P).

    `friction_rad` (D,); with `rng` points and readings are noisy.
    """
    truths: list[np.ndarray] = []
    seen: list[Scenes] = []
    for step, angle in zip(steps, friction_rad, strict=True):
        true = believed.moved(step)
        made = seen_of(true, touches, made_by, float(angle), given=believed)
        seen.append(made if rng is None else made.noisy(rng))
        world = true.kinematics.T_world_antenna(touches.pan_rad, touches.tilt_rad) @ made.shapes.contact_m
        truths.append(np.concatenate([made.distance_m[:, None], made.force_N[:, 1:], world], axis=1))
    found = ContactEstimator(believed, "rod", friction=estimator_friction).estimate_batch(
        np.concatenate([made.points_px for made in seen]),
        np.concatenate([made.moment_Nm for made in seen]),
        np.concatenate([made.pan_rad for made in seen]),
        np.concatenate([made.tilt_rad for made in seen]),
        sigma_px=believed.image.noise_px,
    )
    answers = np.concatenate([found.distance_m[:, None], found.force_N[:, 1:], found.point_world_m], axis=1)
    return np.asarray(answers.reshape(len(steps), len(touches), 6) - np.array(truths))


def linearised(
    rig: Rig, touches: BudgetContacts, friction: float = FRICTION_RAD
) -> tuple[RigArrays, _ErrorSpace, _Linearization]:
    rig_arrays = RigArrays.from_rig(rig, friction)
    space = _ErrorSpace.of(rig_arrays)
    return rig_arrays, space, _linearize(rig_arrays, space, touches)


RIG = correlated_rig()
