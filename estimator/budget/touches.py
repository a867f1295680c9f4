"""Contacts as a rig would see them, without noise: what the error budget is made for."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from estimator.contact.noise_free import empty_frames, noise_free_frames
from estimator.solver.frames import Frames
from estimator.solver.prediction import predict
from estimator.solver.rig_arrays import UNKNOWNS, RigArrays
from vbaa_calib.antenna.nodes import CONTACT
from vbaa_calib.rig import Rig

RUNG = "rod"  # what a fit on a lower rung would say is as good as the same where that rung would be taken
# Ordinary contacts: parts of the length; slopes of the antenna at the contact, of a light touch, a firm one, and nearly
# as much as is ordinary; and directions around the antenna. Nearer to the clamp than `_STRONGEST_AT` of the length the
# force stays what gives that slope there: who presses there with a force that bends the antenna as much presses several
# times as hard.
_DISTANCES, _SLOPES_DEG, _DIRECTIONS, _STRONGEST_AT = (0.2, 0.35, 0.5, 0.65, 0.8, 0.95), (5.0, 15.0, 30.0), 8, 0.5
_STEEPEST_RAD = np.radians(45.0)  # slopes beyond it are not compared with the rod
_FORCE_TOLERANCE, _FORCE_STEPS = 1e-6, 6


@dataclass(frozen=True, eq=False)
class Touches:
    """B contacts, antenna frame: `distance_m` (B,), and `push_N` (B, 2), the force across the clamp's x axis before
    friction; the joints' `pan_rad` and `tilt_rad` for all of them."""

    distance_m: np.ndarray
    push_N: np.ndarray
    pan_rad: float = 0.0
    tilt_rad: float = 0.0

    def __len__(self) -> int:
        return len(self.distance_m)

    def picked(self, which: np.ndarray) -> Touches:
        """Those of a mask or of indices."""
        return replace(self, distance_m=self.distance_m[which], push_N=self.push_N[which])


def ordinary_touches(rig: Rig, pan_rad: float = 0.0, tilt_rad: float = 0.0) -> Touches:
    """A grid over distance, force by the slope that it makes, and direction of the force around the antenna."""
    around = 2.0 * np.pi * (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS
    grid = np.meshgrid(np.array(_DISTANCES) * rig.antenna.length_m, np.radians(_SLOPES_DEG), around, indexing="ij")
    distance, slope, angle = (part.reshape(-1) for part in grid)
    lever = np.maximum(distance, _STRONGEST_AT * rig.antenna.length_m)
    size = 2.0 * rig.antenna.stiffness_Nm2 * slope / lever**2
    return Touches(distance, size[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1), pan_rad, tilt_rad)


def unknowns_of(rig_arrays: RigArrays, touches: Touches) -> np.ndarray:
    """(B, 4) `rig_arrays.UNKNOWNS`, without friction."""
    unknowns = np.zeros((len(touches), UNKNOWNS))
    unknowns[:, 0] = touches.distance_m / rig_arrays.length_m
    unknowns[:, 1:3] = touches.push_N / rig_arrays.force_unit_N
    return unknowns


def touch_of_force(
    rig_arrays: RigArrays, distance_m: float, force_N: np.ndarray, pan_rad: float, tilt_rad: float
) -> Touches:
    """The one contact whose lateral force, antenna frame, is `force_N` (2,); of a push NaN where it bends too far."""
    touch = Touches(np.array([distance_m]), force_N[None].astype(float), pan_rad, tilt_rad)
    empty = _empty(rig_arrays, touch)
    unknowns = unknowns_of(rig_arrays, touch)
    with np.errstate(all="ignore"):
        for _ in range(_FORCE_STEPS):
            prediction = predict(empty, RUNG, unknowns)
            slopes = prediction.point_force_jacobian[:, 4:6, 1:3]
            if not np.isfinite(slopes).all():
                break
            unknowns[:, 1:3] += np.linalg.solve(slopes, (force_N - prediction.point_force[:, 4:6])[..., None])[..., 0]
        prediction = predict(empty, RUNG, unknowns)
        found = np.abs(prediction.point_force[0, 4:6] - force_N).max() <= _FORCE_TOLERANCE * np.hypot(*force_N)
        ordinary = prediction.tangents[0, CONTACT] @ prediction.tangents[0, 0] >= np.cos(_STEEPEST_RAD)
    return replace(touch, push_N=unknowns[:, 1:3] * (rig_arrays.force_unit_N if found and ordinary else np.nan))


def noise_free_touches(rig_arrays: RigArrays, touches: Touches, with_moment: bool) -> Frames:
    """Noise-free frames of the contacts, with the reading if it is to be used."""
    available = np.ones((len(touches), 2)) * (with_moment & (rig_arrays.gain != 0.0))
    unknowns = unknowns_of(rig_arrays, touches)
    return noise_free_frames(_empty(rig_arrays, touches), RUNG, unknowns, available, point_per_px=True)


def world_rotation(rig: Rig, touches: Touches) -> np.ndarray:
    """(3, 3) from the antenna frame to the world's at the contacts' joints."""
    return np.asarray(rig.kinematics.T_world_antenna(touches.pan_rad, touches.tilt_rad).rotation)


def _empty(rig_arrays: RigArrays, touches: Touches) -> Frames:
    gravity = world_rotation(rig_arrays.rig, touches).T @ rig_arrays.rig.gravity_world_m_s2
    return empty_frames(rig_arrays, np.tile(gravity, (len(touches), 1)))
