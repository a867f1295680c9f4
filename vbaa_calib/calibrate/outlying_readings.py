"""Readings that are slips: off the curve and off their neighbours too.

Errors that neighbours share (a bumpy rail, a sticking gauge) leave the curve in company and are no slips; a reading
that leaves it alone is one. Both scales are medians, so that up to a third of the readings may be anything.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

LEAST_READINGS = 8
"""Fewer readings have no neighbours to be compared with."""
_THRESHOLD = 5.0
_PER_MEDIAN = 1.4826
_ANCHORS = 40


def robust_line(regressor: np.ndarray, y: np.ndarray, offset: bool) -> tuple[float, float]:
    """(slope, intercept) of y (N,) over the regressor (N,) with the least median of squares; intercept 0 if held.

    Of all lines through two readings (through one and the origin), at most 780 of them, spread evenly.
    """
    anchors = np.unique(np.linspace(0, len(y) - 1, _ANCHORS).astype(int))
    apart = 0.2 * np.ptp(regressor)
    if offset:
        pairs = np.array([p for p in combinations(anchors, 2) if abs(regressor[p[0]] - regressor[p[1]]) > apart])
        slopes = np.diff(y[pairs])[:, 0] / np.diff(regressor[pairs])[:, 0]
        intercepts = y[pairs[:, 0]] - slopes * regressor[pairs[:, 0]]
    else:
        anchors = anchors[np.abs(regressor[anchors]) > 0.2 * np.abs(regressor).max()]
        slopes = y[anchors] / regressor[anchors]
        intercepts = np.zeros_like(slopes)
    misses = np.median(np.abs(y - slopes[:, None] * regressor - intercepts[:, None]), axis=1)
    best = int(np.argmin(misses))
    return float(slopes[best]), float(intercepts[best])


def outlying(residuals: np.ndarray, least_std: float) -> np.ndarray:
    """(N,) bool: which residuals from a robust fit, in the order of x, are slips. None of fewer than 8.

    `least_std` bounds the scatter from below: readings that are rounded may agree too well.
    """
    if len(residuals) < LEAST_READINGS:
        return np.zeros(len(residuals), bool)
    around = residuals - np.array([np.median(_neighbours(residuals, index)) for index in range(len(residuals))])
    return _far(residuals, least_std) & _far(around, least_std)


def _neighbours(values: np.ndarray, index: int) -> np.ndarray:
    """The four nearest in order, two on either side where there are two."""
    first = min(max(index - 2, 0), len(values) - 5)
    return np.delete(values[first : first + 5], index - first)


def _far(values: np.ndarray, least_std: float) -> np.ndarray:
    scale = max(_PER_MEDIAN * float(np.median(np.abs(values))), least_std)
    return np.abs(values) > _THRESHOLD * scale
