"""Touches as friction sees them: out of the table, the surface's normals, the slip, and the errors in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.distance import cdist

from estimator.table.contacts import ContactTable

from .coefficient import SLIDING, STICKING, UNUSED, Angles, FrictionTouches

if TYPE_CHECKING:
    from estimator.contact.common_errors import CommonErrors
    from estimator.object.surface import Surface
    from estimator.object.track.onset import Track


_LEAST_STD_RAD = 1e-4  # no direction is known better: rigs said to be exact would else be believed without limit
_LEAST_OWN = 0.2  # so much of a deviation at least is taken for the frame's own
# Touches within so much of the patch's extent of each are looked at: where it stuck there may be many in one place.
# They must spread across the antenna by so much of what they spread along it, and by so many of the deviations that
# they usually have: a shape that was only felt along the antenna has no slope across it, and small errors of the points
# along it pass for one.
_NEAR, _SHARE, _NOISE = 0.3, 0.2, 4.0
NORMAL_KNOWN_RAD = 0.12  # a touch whose normal the shape does not tell to this tells nothing of friction across it
_FORCE_KNOWN_RAD = 0.25  # nor does one whose force is not known to this
_SLIPS = 2.0  # a slip speed of so many deviations has a direction
# so much of a friction angle's deviation at least is the frame's own: the difference of two that are nearly alike, the
# whole and the common one, would be anything
_LEAST_OWN_SHARE = 0.7
# A touch slides for certain if so many frames before and after it, as far as they lie within this time, and the next
# ones in any case, slide the same way (cosine between their slips): the slip is taken from several frames at a time, so
# that it begins early and ends late, and turns slowly where it turned at once.
_NEIGHBOURS, _NEAR_S, _SAME_WAY = 2, 0.07, 0.5
# A friction angle is seen where its deviation falls to so much of the one before the frame was seen. Above that the
# prior, which is taken out again, would be most of what is left.
_SEEN = 0.5


@dataclass(frozen=True, eq=False)
class Axes:
    """At P touches, world frame: (P, 3) each, orthonormal; NaN where the antenna's tangent is not known.

    `normal` is the shape's, `along` the antenna's tangent, `lateral` = normal × along. A smooth wire lies flat on what
    it touches: on its side the normal is taken less its part along the antenna, at its tip the tangent less its part
    along the normal.
    """

    normal: np.ndarray
    along: np.ndarray
    lateral: np.ndarray

    @staticmethod
    def of(normal: np.ndarray, tangent: np.ndarray, at_tip: np.ndarray) -> Axes:
        """From unit vectors (P, 3), and where (P,) the tip touches."""
        lateral = _unit(np.cross(normal, tangent))
        flat = _unit(np.cross(tangent, lateral))
        return Axes(
            np.where(at_tip[:, None], normal, flat),
            np.where(at_tip[:, None], np.cross(lateral, normal), tangent),
            lateral,
        )

    def lateral_variance(self, covariance: np.ndarray) -> np.ndarray:
        """(P,) of vectors with these covariances (P, 3, 3)."""
        return np.einsum("pi,pij,pj->p", self.lateral, covariance, self.lateral)


def _unit(vectors: np.ndarray) -> np.ndarray:
    """(..., 3) of length 1; NaN in place of nothing."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 1e-9, length, np.nan)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(P,) of vectors (P, 3)."""
    return np.sum(a * b, axis=1)


def _force_directions(table: ContactTable, shared: CommonErrors, rows: np.ndarray, axes: Axes) -> Angles:
    """Of the forces in these rows (P,), from the normal about the antenna, positive along `Axes.lateral`."""
    force = table.force_world_N[rows]
    across = np.hypot(_dot(force, axes.normal), _dot(force, axes.lateral))
    across, whole = np.where(across > 0.0, across, np.nan), _roll_std_rad(table)[rows]
    angle = np.arctan2(_dot(force, axes.lateral), _dot(force, axes.normal))
    if shared.known:
        modes = np.einsum("pi,pis->ps", axes.lateral, shared.force_N[rows]) / across[:, None]
        own = np.sqrt(np.maximum(whole**2 - np.sum(modes**2, axis=1), (_LEAST_OWN * whole) ** 2))
    else:  # how much is common is not known: it counts as both, as a turn of all forces and as a stretch
        stretch = np.hypot(table.force_y_std_N, table.force_z_std_N)[rows] / across
        own, modes = whole, np.stack([whole, 0.5 * np.sin(2.0 * angle) * stretch], axis=1)
    return Angles(angle, np.maximum(own, _LEAST_STD_RAD), modes)


def _roll_std_rad(table: ContactTable) -> np.ndarray:
    """(B,) of the paper's ψ, as if the force's two components erred independently."""
    y, z = table.force_y_N, table.force_z_N
    square = y**2 + z**2
    return np.hypot(z * table.force_y_std_N, y * table.force_z_std_N) / np.where(square > 0.0, square, np.nan)


def _spread_across(point_m: np.ndarray, own_m2: np.ndarray, axes: Axes, patch: np.ndarray) -> np.ndarray:
    """(P,) bool, of points (P, 3) with own covariances (P, 3, 3) on patches (P,); False where these are not known."""
    same = patch[:, None] == patch
    apart = np.where(same, cdist(point_m, point_m), 0.0)
    extent = np.array([apart[patch == label].max() for label in patch])
    near = same & (apart <= _NEAR * extent[:, None])
    offset = point_m - point_m[:, None]
    across, along = (_spread(np.einsum("pni,pi->pn", offset, axis), near) for axis in (axes.lateral, axes.along))
    noise = np.sqrt(np.maximum(axes.lateral_variance(own_m2), 0.0))
    usual = np.array([np.median(noise[each]) for each in near])
    return (across > _SHARE * along) & (across > _NOISE * usual)


def _spread(values: np.ndarray, counted: np.ndarray) -> np.ndarray:
    """(P,) standard deviations of the counted ones of (P, N)."""
    number = counted.sum(axis=1)
    mean = np.where(counted, values, 0.0).sum(axis=1) / number
    return np.sqrt(np.where(counted, (values - mean[:, None]) ** 2, 0.0).sum(axis=1) / number)


def friction_touches(
    table: ContactTable, surface: Surface, track: Track, shared: CommonErrors, friction_rad: float
) -> tuple[FrictionTouches, Axes, Angles]:
    """The touches of a surface, with the axes and the forces' lateral directions behind them; see `friction`."""
    rows = surface.touched_row
    axes = Axes.of(surface.touched_normal, table.tangent_world[rows], table.status[rows] == "tip_contact")
    found = _force_directions(table, shared, rows, axes)
    turned = axes.lateral_variance(surface.touched_normal_covariance)
    common = np.einsum("pi,pik->pk", axes.lateral, surface.touched_normal_modes)
    normal_std = np.sqrt(np.maximum(turned - np.sum(common**2, axis=1), 0.0))
    seen = _friction_angles(table, shared, rows, axes, friction_rad)
    slip, slip_std = _slip(track, rows, axes)
    sound = ~surface.outlier & ~track.ringing[rows] & np.isfinite(found.angle_rad)
    side_by_side = _spread_across(table.point_world_m[rows], shared.own_m2[rows], axes, surface.touched_patch)
    known = np.sqrt(np.maximum(turned, 0.0)) < NORMAL_KNOWN_RAD
    across = sound & side_by_side & known & (found.whole_std_rad < _FORCE_KNOWN_RAD)
    along = sound & np.isfinite(seen.angle_rad) & np.isfinite(seen.std_rad)
    slides = _sliding_steadily(track, table.time_s)[rows] & np.isfinite(slip_std)
    # common errors of the forces, of the friction angle's prior, of the normals
    lateral_modes = np.hstack([found.modes_rad, np.zeros((len(rows), 1)), common])
    longitudinal_modes = np.hstack([seen.modes_rad, np.zeros_like(common)])
    normal_modes = np.hstack([0.0 * seen.modes_rad, common])
    rubs = FrictionTouches(
        used_as=np.where(across | along, np.where(slides, SLIDING, STICKING), UNUSED),
        slides=slides,
        spread_across=side_by_side,
        lateral=Angles(
            np.where(across, found.angle_rad, np.nan),
            np.hypot(found.std_rad, normal_std),
            np.where(across[:, None], lateral_modes, 0.0),
        ),
        normal_std_rad=normal_std,
        normal_modes_rad=np.where(across[:, None], normal_modes, 0.0),
        longitudinal=Angles(
            np.where(along, seen.angle_rad, np.nan), seen.std_rad, np.where(along[:, None], longitudinal_modes, 0.0)
        ),
        slip=slip,
        slip_std_rad=slip_std,
    )
    return rubs, axes, found


def _sliding_steadily(track: Track, time_s: np.ndarray) -> np.ndarray:
    """(B,) bool: frames, at times (B,), in the midst of sliding one way."""
    sliding, way = track.phase == "sliding", np.nan_to_num(_unit(track.slip_velocity_m_s))
    result = sliding.copy()
    for step in range(-_NEIGHBOURS, _NEIGHBOURS + 1):
        at = np.arange(len(sliding)) + step
        there = np.clip(at, 0, len(sliding) - 1)
        alike = (at == there) & sliding[there] & (_dot(way, way[there]) > _SAME_WAY)
        result &= alike | ((abs(step) > 1) & (np.abs(time_s[there] - time_s) > _NEAR_S))
    return result


def _friction_angles(
    table: ContactTable, shared: CommonErrors, rows: np.ndarray, axes: Axes, friction_rad: float
) -> Angles:
    """The friction angles as the data alone say them, the estimate's prior taken out again, with S + 1 common errors.

    NaN where the prior is all there was, and at the tip, where the antenna's normal is not the object's.
    """
    estimated, std = table.friction_angle_rad[rows], table.friction_angle_std_rad[rows]
    before = max(friction_rad, float(np.nanmax(std, initial=1e-12)))
    seen = (std > 0.0) & (std < _SEEN * before) & (table.status[rows] != "tip_contact")
    widened = 1.0 / (1.0 - np.where(seen, std / before, 0.0) ** 2)
    angle, whole = estimated * widened, std * np.sqrt(widened)
    if not shared.known:
        return Angles(np.where(seen, angle, np.nan), whole, np.nan_to_num(whole)[:, None] * [0.0, 0.0, 1.0])
    force = table.force_world_N[rows]
    across = np.hypot(_dot(force, axes.normal), _dot(force, axes.lateral))[:, None]
    turned = -np.einsum("pi,pis->ps", axes.along, shared.force_N[rows]) / np.where(across > 0, across, np.nan)
    # the last common error is the prior's, which was taken out: to first order, so that half of that is in doubt
    doubt = np.stack([np.zeros(len(rows)), 0.5 * (angle - estimated)], axis=1)
    modes = np.hstack([turned[:, :-1] * widened[:, None], doubt])
    own = np.sqrt(np.maximum(whole**2 - np.sum(modes[:, :-1] ** 2, axis=1), (_LEAST_OWN_SHARE * whole) ** 2))
    return Angles(np.where(seen, angle, np.nan), own, np.where(seen[:, None], modes, 0.0))


def _slip(track: Track, rows: np.ndarray, axes: Axes) -> tuple[np.ndarray, np.ndarray]:
    """Unit slip (P, 2), lateral and longitudinal, and the deviation (P,) of its direction; NaN where it has none."""
    velocity, std = track.slip_velocity_m_s[rows], track.slip_std_m_s[rows]
    parts = np.stack([_dot(velocity, axes.lateral), _dot(velocity, axes.along)], axis=1)
    speed = np.linalg.norm(parts, axis=1)
    with np.errstate(invalid="ignore"):
        directed = speed > _SLIPS * std
    speed = np.where(directed, speed, np.nan)
    return parts / speed[:, None], std / speed
