"""The middle line of a ribbon along a coarse path, from both its edges, and the evidence that it is a rod.

Pixel (0, 0) is the middle of the upper left one. Edges are where the rod's colour gives way to the background's on that
side, searched from the inside, so that hairs that stick out do not count. Hairs that lie along the rod do: points at
which it is wider or narrower than near by are left out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.interpolate import make_smoothing_spline
from scipy.ndimage import median_filter, uniform_filter1d

from vbaa_calib.core.polyline import arc_lengths, beside, normals
from vbaa_calib.core.robust import NORMAL_QUARTILE, huber_weights, mad_std

from .candidates import RodPath, shading_of
from .settings import RodSettings


@dataclass(frozen=True, eq=False)
class Strip:
    """A picture's planes straightened along a curve: (channels, S, A), at stations (S, 2) and places across (A,)."""

    values: np.ndarray
    stations_px: np.ndarray
    normals: np.ndarray
    across_px: np.ndarray
    inside: np.ndarray  # (S, A)

    @staticmethod
    def along(planes: np.ndarray, curve: np.ndarray, spacing: float, reach: float, fine: float) -> Strip:
        """The strip to `reach` on either side of a finely and evenly spaced curve (M, 2)."""
        each = max(1, round(spacing / max(arc_lengths(curve[:2])[-1], 1e-9)))
        stations, normal = curve[::each], normals(curve)[::each]
        across = np.arange(-np.ceil(reach / fine), np.ceil(reach / fine) + 1) * fine
        places = stations[:, None] + across[:, None] * normal[:, None]
        u, v = (np.ascontiguousarray(places[..., axis], np.float32) for axis in range(2))
        border = cv2.BORDER_REPLICATE
        values = np.stack([cv2.remap(plane, u, v, cv2.INTER_LINEAR, borderMode=border) for plane in planes])
        last = np.array(planes.shape[:0:-1]) - 1.0
        inside = np.all((places >= 0.0) & (places <= last), axis=-1)
        return Strip(values, stations, normal, across, inside)

    def colours(self, low: float, high: float, smooth: int = 1) -> np.ndarray:
        """(channels, S) median colour between two places across; outside the picture as nearest to there within."""
        columns = (self.across_px >= low) & (self.across_px <= high)
        values = np.where(self.inside[:, columns], self.values[:, :, columns], np.nan)
        with np.errstate(invalid="ignore"):
            known = self.inside[:, columns].mean(axis=1) > 0.3
            found = np.full(values.shape[:2], np.nan)
            if known.any():
                found[:, known] = np.nanmedian(values[:, known], axis=2)
        if smooth > 1 and known.sum() > 3:
            size = min(smooth | 1, (int(known.sum()) - 1) | 1)
            found[:, known] = median_filter(found[:, known], (1, size), mode="nearest")
        return found


@dataclass(frozen=True, eq=False)
class MeasuredRod:
    """A fitted line and what speaks for it."""

    points_px: np.ndarray
    curve_px: np.ndarray
    width_px: float
    wander_px: float
    inside: tuple[bool, bool]  # whether the rod ends within the picture, at its first and its last end
    holder: tuple[float, float]  # log odds that something else than background is beyond either end
    goes_on_px: np.ndarray | None  # an end beyond which something as wide and of its colour goes on
    gap_px: np.ndarray | None  # the middle of a long piece without evidence
    evidence: float  # log odds of a rod against background
    parts: dict[str, float]

    @property
    def hangs(self) -> bool:
        """Whether it comes from the picture's border and ends before plain background."""
        return self.inside[0] != self.inside[1] and self.holder[0 if self.inside[0] else 1] < 0.0

    def moved(self, by: np.ndarray) -> MeasuredRod:
        """The same in a picture with its first pixel that far (2,) up and to the left."""
        gap = None if self.gap_px is None else self.gap_px + by
        end = None if self.goes_on_px is None else self.goes_on_px + by
        return replace(self, points_px=self.points_px + by, curve_px=self.curve_px + by, gap_px=gap, goes_on_px=end)

    def alone(self, settings: RodSettings) -> MeasuredRod:
        """The same where nothing is known of the ends: a rod's tip is before the background, within the picture."""
        tip = min(
            odds if inside else settings.no_tip_cost for odds, inside in zip(self.holder, self.inside, strict=True)
        )
        # straight things that end in the picture are everywhere
        straight = all(self.inside) and self.parts["net"] < settings.least_turn
        return replace(self, evidence=(self.evidence - max(0.0, tip)) * (settings.straight_share if straight else 1.0))


def smoothed(planes: np.ndarray) -> np.ndarray:
    """Planes with less noise, in which edges are searched."""
    return np.stack([cv2.GaussianBlur(each, (0, 0), 0.7) for each in planes])


def fitted(
    planes: np.ndarray,
    noise: np.ndarray,
    path: RodPath,
    first: np.ndarray | None,
    last: np.ndarray | None,
    settings: RodSettings,
) -> MeasuredRod | None:
    """The line along a path, from its first end to its last where these are known; None where it has no edges."""
    width = path.width_px
    coarse = path.path_px
    curve = _smooth(coarse, np.ones(len(coarse)), max(width, settings.least_smoothing_px))
    points, misses = np.zeros((0, 2)), np.zeros(0)
    share = 0.0
    spread = np.hypot(noise, shading_of(len(planes), settings))
    for round_ in range(settings.fit_rounds):
        off = 0.5 if round_ == 0 else 0.2
        points, widths, share = _edges(planes, spread, curve, width, off, settings.edge_contrast)
        if len(points) < settings.least_points:
            return None
        width = _median_width(widths, width)
        widths = np.where(np.isfinite(widths), widths, width)
        usual = median_filter(widths, 9, mode="mirror")
        kept = np.abs(widths - usual) < settings.width_tolerance * max(mad_std(widths - usual), 0.02 * width)
        points = points[kept]
        if len(points) < settings.least_points:
            return None
        scale = max(
            settings.smoothing_widths * width,
            settings.least_smoothing_px,
            settings.smoothing_share * arc_lengths(points)[-1],
        )
        curve, misses = _robust(points, scale, width)
        if not np.isfinite(curve).all() or arc_lengths(curve)[-1] > 1.5 * arc_lengths(coarse)[-1] + 8.0 * width:
            return None
    # points beyond the ends are no rod's, and would bend the line there
    on, inside = _to_the_ends(planes, noise, curve, width, first, last)
    if len(on) < 10:
        return None
    index, _ = beside(on, points)
    kept = ((index > 0) | (not inside[0])) & ((index < len(on) - 1) | (not inside[1]))
    if settings.least_points <= kept.sum() < len(points):
        points = points[kept]
        curve, misses = _robust(points, scale, width)
        curve, inside = _to_the_ends(planes, noise, curve, width, first, last)
    else:
        curve = on
    if len(curve) < 10:
        return None
    far = max(2.0 * width, 0.03 * float(arc_lengths(curve)[-1]))
    if any(end is not None and np.hypot(*(at - end)) > far for end, at in ((first, curve[0]), (last, curve[-1]))):
        return None
    _, widths, share = _edges(planes, spread, curve, width, 0.2, 0.5)
    width = _median_width(widths, width)
    parts, log = evidence_of(planes, noise, curve, width, settings)
    parts["edges"] = share
    parts["wander"] = mad_std(misses) / width
    if parts["aspect"] < settings.least_aspect or share < settings.least_edges:
        return None
    evidence = parts["ribbon"] * (1.0 - settings.shadow_cost * parts["shadow"]) + _shape(parts, settings)
    holder = _holders(planes, noise, curve, width, settings)
    gap = _gap(curve, log, settings)
    goes_on = _goes_on(planes, noise, curve, width, inside, settings)
    return MeasuredRod(points, curve, width, mad_std(misses), inside, holder, goes_on, gap, evidence, parts)


def _goes_on(
    planes: np.ndarray,
    noise: np.ndarray,
    curve: np.ndarray,
    width: float,
    inside: tuple[bool, bool],
    settings: RodSettings,
) -> np.ndarray | None:
    """An end (2,) of a line ahead of which, to any side, there is more of its colour, about as wide."""
    size = np.array(planes.shape[:0:-1]) - 1.0
    for order, within in ((slice(None, None, -1), inside[0]), (slice(None), inside[1])):
        line = curve[order]
        near = line[-max(2, int(3.0 * width / max(arc_lengths(line[:2])[-1], 1e-9))) :]
        if not within or len(near) < 4:
            continue
        ahead = near[-1] - near[len(near) // 2]
        bearing = np.arctan2(ahead[1], ahead[0]) + np.linspace(-1.9, 1.9, 61)
        ring = near[-1] + settings.ring_widths * width * np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
        if not np.all((ring >= 0.0) & (ring <= size)):
            continue
        strip = Strip.along(planes, near, max(1.0, 0.2 * width), 1.6 * width, max(0.25, width / 12.0))
        rod = np.nanmedian(strip.colours(-0.25 * width, 0.25 * width), axis=1)
        sides = (strip.colours(-1.5 * width, -0.9 * width), strip.colours(0.9 * width, 1.5 * width))
        around = np.nanmedian(np.concatenate(sides, axis=1), axis=1)
        u, v = ring.round().astype(int).T
        difference = (rod - around) / noise**2
        shares = difference @ (planes[:, v, u] - around[:, None]) / max(difference @ (rod - around), 1e-9)
        like = np.append(np.append(0, (shares > 0.6) & (shares < 1.6)), 0)
        starts, ends = np.flatnonzero(np.diff(like) > 0), np.flatnonzero(np.diff(like) < 0)
        arcs = (ends - starts) * (3.8 / 60.0) * settings.ring_widths
        if np.any((arcs > 0.5) & (arcs < 1.8) & (starts > 0) & (ends < 61)):
            return line[-1]
    return None


def _shape(parts: dict[str, float], settings: RodSettings) -> float:
    """Log odds of a rod's shape and colours against a line's of the background, 0 at best."""
    winding = max(0.0, parts["turning"] - 1.5 * parts["net"] - 1.0)
    turned = max(0.0, parts["net"] - settings.most_turn)
    straight = max(0.0, 1.0 - parts["net"] / settings.least_turn)
    return -settings.winding_cost * winding - settings.turned_cost * turned - settings.straight_cost * straight


def _gap(curve: np.ndarray, log: np.ndarray, settings: RodSettings) -> np.ndarray | None:
    """The middle of the longest piece without evidence, if it is too long."""
    empty = np.append(np.append(0, log < 0.5), 0)
    starts, ends = np.flatnonzero(np.diff(empty) > 0), np.flatnonzero(np.diff(empty) < 0)
    if len(starts) == 0:
        return None
    longest = int(np.argmax(ends - starts))
    if ends[longest] - starts[longest] < settings.longest_gap * len(log):
        return None
    return curve[int(0.5 * (starts[longest] + ends[longest]) / len(log) * (len(curve) - 1))]


def _holders(
    planes: np.ndarray, noise: np.ndarray, curve: np.ndarray, width: float, settings: RodSettings
) -> tuple[float, float]:
    """Log odds that what is beyond either end of a line is not the background on both sides of it."""
    found = []
    size = np.array(planes.shape[:0:-1]) - 1.0
    base = 2.0 * shading_of(len(planes), settings) ** 2 + noise**2
    for order in (slice(None, None, -1), slice(None)):
        line = curve[order]
        tangent = line[-1] - line[-max(2, min(len(line), int(2.0 * width)))]
        tangent = tangent / max(np.hypot(*tangent), 1e-9)
        aside = np.array([-tangent[1], tangent[0]])
        along = np.linspace(0.8, 2.0, 7)[:, None] * width
        places = line[-1] + along * tangent
        colours = []
        for across in (np.linspace(-0.35, 0.35, 5), np.linspace(-1.6, -0.9, 5), np.linspace(0.9, 1.6, 5)):
            at = (places[:, None] + across[:, None] * width * aside).reshape(-1, 2)
            at = at[np.all((at >= 0) & (at <= size), axis=1)].round().astype(int)
            colours.append(np.median(planes[:, at[:, 1], at[:, 0]], axis=1) if len(at) > 5 else None)
        beyond, left, right = colours
        if beyond is None or left is None or right is None:
            found.append(0.0)
            continue
        spread = 2.0 * settings.spread**2
        odds = [
            float(np.sum(0.5 * d**2 * (1.0 / base - 1.0 / (base + spread)) - 0.5 * np.log((base + spread) / base)))
            for d in (beyond - left, beyond - right)
        ]
        found.append(max(min(max(odds), 20.0), -20.0))
    return found[0], found[1]


def _projected(
    strip: Strip, spread: np.ndarray, width: float, inner: float, outer: tuple[float, float]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """For either side, (S, A) how much of the difference from the background to the rod a place has, and (S,) that
    difference in standard deviations of places of one surface, `spread` and what the rod itself scatters."""
    mark = strip.colours(-inner * width, inner * width)
    # a highlight or plies change one channel across the rod: others tell its edges better
    columns = np.abs(strip.across_px) < inner * width
    scatter = np.median(np.abs(strip.values[:, :, columns] - mark[..., None]), axis=2)
    spread = np.hypot(spread, np.nanmedian(scatter, axis=1) / NORMAL_QUARTILE)
    sides = []
    for low, high in ((-outer[1], -outer[0]), outer):
        ground = strip.colours(low * width, high * width)
        difference = (mark - ground) / spread[:, None]
        square = np.sum(difference**2, axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            shares = np.einsum("csa,cs->sa", strip.values - ground[..., None], difference / spread[:, None])
            sides.append((shares / square[:, None], np.sqrt(square)))
    return sides


def _edges(
    planes: np.ndarray,
    spread: np.ndarray,
    curve: np.ndarray,
    width: float,
    most_off: float,
    share: float,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Middles (N, 2) between both edges, at which this share of the contrast is left, the widths (N,) there, and the
    part of the stations that have them; where only one is within the picture, half a width from that, and NaN.

    spread : (channels,) deviation of places of one surface.
    """
    fine = float(np.clip(width / 80.0, 0.25, 1.0))
    strip = Strip.along(planes, curve, 0.2 * min(width, 20.0), 2.0 * width, fine)
    centre = len(strip.across_px) // 2
    ends = np.full((2, len(strip.stations_px)), np.nan)
    for side, (shares, contrast) in enumerate(_projected(strip, spread, width, 0.3, (0.6, 2.0))):
        out = shares[:, centre::-1] if side == 0 else shares[:, centre:]
        below = out < share
        k = np.argmax(below, axis=1)
        rows = np.arange(len(k))
        with np.errstate(invalid="ignore", divide="ignore"):
            at = fine * (k - (share - out[rows, k]) / (out[rows, k - 1] - out[rows, k]))
        good = (k > 0) & (contrast > 2.0)
        ends[side, good] = (-1.0, 1.0)[side] * at[good]
    return _middles(strip, ends, width, most_off, planes.shape[1:])


def _middles(
    strip: Strip, ends: np.ndarray, width: float, most_off: float, shape: tuple[int, ...]
) -> tuple[np.ndarray, np.ndarray, float]:
    size = np.array(shape[::-1]) - 1.0

    def within(places: np.ndarray) -> np.ndarray:
        return np.all((places >= 0.0) & (places <= size), axis=-1)

    with np.errstate(invalid="ignore"):
        inside = np.stack([within(strip.stations_px + each[:, None] * strip.normals) for each in ends])
    cut = np.stack([~within(strip.stations_px + half * width * strip.normals) for half in (-0.5, 0.5)])
    middle, broad = ends.mean(axis=0), ends[1] - ends[0]
    # the border cuts one edge off: the rod is as wide there as elsewhere
    once = (cut.sum(axis=0) == 1) & (inside == ~cut).all(axis=0)
    from_one = np.where(cut[0], ends[1] - 0.5 * width, ends[0] + 0.5 * width)
    middle, broad = np.where(once, from_one, middle), np.where(once, np.nan, broad)
    there = inside.all(axis=0) | once
    with np.errstate(invalid="ignore"):
        good = there & (np.abs(middle) < most_off * width)
    points = strip.stations_px[good] + middle[good, None] * strip.normals[good]
    return points, broad[good], float(np.mean(good))


def _median_width(widths: np.ndarray, before: float) -> float:
    """Of those that were measured, not NaN; the one before where none was."""
    return float(np.nanmedian(widths)) if np.isfinite(widths).any() else before


def _smooth(points: np.ndarray, weights: np.ndarray, scale: float) -> np.ndarray:
    """(M, 2) smooth curve by points (N, 2), evenly spaced, on which bends shorter than the scale are lost."""
    along = arc_lengths(points)
    # means over a part of the scale lose nothing, and a spline's cost is in its knots
    each = np.unique(np.floor(along / (0.2 * scale)), return_inverse=True)[1]
    totals = np.maximum(np.bincount(each, weights), 1e-9)
    points = np.stack([np.bincount(each, weights * axis) for axis in points.T], axis=1) / totals[:, None]
    along, weights = np.bincount(each, weights * along) / totals, totals
    if len(along) < 5:
        at = np.linspace(along[0], along[-1], 50)
        return np.stack([np.interp(at, along, each) for each in points.T], axis=1)
    # the kernel of a smoothing spline with this penalty is `scale` wide
    penalty = scale**4 * float(weights.sum()) / (along[-1] - along[0])
    at = np.linspace(along[0], along[-1], max(50, int((along[-1] - along[0]) / 2.0)))
    return np.stack([make_smoothing_spline(along, each, weights, penalty)(at) for each in points.T], axis=1)


def _robust(points: np.ndarray, scale: float, width: float) -> tuple[np.ndarray, np.ndarray]:
    """`_smooth` curve by IRLS, and the points' (N, 2) distances from it (N,). It goes on for two widths at both ends,
    bent as over the last three."""
    weights, misses = np.ones(len(points)), np.zeros(len(points))
    along = arc_lengths(points)
    on = np.linspace(0.0, 2.0 * width, 21)[1:]
    curve = points
    for _ in range(3):
        pieces = [points]
        for last, beyond in ((False, -on[::-1]), (True, along[-1] + on)):
            near = np.abs(along - last * along[-1]) < max(3.0 * width, 2.0 * scale)
            near |= np.abs(np.arange(len(points)) - last * (len(points) - 1)) < 6
            fits = (np.polyfit(along[near], each[near], 2, w=weights[near]) for each in points.T)
            piece = np.stack([np.polyval(each, beyond) for each in fits], axis=1)
            pieces = [*pieces, piece] if last else [piece, *pieces]
        trusted = np.pad(weights, len(on), constant_values=0.3)
        curve = _smooth(np.concatenate(pieces), trusted, scale)
        misses = beside(curve, points)[1]
        weights = huber_weights(misses / max(mad_std(misses), 0.02))
    return curve, misses


def _to_the_ends(
    planes: np.ndarray,
    noise: np.ndarray,
    curve: np.ndarray,
    width: float,
    first: np.ndarray | None,
    last: np.ndarray | None,
) -> tuple[np.ndarray, tuple[bool, bool]]:
    """The part of the curve (M, 2) that is on the rod, or between its ends where they are known, and whether it ends
    within the picture."""
    step = float(arc_lengths(curve[:2])[-1])
    fit = max(2, round(0.5 * width / step))
    strip = Strip.along(planes, curve, step, 1.75 * width, max(0.25, width / 12.0))
    size = np.array(planes.shape[:0:-1]) - 1.0
    inside = np.all((curve >= -0.5) & (curve <= size + 0.5), axis=1)
    mark = strip.colours(-0.25 * width, 0.25 * width)
    grounds = [strip.colours(low * width, high * width) for low, high in ((-1.75, -1.0), (1.0, 1.75))]
    count = len(curve)

    def run_out(known: np.ndarray | None, order: np.ndarray) -> tuple[int, bool]:
        """Index of the last place on the rod in this order, and whether it is within the picture."""
        if known is not None:
            nearest = int(np.argmin(np.hypot(*(curve - known).T)))
            return nearest, bool(inside[nearest])
        near = order[count // 2 : count - 3 * fit] if count - 3 * fit > count // 2 + 2 else order[: count // 2]
        if not np.isfinite(mark[:, near]).any(axis=1).all():
            return int(order[count // 2]), True  # nothing of it is in the picture
        rod = np.nanmedian(mark[:, near], axis=1)
        around = np.nanmedian(np.concatenate([each[:, near] for each in grounds], axis=1), axis=1)
        difference = (rod - around) / noise**2
        scale = max(difference @ (rod - around), 1e-9)
        local = np.nanmean(np.stack([*grounds, np.repeat(around[:, None], count, axis=1)]), axis=0)
        on_rod = difference @ (mark - around[:, None]) / scale > 0.5
        on_rod |= difference @ (mark - local) / scale > 0.5
        run = order[count // 2 :]
        off = ~on_rod[run]
        # a dark ply is not the end
        gone = off & (np.convolve(off, np.ones(fit), "full")[fit - 1 :][: len(off)] >= fit - 0.5)
        out = gone | ~inside[run]
        at = max(int(np.argmax(out)) - 1, 0) if out.any() else len(run) - 1
        return int(run[at]), bool(inside[run[min(at + fit, len(run) - 1)]])

    everything = np.arange(count)
    start, seen_first = run_out(first, everything[::-1])
    end, seen_last = run_out(last, everything)
    return curve[start : end + 1], (seen_first, seen_last)


def evidence_of(
    planes: np.ndarray, noise: np.ndarray, curve: np.ndarray, width: float, settings: RodSettings
) -> tuple[dict[str, float], np.ndarray]:
    """What speaks for a rod along a curve: log odds, summed over cells of one correlation length; and (S,) for each."""
    diagonal = float(np.hypot(*planes.shape[1:]))
    length = float(arc_lengths(curve)[-1])
    cell = max(width, settings.correlation_share * diagonal)
    strip = Strip.along(planes, curve, max(1.0, 0.2 * width), 1.5 * width, max(0.25, width / 16.0))
    bands = [strip.colours(low * width, high * width) for low, high in ((-0.35, 0.35), (-1.2, -0.65), (0.65, 1.2))]
    spacing = length / max(len(strip.stations_px) - 1, 1)
    run = max(1, round(cell / spacing))
    shading = shading_of(len(planes), settings)
    means, scatter = [], []
    for band in bands:
        filled = np.where(np.isfinite(band), band, 0.0)
        known = uniform_filter1d(np.isfinite(band).astype(float), run, axis=1, mode="constant")
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = uniform_filter1d(filled, run, axis=1, mode="constant") / known
            square = uniform_filter1d(filled**2, run, axis=1, mode="constant") / known
        means.append(np.where(known > 0.3, mean, np.nan))
        scatter.append(np.maximum(square - mean**2, 0.0) * min(1.0, 2.0 / run))
    spread = 2.0 * settings.spread**2

    def odds(difference: np.ndarray, variance: np.ndarray) -> np.ndarray:
        wide = variance + spread
        log = 0.5 * difference**2 * (1.0 / variance - 1.0 / wide) - 0.5 * np.log(wide / variance)
        return np.sum(log, axis=0)

    base = 2.0 * shading[:, None] ** 2 + noise[:, None] ** 2 / 4.0
    middle, left, right = means
    a = odds(middle - left, base + scatter[0] + scatter[1])
    b = odds(middle - right, base + scatter[0] + scatter[2])
    across = (right - left) / shading[:, None]
    mixed = np.clip(
        np.sum(across * (middle - left) / shading[:, None], axis=0) / np.sum(across**2 + 1e-6, axis=0), 0, 1
    )
    e = odds(middle - left - mixed * (right - left), base + scatter[0] + 0.5 * (scatter[1] + scatter[2]))
    a, b, e = (np.where(np.isfinite(each), np.clip(each, -60.0, 60.0), np.nan) for each in (a, b, e))
    log = -np.log(settings.flat * np.exp(-a - b) + settings.edge * np.exp(-e) + settings.chance)
    log = np.where(np.isfinite(log), np.maximum(log, settings.gap), 0.0)
    shadows = (_shadowed(middle, side, shading, settings.darkest_shadow) for side in (left, right))
    shadow = np.maximum(*shadows)
    steps = np.diff(middle[:, :: max(1, run)], axis=1)
    steps = steps[:, np.isfinite(steps).all(axis=0)]
    uniform = odds_same(steps, shading, settings.spread)
    tangent = np.diff(curve, axis=0)
    angle = np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
    smooth = max(1, round(2.0 * width / max(length / len(curve), 1e-9)))
    angle = uniform_filter1d(angle, smooth, mode="nearest")
    return {
        "ribbon": float(log.sum()) * spacing / cell,
        "mean": float(log.mean()),
        "worst": float(np.quantile(log, 0.1)),
        "gaps": float(np.mean(log < 0.5)),
        "uniform": uniform,
        "turning": float(np.abs(np.diff(angle)).sum()),
        "net": float(np.ptp(angle)),
        "cells": length / cell,
        "aspect": length / width,
        "length_share": length / diagonal,
        "shadow": float(np.mean(shadow)),
    }, log


def _shadowed(middle: np.ndarray, side: np.ndarray, shading: np.ndarray, darkest: float) -> np.ndarray:
    """(S,) 0 to 1, how much colours (channels, S) look like those on one side in less light; 0 in a grey picture."""
    if len(middle) == 1:
        return np.zeros(middle.shape[1])
    with np.errstate(invalid="ignore", divide="ignore"):
        light = middle[0] / np.maximum(side[0], 1.0)
        off = np.sum(((middle[1:] - light * side[1:]) / (4.0 * shading[1:, None])) ** 2, axis=0)
        there = np.exp(-0.5 * off) * ((light > darkest) & (light < 0.95))
    return np.where(np.isfinite(there), there, 0.0)


def odds_same(steps: np.ndarray, shading: np.ndarray, spread: float) -> float:
    """Mean log odds, from differences (channels, N) between neighbouring cells, that they are of one surface."""
    if steps.shape[1] == 0:
        return 0.0
    one, two = 2.0 * (2.0 * shading[:, None]) ** 2, 2.0 * spread**2
    log = 0.5 * steps**2 * (1.0 / one - 1.0 / two) + 0.5 * np.log(one / two)
    return float(np.mean(-np.log(0.1 + 0.9 * np.exp(np.clip(np.sum(log, axis=0), -50, 50)))))
