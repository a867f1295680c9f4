"""Moment against curvature along a rod in a photograph, and the one EI, if any, that joins them.

The line is known all along, so the moment that weight and load make about each of its places is an integral over the
picture, whatever the slopes and whatever the material; nothing is linearised and no clamp is asked where it points.
With the moment M(s) the rod bends by

    θ′(s) = M(s)/EI + κ₀ + g(s)

κ₀ is the rod's own uniform bow, and g what curl it has beyond that: a Gaussian process whose size and length come from
the picture. Points of the line err by pixels, and their neighbours together. Position, direction and κ₀ are free. All
of this is linear about the line that was measured: the offset of a point at s from it, for curvatures that differ by
δκ(t), is ∫₀ˢ δκ(t) τ(s)·(r(s) − r(t)) dt, τ the tangent. So one generalised least squares gives 1/EI, with weights over
the unknown sizes and lengths by their restricted likelihood.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import block_diag, cho_factor, cho_solve
from scipy.special import fdtrc

from vbaa_calib.core.polyline import arc_lengths, beside, normals

_PIECES = 120  # of the rod; curvature is constant on each
_LEAST_INFORMATION = 1e-13  # added on each coefficient, as a part of the sum of all
_MOST_POINTS = 140
_CURLS = (0.0, *np.geomspace(0.01, 30.0, 8))  # standard deviations of curl, in radians per length of the rod
_CURL_LENGTHS = (0.03, 0.1, 0.3)  # over which curl is correlated, in lengths of the rod
_ERROR_LENGTHS = (0.0, 0.01, 0.03)  # over which points err together, in lengths of the rod
_SAMPLES = 20_000
_LAW_STEPS = 4  # of the moment, on each of which a law that is free is a cubic


@dataclass(frozen=True)
class Loading:
    """What bends the rod: weight per length and a dead load along `down`."""

    down: tuple[float, float]  # unit vector in the picture
    weight_N_m: float = 1.0  # 1 for results per weight
    load_N: float = 0.0
    load_at: float = 1.0  # the load's place as a share of the length

    def moments(self, curve: np.ndarray) -> np.ndarray:
        """(M,) bending moment at the places of an evenly spaced line (M, 2) in metres, in the sense of u to v."""
        along = arc_lengths(curve)
        lever = curve[:, 0] * self.down[1] - curve[:, 1] * self.down[0]
        between = 0.5 * (lever[1:] + lever[:-1]) * np.diff(along)
        beyond = np.append(np.cumsum(between[::-1])[::-1], 0.0) - lever * (along[-1] - along)
        at = self.load_at * along[-1]
        return self.weight_N_m * beyond + self.load_N * np.where(along < at, np.interp(at, along, lever) - lever, 0.0)


@dataclass(frozen=True, eq=False)
class PhotoView:
    """One photograph's line in metres, and what bent the rod in it."""

    points_m: np.ndarray  # (N, 2) measured
    curve_m: np.ndarray  # (M, 2) smooth, evenly spaced, clamp to tip
    loading: Loading

    @cached_property
    def middles_m(self) -> np.ndarray:
        """(K,) arc lengths in the middles of the pieces."""
        return (np.arange(_PIECES) + 0.5) / _PIECES * arc_lengths(self.curve_m)[-1]

    @cached_property
    def moment(self) -> np.ndarray:
        """(K,) bending moment there."""
        return np.interp(self.middles_m, arc_lengths(self.curve_m), self.loading.moments(self.curve_m))

    def at(self, s_m: np.ndarray) -> np.ndarray:
        """(N, 2) places on the smooth line at arc lengths (N,)."""
        along = arc_lengths(self.curve_m)
        return np.stack([np.interp(s_m, along, each) for each in self.curve_m.T], axis=1)

    @cached_property
    def rows(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Offsets (N,) that curvature explains, its effect on them (N, K), position and direction (N, 3), s/L (N,)."""
        along = arc_lengths(self.curve_m)
        normal = normals(self.curve_m)
        tangent = np.stack([normal[:, 1], -normal[:, 0]], axis=1)
        ends = np.linspace(0.0, along[-1], _PIECES + 1)
        angle = np.interp(ends, along, np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0])))
        points = self.points_m[:: -(-len(self.points_m) // _MOST_POINTS)]
        nearest = np.hypot(*(points[:, None] - self.curve_m).transpose(2, 0, 1)).argmin(axis=1)
        inner = (nearest > 0) & (nearest < len(along) - 1)
        points, nearest = points[inner], nearest[inner]
        tangent, normal, place, s = tangent[nearest], normal[nearest], self.curve_m[nearest], along[nearest]
        step = along[-1] / _PIECES
        effect = np.einsum("ni,nki->nk", tangent, place[:, None] - self.at(self.middles_m)) * step
        effect = np.where(self.middles_m < s[:, None], effect, 0.0)
        turn = np.einsum("ni,ni->n", tangent, place - self.curve_m[0])
        free = np.column_stack([normal, turn])
        return beside(self.curve_m, points)[1] + effect @ (np.diff(angle) / step), effect, free, s / along[-1]


def linear_law(views: Sequence[PhotoView], straight: bool = False) -> list[np.ndarray]:
    """(K, 2) per view: curvature by the moment over EI and by the rod's own bow; (K, 1) for a rod without bow."""
    return [np.stack([view.moment, np.ones(_PIECES)], axis=1)[:, : 2 - straight] for view in views]


def free_law(views: Sequence[PhotoView]) -> tuple[list[np.ndarray], np.ndarray]:
    """(K, P) per view: curvature as any smooth function of the moment; and rows that are 0 for a straight one."""
    moments = np.concatenate([view.moment for view in views])
    steps = np.linspace(moments.min(), moments.max(), _LAW_STEPS + 1)
    knots = np.concatenate([steps[[0, 0, 0]], steps, steps[[-1, -1, -1]]])
    middles = np.array([knots[i + 1 : i + 4].mean() for i in range(_LAW_STEPS + 3)])
    slopes = np.diff(np.eye(len(middles)), axis=0) / np.diff(middles)[:, None]
    laws = [BSpline.design_matrix(np.clip(view.moment, steps[0], steps[-1]), knots, 3).toarray() for view in views]
    return laws, np.diff(slopes, axis=0) * (steps[-1] - steps[0])


@dataclass(frozen=True, eq=False)
class Bending:
    """What one or two photographs say of a rod's bending, under H error models."""

    weights: np.ndarray  # (H,) probabilities
    values: np.ndarray  # (H, P) the law's coefficients
    covariances: np.ndarray  # (H, P, P)
    freedom: int  # degrees of freedom of each
    uncurled: float  # probability of no curl
    curl_std: float  # of the rod's own curl, 1/m
    error_std_m: float  # of the points

    def moments_of(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean (N,) and standard deviation (N,) of combinations of the coefficients (N, P)."""
        each = self.values @ rows.T
        mean = self.weights @ each
        own = np.einsum("np,hpq,nq->hn", rows, self.covariances, rows)
        return mean, np.sqrt(self.weights @ (np.maximum(own, 0.0) + (each - mean) ** 2))

    def p_value(self, rows: np.ndarray) -> float:
        """Probability of combinations (N, P) so far from zero where all of them are zero, by an F test."""
        each, spread = self.values @ rows.T, rows @ self.covariances @ rows.T
        square = np.einsum("hn,hn->h", each, np.linalg.solve(spread, each[..., None])[..., 0]) / len(rows)
        return float(self.weights @ fdtrc(len(rows), self.freedom, square))

    def quantiles(self, shares: Sequence[float], relative_std: float) -> np.ndarray:
        """Of the first coefficient, with an independent error of this relative standard deviation."""
        rng = np.random.default_rng(0)
        model = rng.choice(len(self.weights), _SAMPLES, p=self.weights)
        noise = np.sqrt(self.covariances[model, 0, 0]) * rng.standard_t(self.freedom, _SAMPLES)
        drawn = (self.values[model, 0] + noise) * np.exp(relative_std * rng.standard_normal(_SAMPLES))
        return np.quantile(drawn, shares)


def fit_bending(views: Sequence[PhotoView], laws: Sequence[np.ndarray]) -> Bending:
    """Coefficients of a law of curvature, given by its columns (K, P) for each view; all views have the same curl."""
    parts = [view.rows for view in views]
    data, effect, shares = (np.concatenate([part[i] for part in parts]) for i in (0, 1, 3))
    owner = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts])
    bent = np.concatenate([part[1] @ law for part, law in zip(parts, laws, strict=True)])
    design = np.column_stack([bent, block_diag(*(part[2] for part in parts))])
    sizes = np.linalg.norm(design, axis=0)
    design, count, freedom = design / sizes, bent.shape[1], len(data) - design.shape[1]
    length = arc_lengths(views[0].curve_m)[-1]
    pieces = (np.arange(_PIECES) + 0.5) / _PIECES
    # errors of different photographs are independent, however near the places
    apart = np.abs(np.subtract.outer(shares, shares)) + 1e9 * (owner[:, None] != owner)
    noise = 5e-4 * length

    def weighed(curl: float, curl_length: float, error_length: float) -> tuple[float, np.ndarray, np.ndarray, float]:
        """Restricted log-likelihood, coefficients, their covariance, and the variance relative to the noise."""
        process = (curl / length) ** 2 * np.exp(-np.abs(np.subtract.outer(pieces, pieces)) / curl_length)
        errors = np.eye(len(data))
        if error_length:
            errors = 0.2 * errors + 0.8 * np.exp(-apart / error_length)
        factor = cho_factor(noise**2 * errors + effect @ process @ effect.T, lower=True)
        weighted = cho_solve(factor, design)
        normal = design.T @ weighted
        # coefficients that the picture cannot tell apart become very uncertain, not impossible
        normal += _LEAST_INFORMATION * np.trace(normal) * np.eye(len(normal))
        found = np.linalg.solve(normal, weighted.T @ data)
        left = data - design @ found
        variance = float(left @ cho_solve(factor, left)) / freedom
        likelihood = -np.log(np.diag(factor[0])).sum() - 0.5 * np.linalg.slogdet(normal)[1]
        covariance = variance * np.linalg.inv(normal) / np.outer(sizes, sizes)
        return likelihood - 0.5 * freedom * np.log(variance), found / sizes, covariance, variance

    models = list(product(_CURLS, _CURL_LENGTHS, _ERROR_LENGTHS))
    fits = [weighed(*model) for model in models]
    logs, values, covariances, variances = (np.array(each) for each in zip(*fits, strict=True))
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    curls = np.array([curl for curl, *_ in models]) / length
    return Bending(
        weights,
        values[:, :count],
        covariances[:, :count, :count],
        freedom,
        float(weights[curls == 0.0].sum()),
        float(np.sqrt(weights @ (variances * curls**2))),
        noise * float(np.sqrt(weights @ variances)),
    )
