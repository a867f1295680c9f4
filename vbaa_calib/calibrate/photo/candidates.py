"""Lines in a photograph that may be a rod, by evidence of a ribbon between two backgrounds; nothing is measured yet."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from vbaa_calib.core.polyline import arc_lengths
from vbaa_calib.core.robust import NORMAL_QUARTILE
from vbaa_calib.native import core

from .settings import RodSettings

_TO_OPPONENT = np.array([[0.114, 0.587, 0.299], [0.0, -0.7071, 0.7071], [-0.8165, 0.4082, 0.4082]])
"""Luma, red against green and yellow against blue, from blue, green and red."""


@dataclass(frozen=True, eq=False)
class RodPath:
    """A coarse line (N, 2) in pixels of the photograph, the width it was found with, and its evidence."""

    path_px: np.ndarray
    width_px: float
    evidence: float


def opponent(picture: np.ndarray) -> np.ndarray:
    """Planes (1, H, W) of a grey picture (H, W), or (3, H, W) luma and two chroma of a colour one (H, W, 3)."""
    if picture.ndim == 2:
        return picture.astype(np.float32)[None]
    return np.moveaxis(cv2.transform(picture.astype(np.float32), _TO_OPPONENT.astype(np.float32)), -1, 0)


@dataclass(frozen=True, eq=False)
class Level:
    """A reduced picture (channels, H, W), `scale` of its pixels to one of the photograph's."""

    planes: np.ndarray
    scale: float

    def reduced(self, scale: float, shape: tuple[int, int]) -> Level:
        """The picture of a shape (H, W) at a scale of at most this one's."""
        size = (max(8, round(scale * shape[1])), max(8, round(scale * shape[0])))
        if size == self.planes.shape[:0:-1]:
            return self
        return Level(np.stack([cv2.resize(each, size, interpolation=cv2.INTER_AREA) for each in self.planes]), scale)

    def noise(self, settings: RodSettings) -> np.ndarray:
        """(channels,) standard deviation of a pixel, from second differences."""
        rows = self.planes[:, :: max(1, self.planes.shape[1] // settings.sampled_rows)]
        bend = rows[:, :, 2:] - 2.0 * rows[:, :, 1:-1] + rows[:, :, :-2]
        return np.maximum(np.median(np.abs(bend), axis=(1, 2)) / (NORMAL_QUARTILE * np.sqrt(6.0)), settings.least_noise)

    def texture(self, apart_px: float, settings: RodSettings) -> np.ndarray:
        """(channels,) standard deviation between places so far apart, of the usual surface."""
        smooth = np.stack([cv2.blur(each, (3, 3)) for each in self.planes])
        off, few = max(1, round(apart_px)), max(1, self.planes.shape[1] // settings.sampled_rows)
        differences = [smooth[:, off::few] - smooth[:, :-off:few], smooth[:, ::few, off:] - smooth[:, ::few, :-off]]
        return np.mean([np.median(np.abs(each), axis=(1, 2)) for each in differences], axis=0) / NORMAL_QUARTILE


def shading_of(channels: int, settings: RodSettings) -> np.ndarray:
    """(channels,) by which the colour of one surface differs between neighbouring places."""
    return np.array([settings.shading[min(channel, 1)] for channel in range(channels)])


def _turned(planes: np.ndarray, quarter: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Planes turned by so many times 45°, which of their pixels are within the picture (H, W), and the affine map
    (2, 3) of the picture's places to theirs."""
    height, width = planes.shape[1:]
    angle = 0.25 * np.pi * quarter
    turn = np.round(np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]), 12)
    corners = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]]) @ turn.T
    low = corners.min(axis=0)
    to = np.column_stack([turn, -low])
    if quarter % 2 == 0:
        turned = np.ascontiguousarray(np.rot90(planes, -(quarter // 2), axes=(1, 2)))
        return turned, np.ones(turned.shape[1:], np.float32), to
    size = tuple((np.ceil(corners.max(axis=0) - low).astype(int) + 1).tolist())
    turned = np.stack([cv2.warpAffine(each, to, size, flags=cv2.INTER_LINEAR) for each in planes])
    return turned, cv2.warpAffine(np.ones((height, width), np.float32), to, size, flags=cv2.INTER_LINEAR), to


def _most_scale(planes: np.ndarray, settings: RodSettings) -> float:
    """Scale at which a picture is searched for the thinnest rods."""
    return float(min(1.0, np.sqrt(1e6 * settings.most_megapixels / np.prod(planes.shape[1:]))))


def searched(
    picture_planes: np.ndarray, clamp: np.ndarray | None, tip: np.ndarray | None, settings: RodSettings
) -> list[RodPath]:
    """Paths that may be a rod, in pixels of the picture, the best first; through clamp and tip if these are known."""
    height, width = picture_planes.shape[1:]
    most = _most_scale(picture_planes, settings)
    paths: list[RodPath] = []
    width_px = settings.narrowest_px / most
    level = Level(picture_planes, 1.0)
    while width_px <= min(settings.widest_px, 0.4 * min(height, width)):
        scale = min(most, settings.level_width_px / width_px)
        level = level.reduced(scale, (height, width))
        paths += _at_level(level, width_px * scale, clamp, tip, settings)
        width_px *= settings.width_step
    return sorted(paths, key=lambda each: -each.evidence)


@dataclass(frozen=True, eq=False)
class _Sweeps:
    """Evidence of ribbons of one width in a level, for each main direction with the map (2, 3) of places to it."""

    scale: float
    width: float
    evidence: list[tuple[np.ndarray, np.ndarray]]
    per_step: float
    diagonal: float
    settings: RodSettings

    @staticmethod
    def of(level: Level, width: float, settings: RodSettings) -> _Sweeps:
        """Of ribbons so wide in the level's pixels."""
        channels, height, columns = level.planes.shape
        shading = np.hypot(shading_of(channels, settings), level.texture(settings.flank_widths * width, settings))
        noise = level.noise(settings)
        shares = (settings.flat, settings.edge, settings.chance)
        found = []
        for quarter in range(settings.main_directions):
            planes, within, to = _turned(level.planes, quarter)
            evidence = core.search.ribbon_evidence(
                planes, within, width, noise, shading, settings.spread, shares, settings.gap
            )
            found.append((evidence, to))
        diagonal = float(np.hypot(height, columns))
        correlation = max(width, settings.correlation_share * diagonal)
        return _Sweeps(level.scale, width, found, core.search.ROW_STEP / correlation, diagonal, settings)

    def paths(
        self, quarter: int, first: np.ndarray, last: np.ndarray, tolerance: float, least: float
    ) -> list[tuple[np.ndarray, float]]:
        """Paths (N, 2) in the photograph's pixels, down along a main direction from and to places (0 or 1, 2), each
        with its evidence."""
        evidence, to = self.evidence[quarter]
        rules = (self.per_step, self.settings.turn_cost, tolerance, self.width, least)
        ends = [((each + 0.5) * self.scale - 0.5) @ to[:, :2].T + to[:, 2] for each in (first, last)]
        found = core.search.best_paths(evidence, *ends, rules, self.settings.candidates)
        return [(((path - to[:, 2]) @ to[:, :2] + 0.5) / self.scale - 0.5, sum_of) for path, sum_of in found]

    def down(self, quarter: int) -> np.ndarray:
        """(2,) a main direction in the photograph."""
        return self.evidence[quarter][1][1, :2]


def _at_level(
    level: Level, width: float, clamp: np.ndarray | None, tip: np.ndarray | None, settings: RodSettings
) -> list[RodPath]:
    sweeps = _Sweeps.of(level, width, settings)
    tolerance = settings.click_share * sweeps.diagonal + 0.5 * width
    least = settings.least_evidence if clamp is None or tip is None else settings.any_evidence
    one, other = (np.zeros((0, 2)) if each is None else each[None] for each in (clamp, tip))
    found = []
    for quarter in range(settings.main_directions):
        orders = [(one, other)]
        if len(one) and len(other):
            orders = [(one, other) if (other - one)[0] @ sweeps.down(quarter) > 0.0 else (other, one)]
        elif len(one) or len(other):
            orders.append((other, one))
        for first, last in orders:
            for path, sum_of in sweeps.paths(quarter, first, last, tolerance, least):
                found.append(RodPath(path, width / level.scale, sum_of))
    return found


def grown(planes: np.ndarray, path: RodPath, at_first: bool, settings: RodSettings) -> RodPath:
    """The path, going on beyond its last end, and beyond its first one too if asked for, while there is evidence: a rod
    that winds is found in pieces, each of which goes one way."""
    scale = min(_most_scale(planes, settings), settings.level_width_px / path.width_px)
    level = Level(planes, 1.0).reduced(scale, planes.shape[1:])
    sweeps = _Sweeps.of(level, path.width_px * scale, settings)
    for turn in (False, True) if at_first else (False,):
        if turn:
            path = RodPath(path.path_px[::-1], path.width_px, path.evidence)
        for _ in range(settings.most_pieces):
            longer = _next_piece(sweeps, path)
            if longer is None:
                break
            path = longer
        if turn:
            path = RodPath(path.path_px[::-1], path.width_px, path.evidence)
    return path


def _next_piece(sweeps: _Sweeps, path: RodPath) -> RodPath | None:
    """The path with the piece that goes on from its last end with the most evidence; None where none does."""
    points = path.path_px
    if len(points) < 5:
        return None
    stem = points[:-1]
    ahead = stem[-1] - stem[-min(len(stem), 4)]
    ahead = ahead / max(np.hypot(*ahead), 1e-9)
    none, end = np.zeros((0, 2)), stem[-1][None]
    best: RodPath | None = None
    for quarter in range(sweeps.settings.main_directions):
        for sign in (1.0, -1.0):
            if sign * sweeps.down(quarter) @ ahead < sweeps.settings.pieces_forward:
                continue
            first, last = (end, none) if sign > 0.0 else (none, end)
            for piece, gain in sweeps.paths(quarter, first, last, 2.0, sweeps.settings.least_growth):
                on = piece if sign > 0.0 else piece[::-1]
                start = on[min(3, len(on) - 1)] - on[0]
                if start @ ahead < 0.5 * np.hypot(*start) or (
                    best is not None and path.evidence + gain < best.evidence
                ):
                    continue
                if len(on) > 4 and shared(RodPath(on[2:], path.width_px, gain), path, sweeps.settings) < 0.3:
                    best = RodPath(np.concatenate([stem, on[1:]]), path.width_px, path.evidence + gain)
    return best


def shared(path: RodPath, other: RodPath, settings: RodSettings) -> float:
    """Part of a path's length that runs along another, nearer than a part of the width."""
    along = arc_lengths(other.path_px)
    at = np.linspace(0.0, along[-1], max(2, int(2.0 * along[-1] / path.width_px)))
    fine = np.stack([np.interp(at, along, each) for each in other.path_px.T], axis=1)
    away = np.hypot(*(path.path_px[:, None] - fine).transpose(2, 0, 1)).min(axis=1)
    return float(np.mean(away < settings.pieces_along * max(path.width_px, other.width_px)))
