"""The antenna in front of a printed board: its centreline and its ends, measured where it differs from the print.

A white antenna does not show over white squares, nor a dark one over black: there is no point there, rather than a
guessed one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from targets.board import BoardSpec

from .picture import BoardPicture, board_picture
from .profile import BESIDE, Paint, Profiles, darkest_beside, fit, fit_paint, presence, profiles, rough_centres
from .search import PlaneAbove, PlanePath, search

_SEEN_RATIO = 6.0
_AMPLITUDES = 0.5, 1.6
_LEAST_COVER = 0.12
"""A line of less cover is a shadow, a scratch or the print's own misfit."""
_WORST_CENTRE_PX = 0.5
_DISTURBED = 2.0
"""Profiles that leave this many times the residual of most show something else, too."""
_GROWTH, _GROWTHS = 0.25, 8
"""The path is followed beyond what is seen by this part of its length at a time, at most so often."""
_ENDWARD = 0.03
_LEAST_POINTS = 30
_REWEIGHINGS = 4
_END_STEP_PX = 0.1
_END_STD_PX = 0.3
"""Least standard deviation of an end: how square it is cut, and how far its flank shines, is not known."""
_PRESENCE_STD = 0.15
_WORST_SURPRISE = 9.0
"""A column says no more against a place of the end than three standard deviations do."""
_BORDER_PX = 3.0


@dataclass(frozen=True, eq=False)
class LineEnd:
    """Where the line ends in the picture: pixel (2,) and its standard deviation along the line."""

    point_px: np.ndarray
    std_px: float


@dataclass(frozen=True, eq=False)
class BoardLine:
    """The antenna over a board.

    Attributes
    ----------
    points_px : (N, 2) points of the centreline in their order along it.
    sigma_px : (N,) standard deviation across it.
    ends : where it ends beyond the first and the last point; None where it leaves the picture.
    bright : whether it is brighter than the black of the print, rather than darker than the white.
    width_px : its apparent width.
    shadow : how much darker, in units of the print, a band beside it makes white print.
    """

    points_px: np.ndarray
    sigma_px: np.ndarray
    ends: tuple[LineEnd | None, LineEnd | None]
    bright: bool
    width_px: float
    shadow: float

    def reversed(self) -> BoardLine:
        """The same line, from its other end."""
        return replace(self, points_px=self.points_px[::-1], sigma_px=self.sigma_px[::-1], ends=self.ends[::-1])

    def distance_px(self, pixels: np.ndarray) -> np.ndarray:
        """(M,) distance of pixels (M, 2) from the polyline through points and ends."""
        ends = [end.point_px[None] if end else np.empty((0, 2)) for end in self.ends]
        path = np.concatenate([ends[0], self.points_px, ends[1]])
        a, along = path[:-1], np.diff(path, axis=0)
        offset = pixels[:, None] - a
        share = np.clip((offset * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-12), 0.0, 1.0)
        return np.linalg.norm(offset - share[..., None] * along, axis=-1).min(axis=1)


def find_over_board(
    image: np.ndarray, plane: PlaneAbove, spec: BoardSpec, diameter_m: float, bright: bool | None = None
) -> BoardLine | None:
    """The thin line on a plane above a board, in an (H, W) picture; None where there is none.

    With `bright` None a bright and a dark line are looked for, and the one that covers more of its pixels is taken:
    an antenna covers them, its shadow only dims them.
    """
    picture = board_picture(image, plane.camera, plane.T_camera_board, spec)
    if picture is None:
        return None
    width = diameter_m / plane.metres_per_pixel()
    sides = (True, False) if bright is None else (bright,)
    found = [line for side in sides if (line := _Tracker(picture, plane, width, side).measured()) is not None]
    return max(found, key=lambda one: one[0])[1] if found else None


@dataclass(frozen=True, eq=False)
class _Measured:
    """Points (N, 2) px that were measured along a path, and their standard deviations (N,) across it."""

    points: np.ndarray
    sigma: np.ndarray


@dataclass(frozen=True, eq=False)
class _Tracker:
    """Measures one line, bright or dark, from the rough path to its ends."""

    picture: BoardPicture
    plane: PlaneAbove
    width_px: float
    bright: bool

    @property
    def _core_px(self) -> float:
        """How far the line reaches to either side, blur and all."""
        return 0.5 * self.width_px + 2.0 * self.picture.blur_px + 0.5

    def measured(self) -> tuple[float, BoardLine] | None:
        """The line with its cover; None where none is convincing."""
        path = search(self.picture, self.plane, self.width_px, self.bright)
        if path is None:
            return None
        scale = float(np.hypot(0.3 * self.width_px, self.picture.blur_px))
        paint = Paint(1.0 if self.bright else 0.0, min(1.0, 0.4 * self.width_px / scale), scale)
        for _ in range(2):
            now = self._along(path, paint, rough=True)
            if len(now.points) < _LEAST_POINTS // 2:
                return None
            path = self._refitted(path, now)
            paint = fit_paint(self._cut(path, 0.0), paint)
            if paint.cover < _LEAST_COVER:
                return None
        path = self._followed(path, paint)
        now = self._along(path, paint, _ENDWARD, wary=True)
        ends = self._end(path, paint, -1), self._end(path, paint, 1)
        s = self._places(path, now.points)
        first, last = (
            missing if end is None else self._places(path, end.point_px[None])[0]
            for end, missing in zip(ends, (-np.inf, np.inf), strict=True)
        )
        order = np.argsort(s)
        order = order[(s[order] > first) & (s[order] < last)]
        if len(order) < _LEAST_POINTS:
            return None
        shadow = darkest_beside(self._cut(path, 0.0, BESIDE), self._core_px)
        return paint.cover, BoardLine(now.points[order], now.sigma[order], ends, self.bright, self.width_px, shadow)

    def _places(self, path: PlanePath, pixels: np.ndarray) -> np.ndarray:
        """(N,) coordinates along the path of pixels (N, 2)."""
        return path.along(self.plane.to_plane(pixels)[0])[0]

    def _followed(self, path: PlanePath, paint: Paint) -> PlanePath:
        """The path grown beyond what was seen of it for as long as more comes into sight."""
        for _ in range(_GROWTHS):
            reach = path.end - path.start
            now = self._along(path, paint, _GROWTH)
            if len(now.points) < _LEAST_POINTS:
                break
            path = self._refitted(path, now)
            if path.end - path.start < 1.02 * reach:
                break
        return path

    def _cut(self, path: PlanePath, beyond: float, wider: float = 1.0) -> Profiles:
        more = beyond * (path.end - path.start)
        steps = np.linspace(path.start - more, path.end + more, 600)
        pixels, valid = self.plane.to_pixels(path.points(steps))
        inside = valid & ((pixels > -1) & (pixels < self.picture.seen.shape[::-1])).all(axis=1)
        return profiles(self.picture, pixels[inside], wider * self._core_px)

    def _along(
        self, path: PlanePath, paint: Paint, beyond: float = 0.0, *, rough: bool = False, wary: bool = False
    ) -> _Measured:
        cut = self._cut(path, beyond)
        fitted = fit(cut, paint, rough_centres(cut, paint) if rough else 0.0, wary=wary)
        wider = np.maximum(fitted.chi, 1.0)
        good = (fitted.amplitude > _AMPLITUDES[0]) & (fitted.amplitude < _AMPLITUDES[1])
        good &= fitted.amplitude > _SEEN_RATIO * fitted.amplitude_std * wider
        good &= fitted.centre_std * wider < _WORST_CENTRE_PX
        good &= np.abs(fitted.centre) < self.width_px + 2.5
        if good.any():
            good &= fitted.chi < _DISTURBED * max(float(np.median(fitted.chi[good])), 0.5)
        return _Measured(cut.centred(fitted.centre)[good], (fitted.centre_std * wider / cut.stretch)[good])

    def _refitted(self, path: PlanePath, now: _Measured) -> PlanePath:
        points, valid = self.plane.to_plane(now.points)
        points, weight = points[valid], 1.0 / (now.sigma[valid] ** 2 + 0.05**2)
        fresh = path.fitted(points, weight)
        for _ in range(_REWEIGHINGS):
            off = np.abs(fresh.along(points)[1])
            fresh = path.fitted(points, weight / np.maximum(1.0, off / (2.0 * np.median(off) + 1e-9)))
        return fresh

    def _end(self, path: PlanePath, paint: Paint, way: int) -> LineEnd | None:
        """Where the line ends beyond the path's start (−1) or end (+1)."""
        cut = self._cut(path, _GROWTH)
        amplitude, std = presence(cut, paint)
        s = self._places(path, cut.crossing_px)
        order = np.argsort(way * s)
        place = cut.crossing_px[order]
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(place, axis=0), axis=1))])
        outer = way * s[order] > way * 0.5 * (path.start + path.end)
        seen, std = amplitude[order][outer], np.hypot(std[order][outer], _PRESENCE_STD)
        at = along[outer]
        if len(at) < 2:
            return None
        candidates = np.arange(at[0], at[-1], _END_STEP_PX)
        blur = max(self.picture.blur_px, 0.3)
        there = ndtr((candidates[:, None] - at) / blur)
        surprise = np.minimum(((seen - there) / std) ** 2, _WORST_SURPRISE).sum(axis=1)
        likely = np.exp(-0.5 * (surprise - surprise.min()))
        likely /= likely.sum()
        mean = float(likely @ candidates)
        spread = float(np.sqrt(likely @ (candidates - mean) ** 2))
        point = np.array([np.interp(mean, along, place[:, i]) for i in range(2)])
        room = np.minimum(point, np.array(self.picture.seen.shape[::-1]) - 1 - point).min()
        if room < _BORDER_PX + 2.0 * spread:
            return None
        return LineEnd(point, float(np.hypot(spread, _END_STD_PX)))
