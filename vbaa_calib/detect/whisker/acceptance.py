"""Whether a measured line is the antenna: its verdict, and why stretches of it are not seen."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import numpy as np

from vbaa_calib.core.polyline import arc_lengths, normals, offsets_from
from vbaa_calib.native import core

from .centreline import Centreline, Verdict
from .corridor import LEAST_SHAPE_POINTS, Corridor
from .settings import AcceptanceSettings, ProfileSettings, StretchSettings


def accepted(numbers: Mapping[str, Any], inside: float, root: float, changing: bool) -> Centreline:
    """The centreline with these fields, as measured, and with its verdict.

    inside, root : share of its path that lies in the picture, and share of the path's beginning where the line is seen.
    changing : whether it may be brighter than its background in some places and darker in others.
    """
    seen, breadth = numbers["seen"], numbers["breadth"]
    verdict, reason = _doubt(seen, breadth, max(inside, 1e-9), root, changing) or ("ok", "")
    return Centreline(**numbers, verdict=verdict, reason=reason)


def best_of(lines: Sequence[Centreline], width_px: float) -> Centreline:
    """The likeliest of several centrelines; ambiguous if another one is about as likely."""
    ranked = sorted(lines, key=lambda line: (not line.found, -line.likely))
    best, alike = ranked[0], AcceptanceSettings.other_line
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
    near = own < AcceptanceSettings.moved * float(arc_lengths(expected_px)[-1]) and own < 0.5 * other
    return line.with_verdict("ok", "") if near else line


def reject_faint(line: Centreline, usual_height: float) -> Centreline:
    """The centreline, rejected where it is too faint: blur lowers a line as much as it broadens it."""
    if line.found and line.amplitude * max(line.breadth, 1.0) < AcceptanceSettings.faint * usual_height:
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


def _doubt(seen: float, breadth: float, inside: float, root: float, changing: bool) -> tuple[Verdict, str] | None:
    """The reason why a line is no antenna, or not enough of one; None where nothing contradicts it."""
    limits = AcceptanceSettings
    share = f"{100 * seen:.0f} % of its length seen"
    if seen < 0.05:
        return "no_antenna", f"nothing in the picture looks like the antenna ({share})"
    least = limits.least_seen_changing if changing else limits.least_seen
    if seen < least:
        return "too_little", f"too little of the antenna to be sure of it ({share})"
    if root < limits.least_root:
        return "too_little", f"the part near the clamp is not seen ({share})"
    if breadth >= limits.broad and seen / inside < limits.least_seen_broad:
        return "too_little", f"a line {breadth:.1f} times as broad as the antenna, and too little of it ({share})"
    return None


def _reject_off_clamp(line: Centreline, where: Corridor, changing: bool) -> Centreline:
    """The centreline, rejected where it does not leave the clamp along the free antenna.

    A cantilever bends away from its free shape slowly; a cable or an edge that passes its clamp is straight there.
    """
    if not line.found or len(where.axis_px) < 2:
        return line
    limits, start = AcceptanceSettings, where.axis_px[0]
    part_px = limits.from_clamp * float(arc_lengths(where.axis_px)[-1])
    # along the line itself, since a strongly bent one soon leaves the axis; its guide, which noise makes no longer
    guide = np.hypot(*(line.guide_px[0] - start)) + arc_lengths(line.guide_px)
    along = guide[line.measured] / part_px
    first = along < 1.0
    if first.sum() < LEAST_SHAPE_POINTS:
        return line
    across = (line.points_px[first] - start) @ normals(where.axis_px)[0]
    bend, slope, offset = np.polyfit(along[first], across, 2)
    spread = 2.0 * core.search.median(line.sigma_px[first])
    turn = abs(slope) - limits.bends_more[changing] * abs(2.0 * bend)
    turn = turn / part_px - spread * limits.from_clamp / (0.1 * part_px)
    if np.hypot(offset / (where.clamp_px + spread), max(turn, 0.0) / where.clamp_rad) > 1.0:
        turn_deg = np.degrees(np.arctan(abs(slope) / part_px))
        return line.with_verdict(
            "no_antenna",
            f"what could be the antenna passes the clamp by {abs(offset):.0f} px, {turn_deg:.0f}° from its axis "
            "(a cable, an edge; or the clamp is not where it is said to be)",
        )
    return line


def of_antennas_shape(line: Centreline, where: Corridor, changing: bool) -> Centreline:
    """The centreline, rejected where no antenna can have its shape.

    On a calibrated rig a line must be the free antenna bent by a force: a cable bends elsewhere than at the clamp, and
    a line that goes over to an object's edge has a kink. A line with a polarity that may change (`changing`) is more
    often something else. Unless much of it is seen, or its shape is likely, it must also leave the clamp as the antenna
    does and fit better than usual. It must fit better, too, unless much of it is surely a line, not an edge. On a rig
    that is not calibrated every line must leave the clamp as the antenna does.
    """
    limits = AcceptanceSettings
    little = changing and line.seen < limits.much_seen and not line.odds >= limits.likely_odds
    line = _reject_off_clamp(line, where, changing) if little or where.shape_px is None else line
    if where.shape_px is None or not line.found:
        return line
    unsure = changing and line.seen * line.sure < limits.much_seen
    most = limits.usual_misfit if little else limits.unsure_misfit if unsure else 1.0
    if where.misfit(line.points_px, line.sigma_px, most) <= most:
        return line
    return line.with_verdict(
        "no_antenna",
        "what could be the antenna is not its free shape bent by a force (an object's edge, a cable; or the rig has "
        "moved since its calibration)",
    )


class Cause(Enum):
    """Reason why a stretch is not visible, with the remedy."""

    SEEN = ("seen", "")
    FAINT = (
        "as bright as what lies behind it",
        "a cloth of the other brightness behind the antenna, or matt paint on it",
    )
    REVERSED = (
        "its contrast is reversed",
        "matt paint instead of bare metal, a larger lamp, or a plain cloth behind it",
    )
    DISTURBED = ("something else beside it", "clear away what lies beside or behind the antenna, or use --background")
    BLURRED = ("blurred", "focus on the antenna, a smaller aperture, a shorter exposure or slower motion")
    HIDDEN = ("hidden, or in the dark", "take away what stands in front, or move the lamp that leaves it in the dark")
    OUTSIDE = ("outside the picture", "turn the camera, or take a wider lens")

    @property
    def words(self) -> str:
        return self.value[0]

    @property
    def remedy(self) -> str:
        return self.value[1]


@dataclass(frozen=True, eq=False)
class Stretch:
    """A piece of the antenna along `path_px` (M, 2); `start` and `end` are fractions of the antenna's length."""

    start: float
    end: float
    cause: Cause
    path_px: np.ndarray


def stretches(image: np.ndarray, line: Centreline, where: Corridor, bright: bool | None = True) -> list[Stretch]:
    """The visible stretches of the antenna in an (H, W) picture, and the others with their causes, from clamp to
    tip.

    Taken along the line's guide, or along the free antenna where there is none. bright : polarity of the search.
    """
    guide = line.guide_px if len(line.guide_px) >= 2 else where.axis_px
    width = where.width_px * float(np.clip(line.breadth, 1.0, 3.0))
    half = int(np.ceil(0.8 * width + 5.0))
    found = core.search.crossings(image, guide, half, 1.0) if len(guide) >= 2 else None
    if found is None or len(found.along) < StretchSettings.run:
        return []
    guide_along = arc_lengths(guide)
    known = line.measured if len(line.guide_px) >= 2 else np.zeros(len(guide))
    seen = np.interp(found.along, guide_along, known) > 0.5
    causes = _causes(found, seen, width, (line.noise, bright))
    if line.end == "tip":  # what lies beyond is no part of the antenna
        last = int(np.hypot(*(found.points - line.end_px).T).argmin()) + 1
        causes = causes[:last]
    along = found.along[: len(causes)]
    causes = _merged(causes, along, max(StretchSettings.shortest_px, StretchSettings.shortest * float(along[-1])))
    edges = [0, *np.flatnonzero(np.diff(causes)) + 1, len(causes)]
    kinds = list(Cause)
    return [
        Stretch(along[a] / along[-1], along[b - 1] / along[-1], kinds[causes[a]], found.points[a:b])
        for a, b in itertools.pairwise(edges)
    ]


def explained(line: Centreline, image: np.ndarray, where: Corridor, bright: bool | None = True) -> Centreline:
    """The centreline; unless it is "ok", with the invisible stretches and their causes in its reason."""
    lost, remedy = ("", "") if line.found else why_lost(stretches(image, line, where, bright))
    return replace(line, reason=f"{line.reason}; {lost} (remedy: {remedy})") if lost else line


def why_lost(parts: Sequence[Stretch], most: int = 4) -> tuple[str, str]:
    """The longest invisible stretches, in order, and the remedy for the longest; empty if all are visible."""
    lost = sorted((part for part in parts if part.cause is not Cause.SEEN), key=lambda part: part.start - part.end)
    unsure = "not there, or " if len(lost) == len(parts) else ""
    words = [
        f"{100 * part.start:.0f}–{100 * part.end:.0f} % of its length: {unsure}{_words(part)}"
        for part in sorted(lost[:most], key=lambda part: part.start)
    ]
    return "; ".join(words), lost[0].cause.remedy if lost else ""


def _words(part: Stretch) -> str:
    # camera and clamp move together: only the antenna's own movement blurs it the more, the farther from there
    moving = part.cause is Cause.BLURRED and part.start > 0.2 and part.end > 0.9
    return f"{part.cause.words} towards its end, as by motion" if moving else part.cause.words


def _causes(found: Any, seen: np.ndarray, width: float, look: tuple[float, bool | None]) -> np.ndarray:
    """(N,) index of the `Cause` of each profile."""
    noise, bright = look
    half = found.profiles.shape[1] // 2
    sharp, *soft = (
        core.profile.expected(width, blur, half + 2) for blur in (ProfileSettings.blur_px, *StretchSettings.broader_px)
    )
    # the guide bridges what was not seen, and may lie a little off there
    reach = np.ceil(0.5 * width) + 2.0
    offsets = np.arange(-reach, reach + 1.0)
    fits = [core.profile.fit(sharp, found, np.where(seen, 0.0, offset)) for offset in offsets]
    heights = np.stack([_averaged(height) for _, height, _, _ in fits])
    unit = np.stack([unit for _, _, unit, _ in fits])
    best = np.abs(heights / unit).argmax(axis=0)
    at = np.arange(len(best))
    height, rms = heights[best, at], np.stack([rms for *_, rms in fits])[best, at]
    rms = np.sqrt(np.maximum(_averaged(rms**2), 1e-12))  # running sums leave rounding below zero
    noise = noise or float(np.quantile(rms, 0.2))
    softer = [_averaged(core.profile.fit(each, found, offsets[best])[-1] ** 2) for each in soft]
    blurred = np.sqrt(np.maximum(np.min(softer, axis=0), 0.0))
    ground = _averaged(found.profiles[:, [0, 1, -2, -1]].mean(axis=1))
    usual = float(np.median(np.abs(height[seen]))) if seen.any() else 0.0
    there = np.abs(height) > np.maximum(
        StretchSettings.clear * noise * unit[best, at] / np.sqrt(StretchSettings.run), 0.3 * usual
    )
    there &= np.abs(height) > rms
    sign = np.sign(height) * {True: 1, False: -1, None: 0}[bright]
    # what the antenna would stand out by, were it as bright as where it was seen
    lit = np.interp(at, at[seen], (ground + height)[seen]) - ground if seen.any() else np.zeros(len(at))
    faint = np.abs(lit) < max(StretchSettings.alike * usual, 3.0 * noise)
    faint |= (np.abs(lit) < StretchSettings.nearly * usual) & (height * np.sign(lit) > 0.4 * np.abs(lit))
    rules = [
        (~found.inside, Cause.OUTSIDE),
        (seen, Cause.SEEN),
        (there & (sign < 0), Cause.REVERSED),
        (there & (blurred < StretchSettings.much_broader * rms), Cause.BLURRED),
        (rms > StretchSettings.disturbed * noise, Cause.DISTURBED),
        (faint, Cause.FAINT),
    ]
    kinds = list(Cause)
    return np.select([rule for rule, _ in rules], [kinds.index(cause) for _, cause in rules], kinds.index(Cause.HIDDEN))


def _averaged(values: np.ndarray) -> np.ndarray:
    return core.search.running_mean(values, StretchSettings.run, core.search.Beyond.mirrored)


def _merged(causes: np.ndarray, along: np.ndarray, shortest_px: float) -> np.ndarray:
    """The causes (N,) with runs that are too short merged into the longer neighbour, the shortest first."""
    causes = causes.copy()
    while True:
        edges = np.array([0, *np.flatnonzero(np.diff(causes)) + 1, len(causes)])
        lengths = np.append(along, along[-1])[edges[1:]] - along[edges[:-1]]
        if len(lengths) < 2 or lengths.min() >= shortest_px:
            return causes
        at = int(lengths.argmin())
        sides = [side for side in (at - 1, at + 1) if 0 <= side < len(lengths)]
        causes[edges[at] : edges[at + 1]] = causes[edges[max(sides, key=lambda side: lengths[side])]]
