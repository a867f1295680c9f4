"""Contacts made smooth in time, with covariances that stay honest.

Within a stroke, between one beginning of slip and the next, the contact moves at a velocity that changes by a random
walk (constant velocity, Kalman; Rauch, Tung and Striebel backward). How much it changes is taken from the data, axis by
axis: the mean of the intensity under its likelihood, so that a path too short to tell is not taken for a straight line.
Only what differs between frames is smoothed away. The calibration's error, which no smoothing touches, is added again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vbaa_calib.rig import Rig

from ..joints import joint_angles
from ..shared import Shared, shared_errors
from ..table import ContactTable
from .follow import follow
from .kalman import smoothed, walk_of
from .result import LOSS, SLIP_END, SLIP_START, Track
from .strokes import GAP_FRAMES, own_noise, usual_step

LEAST = 5
"""Frames of a piece that is smoothed; shorter ones stay as they are."""
LEAST_NOISE = 1e-6
"""Of a point's own variance, in every direction: the filter divides by it."""


def smooth(table: ContactTable, rig: Rig, shared: Shared | None = None, track: Track | None = None) -> ContactTable:
    """The same table with contact points, distances and forces smoothed in time.

    What is not located, or lies in too short a piece, stays as it is.

    Parameters
    ----------
    rig : tells calibration from noise: without that, smoothed points would claim too much.
    shared, track : `shared_errors(rig, table)` and `follow(table, rig, shared)`, where they are known already.
    """
    if shared is None:
        shared = shared_errors(rig, table)
    if track is None:
        track = follow(table, rig, shared)
    changed = {name: getattr(table, name).copy() for name in _CHANGED}
    own = own_noise(table, np.arange(len(table)), shared)
    rotation, _ = rig.kinematics.world_antenna(*joint_angles(rig.kinematics, table))
    for rows in pieces(table, track):
        _smooth_piece(table, rows, own[rows], shared, rotation[rows], changed)
    return replace(table, **changed)


_CHANGED = (
    *("point_world_m", "covariance_world_m2", "point_antenna_m", "distance_m", "distance_std_m"),
    *("force_world_N", "force_y_N", "force_z_N", "force_y_std_N", "force_z_std_N"),
)


def pieces(table: ContactTable, track: Track) -> list[np.ndarray]:
    """Rows of the table that may be smoothed together: never across a loss, a gap, or a beginning or end of slip."""
    good = table.located & np.isfinite(table.time_s) & np.isfinite(table.covariance_world_m2).all(axis=(1, 2))
    rows = np.flatnonzero(good & (track.phase != "free"))
    if len(rows) < LEAST:
        return []
    time = table.time_s[rows]
    steps = np.diff(time)
    ends = (steps > GAP_FRAMES * usual_step(table.time_s)) | ~(steps > 0.0)
    free = np.cumsum(track.phase == "free")
    ends |= np.diff(free[rows]) > 0
    parting = [event.time_s for event in track.events if event.kind in (LOSS, SLIP_START, SLIP_END)]
    at = np.searchsorted(time, [each for each in parting if np.isfinite(each)], side="right") - 1
    ends[at[(at >= 0) & (at < len(ends))]] = True
    return [part for part in np.split(rows, np.flatnonzero(ends) + 1) if len(part) >= LEAST]


def _smooth_piece(
    table: ContactTable,
    rows: np.ndarray,
    own_m2: np.ndarray,
    shared: Shared,
    rotation: np.ndarray,
    changed: dict[str, np.ndarray],
) -> None:
    time, point = table.time_s[rows], table.point_world_m[rows]
    size = np.trace(own_m2, axis1=1, axis2=2)
    own_m2 = own_m2 + np.eye(3) * (LEAST_NOISE * np.maximum(size, np.median(size)))[:, None, None]
    axes = np.linalg.eigh(own_m2.mean(axis=0))[1]
    turned = axes.T @ own_m2 @ axes
    path = (point - point.mean(axis=0)) @ axes
    walks = np.array([walk_of(time, path[:, i], turned[:, i, i]) for i in range(3)])
    if not np.isfinite(walks).all():
        return
    found, left = smoothed(time, path, turned, walks)
    moved = found @ axes.T + point.mean(axis=0) - point
    changed["point_world_m"][rows] = point + moved
    common = shared.point_m[rows]
    changed["covariance_world_m2"][rows] = axes @ left @ axes.T + common @ np.swapaxes(common, 1, 2)
    changed["point_antenna_m"][rows] += np.einsum("bji,bj->bi", rotation, moved)
    _smooth_distance(table, rows, own_m2, changed)
    _smooth_forces(table, rows, shared, rotation, changed)


def _smooth_distance(table: ContactTable, rows: np.ndarray, own_m2: np.ndarray, changed: dict[str, np.ndarray]) -> None:
    """The distance's own noise is that of the contact point along the antenna."""
    tangent, total = table.tangent_world[rows], table.distance_std_m[rows] ** 2
    own = np.einsum("bi,bij,bj->b", tangent, own_m2, tangent)
    own = np.minimum(np.where(np.isfinite(own), own, total), total)
    found, left = _one(table.time_s[rows], table.distance_m[rows], own)
    changed["distance_m"][rows] = found
    changed["distance_std_m"][rows] = np.sqrt(left + total - own)


def _smooth_forces(
    table: ContactTable, rows: np.ndarray, shared: Shared, rotation: np.ndarray, changed: dict[str, np.ndarray]
) -> None:
    """Antenna frame, y and z; the component along the antenna's x follows in the proportion that it had."""
    time, force = table.time_s[rows], np.einsum("bji,bj->bi", rotation, table.force_world_N[rows])
    modes = np.einsum("bji,bjs->bis", rotation, shared.force_N[rows])
    before = np.hypot(table.force_y_N[rows], table.force_z_N[rows])
    for axis, name in ((1, "force_y"), (2, "force_z")):
        total = table.__dict__[f"{name}_std_N"][rows] ** 2
        own = np.clip(total - (modes[:, axis] ** 2).sum(axis=-1), 0.01 * total, total)
        found, left = _one(time, table.__dict__[f"{name}_N"][rows], own)
        changed[f"{name}_N"][rows], force[:, axis] = found, found
        changed[f"{name}_std_N"][rows] = np.sqrt(left + total - own)
    after = np.hypot(force[:, 1], force[:, 2])
    force[:, 0] *= np.where(before > 0.0, after / np.where(before > 0.0, before, 1.0), 1.0)
    changed["force_world_N"][rows] = np.einsum("bij,bj->bi", rotation, force)


def _one(time: np.ndarray, values: np.ndarray, variance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(P,) smoothed values and their variances; as they were where nothing can be done."""
    walk = walk_of(time, values, variance)
    if not np.isfinite(walk):
        return values, variance
    found, left = smoothed(time, values[:, None], variance[:, None, None], np.array([walk]))
    return found[:, 0], left[:, 0, 0]
