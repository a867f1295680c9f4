"""Visible stretches of the antenna in one picture, and the reasons why the others are not visible."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from vbaa_calib.core.polyline import arc_lengths
from vbaa_calib.native import core

from .centreline import Centreline, Visibility
from .corridor import Corridor
from .crossings import Crossings, crossings

RUN = 9
"""Neighbouring profiles that are averaged, so that a faint line shows."""
SHORTEST, SHORTEST_PX = 0.02, 8.0
"""Stretches shorter than this share of the length, or than so many pixels, are merged with their neighbours."""
CLEAR, ALIKE, NEARLY, DISTURBED = 4.5, 0.2, 0.35, 1.8
"""Least height of a visible line over its deviation; shares of the usual height within which the antenna is as bright
as its background, or nearly so; residual over noise that shows something else."""
BROADER_PX, MUCH_BROADER = (2.0, 4.0), 0.8
"""Larger blurs that are tried, and the share of the residuals that they may leave."""


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
    found = crossings(image, guide, half, True) if len(guide) >= 2 else None
    if found is None or len(found.along) < RUN:
        return []
    guide_along = arc_lengths(guide)
    known = line.visibility if len(line.guide_px) >= 2 else np.full(len(guide), Visibility.HIDDEN)
    seen = np.interp(found.along, guide_along, np.asarray(known) == Visibility.SEEN) > 0.5
    causes = _causes(found, seen, width, (line.noise, bright))
    if line.end == "tip":  # what lies beyond is no part of the antenna
        last = int(np.hypot(*(found.points - line.end_px).T).argmin()) + 1
        causes = causes[:last]
    along = found.along[: len(causes)]
    causes = _merged(causes, along, max(SHORTEST_PX, SHORTEST * float(along[-1])))
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


def _causes(found: Crossings, seen: np.ndarray, width: float, look: tuple[float, bool | None]) -> np.ndarray:
    """(N,) index of the `Cause` of each profile."""
    noise, bright = look
    half = found.profiles.shape[1] // 2
    sharp, *soft = (core.profile.expected(width, blur, half + 2) for blur in (0.8, *BROADER_PX))
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
    there = np.abs(height) > np.maximum(CLEAR * noise * unit[best, at] / np.sqrt(RUN), 0.3 * usual)
    there &= np.abs(height) > rms
    sign = np.sign(height) * {True: 1, False: -1, None: 0}[bright]
    # what the antenna would stand out by, were it as bright as where it was seen
    lit = np.interp(at, at[seen], (ground + height)[seen]) - ground if seen.any() else np.zeros(len(at))
    faint = np.abs(lit) < max(ALIKE * usual, 3.0 * noise)
    faint |= (np.abs(lit) < NEARLY * usual) & (height * np.sign(lit) > 0.4 * np.abs(lit))
    rules = [
        (~found.inside, Cause.OUTSIDE),
        (seen, Cause.SEEN),
        (there & (sign < 0), Cause.REVERSED),
        (there & (blurred < MUCH_BROADER * rms), Cause.BLURRED),
        (rms > DISTURBED * noise, Cause.DISTURBED),
        (faint, Cause.FAINT),
    ]
    kinds = list(Cause)
    return np.select([rule for rule, _ in rules], [kinds.index(cause) for _, cause in rules], kinds.index(Cause.HIDDEN))


def _averaged(values: np.ndarray) -> np.ndarray:
    return core.search.running_mean(values, RUN, core.search.Beyond.mirrored)


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
