"""Friction of an object from contacts, surface normals and slip, with the errors in common (Fig. 5); and normals
corrected by the force."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.distance import cdist

from estimator.object.friction.coefficient import FrictionSettings
from estimator.object.surface import Normals
from estimator.table.contacts import ContactTable, joint_angles
from vbaa_calib.core.robust import finite_or_none

from .coefficient import Angles, Coefficient, FrictionAngles, FrictionTouches, coefficient, judge

if TYPE_CHECKING:
    from estimator.contact.common_errors import CommonErrors
    from estimator.object.surface import Surface
    from estimator.object.track.onset import Track
    from vbaa_calib.rig import Rig


@dataclass(frozen=True, eq=False)
class Friction:
    """What P touches say of the friction between antenna and object, one μ for both sticking and sliding.

    Attributes
    ----------
    mu, std : coefficient of friction and its standard deviation; NaN unless `determined`.
    interval : (2,) of 95 %, common errors included; of an undetermined μ its one-sided bounds, 0 and inf without any.
    cone_half_angle_rad : the paper's α = atan μ; NaN unless `determined`.
    determined : whether the data determine μ. reason : in words, what it rests on, or why it is not determined.
    used_as : (P,) "sliding": friction is μ times the normal force, against the slip; "sticking": at most that, which
        holds where the motion is undecided, too; "unused". row : (P,) of the table.
    lateral_rad, lateral_std_rad : (P,) force from the shape's normal about the antenna, towards normal × tangent.
    psi_rad, nu_rad : (P,) directions of force and shape's normal in the antenna's yz plane (Fig. 5); ν needs the rig.
    normals : of shape, tangents and force together.
    """

    mu: float
    std: float
    interval: np.ndarray
    cone_half_angle_rad: float
    determined: bool
    reason: str
    used_as: np.ndarray
    row: np.ndarray
    lateral_rad: np.ndarray
    lateral_std_rad: np.ndarray
    psi_rad: np.ndarray
    nu_rad: np.ndarray
    normals: Normals

    def to_dict(self) -> dict[str, Any]:
        """The coefficient as plain data."""
        return {
            "told": self.determined,
            "mu": finite_or_none(self.mu),
            "std": finite_or_none(self.std),
            "interval": [finite_or_none(end) for end in self.interval],
            "reason": self.reason,
        }


def friction(
    table: ContactTable,
    surface: Surface,
    track: Track,
    shared: CommonErrors,
    friction_rad: float,
    rig: Rig | None = None,
) -> Friction:
    """One μ for the object; forces against normals; normals by the force.

    Surface and track are of the same table. `shared` is what the frames' errors have in common, `CommonErrors.none`
    without a rig, which counts every error as common and as the frame's own; `friction_rad` the standard deviation of
    the friction angle that the contacts were estimated with. The rig is for ν.
    """
    rubs, axes, found = _friction_touches(table, surface, track, shared, friction_rad)
    rubs, mu = _fitted(rubs)
    determined, reason, interval = judge(rubs, mu)
    rows, normal = surface.touched_row, surface.touched_normal
    # where the shape does not determine the turn about the antenna
    unknown = np.where(rubs.spread_across[:, None], 0.0, np.nan_to_num(axes.lateral))
    covariance = surface.touched_normal_covariance + unknown[:, :, None] * unknown[:, None, :]
    turned = axes.lateral_variance(covariance)
    lateral_std = np.sqrt(found.std_rad**2 + np.sum(found.modes_rad**2, axis=1) + turned)
    informative = interval[0] > 0.0 or np.isfinite(interval[1])
    nu = np.full(len(rows), np.nan)
    if rig is not None:
        rotation, _ = rig.kinematics.world_antenna(*(angle[rows] for angle in joint_angles(rig.kinematics, table)))
        local = np.einsum("pji,pj->pi", rotation, normal)
        nu = np.arctan2(local[:, 2], local[:, 1])
    best, std = (mu.mu, mu.std) if mu is not None and determined else (np.nan, np.nan)
    return Friction(
        mu=best,
        std=std,
        interval=interval,
        cone_half_angle_rad=float(np.arctan(best)),
        determined=determined,
        reason=reason,
        used_as=rubs.used_as,
        row=rows,
        lateral_rad=found.angle_rad,
        lateral_std_rad=lateral_std,
        psi_rad=np.arctan2(table.force_z_N, table.force_y_N)[rows],
        nu_rad=nu,
        normals=_update_normals(
            Normals(normal, covariance), axes, rubs, found, mu if informative else None, interval[1]
        ),
    )


def _fitted(rubs: FrictionTouches) -> tuple[FrictionTouches, Coefficient | None]:
    """The touches as they took part in the fit, and their coefficient, None where none can be used. A contact that
    slides to and fro faster than the slip is averaged lies inside the cone: it then counts as not surely sliding."""
    for _ in range(FrictionSettings.relabelled):
        evidence = FrictionAngles.of(rubs)
        if not len(evidence.touch):
            return rubs, None
        mu = coefficient(evidence)
        best = int(np.argmin(mu.fits.cost))
        expected, off = evidence.expected(mu.fits.mu[best : best + 1])[0], mu.fits.off[best]
        inside = (
            evidence.slides & evidence.lateral & (np.abs(off) > FrictionSettings.wrong_std) & (off * expected < 0.0)
        )
        if not inside.any():
            break
        which = evidence.touch[inside]
        used, slides = rubs.used_as.copy(), rubs.slides.copy()
        used[which], slides[which] = "sticking", False
        rubs = replace(rubs, used_as=used, slides=slides)
    return rubs, mu


def _update_normals(
    normals: Normals,
    axes: _Axes,
    rubs: FrictionTouches,
    found: Angles,
    mu: Coefficient | None,
    largest_mu: float,
) -> Normals:
    """The shape's normals, turned about the antenna as the forces require: of sliding touches by the fit of μ, of
    others, and where no μ fits, within the cone of `largest_mu`, inf where nothing is known of it."""
    lateral = axes.lateral
    before = np.maximum(axes.lateral_variance(normals.covariance), 0.0)
    angle, variance, fitted = np.zeros(len(rubs)), before, np.zeros(len(rubs), bool)
    if mu is not None:
        angle, variance, off = _by_fit(before, rubs, mu)
        fitted = rubs.slides & rubs.across & (off == 0.0)
        variance = variance + off**2
    aim, doubt = _by_force(rubs, found, mu, largest_mu, fitted)
    share = variance / (variance + doubt)  # nothing is said by an infinite doubt
    angle = angle + share * (np.where(np.isfinite(doubt), aim, 0.0) - angle)
    variance = variance * (1.0 - share)
    sound = np.isfinite(angle) & np.isfinite(variance) & (before > 0)
    angle = np.where(sound, angle, 0.0)
    base = np.where(sound[:, None], np.nan_to_num(axes.normal), normals.normal)
    beside = np.where(sound[:, None], np.nan_to_num(lateral), 0.0)
    stretched = np.sqrt(np.where(sound, variance, 1.0) / np.where(sound, before, 1.0)) - 1.0
    stretch = np.eye(3) + stretched[:, None, None] * beside[:, :, None] * beside[:, None, :]
    turned = np.cos(angle)[:, None] * base + np.sin(angle)[:, None] * beside
    return Normals(turned, stretch @ normals.covariance @ np.swapaxes(stretch, 1, 2))


def _by_force(
    rubs: FrictionTouches, found: Angles, mu: Coefficient | None, largest_mu: float, fitted: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Turns (P,) and variances (P,) where the force alone sees the normal: on the cone's rim in touches that slide, if
    μ is known, in others anywhere in it, taken as Gaussian; nothing where the fit has had its say."""
    whole = found.std_rad**2 + np.sum(found.modes_rad**2, axis=1)
    cone = np.arctan(largest_mu if np.isfinite(largest_mu) else FrictionSettings.unknown_mu) ** 2 / 3.0
    angle, variance = found.angle_rad, cone + whole
    if mu is not None and np.isfinite(largest_mu):
        rim = rubs.slides & ~rubs.across
        lean = np.arctan(mu.mu * np.nan_to_num(rubs.slip[:, 0]))
        unsure = mu.std**2 + (mu.mu * np.nan_to_num(rubs.slip[:, 1] * rubs.slip_std_rad)) ** 2
        angle, variance = np.where(rim, angle + lean, angle), np.where(rim, whole + unsure, variance)
    return angle, np.where(fitted, np.inf, variance)


def _by_fit(before: np.ndarray, rubs: FrictionTouches, mu: Coefficient) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Turns (P,) and variances (P,) that the fit found of the touches that took part, over the values that μ may have:
    their common errors and each one's own. And by how much (P,) touches lie off, 0 where that is as it should be."""
    modes = rubs.normal_modes_rad @ mu.axes.T
    beyond = np.sum(rubs.normal_modes_rad**2, axis=1) - np.sum(modes**2, axis=1)
    evidence = FrictionAngles.of(rubs)
    side, touch = evidence.lateral, evidence.touch[evidence.lateral]
    total, square, off = np.zeros((3, len(rubs)))
    own, found = rubs.normal_std_rad[touch] ** 2, mu.fits
    spreads = max(mu.scatter, 1.0) * evidence.spread(found.mu)[:, side]
    for index in np.flatnonzero(mu.weight > 1e-6):
        weight, spread, error = mu.weight[index], spreads[index], found.off[index, side]
        held = evidence.slides[side] & (np.abs(error) < FrictionSettings.wrong_std)
        share = np.where(held, own / spread**2, 0.0)
        turn = modes @ found.modes[index]
        left = np.einsum("pk,kl,pl->p", modes, found.covariance[index], modes, optimize=True) + beyond
        turn[touch] += share * error * spread
        left += rubs.normal_std_rad**2
        left[touch] -= share * own
        total += weight * turn
        square += weight * (left + turn**2)
        off[touch] += weight * np.where(np.abs(error) < FrictionSettings.wrong_std, 0.0, error * spread)
    used = rubs.across
    return np.where(used, total, 0.0), np.where(used, np.maximum(square - total**2, 1e-12), before), off


@dataclass(frozen=True, eq=False)
class _Axes:
    """At P touches, world frame, orthonormal; NaN where the antenna's tangent is not known.

    A smooth wire lies flat on what it touches: on its side the normal is taken less its part along the antenna, at its
    tip the tangent less its part along the normal.
    """

    normal: np.ndarray  # (P, 3) the shape's
    along: np.ndarray  # (P, 3) the antenna's tangent
    lateral: np.ndarray  # (P, 3) normal × along

    @staticmethod
    def of(normal: np.ndarray, tangent: np.ndarray, at_tip: np.ndarray) -> _Axes:
        """From unit vectors (P, 3), and where (P,) the tip touches."""
        lateral = _unit(np.cross(normal, tangent))
        flat = _unit(np.cross(tangent, lateral))
        return _Axes(
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


def _force_directions(table: ContactTable, shared: CommonErrors, rows: np.ndarray, axes: _Axes) -> Angles:
    """Of the forces in these rows (P,), from the normal about the antenna, positive along `_Axes.lateral`."""
    force = table.force_world_N[rows]
    across = np.hypot(_dot(force, axes.normal), _dot(force, axes.lateral))
    y, z, across = table.force_y_N, table.force_z_N, np.where(across > 0.0, across, np.nan)
    square = y**2 + z**2
    # of the paper's ψ, as if the force's two components erred independently
    whole = np.hypot(z * table.force_y_std_N, y * table.force_z_std_N) / np.where(square > 0.0, square, np.nan)
    whole = whole[rows]
    angle = np.arctan2(_dot(force, axes.lateral), _dot(force, axes.normal))
    if shared.known:
        modes = np.einsum("pi,pis->ps", axes.lateral, shared.force_N[rows]) / across[:, None]
        own = np.sqrt(np.maximum(whole**2 - np.sum(modes**2, axis=1), (FrictionSettings.least_own * whole) ** 2))
    else:  # how much is common is not known: it counts as both, as a turn of all forces and as a stretch
        stretch = np.hypot(table.force_y_std_N, table.force_z_std_N)[rows] / across
        own, modes = whole, np.stack([whole, 0.5 * np.sin(2.0 * angle) * stretch], axis=1)
    return Angles(angle, np.maximum(own, FrictionSettings.least_std_rad), modes)


def _spread_across(point_m: np.ndarray, own_m2: np.ndarray, axes: _Axes, patch: np.ndarray) -> np.ndarray:
    """(P,) bool, of points (P, 3) with own covariances (P, 3, 3) on patches (P,); False where these are not known."""
    same = patch[:, None] == patch
    apart = np.where(same, cdist(point_m, point_m), 0.0)
    extent = np.array([apart[patch == label].max() for label in patch])
    near = same & (apart <= FrictionSettings.near_share * extent[:, None])
    offset = point_m - point_m[:, None]
    sides, number = np.einsum("pni,api->apn", offset, np.stack([axes.lateral, axes.along])), near.sum(axis=1)
    mean = np.where(near, sides, 0.0).sum(axis=2) / number
    across, along = np.sqrt(np.where(near, (sides - mean[..., None]) ** 2, 0.0).sum(axis=2) / number)
    noise = np.sqrt(np.maximum(axes.lateral_variance(own_m2), 0.0))
    usual = np.array([np.median(noise[each]) for each in near])
    return (across > FrictionSettings.across_share * along) & (across > FrictionSettings.across_std * usual)


def _friction_touches(
    table: ContactTable, surface: Surface, track: Track, shared: CommonErrors, friction_rad: float
) -> tuple[FrictionTouches, _Axes, Angles]:
    """The touches of a surface, with the axes and the forces' lateral directions behind them; see `friction`."""
    rows = surface.touched_row
    axes = _Axes.of(surface.touched_normal, table.tangent_world[rows], table.status[rows] == "tip_contact")
    found = _force_directions(table, shared, rows, axes)
    turned = axes.lateral_variance(surface.touched_normal_covariance)
    common = np.einsum("pi,pik->pk", axes.lateral, surface.touched_normal_modes)
    normal_std = np.sqrt(np.maximum(turned - np.sum(common**2, axis=1), 0.0))
    seen = _friction_angles(table, shared, rows, axes, friction_rad)
    velocity, speed_std = track.slip_velocity_m_s[rows], track.slip_std_m_s[rows]
    slip = np.stack([_dot(velocity, axes.lateral), _dot(velocity, axes.along)], axis=1)
    speed = np.linalg.norm(slip, axis=1)
    with np.errstate(invalid="ignore"):
        speed = np.where(speed > FrictionSettings.slip_std * speed_std, speed, np.nan)  # slower, it has no direction
    slip, slip_std = slip / speed[:, None], speed_std / speed
    sound = ~surface.outlier & ~track.ringing[rows] & np.isfinite(found.angle_rad)
    side_by_side = _spread_across(table.point_world_m[rows], shared.own_m2[rows], axes, surface.touched_patch)
    known = np.sqrt(np.maximum(turned, 0.0)) < FrictionSettings.normal_known_rad
    across = sound & side_by_side & known & (found.whole_std_rad < FrictionSettings.force_known_rad)
    along = sound & np.isfinite(seen.angle_rad) & np.isfinite(seen.std_rad)
    slides = steady_slides(track, table.time_s)[rows] & np.isfinite(slip_std)
    # common errors of the forces, of the friction angle's prior, of the normals
    lateral_modes = np.hstack([found.modes_rad, np.zeros((len(rows), 1)), common])
    longitudinal_modes = np.hstack([seen.modes_rad, np.zeros_like(common)])
    normal_modes = np.hstack([0.0 * seen.modes_rad, common])
    rubs = FrictionTouches(
        used_as=np.where(across | along, np.where(slides, "sliding", "sticking"), "unused"),
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


def steady_slides(track: Track, time_s: np.ndarray) -> np.ndarray:
    """(B,) bool: frames that slide for certain, in the midst of sliding one way."""
    sliding, way = track.phase == "sliding", np.nan_to_num(_unit(track.slip_velocity_m_s))
    steady = sliding.copy()
    for step in range(-FrictionSettings.neighbours, FrictionSettings.neighbours + 1):
        at = np.arange(len(sliding)) + step
        there = np.clip(at, 0, len(sliding) - 1)
        alike = (at == there) & sliding[there] & (_dot(way, way[there]) > FrictionSettings.same_way)
        steady &= alike | ((abs(step) > 1) & (np.abs(time_s[there] - time_s) > FrictionSettings.near_s))
    return steady


def _friction_angles(
    table: ContactTable, shared: CommonErrors, rows: np.ndarray, axes: _Axes, friction_rad: float
) -> Angles:
    """The friction angles by the data alone, without their prior, with S + 1 common errors; NaN where the prior is all
    there was, and at the tip, where the antenna's normal is not the object's."""
    estimated, std = table.friction_angle_rad[rows], table.friction_angle_std_rad[rows]
    before = max(friction_rad, float(np.nanmax(std, initial=1e-12)))
    seen = (std > 0.0) & (std < FrictionSettings.visible_share * before) & (table.status[rows] != "tip_contact")
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
    own = np.sqrt(
        np.maximum(whole**2 - np.sum(modes[:, :-1] ** 2, axis=1), (FrictionSettings.least_own_share * whole) ** 2)
    )
    return Angles(np.where(seen, angle, np.nan), own, np.where(seen[:, None], modes, 0.0))
