"""The detected antenna in one picture: the result of `antenna.find`, with its verdict in words."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Literal

import numpy as np

Verdict = Literal["ok", "no_antenna", "too_little", "ambiguous"]
EndKind = Literal["tip", "hidden", "border", "unsure", "none"]


class Visibility(IntEnum):
    """Visibility of the antenna at one place along the guide."""

    SEEN = 0
    """The antenna was measured here."""
    HIDDEN = 1
    """Something stands in front, or disturbs the antenna too much to measure it."""
    OUTSIDE = 2
    """Outside the picture, or too near its border."""
    BEYOND = 3
    """Past the visible end: hidden or nothing there, and nothing seen after it."""


def _no_points() -> np.ndarray:
    return np.empty((0, 2))


def _no_numbers() -> np.ndarray:
    return np.empty(0)


@dataclass(frozen=True, eq=False)
class Centreline:
    """The antenna's centreline in one picture, ordered from clamp to tip.

    Attributes
    ----------
    points_px : (N, 2).
    sigma_px : (N,) standard deviation across the antenna.
    effective_px : (N,) the deviation that a fit must give each point to count points as independent: larger than
        `sigma_px` where neighbours share their errors.
    row_px : (N,) or (1,) what noise of whole rows or columns of pixels adds to that, where the antenna follows some.
    seen : fraction of the guide where the antenna was seen.
    amplitude : median height of the line above its background, grey levels.
    breadth : width of the line over that expected from the antenna's width and an ordinary lens.
    verdict : "ok"; "no_antenna": nothing that looks like one; "too_little": something, but too short a part of it;
        "ambiguous": two lines that could both be it.
    reason : the verdict in words; empty when it is "ok".
    guide_px : (K, 2) the path of the search, from the clamp to where a whole antenna ends; it bridges hidden parts.
    visibility : (K,) one `Visibility` for each point of the guide.
    end_px : (2,) the visible end; NaN where there is none. end_std_px : its deviation along the antenna, NaN where it
        is neither the tip nor perhaps the tip.
    end : what the visible end is: the antenna's "tip"; "hidden": the rest is; the picture's "border"; "unsure": it may
        be the tip, but lies nearer than expected, or shows something else, such as a ball or a sheath; or "none".
    other_line_px : (R, 2) the other line where the verdict is "ambiguous", else empty.
    noise : standard deviation of a pixel next to the line, grey levels.
    odds : mean log odds, per correlation length, of two edges along the shape that it was measured along, against
        background alone; NaN where none was searched.
    sure : mean over its points of how surely they are a line's, not the edge of another thing: 1 where that is clear.
    """

    points_px: np.ndarray
    sigma_px: np.ndarray
    seen: float
    amplitude: float
    breadth: float
    verdict: Verdict = "no_antenna"
    reason: str = "nothing in the picture looks like the antenna"
    guide_px: np.ndarray = field(default_factory=_no_points)
    visibility: np.ndarray = field(default_factory=lambda: np.empty(0, np.uint8))
    end_px: np.ndarray = field(default_factory=lambda: np.full(2, np.nan))
    end_std_px: float = np.nan
    end: EndKind = "none"
    other_line_px: np.ndarray = field(default_factory=_no_points)
    noise: float = 0.0
    sure: float = 1.0
    odds: float = np.nan
    effective_px: np.ndarray = field(default_factory=_no_numbers)
    row_px: np.ndarray = field(default_factory=lambda: np.zeros(1))

    @property
    def found(self) -> bool:
        """Whether the verdict is "ok"."""
        return self.verdict == "ok"

    @property
    def likely(self) -> float:
        """Share of the line that is seen with near certainty."""
        return self.seen * self.sure

    @property
    def measured(self) -> np.ndarray:
        """(K,) mask of the guide's places at which the antenna was measured."""
        # NumPy compares with an enum's member four times as long as with its number
        return np.asarray(self.visibility) == Visibility.SEEN.value

    def stretches(self, visibility: Visibility) -> list[np.ndarray]:
        """Pieces (M, 2) of the guide, M ≥ 2, with this visibility."""
        here = np.flatnonzero(np.asarray(self.visibility) == visibility)
        pieces = np.split(here, np.flatnonzero(np.diff(here) > 1) + 1)
        return [self.guide_px[piece] for piece in pieces if len(piece) >= 2]

    def only(self, own: np.ndarray) -> Centreline:
        """The centreline with only the points of the mask `own` (N,); it counts as hidden elsewhere."""
        if own.all():
            return self
        visibility = self.visibility.copy()
        visibility[np.flatnonzero(self.measured)[~own]] = Visibility.HIDDEN
        return replace(
            self,
            points_px=self.points_px[own],
            sigma_px=self.sigma_px[own],
            effective_px=self.effective_px[own],
            row_px=np.broadcast_to(self.row_px, own.shape)[own],
            seen=self.seen * float(own.mean()),
            visibility=visibility,
            end=self.end if own[-1] else "hidden",
            end_px=self.end_px if own[-1] or not own.any() else self.points_px[own][-1],
            end_std_px=self.end_std_px if own[-1] else np.nan,
        )

    def doubted(self, doubt_px: np.ndarray | float) -> Centreline:
        """The centreline with standard deviations increased by an error, (N,) or one, that all its points share."""
        shared = doubt_px * np.sqrt(np.count_nonzero(doubt_px * np.ones(len(self.points_px))))
        if not np.any(doubt_px):
            return self
        return replace(
            self, sigma_px=np.hypot(self.sigma_px, doubt_px), effective_px=np.hypot(self.effective_px, shared)
        )

    def with_verdict(self, verdict: Verdict, reason: str, other_line_px: np.ndarray | None = None) -> Centreline:
        """The centreline with another verdict."""
        return replace(
            self, verdict=verdict, reason=reason, other_line_px=_no_points() if other_line_px is None else other_line_px
        )


NOTHING = Centreline(_no_points(), _no_numbers(), 0.0, 0.0, 1.0)
"""No guide to look along, or nothing along it."""


def too_short(path_px: np.ndarray) -> bool:
    """Whether a path (K, 2) is too short for a line to be measured along it."""
    if len(path_px) and math.dist(path_px[0], path_px[-1]) >= 8.0:
        return False
    return bool(np.hypot(*np.diff(path_px, axis=0).T).sum() < 8.0)
