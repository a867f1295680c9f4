"""What the touches say of μ, with the errors that they have in common fitted along.

Coulomb: in a touch that slides, friction is μ times the normal force, against the slip. With d the unit slip, lateral
and longitudinal, the force's angles are

    lateral        −atan(μ d_lat) + the normal's error + noise
    longitudinal    atan(μ d_long cos(atan(μ d_lat))) + noise     (against the antenna's normal, towards the clamp)

and in all other touches neither of them exceeds atan μ. Sticking and sliding friction are taken as one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

SLIDING, STICKING, UNUSED = "sliding", "sticking", "unused"


@dataclass(frozen=True, eq=False)
class Angles:
    """P angles (P,), rad, NaN where not known or to be used; own deviations (P,); effects of K common errors (P, K).

    Common errors, of unit deviation, move all at once (rig, neighbouring normals), own ones each by itself.
    """

    angle_rad: np.ndarray
    std_rad: np.ndarray
    modes_rad: np.ndarray

    @property
    def whole_std_rad(self) -> np.ndarray:
        """(P,) own and common together."""
        return np.hypot(self.std_rad, np.linalg.norm(self.modes_rad, axis=1))


@dataclass(frozen=True, eq=False)
class FrictionTouches:
    """P touches. The lateral axis is n × t, across the antenna on the object's surface; the longitudinal one is t.

    Attributes
    ----------
    used_as : (P,) "sliding": friction is μ times the normal force, against the slip; "sticking": at most that, which
        holds for touches whose motion is undecided, too; "unused".
    slides : (P,) bool, whether a touch is in the midst of sliding, used or not.
    spread_across : (P,) bool, whether neighbours across the antenna let the shape determine the normal.
    lateral : of the force from the shape's normal, about the antenna, positive along n × t; with the normal's errors.
    normal_std_rad, normal_modes_rad : (P,), (P, K) of these the normal's: how far it may be turned along n × t.
    longitudinal : the friction angle as the data alone say it, positive for a force towards the clamp.
    slip : (P, 2) unit direction of the antenna's slip, lateral and longitudinal; NaN where it does not slide.
    slip_std_rad : (P,) of that direction.
    """

    used_as: np.ndarray
    slides: np.ndarray
    spread_across: np.ndarray
    lateral: Angles
    normal_std_rad: np.ndarray
    normal_modes_rad: np.ndarray
    longitudinal: Angles
    slip: np.ndarray
    slip_std_rad: np.ndarray

    def __len__(self) -> int:
        return len(self.used_as)

    @property
    def across(self) -> np.ndarray:
        """(P,) bool: the lateral angle is used."""
        return (self.used_as != UNUSED) & np.isfinite(self.lateral.angle_rad)

    def at_rest(self) -> FrictionTouches:
        """The same, taken as if nothing were known to slide: friction is at most μ times the normal force."""
        resting = np.where(self.used_as == SLIDING, STICKING, self.used_as)
        return replace(self, used_as=resting, slides=np.zeros(len(self), bool))


_FREEDOM = 5.0  # own errors follow Student's t of so many degrees of freedom: a few frames may be wrong, by any amount
_DIRECTED = 4.0  # a part of the slip not so many times its deviation says nothing of μ, which could be of any size then
WRONG = 4.0  # in own deviations: farther off, a touch is not believed
# what need not slide speaks of μ only where it lies so many of its own deviations outside the cone: noise alone would
# else ask for a wider one, the more the more such touches there are
_NOISE = 3.0
_STEPS, _ENOUGH, _LEAST_SHARE = 40, 1e-5, 1e-2


@dataclass(frozen=True, eq=False)
class Evidence:
    """R angles (R,), lateral and longitudinal ones of all touches that are used, and K errors that they have in common.

    Attributes
    ----------
    angles : measured, with their own and common errors. touch : (R,) which touch an angle is of.
    slides : (R,) bool; the others only bound μ. lateral : (R,) bool; the others are longitudinal.
    slip : (R, 2) lateral and longitudinal unit slip; slip_std_rad : (R,).
    """

    angles: Angles
    slides: np.ndarray
    lateral: np.ndarray
    slip: np.ndarray
    slip_std_rad: np.ndarray
    touch: np.ndarray

    @staticmethod
    def of(rubs: FrictionTouches) -> Evidence:
        """What is known of the touches that are used; of those that slide, along the sure parts of the slip."""
        used, slides = rubs.used_as != UNUSED, rubs.used_as == SLIDING
        unsure = rubs.slip_std_rad[:, None] * np.abs(rubs.slip[:, ::-1])
        directed = ~slides[:, None] | (np.abs(rubs.slip) > _DIRECTED * unsure)
        sides, rows = (rubs.lateral, rubs.longitudinal), []
        for side, sure in zip(sides, directed.T, strict=True):
            known = np.isfinite(side.angle_rad) & np.isfinite(side.std_rad) & (side.std_rad > 0)
            rows.append(np.flatnonzero(used & sure & known & np.isfinite(side.modes_rad).all(axis=1)))
        joined = [
            np.concatenate([vars(side)[name][which] for side, which in zip(sides, rows, strict=True)])
            for name in ("angle_rad", "std_rad", "modes_rad")
        ]
        touch = np.concatenate(rows)
        slides = slides[touch]
        return Evidence(
            Angles(*joined),
            slides=slides,
            lateral=np.arange(len(touch)) < len(rows[0]),
            slip=np.where(slides[:, None], rubs.slip[touch], 0.0),
            slip_std_rad=np.where(slides, rubs.slip_std_rad[touch], 0.0),
            touch=touch,
        )

    def expected(self, mu: np.ndarray) -> np.ndarray:
        """(G, R) angles of touches that slide, rad, for each μ (G,); 0 of the others."""
        across = np.arctan(mu[:, None] * self.slip[:, 0])
        along = np.arctan(mu[:, None] * self.slip[:, 1] * np.cos(across))
        return np.where(self.lateral, -across, along)

    def spread(self, mu: np.ndarray) -> np.ndarray:
        """(G, R) own standard deviations, rad, for each μ (G,).

        A slip whose direction is unsure leaves friction's unsure, too. Their logarithm is not part of the cost: with it
        the errors of the slip would draw μ towards 0.
        """
        other = np.where(self.lateral, self.slip[:, 1], self.slip[:, 0])
        return np.hypot(self.angles.std_rad, mu[:, None] * other * self.slip_std_rad)


@dataclass(frozen=True, eq=False)
class Profile:
    """The common errors that explain the angles best, for each of G values of μ.

    `cost` (G,) is the negative logarithm of the likelihood, the common errors profiled out, `evidence` (G,) the same
    with them integrated out; modes (G, K) are the common errors in standard deviations, with covariance (G, K, K), off
    (G, R) the residuals in own standard deviations: 0 within the bound of touches that need not slide.
    """

    mu: np.ndarray
    cost: np.ndarray
    evidence: np.ndarray
    modes: np.ndarray
    covariance: np.ndarray
    off: np.ndarray

    def select(self, which: np.ndarray | slice) -> Profile:
        """Those of some values."""
        return Profile(**{each.name: getattr(self, each.name)[which] for each in fields(Profile)})

    @staticmethod
    def concatenate(parts: Sequence[Profile]) -> Profile:
        """One after the other."""
        return Profile(**{f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Profile)})


def student_t_losses(off: np.ndarray) -> np.ndarray:
    """Student's negative log-likelihoods, of residuals in standard deviations."""
    return 0.5 * (_FREEDOM + 1.0) * np.log1p(off**2 / _FREEDOM)


def _student_t_weights(off: np.ndarray) -> np.ndarray:
    """What the residuals count for: slope of the losses over the residual."""
    return (_FREEDOM + 1.0) / (_FREEDOM + off**2)


def profile(evidence: Evidence, mu: np.ndarray, start: np.ndarray | None = None) -> Profile:
    """At values of μ (G,): iterated weighted least squares, with a dead zone for touches that need not slide.

    The common errors begin at `start` (K,), or at none.
    """
    modes = evidence.angles.modes_rad
    z = np.tile(np.zeros(modes.shape[1]) if start is None else start, (len(mu), 1))
    expected, spread = evidence.expected(mu), evidence.spread(mu)
    slack = np.where(evidence.slides, 0.0, np.arctan(mu)[:, None] + _NOISE * spread)

    def residual(at: np.ndarray) -> np.ndarray:
        bare = evidence.angles.angle_rad - expected - at @ modes.T
        return np.sign(bare) * np.maximum(np.abs(bare) - slack, 0.0) / spread

    def cost_of(at: np.ndarray, off: np.ndarray) -> np.ndarray:
        return 0.5 * np.sum(at**2, axis=1) + student_t_losses(off).sum(axis=1)

    def hessian_of(off: np.ndarray) -> np.ndarray:
        weight = np.where(evidence.slides | (off != 0.0), _student_t_weights(off), 0.0) / spread**2
        return np.eye(len(modes.T)) + np.swapaxes(weight[:, :, None] * modes, 1, 2) @ modes

    off = residual(z)
    cost, share = cost_of(z, off), np.ones(len(mu))
    for _ in range(_STEPS):
        pull = (_student_t_weights(off) * off / spread) @ modes - z
        step = np.linalg.solve(hessian_of(off), pull[..., None])[..., 0]
        tried = z + share[:, None] * step
        tried_off = residual(tried)
        tried_cost = cost_of(tried, tried_off)
        better = tried_cost < cost
        gained = np.where(better, cost - tried_cost, 0.0)
        z, off = np.where(better[:, None], tried, z), np.where(better[:, None], tried_off, off)
        cost, share = cost - gained, np.where(better, 1.0, 0.3 * share)
        if ((gained < _ENOUGH) & (better | (share < _LEAST_SHARE))).all():
            break
    hessian = hessian_of(off)
    _, volume = np.linalg.slogdet(hessian)
    return Profile(mu, cost, cost + 0.5 * volume, z, np.linalg.inv(hessian), off)
