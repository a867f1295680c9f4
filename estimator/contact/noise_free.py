"""Frames of contacts as a rig would see them, without noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estimator.solver.frames import Frames, frames_from_pixels
from estimator.solver.prediction import bend, predicted_moment
from estimator.solver.rig_arrays import RigArrays

MOST_POINTS = 400


def empty_frames(rig_arrays: RigArrays, gravity_m_s2: np.ndarray) -> Frames:
    """Frames without points and readings, under gravity (B, 3) in the antenna frame."""
    count = len(gravity_m_s2)
    return frames_from_pixels(rig_arrays, np.zeros((count, 1, 2)), np.ones((count, 1)), *_silent(count), gravity_m_s2)


def _silent(count: int) -> tuple[np.ndarray, np.ndarray]:
    """No readings (B, 2), and no antenna's end (B, 3)."""
    return np.full((count, 2), np.nan), np.full((count, 3), np.nan)


def noise_free_frames(
    empty: Frames, rung: str, unknowns: np.ndarray, sensor_available: np.ndarray, *, point_per_px: bool
) -> Frames:
    """Frames that show contacts with these unknowns (B, 4), with the readings that are available (B, 2).

    All have the points of the longest, about one a pixel but not more than `MOST_POINTS`; with `point_per_px` each
    point's deviation makes up for it, so that they weigh as much as one a pixel.
    """
    rig_arrays, rig = empty.rig_arrays, empty.rig_arrays.rig
    T_camera_antenna = rig.T_antenna_camera.inverse()
    shapes = bend(empty, rung, unknowns[:, None])
    nodes, _ = rig.camera.project(T_camera_antenna @ shapes.points_m)
    length_px = np.nansum(np.hypot(*np.moveaxis(np.diff(nodes, axis=1), -1, 0)), axis=1)
    count = int(np.clip(np.max(length_px, initial=2.0), 2, MOST_POINTS))
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
    moment = predicted_moment(empty, shapes) * rig_arrays.std
    available = np.column_stack([sensor_available * 1.0, np.zeros(len(pixels))])
    return replace(seen, available=available, moment_Nm=moment)
