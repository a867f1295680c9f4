"""Lines in a photograph that may be a rod, by evidence of a ribbon between two backgrounds; nothing is measured yet."""

from __future__ import annotations

from dataclasses import dataclass, replace

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
    cost: float = 0.0
    mean: float = 0.0

    def is_clear(self, settings: RodSettings) -> bool:
        """Whether a rod is likely to be along it."""
        return self.mean > settings.enough and self.evidence > settings.clear_evidence


def opponent(picture: np.ndarray) -> np.ndarray:
    """Planes (1, H, W) of a grey picture (H, W), or (3, H, W) luma and two chroma of a colour one (H, W, 3)."""
    if picture.ndim == 2:
        return picture.astype(np.float32)[None]
    luma, *chroma = np.moveaxis(cv2.transform(picture.astype(np.float32), _TO_OPPONENT.astype(np.float32)), -1, 0)
    # less light is less chroma as well
    usual, dark = np.float32(128.0), np.float32(32.0)
    return np.stack([luma, *(each * (usual + dark) / (luma + dark) for each in chroma)])


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


def ribbon_evidence(level: Level, width: float, settings: RodSettings) -> np.ndarray:
    """Log odds (steps, directions, columns) of ribbons so wide down a picture."""
    shading = np.hypot(shading_of(len(level.planes), settings), level.texture(settings.flank_widths * width, settings))
    shares = (settings.flat, settings.edge, settings.chance)
    return core.search.ribbon_evidence(
        level.planes, width, level.noise(settings), shading, settings.spread, shares, settings.gap
    )


def _most_scale(planes: np.ndarray, settings: RodSettings) -> float:
    """Scale at which a picture is searched for the thinnest rods."""
    return float(min(1.0, np.sqrt(1e6 * settings.most_megapixels / np.prod(planes.shape[1:]))))


def levels_of(planes: np.ndarray, settings: RodSettings) -> list[tuple[Level, float]]:
    """The picture reduced for ribbons of each width, in pixels of the picture; the widest first."""
    height, width = planes.shape[1:]
    most = _most_scale(planes, settings)
    widths = [settings.narrowest_px / most]
    while widths[-1] < settings.widest * min(height, width):
        widths.append(widths[-1] * settings.width_step)
    level, levels = Level(planes, 1.0), []
    for width_px in widths:
        level = level.reduced(min(most, settings.level_width_px / width_px), (height, width))
        levels.append((level, width_px))
    return levels[::-1]


def paths_at(
    level: Level,
    width_px: float,
    ends: tuple[np.ndarray | None, np.ndarray | None],
    settings: RodSettings,
    bound: float,
    colours: np.ndarray | None = None,
) -> list[RodPath]:
    """Paths along which ribbons so wide in the photograph's pixels may lie, the best first; from clamp to tip if these
    are known. They lack no more evidence than `bound`, and have one of the `colours` (K, channels) if there are any."""
    clamp, tip = ends
    height, columns = level.planes.shape[1:]
    width, diagonal = width_px * level.scale, float(np.hypot(height, columns))
    if min(height, columns) < 2 * core.search.ROW_STEP:
        return []
    down = ribbon_evidence(level, width, settings)
    across = ribbon_evidence(Level(np.ascontiguousarray(level.planes.swapaxes(1, 2)), level.scale), width, settings)
    if colours is not None:
        spread = settings.other_colour * shading_of(len(level.planes), settings)
        smooth = [cv2.blur(each, (3, 3)) for each in level.planes]
        unlike = [
            sum(((each - own) / by) ** 2 for each, own, by in zip(smooth, colour, spread, strict=True))
            for colour in colours
        ]
        less = np.clip(np.min(unlike, axis=0) - 1.0, 0.0, -settings.gap).astype(np.float32)
        step = core.search.ROW_STEP
        for evidence, each in ((down, less), (across, less.T)):
            evidence -= each[step // 2 :: step][: len(evidence), None]
    correlation = max(width, settings.correlation_share * diagonal)
    both = clamp is not None and tip is not None
    rules = (
        1.0 / correlation,
        settings.enough,
        settings.length_cost,
        settings.turn_cost,
        settings.click_share * diagonal + 0.5 * width,
        width,
        settings.any_evidence if both else settings.least_evidence,
        bound,
        settings.drop,
    )
    known = [None if each is None else ((each + 0.5) * level.scale - 0.5)[None] for each in (clamp, tip)]
    none = np.zeros((0, 2))
    if known[0] is None:
        known.reverse()  # from the tip, where that is known
    first, last = (none if each is None else each for each in known)
    found = core.search.best_paths(
        down, across, first, last, rules, settings.slack, settings.cuts if both else settings.candidates
    )
    paths = [
        RodPath((path + 0.5) / level.scale - 0.5, width_px, sum_of, cost, sum_of * correlation / arc_lengths(path)[-1])
        for path, sum_of, cost in found
    ]
    return [_from_clamp(each, clamp, tip) for each in paths]


def _from_clamp(path: RodPath, clamp: np.ndarray | None, tip: np.ndarray | None) -> RodPath:
    first, last = path.path_px[0], path.path_px[-1]
    if clamp is not None:
        turned = np.hypot(*(last - clamp)) < np.hypot(*(first - clamp))
    else:
        turned = tip is not None and np.hypot(*(first - tip)) < np.hypot(*(last - tip))
    return replace(path, path_px=path.path_px[::-1]) if turned else path


def shared(path: RodPath, other: RodPath, settings: RodSettings) -> float:
    """Part of a path's length that runs along another, nearer than a part of the width."""
    along = arc_lengths(other.path_px)
    at = np.linspace(0.0, along[-1], max(2, int(2.0 * along[-1] / path.width_px)))
    fine = np.stack([np.interp(at, along, each) for each in other.path_px.T], axis=1)
    away = np.hypot(*(path.path_px[:, None] - fine).transpose(2, 0, 1)).min(axis=1)
    return float(np.mean(away < settings.pieces_along * max(path.width_px, other.width_px)))
