"""Errors that the frames of a recording share: those of the calibration, which no number of frames averages out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from estimator.solver.frames import Frames, frames_from_pixels
from estimator.solver.linearised import bend, linearised
from estimator.solver.rig_arrays import ANTENNA, POSES, UNKNOWNS, RigArrays
from estimator.table.contacts import ContactTable, joint_angles
from vbaa_calib.antenna.shape import CONTACT
from vbaa_calib.rig import POSE_PARAMETERS, Rig
from vbaa_calib.session import READINGS

from .settings import ContactSettings

_RUNG = "elastica"  # by which contacts are moved


@dataclass(frozen=True, eq=False)
class CommonErrors:
    """Changes of B frames' results, world frame, per standard deviation of each of S independent shared errors.

    The errors are the rig's (pose, antenna, sensor, lens), those of the joint axes, and, last, the friction angle as
    far as a frame does not determine it: neighbouring contacts have similar friction.
    NaN in frames without a located contact.

    Attributes
    ----------
    point_m, force_N, tangent : (B, 3, S).
    own_m2 : (B, 3, 3) what is left of the world point's covariance: the frame's own noise.
    """

    point_m: np.ndarray
    force_N: np.ndarray
    tangent: np.ndarray
    own_m2: np.ndarray

    @property
    def known(self) -> bool:
        """Whether there are shared errors to separate from noise."""
        return self.point_m.shape[2] > 0

    @staticmethod
    def none(table: ContactTable) -> CommonErrors:
        """No shared errors, for frames without a known rig: all of their covariance counts as their own."""
        nothing = np.zeros((len(table), 3, 0))
        return CommonErrors(nothing, nothing, nothing, table.covariance_world_m2)


def shared_errors(rig: Rig, table: ContactTable, friction_rad: float | None = None) -> CommonErrors:
    """The errors that the contacts of one recording share.

    friction_rad : what the contacts were estimated with, see `ContactEstimator`; by default what the table says.

    Raises
    ------
    InputError : the contacts are not of this rig.
    """
    pan, tilt = joint_angles(rig.kinematics, table)
    rig_arrays = RigArrays.from_rig(
        rig, table.assumed_friction_rad if friction_rad is None else friction_rad, drift=False
    )
    usable = table.located & np.isfinite(pan + tilt + table.distance_std_m)
    # of an antenna touched twice all errors count as the contact's own
    paired = table.paired
    rows = np.flatnonzero(usable & ~paired)
    chunks = (rows[begin : begin + ContactSettings.chunk] for begin in range(0, len(rows), ContactSettings.chunk))
    parts = [_moved(rig_arrays, table, row, pan[row], tilt[row]) for row in chunks]
    size = parts[0].shape[-1] if parts else 1
    moved = np.where((usable & paired)[:, None, None], np.zeros((1, 9, size)), np.nan)
    if parts:
        moved[rows] = np.concatenate(parts)
    point, force, tangent = np.split(moved, 3, axis=1)
    return CommonErrors(point, force, tangent, _rest(table.covariance_world_m2, point))


def _rest(covariance_m2: np.ndarray, modes_m: np.ndarray) -> np.ndarray:
    """(B, 3, 3) covariances without what the modes (B, 3, S) explain, positive semidefinite."""
    rest = covariance_m2 - modes_m @ np.swapaxes(modes_m, 1, 2)
    sound = np.isfinite(rest).all(axis=(1, 2))
    values, vectors = np.linalg.eigh(np.where(sound[:, None, None], rest, 0.0))
    rest = (vectors * np.clip(values, 0.0, None)[:, None]) @ np.swapaxes(vectors, 1, 2)
    return np.where(sound[:, None, None], rest, covariance_m2)


def _moved(
    rig_arrays: RigArrays, table: ContactTable, rows: np.ndarray, pan: np.ndarray, tilt: np.ndarray
) -> np.ndarray:
    """(B, 9, S) derivatives of world point, force and tangent of these rows by the shared errors."""
    rotation, _ = rig_arrays.rig.kinematics.world_antenna(pan, tilt)
    gravity = np.einsum("bji,j->bi", rotation, rig_arrays.rig.gravity_world_m_s2)
    frames = empty_frames(rig_arrays, gravity)
    unknowns = unknowns_of(frames, table, rows)
    # without a sensor about y the table does not say what was read
    read = np.isfinite(table.moment_residual_Nm[rows]) | ~rig_arrays.exists[0]
    seen = noise_free_frames(frames, _RUNG, unknowns, read, point_per_px=False)
    by_error = _errors(seen, unknowns, table.distance_std_m[rows] / rig_arrays.length_m)
    by_error = np.concatenate([0.0 * by_error[:, :1], by_error], axis=1)  # the contacts themselves first
    by_antenna = by_error[..., UNKNOWNS:] @ rig_arrays.axes[POSES : POSES + ANTENNA].T
    shapes = bend(
        frames,
        _RUNG,
        unknowns[:, None] + ContactSettings.error_step * by_error[..., :UNKNOWNS],
        ContactSettings.error_step * by_antenna,
    )
    values = np.stack([shapes.contact_m, shapes.force_N, shapes.tangents[:, CONTACT]], axis=-2)
    values = values.reshape(len(rows), -1, 3, 3)
    slopes = (values[:, 1:] - values[:, :1]) / ContactSettings.error_step
    turned = np.einsum("bij,bsqj->bqis", rotation, slopes)
    by_axes = _by_axes(rig_arrays, values[:, 0], pan, tilt)
    kinematics = rig_arrays.rig.kinematics
    size = rig_arrays.axes.shape[1]
    # an error of the pose is one of the joint axes, too, where both come from one sweep
    turned[..., :size] += by_axes @ (kinematics.axes_by_pose @ rig_arrays.axes[: len(POSE_PARAMETERS)])
    whole = np.concatenate([turned[..., :size], by_axes * kinematics.axes_std, turned[..., size:]], axis=-1)
    # what is true lies one deviation further than what is known
    return -whole.reshape(len(rows), 9, -1)


def unknowns_of(frames: Frames, table: ContactTable, rows: np.ndarray) -> np.ndarray:
    """(B, 4) solver unknowns (`rig_arrays.UNKNOWNS`) of a table's contacts, solved so that pushes and friction angles
    give the table's forces; unknown forces count as zero."""
    rig_arrays = frames.rig_arrays
    force = np.nan_to_num(np.stack([table.force_y_N[rows], table.force_z_N[rows]], axis=1))
    unknowns = np.zeros((len(rows), UNKNOWNS))
    unknowns[:, 0] = np.clip(table.distance_m[rows] / rig_arrays.length_m, 0.01, 1.0)
    unknowns[:, 1:3] = force / rig_arrays.force_unit_N
    if rig_arrays.friction_rad > 0.0:
        unknowns[:, 3] = np.nan_to_num(table.friction_angle_rad[rows]) / rig_arrays.friction_rad
    exact = replace(frames, rig_arrays=rig_arrays.exact)  # the rig's own errors turn no push
    for _ in range(ContactSettings.force_steps):
        there = linearised(exact, _RUNG, unknowns)
        step = np.linalg.solve(there.columns[:, 4:6, 1:3], (force - there.point_force[:, 4:6])[..., None])
        unknowns[:, 1:3] += step[..., 0]
    return unknowns


def _errors(frames: Frames, unknowns: np.ndarray, distance_std: np.ndarray) -> np.ndarray:
    """(B, R + 1, 4 + R) errors of a fit's unknowns and rig steps for each unit error of the rig, and of the friction
    angle.

    How many points a frame really had shows in the deviation (B,) of its distance, in antenna lengths.
    """
    there = linearised(frames, _RUNG, unknowns)
    prior, readings = there.prior, there.readings
    others = np.eye(prior.shape[1]) * prior[:, None] + np.swapaxes(readings, 1, 2) @ readings
    covariance = _as_certain(there.information - others, others, distance_std**2)
    # what is off by one deviation pulls with the weight that the prior holds it
    off = np.swapaxes(covariance * prior[:, None], 1, 2)
    return np.concatenate([off[:, UNKNOWNS:], off[:, UNKNOWNS - 1 : UNKNOWNS]], axis=1)


def _as_certain(points: np.ndarray, others: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Covariances (B, K, K) of K unknowns from information (B, K, K) of the points, times a weight, and of all else.

    The weight of each frame is the one, from 1e-3 to 1e3, with which the first unknown has the variance (B,) asked for.
    """
    # L Lᵀ = points + others, L⁻¹ points L⁻ᵀ = V Λ Vᵀ: the first unknown has the variance Σ (V' L⁻¹ e₀)²/(1 + (w − 1) Λ)
    inverse = np.linalg.inv(np.linalg.cholesky(points + others))
    values, vectors = np.linalg.eigh(inverse @ points @ np.swapaxes(inverse, 1, 2))
    shares = np.einsum("bki,bk->bi", vectors, inverse[:, :, 0]) ** 2
    values = np.clip(values, 0.0, 1.0)
    low, high = (np.full(len(variance), value) for value in (1e-3, 1e3))
    for _ in range(14):
        middle = np.sqrt(low * high)
        vague = (shares / (1.0 + (middle[:, None] - 1.0) * values)).sum(axis=1) > variance
        low, high = np.where(vague, middle, low), np.where(vague, high, middle)
    return np.linalg.inv(np.sqrt(low * high)[:, None, None] * points + others)


def _by_axes(rig_arrays: RigArrays, values: np.ndarray, pan: np.ndarray, tilt: np.ndarray) -> np.ndarray:
    """(B, 3, 3, 3) derivatives of point, force and tangent (B, 3, 3), world frame, by skew, offset and tilt zero."""
    turned, shifted = rig_arrays.rig.kinematics.by_axes(pan, tilt)
    moved = np.einsum("kbij,bqj->bqik", turned, values)
    moved[:, 0] += np.moveaxis(shifted, 0, -1)
    return moved


def empty_frames(rig_arrays: RigArrays, gravity_m_s2: np.ndarray) -> Frames:
    """Frames without points and readings, under gravity (B, 3) in the antenna frame."""
    count = len(gravity_m_s2)
    return frames_from_pixels(rig_arrays, np.zeros((count, 1, 2)), np.ones((count, 1)), *_silent(count), gravity_m_s2)


def _silent(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Missing readings (B, 6), and missing antenna ends (B, 3)."""
    return np.full((count, len(READINGS)), np.nan), np.full((count, 3), np.nan)


def noise_free_frames(
    empty: Frames, rung: str, unknowns: np.ndarray, sensor_available: np.ndarray, *, point_per_px: bool
) -> Frames:
    """Noise-free frames of contacts with these unknowns (B, 4).

    sensor_available : weights of the readings, (B,), or (B, S) in the order of `RigArrays.sensors`.
    All frames have as many points as the longest antenna has pixels, at most `most_points`. point_per_px : the points'
    standard deviations are chosen such that they weigh as much as one point a pixel.
    """
    rig_arrays, rig = empty.rig_arrays, empty.rig_arrays.rig
    T_camera_antenna = rig.T_antenna_camera.inverse()
    shapes = bend(empty, rung, unknowns[:, None])
    nodes, _ = rig.camera.project(T_camera_antenna @ shapes.points_m)
    length_px = np.nansum(np.hypot(*np.moveaxis(np.diff(nodes, axis=1), -1, 0)), axis=1)
    count = int(np.clip(np.max(length_px, initial=2.0), 2, ContactSettings.most_points))
    share = (np.arange(count) + 0.5) / count
    points = np.stack(
        [
            np.stack([np.interp(share * arc[-1], arc, axis) for axis in curve.T], axis=1)
            for arc, curve in zip(shapes.arclength_m, shapes.points_m, strict=True)
        ]
    )
    pixels, valid = rig.camera.project(T_camera_antenna @ points)
    inside = valid & ((pixels >= 0.0) & (pixels <= np.array(rig.camera.image_size) - 1.0)).all(axis=-1)
    sigma = np.full(len(pixels), rig.image.noise_px)
    if point_per_px:
        sigma = sigma * np.sqrt(count / np.clip(length_px, 1.0, None))
    pixels, sigma = np.where(inside[..., None], pixels, np.nan), np.repeat(sigma[:, None], count, axis=1)
    seen = frames_from_pixels(rig_arrays, pixels, sigma, *_silent(len(pixels)), empty.gravity_m_s2)
    # what is read of nothing, less what is predicted
    read = replace(empty, available=np.ones_like(empty.available), reading=np.zeros_like(empty.reading))
    reading = -linearised(read, rung, unknowns).residual * rig_arrays.std
    which = sensor_available if sensor_available.ndim > 1 else sensor_available[:, None] * rig_arrays.exists
    return replace(seen, reading=reading).with_available(which * 1.0, 0.0)
