"""Touches as friction sees them: out of the table, the surface's normals, the slip, and the errors in common."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from estimator.table.contacts import ContactTable

from .directions import Axes, Directions, directions, dot, side_by_side, unit
from .evidence import SLIDING, STICKING, UNUSED, Rubs

if TYPE_CHECKING:
    from estimator.contact.common_errors import Shared
    from estimator.object.surface import Surface
    from estimator.object.track.result import Track

NORMAL_KNOWN_RAD = 0.12
"""A touch whose normal the shape does not tell to this tells nothing of friction across the antenna."""
FORCE_KNOWN_RAD = 0.25
"""Nor does one whose force is not known to this."""
SLIPS = 2.0
"""A slip speed of so many deviations has a direction."""
LEAST_OWN = 0.7
"""So much of a friction angle's deviation at least is the frame's own: the difference of two that are nearly alike, the
whole and the common one, would be anything."""
NEIGHBOURS, NEAR_S = 2, 0.07
"""A touch slides for certain if so many frames before and after it, as far as they lie within this time, and the next
ones in any case, slide the same way: the slip is taken from several frames at a time, so that it begins early and ends
late, and turns slowly where it turned at once."""
SAME_WAY = 0.5
"""Cosine between the slips of such neighbours."""
SEEN = 0.5
"""A friction angle is seen where its deviation falls to so much of the one before the frame was seen. Above that the
prior, which is taken out again, would be most of what is left."""


def rubs_of(
    table: ContactTable, surface: Surface, track: Track, shared: Shared, friction_rad: float
) -> tuple[Rubs, Axes, Directions]:
    """The touches of a surface, with the axes and the forces' directions behind them.

    Parameters
    ----------
    friction_rad : standard deviation of the friction angle that the contacts were estimated with.
    """
    rows = surface.touched_row
    axes = Axes.of(surface.touched_normal, table.tangent_world[rows], table.status[rows] == "tip_contact")
    found = directions(table, shared, rows, axes)
    turned = np.einsum("pi,pij,pj->p", axes.lateral, surface.touched_normal_covariance, axes.lateral)
    common = np.einsum("pi,pik->pk", axes.lateral, surface.touched_normal_modes)
    normal_std = np.sqrt(np.maximum(turned - np.sum(common**2, axis=1), 0.0))
    seen, seen_std, seen_modes = _seen(table, shared, rows, axes, found, friction_rad)
    none = np.zeros_like(common)
    lateral_modes = np.hstack([found.lateral_modes_rad, np.zeros((len(rows), 1)), common])
    slip, slip_std = _slip(track, rows, axes)
    force_std = np.hypot(found.lateral_std_rad, np.linalg.norm(found.lateral_modes_rad, axis=1))
    sound = ~surface.left_out & ~track.ringing[rows] & np.isfinite(found.lateral_rad)
    beside = side_by_side(table.point_world_m[rows], shared.own_m2[rows], axes, surface.touched_patch)
    told = np.sqrt(np.maximum(turned, 0.0)) < NORMAL_KNOWN_RAD
    across = sound & beside & told & (force_std < FORCE_KNOWN_RAD)
    along = sound & np.isfinite(seen) & np.isfinite(seen_std)
    slides = settled(track, table.time_s)[rows] & np.isfinite(slip_std)
    rubs = Rubs(
        used_as=np.where(across | along, np.where(slides, SLIDING, STICKING), UNUSED),
        slides=slides,
        beside=beside,
        lateral_rad=np.where(across, found.lateral_rad, np.nan),
        lateral_std_rad=np.hypot(found.lateral_std_rad, normal_std),
        lateral_modes_rad=np.where(across[:, None], lateral_modes, 0.0),
        normal_std_rad=normal_std,
        normal_modes_rad=np.where(across[:, None], np.hstack([0.0 * seen_modes, common]), 0.0),
        longitudinal_rad=np.where(along, seen, np.nan),
        longitudinal_std_rad=seen_std,
        longitudinal_modes_rad=np.where(along[:, None], np.hstack([seen_modes, none]), 0.0),
        slip=slip,
        slip_std_rad=slip_std,
    )
    return rubs, axes, found


def settled(track: Track, time_s: np.ndarray) -> np.ndarray:
    """(B,) bool: frames, at times (B,), in the midst of sliding one way."""
    sliding, way = track.phase == "sliding", np.nan_to_num(unit(track.slip_velocity_m_s))
    result = sliding.copy()
    for step in range(-NEIGHBOURS, NEIGHBOURS + 1):
        at = np.arange(len(sliding)) + step
        there = np.clip(at, 0, len(sliding) - 1)
        alike = (at == there) & sliding[there] & (dot(way, way[there]) > SAME_WAY)
        result &= alike | ((abs(step) > 1) & (np.abs(time_s[there] - time_s) > NEAR_S))
    return result


def _seen(
    table: ContactTable, shared: Shared, rows: np.ndarray, axes: Axes, found: Directions, friction_rad: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Friction angles (P,) as the data alone say them, own deviations (P,) and common errors (P, S + 1).

    The estimate's prior is taken out again. NaN where it is all there was, and at the tip, where friction along the
    antenna leans the force from the antenna's normal, not from the object's.
    """
    std, size = found.longitudinal_std_rad, shared.point_m.shape[2]
    before = max(friction_rad, float(np.nanmax(std, initial=1e-12)))
    told = (std > 0.0) & (std < SEEN * before) & (table.status[rows] != "tip_contact")
    widened = 1.0 / (1.0 - np.where(told, std / before, 0.0) ** 2)
    angle, whole = found.longitudinal_rad * widened, std * np.sqrt(widened)
    if not size:
        return (
            np.where(told, angle, np.nan),
            whole,
            np.hstack([0.0 * found.lateral_modes_rad, np.nan_to_num(whole)[:, None]]),
        )
    force = table.force_world_N[rows]
    across = np.hypot(dot(force, axes.normal), dot(force, axes.lateral))[:, None]
    turned = -np.einsum("pi,pis->ps", axes.along, shared.force_N[rows]) / np.where(across > 0, across, np.nan)
    # the last common error is the prior's, which was taken out: to first order, so that half of that is in doubt
    doubt = np.stack([np.zeros(len(rows)), 0.5 * (angle - found.longitudinal_rad)], axis=1)
    modes = np.hstack([turned[:, :-1] * widened[:, None], doubt])
    own = np.sqrt(np.maximum(whole**2 - np.sum(modes[:, :-1] ** 2, axis=1), (LEAST_OWN * whole) ** 2))
    return np.where(told, angle, np.nan), own, np.where(told[:, None], modes, 0.0)


def _slip(track: Track, rows: np.ndarray, axes: Axes) -> tuple[np.ndarray, np.ndarray]:
    """Unit slip (P, 2), lateral and longitudinal, and the deviation (P,) of its direction; NaN where it has none."""
    velocity, std = track.slip_velocity_m_s[rows], track.slip_std_m_s[rows]
    parts = np.stack([dot(velocity, axes.lateral), dot(velocity, axes.along)], axis=1)
    speed = np.linalg.norm(parts, axis=1)
    with np.errstate(invalid="ignore"):
        directed = speed > SLIPS * std
    speed = np.where(directed, speed, np.nan)
    return parts / speed[:, None], std / speed
