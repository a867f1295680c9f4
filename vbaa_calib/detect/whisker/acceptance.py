"""Acceptance: whether fitted profiles show the antenna, what of it is seen or hidden, and where it ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.chebyshev import chebvander
from scipy.ndimage import uniform_filter1d
from scipy.spatial import cKDTree

from vbaa_calib.core import smooth
from vbaa_calib.core.polyline import arc_lengths
from vbaa_calib.core.robust import mad_std

from .centreline import Centreline, Verdict, Visibility
from .corridor import Corridor
from .crossings import Crossings

LEAST_SEEN, LEAST_SEEN_INSIDE = 0.3, 0.5
"""Least fraction of the guide that must be seen, and, of a line that is not clear, of what of it is in the picture."""
LEAST_ROOT, ROOT = 0.35, 0.33
"""Least fraction that must be seen of the first part of the guide: the antenna starts at the clamp."""
NARROW, BROAD, LEAST_SEEN_BROAD = 0.3, 1.8, 0.85
"""Narrower than the first it is none. Broader than the second it may be out of focus, or a soft edge: more must be
seen of it."""
WANDER_PX, WANDER_SIGMA = 0.25, 1.35
"""Root mean square distance of the points from a curve as smooth as an antenna's: pixels, and deviations, together."""
WANDER_ORDER = 6
"""Order of that curve."""
SNAKING_RAD = 0.25
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
LEAST_WHOLE = 0.65
"""Least part of such a line that must be seen beside its longest gap."""
TRANSPARENT, NEARBY, VARIES = 0.5, 41, (0.25, 0.15)
"""Such a line that follows its background's brightness by so much, over what so many profiles have in common, is only
that background; where both vary, by so much of the line's height."""
ALIKE_PROFILES = 15
"""So many neighbouring profiles lie before the same thing."""
MOVED = 0.1
"""Part of its length by which the antenna lies at most off where it is expected, in the mean of its points."""
LEAST_POINTS = 12
FROM_CLAMP, BENDS_MORE = 0.35, 0.15
"""Part of the length over which a line's direction at the clamp is measured, by a parabola; what a contact within that
part may falsify it by, over the turn there."""
_SLOPES = np.diff(chebvander(np.linspace(-1.0, 1.0, 41), WANDER_ORDER), axis=0)


@dataclass(frozen=True, eq=False)
class FittedLine:
    """A line fitted to N profiles, not yet accepted as the antenna.

    Attributes
    ----------
    centre, course : (N,) along the profiles, px; the course is smooth.
    sigma_px, effective_px : (N,) standard deviation across the line; and of a point that counts as independent.
    kept : (N,) where it was measured.
    height : (N,) grey levels. noise : of a pixel, grey levels.
    breadth : over what an antenna in focus has. changing : whether it may be here brighter, there darker.
    """

    centre: np.ndarray
    course: np.ndarray
    sigma_px: np.ndarray
    effective_px: np.ndarray
    kept: np.ndarray
    height: np.ndarray
    noise: float
    breadth: float
    changing: bool = False

    @property
    def contrast(self) -> float:
        """Median height over the noise."""
        return smooth.median(self.height[self.kept]) / max(self.noise, 1e-9) if self.kept.any() else 0.0


def accepted(found: Crossings, line: FittedLine) -> Centreline:
    """The centreline of N profiles, with its verdict."""
    kept = line.kept
    visibility = np.where(kept, Visibility.SEEN, np.where(found.inside, Visibility.HIDDEN, Visibility.OUTSIDE)).astype(
        np.uint8
    )
    last = int(np.flatnonzero(kept)[-1]) if kept.any() else -1
    after = np.arange(len(kept)) > last
    visibility[after & (visibility == Visibility.HIDDEN)] = Visibility.BEYOND
    everywhere = found.moved(line.centre)
    points = everywhere[kept]
    doubt = _doubt(found, everywhere, line)
    verdict, reason = doubt or ("ok", "")
    return Centreline(
        points_px=points,
        sigma_px=line.sigma_px[kept],
        seen=float(kept.mean()),
        amplitude=smooth.median(line.height[kept]) if kept.any() else 0.0,
        breadth=line.breadth,
        verdict=verdict,
        reason=reason,
        guide_px=found.moved(line.course),
        visibility=visibility,
        noise=line.noise,
        effective_px=line.effective_px[kept],
    )


def best_of(lines: Sequence[Centreline], width_px: float, alike: float = OTHER_LINE_SEEN) -> Centreline:
    """One centreline out of those along the best path and along the others, best first.

    It is ambiguous where of another so much is seen, over what is seen of the first.
    """
    ranked = sorted(lines, key=lambda line: -line.seen)
    best = ranked[0]
    for other in ranked[1:]:
        if best.found and other.found and other.seen > alike * best.seen and _differ(best, other, width_px):
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
    tree = cKDTree(expected_px)
    own, other = (float(tree.query(points)[0].mean()) for points in (line.points_px, line.other_line_px))
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


def reject_beside_clamp(line: Centreline, where: Corridor) -> Centreline:
    """The centreline, with another verdict where it does not leave the clamp along the free antenna.

    A cantilever bends away from its free shape slowly; a cable or an edge that passes its clamp is straight there.
    """
    along, aside = where.aside(line.points_px) if line.found else (np.empty(0), np.empty(0))
    length = float(arc_lengths(where.axis_px)[-1])
    first = along < FROM_CLAMP * length
    if first.sum() < LEAST_POINTS:
        return line
    bend, slope, offset = np.polyfit(along[first], aside[first], 2)
    spread = 2.0 * smooth.median(line.sigma_px[first])
    turn = abs(slope) - BENDS_MORE * abs(2.0 * bend * FROM_CLAMP * length) - spread / (0.1 * length)
    if abs(offset) > where.clamp_px + spread:
        return line.with_verdict("no_antenna", f"what could be the antenna passes the clamp by {abs(offset):.0f} px")
    if turn > where.clamp_rad:
        return line.with_verdict(
            "no_antenna", f"what could be the antenna leaves the clamp at {np.degrees(abs(slope)):.0f}° from its axis"
        )
    return line


def _differ(one: Centreline, other: Centreline, width_px: float) -> bool:
    """Whether two centrelines run apart over a good part of their length."""
    few = other.points_px[:: max(1, len(other.points_px) // 50)]
    gap = np.abs(few[:, None] - one.points_px[None, :: max(1, len(one.points_px) // 200)]).max(axis=-1).min(axis=1)
    return bool((gap > 2.0 * width_px + 4.0).mean() > 0.3)


def _doubt(found: Crossings, points: np.ndarray, line: FittedLine) -> tuple[Verdict, str] | None:
    """Why these points (N, 2) are no antenna, or not enough of one; None where nothing speaks against it."""
    kept, breadth, contrast = line.kept, line.breadth, line.contrast
    seen, inside = float(kept.mean()), max(float(found.inside.mean()), 1e-9)
    share = f"{100 * seen:.0f} % of its length seen"
    if kept.sum() < LEAST_POINTS or seen < 0.05:
        return "no_antenna", f"nothing in the picture looks like the antenna ({share})"
    if breadth < NARROW:
        return "no_antenna", f"what could be the antenna is {breadth:.1f} times as broad as it should be ({share})"
    if contrast < LEAST_CONTRAST:
        return "no_antenna", f"what could be the antenna hardly stands out from the noise ({share})"
    if line.changing and _step(found, kept) > EDGE:
        return "no_antenna", f"what could be the antenna is the edge of something broader ({share})"
    if line.changing and _transparency(found, line) > TRANSPARENT:
        return "no_antenna", f"what could be the antenna is as bright as what lies behind it all along ({share})"
    wander, snaking = _wander(found.along, points, kept)
    if wander > np.hypot(WANDER_PX, WANDER_SIGMA * smooth.median(line.sigma_px[kept])) or snaking > SNAKING_RAD:
        return "no_antenna", f"what could be the antenna is no smooth line ({share})"
    if line.changing and seen < LEAST_WHOLE * (inside - _longest_gap(found, kept)):
        return "too_little", f"pieces of a line, too few to be sure of it ({share})"
    if seen < (LEAST_SEEN_CHANGING if line.changing else LEAST_SEEN) or (
        contrast <= CLEAR_CONTRAST and seen / inside < LEAST_SEEN_INSIDE
    ):
        return "too_little", f"too little of the antenna to be sure of it ({share})"
    if kept[found.along < ROOT * found.along[-1]].mean() < LEAST_ROOT:
        return "too_little", f"the part near the clamp is not seen ({share})"
    if breadth >= (BROAD_CHANGING if line.changing else BROAD) and seen / inside < LEAST_SEEN_BROAD:
        return "too_little", f"a line {breadth:.1f} times as broad as the antenna, and too little of it ({share})"
    return None


def _longest_gap(found: Crossings, kept: np.ndarray) -> float:
    """Longest stretch that is not seen, as a fraction of the path: one thing may stand in front of the antenna."""
    edges = np.flatnonzero(np.diff(np.concatenate([[1], kept, [1]]).astype(int)))
    return float(np.max(edges[1::2] - edges[::2], initial=0)) / len(kept)


def _flanks(profiles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) grey levels at either end of profiles (N, T): what lies behind the line."""
    return profiles[:, :3].mean(axis=1), profiles[:, -3:].mean(axis=1)


def _step(found: Crossings, kept: np.ndarray) -> float:
    """How the background differs from one side of the line to the other, all along it, over the line's own height."""
    profiles, middle = found.profiles[kept], found.profiles.shape[1] // 2
    one, other = _flanks(profiles)
    height = np.abs(profiles[:, middle - 1 : middle + 2].mean(axis=1) - 0.5 * (one + other))
    steps = (other - one) * found.side[kept]
    # before a patchwork the steps are of either sign: an edge's are alike
    common = abs(smooth.median(steps)) - 3.0 * mad_std(steps) / np.sqrt(len(steps) / ALIKE_PROFILES)
    return max(common, 0.0) / max(smooth.median(height), 1e-9)


def _transparency(found: Crossings, line: FittedLine) -> float:
    """How far the line's own brightness follows that of its background from place to place, 0 for an opaque antenna.

    0 as well where either hardly varies.
    """
    kept = line.kept
    profiles, rows = found.profiles[kept], np.arange(int(kept.sum()))
    at = np.abs(found.across[kept] - line.centre[kept, None]).argmin(axis=1)
    own, behind = profiles[rows, at], 0.5 * sum(_flanks(profiles))
    own, behind = (values - uniform_filter1d(values, NEARBY, mode="nearest") for values in (own, behind))
    both = np.sqrt([np.mean(own**2), np.mean(behind**2)]) / smooth.median(np.abs(line.height[kept]))
    return float(np.mean(own * behind) / np.mean(behind**2)) if (both > VARIES).all() else 0.0


def _wander(along: np.ndarray, points: np.ndarray, kept: np.ndarray) -> tuple[float, float]:
    """Root mean square distance (px) of the kept points from a curve of low order, and by how much it snakes (rad)."""
    reach = along[kept]
    middle, half = 0.5 * (reach[0] + reach[-1]), max(0.5 * float(reach[-1] - reach[0]), 1e-6)
    powers = chebvander((reach - middle) / half, WANDER_ORDER)
    normal_matrix = powers.T @ powers + 1e-9 * len(reach) * np.eye(WANDER_ORDER + 1)
    coefficients = np.linalg.solve(normal_matrix, powers.T @ points[kept])
    off = points[kept] - powers @ coefficients
    steps = _SLOPES @ coefficients
    turns = np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
    return float(np.sqrt((off**2).sum(axis=1).mean())), float(np.abs(turns).sum() - abs(turns.sum()))
