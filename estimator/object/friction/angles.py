"""Touches as friction sees them: out of the table, the surface's normals, the slip, and the errors in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.distance import cdist

from estimator.contact.common_errors import CommonErrors
from estimator.table.contacts import ContactTable
from estimator.table.joint_angles import joint_angles
from vbaa_calib.geometry import Kinematics

from .evidence import SLIDING, STICKING, UNUSED, FrictionTouches

if TYPE_CHECKING:
    from estimator.contact.common_errors import CommonErrors
    from estimator.object.surface import Surface
    from estimator.object.track.result import Track


_LEAST_STD_RAD = 1e-4
"""No direction is known better than that: rigs that are said to be exact would else be believed without limit."""
_LEAST_OWN = 0.2
"""So much of a deviation at least is taken for the frame's own."""


@dataclass(frozen=True, eq=False)
class Axes:
    """At P touches, world frame: (P, 3) each, orthonormal; NaN where the antenna's tangent is not known.

    `normal` is the shape's; where the antenna's side touches, less its part along the antenna, since a smooth wire lies
    flat on whatever it touches. `along` is the antenna's tangent, at its tip less its part along the normal.
    `lateral` = normal × along.
    """

    normal: np.ndarray
    along: np.ndarray
    lateral: np.ndarray

    @staticmethod
    def of(normal: np.ndarray, tangent: np.ndarray, at_tip: np.ndarray) -> Axes:
        """From unit vectors (P, 3), and where (P,) the tip touches."""
        lateral = unit(np.cross(normal, tangent))
        flat = unit(np.cross(tangent, lateral))
        return Axes(
            np.where(at_tip[:, None], normal, flat),
            np.where(at_tip[:, None], np.cross(lateral, normal), tangent),
            lateral,
        )


@dataclass(frozen=True, eq=False)
class Directions:
    """Directions of P forces. Angles in rad; NaN where unknown.

    Attributes
    ----------
    lateral_rad : (P,) of the force from the normal about the antenna, positive along `Axes.lateral`.
    lateral_std_rad, lateral_modes_rad : (P,), (P, S) the force's own and common errors in it.
    longitudinal_rad, longitudinal_std_rad : (P,) the friction angle as estimated, see `ContactTable`; in all.
    """

    lateral_rad: np.ndarray
    lateral_std_rad: np.ndarray
    lateral_modes_rad: np.ndarray
    longitudinal_rad: np.ndarray
    longitudinal_std_rad: np.ndarray


def unit(vectors: np.ndarray) -> np.ndarray:
    """(..., 3) of length 1; NaN in place of nothing."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 1e-9, length, np.nan)


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(P,) of vectors (P, 3)."""
    return np.sum(a * b, axis=1)


def _force_directions(table: ContactTable, shared: CommonErrors, rows: np.ndarray, axes: Axes) -> Directions:
    """Of the forces in these rows (P,) of the table: what is not common in their deviations is each one's own."""
    force = table.force_world_N[rows]
    across = np.hypot(dot(force, axes.normal), dot(force, axes.lateral))
    across, whole = np.where(across > 0.0, across, np.nan), roll_std_rad(table)[rows]
    angle = np.arctan2(dot(force, axes.lateral), dot(force, axes.normal))
    if shared.point_m.shape[2]:
        modes = np.einsum("pi,pis->ps", axes.lateral, shared.force_N[rows]) / across[:, None]
        own = np.sqrt(np.maximum(whole**2 - np.sum(modes**2, axis=1), (_LEAST_OWN * whole) ** 2))
    else:  # how much is common is not known: it counts as both, as a turn of all forces and as a stretch
        stretch = np.hypot(table.force_y_std_N, table.force_z_std_N)[rows] / across
        own, modes = whole, np.stack([whole, 0.5 * np.sin(2.0 * angle) * stretch], axis=1)
    return Directions(
        angle,
        np.maximum(own, _LEAST_STD_RAD),
        modes,
        table.friction_angle_rad[rows],
        table.friction_angle_std_rad[rows],
    )


def roll_rad(table: ContactTable) -> np.ndarray:
    """(B,) the paper's ψ: direction of the force in the antenna's yz plane, from y towards z (Fig. 5)."""
    return np.arctan2(table.force_z_N, table.force_y_N)


def roll_std_rad(table: ContactTable) -> np.ndarray:
    """(B,) its standard deviation in all, as if the two components erred independently."""
    y, z = table.force_y_N, table.force_z_N
    square = y**2 + z**2
    return np.hypot(z * table.force_y_std_N, y * table.force_z_std_N) / np.where(square > 0.0, square, np.nan)


def roll_of(kinematics: Kinematics, table: ContactTable, rows: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """(P,) direction of world vectors (P, 3) in the antenna's yz plane, as `roll_rad`; the paper's ν for normals."""
    pan, tilt = joint_angles(kinematics, table)
    rotation, _ = kinematics.world_antenna(pan[rows], tilt[rows])
    local = np.einsum("pji,pj->pi", rotation, vectors)
    return np.arctan2(local[:, 2], local[:, 1])


_NEAR = 0.3
"""Touches within so much of the patch's extent of each are looked at: where it stuck there may be many in one place."""
_SHARE = 0.2
"""They must spread across the antenna by so much of what they spread along it: a shape that was only felt along the
antenna has no slope across it, and small errors of the points along it pass for one."""
_NOISE = 4.0
"""And by so many of the deviations that they usually have."""


def spread_across(point_m: np.ndarray, own_m2: np.ndarray, axes: Axes, patch: np.ndarray) -> np.ndarray:
    """(P,) bool, of points (P, 3) with own covariances (P, 3, 3) on patches (P,); False where these are not known."""
    same = patch[:, None] == patch
    apart = np.where(same, cdist(point_m, point_m), 0.0)
    extent = np.array([apart[patch == label].max() for label in patch])
    near = same & (apart <= _NEAR * extent[:, None])
    offset = point_m - point_m[:, None]
    across, along = (_spread(np.einsum("pni,pi->pn", offset, axis), near) for axis in (axes.lateral, axes.along))
    noise = np.sqrt(np.maximum(np.einsum("pi,pij,pj->p", axes.lateral, own_m2, axes.lateral), 0.0))
    usual = np.array([np.median(noise[each]) for each in near])
    return (across > _SHARE * along) & (across > _NOISE * usual)


def _spread(values: np.ndarray, counted: np.ndarray) -> np.ndarray:
    """(P,) standard deviations of the counted ones of (P, N)."""
    number = counted.sum(axis=1)
    mean = np.where(counted, values, 0.0).sum(axis=1) / number
    return np.sqrt(np.where(counted, (values - mean[:, None]) ** 2, 0.0).sum(axis=1) / number)


NORMAL_KNOWN_RAD = 0.12
"""A touch whose normal the shape does not tell to this tells nothing of friction across the antenna."""
_FORCE_KNOWN_RAD = 0.25
"""Nor does one whose force is not known to this."""
_SLIPS = 2.0
"""A slip speed of so many deviations has a direction."""
_LEAST_OWN_TOUCHES = 0.7
"""So much of a friction angle's deviation at least is the frame's own: the difference of two that are nearly alike, the
whole and the common one, would be anything."""
_NEIGHBOURS, _NEAR_S = 2, 0.07
"""A touch slides for certain if so many frames before and after it, as far as they lie within this time, and the next
ones in any case, slide the same way: the slip is taken from several frames at a time, so that it begins early and ends
late, and turns slowly where it turned at once."""
_SAME_WAY = 0.5
"""Cosine between the slips of such neighbours."""
_SEEN = 0.5
"""A friction angle is seen where its deviation falls to so much of the one before the frame was seen. Above that the
prior, which is taken out again, would be most of what is left."""


def friction_touches(
    table: ContactTable, surface: Surface, track: Track, shared: CommonErrors, friction_rad: float
) -> tuple[FrictionTouches, Axes, Directions]:
    """The touches of a surface, with the axes and the forces' directions behind them.

    Parameters
    ----------
    friction_rad : standard deviation of the friction angle that the contacts were estimated with.
    """
    rows = surface.touched_row
    axes = Axes.of(surface.touched_normal, table.tangent_world[rows], table.status[rows] == "tip_contact")
    found = _force_directions(table, shared, rows, axes)
    turned = np.einsum("pi,pij,pj->p", axes.lateral, surface.touched_normal_covariance, axes.lateral)
    common = np.einsum("pi,pik->pk", axes.lateral, surface.touched_normal_modes)
    normal_std = np.sqrt(np.maximum(turned - np.sum(common**2, axis=1), 0.0))
    seen, seen_std, seen_modes = _friction_angles(table, shared, rows, axes, found, friction_rad)
    none = np.zeros_like(common)
    lateral_modes = np.hstack([found.lateral_modes_rad, np.zeros((len(rows), 1)), common])
    slip, slip_std = _slip(track, rows, axes)
    force_std = np.hypot(found.lateral_std_rad, np.linalg.norm(found.lateral_modes_rad, axis=1))
    sound = ~surface.outlier & ~track.ringing[rows] & np.isfinite(found.lateral_rad)
    side_by_side = spread_across(table.point_world_m[rows], shared.own_m2[rows], axes, surface.touched_patch)
    told = np.sqrt(np.maximum(turned, 0.0)) < NORMAL_KNOWN_RAD
    across = sound & side_by_side & told & (force_std < _FORCE_KNOWN_RAD)
    along = sound & np.isfinite(seen) & np.isfinite(seen_std)
    slides = sliding_steadily(track, table.time_s)[rows] & np.isfinite(slip_std)
    rubs = FrictionTouches(
        used_as=np.where(across | along, np.where(slides, SLIDING, STICKING), UNUSED),
        slides=slides,
        spread_across=side_by_side,
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


def sliding_steadily(track: Track, time_s: np.ndarray) -> np.ndarray:
    """(B,) bool: frames, at times (B,), in the midst of sliding one way."""
    sliding, way = track.phase == "sliding", np.nan_to_num(unit(track.slip_velocity_m_s))
    result = sliding.copy()
    for step in range(-_NEIGHBOURS, _NEIGHBOURS + 1):
        at = np.arange(len(sliding)) + step
        there = np.clip(at, 0, len(sliding) - 1)
        alike = (at == there) & sliding[there] & (dot(way, way[there]) > _SAME_WAY)
        result &= alike | ((abs(step) > 1) & (np.abs(time_s[there] - time_s) > _NEAR_S))
    return result


def _friction_angles(
    table: ContactTable, shared: CommonErrors, rows: np.ndarray, axes: Axes, found: Directions, friction_rad: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Friction angles (P,) as the data alone say them, own deviations (P,) and common errors (P, S + 1).

    The estimate's prior is taken out again. NaN where it is all there was, and at the tip, where friction along the
    antenna leans the force from the antenna's normal, not from the object's.
    """
    std, size = found.longitudinal_std_rad, shared.point_m.shape[2]
    before = max(friction_rad, float(np.nanmax(std, initial=1e-12)))
    told = (std > 0.0) & (std < _SEEN * before) & (table.status[rows] != "tip_contact")
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
    own = np.sqrt(np.maximum(whole**2 - np.sum(modes[:, :-1] ** 2, axis=1), (_LEAST_OWN_TOUCHES * whole) ** 2))
    return np.where(told, angle, np.nan), own, np.where(told[:, None], modes, 0.0)


def _slip(track: Track, rows: np.ndarray, axes: Axes) -> tuple[np.ndarray, np.ndarray]:
    """Unit slip (P, 2), lateral and longitudinal, and the deviation (P,) of its direction; NaN where it has none."""
    velocity, std = track.slip_velocity_m_s[rows], track.slip_std_m_s[rows]
    parts = np.stack([dot(velocity, axes.lateral), dot(velocity, axes.along)], axis=1)
    speed = np.linalg.norm(parts, axis=1)
    with np.errstate(invalid="ignore"):
        directed = speed > _SLIPS * std
    speed = np.where(directed, speed, np.nan)
    return parts / speed[:, None], std / speed
