"""Runs of located frames, and what differs from frame to frame in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.contact.common_errors import Shared
from estimator.table.contacts import ContactTable
from vbaa_calib.core.robust import NORMAL_QUARTILE

GAP_FRAMES = 4.0
"""A run of located frames ends where so many frames' time passes without one."""
LEAST_SECONDS = 6
"""Second differences that tell a scatter."""

MOST_SCATTER = 3.0
"""How many times as much as said the points of a path may scatter across the antenna, at most."""


@dataclass(frozen=True, eq=False)
class Stroke:
    """P located frames of one contact, in order of time.

    Attributes
    ----------
    rows : (P,) in the table. time_s : (P,)
    material_m : (P, 3) path of the antenna's material point at the contact: that of the contact point less its walk
        along the antenna.
    point_m, tangent, force_N : (P, 3) world. distance_m : (P,)
    own_m2 : (P, 3, 3) noise of the contact point that differs from frame to frame.
    material_m2 : (P, 3, 3) that of the material path.
    modes_m : (P, 3, S) how far each of S common errors moves the material path.
    """

    rows: np.ndarray
    time_s: np.ndarray
    material_m: np.ndarray
    point_m: np.ndarray
    tangent: np.ndarray
    force_N: np.ndarray
    distance_m: np.ndarray
    own_m2: np.ndarray
    material_m2: np.ndarray
    modes_m: np.ndarray


def strokes(table: ContactTable, state: np.ndarray, shared: Shared | None) -> tuple[Stroke, ...]:
    """The runs of located frames with a tangent; `state` (B,) as `onset.Contacting`'s."""
    good = table.located & (state == 1) & np.isfinite(table.time_s)
    good &= np.isfinite(table.point_world_m).all(axis=1) & np.isfinite(table.tangent_world).all(axis=1)
    rows = np.flatnonzero(good)
    if len(rows) == 0:
        return ()
    time = table.time_s[rows]
    step = usual_step(table.time_s)
    free = np.cumsum(state == 0)
    ends = (np.diff(time) > GAP_FRAMES * step) | (np.diff(free[rows]) > 0) | ~(np.diff(time) > 0.0)
    return tuple(_stroke(table, part, shared) for part in np.split(rows, np.flatnonzero(ends) + 1))


def usual_step(time_s: np.ndarray) -> float:
    """Median time from frame to frame; infinite where there is none."""
    steps = np.diff(time_s[np.isfinite(time_s)])
    steps = steps[steps > 0.0]
    return float(np.median(steps)) if len(steps) else np.inf


def own_noise(table: ContactTable, rows: np.ndarray, shared: Shared | None) -> np.ndarray:
    """(P, 3, 3) what differs from frame to frame; the whole covariance where calibration is not told apart from it."""
    whole = table.covariance_world_m2[rows]
    return whole if shared is None or shared.point_m.shape[-1] == 0 else shared.own_m2[rows]


def scatter(path: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """(D,) standard deviation by which a smooth path (P, D) scatters from frame to frame; NaN for a short one.

    By the median of the second differences: steps such as those of a slip do not count.
    """
    if len(path) < LEAST_SECONDS + 2:
        return np.full(path.shape[1], np.nan)
    before, after = np.diff(time_s)[:-1, None], np.diff(time_s)[1:, None]
    share = after / (before + after)
    off = path[1:-1] - share * path[:-2] - (1.0 - share) * path[2:]
    off = off / np.sqrt(1.0 + share**2 + (1.0 - share) ** 2)
    return np.median(np.abs(off), axis=0) / NORMAL_QUARTILE


def _stroke(table: ContactTable, rows: np.ndarray, shared: Shared | None) -> Stroke:
    time, point, tangent = table.time_s[rows], table.point_world_m[rows], table.tangent_world[rows]
    distance, force = table.distance_m[rows], table.force_world_N[rows]
    material = _less_walk(point[..., None], tangent, distance[:, None])[..., 0]
    modes = np.zeros((len(rows), 3, 0)) if shared is None else np.nan_to_num(shared.point_m[rows])
    # what moves a contact along the antenna moves its distance too
    modes = _less_walk(modes, tangent, np.einsum("pi,pis->ps", tangent, modes))
    own = own_noise(table, rows, shared)
    known = shared is not None and shared.point_m.shape[-1] > 0
    noise = _material_noise(material, time, tangent, own, known)
    return Stroke(rows, time, material, point, tangent, force, distance, own, noise, modes)


def _less_walk(point: np.ndarray, tangent: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """(P, 3, K) paths of points (P, 3, K) less their walks along the antenna, by distances (P, K)."""
    walk = 0.5 * (tangent[1:] + tangent[:-1])[..., None] * np.diff(distance, axis=0)[:, None]
    return np.concatenate([point[:1], point[1:] - np.cumsum(walk, axis=0)])


def _material_noise(
    material: np.ndarray, time: np.ndarray, tangent: np.ndarray, own: np.ndarray, known: bool
) -> np.ndarray:
    """(P, 3, 3) noise of the material path.

    An error of the distance moves the contact point along the antenna, and the walk by as much: along the antenna they
    cancel but for what the path itself shows as scatter. Across it the contact point's own noise stays; where that is
    not told apart from the calibration's error, the scatter takes its place.
    """
    along = np.einsum("pi,pj->pij", tangent, tangent)
    flat = np.eye(3) - along
    across = flat @ own @ flat
    predicted = np.sqrt(np.maximum(np.trace(across, axis1=1, axis2=2) / 2.0, 0.0))
    frame = _frames(tangent)
    seen = scatter(np.einsum("pki,pi->pk", frame, material - material.mean(axis=0)), time)
    if np.isnan(seen).any():
        return across + along * (predicted**2)[:, None, None]
    sideways = float(np.hypot(seen[1], seen[2]) / np.sqrt(2.0))
    if known and np.isfinite(predicted).all():
        # what swings more than this is motion, not noise
        factor = np.clip(sideways / max(float(np.median(predicted)), 1e-12), 1.0, MOST_SCATTER) ** 2
        return factor * across + along * seen[0] ** 2
    return along * seen[0] ** 2 + flat * sideways**2


def _frames(tangent: np.ndarray) -> np.ndarray:
    """(P, 3, 3) rows along the antenna and two across it, turning as little as the antenna does."""
    helper = np.eye(3)[np.argmin(np.abs(tangent.mean(axis=0)))]
    first = np.cross(tangent, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([tangent, first, np.cross(tangent, first)], axis=1)
