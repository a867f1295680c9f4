"""The antenna in front of a printed board: centreline and ends, measured where the antenna differs from the print.

Over squares of its own brightness the antenna is invisible and gets no points.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.polynomial import Polynomial
from numpy.polynomial.polynomial import polyval
from scipy.special import ndtr

from targets.board import BoardWithIds
from vbaa_calib.camera import Camera
from vbaa_calib.geometry import Pose

from .profile import (
    BESIDE,
    BoardPicture,
    Paint,
    Profiles,
    board_picture,
    darkest_beside,
    fit,
    fit_paint,
    profiles,
    rough_centres,
)

_STANDS_OUT = 5.0
"""Least ridge response of a candidate pixel over its noise."""
_MOST_CANDIDATES = 20000
_ANGLES = 360
_BIN_M = 1e-3
_LEAST_BIN_PX = 2.0
_BANDS = (6.0, 3.0, 1.5)
"""Half widths, in bins, of the band around the path from which it is fitted again."""
_STEP_PX = 2.0
_LEAST_STEPS = 12
_LEAST_COVER = 0.5
"""Least share of the visible steps along the line that must show it."""


_SEEN_RATIO = 6.0
_AMPLITUDES = 0.5, 1.6
_FAINTEST = 0.12
"""Least cover; less is a shadow, a scratch or a misfit of the print."""
_WORST_CENTRE_PX = 0.5
_DISTURBED = 2.0
"""Profiles with more than this many times the usual residual show something else, too."""
_GROWTH, _GROWTHS = 0.25, 8
"""Share of its length by which the path is extended, repeatedly, while more of the line is found."""
_ENDWARD = 0.03
_LEAST_POINTS = 30
_REWEIGHINGS = 4
_END_STEP_PX = 0.1
_END_STD_PX = 0.3
"""Least standard deviation of an end: its cut and its reflections are unknown."""
_PRESENCE_STD = 0.15
_WORST_SURPRISE = 9.0
"""Cap on a column's squared deviation in the likelihood of an end."""
_BORDER_PX = 3.0


@dataclass(frozen=True, eq=False)
class PlaneAbove:
    """The plane parallel to a board, `height_m` nearer to the viewer; (x, y) on it are those of the board frame."""

    camera: Camera
    T_camera_board: Pose
    height_m: float

    def to_plane(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates (N, 2) m of pixels (N, 2), and validity (N,)."""
        rays, valid = self.camera.unproject(pixels)
        rays = np.where(valid[:, None], rays, 0.0)
        rotation, shift = self.T_camera_board.rotation, self.T_camera_board.translation_m
        away = rays @ rotation[:, 2]
        valid = valid & (away > 1e-6)
        reach = (rotation[:, 2] @ shift - self.height_m) / np.where(valid, away, 1.0)
        return ((rays * reach[:, None] - shift) @ rotation)[:, :2], valid & (reach > 0)

    def to_pixels(self, points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixels (N, 2) of coordinates (N, 2) m, and validity (N,)."""
        raised = np.column_stack([points_m, np.full(len(points_m), -self.height_m)])
        return self.camera.project(self.T_camera_board @ raised)

    def metres_per_pixel(self) -> float:
        """At the board frame's origin, seen squarely."""
        focal_px = np.sqrt(np.prod(np.diag(self.camera.matrix)[:2]))
        return float(np.linalg.norm(self.T_camera_board.translation_m) / focal_px)


@dataclass(frozen=True, eq=False)
class _PlanePath:
    """A bent line on the plane: origin + s·direction + (c0 + c1·s + …)·normal, from s = start to end, m."""

    origin: np.ndarray
    direction: np.ndarray
    coefficients: np.ndarray
    start: float
    end: float

    @property
    def normal(self) -> np.ndarray:
        return np.array([-self.direction[1], self.direction[0]])

    def along(self, points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinate s (N,) and distance (N,) of points (N, 2) from the path, m."""
        offset = points_m - self.origin
        s = offset @ self.direction
        return s, offset @ self.normal - polyval(s, self.coefficients)

    def points(self, s: np.ndarray) -> np.ndarray:
        """(N, 2) points at s (N,)."""
        aside = polyval(s, self.coefficients)
        return self.origin + s[:, None] * self.direction + aside[:, None] * self.normal

    def fitted(self, points_m: np.ndarray, weights: np.ndarray, degree: int = 2) -> _PlanePath:
        """The path through points (N, 2) with weights (N,) on their squares."""
        s, aside = (points_m - self.origin) @ self.direction, (points_m - self.origin) @ self.normal
        coefficients = Polynomial.fit(s, aside, degree, w=np.sqrt(weights)).convert().coef
        return _PlanePath(self.origin, self.direction, coefficients, float(s.min()), float(s.max()))


def _search(picture: BoardPicture, plane: PlaneAbove, width_px: float, bright: bool) -> _PlanePath | None:
    """The path of a bright or dark antenna, on the board alone, where the background is known; or None."""
    pixels, strength = _candidates(picture, width_px, bright)
    points, valid = plane.to_plane(pixels)
    points, strength = points[valid], strength[valid]
    if len(points) < _LEAST_STEPS:
        return None
    scale = plane.metres_per_pixel()
    width = max(_BIN_M, _LEAST_BIN_PX * scale)
    path = _strongest_line(points, strength, width)
    for band in _BANDS:
        near = np.abs(path.along(points)[1]) < band * width
        if near.sum() < _LEAST_STEPS:
            return None
        path = path.fitted(points[near], strength[near], 1 if band == _BANDS[0] else 2)
    # its ends, if it shows often enough
    s = path.along(points[np.abs(path.along(points)[1]) < width])[0]
    step = scale * _STEP_PX
    steps = np.arange(path.start, path.end, step)
    if len(s) < _LEAST_STEPS or len(steps) < _LEAST_STEPS:
        return None
    pixels, valid = plane.to_pixels(path.points(steps))
    height, width_of = picture.pattern.shape
    column, row = np.clip(np.round(np.nan_to_num(pixels)), 0, [width_of - 1, height - 1]).astype(int).T
    behind = np.where(valid, picture.pattern[row, column], np.nan)
    shows = behind < 0.2 if bright else behind > 0.8
    hit = np.isin(np.arange(len(steps)), np.round((s - path.start) / step).astype(int))
    if (shows & hit).sum() < max(_LEAST_STEPS, _LEAST_COVER * shows.sum()):
        return None
    return replace(path, start=float(s.min()), end=float(s.max()))


def _candidates(picture: BoardPicture, width_px: float, bright: bool) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (N, 2) on ridges of the difference and their weights (N,)."""
    known = np.isfinite(picture.pattern)
    difference = np.where(known, picture.seen - np.nan_to_num(picture.pattern), 0.0) * (1.0 if bright else -1.0)
    over_noise = (difference / picture.noise).astype(np.float32)
    smooth = cv2.GaussianBlur(over_noise, (0, 0), max(0.4 * width_px, 0.8))
    xx, yy = (cv2.Sobel(smooth, cv2.CV_32F, 2 * (1 - i), 2 * i, ksize=3) for i in (0, 1))
    xy = cv2.Sobel(smooth, cv2.CV_32F, 1, 1, ksize=3)
    ridge = 0.5 * (np.hypot(xx - yy, 2 * xy) - xx - yy)
    inner = cv2.erode(known.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    noise = float(np.median(ridge[inner])) if inner.any() else np.inf
    response = np.where(inner & (smooth > 2.0), ridge / max(noise, 1e-6), 0.0)
    rows, columns = np.nonzero(response > _STANDS_OUT)
    strength = np.minimum(response[rows, columns], 4 * _STANDS_OUT)
    best = np.argsort(-strength, kind="stable")[:_MOST_CANDIDATES]
    return np.column_stack([columns[best], rows[best]]).astype(float), strength[best]


def _strongest_line(points: np.ndarray, strength: np.ndarray, width: float) -> _PlanePath:
    """The line of the greatest summed strength, by Hough's transform about the points' middle."""
    middle = points.mean(axis=0)
    offset = points - middle
    reach = int(np.ceil(np.linalg.norm(offset, axis=1).max() / width)) + 2
    best, chosen = -1.0, (0.0, 0)
    for angle in np.arange(_ANGLES) * np.pi / _ANGLES:
        bins = np.round(offset @ [-np.sin(angle), np.cos(angle)] / width).astype(int) + reach
        votes = np.convolve(np.bincount(bins, strength, 2 * reach + 1), [0.5, 1.0, 0.5], mode="same")
        if votes.max() > best:
            best, chosen = float(votes.max()), (float(angle), int(votes.argmax()) - reach)
    direction = np.array([np.cos(chosen[0]), np.sin(chosen[0])])
    return _PlanePath(middle, direction, np.array([chosen[1] * width]), 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class LineEnd:
    """Where the line ends in the picture: pixel (2,) and its standard deviation along the line."""

    point_px: np.ndarray
    std_px: float


@dataclass(frozen=True, eq=False)
class BoardLine:
    """The antenna over a board.

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
    image: np.ndarray, plane: PlaneAbove, spec: BoardWithIds, diameter_m: float, bright: bool | None = None
) -> BoardLine | None:
    """The thin line on a plane above a board, in an (H, W) picture; None without one.

    With `bright` None the one with more cover of a bright and a dark line: an antenna covers, its shadow only dims.
    """
    picture = board_picture(image, plane.camera, plane.T_camera_board, spec)
    if picture is None:
        return None
    width = diameter_m / plane.metres_per_pixel()
    sides = (True, False) if bright is None else (bright,)
    found = [line for side in sides if (line := _Tracker(picture, plane, width, side).measured()) is not None]
    return max(found, key=lambda one: one[0])[1] if found else None


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
        path = _search(self.picture, self.plane, self.width_px, self.bright)
        if path is None:
            return None
        scale = float(np.hypot(0.3 * self.width_px, self.picture.blur_px))
        paint = Paint(1.0 if self.bright else 0.0, min(1.0, 0.4 * self.width_px / scale), scale)
        for _ in range(2):
            points, sigma = self._along(path, paint, rough=True)
            if len(points) < _LEAST_POINTS // 2:
                return None
            path = self._refitted(path, points, sigma)
            paint = fit_paint(self._cut(path, 0.0), paint)
            if paint.cover < _FAINTEST:
                return None
        for _ in range(_GROWTHS):
            reach, (points, sigma) = path.end - path.start, self._along(path, paint, _GROWTH)
            if len(points) < _LEAST_POINTS:
                break
            path = self._refitted(path, points, sigma)
            if path.end - path.start < 1.02 * reach:
                break
        points, sigma = self._along(path, paint, _ENDWARD, wary=True)
        ends = self._end(path, paint, -1), self._end(path, paint, 1)
        s = self._places(path, points)
        first, last = (
            missing if end is None else self._places(path, end.point_px[None])[0]
            for end, missing in zip(ends, (-np.inf, np.inf), strict=True)
        )
        order = np.argsort(s)
        order = order[(s[order] > first) & (s[order] < last)]
        if len(order) < _LEAST_POINTS:
            return None
        shadow = darkest_beside(self._cut(path, 0.0, BESIDE), self._core_px)
        return paint.cover, BoardLine(points[order], sigma[order], ends, self.bright, self.width_px, shadow)

    def _places(self, path: _PlanePath, pixels: np.ndarray) -> np.ndarray:
        """(N,) coordinates along the path of pixels (N, 2)."""
        return path.along(self.plane.to_plane(pixels)[0])[0]

    def _cut(self, path: _PlanePath, beyond: float, wider: float = 1.0) -> Profiles:
        more = beyond * (path.end - path.start)
        steps = np.linspace(path.start - more, path.end + more, 600)
        pixels, valid = self.plane.to_pixels(path.points(steps))
        inside = valid & ((pixels > -1) & (pixels < self.picture.seen.shape[::-1])).all(axis=1)
        return profiles(self.picture, pixels[inside], wider * self._core_px)

    def _along(
        self, path: _PlanePath, paint: Paint, beyond: float = 0.0, *, rough: bool = False, wary: bool = False
    ) -> tuple[np.ndarray, np.ndarray]:
        """Points (N, 2) px that were measured along a path, and their standard deviations (N,) across it."""
        cut = self._cut(path, beyond)
        fitted = fit(cut, paint, rough_centres(cut, paint) if rough else 0.0, wary=wary)
        wider = np.maximum(fitted.chi, 1.0)
        good = (fitted.amplitude > _AMPLITUDES[0]) & (fitted.amplitude < _AMPLITUDES[1])
        good &= fitted.amplitude > _SEEN_RATIO * fitted.amplitude_std * wider
        good &= fitted.centre_std * wider < _WORST_CENTRE_PX
        good &= np.abs(fitted.centre) < self.width_px + 2.5
        if good.any():
            good &= fitted.chi < _DISTURBED * max(float(np.median(fitted.chi[good])), 0.5)
        points = cut.crossing_px.copy()
        points[:, cut.axis] += fitted.centre
        return points[good], (fitted.centre_std * wider / cut.stretch)[good]

    def _refitted(self, path: _PlanePath, pixels: np.ndarray, sigma: np.ndarray) -> _PlanePath:
        points, valid = self.plane.to_plane(pixels)
        points, weight = points[valid], 1.0 / (sigma[valid] ** 2 + 0.05**2)
        fresh = path.fitted(points, weight)
        for _ in range(_REWEIGHINGS):
            off = np.abs(fresh.along(points)[1])
            fresh = path.fitted(points, weight / np.maximum(1.0, off / (2.0 * np.median(off) + 1e-9)))
        return fresh

    def _end(self, path: _PlanePath, paint: Paint, way: int) -> LineEnd | None:
        """Where the line ends beyond the path's start (−1) or end (+1)."""
        cut = self._cut(path, _GROWTH)
        # how much of the line is on the guide itself: about 1 where it is, 0 where not
        there = fit(cut, paint, steps=0)
        amplitude, std = there.amplitude, there.amplitude_std * np.maximum(there.chi, 1.0)
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
        point = np.array([np.interp(mean, along, axis) for axis in place.T])
        room = np.minimum(point, np.array(self.picture.seen.shape[::-1]) - 1 - point).min()
        if room < _BORDER_PX + 2.0 * spread:
            return None
        return LineEnd(point, float(np.hypot(spread, _END_STD_PX)))
