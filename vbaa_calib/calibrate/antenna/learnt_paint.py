"""Which paint sets the antenna off from its surroundings, as pictures show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eigh

from vbaa_calib.core.polyline import beside
from vbaa_calib.detect.whisker.centreline import Centreline
from vbaa_calib.detect.whisker.finder import AntennaFinder
from vbaa_calib.detect.whisker.paint import SHOWN, Paint
from vbaa_calib.detect.whisker.profile import measure_on

_OPPONENTS = ((0.5, 0.5, -1.0), (0.5, -1.0, 0.5), (-1.0, 0.5, 0.5))
"""Weights (b, g, r) of pictures that show one colour against the two others."""
WELL_SEEN, ENOUGH, CLEARLY_MORE = 0.9, 0.7, 0.1
"""Shares of the antenna that a paint sees. From `WELL_SEEN` on, one polarity by brightness is taken; below, nearness to
the antenna's colour is tried, too. Below `ENOUGH`, a polarity that changes along the antenna is taken if it sees more
by `CLEARLY_MORE`, since it fits other things as well."""
PULLED_ASIDE = 0.018
"""By which part of its width a line must lie off the middle between its edges, in free pictures, to be measured by
these."""


def learn(finders: Sequence[AntennaFinder], images: Sequence[np.ndarray]) -> Paint | None:
    """The paint that shows the antenna best in pictures (H, W[, 3]); None where none finds it.

    Brighter or darker than its surroundings, in grey, by weighted colours, or by its own colour; a polarity that
    changes along the antenna only where that sees clearly more.

    finders : one for each picture.
    """
    planes = [None, *_OPPONENTS] if images[0].ndim == 3 else [None]

    def best_of(*brights: bool | None) -> _Tried:
        tried = [_Tried.of(Paint(bright, plane), finders, images) for plane in planes for bright in brights]
        return max(tried, key=_Tried.clearness).parted(finders, images)

    best = best_of(True, False)
    if best.seen < WELL_SEEN:
        changing = best_of(None)
        # of one colour, though here brighter, there darker than what lies behind it
        best = max((best, *(one.in_its_colour(finders, images) for one in (best, changing))), key=_Tried.rank)
        if best.seen < ENOUGH and changing.seen > best.seen + CLEARLY_MORE:
            best = changing
    return best.pulled(finders, images).paint if best.seen else None


@dataclass(frozen=True)
class _Tried:
    """A paint, the lines that it finds in pictures, and how much of the antenna is seen in the mean."""

    paint: Paint
    lines: tuple[Centreline, ...]
    seen: float

    @staticmethod
    def of(paint: Paint, finders: Sequence[AntennaFinder], images: Sequence[np.ndarray]) -> _Tried:
        lines = tuple(
            finder.find(paint.plane(image), paint.bright) for finder, image in zip(finders, images, strict=True)
        )
        # a second line does not make the first one less seen
        return _Tried(paint, lines, float(np.mean([line.seen * (line.verdict in SHOWN) for line in lines])))

    def clearness(self) -> float:
        """Mean height over noise of the lines found, weighted by what was seen of them."""
        heights = [line.found * line.seen * line.amplitude / max(line.noise, 1e-6) for line in self.lines]
        return float(np.mean(heights))

    def rank(self) -> tuple[float, float]:
        """More is better."""
        return self.seen, self.clearness()

    def in_its_colour(self, finders: Sequence[AntennaFinder], images: Sequence[np.ndarray]) -> _Tried:
        """The antenna by its median colour where it was found; itself where it was not found, or in grey pictures."""
        found = [(image, line.points_px) for image, line in zip(images, self.lines, strict=True) if line.found]
        if not found or images[0].ndim == 2:
            return self
        b, g, r = np.median(np.concatenate([_sampled(image, points, 0.0) for image, points in found]), axis=0).tolist()
        return _Tried.of(Paint(True, colour=(b, g, r)), finders, images)

    def pulled(self, finders: Sequence[AntennaFinder], images: Sequence[np.ndarray]) -> _Tried:
        """Measured by both edges where its lines lie aside of their middle."""
        if self.paint.bright is None:
            return self
        width, aside = finders[0].corridor.width_px, []
        for image, line in zip(images, self.lines, strict=True):
            between = measure_on(self.paint.plane(image), line.guide_px, width, None) if line.found else line
            if between.found:
                aside.append(np.sqrt(np.mean(beside(between.guide_px, line.points_px)[1] ** 2)))
        both = bool(aside) and float(np.median(aside)) > PULLED_ASIDE * width
        return replace(self, paint=replace(self.paint, both_edges=both))

    def parted(self, finders: Sequence[AntennaFinder], images: Sequence[np.ndarray]) -> _Tried:
        """With weights that separate the antenna better from its flanks, if there are any."""
        if not self.seen or images[0].ndim == 2:
            return self
        other = _Tried.of(_parting(self, finders[0].corridor.width_px, images), finders, images)
        return other if other.clearness() > self.clearness() else self


def _parting(tried: _Tried, width_px: float, images: Sequence[np.ndarray]) -> Paint:
    """Colour weights that separate the antenna from its flanks by the most standard deviations (Fisher)."""
    found = [(image, line.points_px) for image, line in zip(images, tried.lines, strict=True) if line.found]
    antenna = np.concatenate([_sampled(image, points, 0.0) for image, points in found])
    flanks = [
        np.concatenate([_sampled(image, points, side * 1.5 * width_px) for image, points in found]) for side in (-1, 1)
    ]
    scatter = np.cov(np.concatenate(flanks).T) + np.cov(antenna.T)
    # a drawn or clipped picture may have no noise at all
    ridge = max(1e-3 * float(np.trace(scatter)), 1e-6)
    differences = antenna - 0.5 * (flanks[0] + flanks[1])
    bright = None if tried.paint.bright is None else True
    if bright:
        weights = np.linalg.solve(scatter + ridge * np.eye(3), differences.mean(axis=0))
    else:
        # the differences change their sign along the antenna: by their squares, over those from flank to flank
        across = flanks[1] - flanks[0]
        weights = eigh(differences.T @ differences, across.T @ across + len(across) * ridge * np.eye(3))[1][:, -1]
    if not weights.any():
        return tried.paint
    weights = weights / np.abs(weights).sum()
    return Paint(bright, (float(weights[0]), float(weights[1]), float(weights[2])))


def _sampled(image: np.ndarray, points: np.ndarray, aside: float) -> np.ndarray:
    """(N, C) colours of a picture (H, W[, 3]) at points moved across their line."""
    along = np.gradient(points, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    at = np.rint(points + aside * along[:, ::-1] * [-1.0, 1.0]).astype(int)
    at = np.clip(at, 0, [image.shape[1] - 1, image.shape[0] - 1])
    colours = image[at[:, 1], at[:, 0]].astype(float)
    return colours[:, None] if image.ndim == 2 else colours[:, :3]
