"""Friction of an object from its touches (Fig. 5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from estimator.table.contacts import ContactTable

from .angles import Axes, Directions, dot, friction_touches, roll_of, roll_rad, roll_std_rad, unit
from .coefficient import Coefficient, coefficient, enough_sliding, judge
from .evidence import WRONG, Evidence, FrictionTouches

if TYPE_CHECKING:
    from estimator.contact.common_errors import CommonErrors
    from estimator.object.surface import Surface
    from estimator.object.track.result import Track
    from vbaa_calib.rig import Rig


_UNKNOWN_MU = 1.0
"""Of an object whose friction is not known the force is thought to lean as far as this allows."""


@dataclass(frozen=True, eq=False)
class Normals:
    """At P touches, world frame.

    Attributes
    ----------
    normal : (P, 3) unit, out of the object. covariance : (P, 3, 3) rad².
    turned_rad : (P,) by how much the force turned the shape's normal about the antenna, along normal × tangent.
    """

    normal: np.ndarray
    covariance: np.ndarray
    turned_rad: np.ndarray

    @property
    def std_rad(self) -> np.ndarray:
        """(P,) the larger of the deviations in the two directions in which a normal can turn."""
        return np.sqrt(np.maximum(np.linalg.eigvalsh(self.covariance)[:, -1], 0.0))


@dataclass(frozen=True, eq=False)
class _Turn:
    """Turns (P,) about the antenna, along normal × tangent, rad, and their variances (P,)."""

    angle_rad: np.ndarray
    variance: np.ndarray

    def joined(self, other: _Turn) -> _Turn:
        """What both say; nothing is said by an infinite variance."""
        share = self.variance / (self.variance + other.variance)
        aim = np.where(np.isfinite(other.variance), other.angle_rad, 0.0)
        return _Turn(self.angle_rad + share * (aim - self.angle_rad), self.variance * (1.0 - share))


def _update_normals(
    normal: np.ndarray,
    covariance: np.ndarray,
    axes: Axes,
    rubs: FrictionTouches,
    found: Directions,
    mu: Coefficient | None,
    largest_mu: float,
) -> Normals:
    """Shape's normals (P, 3) with covariance (P, 3, 3), turned about the antenna as the forces ask for.

    Touches that slide took part in the fit of μ, and their normals' errors were found with it. In all others the force
    lies somewhere in the cone of `largest_mu`, inf where nothing is known of it. Touches that fit no μ are believed no
    more than that.
    """
    lateral = axes.lateral
    variance = np.maximum(np.einsum("pi,pij,pj->p", lateral, covariance, lateral), 0.0)
    shape, fitted = _Turn(np.zeros(len(rubs)), variance), np.zeros(len(rubs), bool)
    if mu is not None:
        shape, off = _by_fit(shape, rubs, mu)
        fitted = rubs.slides & rubs.across & (off == 0.0)
        shape = _Turn(shape.angle_rad, shape.variance + off**2)
    turn = shape.joined(_by_force(rubs, found, mu, largest_mu, fitted))
    sound = np.isfinite(turn.angle_rad) & np.isfinite(turn.variance) & (variance > 0)
    angle = np.where(sound, turn.angle_rad, 0.0)
    base = np.where(sound[:, None], np.nan_to_num(axes.normal), normal)
    beside = np.where(sound[:, None], np.nan_to_num(lateral), 0.0)
    stretched = np.sqrt(np.where(sound, turn.variance, 1.0) / np.where(sound, variance, 1.0)) - 1.0
    stretch = np.eye(3) + stretched[:, None, None] * beside[:, :, None] * beside[:, None, :]
    turned = np.cos(angle)[:, None] * base + np.sin(angle)[:, None] * beside
    return Normals(turned, stretch @ covariance @ np.swapaxes(stretch, 1, 2), angle)


def _by_force(
    rubs: FrictionTouches, found: Directions, mu: Coefficient | None, largest_mu: float, fitted: np.ndarray
) -> _Turn:
    """Where the force alone sees the normal: on the cone's rim in touches that slide, if μ is known, in others anywhere
    in it, taken as Gaussian; nothing where the fit has had its say."""
    whole = found.lateral_std_rad**2 + np.sum(found.lateral_modes_rad**2, axis=1)
    cone = np.arctan(largest_mu if np.isfinite(largest_mu) else _UNKNOWN_MU) ** 2 / 3.0
    angle, variance = found.lateral_rad, cone + whole
    if mu is not None and np.isfinite(largest_mu):
        rim = rubs.slides & ~rubs.across
        lean = np.arctan(mu.mu * np.nan_to_num(rubs.slip[:, 0]))
        unsure = mu.std**2 + (mu.mu * np.nan_to_num(rubs.slip[:, 1] * rubs.slip_std_rad)) ** 2
        angle, variance = np.where(rim, angle + lean, angle), np.where(rim, whole + unsure, variance)
    return _Turn(angle, np.where(fitted, np.inf, variance))


def _by_fit(shape: _Turn, rubs: FrictionTouches, mu: Coefficient) -> tuple[_Turn, np.ndarray]:
    """What the fit found of the touches that took part, over the values that μ may have: their common errors and each
    one's own. And by how much (P,) touches lie off, 0 where that is as it should be."""
    modes = rubs.normal_modes_rad @ mu.axes.T
    beyond = np.sum(rubs.normal_modes_rad**2, axis=1) - np.sum(modes**2, axis=1)
    evidence = Evidence.of(rubs)
    side, touch = evidence.lateral, evidence.touch[evidence.lateral]
    total, square, off = np.zeros(len(rubs)), np.zeros(len(rubs)), np.zeros(len(rubs))
    own = rubs.normal_std_rad[touch] ** 2
    found, spreads = mu.fits, mu.widened * evidence.spread(mu.fits.mu)[:, side]
    for index in np.flatnonzero(mu.weight > 1e-6):
        worth, spread, error = mu.weight[index], spreads[index], found.off[index, side]
        held = evidence.slides[side] & (np.abs(error) < WRONG)
        share = np.where(held, own / spread**2, 0.0)
        turn = modes @ found.modes[index]
        left = np.einsum("pk,kl,pl->p", modes, found.covariance[index], modes, optimize=True) + beyond
        turn[touch] += share * error * spread
        left += rubs.normal_std_rad**2
        left[touch] -= share * own
        total += worth * turn
        square += worth * (left + turn**2)
        off[touch] += worth * np.where(np.abs(error) < WRONG, 0.0, error * spread)
    used = rubs.across
    left = np.where(used, np.maximum(square - total**2, 1e-12), shape.variance)
    return _Turn(np.where(used, total, shape.angle_rad), left), off


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
    scatter : how much more the sliding touches scatter than they should; the deviations were widened where above 1.
    used_as : (P,) "sliding": friction is μN against the slip; "sticking": at most that; "unused".
    row : (P,) of the table.
    angle_rad, angle_std_rad : (P,) between force and shape's normal. Never negative, so about as large as its deviation
        where nothing rubs.
    lateral_rad, lateral_std_rad : (P,) its part about the antenna, from the shape's normal towards normal × tangent.
    longitudinal_rad, longitudinal_std_rad : (P,) its part along the antenna, towards the clamp: the estimator's
        friction angle, which is as good as unknown where its deviation is about what was said before.
    psi_rad, psi_std_rad : (P,) direction of the force in the antenna's yz plane (Fig. 5).
    nu_rad, nu_std_rad : (P,) the shape's normal's in the same; NaN without the rig.
    lateral_slip : (P,) share of the slip that is across the antenna, signed; NaN where nothing slides.
    normals : of shape, tangents and force together.
    """

    mu: float
    std: float
    interval: np.ndarray
    cone_half_angle_rad: float
    determined: bool
    reason: str
    scatter: float
    used_as: np.ndarray
    row: np.ndarray
    angle_rad: np.ndarray
    angle_std_rad: np.ndarray
    lateral_rad: np.ndarray
    lateral_std_rad: np.ndarray
    longitudinal_rad: np.ndarray
    longitudinal_std_rad: np.ndarray
    psi_rad: np.ndarray
    psi_std_rad: np.ndarray
    nu_rad: np.ndarray
    nu_std_rad: np.ndarray
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
    mu = coefficient(evidence) if len(evidence.angle_rad) else None
    said = judge(rubs, mu)
    rows, normal = surface.touched_row, surface.touched_normal
    covariance = surface.touched_normal_covariance + _unknown_turn(axes, ~rubs.spread_across)
    whole = np.sqrt(
        found.lateral_std_rad**2
        + np.sum(found.lateral_modes_rad**2, axis=1)
        + np.einsum("pi,pij,pj->p", axes.lateral, covariance, axes.lateral)
    )
    angle, angle_std = _angles(table.force_world_N[rows], axes, found, whole)
    unknown = np.full(len(rows), np.nan)
    nu = unknown if rig is None else roll_of(rig.kinematics, table, rows, normal)
    nu_std = unknown if rig is None else np.sqrt(np.einsum("pi,pij,pj->p", axes.lateral, covariance, axes.lateral))
    return Friction(
        mu=mu.mu if mu is not None and said.determined else np.nan,
        std=mu.std if mu is not None and said.determined else np.nan,
        interval=said.interval,
        cone_half_angle_rad=float(np.arctan(mu.mu)) if mu is not None and said.determined else np.nan,
        determined=said.determined,
        reason=said.reason,
        scatter=np.nan if mu is None else mu.scatter,
        used_as=rubs.used_as,
        row=rows,
        angle_rad=angle,
        angle_std_rad=angle_std,
        lateral_rad=found.lateral_rad,
        lateral_std_rad=whole,
        longitudinal_rad=found.longitudinal_rad,
        longitudinal_std_rad=found.longitudinal_std_rad,
        psi_rad=roll_rad(table)[rows],
        psi_std_rad=_roll_std(table, shared, rows, found),
        nu_rad=nu,
        nu_std_rad=nu_std,
        lateral_slip=rubs.slip[:, 0],
        normals=_update_normals(
            normal, covariance, axes, rubs, found, mu if said.informative else None, said.interval[1]
        ),
    )


def _unknown_turn(axes: Axes, where: np.ndarray) -> np.ndarray:
    """(P, 3, 3) 1 rad² of turn about the antenna, where (P,) the shape cannot tell it."""
    turn = np.where(where[:, None], np.nan_to_num(axes.lateral), 0.0)
    return turn[:, :, None] * turn[:, None, :]


def _roll_std(table: ContactTable, shared: CommonErrors, rows: np.ndarray, found: Directions) -> np.ndarray:
    """(P,) of ψ: with a rig the two components' errors are known together, without one they are not."""
    if not shared.point_m.shape[2]:
        return roll_std_rad(table)[rows]
    return np.sqrt(found.lateral_std_rad**2 + np.sum(found.lateral_modes_rad**2, axis=1))


def _angles(force: np.ndarray, axes: Axes, found: Directions, lateral_std: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angle (P,) between forces and normals and its deviation (P,); of its two parts the larger one counts most."""
    direction = unit(force)
    parts = np.stack([dot(direction, axes.lateral), dot(direction, axes.along)], axis=1)
    sideways = np.linalg.norm(parts, axis=1)
    angle = np.arctan2(sideways, dot(direction, axes.normal))
    share = parts / np.where(sideways > 1e-12, sideways, 1.0)[:, None]
    variance = (share[:, 0] * lateral_std) ** 2 + (share[:, 1] * found.longitudinal_std_rad) ** 2
    return angle, np.sqrt(variance)
