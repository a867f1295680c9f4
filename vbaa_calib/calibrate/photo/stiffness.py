"""EI of a rod from its centreline in one photograph, with the uncertainty of scale, gravity's direction and camera
tilt."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import block_diag, cho_factor, cho_solve
from scipy.special import fdtrc

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.polyline import arc_lengths, normals, offsets_from

from .centreline import RodLine
from .settings import RodSettings


@dataclass(frozen=True)
class _Loading:
    """Forces on the rod: weight per length and a dead load, both along `down`."""

    down: tuple[float, float]  # unit vector in the picture
    weight_N_m: float = 1.0  # 1 for results per weight
    load_N: float = 0.0
    load_at: float = 1.0  # the load's place as a share of the length

    def moments(self, curve: np.ndarray) -> np.ndarray:
        """(M,) bending moments along an evenly spaced line (M, 2) m, positive from u to v."""
        along = arc_lengths(curve)
        lever = curve[:, 0] * self.down[1] - curve[:, 1] * self.down[0]
        between = 0.5 * (lever[1:] + lever[:-1]) * np.diff(along)
        beyond = np.append(np.cumsum(between[::-1])[::-1], 0.0) - lever * (along[-1] - along)
        at = self.load_at * along[-1]
        return self.weight_N_m * beyond + self.load_N * np.where(along < at, np.interp(at, along, lever) - lever, 0.0)


@dataclass(frozen=True, eq=False)
class _PhotoView:
    """One photograph's centreline in metres, and the forces that bend the rod in it."""

    points_m: np.ndarray  # (N, 2) measured
    curve_m: np.ndarray  # (M, 2) smooth, evenly spaced, clamp to tip
    loading: _Loading

    @cached_property
    def middles_m(self) -> np.ndarray:
        """(K,) arc lengths of the pieces' middles."""
        return (np.arange(RodSettings.pieces) + 0.5) / RodSettings.pieces * arc_lengths(self.curve_m)[-1]

    @cached_property
    def moment(self) -> np.ndarray:
        """(K,) bending moments at the pieces' middles."""
        return np.interp(self.middles_m, arc_lengths(self.curve_m), self.loading.moments(self.curve_m))

    def at(self, s_m: np.ndarray) -> np.ndarray:
        """(N, 2) points of the smooth line at arc lengths (N,)."""
        along = arc_lengths(self.curve_m)
        return np.stack([np.interp(s_m, along, each) for each in self.curve_m.T], axis=1)

    @cached_property
    def rows(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Design of the fit: the points' lateral offsets (N,) that curvature explains, their derivatives by curvature
        (N, K) and by position and direction (N, 3), and s/L (N,)."""
        along = arc_lengths(self.curve_m)
        normal = normals(self.curve_m)
        tangent = np.stack([normal[:, 1], -normal[:, 0]], axis=1)
        ends = np.linspace(0.0, along[-1], RodSettings.pieces + 1)
        angle = np.interp(ends, along, np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0])))
        points = self.points_m[:: -(-len(self.points_m) // RodSettings.most_points)]
        nearest = np.hypot(*(points[:, None] - self.curve_m).transpose(2, 0, 1)).argmin(axis=1)
        inner = (nearest > 0) & (nearest < len(along) - 1)
        points, nearest = points[inner], nearest[inner]
        tangent, normal, place, s = tangent[nearest], normal[nearest], self.curve_m[nearest], along[nearest]
        step = along[-1] / RodSettings.pieces
        effect = np.einsum("ni,nki->nk", tangent, place[:, None] - self.at(self.middles_m)) * step
        effect = np.where(self.middles_m < s[:, None], effect, 0.0)
        turn = np.einsum("ni,ni->n", tangent, place - self.curve_m[0])
        free = np.column_stack([normal, turn])
        return offsets_from(self.curve_m, points)[1] + effect @ (np.diff(angle) / step), effect, free, s / along[-1]


def _linear_law(views: Sequence[_PhotoView], straight: bool = False) -> list[np.ndarray]:
    """Columns (K, 2) of each view's linear law of curvature: the moment for 1/EI, ones for the rod's own bow.

    straight : a rod without bow, (K, 1).
    """
    return [np.stack([view.moment, np.ones(RodSettings.pieces)], axis=1)[:, : 2 - straight] for view in views]


def _free_law(views: Sequence[_PhotoView]) -> tuple[list[np.ndarray], np.ndarray]:
    """Per view columns (K, P) of a law in which curvature is any smooth function of the moment; and contrast rows
    that are 0 where that function is linear."""
    moments = np.concatenate([view.moment for view in views])
    steps = np.linspace(moments.min(), moments.max(), RodSettings.law_steps + 1)
    knots = np.concatenate([steps[[0, 0, 0]], steps, steps[[-1, -1, -1]]])
    middles = np.array([knots[i + 1 : i + 4].mean() for i in range(RodSettings.law_steps + 3)])
    slopes = np.diff(np.eye(len(middles)), axis=0) / np.diff(middles)[:, None]
    laws = [BSpline.design_matrix(np.clip(view.moment, steps[0], steps[-1]), knots, 3).toarray() for view in views]
    return laws, np.diff(slopes, axis=0) * (steps[-1] - steps[0])


@dataclass(frozen=True, eq=False)
class _Bending:
    """Posterior of a rod's bending law from one or two photographs, under H error models."""

    weights: np.ndarray  # (H,) probabilities
    values: np.ndarray  # (H, P) the law's coefficients
    covariances: np.ndarray  # (H, P, P)
    freedom: int  # degrees of freedom of each
    uncurled: float  # probability of no curl
    curl_std: float  # of the rod's own curl, 1/m
    error_std_m: float  # of the points

    def moments_of(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Means (N,) and standard deviations (N,) of linear combinations (N, P) of the coefficients."""
        each = self.values @ rows.T
        mean = self.weights @ each
        own = np.einsum("np,hpq,nq->hn", rows, self.covariances, rows)
        return mean, np.sqrt(self.weights @ (np.maximum(own, 0.0) + (each - mean) ** 2))

    def p_value(self, rows: np.ndarray) -> float:
        """p-value of the hypothesis that linear combinations (N, P) of the coefficients are all zero, by an F test."""
        each, spread = self.values @ rows.T, rows @ self.covariances @ rows.T
        square = np.einsum("hn,hn->h", each, np.linalg.solve(spread, each[..., None])[..., 0]) / len(rows)
        return float(self.weights @ fdtrc(len(rows), self.freedom, square))

    def quantiles(self, shares: Sequence[float], relative_std: float) -> np.ndarray:
        """Quantiles of the first coefficient, including an independent error of relative standard deviation
        `relative_std`."""
        rng = np.random.default_rng(0)
        model = rng.choice(len(self.weights), RodSettings.samples, p=self.weights)
        noise = np.sqrt(self.covariances[model, 0, 0]) * rng.standard_t(self.freedom, RodSettings.samples)
        drawn = (self.values[model, 0] + noise) * np.exp(relative_std * rng.standard_normal(RodSettings.samples))
        return np.quantile(drawn, shares)


def _fit_bending(views: Sequence[_PhotoView], laws: Sequence[np.ndarray]) -> _Bending:
    """Fits a law of curvature with columns (K, P) for each view; all views share the rod's own curl."""
    parts = [view.rows for view in views]
    data, effect, shares = (np.concatenate([part[i] for part in parts]) for i in (0, 1, 3))
    owner = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts])
    bent = np.concatenate([part[1] @ law for part, law in zip(parts, laws, strict=True)])
    design = np.column_stack([bent, block_diag(*(part[2] for part in parts))])
    sizes = np.linalg.norm(design, axis=0)
    design, count, freedom = design / sizes, bent.shape[1], len(data) - design.shape[1]
    length = arc_lengths(views[0].curve_m)[-1]
    pieces = (np.arange(RodSettings.pieces) + 0.5) / RodSettings.pieces
    # errors of different photographs are independent, however near the places
    apart = np.abs(np.subtract.outer(shares, shares)) + 1e9 * (owner[:, None] != owner)
    noise = 5e-4 * length

    def weighed(curl: float, curl_length: float, error_length: float) -> tuple[float, np.ndarray, np.ndarray, float]:
        """Restricted log-likelihood, coefficients, their covariance, and the variance relative to the noise, under
        one error model."""
        process = (curl / length) ** 2 * np.exp(-np.abs(np.subtract.outer(pieces, pieces)) / curl_length)
        errors = np.eye(len(data))
        if error_length:
            errors = 0.2 * errors + 0.8 * np.exp(-apart / error_length)
        factor = cho_factor(noise**2 * errors + effect @ process @ effect.T, lower=True)
        weighted = cho_solve(factor, design)
        normal = design.T @ weighted
        # coefficients that the picture cannot tell apart become very uncertain, not impossible
        normal += RodSettings.least_information * np.trace(normal) * np.eye(len(normal))
        found = np.linalg.solve(normal, weighted.T @ data)
        left = data - design @ found
        variance = float(left @ cho_solve(factor, left)) / freedom
        likelihood = -np.log(np.diag(factor[0])).sum() - 0.5 * np.linalg.slogdet(normal)[1]
        covariance = variance * np.linalg.inv(normal) / np.outer(sizes, sizes)
        return likelihood - 0.5 * freedom * np.log(variance), found / sizes, covariance, variance

    models = list(product(RodSettings.curls, RodSettings.curl_lengths, RodSettings.error_lengths))
    fits = [weighed(*model) for model in models]
    logs, values, covariances, variances = (np.array(each) for each in zip(*fits, strict=True))
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    curls = np.array([curl for curl, *_ in models]) / length
    return _Bending(
        weights,
        values[:, :count],
        covariances[:, :count, :count],
        freedom,
        float(weights[curls == 0.0].sum()),
        float(np.sqrt(weights @ (variances * curls**2))),
        noise * float(np.sqrt(weights @ variances)),
    )


@dataclass(frozen=True)
class PhotoSetting:
    """What is known of the photographs apart from the centrelines: scale, loads, gravity."""

    length_m: float | None = None  # of the rod, from clamp to tip; None where marks give the scale
    marks_px: np.ndarray | None = None  # two marks (2, 2) in the plane of the rod
    marks_m: float = 0.0  # their distance
    down_rad: float = 0.0  # gravity's direction, from down the picture towards its right side
    weight_N_m: float | None = None  # None for EI per weight, or where the weight is negligible next to a load
    load_N: float = 0.0
    load_m: float | None = None  # place of the load along the rod; None for its tip
    straight: bool = False  # the free rod is straight
    scale_std: float = 0.01  # relative
    down_std_rad: float = np.radians(1.0)
    tilt_std_rad: float = np.radians(3.0)

    @property
    def per_weight(self) -> bool:
        """Whether EI is estimated per weight, in m³."""
        return self.weight_N_m is None and self.load_N == 0.0


@dataclass(frozen=True, eq=False)
class PhotoStiffness:
    """EI, or EI per weight, with the law of moment against curvature."""

    inverse: float  # 1/EI
    inverse_std: float  # with all deviations
    interval: tuple[float, float]  # 95 % of EI; infinite at the upper end where the line gives no bound, from 0 on
    # where the rod bends against its load
    shares: dict[str, float]  # relative standard deviation of EI by cause
    views: list[_PhotoView]  # as fitted
    linear: _Bending  # fit of one EI
    free: _Bending  # fit of curvature as any smooth function of the moment
    curvature: np.ndarray  # (K,) of the free fit
    curvature_std: np.ndarray  # (K,)
    curved_p: float  # probability of a relation so far from a straight line if it is one

    @property
    def determined(self) -> bool:
        """Whether the line determines EI: whether its interval is bounded on both sides."""
        return bool(np.isfinite(self.interval[1]))


def solve_photo(lines: Sequence[RodLine], setting: PhotoSetting) -> PhotoStiffness:
    """EI from the centreline of the bent rod and, optionally, a second one of the unloaded rod: hanging without its
    load, or lying flat where its weight is the only load.

    Raises InputError where no bending is seen, or load and scale are impossible.
    """
    if not all(line.tip_inside for line in lines):
        what = "the rod's tip is not seen: it is outside the picture, or something is next to it"
        raise InputError(what, remedy="photograph all of it, or say where: --tip U,V")
    views = _views(lines, setting)
    linear = _fit_bending(views, _linear_law(views, setting.straight))
    laws, departures = _free_law(views)
    free = _fit_bending(views, laws)
    inverse = float(linear.weights @ linear.values[:, 0])

    def again(changed: PhotoSetting, turn: tuple[float, float] = (0.0, 0.0)) -> float:
        """Relative change of 1/EI under a changed setting or plane."""
        other = _views(lines, changed, turn)
        fit = _fit_bending(other, _linear_law(other, changed.straight))
        return float(fit.weights @ fit.values[:, 0]) / inverse - 1.0

    tilt = setting.tilt_std_rad
    about = [(-tilt, 0.0), (tilt, 0.0)], [(0.0, -tilt), (0.0, tilt)]
    downs = [replace(setting, down_rad=setting.down_rad + sign * setting.down_std_rad) for sign in (-1.0, 1.0)]
    power = 2.0 if setting.weight_N_m is None and setting.load_N else 3.0
    shares = {
        "scale": power * setting.scale_std,
        "gravity": _rms([again(each) for each in downs]),
        "tilt": float(np.linalg.norm([_rms([again(setting, turn) for turn in pair]) for pair in about])),
    }
    other = float(np.sqrt(sum(share**2 for share in shares.values())))
    own = float(linear.moments_of(np.eye(linear.values.shape[1])[:1])[1][0])
    low, high = linear.quantiles((0.025, 0.975), other)
    if high <= 0.0 and not _bends(views[0], lines[0], inverse):
        high = -low
    curvature, curvature_std = free.moments_of(laws[0])
    return PhotoStiffness(
        inverse,
        float(np.hypot(own, other * inverse)),
        (1.0 / high if high > 0.0 else 0.0, 1.0 / low if low > 0.0 else np.inf),
        {"line": own / abs(inverse), **shares},
        views,
        linear,
        free,
        curvature,
        curvature_std,
        free.p_value(departures),
    )


def _bends(view: _PhotoView, line: RodLine, inverse: float, least_px: float = 0.2) -> bool:
    """Whether a compliance 1/EI of `inverse` bends the rod by more than the edges' uncertainty, beyond a shift and
    rotation."""
    _, effect, free, _ = view.rows
    offsets = effect @ (view.moment * inverse)
    offsets -= free @ np.linalg.lstsq(free, offsets, rcond=None)[0]
    return bool(_rms(offsets.tolist()) * line.length_px > least_px * float(arc_lengths(view.curve_m)[-1]))


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _views(lines: Sequence[RodLine], setting: PhotoSetting, turn: tuple[float, float] = (0.0, 0.0)) -> list[_PhotoView]:
    """The centrelines in metres, for a rod's plane rotated about the picture's axes by `turn`, rad."""
    views = []
    down = (float(np.sin(setting.down_rad)), float(np.cos(setting.down_rad)))
    weight = setting.weight_N_m if setting.weight_N_m is not None else float(setting.per_weight)
    for index, line in enumerate(lines):
        middle, far = line.centre_px, RodSettings.camera_lengths * line.length_px
        points, curve = (_turned(each - middle, turn, far) for each in (line.points_px, line.curve_px))
        length = float(np.hypot(*np.diff(curve, axis=0).T).sum())
        if setting.marks_px is not None:
            scale = setting.marks_m / float(
                np.hypot(*np.diff(_turned(setting.marks_px - middle, turn, far), axis=0)[0])
            )
        else:
            scale = (setting.length_m or 0.0) / length
        share = 1.0 if setting.load_m is None else setting.load_m / (scale * length)
        if share > 1.02:
            what = f"the load at {setting.load_m:g} m is beyond the tip, at {scale * length:.3g} m"
            raise InputError(what, remedy="give --distance along the rod, from the clamp, in metres")
        loading = _Loading(down, weight, setting.load_N, min(share, 1.0))
        if index:  # without its load, or lying flat
            loading = _Loading(down, weight if setting.load_N else 0.0)
        views.append(_PhotoView(scale * points, scale * curve, loading))
    return views


def _turned(points: np.ndarray, turn: tuple[float, float], far: float) -> np.ndarray:
    """(N, 2) points in a plane, rotated about its vertical and horizontal axes, that a camera at distance `far` sees
    at `points`."""
    for axis, angle in enumerate(turn):
        if angle:
            place = points[:, axis] * far / (far * np.cos(angle) - points[:, axis] * np.sin(angle))
            rest = points[:, 1 - axis] * (far + place * np.sin(angle)) / far
            points = np.stack([place, rest] if axis == 0 else [rest, place], axis=1)
    return points
