"""Background subtraction: the scene without the antenna, from one picture of it or from several with the antenna.

The background is shifted and scaled to each picture first, since cameras shake and lamps change; a background that does
not fit is rejected.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from vbaa_calib.core.polyline import resample
from vbaa_calib.native import core

from .centreline import Centreline
from .settings import BackgroundSettings

ROUNDS = 6
"""Gauss–Newton steps of a registration."""
ORDINARY_BLUR_PX = 0.85
"""Blur of a lens in focus and of the pixels, standard deviation."""
_FADE_PX = 6
"""Width of the transition from known to filled-in pixels."""


@dataclass(frozen=True, eq=False)
class Background:
    """The empty scene: `grey` (H, W) float32; `scatter` (H, W) of its pictures about it, NaN where it is filled in."""

    grey: np.ndarray
    scatter: np.ndarray | None = None

    def behind(self, image: np.ndarray) -> np.ndarray | None:
        """(H, W) float32 background shifted and scaled to match a picture; None where it does not match."""
        fitted = self._fitted(image)
        return None if fitted is None else np.asarray(fitted[0] * _moved(self.grey, fitted[1]))

    def detail_over_scatter(self, where: np.ndarray) -> float:
        """Ratio of the background's detail to its scatter over the known pixels of the mask `where` (H, W)."""
        if self.scatter is None:
            return 0.0
        known = where & np.isfinite(self.scatter)
        if not known.any():
            return 0.0
        detail, scatter = _detail(self.grey, 0.0)[known], self.scatter[known]
        return float(np.sqrt(np.mean(detail**2) / max(float(np.mean(scatter**2)), 1e-6)))

    @cached_property
    def _marks(self) -> tuple[np.ndarray, np.ndarray]:
        """(M, 2) pixels with much detail, u and v, and the detail (H, W)."""
        detail = _detail(self.grey, BackgroundSettings.fine_px)
        slope = np.hypot(*np.gradient(detail))
        edge = int(BackgroundSettings.most_shift_px) + 2
        slope[:edge], slope[-edge:], slope[:, :edge], slope[:, -edge:] = 0.0, 0.0, 0.0, 0.0
        v, u = np.nonzero(slope > np.quantile(slope[::3, ::3], BackgroundSettings.detailed))
        every = 1 + len(u) // BackgroundSettings.most_pixels
        return np.stack([u, v], axis=1)[::every].astype(np.float32), detail

    def _fitted(
        self, image: np.ndarray, least: float = BackgroundSettings.least_correlation
    ) -> tuple[float, np.ndarray] | None:
        """Gain and shift (2,) px that fit the background to a picture, robust to objects in front of it."""
        at, detail = self._marks
        if len(at) < 50:
            return None
        whole = _detail(image.astype(np.float32), BackgroundSettings.fine_px)
        seen = whole[at[:, 1].astype(int), at[:, 0].astype(int)]
        found = self._near(seen, np.zeros(2), least)
        # farther than its detail is broad, only the whole picture tells
        return found or self._near(seen, np.array(cv2.phaseCorrelate(detail, whole)[0]), least)

    def _near(self, seen: np.ndarray, shift: np.ndarray, least: float) -> tuple[float, np.ndarray] | None:
        """Gain and shift fitted from an initial shift (2,), by the picture's detail (M,) at the marked pixels."""
        (at, detail), gain = self._marks, 1.0
        for _ in range(ROUNDS):
            here, right, down = (_at(detail, at - shift + step) for step in ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5)))
            rows = np.stack([here, 2.0 * (here - right), 2.0 * (here - down)], axis=1)
            left = seen - gain * here
            scale = 1.5 * core.search.median(np.abs(left)) + 1e-6
            weight = 1.0 / (1.0 + (left / (2.0 * scale)) ** 2) ** 2
            normal_matrix = (rows * weight[:, None]).T @ rows + 1e-6 * len(rows) * np.eye(3)
            gain, *moved = np.linalg.solve(normal_matrix, (rows * weight[:, None]).T @ seen)
            if not BackgroundSettings.gain[0] < gain < BackgroundSettings.gain[1]:
                return None
            step = np.array(moved) / gain
            shift = shift + step / max(1.0, float(np.hypot(*step)))
            if np.hypot(*shift) > BackgroundSettings.most_shift_px:
                return None
            if np.hypot(*step) < 0.01:
                break
        here = gain * _at(detail, at - shift)
        limit = 3.0 * core.search.median(np.abs(seen))  # the antenna and the object may lie anywhere
        clipped, found = np.clip(seen, -limit, limit), np.clip(here, -limit, limit)
        correlation = float(clipped @ found / max(np.sqrt((clipped @ clipped) * (found @ found)), 1e-6))
        return (float(gain), shift) if correlation > least else None


def learn(images: Sequence[np.ndarray], masks: Sequence[np.ndarray]) -> Background | None:
    """The static background of pictures (H, W): their median outside the `covered` masks.

    Pixels that are always covered are interpolated across the antenna. None if too few pictures show the same scene.
    """
    best: list[_Fit] = []
    for first in dict.fromkeys((len(images) // 2, 0, len(images) - 1)):
        ground = Background(images[first].astype(np.float32))
        best = max(best, _fits(ground, images, BackgroundSettings.between_two), key=len)
        if len(best) > len(images) // 2:
            break
    if len(best) < BackgroundSettings.least_pictures:
        return None
    # once more against what the first round made of them: one picture's noise would lower every gain
    best = _fits(_median(images, masks, best), images, BackgroundSettings.least_correlation)
    return _median(images, masks, best) if len(best) >= BackgroundSettings.least_pictures else None


_Fit = tuple[int, float, np.ndarray]
"""Index of a picture, gain and shift (2,) px of the background behind it."""


def _fits(ground: Background, images: Sequence[np.ndarray], least: float) -> list[_Fit]:
    fits = [(index, ground._fitted(image, least)) for index, image in enumerate(images)]
    return [(index, *fit) for index, fit in fits if fit is not None]


def _median(images: Sequence[np.ndarray], masks: Sequence[np.ndarray], fits: list[_Fit]) -> Background:
    """The median of matching pictures, aligned with each other, outside the masks (255 where covered)."""
    several = np.empty((len(fits), *images[0].shape), np.float32)
    gains = np.array([gain for _, gain, _ in fits])
    for own, (index, gain, shift) in zip(several, fits, strict=True):
        own[:] = _moved(images[index].astype(np.float32), -shift) * (float(np.median(gains)) / gain)
        own[_moved(masks[index], -shift) > 0] = np.inf
    several.sort(axis=0)  # what is covered comes last
    uncovered = np.isfinite(several).sum(axis=0)
    known = uncovered >= BackgroundSettings.least_uncovered
    low, middle, high = (
        np.take_along_axis(several, np.rint(part * np.maximum(uncovered - 1, 0)).astype(int)[None], axis=0)[0]
        for part in (0.25, 0.5, 0.75)
    )
    scatter = 0.74 * (np.where(known, high, 0.0) - np.where(known, low, 0.0))
    return Background(_filled(np.where(known, middle, 0.0), known), np.where(known, scatter, np.nan))


def covered(line: Centreline, shape: tuple[int, ...], width_px: float) -> np.ndarray:
    """(H, W) uint8 mask, 255 where a detected or assumed antenna covers a picture, with a wide margin."""
    mask = np.zeros(shape, np.uint8)
    if len(line.guide_px) >= 2:
        path = np.round(np.clip(line.guide_px, -8e3, 8e3)).astype(np.int32).reshape(-1, 1, 2)
        cv2.polylines(mask, [path], False, 255, int(np.ceil(max(line.breadth, 1.0) * width_px)) + 6)
    return mask


def evened(image: np.ndarray, behind: np.ndarray, line: Centreline, width_px: float) -> np.ndarray:
    """(H, W) float32 picture less its background; on the detected antenna less the background's local mean.

    An opaque antenna over an uneven background would otherwise get a lopsided profile, which biases its centreline.
    """
    difference = image.astype(np.float32) - behind
    v, u = np.nonzero(covered(line, difference.shape, width_px))
    if not len(u):
        return difference
    path, _ = resample(line.guide_px, 0.25)
    from scipy.spatial import cKDTree  # slow to load
    from scipy.special import ndtr

    distance, _ = cKDTree(path).query(np.stack([u, v], axis=1))
    half, blur = 0.5 * width_px * line.breadth, ORDINARY_BLUR_PX
    share = ndtr((half - distance) / blur) - ndtr((-half - distance) / blur)
    reach = 2 * int(2.0 * width_px) + 1
    difference[v, u] += share * (behind - cv2.blur(behind, (reach, reach)))[v, u]
    return difference


def _filled(grey: np.ndarray, known: np.ndarray) -> np.ndarray:
    """The picture (H, W) with unknown pixels filled in smoothly from their surroundings."""
    reach = 2 * int(cv2.distanceTransform((~known).astype(np.uint8), cv2.DIST_L2, 5).max()) + 2 * _FADE_PX + 1
    around = cv2.blur(grey.astype(np.float32), (reach, reach))
    share = cv2.blur(known.astype(np.float32), (reach, reach))
    fade = np.clip(cv2.distanceTransform(known.astype(np.uint8), cv2.DIST_L2, 5) / _FADE_PX, 0.0, 1.0)
    return np.asarray(fade * grey + (1.0 - fade) * around / np.maximum(share, 1e-3), np.float32)


def _detail(grey: np.ndarray, fine_px: float) -> np.ndarray:
    fine = cv2.GaussianBlur(grey, (0, 0), fine_px) if fine_px else grey
    return np.asarray(fine - cv2.blur(grey, (BackgroundSettings.coarse_px, BackgroundSettings.coarse_px)))


def _at(values: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(M,) values at places (M, 2), u and v, of an array (H, W)."""
    u, v = (places[:, axis].astype(np.float32)[:, None] for axis in (0, 1))
    return cv2.remap(values, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).ravel().astype(float)


def _moved(grey: np.ndarray, shift: np.ndarray) -> np.ndarray:
    move = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
    size = (grey.shape[1], grey.shape[0])
    return cv2.warpAffine(grey, move, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
