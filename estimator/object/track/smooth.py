"""Smoothing of contacts over time, with honest covariances.

Within a stroke, between one onset of slip and the next, the contact moves at a velocity that changes by a random walk
(constant-velocity Kalman filter with the Rauch–Tung–Striebel smoother). The walk's intensity is taken from the data,
axis by axis: its mean under the likelihood, so that a path too short to reveal its curvature is not taken for a
straight line. Only the noise that differs between frames is smoothed. The calibration's error, which smoothing cannot
reduce, is added again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estimator.contact.common_errors import CommonErrors, shared_errors
from estimator.object.track.onset import TrackSettings
from estimator.table.contacts import ContactTable, joint_angles
from vbaa_calib.geometry.covariance import variance_along
from vbaa_calib.rig import Rig

from .follow import follow, runs
from .onset import Track


def _kalman_smooth(
    time_s: np.ndarray, values: np.ndarray, covariance: np.ndarray, walk: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Smoothed values (P, D) and covariances (P, D, D), from values with noise covariances (P, D, D) at increasing
    times (P,). walk : (D,) intensity of the velocity's random walk, unit²/s³."""
    count, size = values.shape
    unit, nothing, noise = np.eye(size), np.zeros((size, size)), np.diag(walk)
    span = max(float(time_s[-1] - time_s[0]), 1e-9)
    wide = ((np.ptp(values, axis=0) ** 2).sum() + np.trace(covariance, axis1=1, axis2=2).mean()) * 100.0
    # place and velocity: before and after each value, and the moves between
    ahead, means = np.empty((2, count, 2 * size))
    ahead_spreads, spreads, moves = np.empty((3, count, 2 * size, 2 * size))
    mean = np.concatenate([values[0], np.zeros(size)])
    spread = np.block([[unit * wide, nothing], [nothing, unit * (wide * 100.0 / span**2)]])
    for i, value in enumerate(values):
        step = float(time_s[i] - time_s[i - 1]) if i else 0.0
        moves[i] = np.block([[unit, step * unit], [nothing, unit]])
        added = np.block([[noise * step**3 / 3.0, noise * step**2 / 2.0], [noise * step**2 / 2.0, noise * step]])
        mean, spread = moves[i] @ mean, moves[i] @ spread @ moves[i].T + added
        ahead[i], ahead_spreads[i] = mean, spread
        gain = np.linalg.solve(spread[:size, :size] + covariance[i], spread[:size]).T
        kept = np.eye(2 * size)
        kept[:, :size] -= gain
        mean = mean + gain @ (value - mean[:size])
        spread = kept @ spread @ kept.T + gain @ covariance[i] @ gain.T
        means[i], spreads[i] = mean, spread
    for i in range(count - 2, -1, -1):
        gain = np.linalg.solve(ahead_spreads[i + 1], moves[i + 1] @ spreads[i]).T
        means[i] += gain @ (means[i + 1] - ahead[i + 1])
        spreads[i] += gain @ (spreads[i + 1] - ahead_spreads[i + 1]) @ gain.T
    smoothed = spreads[:, :size, :size]
    return means[:, :size], 0.5 * (smoothed + np.swapaxes(smoothed, 1, 2))


def _walk_intensity(time_s: np.ndarray, values: np.ndarray, variance: np.ndarray) -> float:
    """Intensity, unit²/s³, of the velocity's random walk in a path (P,) with noise of these variances (P,): the
    posterior mean over a logarithmic grid; NaN where a value is missing or fewer than four are left."""
    sound = np.isfinite(values).all() and np.isfinite(variance).all() and (variance > 0.0).all()
    if not (sound and len(values) >= 4 and (np.diff(time_s) > 0.0).all()):
        return np.nan
    step = float(np.diff(time_s).mean())
    # trial intensities of the walk, about the one that would move the path by its own noise in its mean step
    trials = np.logspace(-8.0, 4.0, 37) * (float(np.median(variance)) / step**3)
    log = _log_likelihoods(time_s - time_s[0], values - values.mean(), variance, trials)
    return float(np.exp(np.logaddexp.reduce(log + np.log(trials)) - np.logaddexp.reduce(log)))


def _log_likelihoods(time: np.ndarray, values: np.ndarray, variance: np.ndarray, trials: np.ndarray) -> np.ndarray:
    """(T,) log-likelihoods of the trial intensities, by one filter for all of them; the first two values only
    initialise it."""
    step = time[1] - time[0]
    place, speed = np.full(len(trials), values[1]), np.full(len(trials), (values[1] - values[0]) / step)
    pp = np.full(len(trials), variance[1])
    pv = np.full(len(trials), variance[1] / step)
    vv = (variance[0] + variance[1]) / step**2 + trials * step / 3.0
    log = np.zeros(len(trials))
    for i in range(2, len(values)):
        step = time[i] - time[i - 1]
        place = place + step * speed
        pp, pv, vv = (
            pp + 2.0 * step * pv + step**2 * vv + trials * step**3 / 3.0,
            pv + step * vv + trials * step**2 / 2.0,
            vv + trials * step,
        )
        total, off = pp + variance[i], values[i] - place
        log -= 0.5 * (off**2 / total + np.log(total))
        place, speed = place + pp / total * off, speed + pv / total * off
        pp, pv, vv = pp - pp * pp / total, pv - pp * pv / total, vv - pv * pv / total
    return log


def smooth(
    table: ContactTable, rig: Rig, shared: CommonErrors | None = None, track: Track | None = None
) -> ContactTable:
    """The table with contact points, distances and forces smoothed over time; rows that are not located, or lie in
    too short a piece, are unchanged. The rig separates calibration errors from noise, which alone is reduced.
    shared, track : from `shared_errors` and `follow`, if known already."""
    shared = shared_errors(rig, table) if shared is None else shared
    track = follow(table, rig, shared) if track is None else track
    changed = {
        name: getattr(table, name).copy()
        for name in (
            *("point_world_m", "covariance_world_m2", "point_antenna_m", "distance_m", "distance_std_m"),
            *("force_world_N", "force_y_N", "force_z_N", "force_y_std_N", "force_z_std_N"),
        )
    }
    rotation, _ = rig.kinematics.world_antenna(*joint_angles(rig.kinematics, table))
    for rows in _smoothable_pieces(table, track):
        _smooth_piece(table, rows, shared.own_m2[rows], shared, rotation[rows], changed)
    return replace(table, **changed)


def _smoothable_pieces(table: ContactTable, track: Track) -> list[np.ndarray]:
    """Runs of rows that may be smoothed together: never across a loss, a gap, or a change between stick and slip."""
    good = table.located & np.isfinite(table.time_s) & np.isfinite(table.covariance_world_m2).all(axis=(1, 2))
    breaks = np.array([event.time_s for event in track.events if event.kind in ("loss", "slip_start", "slip_end")])
    free = track.phase == "free"
    return [
        part
        for part in runs(table, np.flatnonzero(good & ~free), free, breaks)
        if len(part) >= TrackSettings.fewest_smoothed
    ]


def _smooth_piece(
    table: ContactTable,
    rows: np.ndarray,
    own_m2: np.ndarray,
    shared: CommonErrors,
    rotation: np.ndarray,
    changed: dict[str, np.ndarray],
) -> None:
    time, point = table.time_s[rows], table.point_world_m[rows]
    size = np.trace(own_m2, axis1=1, axis2=2)
    own_m2 = own_m2 + np.eye(3) * (TrackSettings.least_noise * np.maximum(size, np.median(size)))[:, None, None]
    axes = np.linalg.eigh(own_m2.mean(axis=0))[1]
    turned = axes.T @ own_m2 @ axes
    path = (point - point.mean(axis=0)) @ axes
    walks = np.array([_walk_intensity(time, path[:, i], turned[:, i, i]) for i in range(3)])
    if not np.isfinite(walks).all():
        return
    found, covariance = _kalman_smooth(time, path, turned, walks)
    moved = found @ axes.T + point.mean(axis=0) - point
    changed["point_world_m"][rows] = point + moved
    common = shared.point_m[rows]
    changed["covariance_world_m2"][rows] = axes @ covariance @ axes.T + common @ np.swapaxes(common, 1, 2)
    changed["point_antenna_m"][rows] += np.einsum("bji,bj->bi", rotation, moved)

    def smooth_number(name: str, own: np.ndarray) -> np.ndarray:
        """A smoothed column with own variances (P,); unchanged where nothing can be done."""
        values, std = changed[name][rows], changed[_std(name)][rows]
        walk = _walk_intensity(time, values, own)
        if np.isfinite(walk):
            smoothed, rest = _kalman_smooth(time, values[:, None], own[:, None, None], np.array([walk]))
            changed[name][rows] = smoothed[:, 0]
            changed[_std(name)][rows] = np.sqrt(rest[:, 0, 0] + std**2 - own)
        return changed[name][rows]

    # the distance's own noise is that of the contact point along the antenna
    tangent, total = table.tangent_world[rows], table.distance_std_m[rows] ** 2
    along = variance_along(own_m2, tangent)
    smooth_number("distance_m", np.minimum(np.where(np.isfinite(along), along, total), total))
    # of the force y and z, antenna frame; x follows in the proportion that it had
    force = np.einsum("bji,bj->bi", rotation, table.force_world_N[rows])
    modes = np.einsum("bji,bjs->bis", rotation, shared.force_N[rows])
    before = np.hypot(table.force_y_N[rows], table.force_z_N[rows])
    for axis, name in ((1, "force_y_N"), (2, "force_z_N")):
        total = changed[_std(name)][rows] ** 2
        force[:, axis] = smooth_number(name, np.clip(total - (modes[:, axis] ** 2).sum(axis=-1), 0.01 * total, total))
    after = np.hypot(force[:, 1], force[:, 2])
    force[:, 0] *= np.where(before > 0.0, after / np.where(before > 0.0, before, 1.0), 1.0)
    changed["force_world_N"][rows] = np.einsum("bij,bj->bi", rotation, force)


def _std(name: str) -> str:
    """The name of a column's standard-deviation column."""
    quantity, _, unit = name.rpartition("_")
    return f"{quantity}_std_{unit}"
