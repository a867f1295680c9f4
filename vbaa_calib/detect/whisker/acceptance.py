"""Acceptance: whether fitted profiles show the antenna, what of it is seen or hidden, and where it ends."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.polynomial.chebyshev import chebvander

from vbaa_calib.core import smooth
from vbaa_calib.core.compiled import kernel
from vbaa_calib.core.polyline import arc_lengths, beside
from vbaa_calib.core.robust import MAD_SCALE
from vbaa_calib.core.smooth import END_VALUE, median, running_mean

from .centreline import Centreline, Verdict, Visibility
from .crossings import Crossings, moved
from .path_refinement import Known, usual_level
from .visible_end import VisibleEnd

LEAST_SEEN, LEAST_SEEN_INSIDE = 0.3, 0.5
"""Least fraction of the guide that must be seen, and, of a line that is not clear, of what of it is in the picture."""
LEAST_ROOT, ROOT = 0.35, 0.33
"""Least fraction that must be seen of the first part of the guide: the antenna starts at the clamp."""
NARROW, BROAD, LEAST_SEEN_BROAD = 0.3, 1.8, 0.85
"""Narrower than the first it is none. Broader than the second it may be out of focus, or a soft edge: more must be
seen of it."""
WANDER_PX, WANDER_SIGMA = 0.25, (1.35, 2.7)
"""Root mean square distance of the points from a curve as smooth as an antenna's: pixels, and deviations, together;
more of these where the polarity may change: neighbours share their errors there."""
_WANDER_ORDER = 6
"""Order of that curve."""
_SNAKING_RAD = 0.25
"""Most that its direction turns to and fro beyond the turn from end to end: a cantilever bends one way."""
LEAST_CONTRAST, CLEAR_CONTRAST = 2.0, 8.0
"""Least height over the noise of a pixel; and of an antenna that is clear."""
FAINT = 0.4
"""A line fainter than this part of the usual height is another thing's."""
OTHER_LINE_SEEN = 0.7
"""A second line of which this much is seen, of what is seen of the first, makes the picture ambiguous."""
LEAST_SEEN_CHANGING, BROAD_CHANGING, EDGE = 0.5, 1.1, 0.3
"""Of a line that may be here bright, there dark, more must be seen, still more of a broader one; its background may
differ from side to side by this part of its height: more is the edge of a cable broader than the antenna."""
_LEAST_WHOLE = 0.65
"""Least part of such a line that must be seen beside its longest gap."""
TRANSPARENT, NEARBY, VARIES = 0.5, 41, (0.25, 0.15)
"""Such a line that follows its background's brightness by so much, over what so many profiles have in common, is only
that background; where both vary, by so much of the line's height."""
USUAL, FAMILIAR, MORE_FAMILIAR = 2.0, 0.7, 0.2
"""Deviations within which a point is as bright as the antenna usually is; from which share of its points on, and by how
much more than on its flanks, a line is the antenna, however bright its background."""
_ALIKE_PROFILES = 15
"""So many neighbouring profiles lie before the same thing."""
MOVED = 0.1
"""Part of its length by which the antenna lies at most off where it is expected, in the mean of its points."""
LEAST_POINTS = 12
_SLOPES = np.diff(chebvander(np.linspace(-1.0, 1.0, 41), _WANDER_ORDER), axis=0)


_SEEN, _HIDDEN, _OUTSIDE, _BEYOND = map(int, Visibility)


class FittedLine(NamedTuple):
    """A line fitted to N profiles, not yet accepted as the antenna.

    Attributes
    ----------
    centre, course : (N,) along the profiles, px; the course is smooth.
    sigma_px, effective_px : (N,) standard deviation across the line; and of a point that counts as independent.
    kept : (N,) where it was measured.
    height : (N,) grey levels. noise : of a pixel, grey levels.
    breadth : over what an antenna in focus has. changing : whether it may be here brighter, there darker.
    sure : mean over what is kept of how surely it is a line, not one edge.
    """

    centre: np.ndarray
    course: np.ndarray
    sigma_px: np.ndarray
    effective_px: np.ndarray
    kept: np.ndarray
    height: np.ndarray
    noise: float
    breadth: float
    changing: bool
    sure: float


class _Look(NamedTuple):
    """What a fitted line looks like.

    Attributes
    ----------
    everywhere, guide : (N, 2) its points, seen or not, and the smooth course through them.
    visibility : (N,) a `Visibility` each.
    seen, inside, root : parts of the path where it is seen, and in the picture; and of its first part where it is seen.
    gap : longest stretch that is not seen, as a part of the path: one thing may stand in front of the antenna.
    height, spread_px : medians of its height, grey levels, and deviation.
    wander_px, snaking_rad : rms distance of its points from a curve of low order, and by how much that snakes.
    step, transparency : of one that changes along its length, how its background differs from side to side, over its
        height; and how far its brightness follows that of the background.
    familiar : share of its points that are as bright as this antenna usually is, 1 where not known.
    """

    everywhere: np.ndarray
    guide: np.ndarray
    visibility: np.ndarray
    seen: float
    inside: float
    root: float
    gap: float
    height: float
    spread_px: float
    wander_px: float
    snaking_rad: float
    step: float
    transparency: float
    familiar: float


@kernel
def without_margins(kept: np.ndarray, margin: int) -> np.ndarray:
    """The kept points (N,) but for so many on either side of a gap; a profile or two that noise hides are no gap."""
    count = len(kept)
    grown = np.zeros(count, np.bool_)
    for n in range(count):
        grown[n] = kept[max(n - 1, 0) : n + 2].any()
    filled = kept.copy()
    for n in range(1, count - 1):
        filled[n] = kept[n] or (grown[n - 1] and grown[n] and grown[n + 1])
    inner = np.zeros(count, np.bool_)
    for n in range(count):
        inner[n] = kept[n] and filled[max(n - margin, 0) : n + margin + 1].all()
    return inner


def accepted(line: FittedLine, look: _Look, end: VisibleEnd) -> Centreline:
    """The centreline of N profiles that look like this and end there, with its verdict; it is kept somewhere."""
    kept = line.kept
    verdict, reason = _doubt(line, look) or ("ok", "")
    return Centreline(
        points_px=look.everywhere[kept],
        sigma_px=line.sigma_px[kept],
        seen=look.seen,
        amplitude=look.height,
        breadth=line.breadth,
        verdict=verdict,
        reason=reason,
        guide_px=look.guide,
        visibility=look.visibility,
        noise=line.noise,
        effective_px=line.effective_px[kept],
        end_px=end.end_px,
        end_std_px=end.std_px,
        end=end.end,
        familiar=look.familiar,
        sure=line.sure,
    )


def best_of(lines: Sequence[Centreline], width_px: float, alike: float = OTHER_LINE_SEEN) -> Centreline:
    """One centreline out of those along the best path and along the others, best first.

    It is ambiguous where of another so much is seen, over what is seen of the first.
    """
    ranked = sorted(lines, key=lambda line: -line.likely)
    best = ranked[0]
    for other in ranked[1:]:
        if best.found and other.found and other.likely > alike * best.likely and _differ(best, other, width_px):
            why = (
                f"two lines could be the antenna: {100 * best.seen:.0f} and {100 * other.seen:.0f} % of its length seen"
            )
            return best.with_verdict("ambiguous", why, other.points_px)
    return best


def decided(line: Centreline, expected_px: np.ndarray) -> Centreline:
    """The same; of two lines that could be the antenna, the first one where it alone lies about as expected, (K, 2).

    expected_px : from the picture before, or from what is known of the rig; it may be empty.
    """
    if line.verdict != "ambiguous" or len(expected_px) < 2:
        return line
    own, other = (_mean_distance(expected_px, points) for points in (line.points_px, line.other_line_px))
    near = own < MOVED * float(arc_lengths(expected_px)[-1]) and own < 0.5 * other
    return line.with_verdict("ok", "") if near else line


def reject_faint(line: Centreline, usual_height: float) -> Centreline:
    """The centreline, with another verdict where it is too faint: blur lowers a line and broadens it alike."""
    if line.found and line.amplitude * max(line.breadth, 1.0) < FAINT * usual_height:
        share = 100.0 * line.amplitude / usual_height
        return line.with_verdict(
            "no_antenna", f"what could be the antenna is too faint ({share:.0f} % of its usual height)"
        )
    return line


def _differ(one: Centreline, other: Centreline, width_px: float) -> bool:
    """Whether two centrelines run apart over a good part of their length."""
    few = other.points_px[:: max(1, len(other.points_px) // 50)]
    gap = np.abs(few[:, None] - one.points_px[None, :: max(1, len(one.points_px) // 200)]).max(axis=-1).min(axis=1)
    return bool((gap > 2.0 * width_px + 4.0).mean() > 0.3)


def _mean_distance(polyline: np.ndarray, points: np.ndarray) -> float:
    """Of points (N, 2) from the nearest ones of a polyline (K, 2)."""
    return float(np.hypot(*(points - polyline[beside(polyline, points)[0]]).T).mean())


def _doubt(line: FittedLine, look: _Look) -> tuple[Verdict, str] | None:
    """Why a line is no antenna, or not enough of one; None where nothing speaks against it."""
    seen, inside, breadth, changing = look.seen, max(look.inside, 1e-9), line.breadth, line.changing
    contrast = look.height / max(line.noise, 1e-9)
    share = f"{100 * seen:.0f} % of its length seen"
    if line.kept.sum() < LEAST_POINTS or seen < 0.05:
        return "no_antenna", f"nothing in the picture looks like the antenna ({share})"
    if breadth < NARROW:
        return "no_antenna", f"what could be the antenna is {breadth:.1f} times as broad as it should be ({share})"
    if contrast < LEAST_CONTRAST:
        return "no_antenna", f"what could be the antenna hardly stands out from the noise ({share})"
    if changing and look.step > EDGE:
        return "no_antenna", f"what could be the antenna is the edge of something broader ({share})"
    if changing and look.transparency > TRANSPARENT:
        return "no_antenna", f"what could be the antenna is as bright as what lies behind it all along ({share})"
    if look.wander_px > np.hypot(WANDER_PX, WANDER_SIGMA[changing] * look.spread_px) or look.snaking_rad > _SNAKING_RAD:
        return "no_antenna", f"what could be the antenna is no smooth line ({share})"
    if changing and seen < _LEAST_WHOLE * (inside - look.gap):
        return "too_little", f"pieces of a line, too few to be sure of it ({share})"
    if seen < (LEAST_SEEN_CHANGING if changing else LEAST_SEEN) or (
        contrast <= CLEAR_CONTRAST and seen / inside < LEAST_SEEN_INSIDE
    ):
        return "too_little", f"too little of the antenna to be sure of it ({share})"
    if look.root < LEAST_ROOT:
        return "too_little", f"the part near the clamp is not seen ({share})"
    if breadth >= (BROAD_CHANGING if changing else BROAD) and seen / inside < LEAST_SEEN_BROAD:
        return "too_little", f"a line {breadth:.1f} times as broad as the antenna, and too little of it ({share})"
    return None


@kernel
def look_of(found: Crossings, line: FittedLine, antenna: Known) -> _Look:
    """What a line that is kept somewhere looks like."""
    levels = antenna.levels
    kept, everywhere = line.kept, moved(found, line.centre)
    visibility = np.where(kept, _SEEN, np.where(found.inside, _HIDDEN, _OUTSIDE)).astype(np.uint8)
    n = len(kept) - 1
    while not kept[n]:
        if visibility[n] == _HIDDEN:
            visibility[n] = _BEYOND
        n -= 1
    gap, longest = 0, 0
    for n in range(len(kept)):
        gap = 0 if kept[n] else gap + 1
        longest = max(longest, gap)
    wander, snaking = _wander(found.along[kept], everywhere[kept])
    familiar, beside = _familiar(found, line, levels) if len(levels) else (1.0, 1.0)
    known = antenna.stands_out or (familiar > FAMILIAR and familiar - beside > MORE_FAMILIAR)
    return _Look(
        everywhere,
        moved(found, line.course),
        visibility,
        kept.mean(),
        found.inside.mean(),
        kept[found.along < ROOT * found.along[-1]].mean(),
        longest / len(kept),
        median(line.height[kept]),
        median(line.sigma_px[kept]),
        wander,
        snaking,
        _step(found, kept) if line.changing else 0.0,
        _transparency(found, line) if line.changing and not known else 0.0,
        familiar,
    )


@kernel
def _familiar(found: Crossings, line: FittedLine, levels: np.ndarray) -> tuple[float, float]:
    """Shares of a line's points, and of their flanks, that are as bright as the antenna's levels (L, 2) say."""
    own, beside, count = 0, 0, 0
    for n in np.flatnonzero(line.kept):
        usual, spread = usual_level(levels, found.along[n] / found.along[-1])
        own += abs(found.profiles[n, np.abs(found.across[n] - line.centre[n]).argmin()] - usual) < USUAL * spread
        for level in _flanks(found.profiles[n]):
            beside += abs(level - usual) < USUAL * spread
        count += 1
    return own / count, 0.5 * beside / count


@kernel
def _flanks(profile: np.ndarray) -> tuple[float, float]:
    """Grey levels at either end of a profile (T,): what lies behind the line."""
    return profile[:3].mean(), profile[-3:].mean()


@kernel
def _step(found: Crossings, kept: np.ndarray) -> float:
    """How the background differs from one side of the line to the other, all along it, over the line's own height."""
    chosen, middle = np.flatnonzero(kept), found.profiles.shape[1] // 2
    steps, height = np.empty(len(chosen)), np.empty(len(chosen))
    for k in range(len(chosen)):
        profile = found.profiles[chosen[k]]
        one, other = _flanks(profile)
        steps[k] = (other - one) * found.side[chosen[k]]
        height[k] = abs(profile[middle - 1 : middle + 2].mean() - 0.5 * (one + other))
    # before a patchwork the steps are of either sign: an edge's are alike
    spread = MAD_SCALE * np.median(np.abs(steps))
    common = abs(median(steps)) - 3.0 * spread / np.sqrt(len(steps) / _ALIKE_PROFILES)
    return max(common, 0.0) / max(median(height), 1e-9)


@kernel
def _transparency(found: Crossings, line: FittedLine) -> float:
    """How far the line's own brightness follows that of its background from place to place, 0 for an opaque antenna.

    0 as well where either hardly varies.
    """
    chosen = np.flatnonzero(line.kept)
    own, behind = np.empty(len(chosen)), np.empty(len(chosen))
    for k in range(len(chosen)):
        n = chosen[k]
        one, other = _flanks(found.profiles[n])
        behind[k] = 0.5 * (one + other)
        own[k] = found.profiles[n, np.abs(found.across[n] - line.centre[n]).argmin()]
    own -= running_mean(own, NEARBY, END_VALUE)
    behind -= running_mean(behind, NEARBY, END_VALUE)
    height, varies = median(np.abs(line.height[line.kept])), (behind**2).mean()
    if np.sqrt((own**2).mean()) > VARIES[0] * height and np.sqrt(varies) > VARIES[1] * height:
        return (own * behind).mean() / varies
    return 0.0


@kernel
def _wander(along: np.ndarray, points: np.ndarray) -> tuple[float, float]:
    """Root mean square distance (px) of points (N, 2) from a curve of low order, and by how much it snakes (rad)."""
    middle, half = 0.5 * (along[0] + along[-1]), max(0.5 * (along[-1] - along[0]), 1e-6)
    orders = _WANDER_ORDER + 1
    powers, matrix, curve = np.empty((len(along), orders)), 1e-9 * len(along) * np.eye(orders), np.zeros((orders, 2))
    for n in range(len(along)):
        place = (along[n] - middle) / half
        powers[n, 0], powers[n, 1] = 1.0, place
        for i in range(2, orders):
            powers[n, i] = 2.0 * place * powers[n, i - 1] - powers[n, i - 2]
        for i in range(orders):
            for j in range(i + 1):
                matrix[i, j] += powers[n, i] * powers[n, j]
            for axis in range(2):
                curve[i, axis] += powers[n, i] * points[n, axis]
    smooth.solve(matrix, curve)
    square = 0.0
    for n in range(len(along)):
        for axis in range(2):
            off = points[n, axis]
            for i in range(orders):
                off -= powers[n, i] * curve[i, axis]
            square += off**2
    turned, turned_at_all, before = 0.0, 0.0, 0.0
    for k in range(len(_SLOPES)):
        u, v = 0.0, 0.0
        for i in range(orders):
            u += _SLOPES[k, i] * curve[i, 0]
            v += _SLOPES[k, i] * curve[i, 1]
        heading = np.arctan2(v, u)
        if k:
            turn = (heading - before + np.pi) % (2.0 * np.pi) - np.pi
            turned += turn
            turned_at_all += abs(turn)
        before = heading
    return np.sqrt(square / len(along)), turned_at_all - abs(turned)
