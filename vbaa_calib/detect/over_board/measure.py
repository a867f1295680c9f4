"""The antenna in front of a printed board: its centreline and its ends, measured where it differs from the print.

A white antenna does not show over white squares, nor a dark one over black: there is no point there, rather than a
guessed one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from targets.board import BoardSpec
from vbaa_calib.camera import Camera
from vbaa_calib.geometry import Pose

from .picture import BoardPicture, board_picture
from .profile import BESIDE, Fitted, Paint, Profiles, darkest_beside, fit, fit_paint, presence, profiles, rough_centres
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
    image: np.ndarray,
    camera: Camera,
    T_camera_board: Pose,
    spec: BoardSpec,
    height_m: float,
    diameter_m: float,
    bright: bool | None = None,
) -> BoardLine | None:
    """The thin line `height_m` in front of a board at a known pose, in an (H, W) picture; None where there is none.

    With `bright` None a bright and a dark line are looked for, and the one that covers more of its pixels is taken:
    an antenna covers them, its shadow only dims them.
    """
    picture = board_picture(image, camera, T_camera_board, spec)
    if picture is None:
        return None
    plane = PlaneAbove(camera, T_camera_board, height_m)
    width = diameter_m / plane.metres_per_pixel()
    found = [_Tracker(picture, plane, width, side) for side in ((True, False) if bright is None else (bright,))]
    lines = [(cover, line) for tracker in found for cover, line in tracker.measured()]
    return max(lines, key=lambda one: one[0])[1] if lines else None


@dataclass(frozen=True, eq=False)
class _Measured:
    """Profiles along a path, the lines fitted to them, and which of them count."""

    cut: Profiles
    fitted: Fitted
    good: np.ndarray

    @property
    def points(self) -> np.ndarray:
        return self.cut.centred(self.fitted.centre)[self.good]

    @property
    def sigma(self) -> np.ndarray:
        spread = self.fitted.centre_std * np.maximum(self.fitted.chi, 1.0) / self.cut.stretch
        return spread[self.good]


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

    def measured(self) -> list[tuple[float, BoardLine]]:
        """The line with its cover; nothing where none is convincing."""
        path = search(self.picture, self.plane, self.width_px, self.bright)
        if path is None:
            return []
        scale = float(np.hypot(0.3 * self.width_px, self.picture.blur_px))
        paint = Paint(1.0 if self.bright else 0.0, min(1.0, 0.4 * self.width_px / scale), scale)
        for _ in range(2):
            now = self._along(path, paint, rough=True)
            if len(now.points) < _LEAST_POINTS // 2:
                return []
            path = self._refitted(path, now)
            aligned = self._cut(path, 0.0)
            paint = fit_paint(aligned, np.zeros(len(aligned.stretch)), paint)
            if paint.cover < _LEAST_COVER:
                return []
        path = self._followed(path, paint)
        now = self._along(path, paint, _ENDWARD, wary=True)
        ends = tuple(self._end(path, paint, way) for way in (-1, 1))
        return self._line(path, now, (ends[0], ends[1]), paint)

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
        core = wider * self._core_px
        picture = self.picture
        inside = valid & (pixels > -1).all(axis=1) & (pixels < np.array(picture.seen.shape[::-1])).all(axis=1)
        return profiles(picture, pixels[inside], core)

    def _along(
        self, path: PlanePath, paint: Paint, beyond: float = 0.0, *, rough: bool = False, wary: bool = False
    ) -> _Measured:
        cut = self._cut(path, beyond)
        start = rough_centres(cut, paint) if rough else np.zeros(len(cut.stretch))
        fitted = fit(cut, paint, start, wary=wary)
        good = (fitted.amplitude > _AMPLITUDES[0]) & (fitted.amplitude < _AMPLITUDES[1])
        good &= fitted.amplitude > _SEEN_RATIO * fitted.amplitude_std * np.maximum(fitted.chi, 1.0)
        good &= fitted.centre_std * np.maximum(fitted.chi, 1.0) < _WORST_CENTRE_PX
        good &= np.abs(fitted.centre) < self.width_px + 2.5
        if good.any():
            good &= fitted.chi < _DISTURBED * max(float(np.median(fitted.chi[good])), 0.5)
        return _Measured(cut, fitted, good)

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
        s = path.along(self.plane.to_plane(cut.crossing_px)[0])[0]
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

    def _line(
        self, path: PlanePath, now: _Measured, ends: tuple[LineEnd | None, LineEnd | None], paint: Paint
    ) -> list[tuple[float, BoardLine]]:
        points, sigma = now.points, now.sigma
        s = path.along(self.plane.to_plane(points)[0])[0]
        limits = [end and float(path.along(self.plane.to_plane(end.point_px[None])[0])[0][0]) for end in ends]
        kept = np.ones(len(s), bool) if limits[0] is None else s > limits[0]
        kept &= True if limits[1] is None else s < limits[1]
        order = np.flatnonzero(kept)[np.argsort(s[kept])]
        if len(order) < _LEAST_POINTS:
            return []
        shadow = darkest_beside(self._cut(path, 0.0, BESIDE), self._core_px)
        found = BoardLine(points[order], sigma[order], ends, self.bright, self.width_px, shadow)
        return [(paint.cover, found)]
