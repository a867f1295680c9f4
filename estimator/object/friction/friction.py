"""Friction of an object from its touches (Fig. 5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from estimator.table.contacts import ContactTable

from .angles import Axes, dot, friction_touches, roll_of, roll_rad, unit
from .coefficient import Coefficient, coefficient, enough_sliding, judge
from .evidence import WRONG, Angles, Evidence, FrictionTouches

if TYPE_CHECKING:
    from estimator.contact.common_errors import CommonErrors
    from estimator.object.surface import Surface
    from estimator.object.track.result import Track
    from vbaa_calib.rig import Rig


_UNKNOWN_MU = 1.0  # of an object whose friction is not known the force is thought to lean as far as this allows


@dataclass(frozen=True, eq=False)
class Normals:
    """At P touches, world frame: normal (P, 3), unit, out of the object; covariance (P, 3, 3), rad²."""

    normal: np.ndarray
    covariance: np.ndarray

    @property
    def std_rad(self) -> np.ndarray:
        """(P,) the larger of the deviations in the two directions in which a normal can turn."""
        return np.sqrt(np.maximum(np.linalg.eigvalsh(self.covariance)[:, -1], 0.0))


@dataclass(frozen=True, eq=False)
class Friction:
    """What P touches say of the friction between antenna and object, one μ for both sticking and sliding.

    Attributes
    ----------
    mu, std : coefficient of friction and its standard deviation; NaN unless `determined`.
    interval : (2,) of 95 %, common errors included. Where μ is not told, its one-sided bounds at 95 %: 0 and inf where
        there is none.
    cone_half_angle_rad : the paper's α = atan μ; NaN unless `determined`.
    determined : whether the data tell μ. reason : in words, what it rests on, or why it is not told.
    used_as : (P,) "sliding": friction is μN against the slip; "sticking": at most that; "unused".
    row : (P,) of the table.
    angle_rad, angle_std_rad : (P,) between force and shape's normal. Never negative, so about as large as its deviation
        where nothing rubs.
    lateral_rad, lateral_std_rad : (P,) its part about the antenna, from the shape's normal towards normal × tangent.
    longitudinal_rad, longitudinal_std_rad : (P,) its part along the antenna, towards the clamp: the estimator's
        friction angle, which is as good as unknown where its deviation is about what was said before.
    psi_rad, nu_rad : (P,) directions of the force and of the shape's normal in the antenna's yz plane (Fig. 5); of the
        latter NaN without the rig.
    lateral_slip : (P,) share of the slip that is across the antenna, signed; NaN where nothing slides.
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
    angle_rad: np.ndarray
    angle_std_rad: np.ndarray
    lateral_rad: np.ndarray
    lateral_std_rad: np.ndarray
    longitudinal_rad: np.ndarray
    longitudinal_std_rad: np.ndarray
    psi_rad: np.ndarray
    nu_rad: np.ndarray
    lateral_slip: np.ndarray
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

    Parameters
    ----------
    surface, track : of the same table.
    shared : what the frames' errors have in common; `CommonErrors.none` where the rig is not known, which then counts
        every error as common and as the frame's own.
    friction_rad : standard deviation of the friction angle that the contacts were estimated with.
    rig : for ν, the normals' direction in the antenna's yz plane.
    """
    rubs, axes, found = friction_touches(table, surface, track, shared, friction_rad)
    evidence = Evidence.of(rubs if enough_sliding(rubs) else rubs.at_rest())
    mu = coefficient(evidence) if len(evidence.touch) else None
    determined, reason, interval = judge(rubs, mu)
    rows, normal = surface.touched_row, surface.touched_normal
    # where the shape cannot tell the turn about the antenna
    unknown = np.where(rubs.spread_across[:, None], 0.0, np.nan_to_num(axes.lateral))
    covariance = surface.touched_normal_covariance + unknown[:, :, None] * unknown[:, None, :]
    turned = np.einsum("pi,pij,pj->p", axes.lateral, covariance, axes.lateral)
    lateral_std = np.sqrt(found.std_rad**2 + np.sum(found.modes_rad**2, axis=1) + turned)
    longitudinal_std = table.friction_angle_std_rad[rows]
    informative = interval[0] > 0.0 or np.isfinite(interval[1])
    angle, angle_std = _angles(table.force_world_N[rows], axes, lateral_std, longitudinal_std)
    return Friction(
        mu=mu.mu if mu is not None and determined else np.nan,
        std=mu.std if mu is not None and determined else np.nan,
        interval=interval,
        cone_half_angle_rad=float(np.arctan(mu.mu)) if mu is not None and determined else np.nan,
        determined=determined,
        reason=reason,
        used_as=rubs.used_as,
        row=rows,
        angle_rad=angle,
        angle_std_rad=angle_std,
        lateral_rad=found.angle_rad,
        lateral_std_rad=lateral_std,
        longitudinal_rad=table.friction_angle_rad[rows],
        longitudinal_std_rad=longitudinal_std,
        psi_rad=roll_rad(table)[rows],
        nu_rad=np.full(len(rows), np.nan) if rig is None else roll_of(rig.kinematics, table, rows, normal),
        lateral_slip=rubs.slip[:, 0],
        normals=_update_normals(
            Normals(normal, covariance), axes, rubs, found, mu if informative else None, interval[1]
        ),
    )


def _angles(
    force: np.ndarray, axes: Axes, lateral_std: np.ndarray, longitudinal_std: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Angle (P,) between forces and normals and its deviation (P,); of its two parts the larger one counts most."""
    direction = unit(force)
    parts = np.stack([dot(direction, axes.lateral), dot(direction, axes.along)], axis=1)
    sideways = np.linalg.norm(parts, axis=1)
    angle = np.arctan2(sideways, dot(direction, axes.normal))
    share = parts / np.where(sideways > 1e-12, sideways, 1.0)[:, None]
    return angle, np.sqrt((share[:, 0] * lateral_std) ** 2 + (share[:, 1] * longitudinal_std) ** 2)


def _update_normals(
    normals: Normals,
    axes: Axes,
    rubs: FrictionTouches,
    found: Angles,
    mu: Coefficient | None,
    largest_mu: float,
) -> Normals:
    """Shape's normals, turned about the antenna as the forces ask for.

    Touches that slide took part in the fit of μ, and their normals' errors were found with it. In all others the force
    lies somewhere in the cone of `largest_mu`, inf where nothing is known of it. Touches that fit no μ are believed no
    more than that.
    """
    lateral = axes.lateral
    before = np.maximum(np.einsum("pi,pij,pj->p", lateral, normals.covariance, lateral), 0.0)
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
