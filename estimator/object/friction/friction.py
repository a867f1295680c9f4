"""Friction of an object from contacts, surface normals and slip, with the errors in common (Fig. 5); and normals
corrected by the force.

Coulomb: in a touch that slides, friction is μ times the normal force, against the slip. With d the unit slip, lateral
and longitudinal, the force's angles are

    lateral        −atan(μ d_lat) + the normal's error + noise
    longitudinal    atan(μ d_long cos(atan(μ d_lat))) + noise     (against the antenna's normal, towards the clamp)

and in all other touches neither of them exceeds atan μ. Sticking and sliding friction are taken as one. Errors that the
touches have in common are fitted with the posterior of μ.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from estimator.object.surface import Normals
from estimator.table.contacts import ContactTable, joint_angles
from vbaa_calib.core.arrays import Rows
from vbaa_calib.core.robust import NORMAL_QUARTILE, chi_square_p, finite_or_none
from vbaa_calib.geometry.covariance import variance_along

if TYPE_CHECKING:
    from estimator.contact.common_errors import CommonErrors
    from estimator.object.surface import Surface
    from estimator.object.track.onset import Track
    from vbaa_calib.rig import Rig


@dataclass(frozen=True)
class FrictionSettings:
    """Thresholds of the friction coefficient and of the touches that determine it."""

    largest_mu: float = 2.0  # no larger μ is searched
    bound_loss: float = 0.5 * 1.645**2  # rise of the cost at a bound that holds with 95 % probability
    spared: int = 2  # touches farthest outside the cone that do not count for a bound, as they may be wrong
    interval: float = 0.95  # share of the posterior in the stated interval
    coarse_points: int = 41  # of the first grid of μ
    fine_points: int = 61  # of the grid about the best μ
    fine_loss: float = 9.0  # log likelihood down to which the fine grid reaches
    between_points: int = 17  # of the grid between neighbours of the coarse one
    fewest_scattered: int = 8  # fewer sliding angles do not determine their scatter
    fewest_sliding: int = 5  # touches that have to slide
    known_share: float = 0.25  # directions known for fewer of the touches are known by accident
    determined_std: float = 0.03  # standard deviation of μ below which it counts as determined
    determined_share: float = 0.1  # the same as a share of μ
    contradicted: float = (
        4.0  # ratio of scatter to expected scatter from which sliding touches do not follow Coulomb's law
    )
    wrong_share: float = 0.25  # share of outliers among them from which they do not
    strained_p: float = 1e-5  # probability of the common errors below which they do not
    freedom: float = 5.0  # of Student's t that own errors follow: a few frames may be wrong by any amount
    directed_std: float = 4.0  # a slip component below so many of its standard deviations has no direction
    wrong_std: float = 4.0  # own standard deviations from which a touch is an outlier
    outside_std: float = 3.0  # standard deviations outside the cone from which a touch that need not slide counts
    most_steps: int = 40  # of Newton's method for the common errors
    step_tolerance: float = 1e-8  # of the cost: it ends with a step that gains less
    least_step: float = 1e-2  # smallest part of a step that is tried
    unknown_mu: float = 1.0  # standard deviation of an unknown object's μ
    least_std_rad: float = 1e-4  # of any direction: a rig stated as exact would count without limit
    least_own: float = 0.2  # smallest part of a standard deviation that is the frame's own
    near_share: float = 0.3  # part of the patch's extent in which a touch's neighbours are compared
    across_share: float = 0.2  # their spread across the antenna over that along it, at least
    across_std: float = 4.0  # and in their usual standard deviations: else small errors pass for a slope
    normal_known_rad: float = 0.12  # normals known less well say nothing about friction across
    force_known_rad: float = 0.25  # nor do forces known less well
    slip_std: float = 2.0  # standard deviations from which a slip speed has a direction
    least_own_share: float = 0.7  # of a friction angle's deviation that is the frame's own
    neighbours: int = 2  # frames before and after that have to slide the same way
    near_s: float = 0.07  # as far as they are within this time
    same_way: float = 0.5  # cosine between their slips
    visible_share: float = 0.5  # of the prior's standard deviation to which a visible friction angle's falls
    relabelled: int = 4  # times that touches inside the cone may turn out not to slide


@dataclass(frozen=True, eq=False)
class _Angles(Rows):
    """P angles; NaN where unknown or not to be used."""

    angle_rad: np.ndarray  # (P,)
    std_rad: np.ndarray  # (P,) own deviations
    modes_rad: np.ndarray  # (P, K) effects of K common errors

    @property
    def whole_std_rad(self) -> np.ndarray:
        """(P,) total standard deviations, of own and shared errors."""
        return np.hypot(self.std_rad, np.linalg.norm(self.modes_rad, axis=1))


@dataclass(frozen=True, eq=False)
class _FrictionTouches(Rows):
    """P touches. The lateral axis is n × t, across the antenna on the object's surface; the longitudinal one is t."""

    used_as: np.ndarray  # (P,) as `Friction`'s
    slides: np.ndarray  # (P,) bool, in the midst of sliding, used or not
    spread_across: np.ndarray  # (P,) bool, whether neighbours across the antenna let the shape determine the normal
    lateral: _Angles  # of the force from the shape's normal, positive along n × t; with the normal's errors
    normal_std_rad: np.ndarray  # (P,) how far the normal may be turned along n × t
    normal_modes_rad: np.ndarray  # (P, K)
    longitudinal: _Angles  # the friction angle without its prior, positive for a force towards the clamp
    slip: np.ndarray  # (P, 2) unit direction of the slip, lateral and longitudinal; NaN where it does not slide
    slip_std_rad: np.ndarray  # (P,)

    @property
    def across(self) -> np.ndarray:
        """(P,) mask of the touches with a usable lateral angle."""
        return (self.used_as != "unused") & np.isfinite(self.lateral.angle_rad)

    @property
    def counts(self) -> tuple[int, int]:
        """Number of touches that slide, and of all that are used."""
        return int(np.sum(self.used_as == "sliding")), int(np.sum(self.used_as != "unused"))


@dataclass(frozen=True, eq=False)
class _FrictionAngles:
    """R friction angles: lateral and longitudinal ones of all touches that are used."""

    angles: _Angles  # R
    slides: np.ndarray  # (R,) the others only bound μ
    lateral: np.ndarray  # (R,) the others are longitudinal
    slip: np.ndarray  # (R, 2) unit
    slip_std_rad: np.ndarray  # (R,)
    touch: np.ndarray  # (R,) of which touch

    @staticmethod
    def of(rubs: _FrictionTouches) -> _FrictionAngles:
        """The angles of usable touches, of sliding ones along the certain components of the slip. If fewer touches
        slide than μ needs, none counts as sliding."""
        if rubs.counts[0] < FrictionSettings.fewest_sliding:
            rubs = replace(rubs, used_as=np.where(rubs.used_as == "sliding", "sticking", rubs.used_as))
        used, slides = rubs.used_as != "unused", rubs.used_as == "sliding"
        unsure = rubs.slip_std_rad[:, None] * np.abs(rubs.slip[:, ::-1])
        directed = ~slides[:, None] | (np.abs(rubs.slip) > FrictionSettings.directed_std * unsure)
        sides, rows = (rubs.lateral, rubs.longitudinal), []
        for side, sure in zip(sides, directed.T, strict=True):
            known = np.isfinite(side.angle_rad) & np.isfinite(side.std_rad) & (side.std_rad > 0)
            rows.append(np.flatnonzero(used & sure & known & np.isfinite(side.modes_rad).all(axis=1)))
        touch = np.concatenate(rows)
        slides = slides[touch]
        return _FrictionAngles(
            _Angles.joined([side.picked(which) for side, which in zip(sides, rows, strict=True)]),
            slides=slides,
            lateral=np.arange(len(touch)) < len(rows[0]),
            slip=np.where(slides[:, None], rubs.slip[touch], 0.0),
            slip_std_rad=np.where(slides, rubs.slip_std_rad[touch], 0.0),
            touch=touch,
        )

    def expected(self, mu: np.ndarray) -> np.ndarray:
        """(G, R) expected angles, rad, of sliding touches for each μ (G,); 0 for the others."""
        across = np.arctan(mu[:, None] * self.slip[:, 0])
        along = np.arctan(mu[:, None] * self.slip[:, 1] * np.cos(across))
        return np.where(self.lateral, -across, along)

    def spread(self, mu: np.ndarray) -> np.ndarray:
        """(G, R) own standard deviations, rad, for each μ (G,), larger where the slip's direction is uncertain.
        Their logarithm is left out of the cost, since it would bias μ towards 0."""
        other = np.where(self.lateral, self.slip[:, 1], self.slip[:, 0])
        return np.hypot(self.angles.std_rad, mu[:, None] * other * self.slip_std_rad)


@dataclass(frozen=True, eq=False)
class _Profile(Rows):
    """Fit of the shared errors to the angles at each of G values of μ."""

    mu: np.ndarray  # (G,)
    cost: np.ndarray  # (G,) negative log-likelihood with the common errors profiled out
    evidence: np.ndarray  # (G,) the same integrated out
    modes: np.ndarray  # (G, K) the common errors
    covariance: np.ndarray  # (G, K, K)
    off: np.ndarray  # (G, R) residuals in own deviations: 0 within the bound of touches that need not slide


def _student_t_losses(off: np.ndarray) -> np.ndarray:
    return 0.5 * (FrictionSettings.freedom + 1.0) * np.log1p(off**2 / FrictionSettings.freedom)


def _student_t_weights(off: np.ndarray) -> np.ndarray:
    return (FrictionSettings.freedom + 1.0) / (FrictionSettings.freedom + off**2)


def _profile(evidence: _FrictionAngles, mu: np.ndarray, start: np.ndarray | None = None) -> _Profile:
    """Profile at values of μ (G,), from initial shared errors (K,): weighted least squares, with a dead zone for
    touches that need not slide."""
    modes = evidence.angles.modes_rad
    z = np.tile(np.zeros(modes.shape[1]) if start is None else start, (len(mu), 1))
    expected, spread = evidence.expected(mu), evidence.spread(mu)
    slack = np.where(evidence.slides, 0.0, np.arctan(mu)[:, None] + FrictionSettings.outside_std * spread)

    def residual(at: np.ndarray, rows: np.ndarray) -> np.ndarray:
        bare = evidence.angles.angle_rad - expected[rows] - at @ modes.T
        return np.sign(bare) * np.maximum(np.abs(bare) - slack[rows], 0.0) / spread[rows]

    def cost_of(at: np.ndarray, off: np.ndarray) -> np.ndarray:
        return 0.5 * np.sum(at**2, axis=1) + _student_t_losses(off).sum(axis=1)

    def hessian_of(off: np.ndarray, rows: np.ndarray) -> np.ndarray:
        weight = np.where(evidence.slides | (off != 0.0), _student_t_weights(off), 0.0) / spread[rows] ** 2
        return np.eye(len(modes.T)) + np.swapaxes(weight[:, :, None] * modes, 1, 2) @ modes

    every = rows = np.arange(len(mu))
    off = residual(z, every)
    cost, share = cost_of(z, off), np.ones(len(mu))
    for _ in range(FrictionSettings.most_steps):
        pull = (_student_t_weights(off[rows]) * off[rows] / spread[rows]) @ modes - z[rows]
        step = np.linalg.solve(hessian_of(off[rows], rows), pull[..., None])[..., 0]
        tried = z[rows] + share[rows, None] * step
        tried_off = residual(tried, rows)
        tried_cost = cost_of(tried, tried_off)
        gained = cost[rows] - tried_cost
        better = gained > 0.0
        z[rows[better]], off[rows[better]], cost[rows[better]] = tried[better], tried_off[better], tried_cost[better]
        share[rows] = np.where(better, 1.0, 0.3 * share[rows])
        rows = rows[
            np.where(better, gained > FrictionSettings.step_tolerance, share[rows] > FrictionSettings.least_step)
        ]
        if not len(rows):
            break
    hessian = hessian_of(off, every)
    _, volume = np.linalg.slogdet(hessian)
    return _Profile(mu, cost, cost + 0.5 * volume, z, np.linalg.inv(hessian), off)


@dataclass(frozen=True, eq=False)
class _Coefficient:
    """Posterior of the friction coefficient μ from the touches; its prior is uniform up to
    `FrictionSettings.largest_mu`."""

    mu: float  # mean of the posterior
    std: float  # of the posterior
    interval: np.ndarray  # (2,) the shortest that holds 95 %
    bounds: np.ndarray  # (2,) one-sided at 95 %, 0 and inf where there is none
    scatter: float  # median of the own residuals; the deviations were widened by it where above 1
    wrong: float  # share of the sliding touches that are not believed
    strain: float  # probability that common errors as large as the best fit's are an accident
    axes: np.ndarray  # (L, K) the combinations of the K common errors that the angles determine
    fits: _Profile  # in these, at G values of μ
    weight: np.ndarray  # (G,) probabilities


def _coefficient(evidence: _FrictionAngles) -> _Coefficient:
    """The posterior of μ, widened where sliding touches scatter more than their standard deviations."""
    angles = evidence.angles
    # orthonormal: what else the common errors do moves no angle
    scaled = angles.modes_rad / angles.std_rad[:, None]
    _, sizes, axes = np.linalg.svd(scaled.T @ scaled)
    axes = axes[sizes > 1e-6]
    angles = replace(angles, modes_rad=angles.modes_rad @ axes.T)
    evidence = replace(evidence, angles=angles)
    found, scatter = _profile_on_grids(evidence), 1.0
    off = np.abs(found.off[np.argmin(found.evidence)][evidence.slides])
    if len(off) >= FrictionSettings.fewest_scattered:  # 1 for Gaussian noise as large as was said
        scatter = float(np.median(off) / NORMAL_QUARTILE)
    if scatter > 1.0:
        evidence = replace(evidence, angles=replace(angles, std_rad=angles.std_rad * scatter))
        found = _profile_on_grids(evidence)
    weight = np.exp(found.evidence.min() - found.evidence) * np.gradient(found.mu)
    weight /= weight.sum()
    mu, best = float(weight @ found.mu), int(np.argmin(found.cost))
    # the shortest interval: from the boundary on, where the posterior is highest there
    edges = np.concatenate([found.mu[:1], 0.5 * (found.mu[1:] + found.mu[:-1]), found.mu[-1:]])
    total, begin = np.concatenate([[0.0], np.cumsum(weight)]), np.linspace(0.0, 1.0 - FrictionSettings.interval, 101)
    ends = np.interp([begin, np.minimum(begin + FrictionSettings.interval, total[-1])], total, edges)
    off, modes = np.abs(found.off[best, evidence.slides]), found.modes[best]
    return _Coefficient(
        mu,
        float(np.sqrt(weight @ (found.mu - mu) ** 2)),
        ends[:, np.argmin(ends[1] - ends[0])],
        _bounds(evidence, found),
        scatter,
        wrong=float(np.mean(off > FrictionSettings.wrong_std)) if len(off) else 0.0,
        strain=chi_square_p(modes @ modes, max(len(modes), 1)),
        axes=axes,
        fits=found,
        weight=weight,
    )


def _profile_on_grids(evidence: _FrictionAngles) -> _Profile:
    """The profile on a coarse grid of μ, refined around the likely values."""
    grid = np.tan(np.linspace(0.0, np.arctan(FrictionSettings.largest_mu), FrictionSettings.coarse_points))
    coarse = _profile(evidence, grid)
    best = int(np.argmin(coarse.evidence))
    likely = np.flatnonzero(coarse.evidence < coarse.evidence[best] + FrictionSettings.fine_loss)
    first, last = max(likely[0] - 1, 0), min(likely[-1] + 1, FrictionSettings.coarse_points - 1)
    between = np.linspace(grid[first], grid[last], FrictionSettings.fine_points)[1:-1]
    fine = _profile(evidence, between, coarse.modes[best])
    return _Profile.joined([coarse.picked(slice(0, first + 1)), fine, coarse.picked(slice(last, None))])


def _cost_without_worst(evidence: _FrictionAngles, found: _Profile) -> np.ndarray:
    """(G,) costs without the touches farthest outside the cone."""
    outside = np.sort(_student_t_losses(found.off[:, ~evidence.slides]), axis=1)
    return found.cost - outside[:, max(outside.shape[1] - FrictionSettings.spared, 0) :].sum(axis=1)


def _bounds(evidence: _FrictionAngles, found: _Profile) -> np.ndarray:
    """(2,) values of μ below and above the minimum at which the profile cost exceeds it by
    `FrictionSettings.bound_loss`."""
    cost = _cost_without_worst(evidence, found)
    dear, best = cost > cost.min() + FrictionSettings.bound_loss, int(np.argmin(cost))
    below, above = np.flatnonzero(dear[:best]), best + np.flatnonzero(dear[best:])

    def edge(outside: int, inside: int) -> float:
        between = np.linspace(found.mu[outside], found.mu[inside], FrictionSettings.between_points)
        finer = _cost_without_worst(evidence, _profile(evidence, between, found.modes[inside]))
        return float(between[np.flatnonzero(finer > cost.min() + FrictionSettings.bound_loss).max(initial=0)])

    lower = edge(below[-1], below[-1] + 1) if len(below) else 0.0
    upper = edge(above[0], above[0] - 1) if len(above) else np.inf
    return np.array([lower, upper if upper < FrictionSettings.largest_mu else np.inf])


def _judge(rubs: _FrictionTouches, mu: _Coefficient | None) -> tuple[bool, str, np.ndarray]:
    """Whether μ is determined, the reason in words, and its interval or one-sided bounds (2,), 0 and inf without
    any. mu : None where no touch could be used."""
    (sliding, used), nothing = rubs.counts, np.array([0.0, np.inf])
    known = "a force and a normal from the shape whose directions are"
    advice = "stroke the object across the antenna, over some length"
    if mu is None:
        return False, f"none of {len(rubs)} contacts has {known} both known; {advice}", nothing
    if used < FrictionSettings.known_share * len(rubs):
        few = f"only {used} of {len(rubs)} contacts have {known} known, too few to believe that these are"
        return False, f"{few}; {advice}", nothing
    if sliding < FrictionSettings.fewest_sliding:
        few = f"only {sliding}" if sliding else "none"
        words = f"of {used} contacts whose normal is known {few} lie{'s' * (sliding < 2)} in the midst of a slide"
        return False, f"{words}{_bound_words(mu.bounds)}", mu.bounds
    if mu.scatter > FrictionSettings.contradicted:
        words = (
            f"the {sliding} sliding contacts scatter {mu.scatter:.0f} times as much as they should: the forces do not"
        )
        why = "did the object move, or does its friction differ from place to place?"
        return False, f"{words} follow friction against the slip; {why}", nothing
    if mu.wrong > FrictionSettings.wrong_share:
        words = f"{100 * mu.wrong:.0f} % of the {sliding} sliding contacts do not follow friction against the slip"
        return False, words, nothing
    if mu.strain < FrictionSettings.strained_p:
        words = (
            f"the {sliding} sliding contacts could follow friction against the slip only if rig and normals were off"
        )
        return False, f"{words} by far more than they should be; did the object move?", nothing
    if mu.std > max(FrictionSettings.determined_std, FrictionSettings.determined_share * mu.mu):
        slides, words = rubs.used_as == "sliding", f"the {sliding} sliding contacts"
        across = rubs.slip[slides, 0]
        if np.median(np.abs(across)) < 0.3:
            words += " slide along the antenna, where the force is hardly known; slide across it, too"
        else:
            accuracy = np.degrees(np.nanmedian(rubs.lateral.whole_std_rad[slides]))
            words += f" know the force against the normal to {accuracy:.1f}°"
            one_way = abs(np.sign(across).sum()) > 0.8 * sliding
            words += "; stroke the same place the other way, too" if one_way else ""
        return False, f"{words}{_bound_words(mu.bounds)}", mu.bounds
    widened = f", scattering {mu.scatter:.1f} times as much as they should" if mu.scatter > 1.5 else ""
    others = f" and {used - sliding} others, which only bound it" if used > sliding else ""
    return True, f"from {sliding} sliding contacts{widened}{others}", mu.interval


def _bound_words(bounds: np.ndarray) -> str:
    """The lower and the upper bound (2,), as far as there are any, in words to be appended to a sentence."""
    low, high = np.floor(100.0 * bounds[0]) / 100.0, np.ceil(100.0 * bounds[1]) / 100.0
    if bounds[0] > 0.005 and high < np.inf:
        return f"; μ lies from {low:.2f} to {high:.2f} (each bound 95 %)"
    return f"; μ ≥ {low:.2f} (95 %)" if bounds[0] > 0.005 else f"; μ ≤ {high:.2f} (95 %)" if high < np.inf else ""


@dataclass(frozen=True, eq=False)
class Friction:
    """Friction between antenna and object from P touches, with one μ for both sticking and sliding.

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
    """Estimate the object's μ, the force directions relative to the normals, and normals corrected by the force.

    surface, track : of this table. shared : the errors that the frames have in common; without a rig
    `CommonErrors.none`, where each error counts as the frame's own and, to be safe, as common as well. friction_rad :
    the standard deviation of the friction angle that the contacts were estimated with. rig : for ν.
    """
    rubs, axes, found = _friction_touches(table, surface, track, shared, friction_rad)
    rubs, mu = _fitted(rubs)
    determined, reason, interval = _judge(rubs, mu)
    rows, normal = surface.touched_row, surface.touched_normal
    # where the shape does not determine the turn about the antenna
    unknown = np.where(rubs.spread_across[:, None], 0.0, np.nan_to_num(axes.lateral))
    covariance = surface.touched_normal_covariance + unknown[:, :, None] * unknown[:, None, :]
    turned = variance_along(covariance, axes.lateral)
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


def _fitted(rubs: _FrictionTouches) -> tuple[_FrictionTouches, _Coefficient | None]:
    """The touches as used in the fit, and their coefficient, None where none is usable. Touches that slide to and fro
    within the time over which slips are averaged lie inside the cone: they no longer count as sliding."""
    for tries in range(FrictionSettings.relabelled, -1, -1):
        evidence = _FrictionAngles.of(rubs)
        if not len(evidence.touch):
            return rubs, None
        mu = _coefficient(evidence)
        best = int(np.argmin(mu.fits.cost))
        expected, off = evidence.expected(mu.fits.mu[best : best + 1])[0], mu.fits.off[best]
        inside = (
            evidence.slides & evidence.lateral & (np.abs(off) > FrictionSettings.wrong_std) & (off * expected < 0.0)
        )
        if not (tries and inside.any()):
            break
        which = evidence.touch[inside]
        used, slides = rubs.used_as.copy(), rubs.slides.copy()
        used[which], slides[which] = "sticking", False
        rubs = replace(rubs, used_as=used, slides=slides)
    return rubs, mu


def _update_normals(
    normals: Normals, axes: _Axes, rubs: _FrictionTouches, found: _Angles, mu: _Coefficient | None, largest_mu: float
) -> Normals:
    """The shape's normals, rotated about the antenna by the forces: for sliding touches by the fit of μ; for others,
    and where no μ fits, into the cone of `largest_mu`, inf where that is unknown."""
    lateral = axes.lateral
    before = np.maximum(variance_along(normals.covariance, lateral), 0.0)
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
    others = np.where(sound[:, None], np.nan_to_num(lateral), 0.0)
    stretched = np.sqrt(np.where(sound, variance, 1.0) / np.where(sound, before, 1.0)) - 1.0
    stretch = np.eye(3) + stretched[:, None, None] * others[:, :, None] * others[:, None, :]
    turned = np.cos(angle)[:, None] * base + np.sin(angle)[:, None] * others
    return Normals(turned, stretch @ normals.covariance @ np.swapaxes(stretch, 1, 2))


def _by_force(
    rubs: _FrictionTouches, found: _Angles, mu: _Coefficient | None, largest_mu: float, fitted: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (P,) and variances (P,) from the force alone: on the cone's rim in sliding touches, if μ is known,
    in others anywhere in it, approximated as Gaussian; none for touches that the fit has used."""
    whole = found.std_rad**2 + np.sum(found.modes_rad**2, axis=1)
    cone = np.arctan(largest_mu if np.isfinite(largest_mu) else FrictionSettings.unknown_mu) ** 2 / 3.0
    angle, variance = found.angle_rad, cone + whole
    if mu is not None and np.isfinite(largest_mu):
        rim = rubs.slides & ~rubs.across
        friction_angle = np.arctan(mu.mu * np.nan_to_num(rubs.slip[:, 0]))
        unsure = mu.std**2 + (mu.mu * np.nan_to_num(rubs.slip[:, 1] * rubs.slip_std_rad)) ** 2
        angle, variance = np.where(rim, angle + friction_angle, angle), np.where(rim, whole + unsure, variance)
    return angle, np.where(fitted, np.inf, variance)


def _by_fit(before: np.ndarray, rubs: _FrictionTouches, mu: _Coefficient) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotations (P,) and variances (P,) from the fit for the touches that took part, over the posterior of μ: due to
    their shared errors and each one's own. Also the residuals (P,), 0 within the cone."""
    modes = rubs.normal_modes_rad @ mu.axes.T
    beyond = np.sum(rubs.normal_modes_rad**2, axis=1) - np.sum(modes**2, axis=1)
    evidence = _FrictionAngles.of(rubs)
    side, touch = evidence.lateral, evidence.touch[evidence.lateral]
    total, square, off = np.zeros((3, len(rubs)))
    own, found = rubs.normal_std_rad[touch] ** 2, mu.fits
    spreads = max(mu.scatter, 1.0) * evidence.spread(found.mu)[:, side]
    for index in np.flatnonzero(mu.weight > 1e-6):
        weight, spread, error = mu.weight[index], spreads[index], found.off[index, side]
        sure = evidence.slides[side] & (np.abs(error) < FrictionSettings.wrong_std)
        share = np.where(sure, own / spread**2, 0.0)
        turn = modes @ found.modes[index]
        variance = np.einsum("pk,kl,pl->p", modes, found.covariance[index], modes, optimize=True) + beyond
        turn[touch] += share * error * spread
        variance += rubs.normal_std_rad**2
        variance[touch] -= share * own
        total += weight * turn
        square += weight * (variance + turn**2)
        off[touch] += weight * np.where(np.abs(error) < FrictionSettings.wrong_std, 0.0, error * spread)
    used = rubs.across
    return np.where(used, total, 0.0), np.where(used, np.maximum(square - total**2, 1e-12), before), off


@dataclass(frozen=True, eq=False)
class _Axes:
    """Orthonormal axes at P touches, world frame; NaN where the antenna's tangent is unknown.

    A smooth wire lies flat on what it touches: on its side the normal is taken less its part along the antenna, at its
    tip the tangent less its part along the normal.
    """

    normal: np.ndarray  # (P, 3) the shape's
    along: np.ndarray  # (P, 3) the antenna's tangent
    lateral: np.ndarray  # (P, 3) normal × along

    @staticmethod
    def of(normal: np.ndarray, tangent: np.ndarray, at_tip: np.ndarray) -> _Axes:
        """The axes from unit normals and tangents (P, 3). at_tip : (P,) mask of touches by the tip."""
        lateral = _unit(np.cross(normal, tangent))
        flat = _unit(np.cross(tangent, lateral))
        return _Axes(
            np.where(at_tip[:, None], normal, flat),
            np.where(at_tip[:, None], np.cross(lateral, normal), tangent),
            lateral,
        )


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., 3) scaled to length 1; NaN where they are zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 1e-9, length, np.nan)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Dot products (P,) of vectors (P, 3)."""
    return np.sum(a * b, axis=1)


def _force_directions(table: ContactTable, shared: CommonErrors, rows: np.ndarray, axes: _Axes) -> _Angles:
    """Angles (P,) of the forces in these rows from the normal, about the antenna, positive along `_Axes.lateral`."""
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
    return _Angles(angle, np.maximum(own, FrictionSettings.least_std_rad), modes)


def _spread_across(point_m: np.ndarray, own_m2: np.ndarray, axes: _Axes, patch: np.ndarray) -> np.ndarray:
    """(P,) mask of the points (P, 3), with own covariances (P, 3, 3), on patches (P,) that extend across the
    antenna; False where unknown."""
    same = patch[:, None] == patch
    apart = np.where(same, np.linalg.norm(point_m[:, None] - point_m, axis=-1), 0.0)
    extent = np.array([apart[patch == label].max() for label in patch])
    near = same & (apart <= FrictionSettings.near_share * extent[:, None])
    offset = point_m - point_m[:, None]
    sides, number = np.einsum("pni,api->apn", offset, np.stack([axes.lateral, axes.along])), near.sum(axis=1)
    mean = np.where(near, sides, 0.0).sum(axis=2) / number
    across, along = np.sqrt(np.where(near, (sides - mean[..., None]) ** 2, 0.0).sum(axis=2) / number)
    noise = np.sqrt(np.maximum(variance_along(own_m2, axes.lateral), 0.0))
    usual = np.array([np.median(noise[each]) for each in near])
    return (across > FrictionSettings.across_share * along) & (across > FrictionSettings.across_std * usual)


def _friction_touches(
    table: ContactTable, surface: Surface, track: Track, shared: CommonErrors, friction_rad: float
) -> tuple[_FrictionTouches, _Axes, _Angles]:
    """The touches of a surface, with axes and lateral force directions; see `friction`."""
    rows = surface.touched_row
    axes = _Axes.of(surface.touched_normal, table.tangent_world[rows], table.status[rows] == "tip_contact")
    found = _force_directions(table, shared, rows, axes)
    turned = variance_along(surface.touched_normal_covariance, axes.lateral)
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
    rubs = _FrictionTouches(
        used_as=np.where(across | along, np.where(slides, "sliding", "sticking"), "unused"),
        slides=slides,
        spread_across=side_by_side,
        lateral=_Angles(
            np.where(across, found.angle_rad, np.nan),
            np.hypot(found.std_rad, normal_std),
            np.where(across[:, None], lateral_modes, 0.0),
        ),
        normal_std_rad=normal_std,
        normal_modes_rad=np.where(across[:, None], normal_modes, 0.0),
        longitudinal=_Angles(
            np.where(along, seen.angle_rad, np.nan), seen.std_rad, np.where(along[:, None], longitudinal_modes, 0.0)
        ),
        slip=slip,
        slip_std_rad=slip_std,
    )
    return rubs, axes, found


def steady_slides(track: Track, time_s: np.ndarray) -> np.ndarray:
    """(B,) mask of frames that slide for certain: within a stretch of sliding in one direction."""
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
) -> _Angles:
    """The friction angles from the data alone, without their prior, with S + 1 shared errors; NaN where only the
    prior determined them, and at the tip, where the antenna's normal is not the object's."""
    estimated, std = table.friction_angle_rad[rows], table.friction_angle_std_rad[rows]
    before = max(friction_rad, float(np.nanmax(std, initial=1e-12)))
    seen = (std > 0.0) & (std < FrictionSettings.visible_share * before) & (table.status[rows] != "tip_contact")
    widened = 1.0 / (1.0 - np.where(seen, std / before, 0.0) ** 2)
    angle, whole = estimated * widened, std * np.sqrt(widened)
    if not shared.known:
        return _Angles(np.where(seen, angle, np.nan), whole, np.nan_to_num(whole)[:, None] * [0.0, 0.0, 1.0])
    force = table.force_world_N[rows]
    across = np.hypot(_dot(force, axes.normal), _dot(force, axes.lateral))[:, None]
    turned = -np.einsum("pi,pis->ps", axes.along, shared.force_N[rows]) / np.where(across > 0, across, np.nan)
    # the last common error is the prior's, which was taken out: to first order, so that half of that is in doubt
    doubt = np.stack([np.zeros(len(rows)), 0.5 * (angle - estimated)], axis=1)
    modes = np.hstack([turned[:, :-1] * widened[:, None], doubt])
    own = np.sqrt(
        np.maximum(whole**2 - np.sum(modes[:, :-1] ** 2, axis=1), (FrictionSettings.least_own_share * whole) ** 2)
    )
    return _Angles(np.where(seen, angle, np.nan), own, np.where(seen[:, None], modes, 0.0))
