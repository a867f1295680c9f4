"""Friction of an object from its touches (Fig. 5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from estimator.object.surface import Normals
from estimator.table.contacts import ContactTable
from estimator.table.joint_angles import joint_angles

from .angles import Axes, friction_touches
from .coefficient import WRONG, Angles, Coefficient, Evidence, FrictionTouches, coefficient, judge

if TYPE_CHECKING:
    from estimator.contact.common_errors import CommonErrors
    from estimator.object.surface import Surface
    from estimator.object.track.onset import Track
    from vbaa_calib.rig import Rig


_UNKNOWN_MU = 1.0  # of an object whose friction is not known the force is thought to lean as far as this allows


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
    rubs, axes, found = friction_touches(table, surface, track, shared, friction_rad)
    evidence = Evidence.of(rubs)
    mu = coefficient(evidence) if len(evidence.touch) else None
    determined, reason, interval = judge(rubs, mu)
    rows, normal = surface.touched_row, surface.touched_normal
    # where the shape cannot tell the turn about the antenna
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


def _update_normals(
    normals: Normals,
    axes: Axes,
    rubs: FrictionTouches,
    found: Angles,
    mu: Coefficient | None,
    largest_mu: float,
) -> Normals:
    """Shape's normals, turned about the antenna as the forces require.

    Touches that slide took part in the fit of μ, and their normals' errors were found with it. In all others, and where
    no μ fits, the force lies somewhere in the cone of `largest_mu`, inf where nothing is known of it.
    """
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
    cone = np.arctan(largest_mu if np.isfinite(largest_mu) else _UNKNOWN_MU) ** 2 / 3.0
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
    evidence = Evidence.of(rubs)
    side, touch = evidence.lateral, evidence.touch[evidence.lateral]
    total, square, off = np.zeros((3, len(rubs)))
    own, found = rubs.normal_std_rad[touch] ** 2, mu.fits
    spreads = max(mu.scatter, 1.0) * evidence.spread(found.mu)[:, side]
    for index in np.flatnonzero(mu.weight > 1e-6):
        weight, spread, error = mu.weight[index], spreads[index], found.off[index, side]
        held = evidence.slides[side] & (np.abs(error) < WRONG)
        share = np.where(held, own / spread**2, 0.0)
        turn = modes @ found.modes[index]
        left = np.einsum("pk,kl,pl->p", modes, found.covariance[index], modes, optimize=True) + beyond
        turn[touch] += share * error * spread
        left += rubs.normal_std_rad**2
        left[touch] -= share * own
        total += weight * turn
        square += weight * (left + turn**2)
        off[touch] += weight * np.where(np.abs(error) < WRONG, 0.0, error * spread)
    used = rubs.across
    return np.where(used, total, 0.0), np.where(used, np.maximum(square - total**2, 1e-12), before), off
