"""The centreline of a rod in one photograph: the line of most evidence, if that is enough and no other comes near.

Nothing is assumed about the rod's colour, which may change along it, except that it differs from the background on
either side. Candidates are ribbons between two backgrounds. Along each, both edges are measured from the inside
outwards, so that protruding hairs do not count, and points at which the rod is wider or narrower than nearby are left
out. Pixel (0, 0) is the centre of the upper left one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import combinations

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.interpolate import CubicSpline
from scipy.linalg import solveh_banded
from scipy.ndimage import maximum_filter1d, median_filter, uniform_filter1d

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.polyline import arc_lengths, normals, offsets_from
from vbaa_calib.core.robust import NORMAL_QUARTILE, huber_weights, mad_std
from vbaa_calib.native import core

from .settings import RodSettings

_TO_OPPONENT = np.array([[0.114, 0.587, 0.299], [0.0, -0.7071, 0.7071], [-0.8165, 0.4082, 0.4082]])
"""Luma, red against green and yellow against blue, from blue, green and red."""


@dataclass(frozen=True, eq=False)
class _RodPath:
    """A coarse line (N, 2) in the photograph's pixels, with the width at which it was found and its evidence."""

    path_px: np.ndarray
    width_px: float
    evidence: float
    cost: float = 0.0
    mean: float = 0.0


def _opponent(picture: np.ndarray, settings: RodSettings) -> np.ndarray:
    """Planes (1, H, W) of a grey picture (H, W), or (3, H, W) luma and two chroma of a colour one (H, W, 3)."""
    if picture.ndim == 2:
        return picture.astype(np.float32)[None]
    luma, *chroma = np.moveaxis(cv2.transform(picture.astype(np.float32), _TO_OPPONENT.astype(np.float32)), -1, 0)
    # less light is less chroma as well
    usual, dark = np.float32(128.0), np.float32(settings.dark)
    return np.stack([luma, *(each * (usual + dark) / (luma + dark) for each in chroma)])


@dataclass(frozen=True, eq=False)
class _Level:
    """A picture (channels, H, W) of a pyramid; `scale` of its pixels make one of the photograph's."""

    planes: np.ndarray
    scale: float

    def reduced(self, scale: float, shape: tuple[int, int]) -> _Level:
        """The picture resized to shape (H, W) at a scale that is not larger than this level's."""
        size = (max(8, round(scale * shape[1])), max(8, round(scale * shape[0])))
        if size == self.planes.shape[:0:-1]:
            return self
        return _Level(np.stack([cv2.resize(each, size, interpolation=cv2.INTER_AREA) for each in self.planes]), scale)

    def noise(self, settings: RodSettings) -> np.ndarray:
        """(channels,) standard deviation of the pixel noise, from second differences."""
        rows = self.planes[:, :: max(1, self.planes.shape[1] // settings.sampled_rows)]
        bend = rows[:, :, 2:] - 2.0 * rows[:, :, 1:-1] + rows[:, :, :-2]
        return np.maximum(np.median(np.abs(bend), axis=(1, 2)) / (NORMAL_QUARTILE * np.sqrt(6.0)), settings.least_noise)

    def texture(self, apart_px: float, settings: RodSettings, axes: Sequence[int] = (1, 2)) -> np.ndarray:
        """(channels,) standard deviation of the difference between places `apart_px` apart on typical surfaces, down
        the picture (axis 1) and across it (2)."""
        smooth = np.stack([cv2.blur(each, (3, 3)) for each in self.planes])
        off, few = max(1, round(apart_px)), max(1, self.planes.shape[1] // settings.sampled_rows)
        found = []
        for axis in axes:
            places = smooth[:, ::few] if axis == 2 else smooth.swapaxes(1, 2)
            step = 1 if axis == 2 else few
            found.append(np.median(np.abs(places[..., off::step] - places[..., :-off:step]), axis=(1, 2)))
        return np.mean(found, axis=0) / NORMAL_QUARTILE


_Against = Callable[[_Level], np.ndarray]


def _shading_of(channels: int, settings: RodSettings) -> np.ndarray:
    """(channels,) typical colour difference of neighbouring places on one surface."""
    return np.array([settings.shading[min(channel, 1)] for channel in range(channels)])


def _ribbon_evidence(level: _Level, width: float, texture: np.ndarray, settings: RodSettings) -> np.ndarray:
    """Log odds (steps, directions, columns) of ribbons of one width, from row to row of a picture with this
    texture (channels,)."""
    shading = np.hypot(_shading_of(len(level.planes), settings), texture)
    shares = (settings.flat, settings.edge, settings.chance)
    spread = np.array([settings.spread, settings.chroma_spread, settings.chroma_spread])[: len(level.planes)]
    return core.search.ribbon_evidence(
        level.planes, width, level.noise(settings), shading, spread, shares, settings.gap
    )


def _most_scale(shape: Sequence[int], settings: RodSettings) -> float:
    """Scale of the pyramid level of a picture (H, W) in which the thinnest rods are searched."""
    return float(min(1.0, np.sqrt(1e6 * settings.most_megapixels / (shape[0] * shape[1]))))


def _levels_of(planes: np.ndarray, settings: RodSettings, finer: float = 1.0) -> list[tuple[_Level, float]]:
    """Pyramid levels for each ribbon width (in the picture's pixels), the widest first; down to widths that are by the
    factor `finer` smaller than usual."""
    height, width = planes.shape[1:]
    most = finer * _most_scale((height, width), settings)
    widths = [settings.narrowest_px / most]
    while widths[-1] < settings.widest * min(height, width):
        widths.append(widths[-1] * settings.width_step)
    level, levels = _Level(planes, 1.0), []
    for width_px in widths:
        level = level.reduced(min(most, 1.0, settings.level_width_px / width_px), (height, width))
        levels.append((level, width_px))
    return levels[::-1]


def _paths_at(
    at: tuple[_Level, float],
    ends: tuple[np.ndarray | None, np.ndarray | None],
    settings: RodSettings,
    limits: tuple[float, float],
    against: Sequence[_Against] = (),
) -> list[_RodPath]:
    """Candidate paths of ribbons of one width `at` a level (in the photograph's pixels), the best first; from clamp to
    tip where these are known.

    limits : evidence by which a path may fall short of the best, and the least log odds of a correlation length.
    against : log odds that are taken off the evidence.
    """
    (level, width_px), (clamp, tip), (bound, gap) = at, ends, limits
    height, columns = level.planes.shape[1:]
    width, diagonal = width_px * level.scale, float(np.hypot(height, columns))
    if min(height, columns) < 2 * core.search.ROW_STEP:
        return []
    texture = level.texture(settings.flank_widths * width, settings)
    searched = replace(settings, gap=gap)
    down = _ribbon_evidence(level, width, texture, searched)
    transposed = _Level(np.ascontiguousarray(level.planes.swapaxes(1, 2)), level.scale)
    across = _ribbon_evidence(transposed, width, texture, searched)
    for each in against:
        less, step = each(level), core.search.ROW_STEP
        for evidence, places in ((down, less), (across, less.T)):
            evidence -= places[step // 2 :: step][: len(evidence), None]
    correlation = max(width, settings.correlation_share * diagonal)
    both = clamp is not None and tip is not None
    rules = (
        1.0 / correlation,
        settings.enough,
        settings.length_cost,
        settings.turn_cost,
        settings.click_share * diagonal + 0.5 * width,
        width,
        settings.any_evidence if both else settings.least_evidence,
        bound,
        settings.drop,
    )
    known = [None if each is None else ((each + 0.5) * level.scale - 0.5)[None] for each in (clamp, tip)]
    none = np.zeros((0, 2))
    if known[0] is None:
        known.reverse()  # from the tip, where that is known
    first, last = (none if each is None else each for each in known)
    found = core.search.best_paths(
        down, across, first, last, rules, settings.slack, settings.cuts if both else settings.candidates
    )
    paths = [
        _RodPath((path + 0.5) / level.scale - 0.5, width_px, sum_of, cost, sum_of * correlation / arc_lengths(path)[-1])
        for path, sum_of, cost in found
    ]
    return [_from_clamp(each, clamp, tip) for each in paths]


def _unlike(colours: np.ndarray, settings: RodSettings, level: _Level) -> np.ndarray:
    """Log odds (H, W) against places that have none of some colours (K, channels)."""
    spread = settings.other_colour * _shading_of(len(level.planes), settings)
    smooth = [cv2.blur(each, (3, 3)) for each in level.planes]
    unlike = [
        sum(((each - own) / by) ** 2 for each, own, by in zip(smooth, colour, spread, strict=True))
        for colour in colours
    ]
    return np.clip(np.min(unlike, axis=0) - 1.0, 0.0, -settings.gap).astype(np.float32)


def _occupied(
    rejected: Sequence[_RodPath], ends: tuple[np.ndarray, np.ndarray], settings: RodSettings, level: _Level
) -> np.ndarray:
    """Log odds (H, W) against the middle of paths along which there is no rod, but for next to its known ends."""
    less = np.zeros(level.planes.shape[1:], np.float32)
    for path in rejected:
        far = np.min([np.hypot(*(path.path_px - end).T) for end in ends], axis=0) > path.width_px
        line = np.rint((path.path_px[far] + 0.5) * level.scale - 0.5).astype(np.int32)
        thick = max(1, round(0.5 * path.width_px * level.scale))
        cv2.polylines(less, [line], False, settings.enough - settings.gap, thick)
    return less


def _from_clamp(path: _RodPath, clamp: np.ndarray | None, tip: np.ndarray | None) -> _RodPath:
    first, last = path.path_px[0], path.path_px[-1]
    if clamp is not None:
        turned = np.hypot(*(last - clamp)) < np.hypot(*(first - clamp))
    else:
        turned = tip is not None and np.hypot(*(first - tip)) < np.hypot(*(last - tip))
    return replace(path, path_px=path.path_px[::-1]) if turned else path


def _sharpest(line: np.ndarray, width: float, reach: float) -> tuple[float, float]:
    """Largest turn (radians) of a line (N, 2) within `reach` to either side of a place, and the arc length there."""
    along = arc_lengths(line)
    at = np.arange(reach, along[-1] - reach, 0.25 * width)
    if len(at) == 0:
        return 0.0, 0.0
    u, v = (np.stack([np.interp(at + way * reach, along, axis) for way in (-1, 0, 1)]) for axis in line.T)
    bearing = np.arctan2(np.diff(v, axis=0), np.diff(u, axis=0))
    turns = np.abs(np.angle(np.exp(1j * (bearing[1] - bearing[0]))))
    return float(turns.max()), float(at[turns.argmax()])


def _pieces(path: _RodPath, settings: RodSettings) -> list[_RodPath]:
    """The two parts of a path next to its sharpest corner, where it may leave a rod for something else; none where it
    has no corner."""
    turn, corner = _sharpest(path.path_px, path.width_px, settings.corner_widths * path.width_px)
    if turn < settings.corner:
        return []
    along = arc_lengths(path.path_px)
    parts = [path.path_px[along < corner], path.path_px[along > corner]]
    sums = [path.evidence * float(arc_lengths(part)[-1] / along[-1]) for part in parts]
    pieces = zip(parts, sums, strict=True)
    return [replace(path, path_px=part, evidence=each) for part, each in pieces if each > settings.least_evidence]


def _shared(path: _RodPath, other: _RodPath, settings: RodSettings) -> float:
    """Fraction of a path's length that runs along another path, within a fraction of the width."""
    along = arc_lengths(other.path_px)
    at = np.linspace(0.0, along[-1], max(2, int(2.0 * along[-1] / path.width_px)))
    fine = np.stack([np.interp(at, along, each) for each in other.path_px.T], axis=1)
    away = np.hypot(*(path.path_px[:, None] - fine).transpose(2, 0, 1)).min(axis=1)
    return float(np.mean(away < settings.pieces_along * max(path.width_px, other.width_px)))


@dataclass(frozen=True, eq=False)
class _PhotoPatch:
    """The part of a picture around a path, reduced until the rod is a few pixels wide; `scale` patch pixels make one
    of the picture's."""

    planes: np.ndarray
    scale: float
    low: np.ndarray  # (2,) its first pixel in the picture
    noise: np.ndarray  # (channels,) standard deviation of a pixel
    spread: np.ndarray  # (channels,) of places of one surface
    size: np.ndarray  # (2,) of the picture

    @staticmethod
    def about(planes: np.ndarray, path: _RodPath, settings: RodSettings) -> _PhotoPatch:
        """The patch around a path."""
        size, room = np.array(planes.shape[:0:-1]), settings.patch_widths * path.width_px + 10.0
        times = max(1, int(path.width_px / settings.measured_width_px))
        low = np.clip(np.floor(path.path_px.min(axis=0) - room).astype(int), 0, size - 2 * times)
        high = np.clip(np.ceil(path.path_px.max(axis=0) + room).astype(int), low + 2 * times, size)
        high -= (high - low) % times
        part = planes[:, low[1] : high[1], low[0] : high[0]]
        level = _Level(part, 1.0).reduced(1.0 / times, part.shape[1:])
        noise = level.noise(settings)
        spread = np.hypot(noise, _shading_of(len(planes), settings))
        return _PhotoPatch(level.planes, level.scale, low, noise, spread, size)

    def here(self, points: np.ndarray) -> np.ndarray:
        """Patch coordinates of points (..., 2) of the picture."""
        return (points - self.low + 0.5) * self.scale - 0.5

    def back(self, points: np.ndarray) -> np.ndarray:
        """Picture coordinates of points (..., 2) of the patch."""
        return (points + 0.5) / self.scale - 0.5 + self.low


@dataclass(frozen=True, eq=False)
class _Strip:
    """A picture's planes resampled along a curve: (channels, S, A), at stations (S, 2) and lateral offsets (A,)."""

    values: np.ndarray
    stations_px: np.ndarray
    normals: np.ndarray
    across_px: np.ndarray
    inside: np.ndarray  # (S, A)

    @staticmethod
    def along(planes: np.ndarray, curve: np.ndarray, spacing: float, reach: float, fine: float) -> _Strip:
        """The strip of half width `reach` along a finely and evenly spaced curve (M, 2)."""
        # an extrapolated end may have shorter steps: there are several rows for the evidence in any case
        few = len(curve) // (4 * core.search.ROW_STEP)
        each = max(1, min(few, round(spacing / max(arc_lengths(curve[:2])[-1], 1e-9))))
        stations, normal = curve[::each], normals(curve)[::each]
        across = np.arange(-np.ceil(reach / fine), np.ceil(reach / fine) + 1) * fine
        places = stations[:, None] + across[:, None] * normal[:, None]
        u, v = (np.ascontiguousarray(places[..., axis], np.float32) for axis in range(2))
        border = cv2.BORDER_REPLICATE
        values = np.stack([cv2.remap(plane, u, v, cv2.INTER_LINEAR, borderMode=border) for plane in planes])
        last = np.array(planes.shape[:0:-1]) - 1.0
        inside = np.all((places >= 0.0) & (places <= last), axis=-1)
        return _Strip(values, stations, normal, across, inside)

    def colours(self, low: float, high: float, smooth: int = 1) -> np.ndarray:
        """(channels, S) median colour between two lateral offsets, NaN outside the picture; smoothed over `smooth`
        stations."""
        columns = self._between(low, high)
        found = np.median(self.values[:, :, columns], axis=2)
        known = self.inside[:, columns].mean(axis=1) > 0.3
        if smooth > 1 and known.sum() > 3:
            if smooth < known.sum():
                found[:, known] = _running_medians(found[:, known], smooth | 1, "mirror")
            else:
                found[:, known] = np.median(found[:, known], axis=1)[:, None]
        found[:, ~known] = np.nan
        return found

    def _between(self, low: float, high: float) -> np.ndarray:
        """A few columns of the strip between two lateral offsets."""
        columns = np.flatnonzero((self.across_px >= low) & (self.across_px <= high))
        return columns[:: max(1, len(columns) // 8)]

    def surface(self, low: float, high: float, smooth: int) -> tuple[np.ndarray, np.ndarray]:
        """(channels, S) median colour between two lateral offsets, and its scatter (channels,)."""
        colours = self.colours(low, high, smooth)
        scatter = np.median(np.abs(self.values[:, :, self._between(low, high)] - colours[..., None]), axis=2)
        known = np.isfinite(scatter[0])
        return colours, np.median(scatter[:, known], axis=1) / NORMAL_QUARTILE if known.any() else np.zeros(
            len(colours)
        )


@dataclass(frozen=True, eq=False)
class _MeasuredRod:
    """A fitted centreline with its evidence, in the photograph's pixels."""

    points_px: np.ndarray
    curve_px: np.ndarray
    width_px: float
    free: tuple[bool, bool]  # whether its first and its last end is known, or in the picture with nothing beyond it
    inside: tuple[bool, bool]  # whether these are in the picture
    holder: tuple[float, float]  # log odds that something else than background is beyond them
    evidence: float  # log odds of a rod, against anything else
    parts: dict[str, float]

    def is_good(self, settings: RodSettings) -> bool:
        """Whether the line has so much evidence that no better one is expected."""
        return self.parts["mean"] > settings.good_mean and self.parts["edges"] > settings.good_edges

    def is_whole(self, settings: RodSettings) -> bool:
        """Whether the line has enough evidence for one that has both edges nearly everywhere."""
        return self.parts["mean"] > settings.whole_mean and self.parts["edges"] > settings.good_edges

    def contains(self, line: np.ndarray, share: float = 0.8) -> bool:
        """Whether at least a fraction `share` of a line's points (N, 2) lie in this rod."""
        return float(np.mean(np.abs(offsets_from(self.curve_px, line)[1]) < 0.5 * self.width_px)) > share

    def enlarged(self, times: int) -> _MeasuredRod:
        """The same line in a picture with so many times the pixels each way."""

        def at(places: np.ndarray) -> np.ndarray:
            return (places + 0.5) * times - 0.5

        return replace(
            self,
            points_px=at(self.points_px),
            curve_px=at(self.curve_px),
            width_px=self.width_px * times,
        )

    def end_colours(self, planes: np.ndarray) -> np.ndarray:
        """(2, channels) colours of the first and the last eighth."""
        size = np.array(planes.shape[:0:-1]) - 1
        places = np.clip(np.rint(self.curve_px).astype(int), 0, size)
        count = max(2, len(places) // 8)
        return np.stack(
            [np.median(planes[:, part[:, 1], part[:, 0]], axis=1) for part in (places[:count], places[-count:])]
        )


def _fitted(
    picture_planes: np.ndarray,
    path: _RodPath,
    first: np.ndarray | None,
    last: np.ndarray | None,
    settings: RodSettings,
    means: Sequence[tuple[slice, float]] = (),
) -> _MeasuredRod | None:
    """The centreline fitted along a path, between its known ends; None where it has no edges.

    means : channels by which edges are found, and grey levels by which light changes along a surface; all by default.
    """
    patch = _PhotoPatch.about(picture_planes, path, settings)
    known = first, last
    first, last = (None if each is None else patch.here(each) for each in known)
    width, coarse = path.width_px * patch.scale, patch.here(path.path_px)
    for end, way in ((first, 1), (last, -1)):
        if end is not None:
            apart = np.hypot(*(coarse[::way] - end).T) > 1.5 * width
            rest = coarse[::way][int(np.argmax(apart)) :]
            if _leads_to(rest, end, settings.sharp_widths * width, settings.sharp_turn):
                coarse = np.concatenate([end[None], rest])[::way]
    course: _Course | None = None
    most, best = 0.0, (slice(None), 0.0)
    # highlights and shadows change light, hairs have the rod's colour: the channels are used that make edges parallel
    every = ((slice(None), settings.light), (slice(None), 0.0), (slice(1), 0.0))[-len(patch.planes) :]
    for channels, light in means or every:
        found = _course(patch, channels, coarse, width, (first, last), replace(settings, light=light))
        if found is None:
            continue
        parallel = found[-1] * min(1.0, arc_lengths(found[1])[-1] / arc_lengths(coarse)[-1])
        if parallel > most:
            course, most, best = found, parallel, (channels, light)
        if parallel > settings.good_edges:
            break
    if course is None:
        return None
    curve, wide, inside = patch.back(course[1]), course[2] / patch.scale, course[3]
    away = np.minimum(curve[[0, -1]], patch.size - 1.0 - curve[[0, -1]]).min(axis=1)
    leaves = any(not within and room > wide + 10.0 for within, room in zip(inside, away, strict=True))
    if leaves and arc_lengths(curve)[-1] > arc_lengths(path.path_px)[-1] + wide:
        # the patch, not the picture
        more = replace(settings, patch_widths=2.0 * settings.patch_widths)
        return _fitted(picture_planes, replace(path, path_px=curve), *known, more, [best])
    return _judged(patch, course, known, settings)


def _judged(
    patch: _PhotoPatch,
    course: _Course,
    ends: tuple[np.ndarray | None, np.ndarray | None],
    settings: RodSettings,
) -> _MeasuredRod:
    """The line along a course with its evidence, between the picture's places where its ends are known to be."""
    points, curve, width, inside, seen, edged = course
    planes, noise = patch.planes, patch.noise
    length, diagonal = float(arc_lengths(curve)[-1]), float(np.hypot(*patch.size)) * patch.scale
    cell = max(width, settings.correlation_share * diagonal)
    parts = _along(planes, curve, width, cell, seen, settings)
    line, wide = patch.back(curve), width / patch.scale
    tolerance = settings.click_share * float(np.hypot(*patch.size)) + 0.5 * wide
    off = [float(np.hypot(*(end - at))) for end, at in zip(ends, line[[0, -1]], strict=True) if end is not None]
    missed = [each / tolerance for each in off if each > 0.5 * wide]  # nearer it is on the rod
    # nobody clicks the ends of a shadow: its middle, as far as it is seen, is its width off that of the rod
    away = [float(np.hypot(*(end - patch.back(points)).T).min()) for end in ends if end is not None]
    off_ends = float(np.clip(2.0 * max(away) / wide - 1.0, 0.0, 1.0)) if len(away) == 2 else 1.0
    parts |= {"edges": edged, "length_share": length / diagonal}
    parts["sharpest"] = _sharpest(curve, width, settings.sharp_widths * width)[0]
    parts |= {"off_clicks": float(np.sum(np.square(missed))), "off_ends": off_ends}
    holder, goes_on = (0.0, 0.0), (False, False)
    if len(off) < 2:
        holder = _holders(planes, noise, curve, width, settings)
        goes_on = _goes_on(planes, noise, curve, width, inside, settings)
    # in a shadow, or as it becomes one: where the line does not look like a shadow all along
    dim = [parts["shadow"] <= 0.5 and parts[name] > 0.5 for name in ("first_shadow", "last_shadow")]
    covered = [
        end is None and within and (on or dark)
        for end, within, on, dark in zip(ends, inside, goes_on, dim, strict=True)
    ]
    first, last = (
        end is not None or (within and not hidden and held < 2.0 * settings.clear_end)
        for end, within, hidden, held in zip(ends, inside, covered, holder, strict=True)
    )
    evidence = _rod_odds(parts, len(off), any(covered), settings)
    return _MeasuredRod(patch.back(points), line, wide, (first, last), inside, holder, evidence, parts)


def _joined(planes: np.ndarray, one: _MeasuredRod, other: _MeasuredRod, settings: RodSettings) -> _MeasuredRod | None:
    """The rod made of two lines of different colours that touch along their whole length; None where they do not."""
    both, room = 0.5 * (one.width_px + other.width_px), one.width_px + other.width_px
    ends = np.hypot(*(one.curve_px[[0, -1]] - other.curve_px[[0, -1]]).T)
    if max(ends) > 2.0 * room or min(each.parts["sides"] for each in (one, other)) < settings.one_sided:
        return None
    index, apart = offsets_from(other.curve_px, one.curve_px)
    low, middle, high = np.quantile(apart, (0.1, 0.5, 0.9))
    if abs(abs(middle) - both) > 0.3 * both or high - low > 0.5 * both:
        return None
    # from the outer edge of one to that of the other
    way = other.curve_px[index] - one.curve_px
    way /= np.maximum(np.hypot(*way.T), 1e-9)[:, None]
    curve = 0.5 * (one.curve_px + other.curve_px[index]) + 0.25 * (other.width_px - one.width_px) * way
    curve = _smooth(curve, np.ones(len(curve)), max(both, settings.least_smoothing_px))
    patch = _PhotoPatch.about(planes, _RodPath(curve, room, 0.0), settings)
    curve, edged = patch.here(curve), min(one.parts["edges"], other.parts["edges"])
    seen = np.ones(len(curve), bool)
    course = (curve, curve, room * patch.scale, one.inside, seen, edged)
    return _judged(patch, course, (None, None), settings)


def _leads_to(line: np.ndarray, end: np.ndarray, run: float, most_turn: float) -> bool:
    """Whether a line (N, 2) can come from a known end: it turns by `most_turn` within a length `run` at most."""
    far = np.hypot(*(line - line[0]).T) > 1.5 * run
    ahead, before = line[int(np.argmax(far)) if far.any() else -1] - line[0], line[0] - end
    apart = float(np.hypot(*before))
    return float(ahead @ before) > np.cos(most_turn * min(1.0, apart / run)) * apart * float(np.hypot(*ahead))


_Course = tuple[np.ndarray, np.ndarray, float, tuple[bool, bool], np.ndarray, float]


def _course(
    patch: _PhotoPatch,
    channels: slice,
    coarse: np.ndarray,
    width: float,
    ends: tuple[np.ndarray | None, np.ndarray | None],
    settings: RodSettings,
) -> _Course | None:
    """Points and their curve, the width, whether the ends are inside, which stations have two edges by some channels,
    and the share of the line that something hides; None where no line is found. In pixels of the patch."""
    planes, spread = patch.planes[channels], patch.spread[channels]
    first, last = ends
    if not arc_lengths(coarse)[-1] > width:
        return None
    curve = _smooth(coarse, np.ones(len(coarse)), max(width, settings.least_smoothing_px))
    middles = _centred(planes, spread, curve, width, settings)
    if not arc_lengths(middles)[-1] > width:
        return None  # wider than it is long
    curve = _smooth(middles, np.ones(len(middles)), max(width, settings.least_smoothing_px))
    for round_ in range(settings.fit_rounds):
        points, width, _ = _edges(planes, spread, curve, width, settings, round_ > settings.fit_rounds - 3)
        if len(points) < settings.least_points:
            return None
        scale = max(
            settings.smoothing_widths * width,
            settings.least_smoothing_px,
            settings.smoothing_share * arc_lengths(points)[-1],
        )
        curve = _robust(points, scale, width, 2.0 * width)
        if not np.isfinite(curve).all() or arc_lengths(curve)[-1] > 1.5 * arc_lengths(coarse)[-1] + 8.0 * width:
            return None

    def to_the_ends(beyond: float) -> tuple[np.ndarray, tuple[bool, bool], float]:
        # where nothing is measured next to a known end, it is the end that is known
        lead, trail = (
            [end[None]]
            if end is not None
            and np.hypot(*(points - end).T).min() > width
            and _leads_to(points[::way], end, settings.sharp_widths * width, 0.7 * settings.sharp_turn)
            else []
            for end, way in zip(ends, (1, -1), strict=True)
        )
        curve = _robust(np.concatenate([*lead, points, *trail]), scale, width, beyond)
        return _to_the_ends(patch, curve, width, ends, beyond, settings)

    # points beyond the ends are no rod's, and would bend the line there
    curve, inside, hidden = to_the_ends(2.0 * width)
    if len(curve) < 10:
        return None
    index, _ = offsets_from(curve, points)
    kept = ((index > 0) | (not inside[0])) & ((index < len(curve) - 1) | (not inside[1]))
    points = points[kept | (np.hypot(*(points - curve[index]).T) < 0.5 * width)]
    if len(points) < settings.least_points:
        return None
    curve, inside, hidden = to_the_ends(2.0 * width)
    if len(curve) < 10:
        return None
    ahead, *_ = to_the_ends((2.0 + settings.bridged_widths) * width)
    longer = len(ahead) > 0 and arc_lengths(ahead)[-1] > arc_lengths(curve)[-1]
    if longer and any(
        within and np.hypot(*(ahead[end] - curve[end])) > 0.2 * width
        for end, within in zip((0, -1), inside, strict=True)
    ):  # it goes on behind something
        points, width, _ = _edges(planes, spread, ahead, width, settings, False)
        if len(points) < settings.least_points:
            return None
        curve, inside, hidden = to_the_ends(2.0 * width)
    if len(curve) < 10:
        return None
    length = float(arc_lengths(curve)[-1])
    if length < settings.least_aspect * width:
        return None
    most_off = 0.5 * (settings.click_share * float(np.hypot(*patch.size)) * patch.scale + width)
    if any(end is not None and np.hypot(*(at - end)) > most_off for end, at in ((first, curve[0]), (last, curve[-1]))):
        return None
    _, width, seen = _edges(planes, spread, curve, width, settings, True)
    if seen.mean() < settings.least_edges or width < settings.least_width_px * patch.scale:
        return None
    hidden = min(hidden, settings.bridged_widths * width / length)
    return points, curve, width, inside, seen, min(1.0, float(seen.mean()) / (1.0 - hidden))


def _along(
    planes: np.ndarray, curve: np.ndarray, width: float, cell: float, seen: np.ndarray, settings: RodSettings
) -> dict[str, float]:
    """Evidence along a measured curve: total and mean log odds of the search in the straightened picture, its bends,
    and the colours of both sides."""
    fine = width / settings.level_width_px
    sigma = 0.4 * np.sqrt(max(fine**2 - 1.0, 0.0))
    soft = planes if sigma < 0.3 else np.stack([cv2.GaussianBlur(each, (0, 0), sigma) for each in planes])
    strip = _Strip.along(soft, curve, fine, 4.0 * width, fine)
    level = _Level(np.ascontiguousarray(strip.values), 1.0 / fine)
    # texture of the sides along the line: edges of the rod and of its shadow are none
    outer = strip.across_px < -width, strip.across_px > width
    apart = settings.flank_widths * settings.level_width_px
    textures = [_Level(level.planes[:, :, side], level.scale).texture(apart, settings, (1,)) for side in outer]
    each = _ribbon_evidence(level, settings.level_width_px, np.mean(textures, axis=0), settings)
    log = each[:, each.shape[1] // 2, len(strip.across_px) // 2].astype(float)
    inside = np.asarray(strip.inside[:, np.abs(strip.across_px) < width].all(axis=1))
    inside = inside[core.search.ROW_STEP // 2 :: core.search.ROW_STEP][: len(log)]
    length = float(arc_lengths(curve)[-1])
    # what has not both its edges, in its colour, is no rod
    near = uniform_filter1d(seen.astype(float), max(1, round(2.0 * width / (length / len(seen)))), mode="nearest")
    near = np.interp(np.linspace(0.0, 1.0, len(log)), np.linspace(0.0, 1.0, len(seen)), near)
    run = min(max(1, round(cell / fine)), len(strip.stations_px))
    every = slice((run - 1) // 2, None, run)
    middle, *sides = (
        uniform_filter1d(_filled(strip.colours(low * width, high * width)), run, axis=1, mode="nearest")[:, every]
        for low, high in ((-0.35, 0.35), (-1.2, -0.65), (0.65, 1.2))
    )
    other = np.interp(
        np.linspace(0.0, 1.0, len(log)),
        np.linspace(0.0, 1.0, middle.shape[1]),
        _other(middle, sides, settings.least_chroma),
    )
    log = np.where((near < 0.3) | (other > 0.5), settings.gap, log)
    log = np.where(inside, log, np.maximum(log, 0.0))
    there = (log > 0.5) | ((near > settings.good_edges) & (other < 0.5))
    shading = _shading_of(len(planes), settings)
    shadow = np.maximum(*(_shadowed(middle, side, shading, settings) for side in sides))
    along = max(1, round(2.0 * width / (length / len(curve))))
    tangent = uniform_filter1d(np.diff(curve, axis=0), along, axis=0, mode="nearest")
    angle = np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
    turns, hidden = np.abs(np.diff(angle)), ~there[np.arange(len(angle) - 1) * len(there) // len(angle)]
    longest = np.diff(np.flatnonzero(np.concatenate([[True], there | ~inside, [True]]))).max() - 1
    return {
        "ribbon": float(log.mean()) * length / cell,
        "mean": float(log.mean()),
        "net": float(np.ptp(angle)),
        "shadow": float(np.mean(shadow)),
        "first_shadow": float(shadow[0]),
        "last_shadow": float(shadow[-1]),
        "unseen_turn": float(turns[hidden].sum()),
        "unseen": longest / len(there),
        **_against_sides(middle, sides, shading),
    }


def _against_sides(middle: np.ndarray, sides: Sequence[np.ndarray], shading: np.ndarray) -> dict[str, float]:
    """Contrast of the middle's colours (channels, S) with the more similar side, in typical differences between places
    of one surface; and the difference of both sides relative to it: large where the curve is only an edge of a thing,
    which then lies on one side."""
    left, right, across = (
        np.linalg.norm(each / shading[:, None], axis=0)
        for each in (middle - sides[0], middle - sides[1], sides[0] - sides[1])
    )
    contrast = np.minimum(left, right)
    return {"contrast": float(np.median(contrast)), "sides": float(np.median(across / np.maximum(contrast, 1.0)))}


def _filled(colours: np.ndarray) -> np.ndarray:
    """Colours (channels, S) with NaN (at the picture's border) replaced by the nearest known colour."""
    known = np.flatnonzero(np.isfinite(colours[0]))
    if len(known) == 0:
        return colours
    nearest = np.abs(np.subtract.outer(known, np.arange(colours.shape[1]))).argmin(axis=0)
    return np.asarray(colours[:, known[nearest]])


def _goes_on(
    planes: np.ndarray,
    noise: np.ndarray,
    curve: np.ndarray,
    width: float,
    inside: tuple[bool, bool],
    settings: RodSettings,
) -> tuple[bool, bool]:
    """Whether a line of the rod's colour and width continues in some direction beyond its first and its last end."""
    size, found = np.array(planes.shape[:0:-1]) - 1.0, [False, False]
    for end, line in enumerate((curve[::-1], curve)):
        near = line[-max(2, int(3.0 * width / max(arc_lengths(line[:2])[-1], 1e-9))) :]
        if not inside[end] or len(near) < 4:
            continue
        ahead = near[-1] - near[len(near) // 2]
        bearing = np.arctan2(ahead[1], ahead[0]) + np.linspace(-1.9, 1.9, 61)
        way = np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
        along = width * np.linspace(1.0, settings.ahead_widths, 12)[:, None, None, None]
        across = width * np.array([-1.2, 0.0, 1.2])[:, None] * np.stack([-way[:, 1], way[:, 0]], axis=1)[:, None]
        places = near[-1] + along * way[:, None] + across  # (12, 61, 3, 2)
        within_picture = np.all((places >= 0.0) & (places <= size), axis=(2, 3))  # (12, 61)
        strip = _Strip.along(planes, near, max(1.0, 0.2 * width), 1.6 * width, max(0.25, width / 12.0))
        rod = np.nanmedian(strip.colours(-0.25 * width, 0.25 * width), axis=1)
        sides = (strip.colours(-1.5 * width, -0.9 * width), strip.colours(0.9 * width, 1.5 * width))
        around = np.nanmedian(np.concatenate(sides, axis=1), axis=1)
        u, v = np.clip(places, 0.0, size).round().astype(int).transpose(3, 0, 1, 2)
        difference = (rod - around) / noise**2
        seen = np.moveaxis(planes[:, v, u], 0, -1)
        # over either side there, as light may change along it
        over = (seen[:, :, 1:2] - seen[:, :, [0, 2]]) @ difference / max(difference @ (rod - around), 1e-9)
        on_rod = within_picture & (over.min(axis=-1) > 0.5) & (over.max(axis=-1) < 1.6)
        found[end] = bool((on_rod.sum(axis=0) > 0.8 * np.maximum(within_picture.sum(axis=0), 6)).any())
    return found[0], found[1]


def _rod_odds(parts: dict[str, float], known: int, covered: bool, settings: RodSettings) -> float:
    """Log odds that a line with so many `known` ends is a rod and not something else with two edges.

    covered : whether an end is in a shadow, or the line goes on.
    """
    bend, length, contrast = parts["net"], float(np.log(parts["length_share"])), max(parts["contrast"], 1.0)
    edges = min(0.0, parts["edges"] - settings.good_edges)
    shape = (edges, min(bend, settings.bent), length)
    terms = (
        1.0,
        float(known),
        min(0.0, parts["mean"] - settings.usual_mean),
        min(1.0, float(np.log(contrast / settings.usual_contrast))),
        min(parts["sides"], 3.0),
        parts["shadow"] * parts["off_ends"],
        min(float(np.sqrt(parts["unseen_turn"])), 1.5),
        parts["unseen"] ** 2,
        min(parts["off_clicks"], 1.0),
        min(max(0.0, parts["sharpest"] - settings.usual_sharpest), 1.0),
        *(shape if known < 2 else (0.0, 0.0, 0.0)),
        float(covered),
    )
    return sum(weight * term for weight, term in zip(settings.rod_odds, terms, strict=True))


def _holders(
    planes: np.ndarray, noise: np.ndarray, curve: np.ndarray, width: float, settings: RodSettings
) -> tuple[float, float]:
    """Log odds, for either end of a line, that what lies beyond it is not the background of one side, in whatever
    light; 0 where nothing of the picture is beyond."""
    found = []
    size = np.array(planes.shape[:0:-1]) - 1.0
    step = float(arc_lengths(curve)[-1]) / (len(curve) - 1)
    shading, other = _shading_of(len(planes), settings), 2.0 * settings.spread**2
    for order in (slice(None, None, -1), slice(None)):
        line = curve[order]
        tangent = line[-1] - line[-max(2, min(len(line), int(2.0 * width / step)))]
        tangent = tangent / max(np.hypot(*tangent), 1e-9)
        across_axis = np.array([-tangent[1], tangent[0]])
        along = np.linspace(0.8, 2.0, 7)[:, None] * width + 2.0  # two pixels may be blurred
        colours = []
        # sides as before the end, as a clamp is wider than the rod; near by there may be hairs or a shadow
        lows = (-3.0, -1.6, 0.9, 2.3)
        for way, low, high in ((1.0, -0.35, 0.35), *((-1.0, low, low + 0.7) for low in lows)):
            places = line[-1] + way * along * tangent
            at = (places[:, None] + np.linspace(low, high, 5)[:, None] * width * across_axis).reshape(-1, 2)
            at = at[np.all((at >= 0) & (at <= size), axis=1)].round().astype(int)
            colours.append(np.median(planes[:, at[:, 1], at[:, 0]], axis=1) if len(at) > 5 else None)
        beyond, *sides = colours
        if beyond is None:
            found.append(0.0)
            continue
        # as unlike as places of the sides are along the line: a weave or a grain is no clamp
        near = line[-max(4, int(8.0 * width / step)) :]
        strip = _Strip.along(planes, near, 0.3 * width, 3.0 * width, max(0.25, width / 8.0))
        along_sides = np.stack([strip.colours(low * width, (low + 0.7) * width) for low in lows])
        with np.errstate(invalid="ignore"):
            scatter = np.abs(along_sides - np.nanmedian(np.nan_to_num(along_sides), axis=2, keepdims=True))
        grain = np.nan_to_num(np.nanmedian(np.nan_to_num(scatter), axis=(0, 2))) / NORMAL_QUARTILE
        base = 2.0 * shading**2 + noise**2 + grain**2
        odds = []
        for side in (each for each in sides if each is not None):
            square, most = (beyond - side) ** 2, base + other
            lit, light = base.copy(), beyond[0] / max(side[0], 1.0)
            if len(base) > 1 and settings.darkest_shadow < min(light, 1.0 / max(light, 1e-9)):
                lit[0] = most[0]  # in a shadow or in more light
            ground = [-0.5 * float(np.sum(square / each + np.log(each))) for each in (base, lit)]
            odds.append(-0.5 * float(np.sum(square / most + np.log(most))) - max(ground))
        found.append(max(min(min(odds, default=0.0), 20.0), -20.0))
    return found[0], found[1]


def _centred(
    planes: np.ndarray, spread: np.ndarray, curve: np.ndarray, width: float, settings: RodSettings
) -> np.ndarray:
    """Points (S, 2) in the middle of the region of the rod's usual colour near a coarse curve, by dynamic
    programming."""
    fine = width / 20.0
    spacing = max(0.2 * min(width, 20.0), arc_lengths(curve)[-1] / settings.most_stations)
    strip = _Strip.along(planes, curve, spacing, 2.0 * width, fine)
    mark, scatter = (each[..., None] for each in strip.surface(-0.3 * width, 0.3 * width, 2 * len(curve)))
    variance = spread[:, None] ** 2 + scatter**2
    if len(variance) > 1:
        variance[0] += settings.light**2
    # near the rod's colour, against near that of either side
    unlike = [np.sum((strip.values - mark) ** 2 / variance[..., None], axis=0)]
    for low, high in ((-2.0 * width, -0.8 * width), (0.8 * width, 2.0 * width)):
        ground, _ = strip.surface(low, high, round(5.0 * width / spacing))
        unlike.append(np.sum((strip.values - ground[..., None]) ** 2 / variance[..., None], axis=0))
    like = np.clip(0.5 * (np.minimum(unlike[1], unlike[2]) - unlike[0]), -2.0, 2.0)
    like = np.where(strip.inside & np.isfinite(like), like, -0.5)
    like = uniform_filter1d(like, max(1, round(0.5 * width / spacing)), axis=0)
    score = 2.0 * uniform_filter1d(like, 20, axis=1, mode="nearest") - uniform_filter1d(
        like, 40, axis=1, mode="nearest"
    )
    total, came = np.pad(score[0], 1, constant_values=-np.inf), np.zeros(score.shape, int)
    before, bent = sliding_window_view(total, score.shape[1]), np.array([[0.1], [0.0], [0.1]])
    for row in range(1, len(score)):
        steps = before - bent
        came[row] = np.argmax(steps, axis=0) - 1
        total[1:-1] = np.max(steps, axis=0) + score[row]
    at = np.zeros(len(score), int)
    at[-1] = int(np.argmax(total[1:-1]))
    for row in range(len(score) - 1, 0, -1):
        at[row - 1] = at[row] + came[row, at[row]]
    return strip.stations_px + strip.across_px[at, None] * strip.normals


def _edges(
    planes: np.ndarray, spread: np.ndarray, curve: np.ndarray, width: float, settings: RodSettings, last: bool
) -> tuple[np.ndarray, float, np.ndarray]:
    """Centres (N, 2) between the rod's edges (half a width from a single edge), its width, and the mask (S,) of
    stations with two edges that far apart. last : whether edges are searched only near those of the curve.

    spread : (channels,) deviation of places of one surface.
    """
    fine = float(np.clip(width / 40.0, 0.25, 1.0))
    spacing = max(0.2 * min(width, 20.0), arc_lengths(curve)[-1] / settings.most_stations)
    strip = _Strip.along(planes, curve, spacing, 2.0 * width, fine)
    centre = len(strip.across_px) // 2
    run = 1 if last else round(settings.one_colour * width / spacing)
    mark, mark_scatter = strip.surface(-0.3 * width, 0.3 * width, run)
    ends = np.full((2, len(strip.stations_px)), np.nan)
    share = settings.edge_contrast
    for side, way in enumerate((-1, 1)):
        low, high = (0.6 * width, 2.0 * width) if way > 0 else (-2.0 * width, -0.6 * width)
        ground, scatter = strip.surface(low, high, 1 if last else round(width / spacing))
        # a highlight, plies or a shadow change one channel of a surface: others tell its edges better
        variance = spread**2 + mark_scatter**2 + scatter**2
        contrast = np.sum((mark - ground) ** 2 / variance[:, None], axis=0)
        if len(variance) > 1:
            variance[0] += (settings.light * (np.clip(0.1 * width - 1.0, 0.0, 1.0) if last else 1.0)) ** 2
        difference = (mark - ground) / variance[:, None]
        square = np.sum(difference * (mark - ground), axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            like = np.einsum("csa,cs->sa", strip.values - ground[..., None], difference) / square[:, None]
        out = like[:, centre::way] - share
        inside = strip.inside[:, centre::way]
        known = np.where(inside & np.isfinite(out), np.clip(out, share - 1.0, 1.0 - share), -1.0)
        if last:
            off = np.abs(strip.across_px[centre::way]) - 0.5 * width
            known = np.where(np.abs(off) < 0.2 * width + 1.0, known, -np.sign(off))
        # inside of the edge most is the rod's, outside of it most is not
        k = np.argmax(np.cumsum(known, axis=1), axis=1)
        rows = np.arange(len(k))
        on = np.minimum(k + 1, out.shape[1] - 1)
        good = (k > 0) & (k < on) & (contrast > 4.0) & inside[rows, on] & (out[rows, k] > 0.0) & (out[rows, on] <= 0.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            at = fine * (k + out[rows, k] / (out[rows, k] - out[rows, on]))
        ends[side, good] = way * at[good]
    widths = ends[1] - ends[0]
    width = _median_width(widths, width)
    # edges are parallel: where they are not, the one that the curve agrees with is the rod's
    known = np.isfinite(widths)
    usual = np.full(len(widths), width)
    if known.sum() > 2:
        run = min(round(settings.one_colour * width / spacing), int(known.sum()) - 1) | 1
        local = median_filter(widths[known], run, mode="mirror")
        usual = np.interp(np.arange(len(widths)), np.flatnonzero(known), local)
    either = np.stack([ends[0] + 0.5 * usual, ends[1] - 0.5 * usual])
    nearer = np.where(np.isfinite(either), np.abs(either), np.inf).argmin(axis=0)
    parallel = np.abs(widths - usual) < settings.parallel * usual + 0.5
    middles = np.where(parallel, ends.mean(axis=0), np.take_along_axis(either, nearer[None], axis=0)[0])
    with np.errstate(invalid="ignore"):
        kept = np.abs(middles) < (0.2 if last else 0.6) * width
    if last:  # one edge does where there are no two near by
        kept &= parallel | ~maximum_filter1d(parallel, round(settings.one_edge * width / spacing) | 1, mode="nearest")
    points = strip.stations_px[kept] + middles[kept, None] * strip.normals[kept]
    return points, width, parallel


def _median_width(widths: np.ndarray, before: float) -> float:
    """Median of the measured widths, NaN ignored; `before` without any."""
    return float(np.nanmedian(widths)) if np.isfinite(widths).any() else before


def _running_medians(rows: np.ndarray, run: int, mode: str) -> np.ndarray:
    """(rows, S) medians over `run` values of each row; of a single row SciPy takes a twentieth of the time."""
    return np.stack([median_filter(each, run, mode=mode) for each in rows])


def _smooth(points: np.ndarray, weights: np.ndarray, scale: float) -> np.ndarray:
    """(M, 2) evenly spaced smooth curve through points (N, 2), without bends shorter than `scale`."""
    along = arc_lengths(points)
    length = float(along[-1])
    count = max(6, int(np.ceil(length / (0.25 * scale))))
    step = length / count
    # Whittaker's smoother: the kernel of this penalty on second differences is `scale` wide
    cell = np.minimum((along / step).astype(int), count - 1)
    totals = np.bincount(cell, weights, count)
    penalty = (scale / step) ** 4 * float(weights.sum()) / count
    bands = penalty * np.array([[1.0, -4.0, 6.0]]).T * np.ones(count)
    bands[2, [0, -1]], bands[2, [1, -2]], bands[1, [1, -1]] = penalty, 5.0 * penalty, -2.0 * penalty
    bands[2] += totals
    # points lie unevenly within their cells
    sums = np.stack([np.bincount(cell, weights * axis, count) for axis in points.T], axis=1)
    knots = solveh_banded(bands, sums)
    middles = np.bincount(cell, weights * along, count) / np.maximum(totals, 1e-9)
    middles = np.where(totals > 1e-9, middles, (np.arange(count) + 0.5) * step)
    at = np.linspace(0.0, length, max(50, int(length)))
    return CubicSpline(middles, knots, bc_type="natural")(at)


def _robust(points: np.ndarray, scale: float, width: float, beyond: float) -> np.ndarray:
    """`_smooth` curve through points (N, 2) by IRLS, extrapolated by `beyond` at both ends with the curvature of its
    last three widths."""
    weights = np.ones(len(points))
    along = arc_lengths(points)
    on = np.linspace(0.0, beyond, 21)[1:]
    curve = points
    for round_ in range(5):
        pieces = [points]
        for last, places in ((False, -on[::-1]), (True, along[-1] + on)):
            near = np.abs(along - last * along[-1]) < max(3.0 * width, 2.0 * scale, beyond)
            near |= np.abs(np.arange(len(points)) - last * (len(points) - 1)) < 6
            fits = np.polyfit(along[near], points[near], 2, w=weights[near])
            piece = np.vander(places, 3) @ fits
            pieces = [*pieces, piece] if last else [piece, *pieces]
        trusted = np.pad(weights, len(on), constant_values=0.3)
        curve = _smooth(np.concatenate(pieces), trusted, scale)
        misses = offsets_from(curve, points)[1]
        off = misses / max(mad_std(misses), 0.02)
        # what is far off is something else's
        weights = huber_weights(off) if round_ < 2 else np.maximum(1.0 - (off / 5.0) ** 2, 0.0) ** 2 + 1e-3
    return curve


def _to_the_ends(
    patch: _PhotoPatch,
    curve: np.ndarray,
    width: float,
    ends: tuple[np.ndarray | None, np.ndarray | None],
    beyond: float,
    settings: RodSettings,
) -> tuple[np.ndarray, tuple[bool, bool], float]:
    """The part of the curve (M, 2) that is on the rod, or between its ends where they are known; whether it ends within
    the picture; and the share of it that something hides. beyond : length by which the curve goes on past the measured
    points."""
    planes, noise = patch.planes, patch.noise
    count = len(curve)
    step = float(arc_lengths(curve)[-1]) / (count - 1)
    strip = _Strip.along(planes, curve, 0.0, 1.75 * width, max(0.25, width / 12.0))
    size = np.array(planes.shape[:0:-1]) - 1.0
    inside = np.all((curve >= -0.5) & (curve <= size + 0.5), axis=1)
    mark = strip.colours(-0.25 * width, 0.25 * width)
    grounds = [strip.colours(low * width, high * width) for low, high in ((-1.75, -1.0), (1.0, 1.75))]
    measured = np.abs(np.arange(count) - 0.5 * (count - 1)) * step < 0.5 * count * step - beyond
    known = np.flatnonzero(np.isfinite(mark[0]) & measured)
    if len(known) < 4:
        return curve[:0], (True, True), 0.0  # nothing of it is in the picture
    shading = _shading_of(len(planes), settings)
    run = min(round(settings.one_colour * width / step), len(known) - 1) | 1
    nearest = np.clip(np.arange(count) - known[run // 2], 0, len(known) - 2 * (run // 2) - 1)

    def log_density(surface: np.ndarray) -> np.ndarray:
        """(M,) log density of the picture along the curve if it shows this surface (channels, M), which looks there as
        it does nearby."""
        usual = _running_medians(np.nan_to_num(surface[:, known]), run, "nearest")
        scatter = np.quantile(np.abs(surface[:, known] - usual), 0.9, axis=1) / 1.645  # plies and highlights count
        std = np.sqrt(shading**2 + noise**2 + np.nan_to_num(scatter) ** 2)[:, None]
        off = mark - usual[:, run // 2 : len(known) - run // 2][:, nearest]
        return np.nan_to_num(np.sum(-0.5 * (off / std) ** 2 - np.log(std), axis=0), nan=-1e9)

    other = len(planes) * -np.log(settings.spread)
    seen = log_density(mark)
    on_rod = np.logaddexp(seen, np.log(settings.hidden) + other)
    off_rod = np.logaddexp(*(log_density(each) for each in grounds)) + np.log(0.5)
    off_rod = np.logaddexp(off_rod, np.log(settings.chance) + other)
    odds = np.maximum(on_rod - off_rod, settings.gap)
    # it differs from one of its sides: between two sides of its own colour there is its clamp
    base = 2.0 * (shading**2 + noise**2)[:, None]
    apart = np.max([np.nan_to_num(np.sum((mark - ground) ** 2 / base, axis=0), nan=99.0) for ground in grounds], axis=0)
    odds = np.where(apart < 4.0, settings.gap, odds)

    def run_out(known_end: np.ndarray | None, order: np.ndarray) -> tuple[int, bool]:
        """Index of the last place on the rod in this order, and whether it is within the picture."""
        if known_end is not None:  # in the picture, though the smooth curve may leave it there
            return int(np.argmin(np.hypot(*(curve - known_end).T))), True
        run = order[count // 2 :]
        out = ~inside[run]
        last = int(np.argmax(out)) if out.any() else len(run)
        at = int(np.argmax(np.cumsum(odds[run[:last]]))) if last else 0
        way = curve[run[at]] - curve[run[max(at - round(width / step), 0)]]
        near = 0.5 * width + 5.0
        reach = curve[run[at]] + way / max(np.hypot(*way), 1e-9) * near
        if np.all((reach >= -0.5) & (reach <= size + 0.5)):
            return int(run[at]), True
        return int(run[last - 1]) if last - at < 2 * round(near / step) else int(run[at]), False

    everything = np.arange(count)
    start, seen_first = run_out(ends[0], everything[::-1])
    end, seen_last = run_out(ends[1], everything)
    hidden = seen[start : end + 1] < np.log(settings.hidden) + other
    return curve[start : end + 1], (seen_first, seen_last), float(hidden.mean()) if len(hidden) else 0.0


def _other(middle: np.ndarray, sides: list[np.ndarray], least_chroma: float) -> np.ndarray:
    """(S,) 1 where the hue of the line's colours (channels, S) differs unusually from its usual hue and from its
    neighbourhood's, else 0."""
    own, contrast = middle[1:], (middle - 0.5 * (sides[0] + sides[1]))[1:]
    known = np.isfinite(contrast).all(axis=0)
    if len(own) == 0 or not known.any():
        return np.zeros(middle.shape[1])
    usual = np.median(contrast[:, known], axis=1)
    size = float(np.hypot(*usual))
    if not size > least_chroma:
        return np.zeros(middle.shape[1])
    along = usual @ contrast / size**2
    across = np.hypot(*(contrast - along * usual[:, None])) / size
    unlike = (across > 0.7) | ((along < 0.0) & (np.hypot(*contrast) > 0.4 * size))
    # where the background changes and the rod does not, or by less as it reflects it, it is the same rod
    around = 0.5 * (sides[0] + sides[1])[1:]
    change, behind = (np.hypot(*(each - np.median(each[:, known], axis=1)[:, None])) for each in (own, around))
    return (unlike & (change > np.maximum(0.7 * size, 0.5 * behind))).astype(float)


def _shadowed(middle: np.ndarray, side: np.ndarray, shading: np.ndarray, settings: RodSettings) -> np.ndarray:
    """(S,) from 0 to 1: similarity of colours (channels, S) to one side's in less light; 0 in a grey picture."""
    if len(middle) == 1:
        return np.zeros(middle.shape[1])
    with np.errstate(invalid="ignore", divide="ignore"):
        light = middle[0] / np.maximum(side[0], 1.0)
        chroma = side[1:] * light * (side[0] + settings.dark) / (middle[0] + settings.dark)  # as `_opponent` has it
        off = np.sum(((middle[1:] - chroma) / (4.0 * shading[1:, None])) ** 2, axis=0)
        there = np.exp(-0.5 * off) * ((light > settings.darkest_shadow) & (light < 0.95))
    return np.where(np.isfinite(there), there, 0.0)


@dataclass(frozen=True, eq=False)
class RodLine:
    """A rod's centreline, from clamp to tip."""

    points_px: np.ndarray  # (N, 2) measured middles of the rod, in order
    curve_px: np.ndarray  # (M, 2) smooth line through them from clamp to tip, evenly spaced
    width_px: float  # median
    tip_inside: bool  # whether its tip is known, or in the picture with nothing beyond it
    centre_px: np.ndarray  # (2,) middle of the picture
    clamp_supposed: bool = False  # the clamped end was chosen only for being the higher one

    @property
    def length_px(self) -> float:
        """Arc length from clamp to tip."""
        return float(arc_lengths(self.curve_px)[-1])


@dataclass(frozen=True, eq=False)
class RodSearch:
    """Candidate centrelines of the rod, the likeliest first, and the reason why the first cannot be used, if any."""

    candidates: list[_MeasuredRod]
    centre_px: np.ndarray
    clamp: np.ndarray | None
    tip: np.ndarray | None
    settings: RodSettings = field(default_factory=RodSettings)

    def line(self, candidate: int | None = None) -> RodLine:
        """The rod's centreline: the likeliest, or the candidate of this number, counted from 1.

        Raises InputError where none stands out, or where two may be meant.
        """
        if candidate is not None:
            if not 1 <= candidate <= len(self.candidates):
                what = f"there is no candidate {candidate}, only {len(self.candidates)}"
                raise InputError(what, remedy="take a number of the picture with the candidates")
            chosen = self.candidates[candidate - 1]
            return self._directed(replace(chosen, free=chosen.inside))
        odds = np.array([0.0, *(line.evidence for line in self.candidates)])
        shares = np.exp(odds - odds.max())
        shares /= shares.sum()  # the probabilities of no rod, and of each candidate
        known = self.clamp is not None and self.tip is not None
        if shares[1:].max(initial=0.0) > self.settings.least_probability[known]:
            return self._directed(self.candidates[int(shares[1:].argmax())])
        remedy = "check --clamp and --tip" if known else "give --clamp U,V and --tip U,V"
        if self.candidates:
            remedy += ", or choose with --candidate N"
        likely = np.flatnonzero(shares[1:] > shares[0]) + 1
        if len(likely) > 1:
            numbers = ", ".join(map(str, likely[:-1])) + f" and {likely[-1]}"
            raise InputError(f"{len(likely)} things in it may be the rod: candidates {numbers}", remedy=remedy)
        where = " between clamp and tip" if known else ""
        raise InputError(f"no rod can be made out{where}: nothing stands out like one", remedy=remedy)

    def _directed(self, found: _MeasuredRod) -> RodLine:
        """The line in the order from clamp to tip."""
        free, inside, ends, supposed = found.free, found.inside, found.curve_px[[0, -1]], False
        if self.clamp is not None or self.tip is not None:
            turned = False  # it was fitted from the clamp to the tip
        elif free[0] != free[1]:
            turned = free[0]
        elif inside[0] != inside[1]:
            turned = inside[1]  # something holds it in the picture
        elif all(inside) and abs(found.holder[0] - found.holder[1]) > self.settings.least_holder_lead:
            turned = found.holder[1] > found.holder[0]
        else:
            turned, supposed = ends[0, 1] > ends[1, 1], all(inside)  # a rod hangs down from its clamp
        order = slice(None, None, -1) if turned else slice(None)
        return RodLine(
            found.points_px[order],
            found.curve_px[order],
            found.width_px,
            free[0] if turned else free[1],
            self.centre_px,
            supposed,
        )


def search_rod(
    picture: np.ndarray,
    clamp: np.ndarray | None = None,
    tip: np.ndarray | None = None,
    settings: RodSettings | None = None,
) -> RodSearch:
    """Candidate centrelines of a rod in a picture (H, W) or (H, W, 3). Raises InputError for ends outside the
    picture."""
    height, width = picture.shape[:2]
    for name, place in (("clamp", clamp), ("tip", tip)):
        if place is not None and not (0 <= place[0] <= width - 1 and 0 <= place[1] <= height - 1):
            raise InputError(f"the {name} {place[0]:g},{place[1]:g} is outside the picture of {width}x{height} pixels")
    settings = settings or RodSettings()
    middle = 0.5 * (np.array([width, height]) - 1.0)
    times = int(0.5 / _most_scale((height, width), settings))
    if times > 1:  # in twice the scale of the search the narrowest rods are 5 px wide: more pixels are of no use
        whole = picture[: height // times * times, : width // times * times]
        small = cv2.resize(whole, None, fx=1.0 / times, fy=1.0 / times, interpolation=cv2.INTER_AREA)
        last = np.array(small.shape[1::-1]) - 1.0
        first, end = (None if each is None else np.clip((each + 0.5) / times - 0.5, 0.0, last) for each in (clamp, tip))
        lines = [each.enlarged(times) for each in search_rod(small, first, end, settings).candidates]
        return RodSearch(lines, middle, clamp, tip, settings)
    planes = _opponent(picture, settings)
    if clamp is not None and tip is not None:
        found = _between(planes, clamp, tip, settings)
    else:
        settings = replace(settings, chroma_spread=settings.spread)  # shadows and highlights have the surface's hue
        paths: list[_RodPath] = []
        for at in _levels_of(planes, settings):
            paths += _paths_at(at, (clamp, tip), settings, (settings.most_cost_alone, settings.gap))
        paths.sort(key=lambda path: -path.evidence)
        groups = _grouped(paths, settings)
        groups += [[piece] for group in groups for path in group for piece in _pieces(path, settings)]
        found = _lines(planes, groups, [clamp, tip], settings)
    found.sort(key=lambda fit: -fit.evidence)
    return RodSearch(_different(found, settings), middle, clamp, tip, settings)


def _between(planes: np.ndarray, clamp: np.ndarray, tip: np.ndarray, settings: RodSettings) -> list[_MeasuredRod]:
    """Lines from clamp to tip."""
    # a known end leaves few places to look at: there is time for thinner rods
    levels = _levels_of(planes, settings, settings.width_step)
    ends, rejected = (clamp, tip), list[_RodPath]()
    found: list[_MeasuredRod] = []
    for search in range(settings.searches):
        # the shortest way is often across the background, which says as much against a rod from then on as it can
        gap = -np.inf if search else settings.gap
        against = [partial(_occupied, rejected, ends, settings)] if search > 1 else []
        lines, more = _measured(planes, levels, ends, settings, gap, against)
        found, rejected = [*found, *lines], [*rejected, *more]
        likely = any(line.evidence > 0.0 for line in found) or not more
        if (search and likely) or any(line.is_whole(settings) for line in found):
            break
    coloured = [line for line in found if line.parts["mean"] > settings.coloured_mean]
    best = max(coloured, key=lambda line: line.evidence, default=None)
    if best is not None and not any(line.is_good(settings) for line in found):
        # of one colour, as at the ends
        colours = best.end_colours(planes)
        found += _measured(planes, levels, ends, settings, settings.gap, [partial(_unlike, colours, settings)])[0]
    return found


def _measured(
    planes: np.ndarray,
    levels: list[tuple[_Level, float]],
    ends: tuple[np.ndarray, np.ndarray],
    settings: RodSettings,
    gap: float,
    against: Sequence[_Against],
) -> tuple[list[_MeasuredRod], list[_RodPath]]:
    """Measured lines from clamp to tip, searching from the widest ribbons to the narrowest until one is a good rod; and
    the paths along which there is none.

    gap : least log odds of a correlation length of the paths that are measured. against : log odds that are taken off
        the evidence.
    """
    found: list[_MeasuredRod] = []
    rejected: list[_RodPath] = []
    bound, mean, (clamp, tip) = settings.most_cost, 0.0, ends
    for at in levels:
        width_px = at[1]
        if any(line.is_good(settings) and line.width_px > 1.8 * width_px for line in found):
            break
        for path in _paths_at(at, ends, settings, (bound, gap), against):
            length = max(arc_lengths(path.path_px)[-1], np.hypot(*(tip - clamp)))  # wide paths end short of the ends
            mean = max(mean, path.mean)
            if length < settings.least_aspect * width_px or path.mean < max(settings.least_path_mean, mean - 1.0):
                continue
            known = (line for line in found if line.is_whole(settings) and width_px < 1.5 * line.width_px)
            if any(line.contains(path.path_px) for line in known):
                continue
            line = _fitted(planes, path, clamp, tip, settings)
            if line is not None:
                found.append(line)
            if line is None or line.evidence < settings.no_rod:
                rejected.append(path)
            elif line.evidence > 0.0:
                bound = min(bound, settings.slack[0] * path.cost + settings.slack[1])
    return found, rejected


def _lines(
    planes: np.ndarray, groups: list[list[_RodPath]], ends: list[np.ndarray | None], settings: RodSettings
) -> list[_MeasuredRod]:
    """The measured lines, at most one of each group of paths."""
    found: list[_MeasuredRod] = []
    for group in groups:
        likely: _MeasuredRod | None = None
        done = False
        for path in group:
            if likely is not None and done and path.width_px < 1.7 * likely.width_px:
                continue
            fit = _fitted(planes, path, ends[0], ends[1], settings)
            if fit is None:
                continue
            if likely is not None and fit.width_px < 1.7 * likely.width_px:
                gain = fit.parts["ribbon"] - likely.parts["ribbon"]
                # a path with less evidence needs more along its line
                if gain <= settings.least_gain * group[0].evidence * (path.evidence < 0.9 * group[0].evidence):
                    continue
                found.remove(likely)
            likely, done = fit, fit.parts["mean"] > settings.whole_mean and 0.6 < fit.width_px / path.width_px < 1.7
            found.append(fit)
        # it may be a highlight, a stripe or an edge along a wider one
        if likely is not None and (likely.evidence > 0.0 or likely.parts["sides"] > settings.one_sided):
            wider = (
                replace(group[0], path_px=likely.curve_px, width_px=times * likely.width_px) for times in (3.0, 6.0)
            )
            fits = (_fitted(planes, path, ends[0], ends[1], settings) for path in wider)
            found += [fit for fit in fits if fit is not None and fit.width_px > 1.7 * likely.width_px]
    pairs = (_joined(planes, one, other, settings) for one, other in combinations(found, 2))
    rods = (rod for rod in pairs if rod is not None)
    # but for those that were measured as one
    return found + [
        rod
        for rod in rods
        if not any(each.contains(rod.curve_px) and each.width_px > 0.8 * rod.width_px for each in found)
    ]


def _grouped(paths: list[_RodPath], settings: RodSettings) -> list[list[_RodPath]]:
    """The best paths that differ from all better ones over half their length, each with variants of other widths."""
    groups: list[list[_RodPath]] = []
    for path in paths:
        group = next((each for each in groups if _shared(path, each[0], settings) > 0.5), None)
        if group is None:
            if len(groups) < settings.candidates:
                groups.append([path])
        elif len(group) == 1 and not 0.9 < path.width_px / group[0].width_px < 1.1:
            group.append(path)
    return groups


def _different(found: list[_MeasuredRod], settings: RodSettings) -> list[_MeasuredRod]:
    """Lines that do not run along likelier ones, nor within a much wider line that is a rod."""
    kept: list[_MeasuredRod] = []
    for line in found:
        wider = (each for each in found if each.is_whole(settings) and each.width_px > 1.7 * line.width_px)
        if not any(each.contains(line.curve_px, 0.5) for each in kept) and not any(
            each.contains(line.curve_px) for each in wider
        ):
            kept.append(line)
    return kept
