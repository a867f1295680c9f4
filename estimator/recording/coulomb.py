"""Coulomb's law as a prior of the friction angles of a recording."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from estimator.object.friction import Friction, steady_slides
from estimator.table.contacts import ContactTable

from .problem import FrictionPrior
from .settings import RefineSettings

if TYPE_CHECKING:
    from estimator.object.track import Track


def as_estimated(table: ContactTable, unit_rad: float) -> FrictionPrior:
    """What frames were estimated with, one by one."""
    known = np.where(np.isfinite(table.friction_prior_rad), table.friction_prior_rad, unit_rad)
    return FrictionPrior(np.zeros(len(table)), np.maximum(known, 1e-4))


def by_coulomb(table: ContactTable, track: Track, friction: Friction, before: FrictionPrior) -> FrictionPrior | None:
    """The friction angles (B,) by the recording's coefficient; None where it has none.

    All lie in the cone. Where the shape determines the object's normal, the force's direction λ about the antenna says
    how much of the cone is left along it: tan²α ≤ μ² − tan²λ, with equality where the contact slides, and along the
    antenna the slip's sign is the angle's. At the tip nothing is known.
    """
    if friction.determined:
        mu, std = friction.mu, friction.std
    elif np.isfinite(friction.interval[1]):
        mu, std = float(friction.interval[1]), 0.0
    else:
        return None
    cone = np.hypot(np.arctan(mu + std), RefineSettings.least_friction_rad)
    mean, spread = np.zeros(len(table)), np.full(len(table), cone / np.sqrt(2.0))
    if not friction.determined:
        spread = np.minimum(spread, before.std_rad)
    else:
        rows, across = friction.row, np.tan(np.clip(friction.lateral_rad, -1.0, 1.0)) / mu if mu > 0.0 else None
        known = friction.lateral_std_rad < RefineSettings.lateral_known_rad
        if across is not None:
            unsure = friction.lateral_std_rad / mu
            left = np.maximum(1.0 - across**2, 0.0) + 2.0 * np.abs(across) * unsure + unsure**2
            rim = np.hypot(np.arctan(mu) * np.sqrt(np.minimum(left, 1.0)), RefineSettings.least_friction_rad)
            spread[rows[known]] = np.minimum(rim, spread[rows])[known]
        speed = np.linalg.norm(track.slip_velocity_m_s, axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            along, turn = track.longitudinal_m_s / speed, track.slip_std_m_s / speed
            slides = (
                steady_slides(track, table.time_s)
                & (np.abs(along) > RefineSettings.slip_along)
                & (turn < RefineSettings.slip_turn)
            )
            sliding_rad = np.arctan(mu * along)
            doubt = np.sqrt((std * along) ** 2 + (RefineSettings.rim * mu) ** 2 + RefineSettings.least_friction_rad**2)
        mean, spread = np.where(slides, sliding_rad, mean), np.where(slides, doubt, spread)
    at_tip = table.status == "tip_contact"
    return FrictionPrior(np.where(at_tip, before.mean_rad, mean), np.where(at_tip, before.std_rad, spread))


def contradicted(prior: FrictionPrior, angle_rad: np.ndarray, std_rad: np.ndarray) -> tuple[np.ndarray, bool]:
    """Which frames (B,) see another angle than the law's, and whether so many do that it does not hold; angle_rad,
    std_rad : (B,) with the prior."""
    reduction = prior.std_rad**2 - std_rad**2
    tells = reduction > RefineSettings.informative * prior.std_rad**2
    off = np.abs(angle_rad - prior.mean_rad) / np.sqrt(np.maximum(reduction, 1e-12))
    wrong = tells & (off > RefineSettings.law_contradicted)
    return wrong, bool(wrong.sum() > max(3, RefineSettings.law_share * tells.sum()))
