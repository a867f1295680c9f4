"""The middle line of a rod in one photograph: a path between its two ends, then both edges across that path.

The only assumption is that the rod is brighter, or darker, than its surroundings all along. Pixel (0, 0) is the middle
of the upper left one. The path is the shortest one by Dijkstra where contrast is cheap; the edges are where the rod's
contrast is lost, searched from the inside, so that hairs that stick out do not count. Hairs that lie along the rod do:
points at which it is wider or narrower than near by are left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.interpolate import make_smoothing_spline
from scipy.ndimage import map_coordinates, median_filter
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.polyline import arc_lengths, beside, normals
from vbaa_calib.core.robust import huber_weights, mad_std

_PATH_SIDE = 500  # longest side, in pixels, of the reduced picture in which the path is looked for
_LEAST_CONTRAST = 12.0  # grey levels by which a rod stands out at least
_LEAST_ELONGATION = 6.0  # length over width, below which it is no rod
_RIVAL = 0.4  # a second elongated thing this long, relative to the longest, may be the rod as well
_ROUNDS = 3
_FINE = 0.25  # spacing, in pixels, at which profiles across the rod are read
_SMOOTHING_WIDTHS = 0.5  # along the rod, in widths: a twisted yarn's plies are lumps of about one width
_LEAST_SMOOTHING_PX = 6.0
_EDGE = 0.6  # of the contrast that is left at an edge: a tangle of hairs beside a yarn has about half of it
_LEAST_POINTS = 12
_LONGEST_GAP = 0.15  # of the rod's length, without any point
_WIDTH_TOLERANCE = 4.0  # deviations of the width from its neighbours' beyond which a point is left out


@dataclass(frozen=True, eq=False)
class RodLine:
    """A rod's middle line, from clamp to tip."""

    points_px: np.ndarray  # (N, 2) measured middles of the rod, in order
    curve_px: np.ndarray  # (M, 2) smooth line through them from clamp to tip, evenly spaced
    width_px: float  # median
    wander_px: float  # standard deviation of points about the curve
    tip_inside: bool  # whether the rod ends within the picture
    centre_px: np.ndarray  # (2,) middle of the picture

    @property
    def length_px(self) -> float:
        """Arc length from clamp to tip."""
        return float(arc_lengths(self.curve_px)[-1])


def find_rod(grey: np.ndarray, clamp: np.ndarray | None = None, tip: np.ndarray | None = None) -> RodLine:
    """The rod's line in a grey picture (H, W) uint8; its ends (2,) in pixels as clicked, or None to look for them.

    Raises InputError where no rod stands out, where two may be meant, or where it is not told which end is the clamp.
    """
    height, width = grey.shape
    for name, place in (("clamp", clamp), ("tip", tip)):
        if place is not None and not (0 <= place[0] <= width - 1 and 0 <= place[1] <= height - 1):
            raise InputError(f"the {name} {place[0]:g},{place[1]:g} is outside the picture of {width}x{height} pixels")
    shrink = min(1.0, _PATH_SIDE / max(grey.shape))
    small = cv2.resize(grey, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
    standing = _standing_out(small, None if clamp is None else (clamp + 0.5) * shrink - 0.5)
    path = (_path(standing, *_ends(standing, shrink, clamp, tip)) + 0.5) / shrink - 0.5
    return _measured(grey, path, clamp, tip)


def _standing_out(small: np.ndarray, on_rod: np.ndarray | None) -> np.ndarray:
    """(H, W) how far each pixel is from the background towards the rod: 0 none, 1 where half of the picture's is."""
    size = min(255, (max(15, min(small.shape) // 2)) | 1)
    far = small.astype(float) - cv2.medianBlur(small, size)
    noise, best, shares = mad_std(far), 0.0, np.zeros(small.shape)
    for sign in (1.0, -1.0):
        contrast = np.clip(sign * far, 0.0, 255.0)
        otsu = float(cv2.threshold(contrast.astype(np.uint8), 0, 255, cv2.THRESH_OTSU)[0])
        # a thin rod is too few pixels for Otsu, which then halves the noise
        level = max(otsu, 5.0 * noise, _LEAST_CONTRAST)
        mask = contrast > level
        if not mask.any():
            continue
        score = max((length for length, *_ in _pieces(mask)), default=0.0) * float(contrast[mask].mean())
        if on_rod is not None:
            u, v = np.rint(on_rod).astype(int)
            score *= 1e-3 + mask[max(v - 4, 0) : v + 5, max(u - 4, 0) : u + 5].any()
        if score > best:
            best, shares = score, contrast / level
    if best == 0.0:
        remedy = "light it so that all of it is brighter, or darker, than what is behind it"
        raise InputError("no rod stands out from its surroundings", remedy=remedy)
    return shares


def _pieces(mask: np.ndarray) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """(length, first end, last end) of each elongated piece of a mask (H, W), the longest first."""
    count, labels, statistics, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    found = []
    for label in range(1, count):
        left, top, wide, high, area = statistics[label]
        if np.hypot(wide, high) < 0.1 * max(mask.shape):
            continue
        box = labels[top : top + high, left : left + wide] == label
        graph = _graph(np.where(box, 1.0, np.inf))
        away = dijkstra(graph, indices=int(np.flatnonzero(box)[0]))
        first = int(np.argmax(np.where(np.isfinite(away), away, -1.0)))
        away = dijkstra(graph, indices=first)
        last = int(np.argmax(np.where(np.isfinite(away), away, -1.0)))
        length = float(away[last])
        if length * length > _LEAST_ELONGATION * area:
            one, other = (np.array([end % wide + left, end // wide + top], float) for end in (first, last))
            found.append((length, one, other))
    return sorted(found, key=lambda piece: -piece[0])


def _ends(
    standing: np.ndarray, shrink: float, clamp: np.ndarray | None, tip: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Clamp and tip (2,) each in the reduced picture: as clicked, or the ends of the longest piece."""
    given = [None if place is None else (place + 0.5) * shrink - 0.5 for place in (clamp, tip)]
    if given[0] is not None and given[1] is not None:
        return given[0], given[1]
    pieces = _pieces(standing > 1.0)
    if not pieces:
        raise InputError("no rod in it: nothing long and thin stands out", remedy="give --clamp U,V and --tip U,V")
    known = given[0] if given[0] is not None else given[1]
    if known is not None:
        pieces.sort(key=lambda piece: min(np.hypot(*(end - known)) for end in piece[1:]))
    if max((piece[0] for piece in pieces[1:]), default=0.0) > _RIVAL * pieces[0][0]:
        raise InputError(f"{len(pieces)} things in it may be the rod", remedy="give --clamp U,V and --tip U,V")
    _, first, last = pieces[0]
    if known is not None:
        other = max((first, last), key=lambda end: float(np.hypot(*(end - known))))
        return (known, other) if given[0] is not None else (other, known)
    bounds = np.array(standing.shape[::-1]) - 1.0
    room = [float(min(end.min(), (bounds - end).min())) for end in (first, last)]
    if min(room) > 2.0:
        raise InputError("both ends of the rod are in the picture", remedy="say which is clamped: --clamp U,V")
    if max(room) < 2.0:
        raise InputError("the rod leaves the picture at both ends", remedy="say where it is clamped: --clamp U,V")
    return (first, last) if room[0] < room[1] else (last, first)


def _graph(cost: np.ndarray) -> coo_matrix:
    """Edges between neighbouring pixels of costs (H, W), as long as the step times the mean cost; inf: no way."""
    number = np.arange(cost.size).reshape(cost.shape)
    pairs = (
        (np.s_[:, :-1], np.s_[:, 1:], 1.0),
        (np.s_[:-1], np.s_[1:], 1.0),
        (np.s_[:-1, :-1], np.s_[1:, 1:], 2**0.5),
        (np.s_[:-1, 1:], np.s_[1:, :-1], 2**0.5),
    )
    rows, columns, lengths = [], [], []
    for one, other, step in pairs:
        length = step * 0.5 * (cost[one] + cost[other]).ravel()
        there = np.isfinite(length)
        for a, b in ((one, other), (other, one)):
            rows.append(number[a].ravel()[there])
            columns.append(number[b].ravel()[there])
            lengths.append(length[there])
    edges = (np.concatenate(rows), np.concatenate(columns))
    return coo_matrix((np.concatenate(lengths), edges), (cost.size, cost.size)).tocsr()


def _path(standing: np.ndarray, clamp: np.ndarray, tip: np.ndarray) -> np.ndarray:
    """(N, 2) the cheapest way from clamp to tip, in the middle of what stands out rather than along its side."""
    cost = 1.0 / (0.03 + np.clip(cv2.GaussianBlur(standing, (0, 0), 2.0), 0.0, 1.5)) ** 2
    columns = cost.shape[1]
    start, end = (int(np.rint(place[1])) * columns + int(np.rint(place[0])) for place in (clamp, tip))
    before = dijkstra(_graph(cost), indices=start, return_predecessors=True)[1]
    way = [end]
    while way[-1] != start:
        way.append(int(before[way[-1]]))
    return np.array([[place % columns, place // columns] for place in way[::-1]], float)


def _measured(grey: np.ndarray, path: np.ndarray, clamp: np.ndarray | None, tip: np.ndarray | None) -> RodLine:
    """Edges across the path, in rounds in which path and width are those of the round before."""
    picture = cv2.GaussianBlur(grey, (0, 0), 0.7).astype(float)
    length = arc_lengths(path)[-1]
    curve, width = _smooth(path, np.ones(len(path)), 0.02 * length), 0.06 * length
    points = curve
    for first in (True, *(False,) * _ROUNDS):
        points, widths = _edges(picture, curve, width, first)
        if len(points) < _LEAST_POINTS:
            raise InputError("the rod's edges cannot be made out", remedy="light it evenly, before a plain background")
        width = _median_width(widths, width)
        widths = np.where(np.isfinite(widths), widths, width)
        if first:  # the path begins and ends in corners of the rod
            away = [np.hypot(*(points - end).T) > width for end in (path[0], path[-1])]
            points, widths = points[away[0] & away[1]], widths[away[0] & away[1]]
        usual = median_filter(widths, 9, mode="mirror")
        kept = np.abs(widths - usual) < _WIDTH_TOLERANCE * max(mad_std(widths - usual), 0.02 * width)
        points = points[kept]
        scale = max(_SMOOTHING_WIDTHS * width, _LEAST_SMOOTHING_PX)
        curve, misses = _robust(points, scale, width)
    curve, inside = _to_the_ends(picture, curve, width, clamp, tip)
    if np.hypot(*np.diff(points, axis=0).T).max() > _LONGEST_GAP * length:
        raise InputError("a long piece of the rod cannot be seen", remedy="clear what hides, touches or crosses it")
    for name, end, sought in (("clamp", curve[0], path[0]), ("tip", curve[-1], path[-1])):
        if np.hypot(*(end - sought)) > max(2.0 * width, 0.03 * length):
            what = f"the rod cannot be followed to its {name} near {sought[0]:.0f},{sought[1]:.0f}"
            raise InputError(what, remedy="clear what touches or crosses it, and check --clamp and --tip")
    width = _median_width(_edges(picture, curve, width, False, 0.5)[1], width)
    return RodLine(points, curve, width, mad_std(misses), inside, 0.5 * (np.array(grey.shape[::-1]) - 1.0))


def _smooth(points: np.ndarray, weights: np.ndarray, scale: float) -> np.ndarray:
    """(M, 2) smooth curve by points (N, 2), evenly spaced, on which bends shorter than the scale are lost."""
    along = arc_lengths(points)
    moved = np.append(True, np.diff(along) > 1e-9)
    along, points, weights = along[moved], points[moved], weights[moved]
    # the kernel of a smoothing spline with this penalty is `scale` wide
    penalty = scale**4 * float(weights.sum()) / along[-1]
    at = np.linspace(0.0, along[-1], max(50, int(along[-1] / 2.0)))
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


def _edges(
    picture: np.ndarray, curve: np.ndarray, width: float, first: bool, share: float = _EDGE
) -> tuple[np.ndarray, np.ndarray]:
    """Middles (N, 2) between both edges, at which this share of the contrast is left, and the widths (N,) there; where
    only one is within the picture, half a width from that, and NaN. In the `first` round, `width` is only how far to
    look."""
    reach = width if first else 2.0 * width
    stations = curve[:: max(1, round(0.2 * min(width, 20.0) / max(arc_lengths(curve[:2])[-1], 1e-9)))]
    normal = normals(stations)
    across = np.arange(-np.ceil(reach / _FINE) * _FINE, reach + _FINE, _FINE)
    places = stations[:, None] + across[:, None] * normal[:, None]
    profiles = map_coordinates(picture, [places[..., 1], places[..., 0]], order=1, mode="nearest")
    within = np.abs(across) <= (1.0 if first else 0.3 * width)
    inner = np.median(profiles[:, within], axis=1)
    middles, widths = [], []
    for place, aside, mark, rows in zip(stations, normal, inner, profiles, strict=True):
        ends = np.full(2, np.nan)
        for side, sign in enumerate((-1.0, 1.0)):
            ground = np.median(rows[(sign * across > (0.0 if first else 0.6 * width))])
            if abs(mark - ground) < _LEAST_CONTRAST:
                continue
            out = ((rows - ground) / (mark - ground))[:: int(sign)][len(across) // 2 :]
            k = int(np.argmax(out < share))
            if k > 0:
                ends[side] = sign * _FINE * (k - (share - out[k]) / (out[k - 1] - out[k]))
        inside = _within(picture, place + ends[:, None] * aside)
        cut = ~_within(picture, place + np.array([[-0.5], [0.5]]) * width * aside)
        middle, broad = ends.mean(), ends[1] - ends[0]
        if not first and cut.sum() == 1 and (inside == ~cut).all():
            # the border cuts one edge off: the rod is as wide there as elsewhere
            middle, broad = ends[inside][0] + (-0.5 if cut[0] else 0.5) * width, np.nan
        elif not inside.all():
            continue
        if first or abs(middle) < 0.2 * width:
            middles.append(place + middle * aside)
            widths.append(broad)
    return np.reshape(middles, (-1, 2)), np.array(widths)


def _median_width(widths: np.ndarray, before: float) -> float:
    """Of those that were measured, not NaN; the one before where none was."""
    return float(np.nanmedian(widths)) if np.isfinite(widths).any() else before


def _within(picture: np.ndarray, places: np.ndarray, margin: float = 0.0) -> np.ndarray:
    """(N,) which places (N, 2) are within a picture (H, W), or so many pixels beyond."""
    last = np.array(picture.shape[::-1]) - 1.0
    return np.all((places >= -margin) & (places <= last + margin), axis=1)


def _to_the_ends(
    picture: np.ndarray, curve: np.ndarray, width: float, clamp: np.ndarray | None, tip: np.ndarray | None
) -> tuple[np.ndarray, bool]:
    """The part of the curve (M, 2) from clamp to tip, and whether the tip is in the picture."""
    fit = max(2, round(0.5 * width / arc_lengths(curve[:2])[-1]))
    normal = normals(curve)
    aside = np.linspace(-0.25, 0.25, 7) * width
    places = curve[:, None] + aside[:, None] * normal[:, None]
    grey = map_coordinates(picture, [places[..., 1], places[..., 0]], order=1, mode="nearest").mean(axis=1)
    apart = curve[:, None] + np.array([-1.5, 1.5])[:, None] * width * normal[:, None]
    ground = map_coordinates(picture, [apart[..., 1], apart[..., 0]], order=1, mode="nearest").mean(axis=1)
    inside = _within(picture, curve, 0.5)
    rod, around = np.median(grey[5 * fit : -5 * fit]), np.median(ground[5 * fit : -5 * fit])
    # not the ground beside each place: near a border that is outside the picture
    on_rod = (grey - around) / (rod - around) > 0.5

    def last_on_rod(clicked: np.ndarray | None, order: slice) -> tuple[int, bool]:
        """Index of the last place on the rod in this direction, and whether it is within the picture."""
        start = len(curve) // 2
        run = np.arange(len(curve))[order]
        run = run[start:] if order.step is None else run[len(curve) - 1 - start :]
        if clicked is not None and np.hypot(*(curve - clicked).T).min() < width:
            near = int(np.argmin(np.hypot(*(curve - clicked).T)))
            return near, bool(inside[near])
        off = ~on_rod[run]
        # a dark ply is not the end
        gone = off & (np.convolve(off, np.ones(fit), "full")[fit - 1 :][: len(off)] >= fit - 0.5)
        last = int(np.argmax(gone | ~inside[run])) - 1 if (gone | ~inside[run]).any() else len(run) - 1
        return int(run[last]), bool(inside[run[min(last + fit, len(run) - 1)]])

    first, _ = last_on_rod(clamp, slice(None, None, -1))
    last, seen = last_on_rod(tip, slice(None))
    return curve[first : last + 1], seen
