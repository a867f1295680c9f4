"""The antenna's paint (bright or dark, by colour or by one edge) that separates it best from its surroundings in
pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.core.polyline import arc_lengths, offsets_from
from vbaa_calib.detect.whisker.centreline import Centreline
from vbaa_calib.detect.whisker.finder import AntennaFinder, coloured
from vbaa_calib.detect.whisker.paint import PLACES, VISIBLE, Paint
from vbaa_calib.detect.whisker.profile import measure_between

from .settings import AntennaSettings


def learn(finders: Sequence[AntennaFinder], images: Sequence[np.ndarray]) -> Paint | None:
    """The paint with which the antenna is found most clearly in pictures (H, W[, 3]); None where none finds it.

    In colour pictures it is found by its edges, of whatever polarity. In grey ones, and where it is too thin for two
    edges, it is brighter or darker than its surroundings, unless a polarity that changes along it shows clearly more.

    finders : one for each picture.
    """
    in_colour = coloured(images[0])
    polarities = (True, False) if not in_colour or finders[0].corridor.width_px < AntennaSettings.two_edges_px else ()
    tried = [_Tried.of(Paint(bright), finders, images) for bright in polarities]
    best = max(tried, key=_Tried.clearness, default=None)
    if best is None or best.seen < AntennaSettings.well_seen:
        changing = _Tried.of(Paint(None), finders, images)
        best = (
            changing if best is None or in_colour or changing.seen > best.seen + AntennaSettings.clearly_more else best
        )
    return best.pulled(finders, images).paint if best.seen else None


@dataclass(frozen=True)
class _Tried:
    """A candidate paint, the lines found with it, and the mean share of the antenna that is visible."""

    paint: Paint
    lines: tuple[Centreline, ...]
    seen: float

    @staticmethod
    def of(paint: Paint, finders: Sequence[AntennaFinder], images: Sequence[np.ndarray]) -> _Tried:
        lines = tuple(
            finder.find(paint.plane(image), paint.bright, image) for finder, image in zip(finders, images, strict=True)
        )
        seen = [_seen_between(line, finder.corridor.width_px) for line, finder in zip(lines, finders, strict=True)]
        # a second line does not make the first one less seen
        clear = [line.verdict in VISIBLE for line in lines]
        return _Tried(paint, lines, float(np.mean(np.multiply(seen, clear))))

    def clearness(self) -> float:
        """Mean signal-to-noise ratio of the lines found, weighted by their visible share."""
        heights = [line.found * line.seen * line.amplitude / max(line.noise, 1e-6) for line in self.lines]
        return float(np.mean(heights))

    def pulled(self, finders: Sequence[AntennaFinder], images: Sequence[np.ndarray]) -> _Tried:
        """The same paint measured by both edges, where a one-sided measurement lies off the middle between them."""
        if self.paint.bright is None:
            return self
        where, offsets = finders[0].corridor, []
        width, taper = where.width_px, where.taper
        for image, line in zip(images, self.lines, strict=True):
            plane = self.paint.plane(image)
            between = measure_between(plane, line, width) if line.found else line
            if between.found:
                # the thin part of an antenna that tapers has noise alone
                half = len(line.points_px) // 2
                thick = line.points_px[: half if taper < 0.0 else None][half if taper > 0.0 else 0 :]
                # light pulls stretches of a line, noise its points
                parts = np.array_split(offsets_from(between.guide_px, thick)[1], PLACES)
                offsets.append(np.sqrt(np.mean([np.mean(one) ** 2 for one in parts if len(one)])))
        # a thinner one has no two edges that are known better
        thickest = max(width * (1.0 + 0.25 * abs(taper)), AntennaSettings.two_edges_px)
        both = bool(offsets) and float(np.median(offsets)) > AntennaSettings.off_middle * thickest
        return replace(self, paint=replace(self.paint, both_edges=both))


def _seen_between(line: Centreline, width_px: float) -> float:
    """Visible share of a line, its ends excluded."""
    if len(line.guide_px) < 2:
        return line.seen
    along = arc_lengths(line.guide_px)
    between = (along > AntennaSettings.ends * width_px) & (along < along[-1] - AntennaSettings.ends * width_px)
    return float(line.measured[between].mean()) if between.any() else line.seen
