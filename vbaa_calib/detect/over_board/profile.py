"""Profiles across a line in front of a board: the fit of its centre and cover, its paint, the shadow beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from .picture import BoardPicture

_GAUSS_NEWTON = 5
_CAPTURE_PX = 2.5
_LEAST_FLANK, _LEAST_GRAIN = 3, 0.01
_BLACK = 0.08
"""What black print reflects, in units of the print: a shadow dims white, and black hardly."""
_EDGE_DOUBT_PX, _EDGE_REACH = 0.5, 1.5
"""Where the line crosses an edge of the pattern, the edge's place is in doubt by so much, over so many widths."""


@dataclass(frozen=True, eq=False)
class Profiles:
    """Raw pixels along N columns (or rows) that a guide crosses, T of each, in units of the board's print.

    Attributes
    ----------
    crossing_px : (N, 2) where the guide crosses the middle of each column.
    axis : the pixel coordinate along the profiles: 1 (v) where the guide runs sideways, 0 (u) where upward.
    stretch : (N,) length along the profile per length across the line, at most about √2.
    across : (N, T) place along the profile from the guide, px.
    seen, behind : (N, T) picture, and what is behind the line, as far as it is known.
    slope, noise : (N, T) the pattern's, 1/px; standard deviation of `seen - behind`, inf outside the picture.
    """

    crossing_px: np.ndarray
    axis: int
    stretch: np.ndarray
    across: np.ndarray
    seen: np.ndarray
    behind: np.ndarray
    slope: np.ndarray
    noise: np.ndarray

    def centred(self, centre: np.ndarray) -> np.ndarray:
        """(N, 2) pixels at distances (N,) along the profiles from the guide."""
        points = self.crossing_px.copy()
        points[:, self.axis] += centre
        return points


@dataclass(frozen=True)
class Paint:
    """The line: brightness in units of the print, how much of a pixel it covers at its middle, its Gaussian width."""

    brightness: float
    cover: float
    scale_px: float


@dataclass(frozen=True, eq=False)
class Fitted:
    """Lines fitted to N profiles: centre along the profile from the guide, px; cover over the expected one (amplitude).

    chi : root mean square of the residuals over their noise. All (N,).
    """

    centre: np.ndarray
    centre_std: np.ndarray
    amplitude: np.ndarray
    amplitude_std: np.ndarray
    chi: np.ndarray


def profiles(picture: BoardPicture, guide_px: np.ndarray, core_px: float) -> Profiles:
    """Cut the columns (rows) out of a picture along a guide (K, 2), one column a pixel.

    Off the board, where the pattern is NaN, what is behind the line is a slope of light through its flanks, which begin
    `core_px` off the guide.
    """
    axis = 1 if np.ptp(guide_px[:, 0]) >= np.ptp(guide_px[:, 1]) else 0
    run = guide_px[:, 1 - axis]
    order = np.argsort(run, kind="stable")
    columns = np.arange(np.ceil(run.min()), np.floor(run.max()) + 1)
    cross = np.interp(columns, run[order], guide_px[order, axis])
    slope = np.gradient(cross) if len(cross) > 1 else np.zeros(1)
    half = int(np.ceil(2.0 * core_px + 4.0))
    place = np.round(cross)[:, None] + np.arange(-half, half + 1)
    where = np.stack(np.broadcast_arrays(columns[:, None], place)[:: 1 if axis == 1 else -1]).astype(int)
    size = np.array(picture.seen.shape[::-1])[:, None, None]
    inside = ((where >= 0) & (where < size)).all(axis=0)
    u, v = np.clip(where, 0, size - 1)
    across = place - cross[:, None]
    grey, known, noise, edge = (
        values[v, u].astype(float) for values in (picture.seen, picture.pattern, picture.noise, picture.slope)
    )
    edge = np.where(np.isnan(known), 0.0, edge)
    behind, grain = _with_flanks(grey, known, inside & (np.abs(across) > core_px), across, noise)
    crossing = np.stack([columns, cross][:: 1 if axis == 1 else -1], axis=1)
    grain = np.where(inside & np.isfinite(behind), grain, np.inf)
    return Profiles(crossing, axis, np.sqrt(1.0 + slope**2), across, grey, behind, edge, grain)


def _with_flanks(
    grey: np.ndarray, known: np.ndarray, beside: np.ndarray, across: np.ndarray, noise: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """`known` (N, T) with NaN replaced by a straight line through the same profile's flanks, and the noise there."""
    off_board = np.isnan(known)
    weight = (beside & off_board).astype(float)
    sides = [weight * (across < 0), weight * (across > 0)]
    counts = [side.sum(axis=1) for side in sides]
    left, right = ((side * grey).sum(axis=1) / np.maximum(n, 1) for side, n in zip(sides, counts, strict=True))
    total = weight.sum(axis=1, keepdims=True)
    middle, mean = ((weight * values).sum(axis=1, keepdims=True) / np.maximum(total, 1.0) for values in (across, grey))
    spread = (weight * (across - middle) ** 2).sum(axis=1, keepdims=True)
    slope = (weight * (across - middle) * (grey - mean)).sum(axis=1, keepdims=True) / np.maximum(spread, 1.0)
    line = mean + slope * (across - middle)
    grain = np.sqrt((weight * (grey - line) ** 2).sum(axis=1, keepdims=True) / np.maximum(total - 2, 1.0))
    # an edge of the sheet between the flanks is no straight slope of light
    doubt = np.hypot(grain + _LEAST_GRAIN, (left - right)[:, None])
    enough = (np.min(counts, axis=0) >= _LEAST_FLANK)[:, None]
    return np.where(off_board, np.where(enough, line, np.nan), known), np.where(off_board, doubt, noise)


def fit(
    cut: Profiles, paint: Paint, start: float | np.ndarray = 0.0, steps: int = _GAUSS_NEWTON, wary: bool = False
) -> Fitted:
    """Weighted Gauss–Newton for the line's centre and cover in a light of its own and its slope, all profiles at once.

    The line hides what is behind it: at each pixel it adds its cover times (its brightness − what is behind).

    start : (N,) px from the guide, where each line is looked for. wary : trust pixels less where the guide runs over
        an edge of the pattern: the picture shows the blur of what the line leaves of the edge, the model the line's
        blur times the edge's.
    """
    width = paint.scale_px * cut.stretch[:, None]
    variance = cut.noise**2
    if wary:
        near = np.exp(-0.5 * (cut.across / (_EDGE_REACH * width)) ** 2)
        variance = variance + (_EDGE_DOUBT_PX * paint.cover * cut.slope * near) ** 2
    weight = 1.0 / variance
    usable = weight > 0
    behind = np.where(usable, np.nan_to_num(cut.behind), 0.0)
    change = np.where(usable, cut.seen - behind, 0.0)
    against = paint.cover * (paint.brightness - behind)
    light = behind + _BLACK
    reach = np.abs(cut.across).max()
    centre = np.zeros(len(cut.stretch)) + start
    for _ in range(max(steps, 1)):
        t = (cut.across - centre[:, None]) / width
        line = np.exp(-0.5 * t**2) * against
        basis = np.stack([light, light * cut.across / reach, line, line * t / width], axis=-1)
        weighted = basis * weight[..., None]
        information = np.swapaxes(weighted, 1, 2) @ basis
        information += np.eye(4) * (1e-9 * np.trace(information, axis1=1, axis2=2)[:, None, None] + 1e-9)
        inverse = np.linalg.inv(information)
        found = (inverse @ (np.swapaxes(weighted, 1, 2) @ change[..., None]))[..., 0]
        amplitude = np.where(np.abs(found[:, 2]) > 0.05, found[:, 2], 0.05)
        if steps:
            centre = np.clip(centre + np.clip(found[:, 3] / amplitude, -1.0, 1.0), -reach, reach)
    residual = np.where(usable, change - (basis @ found[..., None])[..., 0], 0.0) * np.sqrt(weight)
    freedom = np.maximum(usable.sum(axis=1) - 4, 1)
    std = np.sqrt(np.clip(np.diagonal(inverse, axis1=1, axis2=2), 0.0, None))
    chi = np.sqrt((residual**2).sum(axis=1) / freedom)
    return Fitted(centre, std[:, 3] / np.abs(amplitude), found[:, 2], std[:, 2], chi)


def presence(cut: Profiles, paint: Paint) -> tuple[np.ndarray, np.ndarray]:
    """How much of the line is there on the guide itself, (N,): about 1 where it is, 0 where not; and its std (N,)."""
    there = fit(cut, paint, steps=0)
    return there.amplitude, there.amplitude_std * np.maximum(there.chi, 1.0)


def rough_centres(cut: Profiles, paint: Paint) -> np.ndarray:
    """(N,) where along each profile the line fits best, to half a pixel, within a few pixels of the guide."""
    candidates = np.arange(-_CAPTURE_PX, _CAPTURE_PX + 0.1, 0.5)
    tried = [fit(cut, paint, place, steps=0) for place in candidates]
    gain = [np.where(one.amplitude > 0, one.amplitude / np.maximum(one.amplitude_std, 1e-9), 0.0) for one in tried]
    return candidates[np.argmax(gain, axis=0)]


def fit_paint(cut: Profiles, paint: Paint) -> Paint:
    """The brightness and cover of the line on the guide from all profiles together; then its width."""
    usable = np.isfinite(cut.noise)
    behind = np.where(usable, np.nan_to_num(cut.behind), 0.0)
    shape = np.exp(-0.5 * (cut.across / (paint.scale_px * cut.stretch[:, None])) ** 2)
    near = usable & (shape > 0.1)
    basis = np.stack([shape[near], -(shape * behind)[near]], axis=1) / cut.noise[near][:, None]
    change = (cut.seen - behind)[near] / cut.noise[near]
    weight = np.ones(len(change))
    for _ in range(4):
        found = np.linalg.lstsq(basis * weight[:, None], change * weight, rcond=None)[0]
        residual = np.abs(change - basis @ found)
        weight = np.sqrt(np.minimum(1.0, 2.0 * float(np.median(residual)) / np.maximum(residual, 1e-9)))
    cover = float(found[1])
    brightness = float(found[0]) / cover if cover > 1e-3 else paint.brightness
    if cover < 1e-3:
        return Paint(brightness, cover, paint.scale_px)

    def misfit(scale: float) -> float:
        return float(np.median(fit(cut, Paint(brightness, cover, scale), steps=2).chi))

    bounds = 0.5 * paint.scale_px, 2.0 * paint.scale_px
    best = minimize_scalar(misfit, bounds=bounds, method="bounded", options={"xatol": 0.02})
    return Paint(brightness, cover, float(best.x))


BESIDE = 2.5
"""How much wider than usual the profiles are cut to look for a shadow."""
_STRETCHES, _LEAST_WHITE = 6, 4
_WHITE, _FLAT = 0.9, 0.05


def darkest_beside(cut: Profiles, core_px: float) -> float:
    """How much darker white print is, in units of the print, along the darkest band beside a line.

    The middle one of a few stretches: the shadow of a sagging antenna is not parallel to it. `core_px` is how far the
    line itself reaches to either side.
    """
    white = np.isfinite(cut.noise) & (cut.slope < _FLAT) & (cut.behind > _WHITE) & (np.abs(cut.across) > core_px)
    parts = (np.array_split(values, _STRETCHES) for values in (white, np.round(cut.across), cut.behind - cut.seen))
    depths = []
    for chosen, place, dimmed in zip(*parts, strict=True):
        if chosen.any():
            column = (place[chosen] - place[chosen].min()).astype(int)
            count = np.bincount(column)
            means = np.bincount(column, dimmed[chosen]) / np.maximum(count, 1)
            depths.append(float(means[count >= _LEAST_WHITE].max(initial=0.0)))
    return float(np.median(depths)) if depths else 0.0
