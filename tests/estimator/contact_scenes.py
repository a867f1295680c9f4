"""One frame at a time, or many, of the static rod, and what the library says of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.estimator.scenes import Scenes, ShapesOf, push_for_slope, rod_shapes, rolled, scenes
from estimator import Contact, ContactEstimator
from estimator.contact.contacts import Contacts
from estimator.solver.frames import Frames, frames_from_pixels
from estimator.solver.linearised import linearised
from estimator.solver.rig_arrays import RigArrays
from vbaa_calib.rig import Rig

from ..rod_scenes import LENGTH_M, RIG_STD, STIFFNESS_NM2, Frame, World, camera_pose, frames, pushing

WORLD = World(camera_pose(0.6, 1.0))
RIG = WORLD.rig(0.25 * RIG_STD)
STRAIGHT = np.array([0, 0, 0, 0, 0, 0, np.log(STIFFNESS_NM2), -50.0, 0.0])
"""Parameters of a straight antenna without weight, clamped along x."""


def frame(
    contact: float = 0.62,
    roll: float = 0.4,
    tip_m: float = 0.02,
    world: World = WORLD,
    seed: int = 0,
    tilt: float = 0.3,
    **changes,
) -> Frame:
    """One frame without friction, touched at this part of its length."""
    lateral = pushing(roll, tip_m, contact * LENGTH_M).tolist()
    return frames(world, [contact * LENGTH_M], [lateral], [tilt], np.random.default_rng(seed), **changes)[0]


def estimated(seen: Frame, rig: Rig = RIG, model: str = "auto", friction: float = 0.2, **changes) -> Contact:
    """What the library says of one frame."""
    estimator = ContactEstimator(rig, model, friction=friction)
    given = {"moment": seen.moment_Nm} | changes
    return estimator.estimate(seen.points_px, pan=0.0, tilt=seen.tilt_rad, **given)


def estimated_together(several: Sequence[Frame], rig: Rig = RIG, friction: float = 0.2) -> Contacts:
    """The same of many frames in one batch."""
    estimator = ContactEstimator(rig, friction=friction)
    moments, tilts = [seen.moment_Nm for seen in several], [seen.tilt_rad for seen in several]
    return estimator.estimate_batch([seen.points_px for seen in several], moments, [0.0] * len(several), tilts)


def rubbed(
    rig: Rig,
    contact: Sequence[float] | np.ndarray,
    slope_deg: Sequence[float] | np.ndarray,
    friction_rad: np.ndarray | float = 0.0,
    roll: np.ndarray | float = 0.4,
    *,
    sigma_px: float = 0.1,
    made_by: ShapesOf = rod_shapes,
    **changes,
) -> Scenes:
    """Frames without noise at parts of the length, with this slope and this friction angle at the contact."""
    distance = np.asarray(contact, float) * LENGTH_M
    size = push_for_slope(np.radians(slope_deg), distance, STIFFNESS_NM2)
    return scenes(rig, distance, rolled(size, roll), friction_rad, made_by=made_by, sigma_px=sigma_px, **changes)


def answered(
    given: Scenes,
    model: str = "auto",
    friction: float = 0.2,
    moments_Nm: np.ndarray | None = None,
    blind: bool = False,
    jobs: int | None = None,
) -> Contacts:
    """What the library says of scenes; `blind`: without a moment sensor."""
    moments = None if blind else given.moment_Nm if moments_Nm is None else moments_Nm
    return ContactEstimator(given.rig, model, friction=friction, jobs=jobs).estimate_batch(
        given.points_px, moments, given.pan_rad, given.tilt_rad, sigma_px=given.sigma_px
    )


def deviations(contact: Contact, seen: Frame) -> np.ndarray:
    """Errors of distance, f_y and f_z over their standard deviations."""
    force = (contact.force_N - seen.force_N)[1:] / contact.force_std_N[1:]
    return np.array([(contact.distance_m - seen.distance_m) / contact.distance_std_m, *force])


def scene_deviations(found: Contacts, given: Scenes) -> np.ndarray:
    """(B, 3) the same for scenes, NaN where nothing is said."""
    force = (found.force_N - given.force_N)[:, 1:] / found.force_std_N[:, 1:]
    distance = (found.distance_m - given.distance_m) / found.distance_std_m
    return np.concatenate([distance[:, None], force], axis=1)


def frames_of(given: Scenes, friction: float) -> Frames:
    """Scenes as the solver takes them."""
    rig_arrays, count = RigArrays.from_rig(given.rig, friction), len(given)
    rotation, _ = given.rig.kinematics.world_antenna(given.pan_rad, given.tilt_rad)
    gravity = np.einsum("bji,j->bi", rotation, given.rig.gravity_world_m_s2)
    readings = np.column_stack([given.moment_Nm, np.full(count, np.nan)])
    sigma, no_tips = np.full(given.points_px.shape[:2], given.sigma_px), np.full((count, 3), np.nan)
    return frames_from_pixels(rig_arrays, given.points_px, sigma, readings, no_tips, gravity)


def fitted_std(found: Contacts, given: Scenes, rung: str, friction: float = 0.2) -> np.ndarray:
    """(B, 3) deviations of distance, f_y and f_z by noise and rig alone, whatever the rung makes wrong."""
    frames = frames_of(given, friction)
    here = linearised(frames, rung, found.numbers.unknowns)
    distance = np.zeros_like(here.columns[:, :1])
    distance[..., 0] = frames.rig_arrays.length_m
    by_all = np.concatenate([distance, here.columns[:, 4:]], axis=1)
    return np.sqrt(np.einsum("bqk,bkm,bqm->bq", by_all, np.linalg.inv(here.information), by_all))


def point_nees(contact: Contact, seen: Frame) -> float:
    """Normalised error squared of the world point, 1 on average."""
    off = contact.point_world_m - seen.contact_world_m
    return float(off @ np.linalg.solve(contact.covariance_world_m2, off) / 3)


def withheld(contact: Contact) -> bool:
    """No number is given for what the data do not hold."""
    numbers = (contact.distance_m, contact.distance_std_m, contact.force_N, contact.point_world_m, contact.deflection_m)
    return all(np.isnan(number).all() for number in numbers) and bool(contact.reason)


def furthest(first: Contact, second: Contact) -> float:
    """The largest difference of two answers in standard deviations; infinite where they differ in words or in kind."""
    if (first.status, first.in_contact) != (second.status, second.in_contact):
        return np.inf
    if not np.isfinite(first.distance_m):
        return 0.0 if np.isnan(second.distance_m) else np.inf
    if first.model != second.model:
        return np.inf
    point_std = np.sqrt(np.diag(first.covariance_world_m2))
    away = [
        (first.distance_m - second.distance_m) / first.distance_std_m,
        first.distance_std_m / second.distance_std_m - 1.0,
        (first.friction_angle_rad - second.friction_angle_rad) / max(first.friction_angle_std_rad, 1e-9),
        *(first.force_N - second.force_N)[1:] / first.force_std_N[1:],
        *(first.point_world_m - second.point_world_m) / point_std,
    ]
    return float(np.max(np.abs(away)))
