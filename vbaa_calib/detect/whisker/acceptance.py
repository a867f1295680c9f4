"""Acceptance of fitted profiles as the antenna; which parts are visible or hidden, and where it ends."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vbaa_calib.core.polyline import arc_lengths, offsets_from

from .centreline import Centreline, Verdict

LEAST_SEEN, LEAST_SEEN_INSIDE = 0.3, 0.5
"""Least fraction of the guide that must be seen, and, of a line that is not clear, of what of it is in the picture."""
LEAST_ROOT = 0.35
"""Least fraction that must be seen of the first part of the guide: the antenna starts at the clamp."""
NARROW, BROAD, LEAST_SEEN_BROAD = 0.3, 1.8, 0.85
"""Narrower than the first it is none. Broader than the second it may be out of focus, or a soft edge: more must be
seen of it."""
WANDER_PX, WANDER_SIGMA = 0.25, (1.35, 2.7)
"""Root mean square distance of the points from a curve as smooth as an antenna's: pixels, and deviations, together;
more of these where the polarity may change: neighbours share their errors there."""
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
TRANSPARENT = 0.5
"""Such a line that follows its background's brightness by so much is only that background."""
MOVED = 0.1
"""Part of its length by which the antenna lies at most off where it is expected, in the mean of its points."""
LEAST_POINTS = 12


class Evidence(NamedTuple):
    """Properties of a measured line in addition to its centreline.

    Attributes
    ----------
    inside, root : parts of the path that are in the picture, and of its beginning where the line is seen.
    gap : longest stretch that is not seen, as a part of the path: one thing may stand in front of the antenna.
    spread_px : median deviation of its points.
    wander_px, snaking_rad : rms distance of its points from a curve of low order, and by how much that snakes.
    step, transparency : of one that changes along its length, how its background differs from side to side, over its
        height; and how far its brightness follows that of the background.
    changing : whether it may be here brighter, there darker.
    """

    inside: float
    root: float
    gap: float
    spread_px: float
    wander_px: float
    snaking_rad: float
    step: float
    transparency: float
    changing: bool


def accepted(line: Centreline, evidence: Evidence) -> Centreline:
    """The centreline, with its verdict."""
    return line.with_verdict(*(_doubt(line, evidence) or ("ok", "")))


def best_of(lines: Sequence[Centreline], width_px: float, alike: float = OTHER_LINE_SEEN) -> Centreline:
    """The likeliest of several centrelines; ambiguous if another one is more than `alike` times as likely."""
    ranked = sorted(lines, key=lambda line: (not line.found, -line.likely))
    best = ranked[0]
    for other in ranked[1:]:
        if best.found and other.found and other.likely > alike * best.likely and _differ(best, other, width_px):
            why = (
                f"two lines could be the antenna: {100 * best.seen:.0f} and {100 * other.seen:.0f} % of its length seen"
            )
            return best.with_verdict("ambiguous", why, other.points_px)
    return best


def decided(line: Centreline, expected_px: np.ndarray) -> Centreline:
    """The centreline; where two lines could be the antenna, the first one if it alone lies near the expected one (K,
    2).

    expected_px : from the picture before, or from what is known of the rig; it may be empty.
    """
    if line.verdict != "ambiguous" or len(expected_px) < 2:
        return line
    own, other = (_mean_distance(expected_px, points) for points in (line.points_px, line.other_line_px))
    near = own < MOVED * float(arc_lengths(expected_px)[-1]) and own < 0.5 * other
    return line.with_verdict("ok", "") if near else line


def reject_faint(line: Centreline, usual_height: float) -> Centreline:
    """The centreline, rejected where it is too faint: blur lowers a line as much as it broadens it."""
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
    """Mean distance of points (N, 2) from the nearest ones of a polyline (K, 2)."""
    return float(np.hypot(*(points - polyline[offsets_from(polyline, points)[0]]).T).mean())


def _doubt(line: Centreline, look: Evidence) -> tuple[Verdict, str] | None:
    """The reason why a line is no antenna, or not enough of one; None where nothing contradicts it."""
    seen, inside, breadth, changing = line.seen, max(look.inside, 1e-9), line.breadth, look.changing
    contrast = line.amplitude / max(line.noise, 1e-9)
    share = f"{100 * seen:.0f} % of its length seen"
    if len(line.points_px) < LEAST_POINTS or seen < 0.05:
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
