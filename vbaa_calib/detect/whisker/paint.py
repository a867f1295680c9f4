"""What tells the antenna from its surroundings: brighter, darker or of another colour, as the no-load pictures show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from .centreline import Centreline
from .finder import AntennaFinder

OPPONENTS = ((0.5, 0.5, -1.0), (0.5, -1.0, 0.5), (-1.0, 0.5, 0.5))
"""Weights (b, g, r) of pictures that show one colour against the two others."""


@dataclass(frozen=True)
class Paint:
    """How a picture is turned into one plane on which the antenna stands out.

    Attributes
    ----------
    bright : on that plane the antenna is brighter than its surroundings; None: here brighter, there darker.
    weights : (b, g, r) of a colour picture's channels; None for its grey level.
    """

    bright: bool | None = True
    weights: tuple[float, float, float] | None = None

    def plane(self, image: np.ndarray) -> np.ndarray:
        """(H, W) of a grey (H, W) or colour (H, W, 3 or 4) picture: blue, green, red, any depth."""
        if image.ndim == 2:
            return image
        colour = np.ascontiguousarray(image[..., :3])
        if self.weights is None:
            return cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY)
        return cv2.transform(colour.astype(np.float32), np.array([self.weights], np.float32))

    def find(self, finder: AntennaFinder, image: np.ndarray) -> Centreline:
        """The centreline in a grey or colour picture."""
        return finder.find(self.plane(image), self.bright)


def learn(finder: AntennaFinder, images: Sequence[np.ndarray]) -> Paint:
    """The paint that shows the antenna best in pictures (H, W[, 3]) of the free antenna: bright, dark, or its colour.

    Of a colour, the weights that part the antenna from what lies beside it by the most deviations. The default where
    the antenna is not found by any.
    """
    tried = [Paint(True), Paint(False)]
    if images[0].ndim == 3:
        tried += [Paint(bright, weights) for weights in OPPONENTS for bright in (True, False)]
    rated = [(_clearness(finder, images, paint), index) for index, paint in enumerate(tried)]
    best, index = max(rated)
    if best <= 0.0:
        return Paint()
    if images[0].ndim == 2:
        return tried[index]
    refined = _parting(tried[index], finder, images)
    return refined if _clearness(finder, images, refined) > best else tried[index]


def _clearness(finder: AntennaFinder, images: Sequence[np.ndarray], paint: Paint) -> float:
    """Mean height over noise of the lines found, weighted by what was seen of them."""
    lines = [paint.find(finder, image) for image in images]
    return float(np.mean([line.found * line.seen * line.amplitude / max(line.noise, 1e-6) for line in lines]))


def _parting(paint: Paint, finder: AntennaFinder, images: Sequence[np.ndarray]) -> Paint:
    """Weights along which the antenna's colour differs from its flanks' by the most of their deviations."""
    on, beside = [], []
    for image in images:
        line = paint.find(finder, image)
        if line.found:
            on.append(_sampled(image, line.points_px, 0.0))
            beside += [_sampled(image, line.points_px, side * 1.5 * finder.corridor.width_px) for side in (-1, 1)]
    antenna, ground = np.concatenate(on), np.concatenate(beside)
    scatter = np.cov(ground.T) + np.cov(antenna.T)
    # a drawn or clipped picture may have no noise at all
    ridge = max(1e-3 * float(np.trace(scatter)), 1e-6)
    weights = np.linalg.solve(scatter + ridge * np.eye(3), antenna.mean(axis=0) - ground.mean(axis=0))
    if not weights.any():
        return paint
    weights /= np.abs(weights).sum()
    return Paint(True, (float(weights[0]), float(weights[1]), float(weights[2])))


def _sampled(image: np.ndarray, points: np.ndarray, aside: float) -> np.ndarray:
    """(N, 3) colours at points moved across their line."""
    along = np.gradient(points, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    at = np.rint(points + aside * along[:, ::-1] * [-1.0, 1.0]).astype(int)
    at = np.clip(at, 0, [image.shape[1] - 1, image.shape[0] - 1])
    return image[at[:, 1], at[:, 0], :3].astype(float)
